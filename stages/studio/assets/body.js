// A skinned body, whose vertices follow its bones: linear blend skinning of what the server sends of a motion's surface.
import { askBytes } from "./server.js";

const STEP = 1 / 32767;

// What the server sends of a motion's surface (stages/studio/surface.py), as arrays.
export class Body {
  static async load(session, id) { return new Body(await askBytes(`sessions/${session}/motions/${id}/surface`)); }

  constructor(buffer) {
    const [vertices, width, faces, bones, frames] = new Uint32Array(buffer, 0, 5);
    let at = 20;
    const take = (kind, count) => { const part = new kind(buffer, at, count); at += part.byteLength; return part; };
    Object.assign(this, { vertices, width, bones, frames });
    this.rest = take(Float32Array, vertices * 3);
    this.heads = take(Float32Array, bones * 3);
    this.faces = take(Int32Array, faces * 3);
    this.parents = take(Int32Array, bones);
    this.ofVertex = take(Int32Array, vertices * width);
    this.weights = take(Float32Array, vertices * width);
    this.roots = take(Float32Array, frames * 3);
    this.turns = take(Int16Array, frames * bones * 4);
    this.matrices = new Float32Array(bones * 12); // of each bone three rows of four: what it does to a point at rest
    this.places = new Float32Array(bones * 3);
  }

  // The bones' matrices at a frame; between two frames, their rotations blended.
  poseBones(frame) {
    const first = Math.max(0, Math.min(Math.floor(frame), this.frames - 1)), next = Math.min(first + 1, this.frames - 1);
    const share = Math.max(0, Math.min(frame - first, 1)), { heads, matrices, parents, places, roots, turns } = this;
    for (let bone = 0; bone < this.bones; bone++) {
      const i = (first * this.bones + bone) * 4, j = (next * this.bones + bone) * 4, q = [0, 0, 0, 0];
      let dot = 0, length = 0;
      for (let k = 0; k < 4; k++) dot += turns[i + k] * turns[j + k];
      for (let k = 0; k < 4; k++) { q[k] = STEP * (turns[i + k] * (1 - share) + (dot < 0 ? -share : share) * turns[j + k]); length += q[k] * q[k]; }
      const [x, y, z, w] = q.map((each) => each / Math.sqrt(length)), m = bone * 12, up = parents[bone];
      matrices[m] = 1 - 2 * (y * y + z * z); matrices[m + 1] = 2 * (x * y - z * w); matrices[m + 2] = 2 * (x * z + y * w);
      matrices[m + 4] = 2 * (x * y + z * w); matrices[m + 5] = 1 - 2 * (x * x + z * z); matrices[m + 6] = 2 * (y * z - x * w);
      matrices[m + 8] = 2 * (x * z - y * w); matrices[m + 9] = 2 * (y * z + x * w); matrices[m + 10] = 1 - 2 * (x * x + y * y);
      for (let row = 0; row < 3; row++) {
        let place = up < 0 ? roots[first * 3 + row] * (1 - share) + roots[next * 3 + row] * share : places[up * 3 + row];
        if (up >= 0) for (let k = 0; k < 3; k++) place += matrices[up * 12 + row * 4 + k] * (heads[bone * 3 + k] - heads[up * 3 + k]);
        places[bone * 3 + row] = place;
        let moved = place;
        for (let k = 0; k < 3; k++) moved -= matrices[m + row * 4 + k] * heads[bone * 3 + k];
        matrices[m + row * 4 + 3] = moved;
      }
    }
  }

  // Vertices, and normals if there are any at rest, at a frame.
  pose(frame, vertices, restNormals = null, normals = null) {
    this.poseBones(frame);
    const { matrices, ofVertex, rest, weights, width } = this, blend = new Float32Array(12);
    for (let vertex = 0; vertex < this.vertices; vertex++) {
      blend.fill(0);
      for (let k = vertex * width; k < (vertex + 1) * width; k++) {
        const weight = weights[k], m = ofVertex[k] * 12;
        if (weight) for (let i = 0; i < 12; i++) blend[i] += weight * matrices[m + i];
      }
      const at = vertex * 3, x = rest[at], y = rest[at + 1], z = rest[at + 2];
      for (let row = 0; row < 3; row++) {
        const r = row * 4;
        vertices[at + row] = blend[r] * x + blend[r + 1] * y + blend[r + 2] * z + blend[r + 3];
        if (normals) normals[at + row] = blend[r] * restNormals[at] + blend[r + 1] * restNormals[at + 1] + blend[r + 2] * restNormals[at + 2];
      }
    }
  }
}
