// How long one waits, by the page's own clock: medians of five tries at 640×360.

import { readFile } from "node:fs/promises";
import { basename } from "node:path";

const TRIES = 5;
// The panel is 360 pixels wide.
const SIZE = { viewport: { width: 1000, height: 360 } };

const median = (values) => [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];
const summary = (values) => ({
  median: Math.round(median(values)), tries: values.map(Math.round),
});

// From an event in the page until the canvas shows what it asked for. `first` is the first picture
// of another view or of other coats, `sharp` the last one.
const watch = (page, event, key) => page.evaluate(([name, attribute]) => {
  const canvas = document.getElementById("view");
  const old = canvas.dataset[attribute];
  window.studioTest.times = new Promise((resolve) => {
    let begun = null;
    let first = null;
    document.addEventListener(name, () => { begun = performance.now(); }, { capture: true, once: true });
    const observer = new MutationObserver(() => {
      if (begun === null || canvas.dataset[attribute] === old) return;
      const now = performance.now() - begun;
      first ??= now;
      if (canvas.dataset.last === "1") {
        observer.disconnect();
        resolve({ first, sharp: now });
      }
    });
    observer.observe(canvas, { attributes: true, attributeFilter: ["data-frame", "data-last"] });
  });
}, [event, key]);

const times = (page) => page.evaluate(() => window.studioTest.times);

export async function latencies(hands, files) {
  await hands.turn(SIZE);
  const { page } = hands;
  // One size for all tries.
  await page.evaluate(() => localStorage.setItem("impasto-detail", "1280"));
  await page.reload();
  await hands.settled();
  const size = await page.evaluate(() => {
    const { width, height } = document.getElementById("view");
    return [width, height];
  });

  const moves = [];
  for (let i = 0; i < TRIES; i++) {
    await page.mouse.move(320, 180);
    await page.mouse.down();
    await hands.settled();
    await watch(page, "pointermove", "view");
    await page.mouse.move(320 + (i % 2 ? 40 : -40), 180);
    moves.push(await times(page));
    await page.mouse.up();
  }

  const drops = [];
  for (let i = 0; i < TRIES; i++) {
    await hands.settled();
    const file = files[i % files.length];
    const content = await readFile(file);
    await watch(page, "drop", "coats");
    await hands.drop(content, basename(file));
    drops.push(await times(page));
  }
  await hands.shot("latency");

  return {
    size,
    move_to_coarse: summary(moves.map(({ first }) => first)),
    move_to_sharp: summary(moves.map(({ sharp }) => sharp)),
    drop_to_painted: summary(drops.map(({ first }) => first)),
    drop_to_sharp: summary(drops.map(({ sharp }) => sharp)),
  };
}
