// Routes of several planners beside each other, and other ways of the one that searches by expected times.

import { get, lonLat } from "./api.js";
import { DASHES, palette, onTheme } from "./colours.js";
import { byId, complain, draw, make, settled } from "./dom.js";
import { frame, paint } from "./map.js";
import { asked, change, onChange, state } from "./state.js";

// Those that walkers would use come first; the others are there to compare.
const SAYS = {
  expected: "least expected time",
  "shortest-path": "fewest metres",
  darp: "a trained model",
  "greedy-map": "looks around as it goes",
  snapshot: "re-plans on counts",
  forecast: "re-plans on forecasts, slow",
};
const OTHERS = {
  "greedy-local": "sees one crossing",
  "lrta-star": "learns on the way",
  "random-progress": "fewest streets, any",
  "random-walk": "anywhere",
};
const WANTS = { time: "the least time", distance: "the fewest metres", exposure: "the fewest people" };
const ALTERNATIVES = 2;
const LIVE = new Set(["snapshot", "forecast", "darp", "clairvoyant"]);

let town = null;
let planners = [];
let more = false; // whether the others are listed, too
let picked = null; // id of the route whose way is described, by default the first
let chosen = null; // the one that was clicked
let asking = null;
let framed = ""; // ends that were framed
const found = new Map(); // planner -> {status, routes, error}

/** What a route is asked with besides its ends. */
const circumstances = () => ({ depart_at: asked(state.at), walker: state.walker, objective: state.objective });

/** Minutes in few digits. */
export const minutes = (seconds) => {
  const value = seconds / 60;
  return value < 10 ? value.toFixed(1) : String(Math.round(value));
};

const number = (value) => Math.round(value).toLocaleString("en");
const style = (planner) => Math.max(0, planners.indexOf(planner));
const says = (planner) => SAYS[planner] ?? OTHERS[planner] ?? "";

/** All routes that are known, those of one planner together. */
const rows = () =>
  state.planners.flatMap((planner) =>
    (found.get(planner)?.routes ?? []).map((route, turn) => ({ planner, turn, route, id: `${planner}:${turn}` })),
  );

function paintRoutes() {
  const on = state.tab === "routes" || state.tab === "leave";
  const all = on && state.from && state.to ? rows() : [];
  paint(
    "routes",
    all
      .filter((row) => row.turn === 0 || row.id === picked || picked?.startsWith(`${row.planner}:`))
      .map(({ id, planner, turn, route }) => ({
        type: "Feature",
        geometry: route.geometry,
        properties: { id, planner, style: style(planner), picked: id === picked, first: turn === 0 },
      })),
  );
}

function line(planner) {
  const turn = style(planner) % DASHES.length;
  const dash = DASHES[turn][1] === 0 ? null : DASHES[turn].map((length) => length * 3.5).join(" ");
  return draw(
    "svg",
    { class: "line", viewBox: "0 0 30 10", "aria-hidden": "true" },
    draw("line", {
      x1: 1,
      x2: 29,
      y1: 5,
      y2: 5,
      stroke: palette().routes[turn],
      "stroke-width": 3.5,
      "stroke-dasharray": dash,
    }),
  );
}

/** Least of a column, which is written bold. */
function least(name) {
  const values = rows()
    .map(({ route }) => route[name])
    .filter(Number.isFinite);
  return values.length > 1 ? Math.min(...values) : NaN;
}

function cells(row, best) {
  const { route, id, planner } = row;
  const cell = (name, ...content) => make("td", { class: route[name] === best[name] ? "least" : null }, ...content);
  const shows = make("button", {
    type: "button",
    class: "link",
    id: `turns-${id}`,
    text: minutes(route.duration),
    "aria-pressed": String(id === picked),
    "aria-label": `${minutes(route.duration)} minutes by ${planner}: show its turns`,
    onclick: () => choose(id),
  });
  return [
    cell(
      "duration",
      row.turn === 0 ? shows : minutes(route.duration),
      Number.isFinite(route.p90) ? make("small", { text: `9 in 10: ${minutes(route.p90)}` }) : null,
    ),
    cell("distance", number(route.distance)),
    cell("people_met", Number.isFinite(route.people_met) ? number(route.people_met) : "–"),
  ];
}

