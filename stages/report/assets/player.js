// The player: scenes of motions side by side, a shared camera, a timeline with keyframes and errors.
"use strict";

const byId = (id) => document.getElementById(id);
const MOTION_COLOURS = ["--truth", "--second", "--third", "--fourth", "--fifth"];
const FEW_MOTIONS = 4; // that a phone shows at first, if there are more: the first and the last ones

// The colour of the motion with this number as CSS; those beyond the named ones turn around the circle of hues.
function motionColour(number) {
  if (number < MOTION_COLOURS.length) return `var(${MOTION_COLOURS[number]})`;
  return `oklch(64% 0.15 ${Math.round(number * 137.5) % 360})`;
}

// Millimetres, with a tenth where they are few.
const millimetres = (value) => `${value.toFixed(value < 9.95 ? 1 : 0)} mm`;

class MotionData {
  constructor(raw) {
    Object.assign(this, raw);
    const bytes = Uint8Array.from(atob(raw.points), (c) => c.charCodeAt(0));
    this.values = new Int16Array(bytes.buffer);
    this.nodes = raw.nodes;
  }

  // A node's place, metres, at a frame; between two frames on the straight line from one to the other.
  at(frame, node) {
    const first = Math.min(Math.floor(frame), this.frames - 1), next = Math.min(first + 1, this.frames - 1);
    const i = (first * this.nodes + node) * 3, j = (next * this.nodes + node) * 3, share = frame - first;
    const v = this.values, s = this.scale;
    if (!(share > 0)) return [v[i] * s, v[i + 1] * s, v[i + 2] * s];
    return [0, 1, 2].map((k) => s * (v[i + k] + share * (v[j + k] - v[i + k])));
  }

  // The frame shown at a time, a whole number; and the same with what lies between frames.
  frameAt(seconds) { return Math.round(this.placeAt(seconds)); }
  placeAt(seconds) { return Math.max(0, Math.min(this.frames - 1, seconds * this.fps)); }

  // Mean distance of the nodes from another motion's at the same moment, millimetres; null where nodes differ.
  distancesTo(other) {
    if (other.nodes !== this.nodes) return null;
    return Float32Array.from({ length: other.frames }, (_, f) => {
      const mine = this.frameAt(f / other.fps);
      let sum = 0;
      for (let n = 0; n < this.nodes; n++) {
        const a = this.at(mine, n), b = other.at(f, n);
        sum += Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
      }
      return 1000 * sum / this.nodes;
    });
  }
}

class Player {
  constructor(scenes) {
    this.scenes = scenes;
    this.camera = new Camera();
    this.canvas = byId("view");
    this.line = byId("timeline");
    this.playing = false;
    this.time = 0;
    this.options = { ghosts: true, truth: false, follow: true, loop: true, overlay: scenes.every((scene) => scene.overlay), speed: 1 };
    const select = this.buildControls();
    this.listenToPointer();
    this.listenToKeys();
    const linked = (name, otherwise) => Number((new RegExp(`${name}=(\\d+)`).exec(location.hash) || [0, otherwise])[1]);
    select.value = Math.min(linked("scene", 0), this.scenes.length - 1);
    this.choose(Number(select.value));
    new ResizeObserver(() => this.draw()).observe(this.canvas.parentElement);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    if (/frame=/.test(location.hash)) this.seek(linked("frame", 0));
    else if (!matchMedia("(prefers-reduced-motion: reduce)").matches) this.play(true);
  }

  choose(index) {
    const raw = this.scenes[index];
    this.scene = { ...raw, motions: raw.motions.map((m) => new MotionData(m)) };
    const first = this.first = this.scene.motions[0];
    this.errors = this.scene.motions.slice(1).map((m) => m.distancesTo(first));
    this.camera.target = [0, this.scene.floor + 0.52 * this.scene.height, 0];
    this.camera.distance = 2.1 * this.scene.size;
    this.time = 0;
    byId("legend").innerHTML = "";
    this.scene.motions.forEach((m, i) => {
      const item = document.createElement("button");
      item.innerHTML = `<i style="background:${motionColour(i)}"></i>`;
      item.append(m.name);
      const errors = i ? this.errors[i - 1] : null;
      if (errors) item.append(` ${millimetres(errors.reduce((a, b) => a + b, 0) / errors.length)}`);
      item.title = errors ? `Show or hide; mean distance of the joints from ${first.name}` : "Show or hide";
      item.onclick = () => this.toggle(i);
      byId("legend").append(item);
    });
    this.hideSome();
    this.draw();
  }

