// A walk played crossing by crossing: the server is told where the walker is and what it sees, and says how to go on.

import { get, listen, send } from "./api.js";
import { areas, known } from "./avoid.js";
import { capital, minutes, turnIcon } from "./directions.js";
import { byId, calm, complain, make, toast } from "./dom.js";
import { along, bearing, length, upTo } from "./line.js";
import { frame, lookAt, paint, putWalker } from "./map.js";
import { knownPlanners } from "./routes.js";
import { asked, clock, DAYS, onChange, state, WEEK } from "./state.js";

const SPEEDS = [10, 30, 60, 120];
const CROWD = 5; // persons/m² of the crowd that the reader puts ahead
const SLOW = 1.3; // m/s where nothing says how fast

let walk = null;
let starting = false;
let speed = 30;
let planner = "expected";

/** The time of the walker as the server reads it: of the week where no date was chosen, and else local time. */
function timeOf({ begins, seconds }) {
  if (typeof begins === "string") {
    const date = new Date(`${begins}Z`);
    date.setTime(date.getTime() + seconds * 1000);
    return date.toISOString().slice(0, 19);
  }
  const at = (begins + seconds / 60) % WEEK;
  return `${DAYS[Math.floor(at / 1440)]} ${clock(at)}:${String(Math.floor(seconds) % 60).padStart(2, "0")}`;
}

/** Hours and minutes in what the server says of a time. */
const hour = (text) => /(\d\d:\d\d)(:\d\d)?(?!.*\d\d:\d\d)/.exec((text ?? "").slice(0, 19))?.[1] ?? "";

function paintWalk() {
  if (!walk || state.tab !== "walk") {
    paint("walk", []);
    putWalker(null);
    return;
  }
  const lines = [...walk.dropped.map((line) => ["dropped", line]), ["left", walk.line], ["walked", walk.walked]];
  paint(
    "walk",
    lines
      .filter(([, line]) => line.length > 1)
      .map(([part, coordinates]) => ({
        type: "Feature",
        geometry: { type: "LineString", coordinates },
        properties: { part },
      })),
  );
  putWalker(walk.place);
}

function log(current, text, { kind = null, why = "", modifier = null } = {}) {
  byId("walk-log").prepend(
    make(
      "li",
      { class: kind },
      make("time", { text: hour(timeOf(current)) }),
      modifier === null ? make("span", { class: "turn" }) : turnIcon(modifier),
      make("span", {}, text, why ? make("em", { text: why }) : null),
    ),
  );
}

function show() {
  const going = walk !== null && !walk.arrived;
  byId("walk-start").textContent = walk === null ? "Start the walk" : "Start again";
  byId("walk-start").disabled = starting || state.from === null || state.to === null;
  for (const id of ["walk-pause", "walk-step", "walk-crowd"]) byId(id).disabled = !going;
  byId("walk-pause").textContent = !going || walk.playing ? "Pause" : "Go on";
  byId("walk-crowd").setAttribute("aria-pressed", String(walk?.crowd === true));
  byId("walk-says").textContent = starting ? "Planning the walk" : (walk?.says ?? "");
  byId("walk-says").classList.toggle("busy", starting);
  paintWalk();
}

/** What the walker is told, in a sentence or two. */
function sentence(current, said) {
  if (current.arrived) return `Arrived at ${hour(timeOf(current))}.`;
  const crowd = said.crowd_ahead;
  const ahead = crowd
    ? ` Ahead: ${crowd.name}, ${crowd.crowding}, ${crowd.distance < 1 ? "from here on" : `in ${Math.round(crowd.distance)} m`}.`
    : "";
  const range = `half within ${minutes(said.p50)} min, 9 in 10 within ${minutes(said.p90)}`;
  return `Arrival ${hour(said.arrival)}; ${range}.${ahead}`;
}

/** Take over a plan that is another than before, and say why. */
function takeChange(current, said) {
  current.dropped.push(current.line);
  const why = said.why ? `The plan changed. ${capital(said.why)}.` : "The plan changed.";
  toast(why);
  return why;
}

/** Tell the server where the walker is, and take over what it says. */
async function report(current) {
  const body = { location: current.place, time: timeOf(current) };
  if (current.crowd && current.line.length > 1) {
    body.ahead = [{ bearing: Math.round(bearing(current.line[0], along(current.line, 8))), density: CROWD }];
    current.crowd = false;
  }
  const said = await send("POST", `walks/${current.id}/position`, body);
  if (walk !== current) return;
  complain("walk", null);
  current.arrived = said.arrived === true;
  current.next = said.next;
  const why = said.changed ? takeChange(current, said) : "";
  if (said.route) [current.route, current.line] = [said.route, said.route.geometry.coordinates];
  if (current.arrived) current.line = [];
  current.says = sentence(current, said);
  if (current.arrived) {
    current.events.close();
    log(current, "Arrived", { kind: "arrived" });
  } else if (said.next) {
    const metres = Math.round(length(upTo(current.line, target(current))));
    const { instruction, name, modifier } = said.next;
    log(current, `${capital(instruction)}${name ? `: ${name}` : ""}, ${metres} m`, {
      kind: said.changed ? "changed" : null,
      why,
      modifier: modifier ?? "straight",
    });
  }
  show();
}

/** Where the walker reports next: at the crossing before it, or where it stands at that, at the one after. */
function target({ next, line }) {
  if (next && next.distance > 2) return next.location;
  return next?.ends ?? line.at(-1);
}

