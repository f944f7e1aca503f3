// The best time to leave: minutes that the walk takes at every departure of a window, as a curve and as a table.

import { send } from "./api.js";
import { areas, known } from "./avoid.js";
import { byId, complain, draw, make, settled } from "./dom.js";
import { asked, change, clock, deadline, onChange, state, WEEK } from "./state.js";
import { chosen, deadlineChoice } from "./time.js";

const WINDOWS = [
  [60, "1 hour", 5],
  [120, "2 hours", 10],
  [240, "4 hours", 15],
  [480, "8 hours", 30],
];
const FUTURES = 50;
const BOX = { width: 340, height: 190, left: 30, right: 10, top: 14, bottom: 24 };

let asking = null;
let span = 1;

const round = (value) => (Math.round(value * 10) / 10).toFixed(1);

/** A time of the week some minutes after the first departure. */
const leaving = (first, departure) => (((first + departure.departure_minutes) % WEEK) + WEEK) % WEEK;

function chart(found, first) {
  const rows = found.departures;
  const most = Math.max(...rows.map((row) => row.p90_minutes));
  const least = Math.min(...rows.map((row) => row.median_minutes));
  const low = Math.max(0, Math.floor((least - 1) / 5) * 5);
  const step = [1, 2, 5, 10, 20, 50].find((each) => (most - low) / each <= 5) ?? 100;
  const high = Math.max(low + step, Math.ceil(most / step) * step);
  const last = rows.at(-1).departure_minutes || 1;
  const x = (row) => BOX.left + (row.departure_minutes / last) * (BOX.width - BOX.left - BOX.right);
  const y = (value) => BOX.height - BOX.bottom - ((value - low) / (high - low)) * (BOX.height - BOX.top - BOX.bottom);
  const path = (name) => rows.map((row) => `${x(row).toFixed(1)},${y(row[name]).toFixed(1)}`).join(" ");
  const best = rows.find((row) => row.departure_minutes === found.best.departure_minutes) ?? rows[0];
  const lines = [];
  for (let value = low; value <= high; value += step) {
    lines.push(
      draw("line", { class: "grid", x1: BOX.left, x2: BOX.width - BOX.right, y1: y(value), y2: y(value) }),
      draw("text", { x: BOX.left - 6, y: y(value) + 4, "text-anchor": "end", text: value }),
    );
  }
  const every = Math.ceil(rows.length / 5);
  rows.forEach((row, turn) => {
    if (turn % every === 0)
      lines.push(
        draw("text", {
          x: x(row),
          y: BOX.height - 6,
          "text-anchor": turn === 0 ? "start" : "middle",
          text: clock(leaving(first, row)),
        }),
      );
  });
  const back = [...rows]
    .reverse()
    .map((row) => `${x(row).toFixed(1)},${y(row.median_minutes).toFixed(1)}`)
    .join(" ");
  const wide = (BOX.width - BOX.left - BOX.right) / Math.max(1, rows.length - 1);
  const bars = rows.map((row) =>
    draw(
      "rect",
      {
        class: "hit",
        x: x(row) - wide / 2,
        width: wide,
        y: 0,
        height: BOX.height - BOX.bottom,
        onclick: () => change({ at: Math.round(leaving(first, row)) }),
      },
      draw("title", {
        text: `${clock(leaving(first, row))}: half within ${round(row.median_minutes)} min, 9 in 10 within ${round(row.p90_minutes)} min`,
      }),
    ),
  );
  return draw(
    "svg",
    {
      class: "curve",
      viewBox: `0 0 ${BOX.width} ${BOX.height}`,
      role: "img",
      "aria-label": `Minutes of walking by departure, from ${clock(leaving(first, rows[0]))} to ${clock(leaving(first, rows.at(-1)))}. Best: ${clock(leaving(first, best))}. The table below says the same.`,
    },
    ...lines,
    draw("polygon", { class: "band", points: `${path("p90_minutes")} ${back}` }),
    draw("polyline", { class: "p90", points: path("p90_minutes") }),
    draw("polyline", { class: "p50", points: path("median_minutes") }),
    draw("line", { class: "best", x1: x(best), x2: x(best), y1: BOX.top - 6, y2: BOX.height - BOX.bottom }),
    draw("circle", { class: "best", cx: x(best), cy: y(best.p90_minutes), r: 4.5 }),
    ...bars,
  );
}

