// Keyframes and other constraints as plain data: pure functions, which the page and its unit tests call.

// Frames of a text such as "0,15,40", "10-40" or "all", rising; of a clip of `frames` frames.
export function framesOf(text, frames) {
  const found = new Set();
  for (const part of (text || "").split(/[,\s]+/).filter(Boolean)) {
    const range = /^(\d+)-(\d+)$/.exec(part), every = /^every:0*([1-9]\d*)$/.exec(part);
    if (part === "all") for (let f = 0; f < frames; f++) found.add(f);
    else if (every) { for (let f = 0; f < frames; f += Number(every[1])) found.add(f); found.add(frames - 1); }
    else if (range) for (let f = Number(range[1]); f <= Math.min(Number(range[2]), frames - 1); f++) found.add(f);
    else if (/^\d+$/.test(part) && Number(part) < frames) found.add(Number(part));
  }
  return [...found].sort((a, b) => a - b);
}

export const textOf = (keys) => (keys.length ? [...new Set(keys)].sort((a, b) => a - b).join(",") : null);

// Keys of a row: the whole body's for "", else those of a part.
export function keysOf(asked, row, frames) {
  if (!row) return framesOf(asked.keyframes, frames);
  return [...new Set(asked.parts.filter((p) => p.part === row).flatMap((p) => framesOf(p.frames, frames)))].sort((a, b) => a - b);
}

// The constraints with other keys in a row.
export function withKeys(asked, row, keys) {
  const text = textOf(keys);
  if (!row) return { ...asked, keyframes: text };
  const others = asked.parts.filter((p) => p.part !== row);
  return { ...asked, parts: text ? [...others, { part: row, frames: text }] : others };
}

export function toggled(keys, frame) {
  return keys.includes(frame) ? keys.filter((k) => k !== frame) : [...keys, frame].sort((a, b) => a - b);
}

// A key at another frame; one that is there already is replaced.
export function moved(keys, from, to, frames) {
  const place = Math.max(0, Math.min(frames - 1, to));
  return [...new Set([...keys.filter((k) => k !== from), place])].sort((a, b) => a - b);
}

// Stretches without a key between keys: first and last missing frame, and their length in seconds.
export function gapsOf(keys, fps) {
  return keys.slice(1).flatMap((k, i) => (k - keys[i] > 1
    ? [{ first: keys[i] + 1, last: k - 1, seconds: (k - keys[i]) / fps }] : []));
}

// The colour class of a gap: what the weights were measured to fill well, less well, and hardly.
export const gapClass = (seconds) => (seconds <= 0.55 ? "short" : seconds <= 1.05 ? "medium" : "long");

export const rangeText = ([first, last]) => (first === last ? `${first}` : `${first}-${last}`);

// Points (x, z) at equal steps of time along a drawn line, for frames first to last.
export function alongLine(points, first, last) {
  const lengths = [0];
  for (let i = 1; i < points.length; i++) {
    lengths.push(lengths[i - 1] + Math.hypot(points[i][0] - points[i - 1][0], points[i][1] - points[i - 1][1]));
  }
  const total = lengths[lengths.length - 1], frames = [], places = [];
  for (let f = first, i = 0; f <= last; f++) {
    const at = total * (last > first ? (f - first) / (last - first) : 0);
    while (i < points.length - 2 && lengths[i + 1] < at) i++;
    const step = lengths[i + 1] - lengths[i], share = step > 0 ? Math.min(1, (at - lengths[i]) / step) : 0;
    frames.push(f);
    places.push([0, 1].map((k) => Number((points[i][k] + share * (points[i + 1][k] - points[i][k])).toFixed(4))));
  }
  return { frames, places };
}
