// The list of coats: the chosen one is open, the others are one line each.

import { at, el, icon, iconButton, slider } from "./dom.js";
import { maskFields } from "./masks.js";

const KEEPS = [
  ["none", "Painting’s", "As the painting has them."],
  ["luminance", "Scene’s", "Only light and dark are painted."],
  ["palette", "Matched", "Paint in the scene’s own palette."],
];

const percent = (share) => `${Math.round(share * 100)} %`;

export class CoatList {
  // `shelf` knows the paintings, `picker` finds points in the scene.
  constructor(coats, shelf, picker) {
    Object.assign(this, { coats, shelf, picker });
    at("coat-add").addEventListener("click", () => {
      coats.add();
      at("coats").querySelector("button")?.focus();
    });
    at("undo").addEventListener("click", () => coats.undo());
    at("redo").addEventListener("click", () => coats.redo());
    coats.addEventListener("shape", () => this.build());
    coats.addEventListener("history", () => {
      at("undo").disabled = coats.past.length === 0;
      at("redo").disabled = coats.future.length === 0;
    });
    this.build();
  }

  build() {
    const { coats } = this;
    const focused = document.activeElement?.dataset?.keep;
    const chosen = coats.chosen;
    const items = coats.list.map((coat, i) => this.coat(coat, i, coat === chosen)).reverse();
    at("coats").replaceChildren(...items);
    at("coats-empty").hidden = coats.list.length > 0;
    at("coat-add").hidden = coats.list.length === 0;
    // Who works with the keyboard stays where they were.
    if (focused) document.querySelector(`[data-keep="${CSS.escape(focused)}"]`)?.focus();
  }

  coat(coat, i, open) {
    const item = el("li", { class: open ? "coat open" : "coat", "data-coat": i });
    item.classList.toggle("off", !coat.on);
    item.append(this.head(coat, i, open));
    if (!open) return item;
    const body = el("div", { class: "body", id: `coat-${coat.key}` });
    body.append(this.mixture(coat));
    const setting = (label, key, range) => body.append(slider({
      label, ...range, value: coat[key],
      oninput: (value) => {
        coat[key] = value;
        this.coats.changed();
      },
    }).row);
    const share = { min: 0, max: 1, step: 0.01, text: percent };
    setting("Strength", "strength", share);
    setting("Stroke size", "size", { min: 0.5, max: 2, step: 0.05, text: (value) => `${value.toFixed(2)} ×` });
    setting("Strokes", "strokes", share);
    body.append(this.keep(coat));
    body.append(maskFields(coat, this.coats, this.picker));
    item.append(body);
    return item;
  }

  head(coat, i, open) {
    const { coats } = this;
    const name = coat.paintings.length === 0
      ? "No painting yet" : coat.paintings.map(({ painting }) => this.shelf.name(painting)).join(" + ");
    const keep = (what) => ({ "data-keep": `${what}-${coat.key}` });
    const thumbs = el("span", { class: "thumbs" }, ...coat.paintings.slice(0, 3)
      .map(({ painting }) => this.shelf.thumbnail(painting)));
    const title = el("button", {
      type: "button", class: "name", "aria-expanded": String(open),
      "aria-controls": open ? `coat-${coat.key}` : null, title: name,
      onclick: () => coats.choose(coat), ...keep("name"),
    }, thumbs, el("span", { class: "words" }, name));
    const buttons = el("span", { class: "buttons" },
      iconButton(coat.on ? "eye" : "hidden", `Show coat ${i + 1}`, () => {
        coat.on = !coat.on;
        coats.changed(true);
      }, { "aria-pressed": String(coat.on), ...keep("eye"), title: coat.on ? "Hide this coat" : "Show this coat" }));
    if (coats.list.length > 1) {
      buttons.append(
        iconButton("up", `Coat ${i + 1} one up`, () => coats.move(coat, 1),
          { disabled: i === coats.list.length - 1, ...keep("up"), title: "One up" }),
        iconButton("down", `Coat ${i + 1} one down`, () => coats.move(coat, -1),
          { disabled: i === 0, ...keep("down"), title: "One down" }),
      );
    }
    buttons.append(iconButton("bin", `Remove coat ${i + 1}`, () => coats.remove(coat), { title: "Remove this coat" }));
    return el("div", { class: "head" }, title, buttons);
  }

  // The paintings of a coat. Weights matter from two on.
  mixture(coat) {
    if (coat.paintings.length === 0) {
      return el("p", { class: "soft" }, "Choose a painting above, or drop one on the picture.");
    }
    if (coat.paintings.length === 1) {
      return el("p", { class: "soft tip" }, "Mix in another with ", icon("plus"), " on its picture.");
    }
    const list = el("ul", { class: "mixture", "aria-label": "Mixture" });
    const outputs = [];
    const shares = () => {
      const sum = coat.paintings.reduce((all, { weight }) => all + weight, 0);
      outputs.forEach((output, i) => {
        output.textContent = percent(sum > 0 ? coat.paintings[i].weight / sum : 0);
      });
    };
    for (const part of coat.paintings) {
      const name = this.shelf.name(part.painting);
      const { row, input, output } = slider({
        label: name, min: 0, max: 1, step: 0.01, value: part.weight, text: percent,
        oninput: (value) => {
          part.weight = value;
          queueMicrotask(shares);
          this.coats.changed();
        },
      });
      input.dataset.weight = part.painting;
      outputs.push(output);
      list.append(el("li", {}, this.shelf.thumbnail(part.painting), row,
        iconButton("close", `Take ${name} out`, () => this.coats.drop(coat, part.painting))));
    }
    shares();
    return list;
  }

  keep(coat) {
    const group = el("fieldset", { class: "choice" }, el("legend", {}, "Colours"));
    const words = el("p", {}, KEEPS.find(([value]) => value === coat.keep)[2]);
    for (const [value, label, meaning] of KEEPS) {
      const input = el("input", {
        type: "radio", name: `keep-${coat.key}`, value,
        onchange: () => {
          coat.keep = value;
          words.textContent = meaning;
          this.coats.changed();
        },
      });
      input.checked = coat.keep === value;
      group.append(el("label", {}, input, el("span", {}, label)));
    }
    group.append(words);
    return group;
  }
}
