// When which view is asked for: coarse ones while the camera moves, never more than one that is
// not answered; a sharp one when it has come to rest.

// Longer than between two events of a hand that moves, and no longer than it has to be.
const REST_MS = 90;
const LOST_MS = 3000;
const WIDEST = 1280;
const NARROWEST = 480;
// As wide as is sharp within about so many seconds, where nothing else is chosen.
const PATIENCE_S = 3;

export class Pace {
  // `send(message)` gives the message an id and returns it; `stage` is the element that the picture fills.
  constructor(camera, stage, send) {
    this.camera = camera;
    this.stage = stage;
    this.send = send;
    this.chosen = 0;
    this.comfortable = 640;
    this.rested = null;
    this.waiting = null;
    this.pending = false;
    this.scheduled = false;
    this.timer = 0;
    this.sent = new Map();
  }

  // Most pixels across: what was chosen, or what this machine does in a moment.
  get widest() {
    return this.chosen || this.comfortable;
  }

  // Of a view, in pixels: the stage's, even, at most `widest` wide.
  get size() {
    const { width, height } = this.stage.getBoundingClientRect();
    const dense = window.devicePixelRatio || 1;
    const scale = Math.min(dense, this.widest / Math.max(width, 1));
    const even = (v) => Math.max(2, 2 * Math.round((v * scale) / 2));
    return [even(width), even(height)];
  }

  moved() {
    this.pending = true;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.rest(), REST_MS);
    this.schedule();
  }

  schedule() {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame(() => {
      this.scheduled = false;
      const lost = this.waiting && performance.now() - this.sent.get(this.waiting) > LOST_MS;
      if (this.pending && (!this.waiting || lost)) this.waiting = this.ask(true);
    });
  }

  // The camera is at rest: the sharp picture, whatever is still under way.
  rest() {
    clearTimeout(this.timer);
    this.waiting = null;
    const id = this.ask(false);
    this.rested = { id, begun: performance.now() };
  }

  // A picture at rest is sharp: how long that took says how large the next one may be. What is
  // painted anew on a view that is there already says nothing.
  finished({ view, viewWidth, viewHeight }) {
    if (this.rested?.id !== view) return;
    const seconds = Math.max(0.01, (performance.now() - this.rested.begun) / 1000);
    this.rested = null;
    const width = viewWidth * Math.sqrt(PATIENCE_S / seconds);
    const { width: shown, height } = this.stage.getBoundingClientRect();
    const likes = Math.abs(viewWidth / viewHeight - shown / height) < 0.1;
    if (likes) this.comfortable = Math.max(NARROWEST, Math.min(WIDEST, 80 * Math.round(width / 80)));
  }

  ask(moving) {
    this.pending = false;
    const { matrix, fov } = this.camera;
    const id = this.send({ type: "view", camera_to_world: matrix, fov, size: this.size, moving });
    if (id === 0) return null;
    this.sent.set(id, performance.now());
    for (const old of this.sent.keys()) {
      if (this.sent.size <= 16) break;
      this.sent.delete(old);
    }
    return id;
  }

  // A picture of this view is drawn. Returns the milliseconds since the view was sent if it is
  // the first of it.
  answered(id) {
    const since = this.sent.get(id);
    this.sent.delete(id);
    if (this.waiting !== null && id >= this.waiting) {
      this.waiting = null;
      if (this.pending) this.schedule();
    }
    return since === undefined ? null : performance.now() - since;
  }
}
