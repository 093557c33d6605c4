// Short messages at the edge of the picture. Faults stay longer, and are read out at once.

import { at, el, iconButton, sentence } from "./dom.js";

const SHOWN_MS = 5000;
const FAULT_MS = 12000;

function show(place, message, duration) {
  for (const old of place.children) {
    if (old.firstChild.textContent === message) old.remove();
  }
  while (place.children.length > 2) place.firstElementChild.remove();
  const toast = el("div", { class: "toast" }, el("p", {}, message));
  toast.append(iconButton("close", "Dismiss", () => toast.remove()));
  place.append(toast);
  setTimeout(() => toast.remove(), duration);
}

export const say = (message) => show(at("notices"), message, SHOWN_MS);
export const warn = (fault) => show(at("faults"), sentence(fault.message), FAULT_MS);

// For listeners: whatever goes wrong inside is said.
export const guarded = (action) => async (...given) => {
  try {
    await action(...given);
  } catch (fault) {
    warn(fault);
  }
};
