// How far one gets in 5, 10 and 15 minutes.

import { lonLat, send } from "./api.js";
import { areas, known } from "./avoid.js";
import { byId, coloured, complain, make, settled } from "./dom.js";
import { frame, paint } from "./map.js";
import { asked, onChange, state } from "./state.js";

const MINUTES = [5, 10, 15];
let asking = null;
let framed = "";

function show(found) {
  const areas = found.features.filter(
    (feature) => feature.properties.part === "area" && feature.geometry.coordinates.length > 0,
  );
  const ring = (feature) => Math.max(0, MINUTES.indexOf(feature.properties.minutes));
  paint(
    "reach",
    [...areas]
      .sort((one, other) => other.properties.minutes - one.properties.minutes)
      .map((feature) => ({ ...feature, properties: { ring: ring(feature), minutes: feature.properties.minutes } })),
  );
  const rows = [...areas]
    .sort((one, other) => one.properties.minutes - other.properties.minutes)
    .map(({ properties }) =>
      make(
        "tr",
        {},
        make(
          "th",
          { scope: "row" },
          coloured(make("span", { class: "swatch" }), `reach-${Math.max(0, MINUTES.indexOf(properties.minutes))}`),
          `${properties.minutes} min`,
        ),
        make("td", { text: properties.kilometres?.toFixed(1) ?? "–" }),
        make("td", { text: Math.round(properties.hectares ?? 0) }),
        make("td", { text: properties.nodes?.toLocaleString("en") ?? "–" }),
      ),
    );
  byId("reach-found").replaceChildren(
    make(
      "table",
      { class: "reached" },
      make("caption", { class: "hidden", text: "How far one gets" }),
      make(
        "thead",
        {},
        make(
          "tr",
          {},
          ...["Within", "km of streets", "hectares", "crossings"].map((text) => make("th", { scope: "col", text })),
        ),
      ),
      make("tbody", {}, ...rows),
    ),
  );
  const key = lonLat(state.from);
  if (framed !== key)
    frame(
      areas.flatMap((feature) => feature.geometry.coordinates.flat(2)),
      { keep: true },
    );
  framed = key;
}

const find = settled(120, async () => {
  await known();
  complain("isochrone", null);
  if (state.tab !== "reach" || state.from === null) {
    asking?.abort();
    paint("reach", []);
    if (state.from === null)
      byId("reach-found").replaceChildren(make("p", { class: "note", text: "Choose where the walk begins." }));
    return;
  }
  asking?.abort();
  asking = new AbortController();
  const box = byId("reach-found");
  box.replaceChildren(make("p", { class: "note busy", role: "status", text: "Looking how far one gets …" }));
  paint("reach", []);
  try {
    const question = {
      origin: [state.from.lon, state.from.lat],
      minutes: MINUTES,
      depart_at: asked(state.at),
      walker: state.walker || null,
      avoid: areas(),
    };
    const found = await send("POST", "isochrone", question, asking.signal);
    show(found);
  } catch (error) {
    if (error.name === "AbortError") return;
    paint("reach", []);
    box.replaceChildren(make("p", { class: "note", text: "Nothing to show." }));
    complain("isochrone", error.message);
  }
});

/** Begin. */
export function startReach() {
  if (state.camera && state.from) framed = lonLat(state.from); // the link says what is seen
  byId("panel-reach").append(
    make("p", {
      class: "lead",
      text: "How far one gets from the start in 5, 10 and 15 minutes, through the crowds of the chosen hour.",
    }),
    make("div", { id: "reach-found" }),
  );
  onChange((changed) => {
    if (["from", "at", "avoid", "tab", "walker"].some((name) => changed.has(name))) find();
  });
  find();
}
