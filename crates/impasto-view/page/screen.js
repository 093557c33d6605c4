// The canvas with the picture: draws what comes, in order, and says what is drawn.

export class Screen {
  // `acknowledge(frame)` is called once for every picture, `drawn(head)` for those that are shown.
  constructor(canvas, { acknowledge, drawn }) {
    this.canvas = canvas;
    this.paper = canvas.getContext("2d");
    this.acknowledge = acknowledge;
    this.drawn = drawn;
    this.queue = Promise.resolve();
    this.shown = { view: 0, coats: 0 };
    this.wanted = { view: 0, coats: 0, still: false };
    this.times = [];
  }

  // What the page has asked for last; a picture is the last one only if it answers that.
  expect(wanted) {
    Object.assign(this.wanted, wanted);
    this.canvas.dataset.last = "0";
  }

  // A new connection counts anew.
  forget() {
    this.shown = { view: 0, coats: 0 };
    this.canvas.dataset.last = "0";
  }

  receive(head, jpeg) {
    const bitmap = createImageBitmap(jpeg);
    // Handled where it is awaited: until then a picture that is none must not count as unhandled.
    bitmap.catch(() => {});
    this.queue = this.queue.then(async () => {
      try {
        this.draw(head, await bitmap);
      } catch {
        this.canvas.dataset.broken = String(head.frame);
      }
      this.acknowledge(head.frame);
    });
  }

  isOld(head) {
    const { view, coats } = this.shown;
    return head.view < view || (head.view === view && head.coats < coats);
  }

  draw(head, bitmap) {
    if (this.isOld(head)) {
      bitmap.close();
      return;
    }
    this.fit(head.viewWidth, head.viewHeight);
    this.paper.imageSmoothingQuality = "medium";
    this.paper.drawImage(bitmap, head.x, head.y, head.width, head.height);
    bitmap.close();
    this.shown = { view: head.view, coats: head.coats };
    const { view, coats, still } = this.wanted;
    const last = head.last && still && head.view === view && head.coats === coats;
    const { dataset } = this.canvas;
    dataset.frame = String(head.frame);
    dataset.level = String(head.level);
    dataset.view = String(head.view);
    dataset.coats = String(head.coats);
    dataset.last = last ? "1" : "0";
    this.times.push(performance.now());
    this.drawn(head);
  }

  // Another size keeps the old picture, scaled, until the new one has come.
  fit(width, height) {
    const { canvas } = this;
    if (canvas.width === width && canvas.height === height) return;
    const old = document.createElement("canvas");
    old.width = canvas.width;
    old.height = canvas.height;
    old.getContext("2d").drawImage(canvas, 0, 0);
    canvas.width = width;
    canvas.height = height;
    this.paper.drawImage(old, 0, 0, width, height);
  }

  // Pictures drawn within the last second.
  get rate() {
    const now = performance.now();
    this.times = this.times.filter((time) => now - time < 1000);
    return this.times.length;
  }
}
