"use strict";
(() => {
  const FRAME_MS = 80;
  const get = (id) => document.getElementById(id);
  const methods = JSON.parse(get("films").textContent);
  const [play, slider, place, painting] = ["play", "frame", "place", "painting"].map(get);
  const sides = ["left", "right"].map((id) => ({
    choice: get(id),
    screen: get(id + "-screen"),
    frames: [],
  }));
  let timer = 0;

  // Decoded before they are shown: a picture that is still being decoded would flicker by itself.
  const loaded = new Map();
  const load = (address) => {
    if (!loaded.has(address)) {
      const image = new Image();
      image.src = address;
      loaded.set(address, image.decode().then(() => image));
    }
    return loaded.get(address);
  };

  const draw = () => {
    const at = Number(slider.value);
    place.textContent = `${at + 1} / ${Number(slider.max) + 1}`;
    for (const { screen, frames } of sides) {
      const image = frames[at];
      if (image) {
        screen.width = image.naturalWidth;
        screen.height = image.naturalHeight;
        screen.getContext("2d").drawImage(image, 0, 0);
      }
    }
  };

  const choose = async () => {
    const wanted = sides.map(({ choice }) => {
      const { films } = methods[Number(choice.value)];
      // What no painting changes has one film.
      return films[Number(painting.value)] ?? films[0] ?? [];
    });
    const frames = await Promise.all(wanted.map((film) => Promise.all(film.map(load))));
    sides.forEach((side, i) => { side.frames = frames[i]; });
    draw();
  };

  const stop = () => {
    clearInterval(timer);
    timer = 0;
    play.textContent = "Play";
  };
  const start = () => {
    play.textContent = "Pause";
    timer = setInterval(() => {
      slider.value = (Number(slider.value) + 1) % (Number(slider.max) + 1);
      draw();
    }, FRAME_MS);
  };

  play.addEventListener("click", () => (timer ? stop() : start()));
  slider.addEventListener("input", () => { stop(); draw(); });
  for (const element of [painting, ...sides.map(({ choice }) => choice)]) {
    element.addEventListener("change", choose);
  }

  // The address can name what to show, as in report.html#frame=7&left=0&right=2&painting=1.
  for (const [id, value] of new URLSearchParams(location.hash.slice(1))) {
    if (["frame", "left", "right", "painting"].includes(id)) get(id).value = value;
  }
  choose();
})();
