// The studio's page: what is shown, what the keys and buttons do, and how changes go to the server.
import { Body } from "./body.js";
import { alongLine, framesOf, gapClass, gapsOf, keysOf, moved, rangeText, toggled, withKeys } from "./keyframes.js";
import { Motion } from "./motion.js";
import { buildVerbs, byId, chooseClip, element, fillSelect, listConstraints, listResults, showFiles } from "./panels.js";
import { Plain } from "./plain.js";
import { ask } from "./server.js";
import { Timeline } from "./timeline.js";
import { View } from "./view.js";

const PARTS = ["spine", "left_arm", "right_arm", "left_leg", "right_leg"];
const KEYS = [["Space", "play or pause"], ["← →", "a frame; with Shift 10"], [", .", "previous, next keyframe"], ["Home End", "first, last frame"],
  ["K", "set or remove a keyframe"], ["Alt ← →", "move the keyframe here"], ["[ ]", "range begins, ends here"], ["Esc", "no range"],
  ["F", "fill"], ["X", "exchange A and B"], ["C", "next way to compare"], ["G", "ghost of plain interpolation"], ["+ −", "zoom the timeline"], ["Ctrl Z", "undo; with Shift redo"], ["Ctrl S", "save"], ["?", "these keys"]];
const studio = window.studio = { session: null, motions: new Map(), shown: { a: "", b: "" }, frame: 0, range: null, playing: false, drawing: null };
let sending = Promise.resolve(), failures = 0, colours = {};
const plain = new Plain(), watched = new Map(); // id -> path of the jobs whose progress is asked for, the oldest first

const view = new View(byId("view"));
const timeline = new Timeline(byId("timeline"), {
  seek: (frame) => { play(false); seek(frame); },
  moveKey: (row, from, to) => changeKeys("Moved a key", row, (keys) => moved(keys, from, to, frames())),
  range: (range) => { studio.range = range; refresh(); },
  row: (row) => { byId("row").value = row; refresh(); },
});
studio.view = view;
studio.timeline = timeline;
studio.plain = plain;

const state = () => studio.session?.state, asked = () => state().settings.constraints;
const base = () => studio.motions.get(state()?.motion), motionOf = (side) => studio.motions.get(studio.shown[side]);
const frames = () => (base() ? base().frames : 1), row = () => byId("row").value;
const span = () => studio.range || [studio.frame, studio.frame];

function say(text, bad = false) {
  byId("status").textContent = text;
  byId("status").classList.toggle("bad", bad);
}

// Run what talks to the server, one after another. After an error the page says it, and shows what the server holds.
function send(work) {
  sending = sending.then(work).catch(async (error) => {
    failures++;
    say(error.message, true);
    if (studio.session) await ask(`sessions/${studio.session.id}`).then(receive).catch(() => {});
  });
  return sending;
}

// As `send`, for what a person asked on the ground of what the page showed: it is dropped if something failed since, as
// the page shows other settings now. Sent all the same, it would replace what another page has changed.
function sendIfNothingFails(work) {
  const before = failures;
  return send(async () => { if (failures === before) await work(); });
}

async function receive(session) {
  const old = studio.session, known = Object.keys(session.motions);
  const { motion, results } = session.state, wanted = [motion, ...results].filter(Boolean);
  const here = new Map(old?.id === session.id ? [...studio.motions].filter(([id]) => known.includes(id)) : []);
  await Promise.all(wanted.filter((id) => !here.has(id)).map(async (id) => {
    const loaded = await Motion.load(`sessions/${session.id}/motions/${id}`, id, pose);
    here.set(id, loaded);
    loaded.ready.then(refresh).catch((error) => say(error.message, true));
  }));
  studio.session = session; // only when all is there that it shows
  studio.motions = here;
  history.replaceState(null, "", `#session=${session.id}`);
  const fresh = results.filter((id) => old && !(old.id === session.id && old.motions[id]));
  if (fresh.length) studio.shown = { a: fresh[fresh.length - 1], b: results.length > fresh.length ? studio.shown.a : motion };
  if (!wanted.includes(studio.shown.a)) studio.shown.a = results[results.length - 1] || motion;
  if (!wanted.includes(studio.shown.b)) studio.shown.b = motion;
  const settings = session.state.settings;
  byId("weights").value = settings.weights;
  byId("seed").value = settings.seed;
  byId("foot-lock").checked = settings.foot_lock;
  studio.frame = Math.min(studio.frame, frames() - 1);
  if (base() && (!old || old.id !== session.id || old.state.motion !== motion)) { view.follows = false; studio.range = null; view.frame(base()); }
  for (const job of session.jobs) watch(job);
  refresh();
}

