// Looks that are kept with the model.

import { get, request } from "./api.js";
import { at, el, iconButton } from "./dom.js";
import { guarded, say } from "./notices.js";

const address = (name) => `/api/favourites/${encodeURIComponent(name)}`;

export class Favourites {
  constructor(coats, shelf) {
    Object.assign(this, { coats, shelf });
    coats.addEventListener("change", () => this.update());
    at("favourite-form").addEventListener("submit", guarded(async (event) => {
      event.preventDefault();
      const name = at("favourite-name").value.trim();
      if (name === "") return;
      await request("PUT", address(name), { coats: coats.json() });
      at("favourite-form").reset();
      // Its paintings are kept with it, under names of their own.
      await this.shelf.load();
      await this.load();
      say(`${name} is saved with the model.`);
    }));
  }

  update() {
    at("favourite-save").disabled = this.coats.json().length === 0;
  }

  async load() {
    const all = await get("/api/favourites");
    at("favourites").replaceChildren(...all.map((favourite) => this.entry(favourite)));
  }

  entry({ name, coats }) {
    const thumbs = el("span", { class: "thumbs" }, ...coats.flatMap(({ paintings }) => paintings).slice(0, 3)
      .map(({ painting }) => this.shelf.thumbnail(painting)));
    return el("li", {},
      el("button", {
        type: "button", class: "name", "data-favourite": name, onclick: () => this.coats.replaceAll(coats),
      }, thumbs, el("span", { class: "words" }, name)),
      iconButton("bin", `Delete ${name}`, guarded(async () => {
        await request("DELETE", address(name));
        await this.load();
      })));
  }
}
