// The panel around the tools: tabs, dark and light, help, and the picture alone.

import { at } from "./dom.js";

const THEME = "impasto-theme";

// A browser may forbid to keep anything; then nothing is kept.
const kept = (name) => {
  try {
    return localStorage.getItem(name);
  } catch {
    return null;
  }
};
const keep = (name, value) => {
  try {
    localStorage.setItem(name, value);
  } catch {
    // See above.
  }
};

export function setUpTabs(changed) {
  const tabs = [...at("tabs").querySelectorAll("[role=tab]")];
  const select = (tab, focus) => {
    for (const other of tabs) {
      const chosen = other === tab;
      other.setAttribute("aria-selected", String(chosen));
      other.tabIndex = chosen ? 0 : -1;
      at(other.getAttribute("aria-controls")).hidden = !chosen;
    }
    if (focus) tab.focus();
    changed(tab.getAttribute("aria-controls"));
  };
  for (const tab of tabs) tab.addEventListener("click", () => select(tab, false));
  at("tabs").addEventListener("keydown", (event) => {
    const shown = tabs.filter((tab) => !tab.hidden);
    const here = shown.findIndex((tab) => tab.getAttribute("aria-selected") === "true");
    const to = {
      ArrowLeft: here - 1, ArrowRight: here + 1, Home: 0, End: shown.length - 1,
    }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    select(shown[(to + shown.length) % shown.length], true);
  });
}

// The system's scheme until the button is pressed.
export function setUpTheme(changed) {
  const system = matchMedia("(prefers-color-scheme: dark)");
  const dark = () => (kept(THEME) ?? (system.matches ? "dark" : "light")) === "dark";
  const show = () => {
    document.documentElement.dataset.theme = dark() ? "dark" : "light";
    at("theme").setAttribute("aria-label", dark() ? "Light colours" : "Dark colours");
    at("theme").title = dark() ? "Light colours" : "Dark colours";
    changed();
  };
  at("theme").addEventListener("click", () => {
    const wanted = dark() ? "light" : "dark";
    keep(THEME, wanted);
    document.documentElement.dataset.theme = wanted;
    show();
  });
  system.addEventListener("change", show);
  show();
}

export function setUpHelp() {
  at("help-open").addEventListener("click", () => at("help").showModal());
  at("help-close").addEventListener("click", () => at("help").close());
  at("help").addEventListener("click", (event) => {
    if (event.target === at("help")) at("help").close();
  });
}

export function toggleWide() {
  const wide = document.body.classList.toggle("wide");
  at("wide").setAttribute("aria-pressed", String(wide));
  const label = wide ? "Show the controls" : "Picture only";
  at("wide").setAttribute("aria-label", label);
  at("wide").title = `${label} (P)`;
}

// How wide the finest picture may be, 0 for as wide as is quick.
export function setUpDetail(changed) {
  const name = "impasto-detail";
  const old = kept(name);
  if ([...at("detail").options].some(({ value }) => value === old)) at("detail").value = old;
  const tell = () => changed(Number(at("detail").value));
  at("detail").addEventListener("change", () => {
    keep(name, at("detail").value);
    tell();
  });
  tell();
}
