// A motion as the server sends it: places of points as 16-bit numbers (little-endian, as all of today's machines).
import { ask, streamPoints } from "./server.js";

export class Motion {
  // path: on the server. arrived() is called when some of the points have come; `ready` resolves when all have.
  static async load(path, id, arrived) {
    const motion = new Motion(id, await ask(path));
    motion.ready = streamPoints(`${path}/points`, motion.values, (bytes) => {
      motion.there = Math.floor(bytes / 6 / motion.nodes);
      arrived();
    });
    return motion;
  }

  constructor(id, description) {
    Object.assign(this, description, { id, there: 0 });
    this.values = new Int16Array(this.frames * this.nodes * 3);
  }

  placeAt(seconds) { return Math.max(0, Math.min(this.frames - 1, seconds * this.fps)); }

  // A point's place in the world, metres, written into `out` from `at` on; between frames on the straight line.
  at(frame, node, out, at = 0) {
    const first = Math.min(Math.floor(frame), this.frames - 1), share = frame - first;
    const i = (first * this.nodes + node) * 3, j = share > 0 && first + 1 < this.frames ? i + this.nodes * 3 : i;
    for (let k = 0; k < 3; k++) {
      const from = this.values[i + k];
      out[at + k] = (from + share * (this.values[j + k] - from)) * this.scale + this.origin[k];
    }
    return out;
  }

  // Speed of the pelvis in each frame, metres a second.
  speeds() {
    if (this._speeds && this._speedsOf === this.there) return this._speeds;
    const a = [0, 0, 0], b = [0, 0, 0], out = new Float32Array(this.frames), half = Math.max(1, Math.round(this.fps / 30));
    for (let f = 0; f < this.there; f++) {
      const from = Math.max(0, f - half), to = Math.min(this.there - 1, f + half);
      this.at(from, this.root, a);
      this.at(to, this.root, b);
      out[f] = to > from ? Math.hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]) * this.fps / (to - from) : 0;
    }
    this._speedsOf = this.there;
    return (this._speeds = out);
  }

  // Mean distance of the points from another motion's in each frame, millimetres; null where the bodies differ.
  distances(other) {
    if (other.nodes !== this.nodes || other === this) return null;
    const seen = this._distances; // many changes of the page leave both motions as they are
    if (seen && seen.other === other && seen.there === this.there && seen.thereToo === other.there) return seen.found;
    const a = [0, 0, 0], b = [0, 0, 0], frames = Math.min(this.there, other.there);
    const found = Float32Array.from({ length: frames }, (_, f) => {
      let sum = 0;
      for (let n = 0; n < this.nodes; n++) {
        this.at(f, n, a);
        other.at(f, n, b);
        sum += Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
      }
      return 1000 * sum / this.nodes;
    });
    this._distances = { other, there: this.there, thereToo: other.there, found };
    return found;
  }
}