function body() {
  const best = Object.fromEntries(["duration", "distance", "people_met"].map((name) => [name, least(name)]));
  const both = state.from !== null && state.to !== null;
  const listed = planners.filter((planner) => more || planner in SAYS || state.planners.includes(planner));
  return listed.flatMap((planner) => {
    const on = state.planners.includes(planner);
    const answer = on && both ? found.get(planner) : null;
    const box = make("input", {
      type: "checkbox",
      id: `plan-${planner}`,
      checked: on,
      onchange: (event) =>
        change({
          planners: planners.filter((each) =>
            each === planner ? event.target.checked : state.planners.includes(each),
          ),
        }),
    });
    box.checked = on;
    const title = make(
      "label",
      { for: `plan-${planner}` },
      box,
      make(
        "span",
        { class: "who" },
        make("b", { text: planner }),
        on ? line(planner) : null,
        make("small", { text: says(planner) }),
      ),
    );
    const pick = (id) => ({
      class: `${id === picked ? "picked" : ""} ${answer?.status === "asking" ? "asking" : ""}`.trim() || null,
      onclick: (event) => event.target.closest("label, button") || choose(id),
    });
    const first = answer?.routes?.[0];
    const head = make(
      "tr",
      first ? pick(`${planner}:0`) : {},
      make("th", { scope: "row" }, title),
      ...(first
        ? cells({ route: first, id: `${planner}:0`, planner, turn: 0 }, best)
        : [
            make(
              "td",
              { colspan: 3, class: "note" },
              answer?.status === "asking" ? make("span", { class: "busy", text: "planning" }) : (answer?.error ?? ""),
            ),
          ]),
    );
    const others = (answer?.routes ?? []).slice(1).map((route, turn) =>
      make(
        "tr",
        { ...pick(`${planner}:${turn + 1}`) },
        make(
          "th",
          { scope: "row", class: "other" },
          make("button", {
            type: "button",
            class: "link",
            id: `turns-${planner}:${turn + 1}`,
            text: `Another way, ${turn + 1}`,
            "aria-pressed": String(`${planner}:${turn + 1}` === picked),
            onclick: () => choose(`${planner}:${turn + 1}`),
          }),
        ),
        ...cells({ route, id: `${planner}:${turn + 1}`, planner, turn: turn + 1 }, best),
      ),
    );
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
  modifier.includes("uturn")
    ? ARROWS.uturn
    : modifier.includes("left")
      ? ARROWS.left
      : modifier.includes("right")
        ? ARROWS.right
        : ARROWS.straight;

/** A text with a capital in front. */
export const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);

const COMPASS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];

/** A turn in words. */
function turnWords(step) {
  const { type = "", modifier = "", bearing_after: bearing = 0 } = step.maneuver ?? {};
  const into = step.name ? ` ${type === "depart" ? "on" : "into"} ${step.name}` : "";
  if (type === "arrive") return "Arrive";
  if (!step.name && step.maneuver?.instruction) return capital(step.maneuver.instruction);
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
    make(
      "ol",
      { class: "steps" },
      ...steps.map((step) =>
        make(
          "li",
          {},
          turnIcon(step.maneuver?.modifier),
          make("span", { text: turnWords(step) }),
          step.distance > 0
            ? make("small", { text: `${number(step.distance)} m, ${minutes(step.duration)} min` })
            : null,
        ),
      ),
    ),
  );
}

let head = null;

function summary() {
  const row = pickedRoute();
  const sure = row && Number.isFinite(row.route.p90) ? `, 9 in 10 within ${minutes(row.route.p90)}` : "";
  byId("summary").replaceChildren(
    ...(row
      ? [make("b", { text: `${minutes(row.route.duration)} min` }), `, ${number(row.route.distance)} m${sure}`]
      : []),
  );
  byId("summary").hidden = !row || !state.from || !state.to;
}

function show() {
  const focus = document.activeElement?.id; // the rows are made anew
  const all = rows();
  picked = (all.find((row) => row.id === chosen) ?? all[0])?.id ?? null;
  byId("routes-body").replaceChildren(...body());
  if (/^(plan|turns)-/.test(focus ?? "")) byId(focus)?.focus();
  byId("routes-none").hidden = state.from !== null && state.to !== null;
  head.hidden = false;
  paintRoutes();
  directions();
  summary();
}

function choose(id) {
  chosen = id;
  show();
}

const rest = (milliseconds, signal) =>
  new Promise((ready, stop) => {
    setTimeout(ready, milliseconds);
    signal.addEventListener("abort", () => stop(new DOMException("", "AbortError")));
  });

/** Show all of the routes: of a link closely, of ends on the map only where they are out of sight. */
function frameRoutes() {
  const ends = `${lonLat(state.from)};${lonLat(state.to)}`;
  const asking = state.planners.some((planner) => found.get(planner)?.status === "asking" && !LIVE.has(planner));
  if (asking || framed === ends) return;
  frame(
    rows().flatMap(({ route }) => route.geometry.coordinates),
    { keep: framed !== "" || state.camera !== null },
  );
  framed = ends;
}

