// What the page is doing when it is not simply showing a picture: connecting, waiting for a model
// in training, without a style stage, without a connection.

import { at, sentence } from "./dom.js";
import { RunView } from "./run.js";

export class States {
  constructor(again) {
    Object.assign(this, { scene: null, last: null, seen: false, used: false, before: false, timer: 0 });
    this.cover = new RunView(at("state-run"));
    this.panel = new RunView(at("run"));
    at("state-run").hidden = true;
    at("state-again").addEventListener("click", again);
    at("connection-again").addEventListener("click", again);
    at("painting").disabled = true;
  }

  // What changes every second stands apart: it would be read out every second.
  title(title, text, when = "") {
    at("state").hidden = false;
    at("state-when").textContent = when;
    if (at("state-title").textContent !== title) at("state-title").textContent = title;
    if (at("state-text").textContent !== text) at("state-text").textContent = text;
  }

  opened() {
    clearInterval(this.timer);
    at("connection").hidden = true;
    at("state-again").hidden = true;
    document.body.classList.remove("offline");
  }

  // No connection; it tries again in so many seconds.
  lost(seconds) {
    document.body.classList.add("offline");
    let left = Math.ceil(seconds);
    const tell = () => {
      const when = left > 0 ? `Trying again in ${left} s.` : "Trying again…";
      if (this.seen) {
        at("connection").hidden = false;
        at("connection-when").textContent = when;
      } else {
        this.title("The studio does not answer", "Is impasto view still running?", when);
        at("state-run").hidden = true;
        at("state-again").hidden = false;
      }
      left -= 1;
    };
    clearInterval(this.timer);
    tell();
    this.timer = setInterval(tell, 1000);
  }

  // There is no model to show; perhaps it is in training.
  noScene(fault, run) {
    if (run?.training) {
      this.run(run);
      return;
    }
    this.title("There is nothing to show", sentence(fault.message));
    at("state-again").hidden = true;
  }

  show(scene) {
    this.scene = scene;
    at("scene-title").textContent = scene.name;
    at("scene-synthetic").hidden = !scene.synthetic;
    at("unstyled").hidden = scene.styled;
    at("painting").disabled = !scene.styled;
    document.title = `${scene.name} – Impasto`;
    if (!this.seen) {
      at("state-run").hidden = true;
      this.title("Opening the scene", "The first picture is being rendered.");
    }
  }

  // A picture is on the canvas.
  drawn() {
    at("state").hidden = true;
    at("facts").hidden = false;
    if (this.seen) return;
    this.seen = true;
    document.body.classList.remove("waiting");
    const hint = at("hint");
    if (!this.used && this.scene?.styled) {
      at("hint-text").textContent = matchMedia("(hover: none)").matches
        ? "Choose a painting from the shelf." : "Drop a painting here, or choose one from the shelf.";
      hint.hidden = false;
      hint.dataset.first = "1";
    }
  }

  // The first paint is on: the hint has done its work.
  painted() {
    this.used = true;
    const hint = at("hint");
    if (hint.dataset.first) {
      delete hint.dataset.first;
      hint.hidden = true;
    }
  }

  run(run) {
    this.last = run;
    at("tab-run").hidden = !run.training && !this.before;
    if (!run.training) return;
    this.before = true;
    this.panel.show(run);
    if (this.scene) return;
    this.title("This model is in training", "It opens by itself as soon as there is something to see.");
    at("state-run").hidden = false;
    this.cover.show(run);
  }

  redraw() {
    if (this.last?.training) this.run(this.last);
  }
}
