// The studio in a real browser: every step is judged by the pixels of the canvas.
//
//   node e2e.mjs ADDRESS STYLES OUT
//
// Screenshots go to OUT, what is measured to stdout as one JSON object, steps to stderr.

import assert from "node:assert/strict";
import { readdir, readFile } from "node:fs/promises";
import { join } from "node:path";
import { Hands } from "./hands.js";
import { latencies } from "./latency.js";

const [address, styles, out] = process.argv.slice(2);
const DESK = { viewport: { width: 1280, height: 720 }, colorScheme: "light" };
const PHONE = {
  viewport: { width: 390, height: 844 }, colorScheme: "dark", hasTouch: true, isMobile: true,
};
// Mean differences of JPEGs, in 1/255.
const SEEN = 2;
const NOISE = 2;

const step = (text) => process.stderr.write(`studio: ${text}\n`);
const round = (value) => Math.round(value * 1000) / 1000;

const files = (await readdir(styles)).filter((name) => /\.(jpe?g|png)$/i.test(name)).sort()
  .slice(0, 24).map((name) => join(styles, name));
assert.ok(files.length >= 2, `${styles} has fewer than two paintings`);

const hands = await Hands.open(address, out, DESK);
const { page } = hands;
const strength = page.getByLabel("Strength");
const where = page.locator(".coat.open .mask select");
const report = {};

// How far in colour and gradients a kept picture is from a painting.
const distance = async (picture, painting) => {
  const { colour, gradients } = await hands.style(picture, painting);
  return { colour: round(colour), gradients: round(gradients) };
};

