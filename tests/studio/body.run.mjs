// Vertices of a packed surface, as body.js poses them: node body.run.mjs FILE FRAME... prints a JSON list a frame.
import { readFileSync } from "node:fs";
import { Body } from "../../stages/studio/assets/body.js";

const [, , file, ...frames] = process.argv, bytes = readFileSync(file);
const body = new Body(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
const vertices = new Float32Array(body.vertices * 3), normals = new Float32Array(body.vertices * 3);
const up = Float32Array.from({ length: body.vertices * 3 }, (_, i) => (i % 3 === 1 ? 1 : 0));
console.log(JSON.stringify(frames.map((frame) => {
  body.pose(Number(frame), vertices, up, normals);
  return { vertices: [...vertices], normals: [...normals] };
})));