// Change how the motion is filled; the page shows it at once, and the server stores it.
function change(label, constraints, more = {}) {
  if (!base()) return;
  const settings = { ...state().settings, ...more, constraints: constraints || asked() };
  studio.session = { ...studio.session, state: { ...state(), settings } };
  refresh();
  const id = studio.session.id;
  sendIfNothingFails(async () => {
    const answer = await ask(`sessions/${id}/settings`, "PUT", { revision: studio.session.revision, label, settings });
    studio.session = { ...studio.session, revision: answer.revision, undo: answer.undo, redo: answer.redo, motions: answer.motions };
    refresh();
  });
}

const changeKeys = (label, which, make) => change(label, withKeys(asked(), which, make(keysOf(asked(), which, frames()))));
const toggleKey = () => changeKeys(keysOf(asked(), row(), frames()).includes(studio.frame) ? "Removed a key" : "Set a key", row(), (keys) => toggled(keys, studio.frame));

function post(path, body) {
  if (studio.session) sendIfNothingFails(async () => receive(await ask(`sessions/${studio.session.id}/${path}`, "POST", { revision: studio.session.revision, ...body })));
}

function open(name, blob = null, aside = false) {
  byId("open-dialog").close();
  say(`Opening ${name}…`);
  return send(async () => {
    const at = aside ? { session: studio.session.id, revision: studio.session.revision } : {};
    const query = new URLSearchParams({ name, ...at, ...(aside ? { aside: "1" } : {}) });
    for (let clip = ""; ;) {
      query.set("clip", clip);
      const made = await (blob ? ask(`upload?${query}`, "POST", blob) : ask("open", "POST", { file: name, aside, clip, ...at }));
      if (!made.clips) { await receive(made); break; }
      clip = await chooseClip(made.told, made.clips);
      if (!clip) break;
    }
    say("");
  });
}

function watch(job) {
  if (watched.has(job.id)) return;
  const path = `sessions/${studio.session.id}/jobs/${job.id}`, began = performance.now();
  watched.set(job.id, path);
  byId("cancel").hidden = byId("progress").hidden = false;
  const look = async () => {
    let now;
    try { now = await ask(path); } catch (error) { now = { state: "failed", error: error.message }; }
    if (now.total) { byId("progress").max = now.total; byId("progress").value = now.done; } else byId("progress").removeAttribute("value");
    if (now.state === "waiting" || now.state === "running") { say(now.label); setTimeout(look, 90); return; }
    watched.delete(job.id);
    byId("cancel").hidden = byId("progress").hidden = !watched.size;
    if (now.state === "failed") say(now.error, true);
    else if (now.state === "cancelled") say("Cancelled.");
    else send(async () => {
      await receive(await ask(`sessions/${studio.session.id}`));
      studio.fillSeconds = (performance.now() - began) / 1000;
      const gist = studio.session.motions[now.made.motions[0]]?.gist || [];
      say(`${studio.fillSeconds.toFixed(1)} s. ${gist.slice(0, 3).join(" ")}`);
    });
  };
  look();
}

