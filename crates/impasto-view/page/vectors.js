// Points and directions are arrays of three numbers, turns are unit quaternions [x, y, z, w].

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
export const length = (a) => Math.hypot(...a);
export const mix = (a, b, t) => a.map((v, i) => v + (b[i] - v) * t);

// The direction of `a`, or `otherwise` where `a` has none.
export function unit(a, otherwise = [0, 0, 1]) {
  const size = length(a);
  return size > 1e-9 ? times(a, 1 / size) : otherwise;
}

// `v` turned by `angle` about the unit vector `axis`, right-handed.
export function turn(v, axis, angle) {
  const c = Math.cos(angle);
  return add(
    add(times(v, c), times(cross(axis, v), Math.sin(angle))),
    times(axis, dot(axis, v) * (1 - c)),
  );
}

// The turn whose columns are right, down and forward.
export function quaternion([r, d, f]) {
  const trace = r[0] + d[1] + f[2];
  let q;
  if (trace > 0) q = [d[2] - f[1], f[0] - r[2], r[1] - d[0], 1 + trace];
  else if (r[0] > d[1] && r[0] > f[2]) {
    q = [1 + r[0] - d[1] - f[2], d[0] + r[1], f[0] + r[2], d[2] - f[1]];
  } else if (d[1] > f[2]) q = [d[0] + r[1], 1 + d[1] - r[0] - f[2], f[1] + d[2], f[0] - r[2]];
  else q = [f[0] + r[2], f[1] + d[2], 1 + f[2] - r[0] - d[1], r[1] - d[0]];
  const size = Math.hypot(...q);
  return q.map((v) => v / size);
}

export function columns([x, y, z, w]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
  ];
}

// From `a` to `b` the short way, at an even pace.
export function slerp(a, b, t) {
  let cosine = a.reduce((sum, v, i) => sum + v * b[i], 0);
  const sign = cosine < 0 ? -1 : 1;
  cosine *= sign;
  let [s, e] = [1 - t, t * sign];
  if (cosine < 0.9995) {
    const angle = Math.acos(cosine);
    s = Math.sin((1 - t) * angle) / Math.sin(angle);
    e = (Math.sin(t * angle) / Math.sin(angle)) * sign;
  }
  const q = a.map((v, i) => v * s + b[i] * e);
  const size = Math.hypot(...q);
  return q.map((v) => v / size);
}
