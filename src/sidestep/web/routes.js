// Routes of several planners beside each other, and other ways of the first.

import { get, lonLat } from "./api.js";
import { DASHES, palette, onTheme } from "./colours.js";
import { byId, complain, draw, make, settled } from "./dom.js";
import { frame, paint } from "./map.js";
import { asked, change, onChange, state } from "./state.js";

const SAYS = {
  expected: "least expected time",
  "shortest-path": "fewest metres, whatever the crowds",
  "greedy-map": "looks around at every crossing",
  "greedy-local": "sees its own crossing only",
  snapshot: "re-plans on the counts as they stand",
  forecast: "re-plans on forecasts; slow",
  clairvoyant: "knows the future: a bound",
  darp: "the trained model",
  "lrta-star": "learns on the way",
  "random-walk": "anywhere",
  "random-progress": "any path of fewest streets",
};
const ALTERNATIVES = 2;
const LIVE = new Set(["snapshot", "forecast", "darp", "clairvoyant"]);

let town = null;
let picked = null; // id of the route whose way is described
let asking = null;
let framed = ""; // ends that were framed
const found = new Map(); // planner -> {status, routes, error}

/** What a route is asked with besides its ends. */
export const circumstances = () => ({ depart_at: asked(state.at), walker: state.walker, objective: state.objective });

/** Minutes in few digits. */
export const minutes = (seconds) => {
  const value = seconds / 60;
  return value < 10 ? value.toFixed(1) : String(Math.round(value));
};

const number = (value) => Math.round(value).toLocaleString("en");
const style = (planner) => Math.max(0, town.planners.indexOf(planner));

/** All routes that are known, those of one planner together. */
const rows = () =>
  state.planners.flatMap((planner) =>
    (found.get(planner)?.routes ?? []).map((route, turn) => ({ planner, turn, route, id: `${planner}:${turn}` })),
  );

function paintRoutes() {
  const on = state.tab === "routes" || state.tab === "leave";
  const all = on && state.from && state.to ? rows() : [];
  paint("routes", all
    .filter((row) => row.turn === 0 || row.id === picked || picked?.startsWith(`${row.planner}:`))
    .map(({ id, planner, route }) => ({
      type: "Feature",
      geometry: route.geometry,
      properties: { id, planner, style: style(planner), picked: id === picked },
    })));
}

function line(planner) {
  const turn = style(planner) % DASHES.length;
  const dash = DASHES[turn][1] === 0 ? null : DASHES[turn].map((length) => length * 3.5).join(" ");
  return draw("svg", { class: "line", viewBox: "0 0 30 10", "aria-hidden": "true" },
    draw("line", { x1: 1, x2: 29, y1: 5, y2: 5, stroke: palette().routes[turn], "stroke-width": 3.5, "stroke-dasharray": dash }));
}

/** Least of a column, which is written bold. */
function least(name) {
  const values = rows().map(({ route }) => route[name]).filter(Number.isFinite);
  return values.length > 1 ? Math.min(...values) : NaN;
}

function cells(route, best) {
  const cell = (name, text, more) =>
    make("td", { class: route[name] === best[name] ? "least" : null }, text, more ? make("small", { text: more }) : null);
  return [
    cell("duration", minutes(route.duration), Number.isFinite(route.p90) ? `9 in 10: ${minutes(route.p90)}` : ""),
    cell("distance", number(route.distance)),
    cell("people_met", Number.isFinite(route.people_met) ? number(route.people_met) : "–"),
  ];
}

