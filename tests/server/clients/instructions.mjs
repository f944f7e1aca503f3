// osrm-text-instructions: every step of some routes in words, in several languages.
// node instructions.mjs BASE '["/route/v1/...", ...]'
import { createRequire } from "node:module";

const require = createRequire(import.meta.url);
const compiler = require("osrm-text-instructions")("v5");
const polyline = require("@mapbox/polyline");
const [base, given] = process.argv.slice(2);

const found = [];
for (const path of JSON.parse(given)) {
  const { routes } = await (await fetch(base + path)).json();
  for (const { legs, geometry } of routes) {
    const steps = legs.flatMap((leg, legIndex) =>
      leg.steps.map((step) => ({
        type: step.maneuver.type,
        name: step.name,
        location: step.maneuver.location,
        line: polyline.decode(step.geometry),
        ...Object.fromEntries(
          ["en", "de", "fi"].map((language) => [
            language,
            compiler.compile(language, step, { legIndex, legCount: legs.length }),
          ]),
        ),
      })),
    );
    found.push({ steps, line: geometry && polyline.decode(geometry) });
  }
}
console.log(JSON.stringify(found));
