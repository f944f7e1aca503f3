// Routes of several planners beside each other, and other ways of the one that searches by expected times.

import { get, inTurn, lonLat, pause, send } from "./api.js";
import { areas, avoidChoice, known } from "./avoid.js";
import { DASHES } from "./colours.js";
import { minutes, number, short, turnByTurn } from "./directions.js";
import { byId, coloured, complain, draw, make, settled } from "./dom.js";
import { frame, paint } from "./map.js";
import { asked, change, deadline, onChange, state } from "./state.js";
import { chosen as chosenTime, deadlineChoice } from "./time.js";

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
  "lrta-star": "sees one crossing, learns dead ends",
  "greedy-local": "sees one crossing",
  "random-progress": "fewest streets, any",
  "random-walk": "anywhere",
};
const WANTS = { time: "the least time", distance: "the fewest metres", exposure: "the fewest people" };
const ASKED = ["from", "to", "at", "by", "avoid", "walker", "objective"];
const ALTERNATIVES = 2;
const LIVE = new Set(["snapshot", "forecast", "darp", "clairvoyant"]); // these take longest
const REST = 0.4; // seconds without another question, after which the slider rests

let town = null;
let planners = [];
let more = false; // whether the others are listed, too
let picked = null; // id of the route whose way is described, by default the first
let chosen = null; // the one that was clicked
let asking = null;
let framed = ""; // ends that were framed
const found = new Map(); // planner -> {question, ends, asking, routes, error}
const turns = new Set(); // planners that are being asked, the others wait

/** What is asked of every planner: numbers are shown for that alone. */
const question = () => JSON.stringify([ends(), areas(), state.at, state.by, state.walker, state.objective]);
const ends = () => state.from && state.to && `${lonLat(state.from)};${lonLat(state.to)}`;

const style = (planner) => Math.max(0, planners.indexOf(planner));
const says = (planner) => SAYS[planner] ?? OTHERS[planner] ?? "";

/** What a planner answered to what is asked now, as far as it has. */
function answerOf(planner) {
  const known = found.get(planner);
  return known?.question === question() ? known : { asking: true, routes: [], error: null };
}

const rowsOf = (planner, routes) => routes.map((route, turn) => ({ planner, turn, route, id: `${planner}:${turn}` }));

/** All routes that answer what is asked now, those of one planner together. */
const rows = () => (ends() ? state.planners.flatMap((planner) => rowsOf(planner, answerOf(planner).routes)) : []);

/** Draw the routes; those of another hour or walker stay, pale, until there are others. */
function paintRoutes() {
  const on = (state.tab === "routes" || state.tab === "leave") && ends();
  const known = on ? state.planners.map((planner) => [planner, found.get(planner)]) : [];
  paint(
    "routes",
    known
      .filter(([, answer]) => answer?.ends === ends())
      .flatMap(([planner, answer]) =>
        rowsOf(planner, answer.routes)
          .filter((row) => row.turn === 0 || picked?.startsWith(`${planner}:`))
          .map(({ id, turn, route }) => ({
            type: "Feature",
            geometry: route.geometry,
            properties: {
              id,
              planner,
              style: style(planner),
              picked: id === picked,
              opacity: answer.question !== question() ? 0.35 : id === picked || turn === 0 ? 1 : 0.6,
            },
          })),
      ),
  );
}

function line(planner) {
  const turn = style(planner) % DASHES.length;
  const dash = DASHES[turn][1] === 0 ? null : DASHES[turn].map((length) => length * 3.5).join(" ");
  const stroke = draw("line", { x1: 1, x2: 29, y1: 5, y2: 5, "stroke-width": 3.5, "stroke-dasharray": dash });
  const svg = draw("svg", { class: "line", viewBox: "0 0 30 10", "aria-hidden": "true" }, stroke);
  return coloured(svg, `route-${turn}`);
}

/** Least of a column, which is written bold. */
function least(name) {
  const values = rows()
    .map(({ route }) => route[name])
    .filter(Number.isFinite);
  return values.length > 1 ? Math.min(...values) : NaN;
}

function cells({ route }, best) {
  const cell = (name, ...content) => make("td", { class: route[name] === best[name] ? "least" : null }, ...content);
  return [
    cell(
      "duration",
      minutes(route.duration),
      state.by ? make("small", { text: `leave ${/\d\d:\d\d/.exec(route.departs)?.[0]}` }) : null,
      Number.isFinite(route.p90) ? make("small", { text: `9 in 10: ${minutes(route.p90)}` }) : null,
    ),
    cell("distance", short(route.distance)),
    cell("people_met", Number.isFinite(route.people_met) ? short(route.people_met) : "–"),
  ];
}

