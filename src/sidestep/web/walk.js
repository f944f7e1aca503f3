// A walk played crossing by crossing: the server is told where the walker is and what it sees, and says how to go on.

import { get, send } from "./api.js";
import { byId, calm, complain, make } from "./dom.js";
import { frame, lookAt, paint, putWalker } from "./map.js";
import { minutes, turnIcon } from "./routes.js";
import { asked, onChange, state } from "./state.js";

const SPEEDS = [10, 30, 60, 120];
const CROWD = 5; // persons/m² of the crowd that the reader puts ahead

let town = null;
let walk = null;
let speed = 30;
let planner = "expected";

const METRE = 111195.08; // of a degree of latitude

function metresBetween([lon, lat], [otherLon, otherLat]) {
  const east = (otherLon - lon) * Math.cos((lat * Math.PI) / 180);
  return Math.hypot(east, otherLat - lat) * METRE;
}

function bearing([lon, lat], [otherLon, otherLat]) {
  const east = (otherLon - lon) * Math.cos((lat * Math.PI) / 180);
  return ((Math.atan2(east, otherLat - lat) * 180) / Math.PI + 360) % 360;
}

/** The part of a line up to the point nearest to a place. */
function upTo(line, place) {
  let [best, at] = [Infinity, 0];
  line.forEach((point, turn) => {
    const away = metresBetween(point, place);
    if (turn > 0 && away < best) [best, at] = [away, turn];
  });
  return line.slice(0, at + 1);
}

const length = (line) => line.slice(1).reduce((sum, point, turn) => sum + metresBetween(line[turn], point), 0);

/** A point some metres along a line. */
function along(line, metres) {
  let left = metres;
  for (let turn = 1; turn < line.length; turn += 1) {
    const part = metresBetween(line[turn - 1], line[turn]);
    if (left <= part && part > 0) {
      const share = left / part;
      return line[turn].map((value, axis) => line[turn - 1][axis] + share * (value - line[turn - 1][axis]));
    }
    left -= part;
  }
  return line.at(-1);
}

const later = (text, seconds) => {
  const date = new Date(`${text.slice(0, 19)}Z`);
  date.setTime(date.getTime() + seconds * 1000);
  return date.toISOString().slice(0, 19);
};

const hour = (text) => /T(\d\d:\d\d)/.exec(text ?? "")?.[1] ?? "";

function paintWalk() {
  if (!walk || state.tab !== "walk") {
    paint("walk", []);
    putWalker(null);
    return;
  }
  const part = (name, coordinates) => ({
    type: "Feature",
    geometry: { type: "LineString", coordinates },
    properties: { part: name },
  });
  const lines = walk.dropped.filter((line) => line.length > 1).map((line) => part("dropped", line));
  if (walk.line.length > 1) lines.push(part("left", walk.line));
  if (walk.walked.length > 1) lines.push(part("walked", walk.walked));
  paint("walk", lines);
  putWalker(walk.place);
}

function log(text, { kind = "", why = "", modifier = null } = {}) {
  const item = make(
    "li",
    { class: kind || null },
    make("time", { text: hour(walk.time) }),
    modifier === null ? make("span", { class: "turn" }) : turnIcon(modifier),
    make("span", {}, text, why ? make("em", { text: why }) : null),
  );
  byId("walk-log").prepend(item);
}

function show() {
  const going = walk !== null && !walk.arrived;
  byId("walk-start").textContent = walk === null ? "Start the walk" : "Start again";
  byId("walk-start").disabled = state.from === null || state.to === null;
  for (const id of ["walk-pause", "walk-step", "walk-crowd"]) byId(id).disabled = !going;
  byId("walk-pause").textContent = walk?.playing ? "Pause" : "Go on";
  byId("walk-crowd").setAttribute("aria-pressed", String(walk?.crowd === true));
  byId("walk-says").textContent = walk === null ? "" : walk.says;
  paintWalk();
}

/** How long the walk to the next crossing takes, by the pace of the whole route. */
function secondsTo(metres) {
  const { distance, duration } = walk.route;
  return distance > 0 ? (metres / distance) * duration : metres / 1.3;
}

async function report() {
  const current = walk;
  const body = { location: current.place, time: current.time };
  if (current.crowd && current.line.length > 1) {
    body.ahead = [{ bearing: Math.round(bearing(current.line[0], along(current.line, 12))), density: CROWD }];
    current.crowd = false;
  }
  const said = await send("POST", `walks/${current.id}/position`, body);
  if (walk !== current) return;
  complain("walk", null);
  current.arrived = said.arrived === true;
  if (said.route) {
    if (said.changed) current.dropped.push(current.line);
    current.route = said.route;
    current.line = said.route.geometry.coordinates;
  } else if (current.arrived) {
    current.line = [];
  }
  current.next = said.next;
  const arrival = said.arrival ? ` Arrival ${hour(said.arrival)}` : "";
  const range =
    Number.isFinite(said.p50) && Number.isFinite(said.p90) && !current.arrived
      ? `; half within ${minutes(said.p50)} min, 9 in 10 within ${minutes(said.p90)}.`
      : ".";
  current.says = current.arrived ? `Arrived at ${hour(current.time)}.` : `${arrival}${arrival ? range : ""}`.trim();
  if (current.arrived) log("Arrived", { kind: "arrived" });
  else if (said.next) {
    const { name, modifier = "straight", distance } = said.next;
    const street = name || "the path";
    log(`${Math.round(distance)} m along ${street}`, {
      kind: said.changed ? "changed" : "",
      why: said.changed ? `The plan changed. ${said.why ?? ""}` : "",
      modifier,
    });
  }
  show();
}

