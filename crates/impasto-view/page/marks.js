// Marks on the picture: the outline of the chosen coat's sphere or box, and the camera path.

import { along } from "./spline.js";

const SPACE = "http://www.w3.org/2000/svg";
const ROUND = 48;
const EDGES = [
  [0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7],
];

function circles({ centre, radius }) {
  return [[0, 1], [1, 2], [0, 2]].map(([a, b]) => Array.from({ length: ROUND + 1 }, (_, i) => {
    const angle = (i / ROUND) * 2 * Math.PI;
    const point = [...centre];
    point[a] += radius * Math.cos(angle);
    point[b] += radius * Math.sin(angle);
    return point;
  }));
}

function edges({ min, max }) {
  const corner = (i) => [0, 1, 2].map((axis) => ((i >> axis) & 1 ? max[axis] : min[axis]));
  return EDGES.map(([a, b]) => [corner(a), corner(b)]);
}

export class Marks {
  constructor(svg, camera) {
    Object.assign(this, { svg, camera });
  }

  // `mask` or null, and the path's keyframes (none: no path).
  draw(mask, keyframes, closed) {
    const { width, height } = this.svg.getBoundingClientRect();
    const lines = [];
    if (mask?.kind === "sphere") lines.push(...circles(mask.sphere).map((points) => ["mask", points]));
    if (mask?.kind === "box") lines.push(...edges(mask.box).map((points) => ["mask", points]));
    if (keyframes.length > 1) {
      const count = 24 * keyframes.length;
      lines.push(["path", Array.from({ length: count + 1 }, (_, i) => along(keyframes, closed, i / count).matrix.slice(12, 15))]);
    }
    const drawn = lines.flatMap(([kind, points]) => this.line(kind, points, width, height));
    const dots = keyframes.flatMap(({ camera_to_world: m }) => this.dot(m.slice(12, 15), width, height));
    const surface = mask?.kind === "surface" && mask.surface.point ? this.dot(mask.surface.point, width, height) : [];
    this.svg.replaceChildren(...drawn, ...dots, ...surface);
  }

  // What is behind the camera is left out, so that one line may become several.
  line(kind, points, width, height) {
    const pieces = [[]];
    for (const point of points) {
      const at = this.camera.project(point, width / height);
      if (!at || Math.abs(at[0]) > 20 || Math.abs(at[1]) > 20) pieces.push([]);
      else pieces.at(-1).push(`${(at[0] * width).toFixed(1)},${(at[1] * height).toFixed(1)}`);
    }
    return pieces.filter((piece) => piece.length > 1).flatMap((piece) => ["under", kind].map((name) => {
      const line = document.createElementNS(SPACE, "polyline");
      line.setAttribute("points", piece.join(" "));
      line.setAttribute("class", name);
      return line;
    }));
  }

  dot(point, width, height) {
    const at = this.camera.project(point, width / height);
    if (!at) return [];
    const dot = document.createElementNS(SPACE, "circle");
    dot.setAttribute("cx", (at[0] * width).toFixed(1));
    dot.setAttribute("cy", (at[1] * height).toFixed(1));
    dot.setAttribute("r", "4");
    return [dot];
  }
}
