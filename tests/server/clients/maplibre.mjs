// maplibre-gl-directions: its own requests and what it makes of the answers. The map itself, which needs a graphics
// card, is replaced by one that only keeps what would be drawn.
// node maplibre.mjs BASE '[{"waypoints": [[LON, LAT], ...], "configuration": {...}, "bearings": [...]}, ...]'
import MapLibreGlDirections from "@maplibre/maplibre-gl-directions";

const [base, given] = process.argv.slice(2);
const asked = [];
const fetched = globalThis.fetch;
globalThis.fetch = (url, ...more) => {
  asked.push(String(url));
  return fetched(url, ...more);
};

class DrawnMap {
  sources = {};
  layers = [];
  dragPan = { enable() {}, disable() {} };
  addSource(name) {
    this.sources[name] = { setData: (data) => (this.sources[name].data = data) };
  }
  getSource(name) {
    return this.sources[name];
  }
  addLayer(layer) {
    this.layers.push(layer.id);
  }
  on() {}
  off() {}
  once() {}
}

const found = [];
for (const { waypoints, configuration, bearings } of JSON.parse(given)) {
  const map = new DrawnMap();
  const directions = new MapLibreGlDirections(map, { api: `${base}/route/v1`, profile: "foot", ...configuration });
  let answer;
  directions.on("fetchroutesend", (event) => (answer = event.data?.directions));
  await directions.setWaypoints(waypoints);
  if (bearings) {
    const routed = new Promise((resolve) => directions.on("fetchroutesend", resolve));
    directions.waypointsBearings = bearings;
    await routed;
    await new Promise((resolve) => setTimeout(resolve));
  }
  found.push({ asked: asked.at(-1), answer, features: map.sources["maplibre-gl-directions"].data.features });
}
console.log(JSON.stringify(found));
