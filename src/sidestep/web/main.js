// Puts the page together.

import { get } from "./api.js";
import { chooseTheme, onTheme, startTheme, theme } from "./colours.js";
import { startCounts } from "./counts.js";
import { showCrowds, startCrowds } from "./crowds.js";
import { byId, complain, forgive, toast } from "./dom.js";
import { startLeave } from "./leave.js";
import { goTo, loadMap, map, startMap } from "./map.js";
import { startPlaces } from "./places.js";
import { startReach } from "./reach.js";
import { replan, startRoutes } from "./routes.js";
import { startSheet } from "./sheet.js";
import { change, onChange, readLink, state, TABS, writeLink } from "./state.js";
import { startTime } from "./time.js";
import { startWalk } from "./walk.js";

function startTabs() {
  const show = () => {
    for (const name of TABS) {
      const on = name === state.tab;
      byId(`tab-${name}`).setAttribute("aria-selected", String(on));
      byId(`tab-${name}`).tabIndex = on ? 0 : -1;
      byId(`panel-${name}`).hidden = !on;
    }
  };
  for (const name of TABS) {
    byId(`tab-${name}`).addEventListener("click", () => change({ tab: name }));
    byId(`tab-${name}`).addEventListener("keydown", (event) => {
      const at = TABS.indexOf(name);
      const next = { ArrowRight: at + 1, ArrowLeft: at - 1 + TABS.length, Home: 0, End: TABS.length - 1 }[event.key];
      if (next === undefined) return;
      event.preventDefault();
      change({ tab: TABS[next % TABS.length] });
      byId(`tab-${state.tab}`).focus();
    });
  }
  onChange((changed) => changed.has("tab") && show());
  show();
}

function startButtons() {
  const says = () => {
    const dark = theme() === "dark";
    byId("theme").setAttribute("aria-pressed", String(dark));
  };
  byId("theme").addEventListener("click", () => chooseTheme(theme() === "dark" ? "light" : "dark"));
  onTheme(says);
  says();
  byId("alert-close").addEventListener("click", forgive);
  byId("share").addEventListener("click", async () => {
    const link = new URL(writeLink(), document.baseURI).href;
    history.replaceState(null, "", writeLink());
    try {
      await navigator.clipboard.writeText(link);
      toast("The link to this view is on the clipboard.");
    } catch {
      toast("The address of this page holds this view.");
    }
  });
}

function showTown(town) {
  byId("town").textContent = town.name;
  byId("town").title = town.summary ?? "";
  document.title = `Sidestep: ${town.name}`;
  byId("credit").textContent = town.attribution;
  byId("attribution").textContent = `Streets: ${town.attribution}. Crowds: ${town.crowds}.`;
  byId("synthetic").textContent = `Synthetic: ${town.synthetic}.`;
  byId("synthetic").hidden = !town.synthetic;
}

async function start() {
  startTheme();
  startButtons();
  startSheet();
  performance.mark("asked");
  const library = loadMap();
  library.catch(() => {}); // said where it is awaited
  const geometry = get("streets").catch((error) => {
    complain("streets", error.message);
    return { type: "FeatureCollection", features: [] };
  });
  let town;
  try {
    town = await get("town");
  } catch (error) {
    complain("town", error.message);
    return;
  }
  town.name ??= town.scenario.charAt(0).toUpperCase() + town.scenario.slice(1);
  showTown(town);
  if (!town.timed) document.documentElement.dataset.timed = "no"; // there is nothing but the start to choose
  const followed = () => {
    const { found, wrong } = readLink(location.hash, town);
    const said = wrong.map((pair) => pair.join("=").slice(0, 60)).join(", ");
    complain("link", said === "" ? null : `These parts of the link make no sense here and are left out: ${said}.`);
    return found;
  };
  Object.assign(state, followed());
  startTabs();
  startCrowds(town);
  const time = await startTime(town);
  startPlaces(town);
  startRoutes(town, geometry);
  startLeave();
  startReach();
  startWalk();
  performance.mark("usable");
  const streets = await geometry;
  const metres = [];
  for (const { properties } of streets.features) metres[properties.street] = properties.metres;
  startCounts(town, streets.features, replan);
  showCrowds();
  addEventListener("hashchange", () => {
    const link = followed();
    goTo(link.camera);
    change(link);
  });
  await startMap(town, streets, library);
  performance.mark("drawn");
  time.withStreets(metres);
  // For programs that look at the page: tests, the console.
  globalThis.sidestep = { map, state };
}

start();
