// Forward kinematics as docs say it: A = Rz(θ+θ0)·Tz(d)·Tx(a)·Rx(α)·Ry(β), in front of joint 1 the
// base's displacement Trans(x, y, z)·Rz·Ry·Rx. Millimetres and radians. A frame is a rotation, nine
// numbers row by row, and an origin.

const multiply = (a, b) => {
  const out = new Array(9);
  for (let i = 0; i < 3; i++)
    for (let j = 0; j < 3; j++)
      out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
  return out;
};

const rotateX = (t) => [1, 0, 0, 0, Math.cos(t), -Math.sin(t), 0, Math.sin(t), Math.cos(t)];
const rotateY = (t) => [Math.cos(t), 0, Math.sin(t), 0, 1, 0, -Math.sin(t), 0, Math.cos(t)];
const rotateZ = (t) => [Math.cos(t), -Math.sin(t), 0, Math.sin(t), Math.cos(t), 0, 0, 0, 1];

/** The point *v* of a frame, in the base frame. */
export function point(frame, v) {
  const { r, o } = frame;
  return [0, 1, 2].map((i) => r[3 * i] * v[0] + r[3 * i + 1] * v[1] + r[3 * i + 2] * v[2] + o[i]);
}

/** All frames of the arm at the angles *q*: the base's first, then one after each joint. */
export function frames(geometry, q) {
  const [x, y, z, rx, ry, rz] = geometry.base;
  let frame = { r: multiply(multiply(rotateZ(rz), rotateY(ry)), rotateX(rx)), o: [x, y, z] };
  const all = [frame];
  geometry.rows.forEach(([theta, d, a, alpha, beta], k) => {
    const turned = multiply(frame.r, rotateZ(q[k] + theta));
    const o = point({ r: turned, o: frame.o }, [a, 0, d]);
    frame = { r: multiply(multiply(turned, rotateX(alpha)), rotateY(beta)), o };
    all.push(frame);
  });
  return all;
}

/** Centre of the tip, by geometry alone. */
export const tip = (geometry, q) => point(frames(geometry, q).at(-1), geometry.tip);

/** The way from joint to joint as a fitter would build it: along the axis, then across. */
export function skeleton(geometry, q) {
  const all = frames(geometry, q);
  return geometry.rows.map(([, d, ], k) => {
    const { r, o } = all[k];
    const axis = [r[2], r[5], r[8]];
    const elbow = o.map((value, i) => value + d * axis[i]);
    return { from: o, axis, elbow, to: all[k + 1].o };
  });
}

/** The longest the arm can be, mm: what a picture of it must hold. */
export function reach(geometry) {
  const links = geometry.rows.map(([, d, a]) => Math.hypot(d, a));
  return links.reduce((sum, length) => sum + length, Math.hypot(...geometry.tip)) || 500;
}
