// Small helpers for the document. Text that a user or the server wrote goes in as text only.

export const at = (id) => document.getElementById(id);

// An element with attributes, listeners (`onclick: f`) and children; strings become text.
export function el(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === undefined || value === null) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

// One of the drawings that index.html defines.
export function icon(name) {
  const space = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(space, "svg");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const use = document.createElementNS(space, "use");
  use.setAttribute("href", `#icon-${name}`);
  svg.append(use);
  return svg;
}

export function iconButton(name, label, onclick, attributes = {}) {
  const title = attributes.title ?? label;
  return el("button", {
    type: "button", class: "quiet", "aria-label": label, onclick, ...attributes, title,
  }, icon(name));
}

let labels = 0;

// A slider with its name before and its value behind it.
export function slider({ label, min, max, step, value, text, oninput }) {
  const id = `slider-${++labels}`;
  const output = el("output", { for: id }, text(value));
  const input = el("input", {
    type: "range", id, min, max, step,
    oninput: () => {
      oninput(Number(input.value));
      output.textContent = text(Number(input.value));
    },
  });
  input.value = value;
  const row = el("div", { class: "slider" }, el("label", { for: id }, label), input, output);
  return { row, input, output };
}

// A field for a number; what is no number is not passed on.
export function numberField({ label, value, step = "any", min, max, onchange }) {
  const input = el("input", {
    type: "number", step, min, max, "aria-label": label,
    onchange: () => {
      const number = input.valueAsNumber;
      if (Number.isFinite(number) && input.validity.valid) onchange(number);
    },
  });
  input.value = Number.isFinite(value) ? String(Math.round(value * 100) / 100) : "";
  return input;
}

// Offers a file for download.
export function download(blob, name) {
  const address = URL.createObjectURL(blob);
  const link = el("a", { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}

// The server's messages begin small, since the program puts "impasto: " before them.
export const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);

export const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;
