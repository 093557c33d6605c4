// Hands on the picture: drag, wheel, touch and keys move the camera.

import { calm } from "./dom.js";

const TURN = Math.PI;
const STEP = 0.06;
const GLIDE_MS = 350;
const DOUBLE_MS = 350;
const STILL_PX = 5;

// Keys that move while they are held: to the right, up, ahead.
const FLIGHT = {
  KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyQ: [0, -1, 0], KeyE: [0, 1, 0],
};
const ARROWS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Controls {
  // `moved()` is called when the camera is another; `tapped(x, y)` asks whether a click is taken
  // for something else; `focus(x, y)` is a double click. Places are from 0 to 1.
  constructor(canvas, camera, listeners) {
    Object.assign(this, { canvas, camera, ...listeners });
    this.pointers = new Map();
    this.held = new Set();
    this.glide = 0;
    this.flying = 0;
    this.tap = null;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => this.release(event));
    }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    window.addEventListener("blur", () => this.held.clear());
    document.addEventListener("keyup", (event) => this.held.delete(event.code));
  }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }

  press(event) {
    if (event.button === 1) event.preventDefault();
    cancelAnimationFrame(this.glide);
    try {
      this.canvas.setPointerCapture(event.pointerId);
    } catch {
      // A pointer that is already up again cannot be captured; its drag ends at the edge.
    }
    const slides = event.button !== 0 || event.shiftKey;
    this.pointers.set(event.pointerId, {
      x: event.clientX, y: event.clientY, slides, far: 0, main: event.button === 0,
    });
  }

  drag(event) {
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) return;
    const before = this.hands();
    const [dx, dy] = [event.clientX - pointer.x, event.clientY - pointer.y];
    if (dx === 0 && dy === 0) return;
    pointer.far += Math.hypot(dx, dy);
    pointer.x = event.clientX;
    pointer.y = event.clientY;
    if (this.pointers.size === 1 && pointer.far <= STILL_PX) return;
    const height = this.canvas.clientHeight;
    if (this.pointers.size >= 2) {
      const after = this.hands();
      this.camera.pan((after.x - before.x) / height, (after.y - before.y) / height);
      if (before.spread > 0 && after.spread > 0) this.camera.dolly(before.spread / after.spread);
    } else if (pointer.slides || event.shiftKey) this.camera.pan(dx / height, dy / height);
    else this.camera.orbit((dx / height) * TURN, (dy / height) * TURN);
    this.moved();
  }

  // Middle and spread of the fingers.
  hands() {
    const all = [...this.pointers.values()];
    const x = all.reduce((sum, p) => sum + p.x, 0) / all.length;
    const y = all.reduce((sum, p) => sum + p.y, 0) / all.length;
    return { x, y, spread: all.reduce((sum, p) => sum + Math.hypot(p.x - x, p.y - y), 0) };
  }

  release(event) {
    const pointer = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    const still = pointer?.main && pointer.far <= STILL_PX && event.type === "pointerup";
    if (!still || this.pointers.size > 0) return;
    const [x, y] = this.place(event);
    if (this.tapped(x, y)) return;
    const now = performance.now();
    const again = this.tap && now - this.tap.time < DOUBLE_MS
      && Math.hypot(event.clientX - this.tap.x, event.clientY - this.tap.y) < 25;
    this.tap = again ? null : { time: now, x: event.clientX, y: event.clientY };
    if (again) this.focus(x, y);
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    const amount = Math.max(-240, Math.min(240, event.deltaY * lines));
    // A pinch on a touchpad comes as a wheel with Ctrl, in small steps.
    this.camera.dolly(Math.exp(amount * (event.ctrlKey ? 0.01 : 0.0015)));
    this.moved();
  }

  // Returns whether the key was one of the camera's.
  key(event) {
    const { code, key } = event;
    if (FLIGHT[code]) {
      this.held.add(code);
      this.fast = event.shiftKey;
      this.fly();
      return true;
    }
    if (ARROWS[key]) {
      const [x, y] = ARROWS[key];
      if (event.shiftKey) this.camera.pan(x * STEP, y * STEP);
      else this.camera.orbit(x * STEP * TURN, y * STEP * TURN);
    } else if (key === "+" || key === "=") this.camera.dolly(0.9);
    else if (key === "-" || key === "_") this.camera.dolly(1 / 0.9);
    else return false;
    this.moved();
    return true;
  }

  // As long as a key is held: three seconds through half the scene, faster with Shift.
  fly() {
    if (this.flying) return;
    let before = performance.now();
    const step = (now) => {
      if (this.held.size === 0) {
        this.flying = 0;
        return;
      }
      const seconds = Math.min(0.1, (now - before) / 1000);
      before = now;
      const speed = (this.camera.radius / 3) * (this.fast ? 3 : 1) * seconds;
      const sum = [0, 0, 0];
      for (const code of this.held) FLIGHT[code].forEach((v, i) => { sum[i] += v * speed; });
      this.camera.fly(...sum);
      this.moved();
      this.flying = requestAnimationFrame(step);
    };
    this.flying = requestAnimationFrame(step);
  }

  // To another camera: by a short glide, or at once for those who want no motion.
  go(target) {
    cancelAnimationFrame(this.glide);
    if (calm()) {
      this.camera.between(target, target, 1);
      this.moved();
      return;
    }
    const start = this.camera.copy();
    const begun = performance.now();
    const step = (now) => {
      const t = Math.max(0, Math.min(1, (now - begun) / GLIDE_MS));
      this.camera.between(start, target, t * t * (3 - 2 * t));
      this.moved();
      if (t < 1) this.glide = requestAnimationFrame(step);
    };
    this.glide = requestAnimationFrame(step);
  }
}