  // Motions that were hidden by name stay so in another scene.
  hideSome() {
    const motions = this.scene.motions, narrow = this.canvas.clientWidth < 700;
    if (!this.hidden) {
      const spare = narrow ? motions.slice(1, Math.max(1, motions.length - FEW_MOTIONS + 1)) : [];
      this.hidden = new Set(motions.length > FEW_MOTIONS + 1 ? spare.map((m) => m.name) : []);
    }
    this.shown = motions.map((_, i) => i).filter((i) => !this.hidden.has(motions[i].name));
    if (!this.shown.length) this.shown = [0];
    const rows = Math.ceil(this.shown.length / (narrow ? 2 : 4));
    byId("stage").classList.toggle("two-rows", this.shown.length > 4 || rows > 2);
    [...byId("legend").children].forEach((item, i) => item.setAttribute("aria-pressed", this.shown.includes(i)));
  }

  toggle(number) {
    const { name } = this.scene.motions[number];
    if (!this.hidden.delete(name)) this.hidden.add(name);
    this.hideSome();
    this.draw();
  }

  get frame() { return this.first.frameAt(this.time); }

  seek(frame) {
    const last = this.first.frames - 1;
    this.time = Math.max(0, Math.min(last, frame)) / this.first.fps;
    this.draw();
  }

  play(on) {
    this.playing = on;
    byId("play").textContent = on ? "❚❚" : "▶";
    byId("play").setAttribute("aria-label", on ? "Pause" : "Play");
    let last = null;
    const tick = (now) => {
      if (!this.playing) return;
      if (last !== null) this.advance((now - last) / 1000 * this.options.speed);
      last = now;
      requestAnimationFrame(tick);
    };
    if (on) requestAnimationFrame(tick);
  }

  advance(seconds) {
    const length = this.first.frames / this.first.fps;
    this.time += Math.min(seconds, 0.25);
    if (this.time >= length) {
      if (this.options.loop) this.time %= length;
      else { this.time = length; this.play(false); }
    }
    this.draw();
  }

  jumpKey(direction) {
    const keys = this.scene.keys, frame = this.frame;
    const next = direction > 0 ? keys.find((k) => k > frame) : [...keys].reverse().find((k) => k < frame);
    this.play(false);
    if (next !== undefined) this.seek(next);
  }

  step(frames) { this.play(false); this.seek(this.frame + frames); }

  buildControls() {
    const select = byId("scene");
    const titles = new Map(); // scenes of one title form a group, where there are several
    this.scenes.forEach((scene, i) => titles.set(scene.title, [...(titles.get(scene.title) || []), i]));
    for (const [title, members] of titles) {
      const group = members.length > 1 ? document.createElement("optgroup") : select;
      if (group !== select) { group.label = title; select.append(group); }
      for (const i of members) group.append(new Option(this.scenes[i].name, i));
    }
    select.hidden = this.scenes.length < 2;
    select.onchange = () => this.choose(Number(select.value));
    byId("play").onclick = () => this.play(!this.playing);
    byId("back").onclick = () => this.step(-1);
    byId("forward").onclick = () => this.step(1);
    byId("key-back").onclick = () => this.jumpKey(-1);
    byId("key-forward").onclick = () => this.jumpKey(1);
    byId("speed").onchange = (e) => { this.options.speed = Number(e.target.value); };
    for (const name of ["ghosts", "truth", "follow", "loop", "overlay"]) {
      byId(name).checked = this.options[name];
      byId(name).onchange = (e) => { this.options[name] = e.target.checked; this.draw(); };
    }
    for (const button of document.querySelectorAll("[data-view]")) {
      button.onclick = () => { this.camera.preset(button.dataset.view); this.draw(); };
    }
    return select;
  }

  listenToPointer() {
    const view = this.canvas, line = this.line, held = new Map(); // pointers that are down -> where they are
    const release = (e) => held.delete(e.pointerId);
    view.addEventListener("pointerdown", (e) => {
      held.set(e.pointerId, [e.clientX, e.clientY]);
      view.setPointerCapture(e.pointerId);
    });
    view.addEventListener("pointerup", release);
    view.addEventListener("pointercancel", release);
    view.addEventListener("pointermove", (e) => {
      if (!held.has(e.pointerId)) return;
      const before = grip(held);
      held.set(e.pointerId, [e.clientX, e.clientY]);
      const after = grip(held), dx = after.x - before.x, dy = after.y - before.y;
      const two = held.size > 1; // two fingers pan and pinch, one orbits
      if (two || e.shiftKey || e.buttons === 2 || e.buttons === 4) this.camera.pan(dx, dy, view.clientHeight);
      else this.camera.orbit(dx, dy);
      if (two && before.spread > 0 && after.spread > 0) this.camera.zoom(before.spread / after.spread);
      this.draw();
    });
    view.addEventListener("contextmenu", (e) => e.preventDefault());
    view.addEventListener("wheel", (e) => { e.preventDefault(); this.camera.zoom(Math.exp(e.deltaY * 0.001)); this.draw(); },
      { passive: false });
    const scrub = (e) => {
      const { left, width } = this.track();
      this.play(false);
      this.seek(Math.round((e.offsetX - left) / width * (this.first.frames - 1)));
    };
    line.addEventListener("pointerdown", (e) => { line.setPointerCapture(e.pointerId); scrub(e); });
    line.addEventListener("pointermove", (e) => { if (e.buttons) scrub(e); });
  }

