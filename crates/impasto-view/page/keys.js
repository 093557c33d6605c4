// What the keys do when they are not for a field, a list or a button.

import { at } from "./dom.js";

const TYPED = "input:not([type=range]):not([type=checkbox]):not([type=radio]):not([type=file]), textarea";
const ARROWED = "input, select, textarea, [role=tab]";
const PRESSED = "button, a, summary, select, input";

export function setUpKeys({ controls, places, paths, coats, picker, brush, toggleWide }) {
  const onStage = () => document.activeElement === at("view");

  const plain = {
    "?": () => at("help").showModal(),
    f: () => controls.focus(0.5, 0.5),
    l: () => places.level(),
    k: () => paths.add(),
    p: toggleWide,
    c: () => brush.compare(true),
    "[": () => places.step(-1),
    "]": () => places.step(1),
    Home: () => places.home(),
    Escape: () => {
      if (picker.asks) picker.cancel();
      else if (document.body.classList.contains("wide")) toggleWide();
    },
  };

  document.addEventListener("keydown", (event) => {
    if (at("help").open) return;
    const target = event.target instanceof Element ? event.target : document.body;
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !target.matches(TYPED)) {
      event.preventDefault();
      if (event.shiftKey) coats.redo();
      else coats.undo();
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey || target.matches(TYPED)) return;
    if (event.key === "Enter" && picker.asks && onStage()) {
      picker.take(0.5, 0.5);
      return;
    }
    if (event.key === " " && !target.matches(PRESSED)) {
      event.preventDefault();
      paths.toggle();
      return;
    }
    const moves = /^(Arrow|Home)/.test(event.key);
    if (moves && target.matches(ARROWED)) return;
    // Letters choose an entry in a list.
    if (target.matches("select")) return;
    const action = plain[event.key] ?? plain[event.key.toLowerCase()];
    if (action) {
      if (event.repeat && event.key !== "[" && event.key !== "]") return;
      event.preventDefault();
      action();
    } else if (controls.key(event)) event.preventDefault();
  });

  document.addEventListener("keyup", (event) => {
    if (event.key.toLowerCase() === "c") brush.compare(false);
  });
}
