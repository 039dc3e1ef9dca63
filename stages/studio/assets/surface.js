// A body with a surface in the view: the same as a Figure, for a motion that has a `body`.
import * as THREE from "./vendor/three.min.js";

export class Surface {
  constructor(motion) {
    this.motion = motion;
    this.group = new THREE.Group();
    const { rest, faces, vertices } = motion.body;
    this.geometry = new THREE.BufferGeometry().setFromPoints(Array.from({ length: vertices }, (_, i) => new THREE.Vector3().fromArray(rest, 3 * i)));
    this.geometry.setIndex(Array.from(faces));
    this.geometry.computeVertexNormals();
    this.restNormals = this.geometry.attributes.normal.array.slice();
    this.material = new THREE.MeshLambertMaterial();
    this.shade = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.22, depthWrite: false });
    const shadow = new THREE.Group();
    for (const [parent, material] of [[this.group, this.material], [shadow, this.shade]]) {
      const mesh = new THREE.Mesh(this.geometry, material);
      mesh.frustumCulled = false;
      parent.add(mesh);
    }
    shadow.scale.y = 1e-4;
    shadow.position.y = motion.floor + 0.003;
    this.group.add(shadow);
  }

  paint(colours, single) {
    this.material.color.set(single || colours.skin);
    this.shade.color.set(colours.shadow);
  }

  pose(frame) {
    const { normal, position } = this.geometry.attributes;
    this.motion.body.pose(frame, position.array, this.restNormals, normal.array);
    position.needsUpdate = normal.needsUpdate = true;
  }

  dispose() { for (const each of [this.geometry, this.material, this.shade]) each.dispose(); }
}
