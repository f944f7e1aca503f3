// How crowded the streets are at the chosen time: fetched once, kept, and fetched ahead of the slider.

import { get, inTurn } from "./api.js";
import { complain } from "./dom.js";
import { asked, onChange, state, WEEK } from "./state.js";

const STEP = 15; // minutes between two times of the slider
const HOUR = 60;

let limits = [0.31, 0.72, 2.17]; // persons/m², from the server
const kept = new Map(); // time as asked -> {density}
const listeners = { crowds: [], day: [] };
let fetching = null;
let ahead = 0;
export let shown = null; // what is on the map
export let exact = false; // whether that is of the chosen time, or as long as this is asked for of one near it

/** Have a function called when the crowds that are shown change ("crowds"), or more of a day is known ("day"). */
export const onCrowds = (what, listener) => listeners[what].push(listener);

/** The class of a density: 0 is free. */
export const crowding = (density) => limits.filter((limit) => density >= limit).length;

const key = (at) => asked(at) ?? "now";

async function fetched(at, { signal, anew = false } = {}) {
  const name = key(at);
  if (kept.has(name) && !anew) return kept.get(name);
  const found = await get("crowds", { at: asked(at), geometry: "false" }, signal);
  const crowds = { density: found.density };
  kept.set(name, crowds);
  return crowds;
}

/** The kept crowds of the nearest time of the day, within an hour and a half. */
function nearest(at) {
  for (let away = 0; away <= 90; away += STEP) {
    for (const other of [at - away, at + away]) {
      const found = kept.get(key(((other % WEEK) + WEEK) % WEEK));
      if (found) return found;
    }
  }
  return null;
}

function show(crowds, of) {
  shown = crowds;
  exact = crowds === kept.get(key(of));
  for (const listener of listeners.crowds) listener(crowds);
}

/** Show the crowds at the chosen time: those of the nearest kept time at once, and then its own. */
export async function showCrowds({ anew = false } = {}) {
  fetching?.abort();
  fetching = new AbortController();
  const { at } = state;
  const atOnce = kept.get(key(at)) ?? (at === null ? null : nearest(at)) ?? shown;
  if (atOnce) show(atOnce, at);
  try {
    const crowds = await fetched(at, { signal: fetching.signal, anew });
    if (state.at === at && !(exact && shown === crowds)) show(crowds, at);
    complain("crowds", null);
  } catch (error) {
    if (error.name !== "AbortError") complain("crowds", error.message);
  }
}

/** Fetch every hour of a day, so that the slider need not wait. */
export async function fetchDay(day) {
  const turn = (ahead += 1);
  const hours = Array.from({ length: 24 }, (_, hour) => day * 1440 + hour * HOUR);
  try {
    await inTurn(hours, async (at) => {
      if (turn === ahead) await fetched(at);
      if (turn === ahead) for (const listener of listeners.day) listener(day);
    });
  } catch {
    // the chosen time says what is wrong
  }
}

/** Fetch the next times of the slider while it plays. */
export function fetchAhead(at) {
  for (const step of [1, 2, 3]) fetched((at + step * STEP) % WEEK).catch(() => {});
}

/** For each hour of a day the share of the streets' length that is dense or jammed; null where it is not known. */
export const shapeOfDay = (day, metres) =>
  Array.from({ length: 24 }, (_, hour) => {
    const crowds = kept.get(key(day * 1440 + hour * HOUR));
    if (!crowds) return null;
    let crowded = 0;
    let all = 0;
    crowds.density.forEach((density, street) => {
      all += metres[street] ?? 0;
      if (crowding(density) >= 2) crowded += metres[street] ?? 0;
    });
    return all > 0 ? crowded / all : 0;
  });

/** Fetch the crowds of now anew: they go on from what was counted. Those that are expected at other times stay. */
export function refreshCrowds() {
  if (state.at === null) showCrowds({ anew: true });
  else kept.delete(key(null));
}

/** Begin. */
export function startCrowds(town) {
  limits = town.crowding.map((each) => each.limit).filter((limit) => Number.isFinite(limit));
  onChange((changed) => {
    if (changed.has("at")) showCrowds();
  });
}
