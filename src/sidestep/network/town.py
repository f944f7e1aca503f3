"""The streets of a real place, as plain arrays: what the importer makes, and what files hold."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int16, Int32, Int64

from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from sidestep.network.graph import RoadNetwork

EARTH_RADIUS = 6_371_008.8  # m, mean
SAME_DEGREES = 1e-7  # what OpenStreetMap can tell apart, about 1 cm


class TownError(SidestepError):
    """Streets that cannot be: says which part is wrong."""


@dataclass(frozen=True, eq=False)
class Town:
    """Crossings and the streets between them, each street once, whichever ways it is walked.

    The arrays are read-only, and whoever has a town may rely on this: streets join two different crossings, have a
    positive length and width, and their courses lead from tail to head.

    Raises
    ------
    TownError
        Arrays that do not belong together, unknown crossings, coordinates that are none, loops, lengths or widths
        that are not positive.
    """

    place: Float64[np.ndarray, "node 2"]  # longitude, latitude in degrees, WGS 84
    ids: Int64[np.ndarray, " node"]  # OpenStreetMap's; of the node that stands for a merged crossing
    tail: Int32[np.ndarray, " street"]  # node where a street begins
    head: Int32[np.ndarray, " street"]  # node where it ends
    one_way: Bool[np.ndarray, " street"]  # walked from tail to head only
    length: Float32[np.ndarray, " street"]  # m
    width: Float32[np.ndarray, " street"]  # m that walkers have
    kind: tuple[str, ...]  # OpenStreetMap's `highway`
    name: tuple[str, ...]  # "" where it has none
    signals: Int16[np.ndarray, " street"]  # crossings with traffic lights on the way along the street
    crossings: Int16[np.ndarray, " street"]  # crossings of vehicle traffic without lights
    points: Float64[np.ndarray, "point 2"]  # longitude, latitude: courses from tail to head, both ends included
    first: Int64[np.ndarray, " border"]  # where each street's course begins in `points`
    attribution: str  # whose data it is, and under which licence

    def __post_init__(self) -> None:
        _check(self)
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def nodes(self) -> int:
        """Number of crossings."""
        return len(self.ids)

    @property
    def streets(self) -> int:
        """Number of streets, each counted once."""
        return len(self.tail)

    @property
    def kilometres(self) -> float:
        """Length of all streets in kilometres."""
        return float(self.length.sum(dtype=np.float64)) / 1000

    def network(self) -> "RoadNetwork":
        """Directed segments in metres: every street from tail to head, then those that are not one-way, backwards.

        Node i of the network is node i here; `street_of_segment` tells which street a segment belongs to.
        """
        from sidestep.network.graph import road_network

        street, backwards = self.street_of_segment()
        tail = np.where(backwards, self.head[street], self.tail[street])
        head = np.where(backwards, self.tail[street], self.head[street])
        return road_network(self.project(self.place), tail, head, self.length[street], width=self.width[street])

    def street_of_segment(self) -> tuple[Int[np.ndarray, " segment"], Bool[np.ndarray, " segment"]]:
        """The street of each segment of `network`, and whether the segment leads from its head to its tail."""
        back = np.flatnonzero(~self.one_way)
        street = np.concatenate([np.arange(self.streets), back])
        return street, np.arange(len(street)) >= self.streets

    def project(self, lonlat: Float[np.ndarray, "*point 2"]) -> Float[np.ndarray, "*point 2"]:
        """Degrees to metres east and north of the middle of the town, as `network` has them.

        The projection keeps the scale of the middle's latitude: 30 km north or south of it, at 60°, lengths from east
        to west are out by 0.8 %.
        """
        middle = (self.place.min(axis=0) + self.place.max(axis=0)) / 2
        scale = np.radians(EARTH_RADIUS) * np.array([np.cos(np.radians(middle[1])), 1.0])
        return (np.asarray(lonlat, np.float64) - middle) * scale

    def course(self, street: int) -> Float[np.ndarray, "point 2"]:
        """Longitude and latitude along one street, from tail to head."""
        return self.points[self.first[street] : self.first[street + 1]]


def metres_between(
    start: Float[np.ndarray, "point 2"], end: Float[np.ndarray, "point 2"]
) -> Float[np.ndarray, " point"]:
    """Great-circle distance in metres between longitudes and latitudes in degrees, pair by pair."""
    (lon_a, lat_a), (lon_b, lat_b) = np.radians(start).T, np.radians(end).T
    a = np.sin((lat_b - lat_a) / 2) ** 2 + np.cos(lat_a) * np.cos(lat_b) * np.sin((lon_b - lon_a) / 2) ** 2
    return 2 * EARTH_RADIUS * np.arcsin(np.sqrt(np.minimum(a, 1)))


def course_lengths(
    points: Float[np.ndarray, "point 2"], first: Int[np.ndarray, " border"]
) -> Float[np.ndarray, " street"]:
    """Metres along each course of at least two points."""
    legs = metres_between(points[:-1], points[1:])
    legs[first[1:-1] - 1] = 0  # from the end of one course to the start of the next
    return np.add.reduceat(np.append(legs, 0.0), first[:-1]) if len(first) > 1 else np.zeros(0)


def _check(town: Town) -> None:
    streets, nodes = len(town.tail), len(town.ids)
    if not streets:
        raise TownError("a town needs at least one street")
    if len(town.place) != nodes:
        raise TownError(f"there are {nodes} crossings, but {len(town.place)} places")
    for name in ("head", "one_way", "length", "width", "kind", "name", "signals", "crossings"):
        if len(getattr(town, name)) != streets:
            raise TownError(f"there are {streets} streets, but {name} is given for {len(getattr(town, name))}")
    for name, degrees in (("crossing", town.place), ("point", town.points)):
        fine = (np.abs(degrees) <= (180, 90)).all(axis=1)  # NaN is not
        if not fine.all():
            worst = int(np.argmin(fine))
            raise TownError(f"{name} {worst} is at longitude {degrees[worst, 0]} and latitude {degrees[worst, 1]}")
    _check_ends(town)
    _check_numbers(town)
    _check_courses(town)


def _check_ends(town: Town) -> None:
    for name in ("tail", "head"):
        ends = getattr(town, name)
        if ends.min() < 0 or ends.max() >= town.nodes:
            worst = int(np.argmax((ends < 0) | (ends >= town.nodes)))
            raise TownError(f"street {worst} has {name} {ends[worst]}, but there are {town.nodes} crossings")
    if (town.tail == town.head).any():
        worst = int(np.argmax(town.tail == town.head))
        raise TownError(f"street {worst} begins and ends at crossing {town.tail[worst]}")


def _check_numbers(town: Town) -> None:
    for name in ("length", "width"):
        metres = getattr(town, name)
        fine = np.isfinite(metres) & (metres > 0)
        if not fine.all():
            raise TownError(
                f"street {int(np.argmin(fine))} has {name} {metres[np.argmin(fine)]} m; it must be positive"
            )
    for name in ("signals", "crossings"):
        if getattr(town, name).min() < 0:
            worst = int(np.argmin(getattr(town, name)))
            raise TownError(f"street {worst} has {getattr(town, name)[worst]} {name}")


def _check_courses(town: Town) -> None:
    streets, counts = town.streets, np.diff(town.first)
    if len(town.first) != streets + 1 or town.first[0] != 0 or town.first[-1] != len(town.points) or counts.min() < 2:
        raise TownError(f"the courses of {streets} streets do not add up to {len(town.points)} points")
    for name, end, at in (("begins", town.tail, town.first[:-1]), ("ends", town.head, town.first[1:] - 1)):
        apart = np.abs(town.points[at] - town.place[end]).max(axis=1) > SAME_DEGREES
        if apart.any():
            worst = int(np.argmax(apart))
            raise TownError(f"the course of street {worst} {name} elsewhere than at crossing {end[worst]}")