function work(path, body) {
  if (base()) sendIfNothingFails(async () => watch(await ask(`sessions/${studio.session.id}/${path}`, "POST", body)));
}

const fill = () => { say("waiting"); work("fill", { samples: Number(byId("samples").value) || 1 }); };

// End all that runs or waits, the latest first, so that nothing that waits begins.
async function cancel() {
  for (const path of [...watched.values()].reverse()) await ask(path, "DELETE").catch((error) => say(error.message, true));
}

function edit(verb, options, other) {
  if (!base()) return;
  if (verb === "trim") {
    if (!studio.range) { say("Choose a range first: [ and ], or Shift-drag on the timeline.", true); return; }
    options = { frames: `${studio.range[0]}:${studio.range[1] + 1}` };
  }
  const needs = verb === "join" || verb === "retarget";
  if (needs && !other) { say("Choose a second file.", true); return; }
  if (!needs || studio.session.motions[other]) { work("edit", { verb, options, other: other || "" }); return; }
  const before = new Set(Object.keys(studio.session.motions));
  open(other, null, true).then(() => {
    const id = Object.keys(studio.session.motions).find((each) => !before.has(each));
    if (id) work("edit", { verb, options, other: id });
  });
}

// What is drawn: the bodies A and B, ghosts, contacts, pins and the path, at the frame shown.
function pose() {
  if (!base() || !colours.stage) return;
  const mode = byId("compare").value, a = motionOf("a") || base(), b = motionOf("b"), seconds = studio.place / base().fps;
  const wanted = [["a", a, a.placeAt(seconds), mode === "overlay" ? "a" : null, 0, "a"]];
  if (b && b !== a && mode !== "one") wanted.push(["b", b, b.placeAt(seconds), mode === "overlay" ? "b" : null, 0, "b"]);
  if (byId("ghost-keys").checked) {
    const keys = keysOf(asked(), "", frames()), before = keys.filter((k) => k < studio.place).pop(), after = keys.find((k) => k > studio.place);
    for (const key of [before, after]) if (key !== undefined && !keys.includes(studio.place)) wanted.push([`key${key === before}`, base(), key, "key", 0.2, ""]);
  }
  if (byId("ghost-results").checked) {
    for (const id of [state().motion, ...state().results]) {
      const other = studio.motions.get(id);
      if (other && !wanted.some(([, motion]) => motion === other)) wanted.push([id, other, other.placeAt(seconds), "ghost", 0.25, ""]);
    }
  }
  if (plain.motion) wanted.push(["plain", plain.motion, plain.motion.placeAt(seconds), "plain", 0.4, ""]);
  view.shown.mode = mode;
  view.surfaces = byId("surface").checked;
  if (view.surfaces) dress(wanted.filter(([, , , , faint]) => !faint).map(([, motion]) => motion));
  view.pose(wanted);
  view.follow(a, a.placeAt(seconds), byId("follow").checked);
  const standing = byId("contacts").checked ? a.contacts.filter((foot) => foot.runs.some(([from, to]) => studio.frame >= from && studio.frame <= to)) : [];
  const point = [0, 0, 0];
  const discs = standing.map((foot) => { a.at(studio.frame, foot.node, point); return [point[0], point[2]]; });
  const pins = asked().pins.map((pin, index) => ({ index, place: pin.place, frames: pin.frames }))
    .filter((pin) => pin.place && framesOf(pin.frames, frames()).includes(studio.frame));
  const path = studio.drawing?.length ? studio.drawing : asked().path ? asked().path.places.map((p) => [p[0], p[p.length - 1]]) : [];
  view.mark(discs, pins, path);
  view.draw();
}

// Ask for the surfaces of these motions; until they are there, bones are drawn.
function dress(motions) {
  for (const motion of motions.filter((each) => !each.body && !each.dressing)) {
    motion.dressing = true;
    say("Putting the motion on a body…");
    Body.load(studio.session.id, motion.id).then((body) => { motion.body = body; say(""); pose(); }, (error) => {
      motion.dressing = byId("surface").checked = false;
      say(error.message, true);
    });
  }
}

