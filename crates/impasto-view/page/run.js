// A model in training: stage, progress, loss, PSNR and the newest preview.

import { el } from "./dom.js";

const STAGES = { geometry: "Learning the geometry", style: "Learning to paint" };

// Loss over time, on a logarithmic scale as losses fall.
function drawLosses(canvas, losses) {
  const dense = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth || 280, canvas.clientHeight || 90];
  canvas.width = width * dense;
  canvas.height = height * dense;
  const paper = canvas.getContext("2d");
  paper.scale(dense, dense);
  const style = getComputedStyle(canvas);
  const points = losses.filter(([, loss]) => loss > 0 && Number.isFinite(loss));
  if (points.length < 2) return;
  const logs = points.map(([, loss]) => Math.log(loss));
  const [low, high] = [Math.min(...logs), Math.max(...logs)];
  const [begin, end] = [points[0][0], points.at(-1)[0]];
  const x = (seconds) => 2 + ((seconds - begin) / Math.max(end - begin, 1e-9)) * (width - 6);
  const y = (log) => 4 + ((high - log) / Math.max(high - low, 1e-9)) * (height - 10);
  paper.strokeStyle = style.getPropertyValue("--line");
  paper.beginPath();
  for (const part of [0, 0.5, 1]) {
    const level = Math.round(4 + part * (height - 10)) + 0.5;
    paper.moveTo(0, level);
    paper.lineTo(width, level);
  }
  paper.stroke();
  paper.strokeStyle = style.getPropertyValue("--accent");
  paper.lineWidth = 1.5;
  paper.lineJoin = "round";
  paper.beginPath();
  points.forEach(([seconds], i) => paper.lineTo(x(seconds), y(logs[i])));
  paper.stroke();
  paper.fillStyle = style.getPropertyValue("--accent");
  paper.beginPath();
  paper.arc(x(end), y(logs.at(-1)), 2.5, 0, 2 * Math.PI);
  paper.fill();
}

// One view of the run; the page has one in front of the picture and one in the panel.
export class RunView {
  constructor(place) {
    this.stage = el("p", { class: "stage" });
    this.bar = el("progress", { max: 1, "aria-label": "Training" });
    this.figures = el("dl", { class: "figures" });
    this.preview = el("img", { class: "preview", alt: "The newest preview of the training", hidden: true });
    this.curve = el("canvas", { class: "curve", role: "img", "aria-label": "Loss over time, falling" });
    place.append(this.preview, this.stage, this.bar, this.figures, this.curve);
  }

  show(run) {
    const { stage, step, progress, loss, psnr, preview, losses = [] } = run;
    this.stage.textContent = STAGES[stage] ?? stage ?? "Preparing";
    if (Number.isFinite(progress)) this.bar.value = progress;
    const figures = [
      ["Progress", Number.isFinite(progress) ? `${Math.floor(progress * 100)} %` : null],
      ["Step", Number.isFinite(step) ? step.toLocaleString("en") : null],
      ["PSNR", Number.isFinite(psnr) ? `${psnr.toFixed(1)} dB` : null],
      ["Loss", Number.isFinite(loss) ? Number(loss.toPrecision(3)).toString() : null],
    ].filter(([, value]) => value !== null);
    this.figures.replaceChildren(...figures.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))));
    if (preview && this.preview.getAttribute("src") !== preview) this.preview.src = preview;
    this.preview.hidden = !preview;
    const [first, last] = [losses[0]?.[1], losses.at(-1)?.[1]];
    this.curve.hidden = losses.length < 2;
    if (!this.curve.hidden) {
      this.curve.setAttribute("aria-label", `Loss over time, from ${first.toPrecision(2)} to ${last.toPrecision(2)}`);
      drawLosses(this.curve, losses);
    }
  }
}
