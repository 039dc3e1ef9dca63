// The timeline: rows of keyframes with gaps coloured by length, a range, curves of speed and distance, the frame shown.
import { gapClass, gapsOf, keysOf } from "./keyframes.js";

const RULER = 18, ROW = 20, LEFT = 10;

export class Timeline {
  // listen: { seek(frame), moveKey(row, from, to), range([first, last] or null), row(name) }.
  constructor(canvas, listen) {
    Object.assign(this, { canvas, listen, first: 0, last: 1, data: null, held: null });
    canvas.addEventListener("pointerdown", (e) => this.grab(e));
    canvas.addEventListener("pointermove", (e) => this.drag(e));
    canvas.addEventListener("pointerup", (e) => this.drop(e));
    canvas.addEventListener("pointercancel", () => { this.held = null; this.draw(); });
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); if (this.data) this.zoom(Math.exp(e.deltaY * 0.002), this.frameAt(e.offsetX)); }, { passive: false });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  // data: { frames, fps, asked, rows, row, range, speeds, distances, plain, colours }.
  show(data) {
    if (!this.data || this.data.frames !== data.frames) { this.first = 0; this.last = Math.max(1, data.frames - 1); }
    this.data = data;
    this.draw();
  }

  zoom(factor, around = this.frame) {
    if (!this.data) return;
    const most = Math.max(1, this.data.frames - 1), span = Math.max(20, Math.min(most, (this.last - this.first) * factor));
    const share = (around - this.first) / (this.last - this.first);
    this.first = Math.max(0, Math.min(most - span, around - share * span));
    this.last = Math.min(most, this.first + span);
    this.draw();
  }

  get width() { return this.canvas.clientWidth - 2 * LEFT; }
  x(frame) { return LEFT + (frame - this.first) / (this.last - this.first) * this.width; }
  frameAt(x) {
    const frame = Math.round(this.first + (x - LEFT) / this.width * (this.last - this.first));
    return Math.max(0, Math.min(this.data.frames - 1, frame));
  }
  rowAt(y) { return this.data.rows[Math.floor((y - RULER) / ROW)]; }

  grab(e) {
    if (!this.data) return;
    this.canvas.setPointerCapture(e.pointerId);
    const row = this.rowAt(e.offsetY), frame = this.frameAt(e.offsetX);
    if (row !== undefined) {
      if (row !== this.data.row) this.listen.row(row);
      const keys = keysOf(this.data.asked, row, this.data.frames);
      const near = keys.filter((k) => Math.abs(this.x(k) - e.offsetX) < 9).sort((p, q) => Math.abs(this.x(p) - e.offsetX) - Math.abs(this.x(q) - e.offsetX))[0];
      if (near !== undefined) { this.held = { kind: "key", row, from: near, to: near }; this.listen.seek(near); return; }
    }
    this.held = e.shiftKey ? { kind: "range", from: frame } : { kind: "frame" };
    this.drag(e);
  }

  drag(e) {
    if (!this.held) return;
    const frame = this.frameAt(e.offsetX);
    if (this.held.kind === "key") { this.held.to = frame; this.listen.seek(frame); }
    else if (this.held.kind === "range") this.listen.range([Math.min(this.held.from, frame), Math.max(this.held.from, frame)]);
    else this.listen.seek(frame);
    this.draw();
  }

  drop() {
    const held = this.held;
    this.held = null;
    if (held?.kind === "key" && held.to !== held.from) this.listen.moveKey(held.row, held.from, held.to);
    this.draw();
  }

  at(frame) { // the frame shown; the rest is drawn again only where it must be
    this.frame = frame;
    if (this.data && (frame < this.first || frame > this.last)) {
      const span = this.last - this.first;
      this.first = Math.max(0, Math.min(this.data.frames - 1 - span, frame - span * 0.1));
      this.last = this.first + span;
      this.draw();
    } else this.overlay();
  }

  draw() {
    if (!this.data) return;
    const ratio = devicePixelRatio || 1, width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    this.still ||= document.createElement("canvas");
    this.still.width = Math.round(width * ratio);
    this.still.height = Math.round(height * ratio);
    const ctx = this.still.getContext("2d"), { colours, asked, frames, fps, rows, range } = this.data;
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.font = "11px system-ui, sans-serif";
    if (range) {
      ctx.fillStyle = colours.accent;
      ctx.globalAlpha = 0.18;
      ctx.fillRect(this.x(range[0]) - 2, 0, this.x(range[1]) - this.x(range[0]) + 4, height);
      ctx.globalAlpha = 1;
    }
    ctx.fillStyle = colours.dim;
    const every = [1, 5, 10, 15, 30, 60, 150, 300, 600, 1800, 3600, 18000].find((n) => this.width * n / (this.last - this.first) > 46) || 36000;
    for (let f = Math.ceil(this.first / every) * every; f <= this.last; f += every) ctx.fillText(f, this.x(f) - 3, 12);
    rows.forEach((row, i) => {
      const y = RULER + i * ROW, mid = y + ROW / 2;
      let keys = keysOf(asked, row, frames);
      if (this.held?.kind === "key" && this.held.row === row) keys = [...keys.filter((k) => k !== this.held.from), this.held.to].sort((p, q) => p - q);
      ctx.fillStyle = colours.rule;
      ctx.fillRect(LEFT, mid - 0.5, this.width, 1);
      if (!row) {
        for (const gap of gapsOf(keys, fps)) {
          if (gap.last < this.first || gap.first > this.last) continue;
          ctx.fillStyle = colours[gapClass(gap.seconds)];
          ctx.globalAlpha = 0.75;
          ctx.fillRect(this.x(gap.first - 1), mid - 3, this.x(gap.last + 1) - this.x(gap.first - 1), 6);
          ctx.globalAlpha = 1;
        }
      } else {
        ctx.fillStyle = row === this.data.row ? colours.text : colours.dim;
        ctx.fillText(row.replace("_", " "), LEFT + 2, mid - 2);
      }
      ctx.fillStyle = colours.key;
      for (const key of keys) if (key >= this.first && key <= this.last) diamond(ctx, this.x(key), mid, 6, row === this.data.row, colours.text);
    });
    const top = RULER + rows.length * ROW + 16; // below the curves' names
    if (height - top > 12) {
      const far = (v) => `up to ${v.toFixed(v < 10 ? 1 : 0)} mm`;
      let left = LEFT + 2;
      for (const [values, colour, words] of [[this.data.speeds, colours.dim, (v) => `pelvis, up to ${v.toFixed(1)} m/s`],
        [this.data.distances, colours.b, (v) => `A to B, ${far(v)}`], [this.data.plain, colours.plain, (v) => `plain, ${far(v)}`]]) left += this.curve(ctx, values, top, height - top - 3, colour, words, left);
    }
    this.overlay();
  }

  // Returns how wide its name is, with the space after it.
  curve(ctx, values, top, height, colour, words, left) {
    if (!values?.length) return 0;
    let most = 1e-9;
    for (const value of values) most = Math.max(most, value);
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.lineWidth = 1.2;
    ctx.beginPath();
    for (let px = 0; px <= this.width; px++) {
      const from = Math.floor(this.first + px / this.width * (this.last - this.first));
      const to = Math.max(from + 1, Math.floor(this.first + (px + 1) / this.width * (this.last - this.first)));
      let value = 0;
      for (let f = from; f < Math.min(to, values.length); f++) value = Math.max(value, values[f]);
      ctx[px ? "lineTo" : "moveTo"](LEFT + px, top + height * (1 - value / most));
    }
    ctx.stroke();
    ctx.fillText(words(most), left, top - 4);
    return ctx.measureText(words(most)).width + 12;
  }

  overlay() {
    if (!this.still?.width) return;
    const ratio = devicePixelRatio || 1, ctx = this.canvas.getContext("2d");
    if (this.canvas.width !== this.still.width || this.canvas.height !== this.still.height) {
      this.canvas.width = this.still.width;
      this.canvas.height = this.still.height;
    }
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    ctx.clearRect(0, 0, this.canvas.width, this.canvas.height);
    ctx.drawImage(this.still, 0, 0);
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.fillStyle = this.data.colours.text;
    ctx.fillRect(this.x(this.frame || 0) - 0.75, 0, 1.5, this.canvas.clientHeight);
  }
}

function diamond(ctx, x, y, size, chosen, rim) {
  ctx.beginPath();
  ctx.moveTo(x, y - size);
  ctx.lineTo(x + size, y);
  ctx.lineTo(x, y + size);
  ctx.lineTo(x - size, y);
  ctx.closePath();
  ctx.fill();
  if (chosen) { ctx.strokeStyle = rim; ctx.lineWidth = 1; ctx.stroke(); }
}
