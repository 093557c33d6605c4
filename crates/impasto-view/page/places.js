// Where the photos were taken: the places to begin at and to jump to.

import { at, el } from "./dom.js";

export class Places {
  // `left()` is called before the camera leaves for a photo.
  constructor(camera, controls, left) {
    Object.assign(this, { camera, controls, left, photos: [], start: 0, focus: [0, 0, 0] });
    at("photo").addEventListener("change", () => this.go(at("photo").selectedIndex));
    at("photo-before").addEventListener("click", () => this.step(-1));
    at("photo-after").addEventListener("click", () => this.step(1));
    at("home").addEventListener("click", () => this.home());
    at("level").addEventListener("click", () => this.level());
  }

  show(scene, first) {
    this.photos = scene.photos;
    this.start = Math.min(scene.start, Math.max(0, scene.photos.length - 1));
    this.focus = scene.focus;
    const chosen = at("photo").selectedIndex;
    at("photo").replaceChildren(...scene.photos.map(({ name, split }) => {
      const short = name.split("/").at(-1);
      return el("option", {}, split === "test" ? `${short} (test)` : short);
    }));
    at("photo").selectedIndex = first ? this.start : Math.min(chosen, scene.photos.length - 1);
    at("places").hidden = false;
    if (!first) return;
    this.camera.fov = scene.fov;
    const photo = this.photos[this.start];
    if (photo) this.camera.stand(photo.camera_to_world, photo.fov, this.focus);
  }

  go(i) {
    const photo = this.photos[i];
    if (!photo) return;
    this.left();
    at("photo").selectedIndex = i;
    const target = this.camera.copy();
    target.stand(photo.camera_to_world, photo.fov, this.focus);
    this.controls.go(target);
  }

  step(by) {
    const count = this.photos.length;
    if (count > 0) this.go((at("photo").selectedIndex + by + count) % count);
  }

  home() {
    this.go(this.start);
  }

  level() {
    this.left();
    const target = this.camera.copy();
    target.level();
    this.controls.go(target);
  }
}
