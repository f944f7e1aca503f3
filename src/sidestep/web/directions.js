// A route turn by turn, in words and arrows.

import { draw, make } from "./dom.js";

/** Minutes in few digits. */
export const minutes = (seconds) => {
  const value = seconds / 60;
  return value < 10 ? value.toFixed(1) : String(Math.round(value));
};

/** A whole number. */
export const number = (value) => Math.round(value).toLocaleString("en");

/** A whole number for a narrow column. */
export const short = (value) =>
  value < 9999.5
    ? number(value)
    : value.toLocaleString("en", { notation: "compact", maximumSignificantDigits: 3 });

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

/** All turns of a route. */
export const turnByTurn = (route) =>
  make(
    "ol",
    { class: "steps" },
    ...(route.legs ?? [])
      .flatMap((leg) => leg.steps ?? [])
      .map((step) =>
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
  );
