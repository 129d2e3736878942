// How large the picture of the arm is: what fits into it, and a bar of so many millimetres.

import { Vector3 } from "./vendor/three.js";
import { write } from "./say.js";

const MARGIN = 1.25; // an arm that moves a little stays in the picture
const LONGEST_PX = 130;

/** Where a camera that looks against *towards* (unit vector) must stand so that *places*, mm, fill
 *  its picture: the middle to look at and the distance from it. */
export function fitted(places, towards, camera) {
  const right = new Vector3().crossVectors(camera.up, towards).normalize();
  const above = new Vector3().crossVectors(towards, right);
  const along = places.map((place) => {
    const v = new Vector3(...place);
    return [v.dot(right), v.dot(above), v.dot(towards)];
  });
  const centre = [0, 1, 2].map((i) => {
    const values = along.map((p) => p[i]);
    return (Math.min(...values) + Math.max(...values)) / 2;
  });
  const tangent = Math.tan((camera.fov * Math.PI) / 360);
  const away = along.map(([x, y, z]) =>
    Math.max(Math.abs(x - centre[0]) / camera.aspect, Math.abs(y - centre[1])) * MARGIN / tangent + z - centre[2]);
  const middle = new Vector3().addScaledVector(right, centre[0]).addScaledVector(above, centre[1]).addScaledVector(towards, centre[2]);
  return { middle, away: Math.max(...away) };
}

/** The longest of 1, 2 and 5 times a power of ten that is no longer than *most_mm*. */
export function round_mm(most_mm) {
  const power = 10 ** Math.floor(Math.log10(most_mm));
  return power * [5, 2, 1].find((times) => times * power <= most_mm);
}

/** At the picture's middle: what is nearer looks longer. */
export class ScaleBar {
  constructor(element) {
    this.element = element;
    [this.bar, this.words] = element.children;
  }

  show(mm_per_px) {
    const mm = round_mm(LONGEST_PX * mm_per_px);
    this.element.hidden = false;
    this.bar.style.width = `${mm / mm_per_px}px`;
    write(this.words, mm >= 1000 ? `${mm / 1000} m` : `${mm} mm`);
  }
}