  listenToKeys() {
    const actions = {
      " ": () => this.play(!this.playing), ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1),
      ",": () => this.jumpKey(-1), ".": () => this.jumpKey(1), Home: () => this.step(-1e9), End: () => this.step(1e9),
    };
    addEventListener("keydown", (e) => {
      if (/SELECT|INPUT|BUTTON|SUMMARY/.test(e.target.tagName) && e.key === " ") return;
      if (e.target.tagName === "SELECT" || !actions[e.key] || e.ctrlKey || e.metaKey || e.altKey) return;
      e.preventDefault();
      actions[e.key]();
    });
  }

  colours() {
    const style = getComputedStyle(document.documentElement), get = (name) => style.getPropertyValue(name).trim();
    const left = get("--left"), right = get("--right");
    return {
      groups: [get("--spine"), left, right, left, right], rim: get("--stage"), joint: get("--joint"), key: get("--key"),
      grid: get("--grid"), shadow: get("--shadow"), trail: get("--trail"), text: get("--text"), dim: get("--dim"),
      ghost: get("--ghost"), faint: Number(get("--faint")), rule: get("--rule"),
      motion: (i) => (i < MOTION_COLOURS.length ? get(MOTION_COLOURS[i]) : motionColour(i)),
    };
  }

  draw() {
    const colours = this.colours();
    this.drawView(colours);
    this.drawTimeline(colours);
    const frame = this.frame, isKey = this.scene.keys.includes(frame);
    const digits = String(this.first.frames - 1).length;
    byId("counter").innerHTML = `frame <b>${String(frame).padStart(digits, "\u2007")}</b> of ${this.first.frames - 1}`
      + `<span>${(frame / this.first.fps).toFixed(2)} s</span><em${isKey ? "" : " hidden"}>keyframe</em>`;
  }

  drawView(colours) {
    const { ctx, width, height } = fitted(this.canvas), numbers = this.shown, motions = numbers.map((i) => this.scene.motions[i]);
    const most = this.options.overlay ? motions.length : width < 700 ? 2 : motions.length > 12 ? 5 : 4, rows = Math.ceil(motions.length / most);
    const columns = this.options.overlay ? 1 : Math.ceil(motions.length / rows); // rows as even as can be
    const w = width / columns, h = height / rows;
    if (this.options.overlay) {
      const view = { x: 0, y: 0, w, h };
      this.drawPanel(ctx, view, motions.map((m, i) => [m, colours.motion(numbers[i])]), colours);
      return;
    }
    motions.forEach((motion, i) => {
      const number = numbers[i], view = { x: (i % columns) * w, y: Math.floor(i / columns) * h, w, h };
      this.drawPanel(ctx, view, [[motion, null]], colours);
      ctx.fillStyle = colours.rule;
      if (view.x) ctx.fillRect(view.x, view.y + 12, 1, h - 24);
      ctx.fillStyle = colours.motion(number);
      ctx.beginPath();
      ctx.arc(view.x + 20, view.y + 22, 5, 0, 7);
      ctx.fill();
      ctx.font = "600 14px system-ui, sans-serif";
      label(ctx, motion.name, view.x + 32, view.y + 27, w - 44, colours.text, colours.rim);
      const errors = number ? this.errors[number - 1] : null;
      if (errors) {
        ctx.font = "12px system-ui, sans-serif";
        const off = `${millimetres(errors[this.frame])} off here`;
        label(ctx, off, view.x + 32, view.y + 45, w - 44, colours.dim, colours.rim);
      }
    });
  }

  drawPanel(ctx, view, drawn, colours) {
    ctx.save();
    ctx.beginPath();
    ctx.rect(view.x, view.y, view.w, view.h);
    ctx.clip();
    // All panels follow the first motion, so that a drift of another can be seen as such.
    const now = (motion) => motion.placeAt(this.time);
    const centre = this.options.follow ? this.first.at(now(this.first), this.first.root) : [0, 0, 0];
    const project = this.camera.projector(view, centre), floor = this.scene.floor;
    const ground = [this.camera.target[0] + centre[0], 0, this.camera.target[2] + centre[2]];
    drawGround(ctx, project, ground, floor, colours.grid);
    for (const [motion] of drawn) drawShadow(ctx, project, motion, now(motion), floor, colours.shadow);
    drawTrail(ctx, project, drawn[0][0], this.scene.keys, this.frame, floor, colours);
    if (this.options.ghosts) {
      const before = this.scene.keys.filter((k) => k < this.frame).pop(), after = this.scene.keys.find((k) => k > this.frame);
      for (const key of [before, after]) {
        if (key !== undefined) drawGhost(ctx, project, this.first, key, colours.key, colours.faint);
      }
    }
    if (this.options.truth && drawn[0][0] !== this.first) {
      drawGhost(ctx, project, this.first, now(this.first), colours.ghost, 0.55);
    }
    drawBodies(ctx, project, drawn.map(([motion, single]) => [motion, now(motion), single]), colours);
    ctx.restore();
  }

  track() { return { left: 14, width: this.line.clientWidth - 28 }; }

  drawTimeline(colours) {
    const { ctx, height } = fitted(this.line), { left, width } = this.track(), frames = this.first.frames;
    const x = (frame) => left + (frames > 1 ? frame / (frames - 1) : 0) * width, base = height - 30;
    const known = this.errors.filter((errors, i) => errors && this.shown.includes(i + 1)), top = Math.max(1, ...known.map((e) => e.reduce((a, b) => Math.max(a, b), 0)));
    ctx.strokeStyle = colours.rule;
    ctx.lineWidth = 1;
    for (const key of this.scene.keys) line(ctx, x(key), 4, x(key), base + 12);
    this.errors.forEach((errors, i) => {
      if (!errors || !this.shown.includes(i + 1)) return;
      ctx.strokeStyle = colours.motion(i + 1);
      ctx.lineWidth = 1.75;
      ctx.beginPath();
      errors.forEach((e, f) => ctx.lineTo(x(f), base - 4 - (base - 24) * e / top));
      ctx.stroke();
    });
    ctx.strokeStyle = colours.dim;
    line(ctx, left, base + 12, left + width, base + 12);
    ctx.font = "11px system-ui, sans-serif";
    ctx.fillStyle = colours.dim;
    if (known.length) ctx.fillText(`distance from ${this.first.name}, up to ${millimetres(top)}`, left + 4, 13);
    const every = [1, 5, 10, 15, 30, 60, 120, 240, 480, 960, 4800].find((n) => width * n / frames > 44) || 9600;
    ctx.textAlign = "center";
    for (let f = 0; f < frames; f += every) ctx.fillText(f, Math.min(x(f), left + width - 2), height - 2);
    ctx.textAlign = "left";
    ctx.fillStyle = colours.key;
    for (const key of this.scene.keys) diamond(ctx, x(key), base + 12, 5);
    ctx.strokeStyle = ctx.fillStyle = colours.text;
    ctx.lineWidth = 1.5;
    line(ctx, x(this.frame), 0, x(this.frame), height - 14);
    ctx.beginPath();
    ctx.arc(x(this.frame), base + 12, 3.5, 0, 7);
    ctx.fill();
  }
}

