"""Walks that begin and end in the middle of streets: the nearest street, and streets split at points on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import jax
import numpy as np
import shapely
from jaxtyping import Bool, Float, Float64, Int
from shapely.ops import substring

from sidestep.network.graph import ABSENT, SHUT, Areas, RoadNetwork
from sidestep.network.town import Town, TownError

FARTHEST = 250.0
"""Metres from the nearest street beyond which a place counts as outside the town."""
SAME_NODE = 1.0
"""Metres within which a point on a street counts as the crossing, or the other point, that is there."""


@dataclass(frozen=True)
class StreetPoint:
    """A point on a street."""

    street: int
    """Number of the street in its town."""
    fraction: float
    """Of the street's length, from its tail."""
    distance: float
    """Metres from the place that was asked for."""
    place: tuple[float, float]
    """Latitude and longitude in degrees."""


@dataclass(frozen=True, eq=False)
class Snapper:
    """Find the nearest street of a town. Its index is built once; a query takes well under a millisecond."""

    town: Town
    """The town whose streets are searched."""

    def nearest(self, latitude: float, longitude: float, farthest: float = FARTHEST) -> StreetPoint:
        """Find the nearest point on a street.

        Parameters
        ----------
        latitude, longitude
            Degrees, WGS 84.
        farthest
            Largest distance in metres.

        Returns
        -------
        StreetPoint
            The point on the street.

        Raises
        ------
        TownError
            Invalid coordinates, or no street within ``farthest``.
        """
        if not (-90 <= latitude <= 90 and -180 <= longitude <= 180):
            said = (
                f"{_named(latitude, longitude)} is not a valid place{self._if_swapped(latitude, longitude, farthest)}"
            )
            said += ": latitudes are -90 to 90 degrees, longitudes -180 to 180"
            raise TownError(said, field="place")
        town, tree = self.town, self._index
        here = shapely.Point(town.project(np.array([longitude, latitude])))
        candidates, (distance, *_) = tree.query_nearest(here, return_distance=True)
        if distance > farthest:
            if swapped := self._if_swapped(latitude, longitude, farthest):
                raise TownError(f"{_named(latitude, longitude)} is not in this town{swapped}", field="place")
            xy = town.project(town.place)
            (west, south), (east, north) = town.projection.unproject(np.stack([xy.min(axis=0), xy.max(axis=0)]))
            limits = f"(latitude {south:.4f} to {north:.4f}, longitude {west:.4f} to {east:.4f})"
            away = f"{distance:,.0f} m from the nearest street, so it is not in this town"
            raise TownError(f"{_named(latitude, longitude)} is {away} {limits}", field="place")
        street = int(candidates.min())  # of streets that meet at the nearest crossing, always the same one
        return self._on_street(street, here, float(distance))

    def several(self, latitude: float, longitude: float, number: int, farthest: float = FARTHEST) -> list[StreetPoint]:
        """Find the nearest points on several streets.

        Parameters
        ----------
        latitude, longitude, farthest
            As for :meth:`nearest`.
        number
            Of streets.

        Returns
        -------
        list of StreetPoint
            One for each street, the nearest first; fewer where there are not so many.
        """
        tree, here = self._index, shapely.Point(self.town.project(np.array([longitude, latitude])))
        streets = np.sort(tree.query(here, "dwithin", farthest))
        distance = shapely.distance(tree.geometries[streets], here)
        order = np.argsort(distance, kind="stable")[:number]
        return [self._on_street(int(streets[each]), here, float(distance[each])) for each in order]

    def _on_street(self, street: int, here: shapely.Point, distance: float) -> StreetPoint:
        """The point of a street that is nearest to a place in metres."""
        line = self._index.geometries[street]
        along = shapely.line_locate_point(line, here)
        on_street = shapely.get_coordinates(shapely.line_interpolate_point(line, along))[0]
        longitude, latitude = self.town.projection.unproject(on_street).tolist()
        fraction = float(along) / max(line.length, 1e-12)  # two crossings may be at the same place
        return StreetPoint(street, fraction, distance, (latitude, longitude))

    def at(self, street: int, fraction: float, latitude: float, longitude: float) -> StreetPoint:
        """Give a point of a street again that was found before.

        Parameters
        ----------
        street, fraction
            Of the point.
        latitude, longitude
            Degrees of the place that it was found for.

        Returns
        -------
        StreetPoint
            The point.
        """
        here = shapely.Point(self.town.project(np.array([longitude, latitude])))
        there = shapely.line_interpolate_point(self._index.geometries[street], fraction, normalized=True)
        place = self.town.projection.unproject(shapely.get_coordinates(there)[0]).tolist()
        return StreetPoint(street, fraction, float(shapely.distance(here, there)), (place[1], place[0]))

    def bearing(self, point: StreetPoint) -> float:
        """Give the bearing of a street at a point on it.

        Parameters
        ----------
        point
            On a street.

        Returns
        -------
        float
            Degrees clockwise from north, from the street's tail to its head.
        """
        line = self._index.geometries[point.street]
        along = np.clip(point.fraction * line.length + np.array([-1.0, 1.0]), 0.0, line.length)
        (west, south), (east, north) = shapely.get_coordinates(shapely.line_interpolate_point(line, along))
        return float(np.degrees(np.arctan2(east - west, north - south)) % 360)

    def is_swapped(self, latitude: float, longitude: float) -> bool:
        """Tell whether a place that is not in this town is, with latitude and longitude the other way round.

        Parameters
        ----------
        latitude, longitude
            Degrees.

        Returns
        -------
        bool
            Whether both must be exchanged.
        """
        return bool(self._if_swapped(latitude, longitude, FARTHEST))

    def _if_swapped(self, latitude: float, longitude: float, farthest: float) -> str:
        """What to say where latitude and longitude are the wrong way round; "" where they are not."""
        if not (-90 <= longitude <= 90 and -180 <= latitude <= 180):
            return ""
        there = shapely.Point(self.town.project(np.array([latitude, longitude], float)))
        _, (distance, *_) = self._index.query_nearest(there, return_distance=True)
        return ", but the other way round it is; swap the two" if distance <= farthest else ""

    @cached_property
    def _index(self) -> shapely.STRtree:
        """All courses in metres, as a tree."""
        street = np.repeat(np.arange(self.town.streets), np.diff(self.town.first))
        lines = shapely.linestrings(self.town.project(self.town.points), indices=street)
        tree = shapely.STRtree(lines)
        tree.query(lines[0])  # GEOS builds the tree on the first query: before threads share it
        return tree


