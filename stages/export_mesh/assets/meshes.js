// Plays meshes side by side with WebGL 2. Normals come from the fragments' derivatives. No libraries.
"use strict";

const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const pick = id => document.getElementById(id);
const canvas = pick("view"), gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
if (!gl) pick("message").textContent = "This browser has no WebGL 2, which the page needs.";

const VERTEX = `#version 300 es
in vec3 place; uniform vec3 low, scale, target; uniform vec4 turn; uniform vec3 lens; out vec3 at;
void main() {
  vec3 p = low + place * scale - target; at = p;
  p = vec3(p.x * turn.x - p.z * turn.y, p.y, p.x * turn.y + p.z * turn.x);
  p = vec3(p.x, p.y * turn.z - p.z * turn.w, p.y * turn.w + p.z * turn.z);
  float depth = lens.x - p.z;
  gl_Position = vec4(p.x * lens.y, p.y * lens.z, depth - 0.1, depth);
}`;
const FRAGMENT = `#version 300 es
precision highp float; in vec3 at; uniform vec3 colour; out vec4 shown;
void main() {
  vec3 n = normalize(cross(dFdx(at), dFdy(at)));
  float light = 0.35 + 0.5 * abs(dot(n, normalize(vec3(0.4, 0.8, 0.5)))) + 0.15 * abs(n.z);
  shown = vec4(colour * light, 1.0);
}`;
const COLOURS = [[0.35, 0.55, 0.85], [0.95, 0.6, 0.25], [0.45, 0.7, 0.45], [0.75, 0.45, 0.7]];

function program() {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  return made;
}

const shader = program(), uniform = name => gl.getUniformLocation(shader, name);
const faces = {};
for (const [name, text] of Object.entries(DATA.faces)) {
  const list = new Uint32Array(bytes(text).buffer), buffer = gl.createBuffer();
  faces[name] = { buffer, count: list.length, list };
}
let shown = [], frame = 0, playing = true, yaw = 0.6, pitch = 0.15, distance = 2.6, target = [0, 0, 0], last = 0;

function load(name) {
  shown.forEach(each => { gl.deleteBuffer(each.buffer); gl.deleteVertexArray(each.array); });
  let low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
  shown = DATA.scenes[name].map(each => {
    const values = new Uint16Array(bytes(each.data).buffer), array = gl.createVertexArray();
    const buffer = gl.createBuffer();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, faces[each.whose].buffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces[each.whose].list, gl.STATIC_DRAW);
    for (let i = 0; i < 3; i++) {
      low[i] = Math.min(low[i], each.low[i]); high[i] = Math.max(high[i], each.low[i] + 65535 * each.scale[i]);
    }
    return { ...each, array, buffer, vertices: values.length / each.frames / 3 };
  });
  target = low.map((value, i) => (value + high[i]) / 2);
  distance = 1.0 * Math.hypot(...low.map((value, i) => high[i] - value));
  pick("names").replaceChildren(...shown.map(each => {
    const label = document.createElement("span"); label.textContent = each.whose; return label;
  }));
  frame = 0; pick("time").max = Math.max(...shown.map(each => each.frames)) - 1;
}

function draw() {
  canvas.width = canvas.clientWidth * devicePixelRatio; canvas.height = canvas.clientHeight * devicePixelRatio;
  gl.enable(gl.DEPTH_TEST); gl.clearColor(0.9, 0.91, 0.92, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.useProgram(shader);
  const wide = canvas.width / shown.length, at = gl.getAttribLocation(shader, "place");
  shown.forEach((each, index) => {
    gl.viewport(index * wide, 0, wide, canvas.height);
    const focal = 1.9, now = Math.min(Math.floor(frame), each.frames - 1);
    gl.uniform3fv(uniform("low"), each.low); gl.uniform3fv(uniform("scale"), each.scale);
    gl.uniform3fv(uniform("target"), target);
    gl.uniform4f(uniform("turn"), Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch));
    gl.uniform3f(uniform("lens"), distance, focal * Math.min(1, canvas.height / wide), focal * Math.min(1, wide / canvas.height));
    gl.uniform3fv(uniform("colour"), COLOURS[index % COLOURS.length]);
    gl.bindVertexArray(each.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, each.buffer);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, 3, gl.UNSIGNED_SHORT, false, 6, now * each.vertices * 6);
    gl.drawElements(gl.TRIANGLES, faces[each.whose].count, gl.UNSIGNED_INT, 0);
  });
  pick("time").value = Math.floor(frame);
  pick("counter").textContent = `frame ${Math.floor(frame)} of ${Number(pick("time").max) + 1}`;
}

function tick(now) {
  const count = Number(pick("time").max) + 1;
  if (playing && last) frame = (frame + (now - last) / 1000 * shown[0].fps) % count;
  last = now;
  draw();
  requestAnimationFrame(tick);
}

const toggle = () => { playing = !playing; pick("play").textContent = playing ? "Pause" : "Play"; };
pick("play").onclick = toggle;
pick("time").oninput = event => { playing = true; toggle(); frame = Number(event.target.value); };
pick("scene").replaceChildren(...Object.keys(DATA.scenes).map(name => new Option(name, name)));
pick("scene").onchange = event => load(event.target.value);
document.addEventListener("keydown", event => { if (event.key === " " && event.target === document.body) { toggle(); event.preventDefault(); } });
canvas.addEventListener("pointerdown", event => canvas.setPointerCapture(event.pointerId));
canvas.addEventListener("pointermove", event => {
  if (!event.buttons) return;
  yaw -= event.movementX * 0.01; pitch = Math.max(-1.5, Math.min(1.5, pitch + event.movementY * 0.01));
});
canvas.addEventListener("wheel", event => { distance *= Math.exp(event.deltaY * 0.001); event.preventDefault(); }, { passive: false });
const asked = new URLSearchParams(location.hash.slice(1));
load(asked.get("scene") || Object.keys(DATA.scenes)[0]);
if (asked.has("frame")) { frame = Number(asked.get("frame")); toggle(); }
requestAnimationFrame(tick);
