// One body in the view: bones as cylinders, joints as balls, and a shadow; ghosts are the same in one faint colour.
import * as THREE from "./vendor/three.min.js";

const BONE_M = [0.026, 0.021, 0.021, 0.025, 0.025], THIN_M = 0.008; // radii by body group: spine, arms, legs
const UP = new THREE.Vector3(0, 1, 0);
const a = new THREE.Vector3(), b = new THREE.Vector3(), size = new THREE.Vector3(), turn = new THREE.Quaternion();
const matrix = new THREE.Matrix4(), none = new THREE.Quaternion();

export class Figure {
  constructor(motion, faint) {
    this.motion = motion;
    this.group = new THREE.Group();
    const material = faint ? new THREE.MeshBasicMaterial({ transparent: true, opacity: faint, depthWrite: false })
      : new THREE.MeshLambertMaterial();
    const count = motion.edges.length;
    this.bones = new THREE.InstancedMesh(new THREE.CylinderGeometry(1, 1, 1, 10, 1), material, count);
    this.balls = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 12, 8), material, count * 2);
    for (const mesh of [this.bones, this.balls]) {
      mesh.frustumCulled = false;
      mesh.instanceMatrix.setUsage(THREE.DynamicDrawUsage);
    }
    this.group.add(this.bones, this.balls);
    if (!faint) this.addShadow();
    this.point = [0, 0, 0];
  }

  addShadow() {
    this.shade = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.22, depthWrite: false });
    const shadow = new THREE.Group(), mesh = new THREE.InstancedMesh(this.bones.geometry, this.shade, this.bones.count);
    mesh.instanceMatrix = this.bones.instanceMatrix;
    mesh.frustumCulled = false;
    shadow.add(mesh);
    shadow.scale.y = 1e-4;
    shadow.position.y = this.motion.floor + 0.003;
    this.group.add(shadow);
  }

  paint(colours, single) {
    const colour = new THREE.Color();
    this.motion.edges.forEach(([, , group], i) => {
      colour.set(single || colours.groups[group] || colours.groups[0]);
      this.bones.setColorAt(i, colour);
      this.balls.setColorAt(2 * i, colour);
      this.balls.setColorAt(2 * i + 1, colour);
    });
    this.bones.instanceColor.needsUpdate = this.balls.instanceColor.needsUpdate = true;
    if (this.shade) this.shade.color.set(colours.shadow);
  }

  pose(frame) {
    if (frame >= this.motion.there) return;
    this.motion.edges.forEach(([from, to, group, thin, head], i) => {
      a.fromArray(this.motion.at(frame, from, this.point));
      b.fromArray(this.motion.at(frame, to, this.point));
      const radius = thin ? THIN_M : BONE_M[group] || BONE_M[0], length = a.distanceTo(b);
      this.balls.setMatrixAt(2 * i, matrix.compose(a, none, size.setScalar(radius)));
      const ball = head ? Math.min(0.11, Math.max(0.085, length * 0.55)) : radius;
      size.setScalar(ball);
      const place = head ? b.clone().add(a).multiplyScalar(0.5) : b;
      this.balls.setMatrixAt(2 * i + 1, matrix.compose(place, none, size));
      turn.setFromUnitVectors(UP, b.sub(a).normalize());
      a.addScaledVector(b, length / 2);
      this.bones.setMatrixAt(i, matrix.compose(a, turn, size.set(radius, Math.max(length, 1e-4), radius)));
    });
    this.bones.instanceMatrix.needsUpdate = this.balls.instanceMatrix.needsUpdate = true;
  }

  dispose() {
    for (const mesh of [this.bones, this.balls]) { mesh.geometry.dispose(); mesh.material.dispose(); mesh.dispose(); }
    this.shade?.dispose();
  }
}
