// What is asked for, and the link that holds it. Parts of the page change it and are told of changes.

import { settled } from "./dom.js";

export const TABS = ["routes", "leave", "reach", "walk", "crowds"];
export const DAYS = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"];
const NAMES = ["Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday"];

export const state = {
  from: null, // {lon, lat, name}
  to: null,
  at: null, // minutes of the week, Monday 0:00 is 0; null: now
  by: "", // when to be there, such as "18:30"
  avoid: [], // {lon, lat, metres, name}: walks keep that far from there; or {street}: they keep off a street of that name
  planners: ["expected", "shortest-path"],
  walker: "",
  objective: "",
  tab: "routes",
  camera: null, // {zoom, lat, lon}
};

const listeners = [];

/** Have a function called with the set of names that changed. */
export const onChange = (listener) => listeners.push(listener);

/** Change some of what is asked for. */
export function change(changes) {
  const changed = new Set(Object.keys(changes).filter((name) => !same(state[name], changes[name])));
  Object.assign(state, changes);
  if (changed.size === 0) return;
  for (const listener of listeners) listener(changed);
  remember();
}

/** Metres from the middle of an area that is avoided to its edge. */
export const SIZES = [30, 60, 120];
const MOST_AREAS = 10;

/** Take a place as an end, or as the middle of one more area to avoid. */
export const put = (end, place) =>
  change(
    end === "avoid"
      ? { avoid: [...state.avoid, place.street ? place : { metres: SIZES[1], ...place }].slice(-MOST_AREAS) }
      : { [end]: place },
  );

const same = (one, other) => JSON.stringify(one) === JSON.stringify(other);

const two = (number) => String(number).padStart(2, "0");

/** A time of the week as the server reads it: "Sat 17:30". */
export const asked = (minutes) =>
  minutes === null ? null : `${DAYS[Math.floor(minutes / 1440) % 7]} ${clock(minutes)}`;

/** Hours and minutes. */
export const clock = (minutes) => `${two(Math.floor((minutes % 1440) / 60))}:${two(Math.floor(minutes % 60))}`;

/** The name of the day of a time of the week. */
export const dayName = (minutes) => NAMES[Math.floor(minutes / 1440) % 7];

export const WEEK = 7 * 1440;

/** When to be there, as a time of the week: on the day of a departure or, where that is too late, on the next. */
export function deadline(departure) {
  if (state.by === "") return null;
  const [hours, minutes] = state.by.split(":").map(Number);
  const sameDay = Math.floor(departure / 1440) * 1440 + 60 * hours + minutes;
  return (sameDay > departure ? sameDay : sameDay + 1440) % WEEK;
}

function readTime(text) {
  const found = /^(Mon|Tue|Wed|Thu|Fri|Sat|Sun)[ +-]([01]\d|2[0-3]):([0-5]\d)$/.exec(text ?? "");
  return found ? DAYS.indexOf(found[1]) * 1440 + 60 * Number(found[2]) + Number(found[3]) : null;
}

/** A place that is written as longitude and latitude, or null. */
function readPlace(text) {
  const parts = (text ?? "").split(",").map(Number);
  if (parts.length !== 2 || !parts.every(Number.isFinite)) return null;
  const [lon, lat] = parts;
  return Math.abs(lon) <= 180 && Math.abs(lat) <= 90 ? { lon, lat, name: "" } : null;
}

const STREET = "street:";

/** An area to avoid that is written as longitude, latitude and metres, or as a street; or null. */
function readArea(text) {
  if (text.startsWith(STREET)) {
    const street = text.slice(STREET.length).replaceAll("%3B", ";");
    return street.trim() === "" ? null : { street };
  }
  const [, place, metres] = /^(.*),(\d+)$/.exec(text) ?? [];
  const middle = readPlace(place);
  return middle && SIZES.includes(Number(metres)) ? { ...middle, metres: Number(metres) } : null;
}

/** What part of the map is seen, or null. */
function readCamera(text) {
  const [zoom, lat, lon] = text.split("/").map(Number);
  const possible = zoom >= 0 && zoom <= 24 && Math.abs(lat) <= 90 && Math.abs(lon) <= 180;
  return possible ? { zoom, lat, lon } : null;
}

const oneOf = (words) => (text) => (words.includes(text) ? text : null);
const matching = (pattern) => (text) => (pattern.test(text) ? text : null);

/**
 * Read the link. What it does not hold stays as it is by default; so does what it holds wrongly, which `wrong` lists.
 */
export function readLink(hash, town) {
  const link = new URLSearchParams(hash.replace(/^#/, ""));
  const wrong = [];
  const several = (name, between, most, read) => {
    const parts = (link.get(name) ?? "").split(between).filter((part) => part !== "");
    link.delete(name);
    const values = parts.map(read);
    parts.forEach((part, turn) => (values[turn] === null || turn >= most) && wrong.push([name, part]));
    return values.slice(0, most).filter((value) => value !== null);
  };
  const one = (name, read) => several(name, undefined, 1, read)[0];
  const timed = (read) => (town.timed ? read : () => null);
  const planners = several("planners", ",", town.planners.length, oneOf(town.planners));
  const found = {
    from: one("from", readPlace) ?? null,
    to: one("to", readPlace) ?? null,
    at: one("at", timed(readTime)) ?? null,
    by: one("by", timed(matching(/^([01]\d|2[0-3]):[0-5]\d$/))) ?? "",
    avoid: several("avoid", ";", MOST_AREAS, readArea),
    planners: planners.length > 0 ? planners : state.planners.filter((planner) => town.planners.includes(planner)),
    walker: one("walker", oneOf(town.walkers)) ?? "",
    objective: one("objective", matching(/^[\w=., -]{1,60}$/)) ?? "", // the server says what is wrong about it
    tab: one("tab", oneOf(TABS)) ?? "routes",
    camera: one("map", readCamera) ?? null,
  };
  return { found, wrong: [...wrong, ...link] };
}

/** The link of what is shown. */
export function writeLink() {
  const place = (end) => (end === null ? "" : `${end.lon.toFixed(6)},${end.lat.toFixed(6)}`);
  const area = ({ street, ...circle }) =>
    street ? `${STREET}${street.replaceAll(";", "%3B")}` : `${place(circle)},${circle.metres}`;
  const said = {
    from: place(state.from),
    to: place(state.to),
    at: asked(state.at)?.replace(" ", "-") ?? "",
    by: state.by,
    avoid: state.avoid.map(area).join(";"),
    planners: state.planners.join(","),
    walker: state.walker,
    objective: state.objective,
    tab: state.tab,
    map: state.camera
      ? `${state.camera.zoom.toFixed(2)}/${state.camera.lat.toFixed(5)}/${state.camera.lon.toFixed(5)}`
      : "",
  };
  const pairs = Object.entries(said).filter(([, value]) => value !== "");
  return `#${pairs.map(([name, value]) => `${name}=${encodeURIComponent(value).replace(/%2C|%2F|%3A|%3B/g, decodeURIComponent)}`).join("&")}`;
}

const remember = settled(250, () => history.replaceState(null, "", writeLink()));