function body() {
  const best = Object.fromEntries(["duration", "distance", "people_met"].map((name) => [name, least(name)]));
  const both = state.from !== null && state.to !== null;
  return town.planners.flatMap((planner) => {
    const on = state.planners.includes(planner);
    const answer = on && both ? found.get(planner) : null;
    const box = make("input", {
      type: "checkbox", id: `plan-${planner}`, checked: on,
      onchange: (event) => change({ planners: town.planners.filter((each) => (each === planner ? event.target.checked : state.planners.includes(each))) }),
    });
    box.checked = on;
    const title = make("label", { for: `plan-${planner}` }, box, make("span", { class: "who" }, make("b", { text: planner }), make("small", { text: SAYS[planner] ?? "" })), on ? line(planner) : null);
    const pick = (id) => ({ class: id === picked ? "picked" : null, onclick: (event) => event.target.closest("label") || choose(id) });
    const first = answer?.routes?.[0];
    const head = make("tr", first ? pick(`${planner}:0`) : {},
      make("th", { scope: "row" }, title),
      ...(first
        ? cells(first, best)
        : [make("td", { colspan: 3, class: "note" }, answer?.status === "asking" ? make("span", { class: "busy", text: "planning …" }) : (answer?.error ?? ""))]));
    const others = (answer?.routes ?? []).slice(1).map((route, turn) =>
      make("tr", { ...pick(`${planner}:${turn + 1}`), },
        make("th", { scope: "row", class: "other" }, make("button", { type: "button", class: "link", text: `Another way, ${turn + 1}`, "aria-pressed": String(`${planner}:${turn + 1}` === picked), onclick: () => choose(`${planner}:${turn + 1}`) })),
        ...cells(route, best)));
    return [head, ...others];
  });
}

const ARROWS = {
  left: "M17 19v-7a4 4 0 0 0-4-4H6m0 0 4-4M6 8l4 4",
  right: "M7 19v-7a4 4 0 0 1 4-4h7m0 0-4-4m4 4-4 4",
  straight: "M12 20V5m0 0L7 10m5-5 5 5",
  uturn: "M17 19V9a5 5 0 0 0-10 0v9m0 0-3.5-3.5M7 18l3.5-3.5",
};

const arrow = (modifier = "") =>
  modifier.includes("uturn") ? ARROWS.uturn : modifier.includes("left") ? ARROWS.left : modifier.includes("right") ? ARROWS.right : ARROWS.straight;

const COMPASS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];

/** A turn in words. */
export function turnWords(step) {
  const { type = "", modifier = "", bearing_after: bearing = 0 } = step.maneuver ?? {};
  const into = step.name ? ` ${type === "depart" ? "on" : "into"} ${step.name}` : "";
  if (type === "arrive") return "Arrive";
  if (type === "depart") return `Head ${COMPASS[Math.round(bearing / 45) % 8]}${into}`;
  if (modifier.includes("uturn")) return `Turn round${into}`;
  if (modifier.includes("slight")) return `Bear ${modifier.replace("slight ", "")}${into}`;
  if (modifier.includes("straight") || modifier === "") return `Go on${step.name ? ` along ${step.name}` : ""}`;
  return `Turn ${modifier}${into}`;
}

/** An icon for a turn. */
export const turnIcon = (modifier) =>
  draw("svg", { viewBox: "0 0 24 24", class: "turn", "aria-hidden": "true" }, draw("path", { d: arrow(modifier) }));

function directions() {
  const row = rows().find((each) => each.id === picked) ?? null;
  const box = byId("directions");
  if (!row) {
    box.replaceChildren();
    return;
  }
  const steps = row.route.legs?.flatMap((leg) => leg.steps ?? []) ?? [];
  box.replaceChildren(
    make("h2", { text: `Turn by turn, ${row.planner}${row.turn ? `, another way ${row.turn}` : ""}` }),
    make("ol", { class: "steps" }, ...steps.map((step) =>
      make("li", {}, turnIcon(step.maneuver?.modifier), make("span", { text: turnWords(step) }),
        step.distance > 0 ? make("small", { text: `${number(step.distance)} m, ${minutes(step.duration)} min` }) : null))));
}

let head = null;

function show() {
  const focus = document.activeElement?.id;
  byId("routes-body").replaceChildren(...body());
  if (focus?.startsWith("plan-")) byId(focus)?.focus();
  byId("routes-none").hidden = state.from !== null && state.to !== null;
  head.hidden = false;
  paintRoutes();
  directions();
}

function choose(id) {
  picked = id;
  show();
}

