// Style statistics, in the page: put there by `addInitScript`, which sees nothing outside of it.

export function statistics() {
  const BINS = 16;

  // Mean and covariance of RGB, from 0 to 1, and how often gradients of lightness have which size.
  const describe = (pixels, width, height) => {
    const count = width * height;
    const mean = [0, 0, 0];
    for (let i = 0; i < count; i++) {
      for (let c = 0; c < 3; c++) mean[c] += pixels[4 * i + c] / 255 / count;
    }
    const covariance = Array(9).fill(0);
    for (let i = 0; i < count; i++) {
      for (let a = 0; a < 3; a++) {
        for (let b = 0; b < 3; b++) {
          const product = (pixels[4 * i + a] / 255 - mean[a]) * (pixels[4 * i + b] / 255 - mean[b]);
          covariance[3 * a + b] += product / count;
        }
      }
    }
    const light = (x, y) => {
      const i = 4 * (y * width + x);
      return (0.299 * pixels[i] + 0.587 * pixels[i + 1] + 0.114 * pixels[i + 2]) / 255;
    };
    const gradients = Array(BINS).fill(0);
    const inner = (width - 1) * (height - 1);
    for (let y = 0; y + 1 < height; y++) {
      for (let x = 0; x + 1 < width; x++) {
        const size = Math.hypot(light(x + 1, y) - light(x, y), light(x, y + 1) - light(x, y));
        gradients[Math.min(BINS - 1, Math.floor(size * 4 * BINS))] += 1 / inner;
      }
    }
    return { mean, covariance, gradients };
  };

  const norm = (a, b) => Math.hypot(...a.map((v, i) => v - b[i]));

  window.studioTest = {
    // The canvas as it is: size, pixels and statistics stay in the page, under a name.
    kept: {},
    keep(name) {
      const canvas = document.getElementById("view");
      const { width, height } = canvas;
      const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
      this.kept[name] = { width, height, data, ...describe(data, width, height) };
      return { width, height, colours: new Set(new Uint32Array(data.buffer)).size };
    },
    // A painting from its bytes, as large as the canvas is wide, so that gradients compare.
    async painting(name, base64) {
      const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
      const bitmap = await createImageBitmap(new Blob([bytes]));
      const scale = document.getElementById("view").width / Math.max(bitmap.width, bitmap.height);
      const [width, height] = [bitmap.width, bitmap.height].map((v) => Math.max(2, Math.round(v * scale)));
      const canvas = new OffscreenCanvas(width, height);
      const paper = canvas.getContext("2d");
      paper.drawImage(bitmap, 0, 0, width, height);
      this.kept[name] = describe(paper.getImageData(0, 0, width, height).data, width, height);
    },
    // Of two kept things: colours by mean and by covariance (its root, so that both are colours).
    style(a, b) {
      const [one, other] = [this.kept[a], this.kept[b]];
      const mean = norm(one.mean, other.mean);
      const covariance = Math.sqrt(norm(one.covariance, other.covariance));
      return {
        mean, covariance, colour: Math.hypot(mean, covariance),
        gradients: norm(one.gradients, other.gradients),
      };
    },
    // Mean difference of two kept pictures, in 1/255, and of their colours without lightness.
    difference(a, b) {
      const [one, other] = [this.kept[a].data, this.kept[b].data];
      if (one.length !== other.length) throw new Error(`${a} and ${b} differ in size`);
      let [all, chroma] = [0, 0];
      for (let i = 0; i < one.length; i += 4) {
        const d = [0, 1, 2].map((c) => one[i + c] - other[i + c]);
        all += Math.abs(d[0]) + Math.abs(d[1]) + Math.abs(d[2]);
        chroma += Math.abs(-0.1687 * d[0] - 0.3313 * d[1] + 0.5 * d[2])
          + Math.abs(0.5 * d[0] - 0.4187 * d[1] - 0.0813 * d[2]);
      }
      return { mean: all / (one.length / 4) / 3, chroma: chroma / (one.length / 4) / 2 };
    },
  };
}