async function ask(planner, signal) {
  const query = { ...circumstances(), planner, overview: "full", geometries: "geojson", steps: "true" };
  const path = `route/v1/foot/${lonLat(state.from)};${lonLat(state.to)}`;
  const take = (answer) => {
    found.set(planner, { status: "found", routes: answer.routes, error: null });
    complain(`route ${planner}`, null);
    show();
  };
  try {
    // Other planners take longer, so they wait for the slider to rest.
    if (planner !== "expected" && found.get(planner).routes.length > 0) await rest(350, signal);
    take(await get(path, query, signal));
    frameRoutes();
    // Other ways, and how reliable it is, take longer: they are asked for when the route is there and the slider rests.
    await rest(500, signal);
    take(
      await get(
        path,
        {
          ...query,
          alternatives: planner === "expected" ? ALTERNATIVES : "false",
          futures: LIVE.has(planner) ? 10 : 100,
        },
        signal,
      ),
    );
  } catch (error) {
    if (error.name === "AbortError") return;
    if (found.get(planner)?.status !== "found") {
      found.set(planner, { status: "refused", routes: [], error: "no answer" });
      complain(`route ${planner}`, error.message);
      show();
    }
  }
}

/** All planners of the server, those that walkers would use first. */
export const knownPlanners = () => planners;

/** The route that is described, or the first. */
const pickedRoute = () => rows().find((row) => row.id === picked) ?? rows()[0] ?? null;

const plan = settled(40, async () => {
  asking?.abort();
  asking = new AbortController();
  for (const planner of planners) complain(`route ${planner}`, null);
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
  await Promise.all(state.planners.map((planner) => ask(planner, signal)));
});

/** Ask for the routes anew: crowds have changed. */
export const replan = plan;

function choice(id, label, options, name) {
  if (!options || options.length < 2) return null;
  const select = make(
    "select",
    { id },
    ...options.map((option, turn) =>
      make("option", { value: turn === 0 ? "" : option, text: WANTS[option] ?? option }),
    ),
  );
  const show = () => {
    const known = [...select.options].some((option) => option.value === state[name] || option.text === state[name]);
    if (!known) select.append(make("option", { value: state[name], text: state[name] }));
    select.value = state[name];
    if (select.selectedIndex < 0) select.value = "";
  };
  onChange((changed) => changed.has(name) && show());
  show();
  select.addEventListener("change", () => change({ [name]: select.value }));
  return make("div", { class: "choice" }, make("label", { for: id, text: label }), select);
}

/** Begin. */
export function startRoutes(facts) {
  town = facts;
  const order = [...Object.keys(SAYS), ...Object.keys(OTHERS)];
  planners = [
    ...order.filter((planner) => town.planners.includes(planner)),
    ...town.planners.filter((planner) => !order.includes(planner)),
  ];
  planners = [...new Set(planners)];
  const known = planners.filter((planner) => state.planners.includes(planner));
  change({ planners: known.length > 0 ? known : planners.slice(0, 1) });
  head = make(
    "table",
    { class: "planners" },
    make("caption", { class: "hidden", text: "Routes of several planners" }),
    make(
      "thead",
      {},
      make(
        "tr",
        {},
        make("th", { scope: "col", text: "Planner" }),
        make("th", { scope: "col", text: "min" }),
        make("th", { scope: "col", text: "metres" }),
        make(
          "th",
          { scope: "col" },
          make("abbr", {
            title: "Crowd met on the way, person·s/m²: density times time, summed over the way",
            text: "people met",
          }),
        ),
      ),
    ),
    make("tbody", { id: "routes-body" }),
  );
  byId("panel-routes").append(
    make("p", { id: "routes-none", class: "note", text: "Choose both ends: type a street, or click the map twice." }),
    head,
    planners.some((planner) => !(planner in SAYS))
      ? make("button", {
          type: "button",
          class: "link",
          id: "more-planners",
          "aria-expanded": "false",
          text: "More planners",
          onclick: (event) => {
            more = !more;
            event.target.textContent = more ? "Fewer planners" : "More planners";
            event.target.setAttribute("aria-expanded", String(more));
            show();
          },
        })
      : "",
    make(
      "div",
      { class: "choices" },
      choice(
        "walker",
        "Walker",
        town.walkers.filter((kind) => kind !== "custom"),
        "walker",
      ),
      choice("objective", "Prefer", town.objectives, "objective"),
    ),
    make("div", { id: "directions" }),
  );
  onTheme(show);
  onChange((changed) => {
    if (["from", "to", "at", "planners", "walker", "objective"].some((name) => changed.has(name))) plan();
    if (changed.has("tab")) paintRoutes();
  });
  show();
  plan();
}
