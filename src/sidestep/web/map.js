// The map: streets by their crowding, routes, reach, sensors, walkers. MapLibre GL from this host, no tiles and no fonts:
// names of streets are drawn with the fonts of the system.

import { onTheme } from "./colours.js";
import { crowding, exact, onCrowds, shown } from "./crowds.js";
import { byId, calm, make } from "./dom.js";
import { style } from "./layers.js";
import { namedLines } from "./names.js";
import { change, onChange, put, state } from "./state.js";

let gl = null; // the library
export let map = null;
let streets = null;
let town = null;
let classes = [];
let active = null; // the end that the next click on the map is for
const pins = {};
const data = {};

function repaint() {
  if (!map?.isStyleLoaded() && !map?.getLayer("streets")) return;
  const wanted = style(streets, data).layers;
  for (const layer of wanted) {
    for (const [name, value] of Object.entries(layer.paint)) {
      if (/color|opacity/.test(name)) map.setPaintProperty(layer.id, name, value);
    }
  }
}

/** Give the streets the classes of the crowds; only those that changed are told to the map. */
function colour(crowds) {
  if (!map || !streets || !map.getSource("streets")) return;
  streets.features.forEach((feature) => {
    const { street } = feature.properties;
    const now = crowding(crowds.density[street] ?? 0);
    if (classes[street] === now) return;
    classes[street] = now;
    map.setFeatureState({ source: "streets", id: street }, { crowd: now });
  });
}

/** Replace what one of the sources draws. */
export function paint(name, features) {
  data[name] = { type: "FeatureCollection", features };
  map?.getSource(name)?.setData(data[name]);
  if (name === "sensors") said();
}

/** Let some streets stand out, by their numbers. */
export const mark = (numbers) =>
  paint("found", streets?.features.filter(({ properties }) => numbers.includes(properties.street)) ?? []);

/** Let a sensor stand out for some seconds. */
export function flash(sensor) {
  if (!map?.getSource("sensors")) return;
  map.setFeatureState({ source: "sensors", id: sensor }, { fresh: true });
  setTimeout(() => map.setFeatureState({ source: "sensors", id: sensor }, { fresh: false }), 5000);
}

/** The space that the panel and the bar of time leave free, so that what is shown is not below them. */
function padding() {
  const wide = matchMedia("(min-width: 800px)").matches;
  const area = document.querySelector(".map-area").getBoundingClientRect();
  const space = { top: wide ? 72 : 52, left: 36, right: 36, bottom: wide ? 40 : 24 }; // above, pins need room
  const time = document.querySelector(".time").getBoundingClientRect();
  const panel = byId("panel").getBoundingClientRect();
  if (wide) space.bottom += Math.max(0, area.bottom - time.top);
  else {
    space.top += time.bottom;
    space.bottom += Math.max(0, area.bottom - panel.top);
  }
  space.right += 24;
  return space;
}

let framed = []; // what is to be seen, until the reader moves the map
let ours = false; // whether this page chose what part of the map is seen
const hasRoom = ({ top, bottom }) => map.getCanvas().clientHeight - top - bottom > 100; // not below a raised sheet

/** Show all of some coordinates, as soon as there is a map. */
export function frame(coordinates, { keep = false } = {}) {
  framed = coordinates;
  if (!map || coordinates.length === 0) return;
  const bounds = coordinates.reduce(
    (found, point) => found.extend(point),
    new gl.LngLatBounds(coordinates[0], coordinates[0]),
  );
  const space = padding();
  if (!hasRoom(space)) return; // once there is, it is framed again
  if (keep && inView(bounds) && !(ours && isSmall(bounds, space))) return;
  ours = true;
  map.fitBounds(bounds, { padding: space, maxZoom: CLOSEST, duration: calm() ? 0 : 600 });
}

/** Whether something would fill the space that is free if it were shown three times as large. */
function isSmall(bounds, space) {
  const fitting = map.cameraForBounds(bounds, { padding: space, maxZoom: CLOSEST });
  return fitting !== undefined && fitting.zoom > map.getZoom() + Math.log2(3);
}

/** See to it that what is to be seen is so, since there is another space for it. */
export const frameAgain = () => frame(framed, { keep: true });

const CLOSEST = 16.5; // zoom of what is very small
const SLACK = 20; // px of the margins in which something is still seen well

function inView(bounds) {
  const free = padding();
  const { width, height } = map.getCanvas().getBoundingClientRect();
  return [bounds.getSouthWest(), bounds.getNorthEast()].every((corner) => {
    const { x, y } = map.project(corner);
    return (
      x > free.left - SLACK &&
      x < width - free.right + SLACK &&
      y > free.top - SLACK &&
      y < height - free.bottom + SLACK
    );
  });
}

