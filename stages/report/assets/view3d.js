// Drawing of stick figures on a 2D canvas: a camera, a ground, bones with a shadow. No libraries.
"use strict";

const GRID_M = 1, GRID_REACH = 9;
const BONE_M = [0.052, 0.042, 0.042, 0.05, 0.05]; // widths by body group: spine, arms, legs
const THIN_M = 0.014;
const TRAIL_S = 2.5;

class Camera {
  constructor() { this.preset("free"); this.target = [0, 0.9, 0]; this.distance = 4.2; }

  preset(name) {
    const views = { free: [0.65, 0.22], front: [0, 0.06], side: [Math.PI / 2, 0.06], top: [0, 1.5] };
    [this.yaw, this.pitch] = views[name];
  }

  orbit(dx, dy) {
    this.yaw -= dx * 0.008;
    this.pitch = Math.max(-0.25, Math.min(1.55, this.pitch + dy * 0.008));
  }

  zoom(factor) { this.distance = Math.max(0.8, Math.min(40, this.distance * factor)); }

  pan(dx, dy, height) {
    const scale = this.distance / height;
    const c = Math.cos(this.yaw), s = Math.sin(this.yaw);
    this.target[0] -= dx * scale * c;
    this.target[2] += dx * scale * s;
    this.target[1] += dy * scale;
  }

  // A function (x, y, z) -> [screen x, screen y, pixels per metre there, depth] for a viewport.
  projector(view, follow) {
    const cy = Math.cos(this.yaw), sy = Math.sin(this.yaw), cp = Math.cos(this.pitch), sp = Math.sin(this.pitch);
    const tx = this.target[0] + follow[0], ty = this.target[1], tz = this.target[2] + follow[2];
    const focal = 1.25 * Math.min(view.h, view.w * 1.25), mx = view.x + view.w / 2, my = view.y + view.h * 0.52;
    return (x, y, z) => {
      const dx = x - tx, dy = y - ty, dz = z - tz;
      const right = dx * cy - dz * sy, back = dx * sy + dz * cy;
      const up = dy * cp - back * sp, near = dy * sp + back * cp;
      const depth = Math.max(0.05, this.distance - near), scale = focal / depth;
      return [mx + right * scale, my - up * scale, scale, depth];
    };
  }
}