/** Whether routes of a planner are compared. */
const compare = (planner, on) =>
  change({ planners: planners.filter((each) => (each === planner ? on : state.planners.includes(each))) });

/** A row that shows its way when it is pressed, anywhere but on its box. */
function tableRow(id, { asking = false, box = null, name, says: more, mark = null, press }, ...columns) {
  return make(
    "tr",
    { class: id === picked ? "picked" : null, "aria-busy": asking ? "true" : null, onclick: press },
    make(
      "th",
      { scope: "row" },
      make(
        "div",
        { class: "way" },
        box ?? make("span"),
        make(
          "button",
          { type: "button", id: `way-${id}`, "aria-pressed": String(id === picked) },
          make("b", { text: name }),
          mark,
          more ? make("small", { text: more }) : null,
        ),
      ),
    ),
    ...columns,
  );
}

function body() {
  const best = Object.fromEntries(["duration", "distance", "people_met"].map((name) => [name, least(name)]));
  const listed = planners.filter((planner) => more || planner in SAYS || state.planners.includes(planner));
  return listed.flatMap((planner) => {
    const on = state.planners.includes(planner);
    const answer = on && ends() ? answerOf(planner) : null;
    const box = make(
      "label",
      { onclick: (event) => event.stopPropagation() },
      make("input", {
        type: "checkbox",
        id: `plan-${planner}`,
        "aria-label": `Compare ${planner}`,
        checked: on,
        onchange: (event) => compare(planner, event.target.checked),
      }),
    );
    const waits = !answer?.asking
      ? (answer?.error ?? "")
      : turns.has(planner)
        ? make("span", { class: "busy", text: "planning" })
        : "waiting";
    const all = rowsOf(planner, answer?.routes ?? []);
    const [first, ...others] = all;
    return [
      tableRow(
        `${planner}:0`,
        {
          asking: answer?.asking,
          box,
          name: planner,
          says: says(planner),
          mark: on ? line(planner) : null,
          press: () => {
            if (!on) compare(planner, true);
            choose(`${planner}:0`);
          },
        },
        ...(first ? cells(first, best) : [make("td", { colspan: 3, class: "note" }, waits)]),
      ),
      ...others.map((row) =>
        tableRow(
          row.id,
          { asking: answer.asking, name: `Another way, ${row.turn}`, press: () => choose(row.id) },
          ...cells(row, best),
        ),
      ),
    ];
  });
}

function directions() {
  const row = rows().find((each) => each.id === picked) ?? null;
  const box = byId("directions");
  if (!row) {
    box.replaceChildren();
    return;
  }
  box.replaceChildren(
    make("h2", { text: `Turn by turn, ${row.planner}${row.turn ? `, another way ${row.turn}` : ""}` }),
    turnByTurn(row.route),
  );
}

/** In one line what the sheet of narrow screens hides, and what screen readers are told. */
function summary() {
  const row = rows().find((each) => each.id === picked);
  const asking = ends() !== null && state.planners.some((planner) => answerOf(planner).asking);
  const sure = row && Number.isFinite(row.route.p90) ? `, 9 in 10 within ${minutes(row.route.p90)}` : "";
  byId("summary").replaceChildren(
    ...(row
      ? [make("b", { text: `${minutes(row.route.duration)} min` }), `, ${number(row.route.distance)} m${sure}`]
      : [asking ? "Planning …" : ""]),
  );
  byId("summary").hidden = !row && !asking;
  byId("panel-routes").setAttribute("aria-busy", String(asking));
  const told = asking ? "Planning routes" : row ? `${row.planner}: ${byId("summary").textContent}` : "";
  if (byId("routes-status").textContent !== told) byId("routes-status").textContent = told;
}

function show() {
  const focus = document.activeElement?.id; // the rows are made anew
  const all = rows();
  const [planner] = (chosen ?? "").split(":");
  const coming = state.planners.includes(planner) && answerOf(planner).asking;
  picked = coming ? chosen : ((all.find((row) => row.id === chosen) ?? all[0])?.id ?? null);
  byId("routes-body").replaceChildren(...body());
  if (/^(plan|way)-/.test(focus ?? "")) byId(focus)?.focus();
  byId("routes-none").hidden = ends() !== null;
  paintRoutes();
  directions();
  summary();
}

function choose(id) {
  chosen = id;
  show();
}

