// Points in the scene: the next click in the picture, or Enter for its middle, and the server says
// what is there.

import { at } from "./dom.js";

const ANSWER_MS = 5000;

export class Picker {
  // `send(message)` gives the message an id and returns it, 0 when there is no connection.
  constructor(send) {
    this.send = send;
    this.waiting = new Map();
    this.asking = null;
    at("hint-end").addEventListener("click", () => this.cancel());
  }

  get asks() {
    return this.asking !== null;
  }

  // `{point, depth, colour}` of a place of the picture, from 0 to 1; rejected where nothing is.
  async pick(x, y) {
    const id = this.send({ type: "pick", x, y });
    if (id === 0) throw new Error("There is no connection: nothing can be picked.");
    const answer = await new Promise((resolve) => {
      this.waiting.set(id, resolve);
      setTimeout(() => resolve(null), ANSWER_MS);
    });
    this.waiting.delete(id);
    if (!answer) throw new Error("The studio did not say what is there. Try once more.");
    if (!answer.point) throw new Error("There is nothing at this place: click on something solid.");
    return answer;
  }

  // A message `picked`, or a `problem` of this id.
  answered(message) {
    this.waiting.get(message.id)?.(message.type === "picked" ? message : null);
  }

  // Waits for a click; null if it is called off.
  async ask(what) {
    this.cancel();
    const place = await new Promise((resolve) => {
      this.asking = resolve;
      at("stage").classList.add("picking");
      at("aim").hidden = false;
      at("hint-text").textContent = `${what}, or press Enter for the middle.`;
      at("hint").hidden = false;
      at("hint-end").hidden = false;
      at("view").focus({ preventScroll: true });
      if (matchMedia("(max-width: 820px)").matches) window.scrollTo(0, 0);
    });
    this.asking = null;
    at("stage").classList.remove("picking");
    at("aim").hidden = true;
    at("hint").hidden = true;
    at("hint-end").hidden = true;
    return place ? this.pick(...place) : null;
  }

  // Whether a click was waited for.
  take(x, y) {
    if (!this.asking) return false;
    this.asking([x, y]);
    return true;
  }

  cancel() {
    this.asking?.(null);
  }
}