const wholeTown = () => {
  const [west, south, east, north] = town.bounds;
  frame([
    [west, south],
    [east, north],
  ]);
};

/** Move the view to a place. */
export const lookAt = (place) => {
  const center = [place.lon, place.lat];
  const space = padding();
  if (!map || !hasRoom(space) || inView(new gl.LngLatBounds(center, center))) return;
  const offset = [(space.left - space.right) / 2, (space.top - space.bottom) / 2];
  map.easeTo({ center, offset, duration: calm() ? 0 : 400 });
};

/** Show the part of the town that a link names. */
export function goTo(camera) {
  if (map && camera) map.jumpTo({ center: [camera.lon, camera.lat], zoom: camera.zoom });
}

/** The place in the middle of what is seen. */
export function middle() {
  if (!map) return { lon: (town.bounds[0] + town.bounds[2]) / 2, lat: (town.bounds[1] + town.bounds[3]) / 2, name: "" };
  const free = padding();
  const { width, height } = map.getCanvas().getBoundingClientRect();
  const { lng, lat } = map.unproject([(width + free.left - free.right) / 2, (height + free.top - free.bottom) / 2]);
  return { lon: lng, lat, name: "" };
}

/** Say which end the next click is for. */
export function expectClick(end) {
  active = end;
  hint();
}

const HINTS = { from: "where the walk begins", to: "where the walk ends", avoid: "where not to walk" };

function hint() {
  const box = byId("hint");
  const next = active ?? (state.from === null ? "from" : state.to === null ? "to" : null);
  box.hidden = !map || next === null;
  const touch = matchMedia("(pointer: coarse)").matches ? "Tap" : "Click";
  box.textContent = `${touch} the map ${HINTS[next]}`;
}

