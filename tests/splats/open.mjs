// Opens splats in a viewer that is not ours, in headless Chromium, and looks at what it draws.
//
//   node open.mjs FILE.ply camera.json CHROMIUM SCREENSHOT.png

import { createReadStream, existsSync, readFileSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join, normalize } from "node:path";
import { chromium } from "playwright-core";

const [ply, camera, executablePath, screenshot] = process.argv.slice(2);
const here = import.meta.dirname;
const modules = join(here, "node_modules");
const types = { ".html": "text/html", ".js": "text/javascript", ".json": "application/json" };

const fileOf = (path) => {
  if (path === "/") return join(here, "page.html");
  if (path === "/splats.ply") return ply;
  if (path === "/camera.json") return camera;
  return path.startsWith("/node_modules/") ? join(modules, path.slice("/node_modules".length)) : null;
};
const server = createServer((request, response) => {
  const file = fileOf(normalize(new URL(request.url, "http://127.0.0.1").pathname));
  if (!file || !existsSync(file)) return response.writeHead(404).end();
  response.writeHead(200, { "content-type": types[extname(file)] ?? "application/octet-stream" });
  createReadStream(file).pipe(response);
});
await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));

const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});
const problems = [];
try {
  const { width, height } = JSON.parse(readFileSync(camera, "utf8"));
  const page = await browser.newPage({ viewport: { width, height } });
  page.on("pageerror", (error) => problems.push(String(error)));
  page.on("console", (line) => line.type() === "error" && !/favicon/.test(line.location().url) && problems.push(line.text()));
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  await page.waitForFunction("document.title === 'ready'", null, { timeout: 90_000 }).catch((error) => problems.push(String(error)));
  const count = await page.evaluate("window.splats?.() ?? 0");
  // The viewer sorts and fades in over some frames.
  await page.waitForTimeout(8000);
  const picture = await page.screenshot({ path: screenshot });
  // The screenshot's own pixels: how many differ from the page's black, and how many shades there are.
  const seen = await page.evaluate(async (base64) => {
    const image = new Image();
    image.src = `data:image/png;base64,${base64}`;
    await image.decode();
    const canvas = new OffscreenCanvas(image.width, image.height);
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, image.width, image.height);
    const shades = new Set();
    let filled = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (data[i] + data[i + 1] + data[i + 2] > 24) filled += 1;
      shades.add((data[i] >> 4) * 256 + (data[i + 1] >> 4) * 16 + (data[i + 2] >> 4));
    }
    return { filled: filled / (data.length / 4), shades: shades.size };
  }, picture.toString("base64"));
  if (count === 0) problems.push("the viewer holds no splats");
  if (seen.filled < 0.5) problems.push(`only ${(100 * seen.filled).toFixed(0)} % of the picture is filled`);
  if (seen.shades < 40) problems.push(`the picture has only ${seen.shades} shades`);
  console.log(`splats: the viewer shows ${count}, ${(100 * seen.filled).toFixed(0)} % of the picture filled, ${seen.shades} shades`);
} finally {
  await browser.close();
  server.close();
}
for (const problem of problems) console.error(`splats: ${problem}`);
process.exit(problems.length ? 1 : 0);
