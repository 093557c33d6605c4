// The coats of paint: what they are, their JSON, and undo. The uppermost is last, as in the JSON.

const HISTORY = 50;
const SETTLED_MS = 400;

let keys = 0;

export const newMask = () => ({
  kind: "everywhere",
  inverted: false,
  depth: { from: 0, to: 1 },
  sphere: { centre: [0, 0, 0], radius: 0.3 },
  box: { min: [-0.3, -0.3, -0.3], max: [0.3, 0.3, 0.3] },
  surface: { point: null, tolerance: 0.1 },
});

export const newCoat = () => ({
  key: ++keys, on: true, paintings: [], strength: 1, size: 1, strokes: 1, keep: "none", mask: newMask(),
});

// Null where it covers everything. A surface that was not clicked yet counts as everything, so
// that the paint is seen while one chooses.
function maskJson(mask) {
  const { kind, inverted } = mask;
  if (kind === "everywhere" || (kind === "surface" && !mask.surface.point)) return null;
  const shape = kind === "near" || kind === "far" ? kind : { [kind]: mask[kind] };
  return { shape, inverted };
}

function coatJson(coat) {
  const mask = maskJson(coat.mask);
  const { paintings, strength, size, strokes, keep } = coat;
  return { paintings, strength, stroke_size: size, stroke_strength: strokes, keep, ...(mask ? { mask } : {}) };
}

const shows = (coat) => coat.on && coat.paintings.some(({ weight }) => weight > 0);

function fromJson({
  paintings, strength = 1, stroke_size: size = 1, stroke_strength: strokes = 1, keep = "none", mask,
}) {
  const coat = newCoat();
  Object.assign(coat, { strength, size, strokes, keep });
  coat.paintings = paintings.map(({ painting, weight = 1 }) => ({ painting, weight }));
  if (mask) {
    const { shape, inverted = false } = mask;
    const kind = typeof shape === "string" ? shape : Object.keys(shape)[0];
    Object.assign(coat.mask, { kind, inverted });
    if (typeof shape === "object") coat.mask[kind] = structuredClone(shape[kind]);
  }
  return coat;
}

export class Coats extends EventTarget {
  // "change": other paint, and "shape": another list, which must be built anew.
  constructor() {
    super();
    this.list = [];
    this.active = null;
    this.past = [];
    this.future = [];
    this.settled = structuredClone(this.list);
    this.timer = 0;
  }

  get chosen() {
    return this.list.find(({ key }) => key === this.active) ?? this.list.at(-1) ?? null;
  }

  // What the server paints with.
  json() {
    return this.list.filter(shows).map(coatJson);
  }

  changed(shape = false) {
    this.dispatchEvent(new Event("change"));
    if (shape) this.dispatchEvent(new Event("shape"));
    // What is dragged is one step to undo.
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.settle(), SETTLED_MS);
  }

  settle() {
    clearTimeout(this.timer);
    const now = structuredClone(this.list);
    if (JSON.stringify(now) === JSON.stringify(this.settled)) return;
    this.past.push(this.settled);
    if (this.past.length > HISTORY) this.past.shift();
    this.future = [];
    this.settled = now;
    this.dispatchEvent(new Event("history"));
  }

  step(from, to) {
    this.settle();
    if (from.length === 0) return;
    to.push(this.settled);
    this.settled = from.pop();
    this.list = structuredClone(this.settled);
    this.changed(true);
    this.dispatchEvent(new Event("history"));
  }

  undo() {
    this.step(this.past, this.future);
  }

  redo() {
    this.step(this.future, this.past);
  }

  replaceAll(json) {
    this.settle();
    this.list = json.map(fromJson);
    this.active = this.list.at(-1)?.key ?? null;
    this.changed(true);
  }

  add() {
    const coat = newCoat();
    this.list.push(coat);
    this.active = coat.key;
    this.changed(true);
    return coat;
  }

  remove(coat) {
    this.list = this.list.filter((other) => other !== coat);
    if (this.active === coat.key) this.active = this.list.at(-1)?.key ?? null;
    this.changed(true);
  }

  // By one place, upwards or downwards as they lie on one another.
  move(coat, by) {
    const from = this.list.indexOf(coat);
    const to = from + by;
    if (to < 0 || to >= this.list.length) return;
    this.list.splice(from, 1);
    this.list.splice(to, 0, coat);
    this.changed(true);
  }

  choose(coat) {
    if (this.active === coat.key) return;
    this.active = coat.key;
    this.dispatchEvent(new Event("shape"));
  }

  // One painting instead of what the chosen coat has; the first coat comes by itself.
  paint(painting) {
    const coat = this.chosen ?? this.add();
    coat.paintings = [{ painting, weight: 1 }];
    coat.on = true;
    this.changed(true);
  }

  // A painting more in the chosen coat, with as much weight as the others have on average.
  mix(painting) {
    const coat = this.chosen ?? this.add();
    const { paintings } = coat;
    if (paintings.some((other) => other.painting === painting)) return;
    const sum = paintings.reduce((all, { weight }) => all + weight, 0);
    paintings.push({ painting, weight: sum > 0 ? sum / paintings.length : 1 });
    coat.on = true;
    this.changed(true);
  }

  drop(coat, painting) {
    coat.paintings = coat.paintings.filter((other) => other.painting !== painting);
    this.changed(true);
  }
}