function seek(place) {
  studio.place = Math.max(0, Math.min(frames() - 1, place));
  studio.frame = Math.round(studio.place);
  timeline.at(studio.frame);
  byId("timeline").setAttribute("aria-valuenow", studio.frame);
  const last = frames() - 1, fps = base()?.fps || 30;
  byId("counter").textContent = `frame ${studio.frame} of ${last} · ${(studio.frame / fps).toFixed(2)} s`;
  if (base()) byId("key").setAttribute("aria-pressed", keysOf(asked(), row(), frames()).includes(studio.frame));
  pose();
}

function play(on) {
  if (on === studio.playing || (on && !base())) return;
  studio.playing = on;
  byId("play").textContent = on ? "❚❚" : "▶";
  byId("play").setAttribute("aria-label", on ? "Pause" : "Play");
  let last = null;
  const tick = (now) => {
    if (!studio.playing) return;
    if (last !== null) {
      const next = studio.place + Math.min((now - last) / 1000, 0.25) * base().fps * Number(byId("speed").value);
      const [from, to] = studio.range || [0, frames() - 1];
      seek(next > to ? from : next);
    }
    last = now;
    requestAnimationFrame(tick);
  };
  if (on) requestAnimationFrame(tick);
}

function jumpKey(direction) {
  if (!base()) return;
  const keys = keysOf(asked(), row(), frames()), next = direction > 0 ? keys.find((k) => k > studio.frame) : keys.filter((k) => k < studio.frame).pop();
  play(false);
  if (next !== undefined) seek(next);
}

const step = (by) => { play(false); seek(studio.frame + by); };
const setRange = (end) => { const old = span(); studio.range = end ? [Math.min(old[0], studio.frame), studio.frame] : [studio.frame, Math.max(old[1], studio.frame)]; refresh(); };

// Everything beside the view, from the session.
function refresh() {
  const there = Boolean(base());
  for (const id of ["save", "fill", "key", "keep", "lock", "pin", "draw", "key-every", "key-none", "swap"]) byId(id).disabled = !there;
  byId("empty").hidden = there;
  byId("undo").disabled = !studio.session?.undo;
  byId("redo").disabled = !studio.session?.redo;
  byId("undo").title = `Undo: ${studio.session?.undo || "nothing"} (Ctrl+Z)`;
  byId("redo").title = `Redo: ${studio.session?.redo || "nothing"} (Ctrl+Shift+Z)`;
  if (!there) return;
  const { session, shown } = studio, motion = base(), a = motionOf("a"), b = motionOf("b"), mode = byId("compare").value;
  byId("file").textContent = `${session.motions[state().motion].name} · ${motion.frames} frames at ${motion.fps} a second`;
  listResults(session, shown, {
    choose: (side, id) => { shown[side] = id; if (side === "b" && byId("compare").value === "one") byId("compare").value = "slider"; refresh(); },
    goOn: (id) => post("choose", { motion: id }), discard: (id) => post("discard", { motion: id }),
  });
  listConstraints(asked(), (field, i) => change("Removed a constraint", { ...asked(), [field]: field === "path" ? null : asked()[field].filter((_, k) => k !== i) }));
  fillSelect(byId("end"), Object.keys(motion.ends), Object.keys(motion.ends).map((name) => name.replace("_", " ")));
  const two = (mode === "slider" || mode === "beside") && b && b !== a, label = element("span", session.motions[shown.a]?.name || "");
  byId("shown").replaceChildren(label, ...(two || (mode === "overlay" && b !== a) ? [element("span", session.motions[shown.b]?.name || "")] : []));
  byId("divider").hidden = !(two && mode === "slider");
  const keys = keysOf(asked(), "", frames()), gaps = gapsOf(keys, motion.fps), counts = { short: 0, medium: 0, long: 0 };
  for (const gap of gaps) counts[gapClass(gap.seconds)]++;
  const parts = PARTS.filter((part) => part === row() || asked().parts.some((each) => each.part === part));
  byId("gaps").replaceChildren(`${keys.length} keys, ${gaps.length} gaps`, ...[["short", "to half a second"], ["medium", "to a second"], ["long", "longer"]]
    .flatMap(([name, words]) => [element("i", "", { class: name }), `${counts[name]} ${words}`]));
  plain.look(byId("ghost-plain").checked ? session : null, send, refresh);
  timeline.show({ frames: motion.frames, fps: motion.fps, asked: asked(), rows: ["", ...parts], row: row(), range: studio.range,
    speeds: (a || motion).speeds(), distances: a && b ? a.distances(b) : null, plain: plain.motion && a ? a.distances(plain.motion) : null, colours });
  byId("timeline").setAttribute("aria-valuemax", motion.frames - 1);
  seek(studio.place || 0);
}

