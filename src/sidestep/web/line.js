// Lines on the ground: lists of longitudes and latitudes, with lengths in metres.

const METRES = 111195.08; // of a degree of latitude

const east = ([lon, lat], [otherLon]) => (otherLon - lon) * Math.cos((lat * Math.PI) / 180);

/** Metres from one point to another. */
export const metresBetween = (one, other) => Math.hypot(east(one, other), other[1] - one[1]) * METRES;

/** In which direction another point lies, degrees clockwise from north. */
export const bearing = (one, other) => ((Math.atan2(east(one, other), other[1] - one[1]) * 180) / Math.PI + 360) % 360;

/** Metres of a line. */
export const length = (line) => line.slice(1).reduce((sum, point, turn) => sum + metresBetween(line[turn], point), 0);

/** The part of a line up to its point nearest to a place, of such points the first. */
export function upTo(line, place) {
  let [best, at] = [Infinity, 0];
  line.forEach((point, turn) => {
    const away = metresBetween(point, place);
    if (turn > 0 && away < best - 0.5) [best, at] = [away, turn];
  });
  return line.slice(0, at + 1);
}

/** A point some metres along a line. */
export function along(line, metres) {
  let left = metres;
  for (let turn = 1; turn < line.length; turn += 1) {
    const part = metresBetween(line[turn - 1], line[turn]);
    if (left <= part && part > 0) {
      const share = left / part;
      return line[turn].map((value, axis) => line[turn - 1][axis] + share * (value - line[turn - 1][axis]));
    }
    left -= part;
  }
  return line.at(-1);
}

/** A closed ring, to the centimetre: walks keep areas of 50,000 bytes at most. */
const closed = (points) => [...points, points[0]].map((point) => point.map((degrees) => Number(degrees.toFixed(7))));

/** A rectangle along each straight part of a line, which ends some metres (a third of a short line) before its ends. */
export function strips(line, end) {
  const cut = Math.min(end, length(line) / 3);
  const [half, last] = [cut / 2, length(line) - cut]; // streets that meet it at 30° or more stay outside
  const found = [];
  let walked = 0;
  line.slice(1).forEach((point, turn) => {
    const part = metresBetween(line[turn], point);
    const [begin, stop] = [Math.max(cut - walked, 0), Math.min(last - walked, part)];
    walked += part;
    if (begin >= stop) return;
    const [one, other] = [along([line[turn], point], begin), along([line[turn], point], stop)];
    const [high, wide] = [half / METRES, half / METRES / Math.cos((one[1] * Math.PI) / 180)];
    const angle = (bearing(one, other) * Math.PI) / 180;
    const [x, y] = [wide * Math.cos(angle), -high * Math.sin(angle)];
    const corners = [
      [one[0] - x, one[1] - y],
      [other[0] - x, other[1] - y],
      [other[0] + x, other[1] + y],
      [one[0] + x, one[1] + y],
    ];
    found.push([closed(corners)]);
  });
  return found;
}

/** A polygon of all points that are some metres from a place. */
export function circle({ lon, lat, metres }, corners = 24) {
  const [high, wide] = [metres / METRES, metres / METRES / Math.cos((lat * Math.PI) / 180)];
  const ring = Array.from({ length: corners }, (_, turn) => (2 * Math.PI * turn) / corners).map((angle) => [
    lon + wide * Math.cos(angle),
    lat + high * Math.sin(angle),
  ]);
  return { type: "Polygon", coordinates: [closed(ring)] };
}