const NUDGE = { ArrowUp: [0, -1], ArrowDown: [0, 1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

function pin(end) {
  const place = state[end];
  if (place === null) {
    pins[end]?.remove();
    delete pins[end];
    return;
  }
  const called = end === "from" ? "Start" : "Destination";
  if (!pins[end]) {
    const button = make(
      "button",
      { type: "button", class: `pin pin-${end}` },
      make("span", { text: end === "from" ? "A" : "B" }),
    );
    const marker = new gl.Marker({ element: button, draggable: true, anchor: "bottom" });
    marker.on("dragend", () => {
      const { lng, lat } = marker.getLngLat();
      change({ [end]: { lon: lng, lat, name: "" } });
    });
    button.addEventListener("keydown", (event) => {
      const step = NUDGE[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      const point = map.project(marker.getLngLat());
      const { lng, lat } = map.unproject([point.x + 12 * step[0], point.y + 12 * step[1]]);
      change({ [end]: { lon: lng, lat, name: "" } });
    });
    pins[end] = marker.setLngLat([place.lon, place.lat]).addTo(map);
    button.setAttribute("role", "button"); // MapLibre's own role would hide that it can be pressed
  }
  pins[end].setLngLat([place.lon, place.lat]);
  pins[end]
    .getElement()
    .setAttribute(
      "aria-label",
      `${called}${place.name ? `, ${place.name}` : ""}: drag it, or move it with the arrow keys`,
    );
  pins[end].getElement().title = place.name || called;
}

let walker = null;

/** Put the walker somewhere, or away (null). */
export function putWalker(place) {
  if (!map) return;
  if (place === null) {
    walker?.remove();
    walker = null;
    return;
  }
  walker ??= new gl.Marker({ element: make("div", { class: "walker" }) }).setLngLat(place).addTo(map);
  walker.getElement().removeAttribute("role");
  walker.getElement().setAttribute("aria-hidden", "true");
  walker.getElement().removeAttribute("aria-label");
  walker.setLngLat(place);
}

/** What is nearest to a point of the map, of some layers. */
function nearest(point, layer) {
  const box = [
    [point.x - 8, point.y - 8],
    [point.x + 8, point.y + 8],
  ];
  return map.queryRenderedFeatures(box, { layers: [layer] })[0]?.properties ?? null;
}

/** What is said of a place that is clicked, as it is now: a sensor or street, and its crowd. */
function wordsOf(sensor, street) {
  if (sensor !== null) {
    const { count } = data.sensors.features.find(({ properties }) => properties.sensor === sensor)?.properties ?? {};
    return [
      `Sensor ${sensor}`,
      Number.isFinite(count) ? `${Math.round(count)} persons/h counted` : "nothing counted lately",
    ];
  }
  if (street === null) return ["Here", ""];
  const name = street.name || street.kind || "street";
  if (!exact) return [name, "…"];
  const density = shown.density[street.street] ?? 0;
  return [name, `${town.crowding[crowding(density)].word}, ${density.toFixed(density < 1 ? 2 : 1)} persons/m²`];
}

let popup = null;
let said = () => {}; // says anew what is said of the place that was clicked

function clicked(event) {
  const { lng, lat } = event.lngLat;
  const place = { lon: lng, lat, name: "" };
  const next = active ?? (state.from === null ? "from" : state.to === null ? "to" : null);
  popup?.remove();
  if (next !== null) {
    active = null;
    put(next, place);
    hint();
    return;
  }
  const [sensor, street] = [nearest(event.point, "sensors")?.sensor ?? null, nearest(event.point, "streets")];
  const [title, crowd] = [make("b"), make("span", { id: "here-crowd" })];
  said = () => ([title.textContent, crowd.textContent] = wordsOf(sensor, street));
  said();
  const choose = (end, text) =>
    make("button", {
      type: "button",
      class: "chip",
      text,
      onclick: () => {
        popup.remove();
        put(end, place);
      },
    });
  popup = new gl.Popup({ closeButton: false, maxWidth: "300px", offset: 8 })
    .setLngLat(event.lngLat)
    .setDOMContent(
      make(
        "div",
        { class: "here" },
        make("p", {}, title, crowd),
        make("div", { class: "row" }, choose("from", "Start here"), choose("to", "Go here"), choose("avoid", "Avoid")),
      ),
    )
    .addTo(map);
}

function withoutMap(sentence) {
  byId("no-map").textContent = sentence;
  byId("no-map").hidden = false;
  document.querySelector(".map-tools").hidden = true;
  document.documentElement.dataset.map = "none";
}

/** Load the library, and have it start its workers while the rest of the page is on its way. */
export async function loadMap() {
  const library = await import("./vendor/maplibre-gl.mjs");
  library.prewarm();
  return library;
}

/** Begin; resolves when the map is drawn, or cannot be. */
export async function startMap(facts, geometry, library) {
  [town, streets] = [facts, geometry];
  data.names = { type: "FeatureCollection", features: namedLines(streets.features) };
  classes = [];
  try {
    gl = await library;
  } catch {
    withoutMap(
      "The files of the map are missing here; in a checkout of Sidestep, make page fetches them. Everything else on this page works without them.",
    );
    return;
  }
  try {
    map = new gl.Map({
      container: "map",
      style: style(streets, data),
      bounds: town.bounds,
      fitBoundsOptions: { padding: padding() },
      attributionControl: false,
      maxPitch: 0,
      dragRotate: false,
      pitchWithRotate: false,
      minZoom: 9,
      maxZoom: 19,
      fadeDuration: calm() ? 0 : 200,
      locale: { "Map.Title": `Streets of ${town.name}` },
    });
  } catch {
    map = null;
    withoutMap("This browser cannot draw the map: WebGL is off. Routes, times and crowds are in the tables.");
    return;
  }
  map.touchZoomRotate.disableRotation();
  map.keyboard.disableRotation();
  map
    .getCanvas()
    .setAttribute(
      "aria-label",
      `Map of the streets of ${town.name}, coloured by crowding; arrow keys move it, plus and minus zoom`,
    );
  if (state.camera) goTo(state.camera);
  else frame(framed);
  map.on("movestart", ({ originalEvent }) => originalEvent && ([framed, ours] = [[], false]));
  map.on("moveend", () => {
    const { lng, lat } = map.getCenter();
    change({ camera: { zoom: map.getZoom(), lat, lon: lng } });
  });
  map.on("click", clicked);
  map.on("mousemove", "streets", () => (map.getCanvas().style.cursor = "pointer"));
  map.on("mouseleave", "streets", () => (map.getCanvas().style.cursor = ""));
  byId("zoom-in").addEventListener("click", () => map.zoomIn());
  byId("zoom-out").addEventListener("click", () => map.zoomOut());
  byId("whole").addEventListener("click", wholeTown);
  onTheme(repaint);
  onCrowds("crowds", colour);
  onCrowds("crowds", () => said());
  onChange((changed) => {
    for (const end of ["from", "to"]) if (changed.has(end)) pin(end);
    if (changed.has("from") || changed.has("to")) hint();
  });
  await new Promise((ready) => map.once("load", ready));
  pin("from");
  pin("to");
  hint();
  if (shown) colour(shown);
  for (const name of Object.keys(data)) map.getSource(name)?.setData(data[name]);
  document.documentElement.dataset.map = "drawn";
}
