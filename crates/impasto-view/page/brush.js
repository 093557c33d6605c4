// Sends the coats whenever they change, at most one at a time: what a slider passes meanwhile is
// skipped, its newest place is not.

import { at } from "./dom.js";

const LOST_MS = 5000;

export class Brush {
  constructor(coats, send) {
    Object.assign(this, { coats, send, waiting: 0, pending: false, bare: false, timer: 0, sent: new Map() });
    coats.addEventListener("change", () => this.touch());
    const button = at("compare");
    button.addEventListener("pointerdown", () => this.compare(true));
    for (const end of ["pointerup", "pointerleave", "pointercancel", "blur"]) {
      button.addEventListener(end, () => this.compare(false));
    }
    // Space and Enter on the button: pressed once on, once off, since a screen reader cannot hold.
    button.addEventListener("click", (event) => {
      if (event.detail === 0) this.compare(!this.bare);
    });
  }

  // Without paint, for as long as one wants to compare.
  compare(bare) {
    if (this.bare === bare || (bare && at("compare").disabled)) return;
    this.bare = bare;
    at("compare").setAttribute("aria-pressed", String(bare));
    this.touch();
  }

  touch() {
    if (this.waiting !== 0) this.pending = true;
    else this.paint();
  }

  // To a server that knows nothing of this page yet.
  again() {
    this.waiting = 0;
    this.paint();
  }

  paint() {
    clearTimeout(this.timer);
    this.pending = false;
    this.waiting = this.send({ type: "coats", coats: this.bare ? [] : this.coats.json() });
    if (this.waiting === 0) return;
    this.sent.clear();
    this.sent.set(this.waiting, performance.now());
    // An answer that got lost must not hold the brush for ever.
    this.timer = setTimeout(() => this.painted(this.waiting), LOST_MS);
  }

  // These coats are ready, or were refused.
  painted(id) {
    if (id !== this.waiting) return;
    clearTimeout(this.timer);
    this.waiting = 0;
    if (this.pending) this.paint();
  }

  // A picture with these coats is drawn. Milliseconds since they were sent, if it is the first.
  drawn(id) {
    const since = this.sent.get(id);
    this.sent.delete(id);
    return since === undefined ? null : performance.now() - since;
  }
}
