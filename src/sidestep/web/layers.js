// How the map looks: its layers, from below to above.

import { DASHES, palette } from "./colours.js";

const EMPTY = { type: "FeatureCollection", features: [] };
const SOURCES = ["reach", "routes", "avoid", "found", "walk", "sensors", "names"];

/** One of several values by a number, the first where there is no such number. */
const oneOf = (number, values) => [
  "match",
  number,
  ...values.slice(1).flatMap((value, turn) => [turn + 1, value]),
  values[0],
];
const literal = (values) => values.map((value) => ["literal", value]);

const CROWD = ["coalesce", ["feature-state", "crowd"], 0];
const STYLE = ["%", ["get", "style"], DASHES.length];

const widths = (base) => {
  const wide = (factor) => ["*", factor, oneOf(CROWD, [0.8, 1.15, 1.6, 2.1])];
  return [
    "interpolate",
    ["exponential", 1.5],
    ["zoom"],
    12,
    wide(base * 0.4),
    14,
    wide(base * 0.75),
    16,
    wide(base * 1.7),
    19,
    wide(base * 6),
  ];
};

const routeWidth = (more) => [
  "interpolate",
  ["exponential", 1.4],
  ["zoom"],
  12,
  ["+", ["case", ["get", "picked"], 4, 2.4], more],
  16,
  ["+", ["case", ["get", "picked"], 7, 4.5], more],
];
const dashes = oneOf(STYLE, literal(DASHES));

/** The style of the map for some streets, and for what else is drawn by the name of its source. */
export function style(streets, data) {
  const colours = palette();
  return {
    version: 8,
    sources: {
      streets: { type: "geojson", data: streets, promoteId: "street", tolerance: 0.2 },
      ...Object.fromEntries(
        SOURCES.map((name) => [
          name,
          { type: "geojson", data: data[name] ?? EMPTY, ...(name === "sensors" ? { promoteId: "sensor" } : {}) },
        ]),
      ),
    },
    layers: [
      { id: "paper", type: "background", paint: { "background-color": colours.paper } },
      {
        id: "reach-area",
        type: "fill",
        source: "reach",
        paint: { "fill-color": oneOf(["get", "ring"], colours.reach), "fill-opacity": 0.22 },
      },
      {
        id: "streets",
        type: "line",
        source: "streets",
        layout: { "line-cap": "round", "line-join": "round" },
        paint: { "line-color": oneOf(CROWD, colours.crowds), "line-width": widths(1.5) },
      },
      {
        id: "reach-line",
        type: "line",
        source: "reach",
        layout: { "line-join": "round" },
        paint: { "line-color": oneOf(["get", "ring"], colours.reach), "line-width": 2 },
      },
      {
        id: "routes-casing",
        type: "line",
        source: "routes",
        layout: { "line-cap": "round", "line-join": "round", "line-sort-key": ["case", ["get", "picked"], 1, 0] },
        paint: { "line-color": colours.casing, "line-width": routeWidth(3) },
      },
      {
        id: "routes",
        type: "line",
        source: "routes",
        layout: { "line-cap": "butt", "line-join": "round", "line-sort-key": ["case", ["get", "picked"], 1, 0] },
        paint: {
          "line-color": oneOf(STYLE, colours.routes),
          "line-width": routeWidth(0),
          "line-dasharray": dashes,
          "line-opacity": ["get", "opacity"],
        },
      },
      {
        id: "avoid-area",
        type: "fill",
        source: "avoid",
        paint: { "fill-color": colours.label, "fill-opacity": 0.28 },
      },
      {
        id: "avoid-line",
        type: "line",
        source: "avoid",
        paint: { "line-color": colours.label, "line-width": 2.5, "line-dasharray": [1.5, 1] },
      },
      {
        id: "found",
        type: "line",
        source: "found",
        layout: { "line-cap": "round", "line-join": "round" },
        paint: { "line-color": colours.routes[0], "line-width": 11, "line-opacity": 0.4 },
      },
      {
        id: "walk-casing",
        type: "line",
        source: "walk",
        layout: { "line-cap": "round", "line-join": "round" },
        paint: { "line-color": colours.casing, "line-width": 9 },
      },
      {
        id: "walk",
        type: "line",
        source: "walk",
        layout: { "line-cap": "round", "line-join": "round" },
        paint: {
          "line-color": [
            "match",
            ["get", "part"],
            "walked",
            colours.walked,
            "dropped",
            colours.walked,
            colours.routes[0],
          ],
          "line-width": ["match", ["get", "part"], "dropped", 2.5, 5.5],
          "line-opacity": ["match", ["get", "part"], "dropped", 0.8, 1],
        },
      },
      {
        id: "names",
        type: "symbol",
        source: "names",
        minzoom: 13,
        layout: {
          "symbol-placement": "line",
          "symbol-spacing": 340,
          "text-field": ["get", "name"],
          "text-font": ["system-ui"],
          "text-size": ["interpolate", ["linear"], ["zoom"], 13, 10.5, 17, 14],
          "text-padding": 8,
          "text-max-angle": 40,
          "symbol-sort-key": ["-", 0, ["get", "metres"]],
        },
        paint: { "text-color": colours.label, "text-halo-color": colours.paper, "text-halo-width": 1.8 },
      },
      {
        id: "reach-minutes",
        type: "symbol",
        source: "reach",
        layout: {
          "symbol-placement": "line",
          "symbol-spacing": 260,
          "text-field": ["concat", ["to-string", ["get", "minutes"]], " min"],
          "text-font": ["system-ui"],
          "text-size": 12,
        },
        paint: {
          "text-color": oneOf(["get", "ring"], colours.reachText),
          "text-halo-color": colours.paper,
          "text-halo-width": 2,
        },
      },
      { id: "sensors", type: "circle", source: "sensors", paint: sensorPaint(colours) },
    ],
  };
}

function sensorPaint(colours) {
  const counted = ["!=", ["get", "count"], null];
  return {
    "circle-radius": ["case", counted, ["min", 16, ["+", 4, ["*", 0.1, ["sqrt", ["max", 0, ["get", "count"]]]]]], 4.5],
    "circle-color": colours.sensor,
    "circle-opacity": ["case", counted, 0.6, 0],
    "circle-stroke-color": ["case", ["boolean", ["feature-state", "fresh"], false], colours.routes[0], colours.sensor],
    "circle-stroke-opacity": 1,
    "circle-stroke-width": ["case", ["boolean", ["feature-state", "fresh"], false], 4, 2],
  };
}