/** Walk to the next crossing, as fast as was chosen, and report from there. */
async function onward(current) {
  const target = current.next?.location ?? current.line.at(-1);
  let part = upTo(current.line, target);
  if (part.length < 2 || length(part) < 0.5) part = current.line;
  if (part.length < 2) return;
  const metres = length(part);
  const seconds = Math.max(1, secondsTo(metres));
  const began = performance.now();
  await new Promise((done) => {
    const frameOf = (timestamp) => {
      if (walk !== current) return done();
      const share = calm() ? 1 : Math.min(1, ((timestamp - began) / 1000) * (speed / seconds));
      current.place = share < 1 ? along(part, share * metres) : part.at(-1);
      putWalker(state.tab === "walk" ? current.place : null);
      if (share < 1) requestAnimationFrame(frameOf);
      else if (calm()) setTimeout(done, Math.min(1500, (1000 * seconds) / speed));
      else done();
    };
    requestAnimationFrame(frameOf);
  });
  if (walk !== current) return;
  current.walked.push(...(current.walked.length > 0 ? part.slice(1) : part));
  const rest = current.line.slice(part.length - 1);
  current.line = rest.length > 0 ? rest : [part.at(-1)];
  current.time = later(current.time, seconds);
  lookAt({ lon: current.place[0], lat: current.place[1] });
}

async function go(current, once) {
  if (current.moving) return;
  current.moving = true;
  try {
    do {
      await onward(current);
      if (walk !== current) return;
      await report();
    } while (walk === current && current.playing && !current.arrived && !once);
  } catch (error) {
    current.playing = false;
    complain("walk", error.message);
  } finally {
    current.moving = false;
    if (walk === current) {
      if (current.arrived) current.playing = false;
      show();
    }
  }
}

async function start() {
  stop();
  byId("walk-log").replaceChildren();
  try {
    const [begun, clock] = await Promise.all([
      send("POST", "walks", {
        origin: [state.from.lon, state.from.lat],
        destination: [state.to.lon, state.to.lat],
        planner,
        ...(state.walker ? { walker: state.walker } : {}),
        ...(state.objective ? { objective: state.objective } : {}),
        ...(state.at === null ? {} : { depart_at: asked(state.at) }),
      }),
      get("clock"),
    ]);
    complain("walk", null);
    const line = begun.route.geometry.coordinates;
    // The walk begins when it arrives, less the time it takes.
    const time =
      begun.departure ?? (begun.arrival ? later(begun.arrival, -begun.route.duration) : clock.now.slice(0, 19));
    walk = {
      id: begun.id,
      route: begun.route,
      line,
      place: line[0],
      time,
      walked: [],
      dropped: [],
      next: null,
      arrived: false,
      crowd: false,
      playing: true,
      moving: false,
      says: "",
    };
    log(`Set out, ${planner}: ${minutes(begun.route.duration)} min expected`, { kind: "set-out" });
    frame(line, { keep: true });
    await report();
    go(walk, false);
  } catch (error) {
    complain("walk", error.message);
  }
  show();
}

function stop() {
  if (walk && !walk.arrived) send("DELETE", `walks/${walk.id}`).catch(() => {});
  walk = null;
}

/** Begin. */
export function startWalk(facts) {
  town = facts;
  const who = make(
    "select",
    { id: "walk-planner" },
    ...town.planners.map((name) => make("option", { value: name, text: name })),
  );
  who.value = planner;
  who.addEventListener("change", () => (planner = who.value));
  const pace = make(
    "select",
    { id: "walk-speed" },
    ...SPEEDS.map((times) => make("option", { value: times, text: `${times} × as fast` })),
  );
  pace.value = String(speed);
  pace.addEventListener("change", () => (speed = Number(pace.value)));
  const button = (id, text, onclick, kind = "chip") =>
    make("button", { id, type: "button", class: kind, text, onclick });
  byId("panel-walk").append(
    make("p", {
      class: "lead",
      text: "A walker reports from every crossing and is told how to go on. Put a crowd ahead, and see whether it walks round it.",
    }),
    make(
      "div",
      { class: "choices" },
      make("div", { class: "choice" }, make("label", { for: "walk-planner", text: "Planner" }), who),
      make("div", { class: "choice" }, make("label", { for: "walk-speed", text: "Pace" }), pace),
    ),
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
    make("p", { id: "walk-says", class: "finding", role: "status" }),
    make("ol", { id: "walk-log", class: "log", reversed: true }),
  );
  onChange((changed) => {
    if (changed.has("from") || changed.has("to")) {
      stop();
      byId("walk-log").replaceChildren();
    }
    if (changed.has("from") || changed.has("to") || changed.has("tab")) show();
  });
  show();
}
