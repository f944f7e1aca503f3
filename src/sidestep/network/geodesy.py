"""Longitude and latitude in metres: great-circle distances, and a plane for a town."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

EARTH_RADIUS = 6_371_008.8
"""Mean radius of the Earth in metres."""


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
        centre = (lonlat.min(axis=0) + lonlat.max(axis=0)) / 2
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
        return (np.asarray(lonlat, np.float64) - self.centre) * self.scale

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
        return xy / self.scale + self.centre


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