/** Show all of the routes: of a link closely, of ends on the map only where they are out of sight. */
function frameRoutes() {
  const asking = state.planners.some((planner) => answerOf(planner).asking && !LIVE.has(planner));
  if (asking || framed === ends()) return;
  frame(
    rows().flatMap(({ route }) => route.geometry.coordinates),
    { keep: framed !== "" },
  );
  framed = ends();
}

/** Areas to avoid go in a body only; what proxies may refuse is not sent without need. */
const asRoute = (coordinates, options, signal) =>
  areas() === undefined
    ? get(`route/v1/foot/${coordinates}`, options, signal)
    : send(
        "POST",
        "route/v1/foot",
        { ...options, avoid: areas(), coordinates: coordinates.split(";").map((each) => each.split(",").map(Number)) },
        signal,
      );

/** Ask one planner, for its route alone or for more about it, unless it has refused already. */
async function ask(planner, details, signal) {
  if (details && answerOf(planner).error) return;
  const what = { question: question(), ends: ends() };
  const due = deadline(chosenTime());
  // By a deadline every departure is walked in all futures: how many is then the server's choice.
  const futures = due !== null ? undefined : LIVE.has(planner) ? 10 : 100;
  const options = {
    depart_at: asked(due === null ? state.at : chosenTime()) ?? undefined,
    arrive_by: asked(due) ?? undefined,
    walker: state.walker || undefined,
    objective: state.objective || undefined,
    planner,
    overview: "full",
    geometries: "geojson",
    steps: true,
    ...(details ? { alternatives: planner === "expected" ? ALTERNATIVES : 0, futures } : {}),
  };
  turns.add(planner);
  show();
  try {
    const { routes } = await asRoute(what.ends, options, signal);
    found.set(planner, { ...what, asking: false, routes, error: null });
    complain(`route ${planner}`, null);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    if (details) return; // the route is there
    found.set(planner, { ...what, asking: false, routes: [], error: "no answer" });
    complain(`route ${planner}`, error.message);
  } finally {
    if (!signal.aborted) turns.delete(planner);
  }
  show();
  if (!details) frameRoutes();
}

/** All planners of the server, those that walkers would use first. */
export const knownPlanners = () => planners;

const plan = settled(40, async () => {
  asking?.abort();
  asking = new AbortController();
  const { signal } = asking;
  turns.clear();
  for (const planner of planners)
    if (!state.planners.includes(planner) || found.get(planner)?.question !== question())
      complain(`route ${planner}`, null);
  if (ends() === null) found.clear();
  else for (const planner of state.planners) if (found.has(planner)) found.get(planner).asking = true;
  show();
  if (ends() === null) return;
  await known();
  if (signal.aborted) return;
  // What takes long is asked when the slider rests: other planners, other ways, and how reliable a route is.
  const again = new Set(found.keys());
  const rested = pause(REST, signal);
  rested.catch(() => {}); // nobody may wait for it
  const slow = (planner) => planner !== "expected" && again.has(planner);
  try {
    for (const live of [false, true]) {
      const some = state.planners.filter((planner) => LIVE.has(planner) === live);
      await inTurn(some, async (planner) => {
        if (slow(planner)) await rested;
        await ask(planner, false, signal);
      });
      await rested;
      await inTurn(some, (planner) => ask(planner, true, signal));
    }
  } catch (error) {
    if (error.name !== "AbortError") throw error;
  }
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

/** Begin; streets come when they are there. */
export function startRoutes(facts, streets) {
  town = facts;
  if (state.camera) framed = ends(); // the link says what is seen
  const order = [...Object.keys(SAYS), ...Object.keys(OTHERS)];
  planners = [
    ...order.filter((planner) => town.planners.includes(planner)),
    ...town.planners.filter((planner) => !order.includes(planner)),
  ];
  planners = [...new Set(planners)];
  const compared = planners.filter((planner) => state.planners.includes(planner));
  change({ planners: compared.length > 0 ? compared : planners.slice(0, 1) });
  const table = make(
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
    table,
    make("p", { id: "routes-status", class: "hidden", role: "status" }),
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
      deadlineChoice("arrive-by"),
    ),
    avoidChoice(streets),
    make("div", { id: "directions" }),
  );
  onChange((changed) => {
    if ([...ASKED, "planners"].some((name) => changed.has(name))) {
      show(); // what was found for another question goes at once
      plan();
    }
    if (changed.has("tab")) paintRoutes();
  });
  show();
  plan();
}
