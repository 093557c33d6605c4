// The camera that the hands move. Axes are OpenCV's: right, down, forward.

import { add, columns, cross, dot, length, mix, quaternion, slerp, sub, times, turn, unit } from "./vectors.js";

const STEEPEST = (85 * Math.PI) / 180;

export class Camera {
  constructor() {
    this.up = [0, 1, 0];
    this.radius = 1;
    this.right = [1, 0, 0];
    this.down = [0, -1, 0];
    this.forward = [0, 0, -1];
    this.position = [0, 0, 1];
    this.focus = [0, 0, 0];
    this.fov = 50;
  }

  // 16 numbers, column by column.
  get matrix() {
    return [...this.right, 0, ...this.down, 0, ...this.forward, 0, ...this.position, 1];
  }

  get distance() {
    return length(sub(this.focus, this.position));
  }

  get nearest() {
    return 0.02 * this.radius;
  }

  // Stands where a photo or a keyframe was taken. The focus stays as deep as `focus` is, in the
  // middle of the picture, so that the first drag turns what one looks at.
  stand(matrix, fov, focus = this.focus) {
    this.right = unit(matrix.slice(0, 3));
    this.down = unit(matrix.slice(4, 7));
    this.forward = unit(matrix.slice(8, 11));
    this.position = matrix.slice(12, 15);
    if (fov) this.fov = fov;
    const depth = dot(sub(focus, this.position), this.forward);
    this.focus = add(this.position, times(this.forward, Math.max(depth, 0.1 * this.radius)));
  }

  rotate(axis, angle) {
    for (const name of ["right", "down", "forward"]) {
      this[name] = unit(turn(this[name], axis, angle));
    }
  }

  // About the focus: positive `yaw` carries the camera to its left, positive `pitch` upwards.
  orbit(yaw, pitch) {
    const about = (axis, angle) => {
      const arm = turn(sub(this.position, this.focus), axis, angle);
      this.rotate(axis, angle);
      this.position = add(this.focus, arm);
    };
    about(this.up, -yaw);
    const elevation = Math.asin(Math.max(-1, Math.min(1, dot(this.forward, this.up))));
    const lowest = Math.min(-STEEPEST, elevation);
    const highest = Math.max(STEEPEST, elevation);
    const wanted = Math.max(lowest, Math.min(highest, elevation - pitch));
    about(unit(cross(this.forward, this.up), this.right), wanted - elevation);
  }

  // By a share of the picture's height; what is at the focus follows the hand.
  pan(x, y) {
    const height = 2 * this.distance * Math.tan((this.fov * Math.PI) / 360);
    this.shift(add(times(this.right, -x * height), times(this.down, -y * height)));
  }

  shift(by) {
    this.position = add(this.position, by);
    this.focus = add(this.focus, by);
  }

  // The distance to the focus times `factor`. Who comes too near pushes the focus ahead.
  dolly(factor) {
    const wanted = this.distance * factor;
    const towards = unit(sub(this.focus, this.position), this.forward);
    this.position = add(this.position, times(towards, this.distance - wanted));
    if (wanted < this.nearest) {
      this.focus = add(this.position, times(towards, this.nearest));
    }
  }

  // In scene units: to the right, up, ahead.
  fly(right, up, ahead) {
    this.shift(add(times(this.right, right), add(times(this.up, up), times(this.forward, ahead))));
  }

  level() {
    this.right = unit(cross(this.forward, this.up), this.right);
    this.down = unit(cross(this.forward, this.right));
  }

  // Where the camera would stand if it turned to `point` from where it is.
  facing(point) {
    const forward = unit(sub(point, this.position), this.forward);
    const axis = cross(this.forward, forward);
    const angle = Math.atan2(length(axis), dot(this.forward, forward));
    const turned = Object.assign(new Camera(), this);
    turned.rotate(unit(axis, this.right), angle);
    turned.focus = point;
    return turned;
  }

  // Part `t` of the way from one camera to another.
  between(from, to, t) {
    const frame = (camera) => quaternion([camera.right, camera.down, camera.forward]);
    [this.right, this.down, this.forward] = columns(slerp(frame(from), frame(to), t));
    this.position = mix(from.position, to.position, t);
    this.focus = mix(from.focus, to.focus, t);
    this.fov = from.fov + (to.fov - from.fov) * t;
  }

  copy() {
    return Object.assign(new Camera(), this);
  }

  // Where a point is in a picture of this aspect, from 0 to 1; null behind the camera.
  project(point, aspect) {
    const ray = sub(point, this.position);
    const depth = dot(ray, this.forward);
    if (depth < 1e-4) return null;
    const half = Math.tan((this.fov * Math.PI) / 360) * depth;
    return [
      0.5 + dot(ray, this.right) / (2 * half * aspect),
      0.5 + dot(ray, this.down) / (2 * half),
    ];
  }
}
