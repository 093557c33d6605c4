// The shelf of paintings: thumbnails, uploads, drops, and generated ones.

import { get, post } from "./api.js";
import { at, el, icon, sentence } from "./dom.js";
import { guarded, say, warn } from "./notices.js";

const LARGEST = 32 * 1024 * 1024;
const MANY = 12;
const SAVED = "saved:";
const OURS = "application/x-impasto-painting";

// The file's name as one would say it: without its ending and the number that sorts it.
const spoken = (name) => {
  const words = name.split("/").at(-1).replace(/\.(jpe?g|png|webp|gif|bmp|tiff?)$/i, "")
    .replace(/^\d+[_-]+/, "").replace(/[_-]+/g, " ").trim();
  return words === "" ? name : words;
};

export class Shelf {
  constructor(coats) {
    this.coats = coats;
    this.known = new Map();
    at("choose").addEventListener("click", () => at("file").click());
    at("file").addEventListener("change", guarded(async () => {
      const files = [...at("file").files];
      at("file").value = "";
      await this.take(files, false);
    }));
    at("random").addEventListener("click", guarded(() => this.surprise()));
    at("find").addEventListener("input", () => this.build());
    this.listenForDrops();
    coats.addEventListener("change", () => this.mark());
  }

  async load() {
    const all = await get("/api/paintings");
    this.known = new Map(all.map((painting) => [painting.id, { ...painting, name: spoken(painting.name) }]));
    this.build();
  }

  name(id) {
    return this.known.get(id)?.name ?? id;
  }

  thumbnail(id) {
    const address = this.known.get(id)?.thumbnail;
    return address ? el("img", { src: address, alt: "", width: 32, height: 32, draggable: "false" })
      : el("span", { class: "blank" });
  }

  build() {
    // What favourites keep is a copy of what mostly stands on the shelf already.
    const own = new Set([...this.known.values()].filter(({ id }) => !id.startsWith(SAVED)).map(({ name }) => name));
    const all = [...this.known.values()].filter(({ id, name }) => !id.startsWith(SAVED) || !own.has(name));
    const words = at("find").value.trim().toLowerCase();
    const found = all.filter(({ name }) => name.toLowerCase().includes(words));
    at("shelf").replaceChildren(...found.map((painting) => this.entry(painting)));
    at("find").hidden = all.length <= MANY;
    at("shelf-empty").hidden = all.length > 0;
    this.mark();
  }

  entry({ id, name, thumbnail }) {
    const apply = el("button", {
      type: "button", class: "painting", title: name, "aria-label": `Paint with ${name}`, "data-painting": id,
      onclick: (event) => (event.shiftKey ? this.coats.mix(id) : this.coats.paint(id)),
    }, el("img", { src: thumbnail, alt: "", loading: "lazy", draggable: "false" }));
    apply.draggable = true;
    apply.addEventListener("dragstart", (event) => event.dataTransfer.setData(OURS, id));
    const mix = el("button", {
      type: "button", class: "mix", title: `Mix in ${name}`, "aria-label": `Mix in ${name}`, "data-mix": id,
      onclick: () => this.coats.mix(id),
    }, icon("plus"));
    return el("li", {}, apply, mix);
  }

  // Which paintings the chosen coat has.
  mark() {
    const used = new Set(this.coats.chosen?.paintings.map(({ painting }) => painting));
    for (const button of at("shelf").querySelectorAll(".painting")) {
      button.setAttribute("aria-pressed", String(used.has(button.dataset.painting)));
    }
  }

  // New ones come first: who uploaded one looks for it.
  put({ id, name, thumbnail }) {
    const painting = { id, name: spoken(name), thumbnail };
    this.known.delete(id);
    this.known = new Map([[id, painting], ...this.known]);
    at("find").value = "";
    this.build();
    at("shelf").scrollTop = 0;
  }

  async surprise() {
    const painting = await post("/api/paintings/random");
    this.put(painting);
    this.coats.paint(painting.id);
  }

  // Paints with pictures: the first one instead of what is there or, mixing, beside it.
  async take(files, mixing) {
    if (at("painting").disabled) throw new Error("This model cannot be painted yet.");
    let mixes = mixing;
    for (const file of files) {
      if (file.size > LARGEST) {
        warn(new Error(`“${file.name}” is larger than 32 MiB. Save a smaller copy and drop that.`));
        continue;
      }
      try {
        at("stage").classList.add("busy");
        const painting = await post(`/api/paintings?name=${encodeURIComponent(file.name)}`, file);
        this.put(painting);
        if (mixes) this.coats.mix(painting.id);
        else this.coats.paint(painting.id);
        mixes = true;
        say(`${sentence(spoken(painting.name))} is on the shelf.`);
      } catch (fault) {
        warn(new Error(`“${file.name}”: ${sentence(fault.message)}`));
      } finally {
        at("stage").classList.remove("busy");
      }
    }
  }

  listenForDrops() {
    const carries = (event) => [...event.dataTransfer.types].some((type) => type === "Files" || type === OURS);
    let depth = 0;
    const leave = () => {
      depth = 0;
      at("drop").hidden = true;
    };
    document.addEventListener("dragenter", (event) => {
      if (!carries(event) || at("painting").disabled) return;
      depth += 1;
      at("drop").hidden = false;
    });
    document.addEventListener("dragleave", () => {
      depth -= 1;
      if (depth <= 0) leave();
    });
    // Without this, the browser would open what is dropped instead of the studio.
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener("dragend", leave);
    document.addEventListener("drop", guarded(async (event) => {
      event.preventDefault();
      leave();
      const id = event.dataTransfer.getData(OURS);
      if (id !== "") {
        if (event.shiftKey) this.coats.mix(id);
        else this.coats.paint(id);
        return;
      }
      const files = [...event.dataTransfer.files];
      if (files.length === 0) throw new Error("That is no picture file. Save the painting first, then drop the file.");
      await this.take(files, event.shiftKey);
    }));
    document.addEventListener("paste", guarded(async (event) => {
      const files = [...(event.clipboardData?.files ?? [])];
      if (files.length > 0) await this.take(files, false);
    }));
  }
}
