"""Polygons that people draw on maps, as GeoJSON (RFC 7946), and the streets that cross them."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from sidestep.errors import SidestepError
from sidestep.files import reading
from sidestep.network.geodesy import HALF_CIRCLE, Projection
from sidestep.network.snapping import SplitStreets
from sidestep.network.town import Town

DEEPEST = 100
"""Collections within collections beyond which a file is refused."""
_LISTS = (list, tuple)  # from Python lists of JSON may be tuples, as in shapely's __geo_interface__


class PolygonError(SidestepError):
    """A polygon that is none, or that lies elsewhere."""


@dataclass(frozen=True, eq=False)
class Polygons:
    """Some polygons, which may have holes and overlap."""

    shape: shapely.Geometry
    """All of them as one; longitudes, continuous in the town, and latitudes in degrees."""
    town: Town
    """The streets that they are about."""

    @property
    def rings(self) -> list[list[list[list[float]]]]:
        """Of each polygon its outer ring and its holes, as GeoJSON has them in a MultiPolygon."""
        return _geojson(self.shape)

    def contains(self, lonlat: Float[np.ndarray, "point 2"]) -> Bool[np.ndarray, " point"]:
        """Which points lie inside; longitudes and latitudes in degrees."""
        return np.asarray(shapely.intersects_xy(self.shape, _continuous(lonlat, self.town)))

    def crossed(self, streets: SplitStreets) -> Bool[np.ndarray, " segment"]:
        """Find the segments whose course leads through the inside of a polygon.

        Parameters
        ----------
        streets
            The streets of a town, some of them split.

        Returns
        -------
        Bool[np.ndarray, " segment"]
            Of split streets each piece on its own. A street along the border is not crossed.
        """
        town = streets.town
        found = self._crosses(town.points, np.repeat(np.arange(town.streets), np.diff(town.first)))[streets.street]
        split = np.flatnonzero(found & (streets.fraction < 1))
        if len(split):
            courses = [streets.course(segment) for segment in split.tolist()]
            piece = np.repeat(np.arange(len(split)), list(map(len, courses)))
            found[split] = self._crosses(np.concatenate(courses), piece)
        return found

    def _crosses(self, points: Float[np.ndarray, "point 2"], line: Int[np.ndarray, " point"]) -> Bool[np.ndarray, "n"]:
        """Which lines do; ``line`` is the number of the line of each point."""
        lines = shapely.linestrings(_continuous(points, self.town), indices=line)
        shapely.prepare(self.shape)
        return np.asarray(shapely.intersects(self.shape, lines) & ~shapely.touches(self.shape, lines))


def read_polygons(given: Path | str | dict[str, Any], town: Town) -> Polygons:
    """Read the polygons of a GeoJSON file.

    Parameters
    ----------
    given
        The file, or its content: a polygon or several, as geometries, as features or as collections of them.
    town
        The streets that they are about.

    Returns
    -------
    Polygons
        All of them.

    Raises
    ------
    PolygonError
        No file, other content than polygons, polygons that cross themselves or are not closed, coordinates that are no
        degrees, and latitudes where longitudes belong.
    """
    if isinstance(given, dict):
        return _polygons(given, town)
    with reading(Path(given), PolygonError, "GeoJSON") as file:
        try:
            content = json.load(file)
        except RecursionError as error:
            raise PolygonError("its values are nested too deeply") from error
        return _polygons(content, town)


def _polygons(content: object, town: Town) -> Polygons:
    found = [_polygon(rings, town) for rings in _rings(content)]
    if not found:
        raise PolygonError("there is no polygon in it; draw one")
    shape = shapely.union_all(found)
    if not _near(shape, town) and _near(shapely.transform(shape, lambda points: points[:, ::-1]), town):
        raise PolygonError(_swapped(town))
    return Polygons(shape, town)


def _rings(content: object, depth: int = 0) -> Iterator[list[Any]]:
    """The rings of each polygon, as they stand in GeoJSON."""
    kind = content.get("type") if isinstance(content, dict) else None
    if not isinstance(content, dict) or depth > DEEPEST:
        raise PolygonError("it must be a GeoJSON object with a polygon")
    match kind:
        case "FeatureCollection" | "GeometryCollection":
            for member in _list(content, "features" if kind == "FeatureCollection" else "geometries"):
                yield from _rings(member, depth + 1)
        case "Feature":
            yield from _rings(content.get("geometry"), depth + 1)
        case "Polygon":
            yield _list(content, "coordinates")
        case "MultiPolygon":
            for rings in _list(content, "coordinates"):
                yield list(rings) if isinstance(rings, _LISTS) else [rings]
        case _:
            raise PolygonError(f"an area must be a Polygon or MultiPolygon, not {kind!r:.40}")


def _list(content: dict[str, Any], member: str) -> list[Any]:
    """A member that has to be a list."""
    if not isinstance(found := content.get(member), _LISTS):
        raise PolygonError(f"{content['type']} needs a list of {member}")
    return list(found)


def _polygon(rings: list[Any], town: Town) -> shapely.Geometry:
    """One polygon: its outer ring, and its holes."""
    if not rings:
        raise PolygonError("a polygon must have a ring, not none")
    polygon = _of_rings([_ring(ring, town) for ring in rings])
    if not shapely.is_valid(polygon):
        raise PolygonError(f"a polygon is not valid: {shapely.is_valid_reason(polygon)}")
    return polygon


def _of_rings(rings: Iterable[Float[np.ndarray, "_ 2"]]) -> shapely.Polygon:
    outer, *holes = map(shapely.linearrings, rings)  # which may have different numbers of points
    return shapely.polygons(outer, holes=holes or None)


def _ring(ring: Any, town: Town) -> Float[np.ndarray, "point 2"]:
    numbers = isinstance(ring, _LISTS) and all(
        isinstance(point, _LISTS)
        and len(point) >= 2
        and all(isinstance(each, (int, float)) and not isinstance(each, bool) for each in point[:2])
        for point in ring
    )
    if not numbers:
        raise PolygonError("a ring must be a list of [longitude, latitude]")
    try:
        points = np.array([point[:2] for point in ring], np.float64).reshape(-1, 2)
    except OverflowError as error:
        raise PolygonError("a number of it is too large") from error
    if np.isnan(points).any():
        raise PolygonError("a longitude or latitude is no number")
    if len(points) < 4 or (points[0] != points[-1]).any():
        raise PolygonError("a ring needs at least four points, of which the last is the first")
    if not (np.abs(points) <= (180, 90)).all():
        if (np.abs(points) <= (90, 180)).all() and _near(shapely.box(*points.min(0)[::-1], *points.max(0)[::-1]), town):
            raise PolygonError(_swapped(town))
        raise PolygonError(
            "points must be longitude -180 to 180 and latitude -90 to 90; convert other systems of reference to these"
        )
    return _continuous(points, town)


def _near(shape: shapely.Geometry, town: Town) -> bool:
    """Whether the box around a shape meets that around a town."""
    place = _continuous(town.place, town)
    (west, south), (east, north) = place.min(axis=0), place.max(axis=0)
    return bool(shapely.intersects(shapely.box(*shapely.bounds(shape)), shapely.box(west, south, east, north)))


def _continuous(lonlat: Float[np.ndarray, "point 2"], town: Town) -> Float[np.ndarray, "point 2"]:
    """The same places; in towns on the antimeridian longitudes go on beyond 180°: no line leads round the world."""
    across = np.ptp(town.place[:, 0]) > HALF_CIRCLE
    return town.projection.continuous(lonlat) if across else np.asarray(lonlat, np.float64)


def in_degrees(areas: Sequence[Sequence[Float[np.ndarray, "_ 2"]]], plane: Projection) -> list[list[list[list[float]]]]:
    """Write polygons in degrees, split at the antimeridian as GeoJSON wants it (RFC 7946, section 3.1.9).

    Parameters
    ----------
    areas
        Of each polygon the outer ring, anticlockwise, and its holes, clockwise; metres on the plane.
    plane
        About the middle of the town.

    Returns
    -------
    list
        Polygons, of those across the antimeridian one on either side: their rings as lists of longitude and latitude.
    """
    xy = np.concatenate([np.zeros((0, 2)), *(ring for rings in areas for ring in rings)])  # at once: there may be many
    lonlat = xy / plane.scale + plane.centre
    if (np.abs(lonlat[:, 0]) <= HALF_CIRCLE).all():
        points = iter(np.round(lonlat, 7).tolist())
        return [[list(islice(points, len(ring))) for ring in rings] for rings in areas]
    polygons = [_of_rings(ring / plane.scale + plane.centre for ring in rings) for rings in areas]
    return [[np.round(ring, 7).tolist() for ring in side] for polygon in polygons for side in _geojson(polygon)]


def _geojson(shape: shapely.Geometry) -> list[list[list[list[float]]]]:
    """The polygons of a shape whose longitudes may go on beyond 180°, split at the antimeridian."""
    world = shapely.box(-HALF_CIRCLE, -90, HALF_CIRCLE, 90)
    sides = [shape]
    if not shapely.covers(world, shape):
        turns = [np.array([turn, 0.0]) for turn in (-2 * HALF_CIRCLE, 0.0, 2 * HALF_CIRCLE)]
        sides = [shapely.intersection(shapely.transform(shape, partial(np.add, turn)), world) for turn in turns]
    found = [part for part in shapely.get_parts(sides) if part.geom_type == "Polygon" and not part.is_empty]
    return [
        [shapely.get_coordinates(ring).tolist() for ring in (part.exterior, *part.interiors)]
        for part in shapely.orient_polygons(found)
    ]


def _swapped(town: Town) -> str:
    longitude, latitude = town.place[0]
    said = "latitude and longitude are swapped: GeoJSON has the longitude first"
    return f"{said}, such as [{longitude:.4f}, {latitude:.4f}] in this town"