function theme(name) {
  if (name) document.documentElement.dataset.theme = name;
  const style = getComputedStyle(document.documentElement), get = (each) => style.getPropertyValue(`--${each}`).trim();
  colours = Object.fromEntries(["stage", "grid", "shadow", "key", "a", "b", "skin", "ghost", "plain", "path", "text", "dim", "rule", "accent", "short", "medium", "long"].map((each) => [each, get(each)]));
  colours.groups = [get("spine"), get("left"), get("right"), get("left"), get("right")];
  view.colour(colours);
  refresh();
}

function listen() {
  const click = (id, act) => byId(id).addEventListener("click", act);
  const files = () => showFiles(open, (id) => { byId("open-dialog").close(); send(async () => receive(await ask(`sessions/${id}`))); });
  const undo = () => post("history", { move: "undo" }), redo = () => post("history", { move: "redo" });
  let named = ""; // the session whose file the dialog names
  const save = () => {
    if (!base()) return;
    if (named !== studio.session.id) byId("name").value = `${plainName()}.filled.bvh`;
    named = studio.session.id;
    byId("saved").textContent = "";
    byId("commands").hidden = true;
    byId("overwrite").checked = false; // asked for each time
    byId("save-dialog").showModal();
  };
  const plainName = () => studio.session.motions[state().motion].name.replace(/\.[^.]*$/, "").replace(/[^\w-]/g, "_");
  const swap = () => { const { a, b } = studio.shown; studio.shown = { a: b, b: a }; refresh(); };
  const ghost = () => { byId("ghost-plain").checked = !byId("ghost-plain").checked; refresh(); };
  const compare = () => { const select = byId("compare"); select.selectedIndex = (select.selectedIndex + 1) % select.options.length; refresh(); };
  const off = () => { studio.range = null; stopDrawing(); refresh(); };
  click("open", files); click("undo", undo); click("redo", redo); click("save", save); click("play", () => play(!studio.playing));
  click("back", () => step(-1)); click("forward", () => step(1)); click("key-back", () => jumpKey(-1)); click("key-forward", () => jumpKey(1));
  click("key", toggleKey); click("fill", fill); click("cancel", cancel); click("swap", swap); click("theme", () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
  click("range-from", () => setRange(0)); click("range-to", () => setRange(1)); click("range-off", off);
  click("zoom-in", () => timeline.zoom(0.5)); click("zoom-out", () => timeline.zoom(2)); click("keys-help", () => byId("keys-dialog").showModal());
  click("key-every", () => changeKeys("Set keys evenly", row(), (keys) => {
    const [from, to] = studio.range || [0, frames() - 1], by = Math.max(1, Number(byId("every").value) || 15), even = [];
    for (let f = from; f <= to; f += by) even.push(f);
    return [...keys.filter((k) => k < from || k > to), ...even, to];
  }));
  click("key-none", () => {
    if (!studio.range) { say("Choose a range first: [ and ], or Shift-drag on the timeline.", true); return; }
    const [from, to] = studio.range;
    changeKeys("Made a gap", row(), (keys) => [...keys.filter((k) => k < from || k > to), ...(row() ? [] : [from, to])]);
  });
  const add = (label, field, entry) => change(label, { ...asked(), [field]: [...asked()[field], entry] });
  click("keep", () => add("Kept a part", "keep", { part: byId("part").value, frames: rangeText(span()) }));
  click("lock", () => add("Locked a part", "locks", { part: byId("part").value, frames: rangeText(span()) }));
  click("pin", () => {
    const end = byId("end").value, place = (motionOf("a") || base()).at(studio.frame, base().ends[end], [0, 0, 0]).map((each) => Number(each.toFixed(4)));
    add("Pinned an end", "pins", { end, frames: rangeText(span()), place });
  });
  const stopDrawing = () => { studio.drawing = null; view.controls.enabled = true; byId("hint").hidden = true; };
  click("draw", () => { studio.drawing = []; view.controls.enabled = false; byId("hint").hidden = false; byId("hint").textContent = "Draw on the ground where the pelvis goes over the range. Esc ends it."; });
  listenInView(stopDrawing);
  for (const id of ["compare", "row", "ghost-keys", "ghost-results", "ghost-plain", "surface", "follow", "contacts"]) byId(id).addEventListener("change", refresh);
  byId("weights").onchange = (e) => change("Chose weights", null, { weights: e.target.value });
  byId("seed").onchange = (e) => change("Chose a seed", null, { seed: Math.max(0, Math.round(Number(e.target.value) || 0)) });
  byId("foot-lock").onchange = (e) => change("Feet", null, { foot_lock: e.target.checked });
  byId("upload").onchange = (e) => { if (e.target.files[0]) open(e.target.files[0].name, e.target.files[0]); };
  for (const each of document.querySelectorAll("[data-camera]")) each.onclick = () => { if (base()) view.frame(base(), each.dataset.camera); };
  addEventListener("dragover", (e) => { e.preventDefault(); document.body.classList.add("dropping"); });
  addEventListener("dragleave", () => document.body.classList.remove("dropping"));
  addEventListener("drop", (e) => { e.preventDefault(); document.body.classList.remove("dropping"); const file = e.dataTransfer.files[0]; if (file) open(file.name, file); });
  click("save-close", () => byId("save-dialog").close());
  byId("save-form").addEventListener("submit", async (e) => {
    e.preventDefault();
    try {
      const made = await ask(`sessions/${studio.session.id}/save`, "POST", { motion: studio.shown.a, name: byId("name").value, overwrite: byId("overwrite").checked });
      byId("saved").textContent = `Saved ${made.files.join(", ")}. ${made.commands.length ? "These commands write the same bytes:" : ""}`;
      byId("saved").className = "";
      byId("commands").textContent = made.commands.join("\n");
      byId("commands").hidden = !made.commands.length;
    } catch (error) { byId("saved").textContent = error.message; byId("saved").className = "bad"; }
  });
  byId("keys-list").replaceChildren(...KEYS.flatMap(([key, words]) => [element("dt", key), element("dd", words)]));
  const acts = { " ": () => play(!studio.playing), ArrowLeft: () => step(-1), ArrowRight: () => step(1), ",": () => jumpKey(-1), ".": () => jumpKey(1),
    Home: () => step(-1e9), End: () => step(1e9), k: () => base() && toggleKey(), f: fill, x: swap, c: compare, g: ghost, "[": () => setRange(0), "]": () => setRange(1),
    Escape: off, "+": () => timeline.zoom(0.5), "-": () => timeline.zoom(2), "?": () => byId("keys-dialog").showModal(), o: files };
  const moveKey = (by) => { const from = studio.frame; if (keysOf(asked(), row(), frames()).includes(from)) { changeKeys("Moved a key", row(), (keys) => moved(keys, from, from + by, frames())); seek(from + by); } };
  addEventListener("keydown", (e) => {
    if (document.querySelector("dialog[open]") || (/SELECT|INPUT/.test(e.target.tagName) && e.target.type !== "checkbox")) return;
    const command = e.ctrlKey || e.metaKey, key = e.key.length === 1 ? e.key.toLowerCase() : e.key, arrow = { ArrowLeft: -1, ArrowRight: 1 }[key];
    let act = command ? { z: e.shiftKey ? redo : undo, y: redo, s: save }[key] : acts[key];
    if (arrow && e.target.id === "divider") act = () => split(view.shown.share + arrow * 0.05);
    else if (arrow && e.altKey) act = () => base() && moveKey(arrow);
    else if (arrow && e.shiftKey) act = () => step(10 * arrow);
    if (!act || (key === " " && /BUTTON|SUMMARY|INPUT/.test(e.target.tagName))) return;
    e.preventDefault();
    act();
  });
}

function split(share) {
  view.shown.share = Math.max(0.03, Math.min(0.97, share));
  byId("divider").style.left = `${100 * view.shown.share}%`;
  byId("divider").setAttribute("aria-valuenow", Math.round(100 * view.shown.share));
  view.draw();
}

// Pointers in the view: the border between A and B, handles of pins, a path drawn on the ground.
function listenInView(stopDrawing) {
  const divider = byId("divider"), canvas = byId("view"), box = () => canvas.getBoundingClientRect();
  divider.addEventListener("pointerdown", (e) => divider.setPointerCapture(e.pointerId));
  divider.addEventListener("pointermove", (e) => { if (e.buttons) split((e.clientX - box().left) / box().width); });
  let held = null;
  canvas.addEventListener("pointerdown", (e) => {
    held = studio.drawing ? null : base() && view.pinUnder(e);
    if (held) view.controls.enabled = false;
  }, { capture: true });
  canvas.addEventListener("pointermove", (e) => {
    if (!e.buttons) return;
    if (studio.drawing) { const at = view.ground(e); if (at) { studio.drawing.push(at); pose(); } }
    if (held) { held.place = view.beside(e, held.place) || held.place; view.mark([], [held], []); view.draw(); }
  });
  canvas.addEventListener("pointerup", () => {
    if (held) change("Moved a pin", { ...asked(), pins: asked().pins.map((pin, i) => (i === held.index ? { ...pin, place: held.place } : pin)) });
    if (held) view.controls.enabled = true;
    held = null;
    if (!studio.drawing) return;
    const [from, to] = studio.range || [0, frames() - 1], line = studio.drawing;
    stopDrawing();
    if (line.length > 1) change("Drew a path", { ...asked(), path: alongLine(line, from, to) });
  });
}

async function begin() {
  studio.place = 0;
  studio.jobs = () => watched.size; // for tests
  const start = await ask("start");
  fillSelect(byId("weights"), start.weights);
  byId("surface").disabled = !start.bodies;
  byId("surface").parentElement.title = start.bodies ? "" : "They need the package anny: pip install 'pumps[mesh]'";
  const parts = ["arms", "legs", "upper_body", "lower_body", "root", "position", ...PARTS];
  fillSelect(byId("part"), parts, parts.map((part) => part.replace("_", " ")));
  buildVerbs(edit);
  listen();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (e) => theme(e.matches ? "dark" : "light"));
  theme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  const wanted = /session=([0-9a-f]{16})/.exec(location.hash);
  if (wanted) await send(async () => receive(await ask(`sessions/${wanted[1]}`)));
  else if (start.first) await open(start.first);
  const files = await ask("files");
  for (const select of document.querySelectorAll("[data-other]")) fillSelect(select, ["", ...files], ["choose a file", ...files]);
  studio.begun = true;
}

begin().catch((error) => say(error.message, true));
