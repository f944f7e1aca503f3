// Colours of the map. Crowds: lightness falls (on dark paper rises) with the crowd, and lines get wider,
// so that they can be told apart without seeing hues. Routes: blue and green with dashes of their own.

const PALETTES = {
  light: {
    paper: "#f6f5f1",
    crowds: ["#cbcfce", "#f0b54f", "#d3572b", "#7a1038"],
    label: "#3f4650",
    halo: "#f6f5f1",
    routes: ["#1d4ed8", "#0f766e", "#7c3aed", "#334155", "#0369a1", "#4d7c0f"],
    casing: "#ffffff",
    reach: ["#0b5c8f", "#2f86b8", "#7bb6d6"],
    reachText: ["#084469", "#0b5c8f", "#1f6f9f"],
    sensor: "#0f766e",
    walked: "#64748b",
  },
  dark: {
    paper: "#14181f",
    crowds: ["#3a4350", "#9a4f2c", "#f0883a", "#ffe9a8"],
    label: "#c4ccd6",
    halo: "#14181f",
    routes: ["#6ea8ff", "#4fd1b8", "#c4a1ff", "#e2e8f0", "#5cc8f5", "#b5d96c"],
    casing: "#0b0e13",
    reach: ["#8fd0f5", "#4c9ccb", "#2a6a91"],
    reachText: ["#c3e6fb", "#9bd4f6", "#7cc0ea"],
    sensor: "#4fd1b8",
    walked: "#8a97a8",
  },
};

export const DASHES = [
  [1, 0],
  [2.2, 1.2],
  [0.2, 1.5],
  [3.5, 1, 0.2, 1],
  [1.2, 1.2],
  [5, 1.5],
];

const media = matchMedia("(prefers-color-scheme: dark)");
const listeners = [];

/** "light" or "dark". */
export const theme = () => document.documentElement.dataset.theme ?? (media.matches ? "dark" : "light");

/** The colours of the theme. */
export const palette = () => PALETTES[theme()];

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
