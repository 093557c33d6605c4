// The way between keyframes: a smooth curve through all of them, at an even pace from one to the
// next.

import { columns, quaternion, slerp } from "./vectors.js";

const parts = ({ camera_to_world: m, fov }) => ({
  position: m.slice(12, 15),
  turn: quaternion([m.slice(0, 3), m.slice(4, 7), m.slice(8, 11)]),
  fov,
});

// Catmull and Rom's curve between the middle two of four values.
function curve(a, b, c, d, t) {
  const tangents = [(c - a) / 2, (d - b) / 2];
  const [t2, t3] = [t * t, t * t * t];
  return (2 * t3 - 3 * t2 + 1) * b + (t3 - 2 * t2 + t) * tangents[0]
    + (3 * t2 - 2 * t3) * c + (t3 - t2) * tangents[1];
}

// The camera at part `t` (0 to 1) of a path: `{matrix, fov}`.
export function along(keyframes, closed, t) {
  const count = keyframes.length;
  const segments = closed ? count : count - 1;
  const place = Math.max(0, Math.min(1, t)) * segments;
  const segment = Math.min(Math.floor(place), segments - 1);
  const key = (i) => parts(keyframes[closed ? (i + count) % count : Math.max(0, Math.min(count - 1, i))]);
  const [a, b, c, d] = [-1, 0, 1, 2].map((i) => key(segment + i));
  const rest = place - segment;
  const position = b.position.map((_, i) => curve(a.position[i], b.position[i], c.position[i], d.position[i], rest));
  const [right, down, forward] = columns(slerp(b.turn, c.turn, rest));
  return {
    matrix: [...right, 0, ...down, 0, ...forward, 0, ...position, 1],
    fov: curve(a.fov, b.fov, c.fov, d.fov, rest),
  };
}