def _named(latitude: float, longitude: float) -> str:
    """Both numbers by name: people give them in either order."""
    return f"latitude {latitude:g}, longitude {longitude:g}"


@dataclass(frozen=True, eq=False)
class SplitStreets:
    """The streets of a town, some of them split at points.

    Nodes and segments of the town keep their numbers; a split segment keeps its number for its first piece.
    """

    town: Town
    """The town whose streets these are."""
    network: RoadNetwork
    """Its network with the points as additional nodes."""
    nodes: tuple[int, ...]
    """Node of each point, in the order given."""
    parent: Int[np.ndarray, " segment"]
    """Segment of the town that each segment is a piece of; its own number where it is whole."""
    street: Int[np.ndarray, " segment"]
    """Street of the town that each segment runs along."""
    begin: Float64[np.ndarray, " segment"]
    """Fraction of the street's length at which each segment begins."""
    end: Float64[np.ndarray, " segment"]
    """Fraction at which each segment ends; less than ``begin`` on segments from the street's head to its tail."""

    @property
    def begins_at_crossing(self) -> Bool[np.ndarray, " segment"]:
        """Which segments begin at a crossing of the town and not at a point where a street was split."""
        return (self.begin == 0.0) | (self.begin == 1.0)

    @property
    def fraction(self) -> Float64[np.ndarray, " segment"]:
        """Length of each segment as a fraction of its parent's."""
        return np.abs(self.end - self.begin)

    def course(self, segment: int) -> Float[np.ndarray, "point 2"]:
        """Give the course of one segment.

        Parameters
        ----------
        segment
            Its number.

        Returns
        -------
        Float[np.ndarray, "point 2"]
            Longitudes and latitudes in degrees, in walking direction.
        """
        return piece_of(self.town, int(self.street[segment]), float(self.begin[segment]), float(self.end[segment]))


def piece_of(town: Town, street: int, begin: float, end: float) -> Float[np.ndarray, "point 2"]:
    """Give the course of a part of a street.

    Parameters
    ----------
    town, street
        The street.
    begin, end
        Fractions of its length, from its tail, at which the part begins and ends.

    Returns
    -------
    Float[np.ndarray, "point 2"]
        Longitudes and latitudes in degrees, from ``begin`` to ``end``.
    """
    course = town.course(street)
    if abs(end - begin) == 1:
        return course if begin < end else course[::-1]
    piece = substring(shapely.LineString(town.project(course)), begin, end, normalized=True)
    return town.projection.unproject(shapely.get_coordinates(piece))


def middle_of(town: Town, street: int) -> tuple[float, float]:
    """Longitude and latitude, in degrees, of the middle of a street."""
    line = shapely.LineString(town.project(town.course(street)))
    middle = shapely.get_coordinates(shapely.line_interpolate_point(line, 0.5, normalized=True))[0]
    longitude, latitude = town.projection.unproject(middle).tolist()
    return longitude, latitude


def simplified(town: Town, points: Sequence[Sequence[float]], metres: float) -> list[list[float]]:
    """Leave out points of a course that change it little.

    Parameters
    ----------
    town, points
        Longitudes and latitudes in this town in degrees, two or more.
    metres
        By which the course may be off.

    Returns
    -------
    list
        Some of the points, the first and the last among them.
    """
    line = shapely.LineString(town.project(np.array(points, float)))
    kept = shapely.get_coordinates(line.simplify(metres))
    # Points that are kept stay as they are: the simplified line has them in their order.
    at, found = 0, []
    projected = shapely.get_coordinates(line)
    for place in kept:
        at += int(np.argmax((projected[at:] == place).all(axis=1)))
        found.append(list(points[at]))
    return found


