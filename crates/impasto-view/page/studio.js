// The studio: puts its parts together. docs/studio.md has what page and server say to each other.

import { get } from "./api.js";
import { Brush } from "./brush.js";
import { Camera } from "./camera.js";
import { CoatList } from "./coat-list.js";
import { Coats } from "./coats.js";
import { Controls } from "./controls.js";
import { at } from "./dom.js";
import { Favourites } from "./favourites.js";
import { Jobs } from "./jobs.js";
import { setUpKeys } from "./keys.js";
import { Marks } from "./marks.js";
import { guarded, say, warn } from "./notices.js";
import { Shelf } from "./paintings.js";
import { Pace } from "./pace.js";
import { setUpDetail, setUpHelp, setUpTabs, setUpTheme, toggleWide } from "./panel.js";
import { Paths } from "./paths.js";
import { Picker } from "./picker.js";
import { Places } from "./places.js";
import { Screen } from "./screen.js";
import { Socket } from "./socket.js";
import { States } from "./states.js";

const canvas = at("view");
const camera = new Camera();
const coats = new Coats();
const states = new States(() => socket.connect());
const shelf = new Shelf(coats);
const favourites = new Favourites(coats, shelf);
const send = (message) => (states.scene ? socket.send(message) : 0);
const picker = new Picker(send);
const pace = new Pace(camera, at("stage"), (message) => {
  const id = send(message);
  screen.expect({ view: id, still: !message.moving });
  return id;
});
const brush = new Brush(coats, (message) => {
  const id = send(message);
  if (id !== 0) screen.expect({ coats: id });
  return id;
});
const screen = new Screen(canvas, { acknowledge: (frame) => socket.acknowledge(frame), drawn });
const socket = new Socket({ opened, lost: (seconds) => states.lost(seconds), message, picture: (head, jpeg) => screen.receive(head, jpeg) });
const marks = new Marks(at("marks"), camera);

let tab = "paint";
let marking = 0;

// The camera is another, by whichever hand.
function moved() {
  paths.showLens();
  pace.moved();
  mark();
}

function mark() {
  cancelAnimationFrame(marking);
  marking = requestAnimationFrame(() => {
    const shown = !paths.playing;
    const mask = shown && tab === "paint" && coats.chosen?.on ? coats.chosen.mask : null;
    const keyframes = shown && tab === "path" ? paths.keyframes : [];
    marks.draw(mask, keyframes, at("path-closed").checked);
  });
}

const controls = new Controls(canvas, camera, {
  moved: () => {
    if (paths.playing) paths.stop();
    moved();
  },
  tapped: (x, y) => picker.take(x, y),
  focus: guarded(async (x, y) => {
    const { point } = await picker.pick(x, y);
    controls.go(camera.facing(point));
  }),
});
const paths = new Paths(camera, controls, moved);
const places = new Places(camera, controls, () => paths.stop());
const jobs = new Jobs(coats, paths);
new CoatList(coats, shelf, picker);

function drawn(head) {
  if (canvas.dataset.last === "1") pace.finished(head);
  const byView = pace.answered(head.view);
  const byCoats = brush.drawn(head.coats);
  const latency = byCoats ?? byView;
  if (latency !== null) {
    canvas.dataset.latency = latency.toFixed(1);
    at("fact-latency").textContent = `${Math.round(latency)} ms`;
  }
  at("fact-rate").textContent = `${screen.rate} a second`;
  at("fact-size").textContent = `${head.viewWidth} × ${head.viewHeight}`;
  at("fact-rays").textContent = head.rays >= 1e6
    ? `${(head.rays / 1e6).toFixed(1)} M a second` : `${Math.round(head.rays / 1e3)} k a second`;
  states.drawn();
}

function opened() {
  socket.watch(true);
  screen.forget();
  states.opened();
  load();
}

// Everything that the server knows, and then the first picture. Again after each connection.
const load = guarded(async () => {
  let scene;
  try {
    scene = await get("/api/scene");
  } catch (fault) {
    states.noScene(fault, await get("/api/run").catch(() => null));
    return;
  }
  show(scene);
  const rest = await Promise.allSettled([
    shelf.load(), jobs.load(), get("/api/run").then((run) => states.run(run)),
  ]);
  rest.push(...await Promise.allSettled([favourites.load()]));
  coats.dispatchEvent(new Event("shape"));
  const failed = rest.find(({ status }) => status === "rejected");
  if (failed) warn(failed.reason);
});

// Another model, or the same one again: the camera stays where it is once it has a place.
function show(scene) {
  const first = !states.scene;
  states.show(scene);
  paths.name = scene.name;
  camera.up = scene.up;
  camera.radius = scene.radius;
  places.show(scene, first);
  paths.showLens();
  brush.again();
  pace.rest();
  mark();
}

function message(told) {
  if (told.type === "painted") brush.painted(told.id);
  else if (told.type === "picked") picker.answered(told);
  else if (told.type === "run") states.run(told);
  else if (told.type === "model") {
    const first = !states.scene;
    show(told);
    if (first) load();
    else say("The model has learned more: this is its newest state.");
  } else if (told.type === "problem") {
    picker.answered(told);
    brush.painted(told.id);
    warn(new Error(told.message));
  }
}

coats.addEventListener("change", () => {
  at("compare").disabled = coats.json().length === 0;
  if (coats.json().length > 0) states.painted();
  mark();
});
coats.addEventListener("shape", mark);
paths.addEventListener("change", mark);

setUpTabs((name) => {
  tab = name;
  mark();
});
setUpTheme(() => states.redraw());
setUpHelp();
setUpDetail((widest) => {
  pace.chosen = widest;
  pace.rest();
});
setUpKeys({ controls, places, paths, coats, picker, brush, toggleWide });
at("wide").addEventListener("click", toggleWide);

// A new size is asked for when it has settled.
let resized = 0;
new ResizeObserver(() => {
  clearTimeout(resized);
  resized = setTimeout(() => {
    pace.rest();
    mark();
  }, 100);
}).observe(at("stage"));
setInterval(() => { at("fact-rate").textContent = `${screen.rate} a second`; }, 1000);

// The token is in a cookie by now, and need not stay in the address.
if (location.search.includes("token=")) history.replaceState(null, "", location.pathname);
socket.connect();
