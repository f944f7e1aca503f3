// Leaflet Routing Machine in a page without a screen: routes, their texts, and the whole control on a map.
// node leaflet.mjs BASE '{"walks": [[[LAT, LON], ...], ...], "outside": [[LAT, LON], ...], "parameters": {...}}'
import { createRequire } from "node:module";
import { JSDOM } from "jsdom";

const [base, given] = process.argv.slice(2);
const { walks, outside, parameters } = JSON.parse(given);
const { window } = new JSDOM('<div id="map"></div>', { url: base, pretendToBeVisual: true });
const asked = [];
class Recorded extends window.XMLHttpRequest {
  open(method, url, ...more) {
    asked.push(url);
    super.open(method, url, ...more);
  }
}
window.XMLHttpRequest = Recorded;
Object.assign(globalThis, { window, document: window.document, location: window.location });
const require = createRequire(import.meta.url);
const L = (globalThis.L = window.L = require("leaflet"));
require("leaflet-routing-machine");

const serviceUrl = `${base}/route/v1`;
const router = L.Routing.osrmv1({ serviceUrl, profile: "foot", requestParameters: parameters });
const formatter = new L.Routing.Formatter();

const route = (places, options, by = router) =>
  new Promise((resolve) => {
    const waypoints = places.map((place) => L.Routing.waypoint(L.latLng(place)));
    by.route(
      waypoints,
      (error, routes) =>
        resolve({
          error,
          routes: routes?.map(({ name, summary, coordinates, instructions, waypoints, waypointIndices }) => ({
            name,
            summary,
            waypointIndices,
            coordinates: coordinates.map(({ lat, lng }) => [lat, lng]),
            waypoints: waypoints.map(({ latLng: { lat, lng } }) => [lat, lng]),
            instructions: instructions.map((each, number) => ({
              ...each,
              icon: formatter.getIconName(each, number),
              said: formatter.formatInstruction(each, number),
            })),
          })),
        }),
      null,
      options,
    );
  });

const found = [];
for (const places of walks) found.push(await route(places));
const again = await route(walks[0]); // now with the hints of the answer before
const line = await route(walks[0], { geometryOnly: true, allowUTurns: true });
const refused = await route(outside);

const map = L.map("map").setView(walks[0][0], 15);
const control = L.Routing.control({ waypoints: walks[0].map((place) => L.latLng(place)), router, fitSelectedRoutes: false });
const lines = await new Promise((resolve, reject) => {
  control.on("routeselected", () => setTimeout(() => resolve(document.querySelectorAll("path").length)));
  control.on("routingerror", (event) => reject(new Error(JSON.stringify(event.error))));
  control.addTo(map);
});
const rows = [...document.querySelectorAll(".leaflet-routing-alt:not(.leaflet-routing-alt-minimized) tr")].map(
  (row) => row.textContent,
);
console.log(JSON.stringify({ asked, found, again, line, refused, control: { lines, rows } }));
process.exit(0); // the page's timers go on