try {
  step("open");
  // Of a modest size, so that two cores render it in a moment.
  await page.evaluate(() => localStorage.setItem("impasto-detail", "640"));
  await page.reload();
  const first = await hands.keep("open");
  assert.ok(first.colours > 500, `the first picture has ${first.colours} colours`);

  step("drag to orbit");
  await hands.drag(110, 25);
  await hands.keep("photo");
  const orbited = await hands.difference("open", "photo");
  assert.ok(orbited.mean > SEEN, `the drag changed ${orbited.mean}/255`);

  // The painting whose colours are furthest from the scene's shows best that they moved, and the
  // second one is the furthest from the first.
  for (const file of files) await hands.painting(file);
  const furthest = async (from, among) => {
    const far = await Promise.all(among.map(async (file) => (await hands.style(from, file)).colour));
    return among[far.indexOf(Math.max(...far))];
  };
  const one = await furthest("photo", files);
  const two = await furthest(one, files.filter((file) => file !== one));

  step(`drop ${one}`);
  await hands.dropPainting(one);
  await hands.keep("painted");
  const painted = await hands.difference("photo", "painted");
  const [before, after] = [await distance("photo", one), await distance("painted", one)];
  report.drop = { change: round(painted.mean), before, after };
  assert.ok(painted.mean > SEEN, `the painting changed ${painted.mean}/255`);
  assert.ok(after.colour < before.colour, `colours moved from ${before.colour} to ${after.colour} of the painting's`);

  step(`mix with ${two}`);
  await hands.dropPainting(two, { shift: true });
  await hands.keep("mixed");
  const shares = await page.locator(".mixture output").allTextContents();
  assert.deepEqual(shares, ["50 %", "50 %"]);
  const mixed = await hands.difference("painted", "mixed");
  const [away, towards] = [await distance("painted", two), await distance("mixed", two)];
  report.mix = { change: round(mixed.mean), before: away, after: towards };
  assert.ok(mixed.mean > SEEN, `the second painting changed ${mixed.mean}/255`);
  assert.ok(towards.colour < away.colour, `colours moved from ${away.colour} to ${towards.colour} of the second painting's`);

  step("strength 0.5");
  await strength.fill("0.5");
  await hands.keep("half");
  const whole = (await hands.difference("photo", "mixed")).mean;
  const [toPhoto, toFull] = [(await hands.difference("half", "photo")).mean, (await hands.difference("half", "mixed")).mean];
  report.half = { whole: round(whole), to_photo: round(toPhoto), to_full: round(toFull) };
  assert.ok(toPhoto < whole && toFull < whole, `half strength is ${toPhoto} from the photo's look and ${toFull} from the paint, these ${whole} from each other`);
  await strength.fill("1");

  step("keep the scene's colours");
  await page.getByLabel("Scene’s").check();
  await hands.keep("luminance");
  const chroma = [await hands.difference("mixed", "photo"), await hands.difference("luminance", "photo")]
    .map((found) => round(found.chroma));
  report.luminance = { chroma_before: chroma[0], chroma_after: chroma[1] };
  assert.ok(chroma[1] < chroma[0], `chroma went from ${chroma[0]} to ${chroma[1]} of the scene's`);
  await page.getByLabel("Painting’s").check();

  step("strength 0");
  await strength.fill("0");
  await hands.keep("nothing");
  const nothing = (await hands.difference("nothing", "photo")).mean;
  report.nothing = round(nothing);
  assert.ok(nothing < NOISE, `strength 0 is ${nothing}/255 from the photo's look`);
  await strength.fill("1");
  await hands.settled();

  step("a sphere, and everything but that");
  await where.selectOption("sphere");
  await page.getByRole("button", { name: "Put it at a point…" }).click();
  await page.locator("#view").click();
  await page.locator("#aim").waitFor({ state: "hidden" });
  await page.getByLabel("Radius").fill("0.2");
  await hands.keep("sphere");
  await page.getByLabel("Everything but that").check();
  await hands.keep("outside");
  const [inside, outside] = [(await hands.difference("sphere", "photo")).mean, (await hands.difference("outside", "photo")).mean];
  report.sphere = { inside: round(inside), outside: round(outside), whole: round(whole) };
  assert.ok(inside > 0.1 && outside > 0.1, `the sphere's paint changed ${inside}/255, the rest's ${outside}/255`);
  assert.ok(Math.abs(inside + outside - whole) < 2 * NOISE, `${inside} inside and ${outside} outside are not ${whole}`);
  await where.selectOption("everywhere");
  await hands.settled();

  step("a favourite");
  await page.getByLabel("Name of the favourite").fill("Dusk and dawn 2");
  await page.locator("#favourite-save").click();
  const favourite = page.getByRole("button", { name: "Dusk and dawn 2", exact: true });
  await favourite.waitFor();
  await page.getByRole("button", { name: "Remove coat 1" }).click();
  await hands.keep("bare");
  assert.ok((await hands.difference("bare", "photo")).mean < NOISE, "without a coat it is as photographed");
  await favourite.click();
  await hands.keep("favourite");
  assert.ok((await hands.difference("favourite", "mixed")).mean < NOISE, "the favourite is what was saved");
  await page.getByRole("button", { name: "Delete Dusk and dawn 2" }).click();
  await favourite.waitFor({ state: "detached" });

  step("a file that is no picture");
  assert.deepEqual(hands.faults, []);
  const coats = await page.locator("#view").getAttribute("data-coats");
  await hands.drop("not a picture", "letter.jpg");
  const alert = page.getByRole("alert").filter({ hasText: "letter.jpg" });
  await alert.waitFor();
  report.refusal = (await alert.innerText()).trim();
  await hands.keep("refused");
  assert.equal(await page.locator("#view").getAttribute("data-coats"), coats);
  // The browser itself reports the refused request; nothing else may be wrong.
  assert.ok(hands.faults.every((fault) => fault.startsWith("Failed to load resource")), hands.faults.join("; "));
  hands.faults.length = 0;

  step("three keyframes and their preview");
  await page.getByRole("tab", { name: "Camera" }).click();
  for (const by of [[-60, 0], [-60, 10], [-60, -10]]) {
    await hands.drag(...by);
    await hands.settled();
    await page.getByRole("button", { name: "Add a keyframe here" }).click();
  }
  assert.equal(await page.locator("#keyframes li").count(), 3);
  await hands.keep("keyframes");
  await page.getByLabel("Seconds").fill("1");
  await page.getByLabel("Frames a second").fill("8");
  await page.getByRole("button", { name: "Preview" }).click();
  await page.getByRole("button", { name: "Stop" }).waitFor();
  await page.getByRole("button", { name: "Preview" }).waitFor();
  await hands.keep("end of the preview");
  assert.ok((await hands.difference("keyframes", "end of the preview")).mean < NOISE, "the preview ends at the last keyframe");
  const [path] = await Promise.all([
    page.waitForEvent("download"), page.getByRole("button", { name: "Download the path" }).click(),
  ]);
  const { camera_path: frames } = JSON.parse(await readFile(await path.path(), "utf8"));
  assert.equal(frames.length, 8);

  step("a film");
  await page.getByRole("tab", { name: "Take away" }).click();
  await page.locator("#film-format").selectOption("gif");
  await page.locator("#film-size").selectOption({ label: "Other" });
  await page.getByLabel("Width").fill("160");
  await page.getByLabel("Height").fill("90");
  await page.getByRole("button", { name: "Record the film" }).click();
  const link = page.getByRole("link", { name: "Download" });
  await link.waitFor({ timeout: 180000 });
  const [film] = await Promise.all([page.waitForEvent("download"), link.click()]);
  const gif = await readFile(await film.path());
  report.film = { bytes: gif.length };
  assert.ok(gif.length > 1000 && gif.subarray(0, 4).toString() === "GIF8", `the film has ${gif.length} bytes`);
  await hands.shot("film");

  step("on a phone, in the dark, by touch");
  await hands.turn(PHONE);
  await hands.keep("phone");
  await hands.page.locator(".painting").first().tap();
  await hands.keep("phone painted");
  assert.ok((await hands.difference("phone", "phone painted")).mean > SEEN, "a tap on a painting paints");

  step("latency");
  report.latency_ms = await latencies(hands, files);

  assert.deepEqual(hands.faults, []);
  const elsewhere = hands.requests.filter((url) => !/^(blob:|data:)/.test(url) && new URL(url).hostname !== "127.0.0.1");
  assert.deepEqual(elsewhere, [], "requests that left this machine");
  report.requests = hands.requests.length;
  process.stdout.write(`${JSON.stringify(report)}\n`);
  step(`passed; ${hands.shots} screenshots in ${out}`);
} catch (fault) {
  await hands.shot("failed").catch(() => {});
  step(`failed: ${fault.message}`);
  process.stdout.write(`${JSON.stringify({ ...report, failed: fault.message })}\n`);
  process.exitCode = 1;
} finally {
  await hands.browser.close();
}
