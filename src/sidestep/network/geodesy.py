"""Longitude and latitude in metres: great-circle distances, and a plane for a town, on either side of 180°."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

EARTH_RADIUS = 6_371_008.8
"""Mean radius of the Earth in metres."""
HALF_CIRCLE = 180.0
"""Degrees of longitude from the prime meridian to the antimeridian."""


@dataclass(frozen=True, eq=False)
class Projection:
    """The equirectangular projection about a centre: metres east and north of it.

    It keeps the scale of the centre's latitude. At 60°, lengths from east to west are off by 0.8 % 30 km north or south
    of the centre.
    """

    centre: Float[np.ndarray, "2"]
    """Longitude and latitude in degrees."""
    scale: Float[np.ndarray, "2"]
    """Metres per degree of longitude and of latitude."""

    @classmethod
    def of(cls, lonlat: Float[np.ndarray, "point 2"]) -> "Projection":
        """Project about the middle of some points' bounding box.

        Parameters
        ----------
        lonlat
            Longitudes and latitudes in degrees, at least one.

        Returns
        -------
        Projection
            The plane.
        """
        low, high = lonlat.min(axis=0), lonlat.max(axis=0)
        if high[0] - low[0] > HALF_CIRCLE:  # the shorter way from one to the other leads across the antimeridian
            east = lonlat[lonlat[:, 0] < 0, 0].max() + 2 * HALF_CIRCLE
            low[0], high[0] = lonlat[lonlat[:, 0] >= 0, 0].min(), east
        centre = (low + high) / 2
        _wrap(centre)
        return cls(centre, np.radians(EARTH_RADIUS) * np.array([np.cos(np.radians(centre[1])), 1.0]))

    def project(self, lonlat: Float[np.ndarray, "*point 2"]) -> Float[np.ndarray, "*point 2"]:
        """Convert degrees to metres.

        Parameters
        ----------
        lonlat
            Longitudes and latitudes in degrees.

        Returns
        -------
        Float[np.ndarray, "*point 2"]
            Metres east and north of the centre.
        """
        away = np.asarray(lonlat, np.float64) - self.centre
        _wrap(away)
        return away * self.scale

    def continuous(self, lonlat: Float[np.ndarray, "*point 2"]) -> Float[np.ndarray, "*point 2"]:
        """Let longitudes go on beyond 180° where the shorter way from the centre leads across the antimeridian.

        Parameters
        ----------
        lonlat
            Longitudes and latitudes in degrees.

        Returns
        -------
        Float[np.ndarray, "*point 2"]
            The same places without a jump between them.
        """
        away = np.asarray(lonlat, np.float64) - self.centre
        _wrap(away)
        return away + self.centre

    def unproject(self, xy: Float[np.ndarray, "*point 2"]) -> Float[np.ndarray, "*point 2"]:
        """Convert metres back to degrees.

        Parameters
        ----------
        xy
            Metres east and north of the centre.

        Returns
        -------
        Float[np.ndarray, "*point 2"]
            Longitudes and latitudes in degrees.
        """
        lonlat = xy / self.scale + self.centre
        _wrap(lonlat)
        return lonlat


def heading(start: Sequence[float], end: Sequence[float]) -> tuple[float, float]:
    """Find the way from one place to another near by, in the plane.

    Parameters
    ----------
    start, end
        Longitude and latitude in degrees.

    Returns
    -------
    float, float
        Its bearing, in degrees clockwise from north, and its length in metres.
    """
    (west, south), (east, north) = start, end
    right = ((east - west + HALF_CIRCLE) % (2 * HALF_CIRCLE) - HALF_CIRCLE) * math.cos(math.radians(north))
    up = north - south
    return math.degrees(math.atan2(right, up)) % 360, EARTH_RADIUS * math.radians(math.hypot(right, up))


def metres_between(
    start: Float[np.ndarray, "point 2"], end: Float[np.ndarray, "point 2"]
) -> Float[np.ndarray, " point"]:
    """Compute great-circle distances, pair by pair.

    Parameters
    ----------
    start, end
        Longitudes and latitudes in degrees.

    Returns
    -------
    Float[np.ndarray, " point"]
        Metres.
    """
    (lon_a, lat_a), (lon_b, lat_b) = np.radians(start).T, np.radians(end).T
    a = np.sin((lat_b - lat_a) / 2) ** 2 + np.cos(lat_a) * np.cos(lat_b) * np.sin((lon_b - lon_a) / 2) ** 2
    return 2 * EARTH_RADIUS * np.arcsin(np.sqrt(np.minimum(a, 1)))


def split_at_antimeridian(points: Sequence[Sequence[float]]) -> list[list[list[float]]]:
    """Split a line where it crosses the antimeridian, as GeoJSON wants it (RFC 7946, section 3.1.9).

    Parameters
    ----------
    points
        Longitudes and latitudes in degrees.

    Returns
    -------
    list
        The lines on either side; one for a line that does not cross it.
    """
    lines = [[list(points[0])]]
    for (lon, lat), (to_lon, to_lat) in pairwise(points):
        if abs(to_lon - lon) > HALF_CIRCLE:
            side = HALF_CIRCLE if lon > 0 else -HALF_CIRCLE
            beyond = to_lon + 2 * side  # seen from this side
            share = (side - lon) / (beyond - lon) if beyond != lon else 0.0
            crossing = round(lat + share * (to_lat - lat), 7)
            if lon != side:
                lines[-1].append([side, crossing])
            lines.append([[-side, crossing]])
            if to_lon == -side:
                continue
        lines[-1].append([to_lon, to_lat])
    return [line for line in lines if len(line) > 1]


def line_geometry(points: Sequence[Sequence[float]]) -> dict[str, object]:
    """Write a line as a GeoJSON geometry.

    Parameters
    ----------
    points
        Longitudes and latitudes in degrees.

    Returns
    -------
    dict
        A LineString, or a MultiLineString where it crosses the antimeridian.
    """
    lines = split_at_antimeridian(points) if len(points) else []
    if len(lines) > 1:
        return {"type": "MultiLineString", "coordinates": lines}
    return {"type": "LineString", "coordinates": points}


def course_lengths(
    points: Float[np.ndarray, "point 2"], first: Int[np.ndarray, " border"]
) -> Float[np.ndarray, " street"]:
    """Compute the lengths of courses.

    Parameters
    ----------
    points
        Longitudes and latitudes in degrees of all courses, one course after another.
    first
        Index in ``points`` where each course begins, and at last the number of points.

    Returns
    -------
    Float[np.ndarray, " street"]
        Metres.
    """
    legs = metres_between(points[:-1], points[1:])
    legs[first[1:-1] - 1] = 0  # from the end of one course to the start of the next
    return np.add.reduceat(np.append(legs, 0.0), first[:-1]) if len(first) > 1 else np.zeros(0)


def _wrap(lonlat: Float[np.ndarray, "*point 2"]) -> None:
    """Turn longitudes beyond 180° into those of the shorter way round, in place; others stay as they are."""
    lonlat[..., 0] -= 2 * HALF_CIRCLE * np.rint(lonlat[..., 0] / (2 * HALF_CIRCLE))
