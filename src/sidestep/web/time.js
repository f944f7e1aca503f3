// The chosen time: slider, day, play, now; and the server's clock.

import { get } from "./api.js";
import { fetchAhead, fetchDay, onCrowds, shapeOfDay } from "./crowds.js";
import { byId, calm, coloured, draw, make, settled } from "./dom.js";
import { change, clock, dayName, DAYS, deadline, onChange, state, WEEK } from "./state.js";

const STEP = 15;
let reading = { minutes: 720, speed: 1, at: performance.now(), simulated: false };
let playing = 0;
let counted = false;
let synthetic = false;
let timed = true; // whether crowds depend on the time
const deadlines = []; // which day they mean depends on the time

/** Minutes of the week by the server's clock. */
export const now = () => (reading.minutes + ((performance.now() - reading.at) / 60000) * reading.speed) % WEEK;

/** The chosen time, minutes of the week. */
export const chosen = () => state.at ?? now();

/** A control for the time by which to be there, which says the day that is meant. */
export function deadlineChoice(id) {
  const input = make("input", { id, type: "time", "aria-describedby": `${id}-day` });
  const day = make("small", { id: `${id}-day`, role: "status" });
  input.addEventListener("change", () => change({ by: input.value }));
  const show = () => {
    const due = deadline(chosen());
    if (input.value !== state.by) input.value = state.by;
    const next = due !== null && dayName(due) !== dayName(chosen());
    const words = due === null ? "" : `${dayName(due)}${next ? ", the next day" : ""}`;
    if (day.textContent !== words) day.textContent = words;
  };
  onChange((changed) => changed.has("by") && show());
  deadlines.push(show);
  show();
  return make("div", { class: "choice timed" }, make("label", { for: id, text: "To be there by" }), input, day);
}

/** Take over what the server says about its clock. */
export function setClock(said) {
  const found = /^(\d{4})-(\d\d)-(\d\d)T(\d\d):(\d\d)(?::(\d\d))?/.exec(said.now ?? "");
  if (!found) return;
  const [year, month, day, hour, minute, second] = found.slice(1).map((part) => Number(part ?? 0));
  const date = Date.UTC(year, month - 1, day, hour, minute, second);
  const weekday = (new Date(date).getUTCDay() + 6) % 7;
  reading = {
    minutes: weekday * 1440 + hour * 60 + minute + second / 60,
    speed: said.speed ?? 1,
    at: performance.now(),
    simulated: said.simulated === true,
  };
  showTime();
}

function showTime() {
  const at = chosen();
  const slider = byId("slider");
  const words = timed ? `${dayName(at)} ${clock(at)}` : "From the start";
  const parts = timed ? [make("span", { class: "of-day", text: `${dayName(at)} ` }), clock(at)] : [words];
  slider.value = String(Math.min(Math.floor((at % 1440) / STEP) * STEP, 1425));
  slider.setAttribute("aria-valuetext", words);
  slider.style.setProperty("--part", `${((at % 1440) / 1440) * 100}%`);
  byId("day").value = String(Math.floor(at / 1440) % 7);
  if (byId("time-shown").textContent !== words) byId("time-shown").replaceChildren(...parts);
  byId("now").setAttribute("aria-pressed", String(state.at === null));
  for (const show of deadlines) show();
}

function showKind() {
  const simulated = reading.simulated ? `, clock simulated${reading.speed === 1 ? "" : `, ×${reading.speed}`}` : "";
  const live = state.at === null && counted;
  const kind = live ? ["from live", " counts"] : ["expected", " crowds"];
  byId("crowds-kind").replaceChildren(
    kind[0],
    make("span", { class: "wide", text: kind[1] }),
    (synthetic ? ", synthetic" : "") + (state.at === null ? simulated : ""),
  );
}

/** Say whether anything was counted lately, from which the crowds of now go on. */
export function setCounted(some) {
  counted = some;
  showKind();
}

function choose(minutes) {
  change({ at: Math.round(((minutes % WEEK) + WEEK) % WEEK) });
}

function stop() {
  clearInterval(playing);
  playing = 0;
  const button = byId("play");
  button.classList.remove("playing");
  button.setAttribute("aria-label", "Play the day");
}

function play() {
  const button = byId("play");
  button.classList.add("playing");
  button.setAttribute("aria-label", "Stop");
  const day = () => Math.floor(chosen() / 1440) * 1440;
  playing = setInterval(
    () => {
      const next = day() + ((Math.floor((chosen() % 1440) / STEP) * STEP + STEP) % 1440);
      choose(next);
      fetchAhead(next);
    },
    calm() ? 1000 : 300,
  );
}

function showShape(day, metres) {
  if (day !== Math.floor(chosen() / 1440)) return;
  const shape = shapeOfDay(day, metres);
  const most = Math.max(0.05, ...shape.map((share) => share ?? 0));
  const bars = shape.map((share, hour) =>
    share === null
      ? null
      : draw("rect", { x: hour + 0.12, width: 0.76, y: 1 - share / most, height: share / most, rx: 0.12 }),
  );
  byId("day-shape").replaceChildren(...bars.filter((bar) => bar !== null));
}

/** Begin. */
export async function startTime(town) {
  synthetic = Boolean(town.synthetic);
  timed = town.timed;
  let metres = [];
  byId("day").append(...DAYS.map((_, day) => make("option", { value: day, text: dayName(day * 1440) })));
  byId("day-shape").setAttribute("viewBox", "0 0 24 1");
  byId("slider").addEventListener("input", (event) => {
    stop();
    choose(Math.floor(chosen() / 1440) * 1440 + Number(event.target.value));
  });
  byId("day").addEventListener("change", (event) =>
    choose(Number(event.target.value) * 1440 + ((Math.floor(chosen() / STEP) * STEP) % 1440)),
  );
  byId("now").addEventListener("click", () => {
    stop();
    change({ at: null });
  });
  byId("play").addEventListener("click", () => (playing ? stop() : play()));
  const words = town.crowding.map((each, turn) => {
    const before = turn === 0 ? 0 : town.crowding[turn - 1].limit;
    const range = Number.isFinite(each.limit) ? `${before}–${each.limit}` : `${before}+`;
    return make(
      "li",
      {},
      coloured(make("span", { class: "swatch" }), `crowd-${turn}`),
      make("b", { text: each.word }),
      make("span", { class: "range", text: ` ${range}${turn === town.crowding.length - 1 ? " persons/m²" : ""}` }),
    );
  });
  byId("legend").append(...words);
  let day = -1;
  let ready = false;
  const another = settled(150, () => fetchDay(day));
  const look = () => {
    showTime();
    showKind();
    if (day !== Math.floor(chosen() / 1440)) {
      day = Math.floor(chosen() / 1440);
      showShape(day, metres);
      if (ready && timed) another();
    }
  };
  onChange((changed) => changed.has("at") && look());
  onCrowds("crowds", showKind);
  onCrowds("day", (of) => showShape(of, metres));
  try {
    setClock(await get("clock"));
  } catch {
    showTime(); // the time is then noon, and can be chosen
  }
  look();
  setInterval(() => state.at === null && look(), 1000);
  return {
    /** The rest of the day is fetched when all that is seen first is there. */
    withStreets(lengths) {
      metres = lengths;
      ready = true;
      if (timed) another();
    },
  };
}
