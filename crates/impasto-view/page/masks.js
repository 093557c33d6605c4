// Where a coat goes: fields for its mask, some of them filled by a click in the picture.

import { el, numberField, slider } from "./dom.js";
import { guarded } from "./notices.js";
import { add, sub, times } from "./vectors.js";

const KINDS = [
  ["everywhere", "Everywhere"], ["near", "The near scene"], ["far", "The far surroundings"],
  ["depth", "A range of depth"], ["sphere", "Inside a sphere"], ["box", "Inside a box"],
  ["surface", "A surface, clicked"],
];
const round = (value) => String(Math.round(value * 100) / 100);

const triple = (label, point, changed) => el("div", { class: "triple", role: "group", "aria-label": label },
  el("span", {}, label),
  ...["x", "y", "z"].map((axis, i) => numberField({
    label: `${label}, ${axis}`, value: point[i], step: 0.05, onchange: (value) => changed(i, value),
  })));

export function maskFields(coat, coats, picker) {
  const { mask } = coat;
  const select = el("select", {
    "data-keep": `mask-${coat.key}`,
    onchange: () => {
      mask.kind = select.value;
      coats.changed(true);
      if (mask.kind === "surface" && !mask.surface.point) pickSurface();
    },
  }, ...KINDS.map(([value, label]) => el("option", { value }, label)));
  select.value = mask.kind;
  const box = el("div", { class: "mask" }, el("label", { class: "line" }, el("span", {}, "Where"), select));
  const changed = () => coats.changed();
  const rebuilt = () => coats.changed(true);

  const pickButton = (label, what, take) => el("div", { class: "row" }, el("button", {
    type: "button", "data-keep": `pick-${coat.key}`,
    onclick: guarded(async () => {
      const found = await picker.ask(what);
      if (found) {
        take(found);
        rebuilt();
      }
    }),
  }, label));

  const pickSurface = guarded(async () => {
    const found = await picker.ask("Click the surface to paint");
    if (found) {
      mask.surface.point = found.point;
      rebuilt();
    }
  });

  const fields = {
    depth: () => {
      const { depth } = mask;
      const furthest = Math.max(2, Math.ceil(depth.to * 1.5));
      const line = (label, name) => slider({
        label, min: 0, max: furthest, step: 0.01, value: depth[name], text: round,
        oninput: (value) => {
          depth[name] = value;
          // The one that is pushed takes the other along: a range never is upside down.
          if (depth.from > depth.to) depth[name === "from" ? "to" : "from"] = value;
          lines.forEach(({ input, output }, i) => {
            const end = depth[i === 0 ? "from" : "to"];
            input.value = end;
            output.textContent = round(end);
          });
          changed();
        },
      });
      const lines = [line("From", "from"), line("To", "to")];
      return [...lines.map(({ row }) => row), pickButton("Around a point…", "Click what lies in the middle of the range",
        (found) => Object.assign(depth, { from: Math.max(0, found.depth * 0.8), to: found.depth * 1.2 }))];
    },
    sphere: () => [
      pickButton("Put it at a point…", "Click where the sphere goes", (found) => { mask.sphere.centre = found.point; }),
      slider({
        label: "Radius", min: 0.02, max: 1.5, step: 0.01, value: mask.sphere.radius, text: round,
        oninput: (value) => {
          mask.sphere.radius = value;
          changed();
        },
      }).row,
      triple("Centre", mask.sphere.centre, (i, value) => {
        mask.sphere.centre[i] = value;
        changed();
      }),
    ],
    box: () => {
      const { min, max } = mask.box;
      const centre = times(add(min, max), 0.5);
      const size = sub(max, min);
      const put = (c, s) => {
        mask.box = { min: sub(c, times(s, 0.5)), max: add(c, times(s, 0.5)) };
        changed();
      };
      return [
        pickButton("Put it at a point…", "Click where the box goes", (found) => put(found.point, size)),
        triple("Centre", centre, (i, value) => {
          centre[i] = value;
          put(centre, size);
        }),
        triple("Size", size, (i, value) => {
          size[i] = Math.max(0.01, Math.abs(value));
          put(centre, size);
        }),
      ];
    },
    surface: () => [
      el("div", { class: "row" }, el("button", { type: "button", "data-keep": `pick-${coat.key}`, onclick: pickSurface },
        mask.surface.point ? "Click another surface…" : "Click a surface…")),
      slider({
        label: "Reach", min: 0, max: 1, step: 0.01, value: mask.surface.tolerance, text: round,
        oninput: (value) => {
          mask.surface.tolerance = value;
          if (mask.surface.point) changed();
        },
      }).row,
    ],
  };

  box.append(...(fields[mask.kind]?.() ?? []));
  if (mask.kind !== "everywhere") {
    const input = el("input", {
      type: "checkbox",
      onchange: () => {
        mask.inverted = input.checked;
        changed();
      },
    });
    input.checked = mask.inverted;
    box.append(el("label", { class: "check" }, input, " Everything but that"));
  }
  return box;
}