function line(ctx, x0, y0, x1, y1) {
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}

// Where the held pointers are on average, and how far they are spread, pixels.
function grip(held) {
  const points = [...held.values()], x = mean(points.map((p) => p[0])), y = mean(points.map((p) => p[1]));
  return { x, y, spread: mean(points.map((p) => Math.hypot(p[0] - x, p[1] - y))) };
}

const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;

// Text with a rim in the background's colour, readable over a body; cut where it is wider than its panel.
function label(ctx, text, x, y, width, colour, rim) {
  let shown = text;
  while (shown.length > 1 && ctx.measureText(shown).width > width) shown = `${shown.slice(0, -2)}…`;
  ctx.lineJoin = "round";
  ctx.lineWidth = 4;
  ctx.strokeStyle = rim;
  ctx.strokeText(shown, x, y);
  ctx.fillStyle = colour;
  ctx.fillText(shown, x, y);
}

// A cleared canvas in CSS pixels, sharp on screens of any density.
function fitted(canvas) {
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const ctx = canvas.getContext("2d");
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.clearRect(0, 0, width, height);
  return { ctx, width, height };
}

function startTheme() {
  const root = document.documentElement, dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const wanted = /theme=(dark|light)/.exec(location.hash);
  root.dataset.theme = wanted ? wanted[1] : dark ? "dark" : "light";
  byId("theme").onclick = () => {
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    if (window.player) window.player.draw();
  };
}

startTheme();
const scenes = JSON.parse(byId("scenes").textContent);
if (scenes.length) window.player = new Player(scenes);