/** Seconds that the beginning of a route takes, by the pace of its steps. */
function secondsOf(route, metres) {
  let [left, seconds] = [metres, 0];
  for (const { distance, duration } of route.legs.flatMap((leg) => leg.steps)) {
    if (distance <= 0) continue;
    const walked = Math.min(left, distance);
    seconds += (walked / distance) * duration;
    left -= walked;
    if (left <= 0) return seconds;
  }
  return seconds + left / SLOW;
}

/** Let the walker be seen on its way along a line; at once where motion is not wanted. */
function move(current, part, seconds) {
  const [metres, began] = [length(part), performance.now()];
  return new Promise((done) => {
    const step = (timestamp) => {
      if (walk !== current) return done();
      const share = Math.min(1, (Math.max(0, timestamp - began) / 1000) * (speed / seconds));
      current.place = share < 1 ? along(part, share * metres) : part.at(-1);
      if (!calm() || share === 1) putWalker(state.tab === "walk" ? current.place : null);
      return share < 1 ? requestAnimationFrame(step) : done();
    };
    requestAnimationFrame(step);
  });
}

/** Walk to the next crossing, as fast as was chosen. */
async function onward(current) {
  let part = upTo(current.line, target(current));
  if (part.length < 2 || length(part) < 0.5) part = current.line;
  if (part.length < 2) return;
  const seconds = Math.max(1, secondsOf(current.route, length(part)));
  await move(current, part, seconds);
  if (walk !== current) return;
  current.walked.push(...part);
  current.line = current.line.slice(part.length - 1);
  current.seconds += seconds;
  lookAt({ lon: current.place[0], lat: current.place[1] });
}

async function go(current, once) {
  if (current.moving) return;
  current.moving = true;
  try {
    do {
      await onward(current);
      if (walk !== current) return;
      await report(current);
    } while (walk === current && current.playing && !current.arrived && !once);
  } catch (error) {
    current.playing = false;
    complain("walk", error.message);
  } finally {
    current.moving = false;
    if (walk === current) show();
  }
}

async function start() {
  stop();
  byId("walk-log").replaceChildren();
  starting = true;
  complain("walk", null);
  show();
  try {
    await known();
    const begins = state.at ?? (await get("clock")).now.slice(0, 19);
    const begun = await send("POST", "walks", {
      origin: [state.from.lon, state.from.lat],
      destination: [state.to.lon, state.to.lat],
      planner,
      depart_at: asked(state.at) ?? begins,
      ...(state.walker ? { walker: state.walker } : {}),
      ...(state.objective ? { objective: state.objective } : {}),
      avoid: areas(),
    });
    const line = begun.route.geometry.coordinates;
    const current = {
      id: begun.id,
      route: begun.route,
      line,
      place: line[0],
      begins,
      seconds: 0,
      walked: [],
      dropped: [],
    };
    Object.assign(current, { next: null, arrived: false, crowd: false, playing: true, moving: false, says: "" });
    // New counts may change the plan; from the next crossing on the walker follows it.
    current.events = listen(`walks/${begun.id}/events`, {
      plan: (said) => {
        if (walk === current && said.changed)
          log(current, "Counts came", { kind: "changed", why: takeChange(current, said) });
      },
    });
    walk = current;
    starting = false;
    log(current, `Set out, ${planner}: ${minutes(begun.route.duration)} min expected`, { kind: "set-out" });
    frame(line, { keep: true });
    await report(current);
    go(current, false);
  } catch (error) {
    complain("walk", error.message);
  }
  starting = false;
  show();
}

function stop() {
  walk?.events.close();
  if (walk && !walk.arrived) send("DELETE", `walks/${walk.id}`).catch(() => {}); // it would be forgotten anyway
  walk = null;
}

/** Begin. */
export function startWalk() {
  const option = (value, text) => make("option", { value, text });
  const who = make("select", { id: "walk-planner" }, ...knownPlanners().map((name) => option(name, name)));
  who.value = planner;
  who.addEventListener("change", () => (planner = who.value));
  const pace = make("select", { id: "walk-speed" }, ...SPEEDS.map((times) => option(times, `${times} × as fast`)));
  pace.value = String(speed);
  pace.addEventListener("change", () => (speed = Number(pace.value)));
  const choice = (control, text) => make("div", { class: "choice" }, make("label", { for: control.id, text }), control);
  const button = (id, text, onclick, kind = "chip") =>
    make("button", { id, type: "button", class: kind, text, onclick });
  byId("panel-walk").append(
    make("p", {
      class: "lead",
      text: "A walker reports from every crossing and is told how to go on. Put a crowd ahead, and see whether it walks round it.",
    }),
    make("div", { class: "choices" }, choice(who, "Planner"), choice(pace, "Pace")),
    make(
      "div",
      { class: "row" },
      button("walk-start", "Start the walk", start, "main"),
      button("walk-pause", "Pause", () => {
        walk.playing = !walk.playing;
        if (walk.playing) go(walk, false);
        show();
      }),
      button("walk-step", "One crossing", () => {
        walk.playing = false;
        go(walk, true);
        show();
      }),
      button("walk-crowd", "A crowd ahead", () => {
        walk.crowd = !walk.crowd;
        show();
      }),
    ),
    make("p", { id: "walk-says", class: "finding" }),
    make("ol", { id: "walk-log", class: "log", reversed: true }),
  );
  onChange((changed) => {
    if (["from", "to", "avoid"].some((name) => changed.has(name))) {
      stop();
      byId("walk-log").replaceChildren();
    }
    if (["from", "to", "avoid", "tab"].some((name) => changed.has(name))) show();
  });
  addEventListener("pagehide", stop);
  show();
}
