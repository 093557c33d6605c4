// Camera paths: keyframes, lens, pace, and a preview in the page.

import { post } from "./api.js";
import { at, download, el, icon, iconButton, slider } from "./dom.js";
import { guarded } from "./notices.js";
import { along } from "./spline.js";

const FOV = [10, 110];

export class Paths extends EventTarget {
  // `moved()` is called when the preview moves the camera. "change": another path.
  constructor(camera, controls, moved) {
    super();
    Object.assign(this, { camera, controls, moved, keyframes: [], playing: 0, name: "scene" });
    this.lens = slider({
      label: "Field of view", min: FOV[0], max: FOV[1], step: 1, value: camera.fov, text: (v) => `${Math.round(v)}°`,
      oninput: (value) => {
        this.stop();
        camera.fov = value;
        moved();
      },
    });
    this.lens.input.id = "lens-fov";
    this.lens.row.querySelector("label").htmlFor = "lens-fov";
    at("lens").append(this.lens.row);
    at("keyframe-add").addEventListener("click", () => this.add());
    at("preview").addEventListener("click", () => this.toggle());
    at("path-save").addEventListener("click", guarded(() => this.save()));
    for (const id of ["path-seconds", "path-fps", "path-closed"]) {
      at(id).addEventListener("input", () => this.changed());
    }
    this.changed();
  }

  get ready() {
    return this.keyframes.length >= 2 && at("path-seconds").validity.valid && at("path-fps").validity.valid;
  }

  // As docs/studio.md has it.
  json(size) {
    return {
      keyframes: this.keyframes,
      seconds: at("path-seconds").valueAsNumber,
      fps: at("path-fps").valueAsNumber,
      closed: at("path-closed").checked,
      size,
    };
  }

  // The slider follows the camera, which photos and keyframes change too.
  showLens() {
    this.lens.input.value = this.camera.fov;
    this.lens.output.textContent = `${Math.round(this.camera.fov)}°`;
  }

  add() {
    this.stop();
    this.keyframes.push({ camera_to_world: this.camera.matrix, fov: this.camera.fov });
    this.changed();
  }

  go(i) {
    this.stop();
    const target = this.camera.copy();
    target.stand(this.keyframes[i].camera_to_world, this.keyframes[i].fov);
    this.controls.go(target);
  }

  changed() {
    const entries = this.keyframes.map((keyframe, i) => el("li", {},
      el("button", { type: "button", class: "name", onclick: () => this.go(i), title: "Go there" },
        el("span", { class: "words" }, `Keyframe ${i + 1}`),
        el("span", { class: "soft" }, `${Math.round(keyframe.fov)}°`)),
      iconButton("up", `Keyframe ${i + 1} one earlier`, () => this.swap(i, i - 1), { disabled: i === 0, title: "Earlier" }),
      iconButton("bin", `Delete keyframe ${i + 1}`, () => {
        this.keyframes.splice(i, 1);
        this.changed();
      }, { title: "Delete" })));
    at("keyframes").replaceChildren(...entries);
    at("keyframes-empty").hidden = entries.length > 1;
    at("preview").disabled = !this.ready;
    at("path-save").disabled = !this.ready;
    this.dispatchEvent(new Event("change"));
  }

  swap(i, j) {
    [this.keyframes[i], this.keyframes[j]] = [this.keyframes[j], this.keyframes[i]];
    this.changed();
  }

  toggle() {
    if (this.playing) this.stop();
    else if (this.ready) this.play();
  }

  play() {
    const { keyframes, seconds, closed } = this.json([2, 2]);
    const begun = performance.now();
    at("preview").replaceChildren(icon("stop"), "Stop");
    const step = (now) => {
      const t = Math.max(0, (now - begun) / 1000 / seconds);
      const { matrix, fov } = along(keyframes, closed, t);
      this.camera.stand(matrix, fov);
      this.moved();
      if (t < 1) this.playing = requestAnimationFrame(step);
      else this.stop();
    };
    this.playing = requestAnimationFrame(step);
  }

  stop() {
    cancelAnimationFrame(this.playing);
    this.playing = 0;
    at("preview").replaceChildren(icon("play"), "Preview");
  }

  async save() {
    const path = await post("/api/path", this.json([1920, 1080]));
    download(new Blob([JSON.stringify(path, null, 2)], { type: "application/json" }), `${this.name}-path.json`);
  }
}
