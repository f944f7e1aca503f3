// What is counted, as it arrives; and where it is crowded at the chosen time.

import { get, listen } from "./api.js";
import { crowding, exact, onCrowds, refreshCrowds, shown } from "./crowds.js";
import { byId, coloured, make, settled, toast } from "./dom.js";
import { flash, paint } from "./map.js";
import { onChange, state } from "./state.js";
import { now, setClock, setCounted } from "./time.js";

const LISTED = 10;
let town = null;
let streets = [];
let sensors = [];
const lately = new Set();

const number = (value) => (Number.isFinite(value) ? Math.round(value).toLocaleString("en") : "–");
const when = (text) => /T(\d\d:\d\d)/.exec(text ?? "")?.[1] ?? "–";

const said = ({ count, counted_from: from }) => `${count} ${from}`;

function paintSensors() {
  const seen = sensors.filter(({ properties }) => state.tab === "crowds" || properties.count !== null);
  paint("sensors", seen);
  byId("mark-sensor").hidden = seen.length === 0;
}

function showSensors() {
  byId("sensors-body").replaceChildren(
    ...sensors.map(({ properties }) =>
      make(
        "tr",
        { class: lately.has(properties.sensor) ? "picked" : null },
        make("th", { scope: "row", text: properties.sensor }),
        make("td", { text: number(properties.count ?? NaN) }),
        make("td", { text: number(properties.expected ?? NaN) }),
        make("td", { text: when(properties.counted_from) }),
      ),
    ),
  );
  byId("sensors").hidden = sensors.length === 0;
  paintSensors();
}

/** Ask what was counted latest, and find out which sensors say something else than before. */
async function readSensors() {
  const before = new Map(sensors.map(({ properties }) => [properties.sensor, said(properties)]));
  try {
    sensors = (await get("sensors")).features ?? [];
  } catch {
    sensors = []; // the town may have none
  }
  setCounted(sensors.some(({ properties }) => properties.count !== null));
  showSensors();
  if (before.size === 0) return [];
  return sensors
    .map(({ properties }) => properties)
    .filter((properties) => properties.count !== null && before.get(properties.sensor) !== said(properties));
}

function showStreets() {
  byId("streets").setAttribute("aria-busy", String(!exact));
  if (!exact || state.tab !== "crowds") return; // numbers of another time are none of this
  const metres = [0, 0, 0, 0];
  const named = new Map();
  for (const { properties } of streets) {
    const density = shown.density[properties.street] ?? 0;
    metres[crowding(density)] += properties.metres;
    const { name } = properties;
    if (name && density > (named.get(name) ?? 0)) named.set(name, density);
  }
  const all = metres.reduce((sum, value) => sum + value, 0) || 1;
  byId("shares").replaceChildren(
    ...town.crowding.map(({ word }, turn) => {
      const share = (100 * metres[turn]) / all;
      const bar = coloured(make("span", { class: "bar" }), `crowd-${turn}`);
      bar.style.setProperty("--share", `${share}%`);
      return make(
        "li",
        {},
        make("span", { text: word }),
        make("span", { class: "track" }, bar),
        make("span", { class: "figure", text: `${share.toFixed(share < 10 ? 1 : 0)} %` }),
      );
    }),
  );
  const densest = [...named].sort((one, other) => other[1] - one[1]).slice(0, LISTED);
  byId("densest-body").replaceChildren(
    ...densest.map(([name, density]) =>
      make(
        "tr",
        {},
        make("th", { scope: "row", text: name }),
        make("td", { text: town.crowding[crowding(density)].word }),
        make("td", { text: density.toFixed(1) }),
      ),
    ),
  );
}

/** Crowds are others than before: since something was counted, or since time has passed. */
const arrived = settled(200, async () => {
  const changed = await readSensors();
  if (changed.length === 0) return;
  for (const { sensor } of changed) {
    lately.add(sensor);
    flash(sensor);
  }
  showSensors();
  const [first] = changed;
  const more = changed.length > 1 ? `, and ${changed.length - 1} more` : "";
  toast(`Counted: ${first.sensor}, ${number(first.count)} persons/h${more}`);
  setTimeout(() => {
    lately.clear();
    showSensors();
  }, 5000);
});

/** Begin; crowds that changed are told to a function. */
export function startCounts(facts, features, changed) {
  town = facts;
  streets = features;
  byId("panel-crowds").append(
    make(
      "div",
      { id: "streets" },
      make("h2", { text: "The streets at the chosen time" }),
      make("ul", { id: "shares", class: "shares", "aria-label": "Share of the streets' length" }),
      make(
        "table",
        {},
        make("caption", { class: "hidden", text: "Densest streets" }),
        make(
          "thead",
          {},
          make(
            "tr",
            {},
            ...["Densest streets", "crowd", "persons/m²"].map((text) => make("th", { scope: "col", text })),
          ),
        ),
        make("tbody", { id: "densest-body" }),
      ),
    ),
    make(
      "div",
      { id: "sensors", hidden: true },
      make("h2", {}, "Counts ", make("span", { id: "wire", class: "wire", text: "connecting" })),
      make(
        "table",
        {},
        make("caption", { class: "hidden", text: "Sensors, and what they counted latest" }),
        make(
          "thead",
          {},
          make(
            "tr",
            {},
            ...["Sensor", "counted/h", "expected/h", "from"].map((text) => make("th", { scope: "col", text })),
          ),
        ),
        make("tbody", { id: "sensors-body" }),
      ),
    ),
  );
  onCrowds("crowds", showStreets);
  onChange((names) => {
    if (!names.has("tab")) return;
    showStreets();
    paintSensors();
  });
  showStreets();
  readSensors();
  // Without counts the server has nothing to tell, and yet it gets later.
  const quarter = () => Math.floor(now() / 15);
  let seen = quarter();
  setInterval(() => {
    if (seen === quarter()) return;
    seen = quarter();
    refreshCrowds();
    if (state.at === null) changed();
  }, 1000);
  let cut = false;
  const source = listen("events", {
    crowds: () => {
      refreshCrowds();
      arrived();
      if (state.at === null) changed();
    },
    clock: (data) => {
      setClock(data);
      refreshCrowds();
    },
  });
  const same = (one, other) => ["scenario", "version", "streets"].every((name) => one[name] === other[name]);
  source.onopen = () => {
    if (cut) {
      // A server that was started anew may have another town, or another version of this page.
      get("town").then(
        (anew) => same(anew, town) || location.reload(),
        () => {},
      );
      get("clock").then(setClock, () => {});
      refreshCrowds();
      arrived();
    }
    cut = false;
    byId("wire").textContent = "live";
  };
  source.onerror = () => {
    cut = true;
    byId("wire").textContent = "not connected";
  };
}