const rest = (milliseconds, signal) =>
  new Promise((ready, stop) => {
    setTimeout(ready, milliseconds);
    signal.addEventListener("abort", () => stop(new DOMException("", "AbortError")));
  });

async function ask(planner, signal) {
  const query = {
    ...circumstances(), planner, overview: "full", geometries: "geojson", steps: "true",
    alternatives: planner === "expected" ? ALTERNATIVES : "false",
  };
  const path = `route/v1/foot/${lonLat(state.from)};${lonLat(state.to)}`;
  try {
    const answer = await get(path, query, signal);
    found.set(planner, { status: "found", routes: answer.routes, error: null });
    complain(`route ${planner}`, null);
    if (!rows().some((row) => row.id === picked)) picked = rows()[0]?.id ?? null;
    show();
    // How reliable it is takes simulated futures, so it is asked for when the route is there and the slider rests.
    await rest(500, signal);
    const sure = await get(path, { ...query, alternatives: "false", steps: "false", overview: "false", futures: LIVE.has(planner) ? 10 : 100 }, signal);
    Object.assign(found.get(planner).routes[0], { p50: sure.routes[0].p50, p90: sure.routes[0].p90 });
  } catch (error) {
    if (error.name === "AbortError") return;
    if (found.get(planner)?.status !== "found") {
      found.set(planner, { status: "refused", routes: [], error: "no route" });
      complain(`route ${planner}`, error.message);
    }
  }
  show();
}

/** The route that is described, or the first. */
export const pickedRoute = () => rows().find((row) => row.id === picked) ?? rows()[0] ?? null;

const plan = settled(40, async () => {
  asking?.abort();
  asking = new AbortController();
  for (const planner of town.planners) complain(`route ${planner}`, null);
  if (state.from === null || state.to === null) {
    found.clear();
    show();
    return;
  }
  const { signal } = asking;
  for (const planner of state.planners) {
    const before = found.get(planner);
    found.set(planner, { status: "asking", routes: before?.routes ?? [], error: null });
  }
  show();
  const ends = `${lonLat(state.from)};${lonLat(state.to)}`;
  await Promise.all(state.planners.map((planner) => ask(planner, signal)));
  if (framed !== ends && !signal.aborted) {
    frame(rows().flatMap(({ route }) => route.geometry.coordinates), { keep: true });
    framed = ends;
  }
});

/** Ask for the routes anew: crowds have changed. */
export const replan = plan;

function choice(id, label, options, name) {
  if (!options || options.length < 2) return null;
  const select = make("select", { id }, ...options.map((option, turn) => make("option", { value: turn === 0 ? "" : option, text: option })));
  select.value = state[name];
  if (select.selectedIndex < 0) select.value = "";
  select.addEventListener("change", () => change({ [name]: select.value }));
  return make("div", { class: "choice" }, make("label", { for: id, text: label }), select);
}

/** Begin. */
export function startRoutes(facts) {
  town = facts;
  const known = state.planners.filter((planner) => town.planners.includes(planner));
  change({ planners: known.length > 0 ? known : town.planners.slice(0, 1) });
  head = make("table", { class: "planners" },
    make("caption", { class: "hidden", text: "Routes of several planners" }),
    make("thead", {}, make("tr", {}, make("th", { scope: "col", text: "Planner" }), make("th", { scope: "col", text: "min" }), make("th", { scope: "col", text: "metres" }),
      make("th", { scope: "col" }, make("abbr", { title: "Crowd met on the way, person·s/m²: density times time, summed over the way", text: "people met" })))),
    make("tbody", { id: "routes-body" }));
  byId("panel-routes").append(
    make("p", { id: "routes-none", class: "note", text: "Choose both ends: type a street, or click the map twice." }),
    head,
    make("div", { class: "choices" }, choice("walker", "Walker", town.walkers, "walker"), choice("objective", "Prefer", town.objectives, "objective")),
    make("div", { id: "directions" }));
  onTheme(show);
  onChange((changed) => {
    if (["from", "to", "at", "planners", "walker", "objective"].some((name) => changed.has(name))) plan();
    if (changed.has("tab")) paintRoutes();
  });
  show();
  plan();
}
