// Areas that routes keep out of: a circle round each place that is chosen on the map or by its street.

import { byId, icon, make } from "./dom.js";
import { circle } from "./line.js";
import { paint } from "./map.js";
import { combobox, CROSS, inWords, name } from "./places.js";
import { change, onChange, SIZES, state } from "./state.js";

const features = () => state.avoid.map((area) => ({ type: "Feature", properties: {}, geometry: circle(area) }));

/** The areas as the server takes them. */
export const areas = () => (state.avoid.length > 0 ? { type: "FeatureCollection", features: features() } : undefined);

function row(area, turn) {
  const resized = (metres) => state.avoid.map((each) => (each === area ? { ...area, metres } : each));
  const size = make(
    "select",
    { id: `avoid-size-${turn}`, "aria-label": `How far from ${inWords(area)}` },
    ...SIZES.map((metres) => make("option", { value: metres, text: `${metres} m` })),
  );
  size.value = String(area.metres);
  size.addEventListener("change", () => change({ avoid: resized(Number(size.value)) }));
  return make(
    "li",
    {},
    make("span", { text: inWords(area) }),
    size,
    make(
      "button",
      {
        type: "button",
        class: "quiet",
        "aria-label": `Avoid ${inWords(area)} no more`,
        onclick: () => {
          change({ avoid: state.avoid.filter((each) => each !== area) });
          byId("end-avoid").focus();
        },
      },
      icon(CROSS),
    ),
  );
}

/** The control for them, which also draws them. */
export function avoidChoice() {
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
    if (state.avoid.length > 0) box.open = true;
    byId("mark-avoid").hidden = state.avoid.length === 0;
    for (const note of document.querySelectorAll(".routes-only")) note.hidden = state.avoid.length === 0;
    for (const area of state.avoid) name(area, show);
  };
  onChange((names) => names.has("avoid") && changed());
  changed();
  return box;
}
