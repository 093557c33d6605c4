// What a person does in the studio, by a browser without a screen.

import { readFile } from "node:fs/promises";
import { basename } from "node:path";
import { chromium } from "playwright-core";
import { statistics } from "./statistics.js";

const PATIENCE_MS = 120000;

export class Hands {
  static async open(address, folder, options) {
    const browser = await chromium.launch({
      executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
      args: ["--no-sandbox", "--disable-background-networking", "--disable-component-update"],
    });
    const hands = new Hands();
    Object.assign(hands, { browser, address, folder, requests: [], faults: [], shots: 0 });
    await hands.turn(options);
    return hands;
  }

  // A new page, of another size or scheme.
  async turn(options) {
    await this.context?.close();
    this.context = await this.browser.newContext({ acceptDownloads: true, ...options });
    this.page = await this.context.newPage();
    await this.page.addInitScript(statistics);
    this.page.on("request", (request) => this.requests.push(request.url()));
    this.page.on("websocket", (socket) => this.requests.push(socket.url()));
    this.page.on("pageerror", (fault) => this.faults.push(fault.message));
    this.page.on("console", (message) => {
      if (message.type() === "error") this.faults.push(message.text());
    });
    await this.page.goto(this.address);
  }

  // Until the sharp picture of what was asked last is there, and nothing is under way any more.
  async settled() {
    await this.page.waitForTimeout(250);
    await this.page.waitForFunction(() => {
      const { last, frame } = document.getElementById("view").dataset;
      const now = performance.now();
      const state = (window.studioTest.state ??= { frame: "", since: now });
      if (last !== "1" || state.frame !== frame) Object.assign(state, { frame, since: now });
      return last === "1" && now - state.since > 300;
    }, null, { timeout: PATIENCE_MS, polling: 50 });
  }

  // Keeps the settled picture in the page under a name, and a screenshot.
  async keep(name) {
    await this.settled();
    const found = await this.page.evaluate((as) => window.studioTest.keep(as), name);
    await this.shot(name);
    return found;
  }

  async shot(name) {
    this.shots += 1;
    const number = String(this.shots).padStart(2, "0");
    await this.page.screenshot({ path: `${this.folder}/${number}-${name.replaceAll(" ", "-")}.png` });
  }

  async painting(file) {
    const base64 = await readFile(file, "base64");
    await this.page.evaluate(([name, bytes]) => window.studioTest.painting(name, bytes), [file, base64]);
  }

  style(a, b) {
    return this.page.evaluate(([x, y]) => window.studioTest.style(x, y), [a, b]);
  }

  difference(a, b) {
    return this.page.evaluate(([x, y]) => window.studioTest.difference(x, y), [a, b]);
  }

  // A drag by hand over the middle of the picture, in pixels.
  async drag(x, y) {
    const box = await this.page.locator("#view").boundingBox();
    const [cx, cy] = [box.x + box.width / 2, box.y + box.height / 2];
    await this.page.mouse.move(cx, cy);
    await this.page.mouse.down();
    await this.page.mouse.move(cx + x, cy + y, { steps: 6 });
    await this.page.mouse.up();
  }

  // A file dropped on the picture.
  async drop(bytes, name, { shift = false, type = "image/jpeg" } = {}) {
    await this.page.evaluate(([base64, called, shiftKey, mime]) => {
      const content = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(new File([content], called, { type: mime }));
      for (const event of ["dragenter", "dragover", "drop"]) {
        document.getElementById("view").dispatchEvent(new DragEvent(event, {
          dataTransfer, shiftKey, bubbles: true, cancelable: true,
        }));
      }
    }, [Buffer.from(bytes).toString("base64"), name, shift, type]);
  }

  async dropPainting(file, options) {
    const before = await this.page.locator("#view").getAttribute("data-coats");
    await this.drop(await readFile(file), basename(file), options);
    await this.page.waitForFunction(
      (old) => document.getElementById("view").dataset.coats !== old, before, { timeout: PATIENCE_MS },
    );
  }
}