function table(found, first) {
  const due = deadline(first);
  return make(
    "table",
    { class: "departures" },
    make("caption", { class: "hidden", text: "Minutes of walking by departure" }),
    make(
      "thead",
      {},
      make(
        "tr",
        {},
        ...["Leave", "half within", "9 in 10 within", ...(due === null ? [] : [`there by ${asked(due)}`])].map((text) =>
          make("th", { scope: "col", text }),
        ),
      ),
    ),
    make(
      "tbody",
      {},
      ...found.departures.map((row) =>
        make(
          "tr",
          { class: row.departure_minutes === found.best.departure_minutes ? "picked" : null },
          make(
            "th",
            { scope: "row" },
            make("button", {
              type: "button",
              class: "link",
              text: clock(leaving(first, row)),
              "aria-label": `Leave at ${clock(leaving(first, row))}`,
              onclick: () => change({ at: Math.round(leaving(first, row)) }),
            }),
          ),
          make("td", { text: round(row.median_minutes) }),
          make("td", { text: round(row.p90_minutes) }),
          due === null ? null : make("td", { text: `${Math.round(100 * row.on_time)} %` }),
        ),
      ),
    ),
  );
}

function show(found, first) {
  const rows = found.departures;
  const best = rows.find((row) => row.departure_minutes === found.best.departure_minutes) ?? rows[0];
  const worst = rows.reduce((one, other) => (other.p90_minutes > one.p90_minutes ? other : one));
  const due = deadline(first);
  const saved = worst.p90_minutes - best.p90_minutes;
  const when = clock(leaving(first, best));
  byId("leave-found").replaceChildren(
    make(
      "p",
      { class: "finding" },
      make("b", { text: `Leave at ${when}` }),
      ` and nine walks in ten take at most ${round(best.p90_minutes)} min, half of them ${round(best.median_minutes)}.`,
      saved >= 0.5
        ? ` Leaving at ${clock(leaving(first, worst))} would take up to ${round(saved)} min longer.`
        : " Other departures of this window take as long.",
      due === null ? null : ` It arrives by ${asked(due)} in ${Math.round(100 * best.on_time)} % of the walks.`,
    ),
    chart(found, first),
    make(
      "ul",
      { class: "key" },
      make("li", {}, make("span", { class: "key-p50" }), "half of the walks"),
      make("li", {}, make("span", { class: "key-p90" }), "nine in ten"),
      make("li", { text: "minutes, by departure" }),
    ),
    make("button", {
      type: "button",
      class: "main",
      text: `Set ${when} as the departure`,
      onclick: () => change({ at: Math.round(leaving(first, best)) }),
    }),
    make("details", {}, make("summary", { text: "As a table" }), table(found, first)),
  );
}

let wanted = "";

const find = settled(150, async () => {
  await known();
  if (state.tab !== "leave") return;
  const box = byId("leave-found");
  if (state.from === null || state.to === null) {
    asking?.abort();
    wanted = "";
    box.replaceChildren(make("p", { class: "note", text: "Choose both ends first." }));
    return;
  }
  const [minutes, , step] = WINDOWS[span];
  const inside =
    shown &&
    state.at !== null &&
    state.at >= shown.first &&
    state.at <= shown.first + shown.minutes &&
    deadline(state.at) === deadline(shown.first);
  // A departure chosen on the curve does not move the window that the curve is about.
  const first = inside ? shown.first : Math.floor(chosen() / 5) * 5;
  const question = {
    origin: [state.from.lon, state.from.lat],
    destination: [state.to.lon, state.to.lat],
    depart_at: asked(first),
    until: asked((first + minutes) % WEEK),
    step,
    futures: FUTURES,
    arrive_by: asked(deadline(first)),
    walker: state.walker || null,
    planner: state.planners[0] === "shortest-path" ? "shortest-path" : "expected",
    avoid: areas(),
  };
  if (wanted === JSON.stringify(question)) return;
  wanted = JSON.stringify(question);
  complain("when", null);
  asking?.abort();
  asking = new AbortController();
  box.replaceChildren(make("p", { class: "note busy", role: "status", text: "Walking through simulated futures …" }));
  try {
    const found = await send("POST", "when", question, asking.signal);
    shown = { first, minutes };
    show(found, first);
  } catch (error) {
    if (error.name === "AbortError") return;
    wanted = "";
    box.replaceChildren(make("p", { class: "note", text: "No departures to compare." }));
    complain("when", error.message);
  }
});

let shown = null;

/** Begin. */
export function startLeave() {
  const windows = make(
    "select",
    { id: "leave-window" },
    ...WINDOWS.map(([, says], turn) => make("option", { value: turn, text: `the next ${says}` })),
  );
  windows.value = String(span);
  windows.addEventListener("change", () => {
    span = Number(windows.value);
    shown = null;
    find();
  });
  byId("panel-leave").append(
    make(
      "div",
      { class: "choices" },
      make("div", { class: "choice" }, make("label", { for: "leave-window", text: "Departures of" }), windows),
      deadlineChoice("leave-by"),
    ),
    make("div", { id: "leave-found" }),
  );
  onChange((changed) => {
    if (["from", "to"].some((name) => changed.has(name))) shown = null;
    if (["from", "to", "at", "by", "avoid", "tab", "walker", "planners"].some((name) => changed.has(name))) find();
  });
  find();
}
