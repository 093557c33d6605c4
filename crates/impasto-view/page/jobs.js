// Films and exports: what is to be made, how far it is, and the files.

import { get, post, request } from "./api.js";
import { at, download, el, iconButton } from "./dom.js";
import { guarded, say, warn } from "./notices.js";

const POLL_MS = 700;
const FILMS = { gif: "GIF", mp4: "MP4", webm: "WebM", png: "PNG frames" };
const EXPORTS = { points: "Point cloud", splats: "Gaussian splats" };

export class Jobs {
  constructor(coats, paths) {
    Object.assign(this, { coats, paths, formats: false });
    at("film-size").addEventListener("change", () => {
      at("film-other").hidden = at("film-size").value !== "";
      this.update();
    });
    at("film").addEventListener("input", () => this.update());
    at("film").addEventListener("submit", guarded(async (event) => {
      event.preventDefault();
      await this.record();
    }));
    paths.addEventListener("change", () => this.update());
    at("picture-save").addEventListener("click", () => {
      at("view").toBlob((blob) => download(blob, `${paths.name}.png`), "image/png");
    });
  }

  async load() {
    const { films, exports } = await get("/api/formats");
    at("film-format").replaceChildren(...films.map((value) => el("option", { value }, FILMS[value] ?? value)));
    at("exports").replaceChildren(...exports.map((kind) => el("button", {
      type: "button", "data-export": kind,
      onclick: guarded(async () => {
        const { job } = await post("/api/exports", { coats: this.coats.json(), kind });
        this.follow(job, EXPORTS[kind] ?? kind);
      }),
    }, EXPORTS[kind] ?? kind)));
    this.formats = films.length > 0;
    at("film-needs").textContent = this.formats ? "A film follows the camera path: set at least two keyframes under Camera."
      : "This machine can make no films.";
    at("exports-section").hidden = exports.length === 0;
    this.update();
  }

  get size() {
    const preset = at("film-size").value;
    return preset === "" ? [at("film-width").valueAsNumber, at("film-height").valueAsNumber]
      : preset.split("x").map(Number);
  }

  update() {
    const { paths } = this;
    at("film-needs").hidden = this.formats && paths.keyframes.length >= 2;
    at("film-record").disabled = !paths.ready || !this.formats;
    const { seconds, fps } = paths.json(this.size);
    const frames = Math.max(1, Math.round(seconds * fps));
    at("film-length").textContent = paths.ready ? `${frames} frames` : "";
  }

  async record() {
    const { size } = this;
    const format = at("film-format").value;
    const both = at("film-both").checked;
    const { job } = await post("/api/films", {
      path: this.paths.json(size), coats: this.coats.json(), size, format, side_by_side: both,
    });
    this.follow(job, `${FILMS[format] ?? format}, ${size[0]} × ${size[1]}${both ? ", side by side" : ""}`);
  }

  follow(job, title) {
    const address = `/api/jobs/${encodeURIComponent(job)}`;
    const bar = el("progress", { max: 1, "aria-label": title });
    const text = el("span", { class: "soft" }, "waiting");
    const end = el("span", { class: "buttons" });
    const entry = el("li", { class: "job", "data-job": job, "data-state": "waiting" },
      el("div", { class: "head" }, el("span", { class: "words" }, title), end), el("div", { class: "line" }, bar, text));
    let over = false;
    end.append(iconButton("close", `Stop ${title}`, guarded(async () => {
      over = true;
      await request("DELETE", address);
      entry.remove();
    }), { title: "Stop" }));
    at("jobs").prepend(entry);
    at("jobs-empty").hidden = true;
    entry.scrollIntoView({ block: "nearest" });

    const forget = () => iconButton("close", `Remove ${title} from the list`, () => entry.remove(), { title: "Remove from the list" });
    const finish = ({ state, error, file }) => {
      over = true;
      bar.remove();
      if (state === "done") {
        text.textContent = "";
        end.replaceChildren(el("a", { class: "button", href: file, download: "" }, "Download"), forget());
        say(`${title}: ready to download.`);
      } else {
        text.textContent = error ?? "It could not be made.";
        text.className = "fault";
        end.replaceChildren(forget());
        warn(new Error(`${title}: ${text.textContent}`));
      }
    };
    const look = async () => {
      if (over) return;
      try {
        const found = await get(address);
        if (over) return;
        entry.dataset.state = found.state;
        if (found.state === "done" || found.state === "failed") {
          finish(found);
          return;
        }
        if (found.state === "running") {
          bar.value = found.progress;
          text.textContent = `${Math.floor(found.progress * 100)} %`;
        }
      } catch (fault) {
        // Without an answer the job may still go on; one that is not known any more does not.
        if (fault.status === 404) {
          finish({ state: "failed", error: fault.message });
          return;
        }
      }
      setTimeout(look, POLL_MS);
    };
    look();
  }
}
