"use strict";
(() => {
  const at = (id) => document.getElementById(id);
  const study = JSON.parse(at("study").textContent);
  const QUESTIONS = ["match", "flicker"];
  const [width, height] = study.size;
  const pace = 1000 / study.rate;

  const random = (below) => {
    const bits = crypto.getRandomValues(new Uint32Array(1))[0];
    return Math.floor((bits / 2 ** 32) * below);
  };
  const order = study.questions.map((_, i) => i);
  for (let i = order.length - 1; i > 0; i--) {
    const j = random(i + 1);
    [order[i], order[j]] = [order[j], order[i]];
  }
  const bytes = crypto.getRandomValues(new Uint8Array(8));
  const participant = Array.from(bytes, (b) => b.toString(16).padStart(2, "0")).join("");
  const given = [];

  // What is on the screen: the pair's frames, where its clips stand, and what was answered.
  let pair = null;

  const show = (id) => {
    for (const section of document.querySelectorAll("section")) {
      section.hidden = section.id !== id;
    }
    at(id).focus({ preventScroll: true });
    window.scrollTo(0, 0);
  };

  const decode = (urls) => Promise.all(urls.map((url) => {
    const image = new Image();
    image.src = url;
    return image.decode().then(() => image);
  }));

  const draw = () => {
    for (const side of ["a", "b"]) {
      at(side).getContext("2d").drawImage(pair.frames[side][pair.frame], 0, 0);
    }
  };

  // Both clips show the same frame. A late tick shows the next frame and skips none, so that what
  // has played has been seen.
  const play = (mine) => {
    const tick = (now) => {
      if (pair !== mine) return;
      requestAnimationFrame(tick);
      if (pair.paused || now - pair.drawn < pace) return;
      pair.drawn = Math.max(pair.drawn + pace, now - pace);
      const last = pair.frames.a.length - 1;
      const next = pair.frame + pair.step;
      if (next < 0 || next > last) pair.step = -pair.step;
      pair.frame += pair.step;
      draw();
      if (pair.frame === last && !pair.played) {
        pair.played = true;
        update();
      }
    };
    requestAnimationFrame(tick);
  };

  const update = () => {
    const open = QUESTIONS.findIndex((q) => !pair.replies[q]);
    pair.active = pair.back ?? open;
    QUESTIONS.forEach((question, i) => {
      const reply = pair.replies[question];
      at(question).classList.toggle("active", pair.played && pair.active === i);
      for (const button of at(question).querySelectorAll("button")) {
        button.disabled = !pair.played;
        button.setAttribute("aria-pressed", String(reply?.choice === button.value));
      }
    });
    at("next").disabled = open >= 0;
    at("pause").textContent = pair.paused ? "Play" : "Pause";
    at("status").textContent = pair.played
      ? "Watch as long as you like." : "You can answer when both clips have played once.";
  };

  const answer = (question, choice) => {
    if (!pair?.played) return;
    const seconds = Math.round((performance.now() - pair.shown) / 10) / 100;
    pair.replies[question] = { choice, seconds };
    pair.back = null;
    update();
  };

  const pause = () => {
    pair.paused = !pair.paused;
    update();
  };

  const present = async () => {
    const number = given.length;
    const question = study.questions[order[number]];
    pair = null;
    at("next").disabled = true;
    const [a, b] = await Promise.all([decode(question.a), decode(question.b)]);
    at("place").textContent = `Pair ${number + 1} of ${order.length}`;
    at("progress").max = order.length;
    at("progress").value = number;
    at("next").textContent = number + 1 < order.length ? "Next pair" : "Finish";
    at("painting").src = question.painting;
    for (const side of ["a", "b"]) {
      at(side).width = width;
      at(side).height = height;
    }
    pair = {
      id: question.id, frames: { a, b }, frame: 0, step: 1, drawn: performance.now(),
      shown: performance.now(), played: false, paused: false, replies: {}, active: 0, back: null,
    };
    show("trial");
    draw();
    update();
    play(pair);
  };

  const forward = () => {
    if (!pair || QUESTIONS.some((q) => !pair.replies[q])) return;
    const { match, flicker } = pair.replies;
    given.push({ question: pair.id, match, flicker });
    if (given.length < order.length) present().catch(fault);
    else finish();
  };

  const finish = () => {
    pair = null;
    const file = { schema: study.schema, study: study.study, participant, answers: given };
    at("answers").value = JSON.stringify(file, null, 1);
    show("end");
  };

  let saved = false;
  const save = () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([at("answers").value], { type: "application/json" }));
    link.download = `answers-${participant}.json`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    saved = true;
  };

  const copy = async () => {
    at("answers").select();
    try {
      await navigator.clipboard.writeText(at("answers").value);
      at("copied").textContent = "Copied.";
      saved = true;
    } catch {
      at("copied").textContent = "Selected: copy it with Ctrl+C or the menu.";
    }
  };

  const fault = () => {
    show("fault");
    at("fault").hidden = false;
    at("fault").textContent = "A clip of this page cannot be shown. Please ask for the page again.";
  };

  const KEYS = {
    1: "a", ArrowLeft: "a", 2: "b", ArrowRight: "b", 3: "neither", ArrowDown: "neither",
  };
  document.addEventListener("keydown", (event) => {
    if (!pair || event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
    const choice = KEYS[event.key];
    if (choice && pair.active >= 0) answer(QUESTIONS[pair.active], choice);
    else if (event.key === "ArrowUp") {
      pair.back = pair.active < 0 ? 1 : 0;
      update();
    } else if (event.key === "Enter" && !at("next").disabled) forward();
    else if (event.key === "p" || event.key === "P") pause();
    else return;
    event.preventDefault();
  });
  window.addEventListener("beforeunload", (event) => {
    if (given.length > 0 && !saved) event.preventDefault();
  });
  for (const question of QUESTIONS) {
    at(question).addEventListener("click", (event) => {
      const button = event.target.closest("button");
      if (button) answer(question, button.value);
    });
  }
  at("pause").addEventListener("click", pause);
  at("next").addEventListener("click", forward);
  at("save").addEventListener("click", save);
  at("copy").addEventListener("click", copy);
  at("begin").addEventListener("click", () => {
    at("begin").disabled = true;
    present().catch(fault);
  });

  const played = (2 * (study.questions[0].a.length - 1)) / study.rate;
  const minutes = Math.max(1, Math.round((order.length * (played + 8)) / 60));
  at("count").textContent = order.length;
  at("minutes").textContent = minutes === 1 ? "a minute" : `${minutes} minutes`;
  at("synthetic").hidden = !study.synthetic;
  at("pictures").classList.toggle("wide", width > height);
  at("begin").disabled = false;
})();
