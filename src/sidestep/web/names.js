// Streets are cut at every crossing, and a name needs a longer line to stand on: parts of one name that go on into
// each other are joined.

const STRAIGHT = 45; // degrees by which a street may turn at a crossing

const key = ([lon, lat]) => `${lon.toFixed(6)},${lat.toFixed(6)}`;

function heading([lon, lat], [otherLon, otherLat]) {
  return (Math.atan2((otherLon - lon) * Math.cos((lat * Math.PI) / 180), otherLat - lat) * 180) / Math.PI;
}

/** How much a walker turns who goes on from one line into the other, degrees. */
function turn(one, other) {
  const before = heading(one.at(-2), one.at(-1));
  const after = heading(other[0], other[1]);
  return Math.abs(((after - before + 540) % 360) - 180);
}

/** Join a line with the straightest of the others, or find none. */
function extended(line, others) {
  let best = null;
  for (const other of others) {
    for (const end of [other, [...other].reverse()]) {
      if (key(line.at(-1)) !== key(end[0])) continue;
      const angle = turn(line, end);
      if (angle < STRAIGHT && (best === null || angle < best.angle)) best = { other, end, angle };
    }
  }
  if (best === null) return null;
  others.splice(others.indexOf(best.other), 1);
  return [...line, ...best.end.slice(1)];
}

/** Lines for the names of streets. */
export function namedLines(features) {
  const named = new Map();
  for (const { properties, geometry } of features) {
    if (!properties.name || geometry.coordinates.length < 2) continue;
    if (!named.has(properties.name)) named.set(properties.name, []);
    named.get(properties.name).push({ line: geometry.coordinates, metres: properties.metres });
  }
  const lines = [];
  for (const [name, parts] of named) {
    const metres = parts.reduce((sum, part) => sum + part.metres, 0);
    const left = parts.map((part) => part.line);
    while (left.length > 0) {
      let line = left.pop();
      for (const backwards of [false, true]) {
        if (backwards) line = [...line].reverse();
        for (let next = extended(line, left); next !== null; next = extended(line, left)) line = next;
      }
      lines.push({
        type: "Feature",
        geometry: { type: "LineString", coordinates: line },
        properties: { name, metres },
      });
    }
  }
  return lines;
}
