// Both ends of the walk as text: comboboxes of street names, coordinates and places on the map
// (ARIA Authoring Practices, "Editable Combobox With List Autocomplete").

import { get, lonLat } from "./api.js";
import { byId, complain, icon, make, settled } from "./dom.js";
import { expectClick, lookAt, mark, middle } from "./map.js";
import { change, onChange, put, state } from "./state.js";

export const CROSS = "m7 7 10 10M17 7 7 17";
const ENDS = { from: ["A", "From"], to: ["B", "To"], avoid: ["×", "Avoid"] };
let town = null;

/** Latitude and longitude as people write them. */
export const inWords = (place) => place.name || `${place.lat.toFixed(5)}, ${place.lon.toFixed(5)}`;

const within = (lon, lat) => {
  const [west, south, east, north] = town.bounds;
  const [wide, high] = [(east - west) / 2, (north - south) / 2];
  return lon >= west - wide && lon <= east + wide && lat >= south - high && lat <= north + high;
};

/** How long a street is, in words. */
const length = (metres) =>
  !Number.isFinite(metres)
    ? ""
    : metres < 950
      ? `${Math.round(metres / 10) * 10} m`
      : `${(metres / 1000).toFixed(1)} km`;

/** Two numbers as a place: latitude first, as people write them, unless only the other order lies near the town. */
function coordinates(text) {
  const found = /^\s*(-?\d{1,3}(?:\.\d+)?)\s*[,;\s]\s*(-?\d{1,3}(?:\.\d+)?)\s*$/.exec(text);
  if (!found) return null;
  const [one, other] = [Number(found[1]), Number(found[2])];
  const [lat, lon] = !within(other, one) && within(one, other) ? [other, one] : [one, other];
  return Math.abs(lat) <= 90 && Math.abs(lon) <= 180 ? { lat, lon, name: "" } : null;
}

