// Areas to keep out of: a circle round each place that is chosen on the map, or all of a street.

import { byId, complain, icon, make } from "./dom.js";
import { circle, strips } from "./line.js";
import { paint } from "./map.js";
import { combobox, CROSS, inWords, name } from "./places.js";
import { change, onChange, SIZES, state } from "./state.js";

const ENDS = 6; // metres from crossings, where a street that is avoided may be crossed
let geometry = null; // promise of the streets, and then
let streets = [];

/** Resolves when it is known where the streets are that are avoided. */
export const known = () => (state.avoid.some(({ street }) => street) ? geometry : null);

/** All parts of a street. Crossings stay open, or a long street would be a wall. */
const wholeStreet = (name) => ({
  type: "MultiPolygon",
  coordinates: streets
    .filter(({ properties }) => properties.name === name)
    .flatMap(({ geometry }) => strips(geometry.coordinates, ENDS)),
});

const features = () =>
  state.avoid
    .map((area) => (area.street ? wholeStreet(area.street) : circle(area)))
    .filter(({ coordinates }) => coordinates.length > 0)
    .map((geometry) => ({ type: "Feature", properties: {}, geometry }));

/** The areas as the server takes them. */
export function areas() {
  const all = features();
  return all.length > 0 ? { type: "FeatureCollection", features: all } : undefined;
}

function sizeOf(area, turn) {
  const resized = (metres) => state.avoid.map((each) => (each === area ? { ...area, metres } : each));
  const size = make(
    "select",
    { id: `avoid-size-${turn}`, "aria-label": `How far from ${inWords(area)}` },
    ...SIZES.map((metres) => make("option", { value: metres, text: `${metres} m` })),
  );
  size.value = String(area.metres);
  size.addEventListener("change", () => change({ avoid: resized(Number(size.value)) }));
  return size;
}

const row = (area, turn) =>
  make(
    "li",
    {},
    make("span", { text: area.street ?? inWords(area) }),
    area.street ? make("small", { text: "all of it" }) : sizeOf(area, turn),
    make(
      "button",
      {
        type: "button",
        class: "quiet",
        "aria-label": `Avoid ${area.street ?? inWords(area)} no more`,
        onclick: () => {
          change({ avoid: state.avoid.filter((each) => each !== area) });
          byId("end-avoid").focus();
        },
      },
      icon(CROSS),
    ),
  );

/** The control for them, which also draws them; streets come when they are there. */
export function avoidChoice(coming) {
  const list = make("ul", { class: "areas", "aria-label": "Areas to avoid" });
  const box = make(
    "details",
    { id: "avoid" },
    make("summary", { text: "Areas to avoid" }),
    combobox("avoid").box,
    list,
  );
  const show = () => {
    const focus = document.activeElement?.id;
    list.replaceChildren(...state.avoid.map(row));
    if (focus?.startsWith("avoid-size")) byId(focus)?.focus();
  };
  const changed = () => {
    show();
    paint("avoid", features());
    const names = new Set(streets.map(({ properties }) => properties.name));
    const [missing] = state.avoid.filter(({ street }) => street && names.size > 0 && !names.has(street));
    complain("avoid", missing ? `No street here is called “${missing.street}”, so none is avoided for it.` : null);
    if (state.avoid.length > 0) box.open = true;
    byId("mark-avoid").hidden = state.avoid.length === 0;
    for (const area of state.avoid) if (!area.street) name(area, show);
  };
  onChange((names) => names.has("avoid") && changed());
  changed();
  geometry = coming.then(({ features }) => {
    streets = features;
    changed();
  });
  return box;
}
