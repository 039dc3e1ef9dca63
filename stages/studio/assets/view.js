// The 3D view: a ground, the figures shown, ghosts, foot contacts, handles of pins, a path on the ground.
import * as THREE from "./vendor/three.min.js";
import { Figure } from "./figure.js";
import { Surface } from "./surface.js";

const REACH_M = 24;
const CAMERAS = { free: [0.65, 0.3], front: [0, 0.08], side: [Math.PI / 2, 0.08], top: [0, 1.5] };

// A square of lines a metre apart, in pieces of a metre: some renderers drop long lines that pass behind the camera.
function ground(colour) {
  const points = [];
  for (let i = -REACH_M; i <= REACH_M; i++) {
    for (let j = -REACH_M; j < REACH_M; j++) points.push(new THREE.Vector3(i, 0, j), new THREE.Vector3(i, 0, j + 1), new THREE.Vector3(j, 0, i), new THREE.Vector3(j + 1, 0, i));
  }
  return new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineBasicMaterial({ color: colour }));
}

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(38, 1, 0.05, 400);
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = Math.PI * 0.52;
    this.controls.addEventListener("change", () => this.draw());
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x99a0aa, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.4);
    sun.position.set(2, 5, 3);
    this.scene.add(sun);
    this.marks = new THREE.Group();
    this.scene.add(this.marks);
    this.figures = new Map(); // key -> Figure
    this.shown = { a: null, b: null, mode: "one", share: 0.5 };
    this.last = new THREE.Vector3();
    this.disc = new THREE.CircleGeometry(0.07, 20).rotateX(-Math.PI / 2);
    this.handle = new THREE.OctahedronGeometry(0.045);
    this.point = [0, 0, 0];
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  colour(colours) {
    this.colours = colours;
    this.scene.background = new THREE.Color(colours.stage);
    this.scene.fog = new THREE.Fog(colours.stage, 9, 26);
    if (this.grid) { this.scene.remove(this.grid); this.grid.geometry.dispose(); this.grid.material.dispose(); }
    this.grid = ground(colours.grid);
    this.grid.position.y = this.floor || 0;
    this.scene.add(this.grid);
    for (const figure of this.figures.values()) figure.paint(colours, figure.single && colours[figure.single]);
    this.draw();
  }

  // Where the camera looks from, and at: the middle of a body on the floor of a motion.
  frame(motion, name = "free") {
    const [yaw, pitch] = CAMERAS[name], far = 2.2 * Math.max(motion.size, 0.5), flat = Math.cos(pitch);
    this.floor = motion.floor;
    if (this.grid) this.grid.position.y = motion.floor;
    motion.at(0, motion.root, this.point);
    if (!this.follows) this.last.set(this.point[0], 0, this.point[2]);
    this.controls.target.set(this.last.x, motion.floor + 0.52 * motion.height, this.last.z);
    this.camera.position.set(Math.sin(yaw) * flat, Math.sin(pitch), Math.cos(yaw) * flat).multiplyScalar(far).add(this.controls.target);
    this.controls.update();
  }

  // wanted: [key, motion, frame, colour name or null, faintness or 0, "a", "b" or ""], all figures that are seen.
  pose(wanted) {
    const keep = new Set(wanted.map(([key]) => key));
    for (const [key, figure] of this.figures) {
      if (keep.has(key)) continue;
      this.scene.remove(figure.group);
      figure.dispose();
      this.figures.delete(key);
    }
    for (const [key, motion, frame, single, faint, side] of wanted) {
      const Kind = this.surfaces && motion.body && !faint ? Surface : Figure;
      let figure = this.figures.get(key);
      if (figure && (!(figure instanceof Kind) || figure.motion !== motion || figure.single !== single)) {
        this.scene.remove(figure.group);
        figure.dispose();
        figure = null;
      }
      if (!figure) {
        figure = new Kind(motion, faint);
        figure.single = single;
        figure.paint(this.colours, single && this.colours[single]);
        this.figures.set(key, figure);
        this.scene.add(figure.group);
      }
      figure.side = side;
      figure.pose(frame);
    }
  }

  // Move the camera along with the pelvis, on the ground.
  follow(motion, frame, on) {
    motion.at(frame, motion.root, this.point);
    if (on && motion.there > frame) {
      const dx = this.point[0] - this.last.x, dz = this.point[2] - this.last.z;
      for (const each of [this.camera.position, this.controls.target]) { each.x += dx; each.z += dz; }
      this.last.set(this.point[0], 0, this.point[2]);
    }
    this.follows = on;
    if (this.grid) this.grid.position.set(Math.round(this.controls.target.x), this.floor || 0, Math.round(this.controls.target.z));
  }

  // contacts: places (x, z) of feet that stand; pins: [{place, held}]; path: places (x, z).
  mark(contacts, pins, path) {
    for (const mesh of [...this.marks.children]) {
      this.marks.remove(mesh);
      mesh.material.dispose();
      if (mesh.geometry !== this.disc && mesh.geometry !== this.handle) mesh.geometry.dispose();
    }
    const flat = (this.floor || 0) + 0.006;
    for (const [x, z] of contacts) {
      const mesh = new THREE.Mesh(this.disc, new THREE.MeshBasicMaterial({ color: this.colours.path, transparent: true, opacity: 0.75 }));
      mesh.position.set(x, flat, z);
      this.marks.add(mesh);
    }
    for (const pin of pins) {
      const mesh = new THREE.Mesh(this.handle, new THREE.MeshBasicMaterial({ color: this.colours.key, depthTest: false }));
      mesh.position.fromArray(pin.place);
      mesh.renderOrder = 2;
      mesh.userData.pin = pin.index;
      this.marks.add(mesh);
    }
    if (path.length > 1) {
      const geometry = new THREE.BufferGeometry().setFromPoints(path.map(([x, z]) => new THREE.Vector3(x, flat + 0.004, z)));
      this.marks.add(new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: this.colours.path })));
    }
  }

  ray(event) {
    const box = this.canvas.getBoundingClientRect(), caster = new THREE.Raycaster();
    const at = new THREE.Vector2((event.clientX - box.left) / box.width * 2 - 1, 1 - (event.clientY - box.top) / box.height * 2);
    caster.setFromCamera(at, this.camera);
    return caster;
  }

  // Where a pointer meets the ground, (x, z), or null.
  ground(event) {
    const found = this.ray(event).ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 1, 0), -(this.floor || 0)), new THREE.Vector3());
    return found && [found.x, found.z];
  }

  pinUnder(event) {
    const hit = this.ray(event).intersectObjects(this.marks.children.filter((mesh) => mesh.userData.pin !== undefined))[0];
    return hit ? { index: hit.object.userData.pin, place: hit.object.position.toArray() } : null;
  }

  // Where a pointer is in the plane through a place that faces the camera.
  beside(event, place) {
    const facing = this.camera.getWorldDirection(new THREE.Vector3()), through = new THREE.Vector3().fromArray(place);
    const found = this.ray(event).ray.intersectPlane(new THREE.Plane().setFromNormalAndCoplanarPoint(facing, through), new THREE.Vector3());
    return found && found.toArray().map((each) => Number(each.toFixed(4)));
  }

  draw() {
    if (this.asked) return;
    this.asked = requestAnimationFrame(() => { this.asked = 0; this.render(); });
  }

  render() {
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight, { mode, share } = this.shown;
    if (!width || !height || !this.colours) return;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    if (this.size !== `${width}x${height}x${ratio}`) {
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
      this.size = `${width}x${height}x${ratio}`;
    }
    const two = (mode === "slider" || mode === "beside") && [...this.figures.values()].some((figure) => figure.side === "b");
    const cut = Math.round(width * (mode === "beside" ? 0.5 : share));
    this.renderer.setScissorTest(two);
    for (const side of two ? ["a", "b"] : [""]) {
      for (const figure of this.figures.values()) figure.group.visible = !two || !figure.side || figure.side === side;
      const [x, w] = side === "b" ? [cut, width - cut] : [0, two ? cut : width];
      if (two) this.renderer.setScissor(x, 0, w, height);
      const whole = mode !== "beside" || !two;
      this.renderer.setViewport(whole ? 0 : x, 0, whole ? width : w, height);
      this.camera.aspect = (whole ? width : w) / height;
      this.camera.updateProjectionMatrix();
      this.renderer.render(this.scene, this.camera);
    }
    this.drawn = (this.drawn || 0) + 1;
  }
}