/** A text for an end or, of areas to avoid, for one more. */
export function combobox(end) {
  const id = `end-${end}`;
  const [sign, word] = ENDS[end];
  const known = () => (end === "avoid" ? null : state[end]);
  const notFound = (text) => {
    const stands = known() && `, so the walk still ${end === "from" ? "begins" : "ends"} at ${inWords(known())}`;
    complain("search", `No street here is called “${text}”${stands ?? ""}; type a part of its name, or coordinates.`);
  };
  const input = make("input", {
    id,
    type: "text",
    role: "combobox",
    autocomplete: "off",
    autocapitalize: "off",
    spellcheck: "false",
    placeholder: "Street or coordinates",
    "aria-autocomplete": "list",
    "aria-expanded": "false",
    "aria-controls": `${id}-list`,
  });
  const list = make("ul", {
    id: `${id}-list`,
    role: "listbox",
    "aria-label": `Places for ${word}`,
    class: "options",
    hidden: true,
  });
  const clear = make(
    "button",
    { type: "button", class: "quiet clear", "aria-label": `Clear ${word}`, hidden: true },
    icon(CROSS),
  );
  let options = [];
  let offered = null; // the text that the options are for
  let entered = false; // Enter was pressed before they were there
  let at = -1;
  let asking = null;

  const open = () => !list.hidden;
  const close = () => {
    asking?.abort();
    entered = false;
    list.hidden = true;
    at = -1;
    mark([]);
    input.setAttribute("aria-expanded", "false");
    input.removeAttribute("aria-activedescendant");
  };

  function highlight(next) {
    at = next;
    mark(options[at]?.streets ?? []);
    options.forEach((option, turn) => option.node.setAttribute("aria-selected", String(turn === at)));
    if (at < 0) input.removeAttribute("aria-activedescendant");
    else {
      input.setAttribute("aria-activedescendant", options[at].node.id);
      options[at].node.scrollIntoView({ block: "nearest" });
    }
  }

  function choose(option) {
    close();
    complain("search", null);
    const place = option.place();
    input.value = end === "avoid" ? "" : inWords(place);
    offered = input.value;
    expectClick(null);
    put(end, end === "avoid" && option.streets ? { street: option.says } : place);
    lookAt(place);
  }

  /** List what was found for a text; where Enter waits for it, take the first, or say that there is nothing. */
  function offer(text, found) {
    offered = text;
    if (entered) {
      entered = false;
      options = [];
      if (found.length > 0) choose(found[0]);
      else notFound(text);
      return;
    }
    const before = options[at]?.says; // stays chosen where it is still found
    options = found.map((option, turn) => ({
      ...option,
      node: make(
        "li",
        { id: `${id}-option-${turn}`, role: "option", "aria-selected": "false" },
        make("span", { text: option.says }),
        option.more ? make("small", { text: option.more }) : null,
      ),
    }));
    for (const option of options) {
      option.node.addEventListener("pointerdown", (event) => event.preventDefault()); // the text keeps the focus
      option.node.addEventListener("click", () => choose(option));
      option.node.addEventListener("pointerenter", () => mark(option.streets ?? []));
    }
    const none = make("li", { role: "option", "aria-disabled": "true", text: `No street is called “${text}”` });
    list.replaceChildren(...(options.length > 0 ? options.map((option) => option.node) : [none]));
    highlight(options.findIndex((option) => option.says === before));
    list.hidden = document.activeElement !== input;
    input.setAttribute("aria-expanded", String(!list.hidden));
  }

  const onMap = { says: "The middle of the map", more: "as it is shown now", place: middle };

  async function search() {
    const text = input.value.trim();
    asking?.abort();
    const place = coordinates(text);
    if (place) {
      offer(text, [{ says: inWords(place), more: "latitude, longitude", place: () => place }]);
      return;
    }
    if (text === "") {
      offer(text, [onMap]);
      return;
    }
    asking = new AbortController();
    try {
      const found = await get("search", { q: text, limit: 7 }, asking.signal);
      complain("search", null);
      offer(
        text,
        found.map((each) => ({
          says: each.name,
          more: length(each.metres),
          streets: each.streets,
          place: () => ({ lon: each.longitude, lat: each.latitude, name: each.name }),
        })),
      );
    } catch (error) {
      if (error.name === "AbortError") return;
      entered = false;
      complain("search", error.message);
    }
  }
  const searchSoon = settled(120, () => offered !== input.value.trim() && search());

  input.addEventListener("input", () => {
    [entered, offered] = [false, null]; // what is listed is for another text
    highlight(-1);
    complain("search", null);
    searchSoon();
  });
  input.addEventListener("focus", () => {
    expectClick(end);
    input.select();
  });
  input.addEventListener("click", () => !open() && search());
  input.addEventListener("blur", (event) => {
    // Only a click on the map that follows at once is for this end.
    if (event.relatedTarget && !event.relatedTarget.closest("#map")) expectClick(null);
    close();
    const text = input.value.trim();
    if (text !== "" && offered === text && options.length === 0) notFound(text);
    input.value = known() ? inWords(known()) : "";
  });
  input.addEventListener("keydown", (event) => {
    const last = options.length;
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      if (!open() || offered !== input.value.trim()) search();
      else if (last > 0) highlight(event.key === "ArrowDown" ? (at + 1) % last : (at <= 0 ? last : at) - 1);
    } else if (event.key === "Enter") {
      event.preventDefault();
      if (at >= 0) choose(options[at]);
      else if (input.value.trim() !== "") {
        entered = true;
        complain("search", null);
        search();
      }
    } else if (event.key === "Escape") {
      if (open()) close();
      else input.value = "";
    }
  });
  clear.addEventListener("click", () => {
    change({ [end]: null });
    input.focus();
  });

  const show = () => {
    if (document.activeElement !== input) input.value = known() ? inWords(known()) : "";
    clear.hidden = known() === null;
  };
  const box = make(
    "div",
    { class: "end" },
    make(
      "label",
      { for: id },
      make("span", { class: `dot dot-${end}`, "aria-hidden": "true", text: sign }),
      make("span", { text: word }),
    ),
    input,
    clear,
    list,
  );
  return { box, show };
}

/** Ask for the name of the street at a place that has none yet. */
export async function name(place, show) {
  if (place === null || place.name !== "") return;
  try {
    const found = await get(`nearest/v1/foot/${lonLat(place)}`, { number: 1 });
    const street = found.waypoints?.[0]?.name;
    if (!street) return;
    place.name = street;
    show();
  } catch {
    // coordinates do as well
  }
}

/** Begin. */
export function startPlaces(facts) {
  town = facts;
  const ends = { from: combobox("from"), to: combobox("to") };
  byId("swap").before(ends.from.box, ends.to.box);
  byId("swap").addEventListener("click", () => change({ from: state.to, to: state.from }));
  const show = (changed) => {
    for (const end of ["from", "to"]) {
      if (!changed.has(end)) continue;
      ends[end].show();
      name(state[end], ends[end].show);
    }
  };
  onChange(show);
  show(new Set(["from", "to"]));
}
