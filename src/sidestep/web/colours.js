// Colours of the map, which base.css has, and the theme.

export const DASHES = [
  [1, 0],
  [2.2, 1.2],
  [1, 0.8],
  [3.5, 0.8, 1, 0.8],
  [5, 1.2],
  [3.5, 0.8, 1, 0.8, 1, 0.8],
];

const media = matchMedia("(prefers-color-scheme: dark)");
const listeners = [];

/** "light" or "dark". */
export const theme = () => document.documentElement.dataset.theme ?? (media.matches ? "dark" : "light");

/** The colours of the theme, as the map takes them. */
export function palette() {
  const probe = document.createElement("i");
  document.body.append(probe);
  const colour = (name) => {
    probe.style.color = `var(--${name})`;
    return getComputedStyle(probe).color;
  };
  const several = (name, count) => Array.from({ length: count }, (_, turn) => colour(`${name}-${turn}`));
  const found = {
    paper: colour("paper"),
    crowds: several("crowd", 4),
    label: colour("label"),
    routes: several("route", DASHES.length),
    casing: colour("casing"),
    reach: several("reach", 3),
    reachText: several("reach-text", 3),
    sensor: colour("good"),
    walked: colour("walked"),
  };
  probe.remove();
  return found;
}

/** Have a function called when the theme changes. */
export const onTheme = (listener) => listeners.push(listener);

function told() {
  for (const listener of listeners) listener();
}

/** Choose a theme; the system's own needs no remembering. */
export function chooseTheme(chosen) {
  const system = media.matches ? "dark" : "light";
  if (chosen === system) delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = chosen;
  try {
    if (chosen === system) localStorage.removeItem("sidestep-theme");
    else localStorage.setItem("sidestep-theme", chosen);
  } catch {
    // storage may be forbidden
  }
  told();
}

/** Begin with what was chosen before. */
export function startTheme() {
  try {
    const chosen = localStorage.getItem("sidestep-theme");
    if (chosen === "light" || chosen === "dark") document.documentElement.dataset.theme = chosen;
  } catch {
    // storage may be forbidden
  }
  media.addEventListener("change", told);
}