class _Segments(NamedTuple):
    """The segments of a town."""

    network: RoadNetwork
    street: Int[np.ndarray, " segment"]
    backwards: Bool[np.ndarray, " segment"]
    """Whether each leads from its street's head to its tail."""
    exit_of: Int[np.ndarray, " segment"]
    """Which exit of its tail each is."""


@lru_cache(maxsize=4)
def _segments_of(town: Town) -> _Segments:
    """The segments of a town, made once."""
    network = town.network()
    exit_segment, exit_of = np.asarray(network.exit_segment), np.empty(network.segments, np.int32)
    node, rank = np.nonzero(exit_segment != ABSENT)
    exit_of[exit_segment[node, rank]] = rank
    return _Segments(network, *town.street_of_segment(), exit_of)


def split_streets(town: Town, points: Sequence[int | StreetPoint]) -> SplitStreets:
    """Split streets at points; a point within ``SAME_NODE`` metres of a node is that node.

    Parameters
    ----------
    town
        The streets.
    points
        Nodes of the town, or points on its streets.

    Returns
    -------
    SplitStreets
        The streets with a node at every point.
    """
    base, street, backwards, exit_of = _segments_of(town)
    nodes: list[int] = []
    new: list[Float[np.ndarray, 2]] = []
    stops: dict[int, list[tuple[float, int]]] = {}  # along the streets with points: fractions and nodes
    for point in points:
        if isinstance(point, int):
            nodes.append(point)
            continue
        tail, head, length = town.tail[point.street], town.head[point.street], float(town.length[point.street])
        there = stops.setdefault(point.street, [(0.0, int(tail)), (1.0, int(head))])
        away, node = min((abs(fraction - point.fraction) * length, node) for fraction, node in there)
        if away >= SAME_NODE:
            node = base.nodes + len(new)
            new.append(town.project(np.array(point.place[::-1])))
            there.append((point.fraction, node))
        nodes.append(node)
    with_points = np.zeros(town.streets, bool)
    with_points[list(stops)] = True
    # One row a piece: its parent, its tail and head, and the fractions at which it begins and ends.
    pieces: list[list[tuple[float, ...]]] = []
    for segment in np.flatnonzero(with_points[street]).tolist():
        along = sorted(stops[int(street[segment])], reverse=bool(backwards[segment]))
        pieces.append([(segment, tail, head, begin, end) for (begin, tail), (end, head) in pairwise(along)])
    first = np.reshape([each[0] for each in pieces], (-1, 5))
    added = np.reshape([piece for each in pieces for piece in each[1:]], (-1, 5))
    split = first[:, 0].astype(np.int64)
    rows = np.stack([np.arange(base.segments), base.tail, base.head, backwards, ~backwards], axis=1, dtype=np.float64)
    rows[split] = first
    rows = np.concatenate([rows, added])
    parent, tail, head = rows[:, :3].astype(np.int64).T
    begin, end = rows[:, 3:].T
    length, width = np.asarray(base.length)[parent] * np.abs(end - begin), np.asarray(base.width)[parent]
    # The exits of the town's crossings stay, but some lead to a point; the others are those of the points.
    exits = ((0, len(new)), (0, max(2 - base.exits, 0)))
    exit_node, exit_segment = (
        np.pad(np.asarray(each), exits, constant_values=ABSENT) for each in (base.exit_node, base.exit_segment)
    )
    exit_node[tail[split], exit_of[split]] = head[split]
    used = dict.fromkeys(range(base.nodes, base.nodes + len(new)), 0)
    for segment, node in enumerate(tail[base.segments :].tolist(), start=base.segments):
        exit_node[node, used[node]], exit_segment[node, used[node]] = head[segment], segment
        used[node] += 1
    position = np.concatenate([np.asarray(base.position), np.reshape(new, (-1, 2)).astype(np.float32)])
    ends = (tail.astype(np.int32), head.astype(np.int32), length.astype(np.float32), width)
    areas = _areas_of_pieces(base, len(position), parent, tail, head) or ()
    network = RoadNetwork(*jax.device_put((position, exit_node, exit_segment, *ends, *areas)))
    return SplitStreets(town, network, tuple(nodes), parent, street[parent], begin, end)


def _areas_of_pieces(
    base: RoadNetwork,
    nodes: int,
    parent: Int[np.ndarray, " segment"],
    tail: Int[np.ndarray, " segment"],
    head: Int[np.ndarray, " segment"],
) -> Areas | None:
    """Restricted areas where segments of ``base`` are split: a point in the middle of a restricted street is inside."""
    if base.area is None or base.enters is None:
        return None
    known, entered = np.asarray(base.area), np.asarray(base.enters)
    of_parent = np.where(entered == ABSENT, known[np.asarray(base.tail)], entered)[parent]
    area = np.full(nodes, ABSENT, np.int32)
    area[head] = np.maximum(of_parent, ABSENT)  # of the new nodes; those of the town are as before
    area[: base.nodes] = known
    return area, np.where((area[tail] == ABSENT) | (of_parent == SHUT), of_parent, ABSENT)
