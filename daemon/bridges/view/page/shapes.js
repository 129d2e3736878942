// What the scene is made of: rods between places, clouds of round points.

import {
  BufferAttribute, BufferGeometry, CylinderGeometry, Mesh, Points, PointsMaterial, Quaternion, Vector3,
} from "./vendor/three.js";

const UP = new Vector3(0, 1, 0); // along which three.js makes its cylinders

export function rod(material, radius) {
  return new Mesh(new CylinderGeometry(radius, radius, 1, 28), material);
}

/** A rod of length 1, put between two places. */
export function span(mesh, from, to) {
  const a = new Vector3(...from);
  const b = new Vector3(...to);
  const length = a.distanceTo(b);
  mesh.visible = length > 0.5;
  if (!mesh.visible) return;
  mesh.position.copy(a).add(b).multiplyScalar(0.5);
  mesh.scale.set(1, length, 1);
  mesh.quaternion.copy(new Quaternion().setFromUnitVectors(UP, b.sub(a).divideScalar(length)));
}

export function buffer(room) {
  return new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(3 * room), 3));
}

export function cloud(room, pixels) {
  const material = new PointsMaterial({ size: pixels * Math.min(devicePixelRatio, 2), sizeAttenuation: false, transparent: true, depthTest: false });
  material.onBeforeCompile = (shader) => { // round, not square
    shader.fragmentShader = shader.fragmentShader.replace(
      "#include <clipping_planes_fragment>",
      "#include <clipping_planes_fragment>\nif (length(gl_PointCoord - 0.5) > 0.5) discard;",
    );
  };
  return new Points(buffer(room), material);
}

export function fill(thing, places) {
  const attribute = thing.geometry.attributes.position;
  places.forEach((place, i) => attribute.setXYZ(i, ...place));
  attribute.needsUpdate = true;
  thing.geometry.setDrawRange(0, places.length);
}