function drawGround(ctx, project, centre, floor, colour) {
  const x0 = Math.round(centre[0] / GRID_M), z0 = Math.round(centre[2] / GRID_M);
  ctx.strokeStyle = colour;
  for (let ring = 0; ring < 3; ring++) { // three steps of fading, so that the ground has no hard edge
    ctx.globalAlpha = [0.5, 0.27, 0.12][ring];
    ctx.lineWidth = 1;
    ctx.beginPath();
    for (let i = -GRID_REACH; i <= GRID_REACH; i++) {
      for (let j = -GRID_REACH; j < GRID_REACH; j++) {
        const far = Math.hypot(i, j + 0.5) / GRID_REACH;
        if (far > 1 || Math.min(2, Math.floor(far * 3)) !== ring) continue;
        for (const [ax, az, bx, bz] of [[i, j, i, j + 1], [j, i, j + 1, i]]) {
          const a = project((x0 + ax) * GRID_M, floor, (z0 + az) * GRID_M);
          const b = project((x0 + bx) * GRID_M, floor, (z0 + bz) * GRID_M);
          if (a[3] < 0.2 || b[3] < 0.2) continue;
          ctx.moveTo(a[0], a[1]);
          ctx.lineTo(b[0], b[1]);
        }
      }
    }
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

function drawShadow(ctx, project, motion, frame, floor, colour) {
  strokeAll(ctx, motion, (node) => { const p = motion.at(frame, node); return project(p[0], floor, p[2]); }, colour, 0.3, 0.07);
}

// The pelvis' path on the ground for some seconds around a frame, with the keyframes on it.
function drawTrail(ctx, project, motion, keys, frame, floor, colours) {
  const reach = Math.round(TRAIL_S * motion.fps), first = Math.max(0, frame - reach);
  const last = Math.min(motion.frames - 1, frame + reach), stride = Math.max(1, Math.round(motion.fps / 30));
  ctx.strokeStyle = colours.trail;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  for (let f = first; f <= last; f += stride) {
    const p = motion.at(f, motion.root), s = project(p[0], floor, p[2]);
    if (f === first) ctx.moveTo(s[0], s[1]); else ctx.lineTo(s[0], s[1]);
  }
  ctx.stroke();
  ctx.fillStyle = colours.key;
  for (const key of keys) {
    if (key < first || key > last) continue;
    const p = motion.at(key, motion.root), s = project(p[0], floor, p[2]);
    diamond(ctx, s[0], s[1], 3);
  }
}

function diamond(ctx, x, y, size) {
  ctx.beginPath();
  ctx.moveTo(x, y - size);
  ctx.lineTo(x + size, y);
  ctx.lineTo(x, y + size);
  ctx.lineTo(x - size, y);
  ctx.closePath();
  ctx.fill();
}

// A whole figure in one faint colour: a keyframe's ghost, or the truth behind a result.
function drawGhost(ctx, project, motion, frame, colour, alpha) {
  strokeAll(ctx, motion, (node) => project(...motion.at(frame, node)), colour, alpha, 0.026);
}

// All bones in one stroke, so that a faint colour does not add up where they meet.
function strokeAll(ctx, motion, place, colour, alpha, width) {
  ctx.strokeStyle = colour;
  ctx.globalAlpha = alpha;
  ctx.lineCap = ctx.lineJoin = "round";
  ctx.beginPath();
  let scale = 0;
  for (const [a, b, , thin] of motion.edges) {
    if (thin) continue;
    const s = place(a), t = place(b);
    scale = Math.max(scale, s[2]);
    ctx.moveTo(s[0], s[1]);
    ctx.lineTo(t[0], t[1]);
  }
  ctx.lineWidth = Math.max(1, width * scale);
  ctx.stroke();
  ctx.globalAlpha = 1;
}

// Bodies [motion, frame, one colour or null for the groups' own]: the bones of all of them, the farthest first, so that
// the body in front hides the one behind it.
function drawBodies(ctx, project, bodies, colours) {
  const pieces = bodies.flatMap(([motion, frame, single]) => motion.edges.map(([a, b, group, thin, head]) => {
    const s = project(...motion.at(frame, a)), t = project(...motion.at(frame, b));
    return { s, t, group, thin, head, single, depth: (s[3] + t[3]) / 2 };
  }));
  pieces.sort((p, q) => q.depth - p.depth);
  ctx.lineCap = "round";
  for (const { s, t, group, thin, head, single } of pieces) {
    const colour = single || colours.groups[group], scale = (s[2] + t[2]) / 2;
    const width = Math.max(thin ? 1 : 2, (thin ? THIN_M : BONE_M[group]) * scale);
    ctx.beginPath();
    ctx.moveTo(s[0], s[1]);
    ctx.lineTo(t[0], t[1]);
    if (!thin) { // a rim in the background's colour keeps crossing limbs apart
      ctx.strokeStyle = colours.rim;
      ctx.lineWidth = width + 3;
      ctx.stroke();
    }
    ctx.strokeStyle = colour;
    ctx.lineWidth = width;
    ctx.stroke();
    if (head) ball(ctx, s, t, scale, colour, colours.rim);
    if (!thin && !head) {
      ctx.fillStyle = colours.joint;
      for (const end of [s, t]) {
        ctx.beginPath();
        ctx.arc(end[0], end[1], Math.max(1, width * 0.22), 0, 7);
        ctx.fill();
      }
    }
  }
}

function ball(ctx, s, t, scale, colour, rim) {
  const length = Math.hypot(t[0] - s[0], t[1] - s[1]) / scale, radius = Math.min(0.11, Math.max(0.085, length * 0.55));
  ctx.beginPath();
  ctx.arc((s[0] + t[0]) / 2, (s[1] + t[1]) / 2, radius * scale, 0, 7);
  ctx.fillStyle = colour;
  ctx.strokeStyle = rim;
  ctx.lineWidth = 1.5;
  ctx.fill();
  ctx.stroke();
}
