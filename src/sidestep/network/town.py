"""The streets of a real place as plain arrays: what the importer makes and what files hold."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int16, Int32, Int64

from sidestep.errors import SidestepError
from sidestep.network.checks import check_each, check_edges
from sidestep.network.geodesy import Projection
from sidestep.network.opening_hours import open_minutes

if TYPE_CHECKING:
    from sidestep.network.graph import Areas, RoadNetwork

ATTRIBUTION = "© OpenStreetMap contributors, ODbL 1.0"
"""Whose the data of OpenStreetMap are, and under which licence."""
SAME_DEGREES = 1e-7
"""Degrees within which coordinates are the same: OpenStreetMap's resolution, about 1 cm."""
MOST_CROSSINGS = np.iinfo(np.int16).max
"""Largest number of crossings of vehicle traffic along a street that a town can hold."""
ARRAYS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "place": (np.float64, (2,)), "ids": (np.int64, ()), "tail": (np.int32, ()), "head": (np.int32, ()),
    "one_way": (np.bool_, ()), "length": (np.float32, ()), "width": (np.float32, ()), "signals": (np.int16, ()),
    "crossings": (np.int16, ()), "restricted": (np.bool_, ()), "incline": (np.float32, ()), "kerb": (np.float32, ()),
    "points": (np.float64, (2,)), "first": (np.int64, ()),
}  # fmt: skip
"""Type of each array of a town, and the shape of one row."""
WORDS = ("kind", "name", "opening")
"""Columns of text."""
USUAL: dict[str, Any] = {"opening": "", "restricted": False, "incline": np.nan, "kerb": 0.0}
"""Values of streets that are always open to everybody, where nothing is known of inclines and kerbs."""


class TownError(SidestepError):
    """An invalid town, file of a town, or place in it; ``field`` names the array or argument at fault."""


@dataclass(frozen=True, eq=False)
class Town:
    """Crossings and the streets between them; each street comes once, whether it is walked in one direction or both.

    Arrays are read-only. Every town has at least one street; streets join two different crossings, have a positive
    length and width, and a course from tail to head.

    Raises
    ------
    TownError
        Arrays of different lengths, unknown crossings, invalid coordinates, loops, lengths or widths that are not
        positive, courses that do not lead from tail to head.
    """

    place: Float64[np.ndarray, "node 2"]
    """Longitude and latitude of each crossing in degrees, WGS 84."""
    ids: Int64[np.ndarray, " node"]
    """OpenStreetMap's node number; for a merged crossing, that of the node that represents it."""
    tail: Int32[np.ndarray, " street"]
    """Crossing where each street begins."""
    head: Int32[np.ndarray, " street"]
    """Crossing where each street ends."""
    one_way: Bool[np.ndarray, " street"]
    """Which streets are walked from tail to head only."""
    length: Float32[np.ndarray, " street"]
    """Metres walked: along the course, and through its part of merged crossings at both ends."""
    width: Float32[np.ndarray, " street"]
    """Metres available to walkers."""
    kind: tuple[str, ...]
    """OpenStreetMap's ``highway`` tag of each street."""
    name: tuple[str, ...]
    """Name of each street, "" where it has none."""
    signals: Int16[np.ndarray, " street"]
    """Number of signalised crossings of vehicle traffic along each street."""
    crossings: Int16[np.ndarray, " street"]
    """Number of crossings of vehicle traffic without signals along each street."""
    opening: tuple[str, ...]
    """When each street is open, in the syntax of OpenStreetMap's ``opening_hours``; "" where it always is."""
    restricted: Bool[np.ndarray, " street"]
    """Streets for those only whose walk begins or ends there (``destination``, ``customers``)."""
    incline: Float32[np.ndarray, " street"]
    """Mean rise from tail to head for each metre; NaN where it is unknown."""
    kerb: Float32[np.ndarray, " street"]
    """Metres of the highest kerb along each street; 0 where none is known."""
    points: Float64[np.ndarray, "point 2"]
    """Longitudes and latitudes of all courses one after another, each from tail to head with both ends."""
    first: Int64[np.ndarray, " border"]
    """Index in ``points`` where each street's course begins, and at last the number of points."""
    attribution: str
    """Whose data it is, and under which licence."""

    def __post_init__(self) -> None:
        _check(self)
        for name in ARRAYS:
            getattr(self, name).setflags(write=False)

    @classmethod
    def of_streets(cls, ends: Int[np.ndarray, "street 2"], **columns: Any) -> "Town":
        """Build a town of the nodes that streets join; other nodes are left out.

        Parameters
        ----------
        ends
            Indices of the nodes where each street begins and ends.
        columns
            What else a town has, ``place`` and ``ids`` for all nodes. Arrays are converted to the types of a town.
            What is left out is as in ``USUAL``.

        Returns
        -------
        Town
            Streets in the order given, crossings in that of the nodes.
        """
        columns = {name: (value,) * len(ends) for name, value in USUAL.items()} | columns
        used, renumbered = np.unique(ends, return_inverse=True)
        tail, head = renumbered.reshape(-1, 2).T
        columns |= {"tail": tail, "head": head, "place": columns["place"][used], "ids": columns["ids"][used]}
        for name, (kind, _) in ARRAYS.items():
            columns[name] = np.ascontiguousarray(columns[name], kind)
        return cls(**columns)

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
        """Build the network of directed segments.

        Returns
        -------
        RoadNetwork
            Every street from tail to head, then, from head to tail, those that are not one-way. Nodes have the same
            numbers as here; `street_of_segment` gives the street of each segment.
        """
        from sidestep.network.graph import road_network

        (tail, head), (street, _) = self._ends, self.street_of_segment()
        return road_network(
            self.project(self.place), tail, head, self.length[street], width=self.width[street], areas=self._areas
        )

    def street_of_segment(self) -> tuple[Int[np.ndarray, " segment"], Bool[np.ndarray, " segment"]]:
        """Relate the segments of `network` to streets.

        Returns
        -------
        Int[np.ndarray, " segment"], Bool[np.ndarray, " segment"]
            The street of each segment, and whether the segment leads from the street's head to its tail.
        """
        back = np.flatnonzero(~self.one_way)
        street = np.concatenate([np.arange(self.streets), back])
        return street, np.arange(len(street)) >= self.streets

    def of_kinds(self, kinds: Sequence[str]) -> Bool[np.ndarray, " street"]:
        """Say which streets are of one of some kinds.

        Parameters
        ----------
        kinds
            Values of OpenStreetMap's key ``highway``, as in ``kind``.

        Returns
        -------
        Bool[np.ndarray, " street"]
            Those that are.

        Raises
        ------
        TownError
            A kind of which there is no street (field ``kind``).
        """
        known = sorted(set(self.kind))
        for kind in kinds:
            if kind not in known:
                said = f"no street here is of the kind {kind!r:.40}; choose from {', '.join(known)}"
                raise TownError(said, field="kind")
        return np.isin(self.kind, kinds)

    @property
    def never_open(self) -> Bool[np.ndarray, " street"]:
        """Which streets are never open, so that nobody walks them."""
        never = {text for text in set(self.opening) if not np.any(open_minutes(text))}  # all of them can be read
        return np.array([text in never for text in self.opening])

    @cached_property
    def _ends(self) -> Int[np.ndarray, "2 segment"]:
        """Tail and head of each segment."""
        street, backwards = self.street_of_segment()
        return np.where(backwards, [self.head[street], self.tail[street]], [self.tail[street], self.head[street]])

    @cached_property
    def _areas(self) -> "Areas | None":
        """The restricted areas of `network`; None where everybody may walk all streets."""
        from sidestep.network.restricted import restricted_areas

        never_open = self.never_open
        if not (self.restricted.any() or never_open.any()):
            return None
        street, _ = self.street_of_segment()
        tail, head = self._ends
        return restricted_areas(self.nodes, tail, head, self.restricted[street], never_open[street])

    @cached_property
    def projection(self) -> Projection:
        """The plane of `network`, about the middle of the town."""
        return Projection.of(self.place)

    def project(self, lonlat: Float[np.ndarray, "*point 2"]) -> Float[np.ndarray, "*point 2"]:
        """Convert degrees to the metres of `network`'s positions.

        Parameters
        ----------
        lonlat
            Longitudes and latitudes in degrees.

        Returns
        -------
        Float[np.ndarray, "*point 2"]
            Metres east and north of the middle of the town.
        """
        return self.projection.project(lonlat)

    def course(self, street: int) -> Float[np.ndarray, "point 2"]:
        """Give the course of one street.

        Parameters
        ----------
        street
            Its number.

        Returns
        -------
        Float[np.ndarray, "point 2"]
            Longitudes and latitudes in degrees, from tail to head.
        """
        return self.points[self.first[street] : self.first[street + 1]]


def _check(town: Town) -> None:
    if not town.streets:
        raise TownError("a town needs at least one street", field="tail")
    for field in ("head", "one_way", "length", "width", "signals", "crossings", *WORDS, *USUAL):
        if (given := len(getattr(town, field))) != town.streets:
            raise TownError(f"there are {town.streets} streets, but {field} is given for {given}", field=field)
    if len(town.place) != town.nodes:
        raise TownError(f"there are {town.nodes} crossings, but place is given for {len(town.place)}", field="place")
    for item, field in (("crossing", "place"), ("point", "points")):
        degrees = getattr(town, field)
        fine = (np.abs(degrees) <= (180, 90)).all(axis=1)  # NaN is not
        check_each(TownError, item, field, degrees, fine, "be longitude -180 to 180 and latitude -90 to 90")
    check_edges(TownError, "street", town.nodes, vars(town))
    for field in ("signals", "crossings", "kerb"):
        check_each(TownError, "street", field, getattr(town, field), getattr(town, field) >= 0, "be 0 or more")
    _check_opening(town.opening)
    first = town.first
    if len(first) != town.streets + 1 or first[0] != 0 or first[-1] != len(town.points) or np.diff(first).min() < 2:
        raise TownError(
            f"the courses of {town.streets} streets do not add up to {len(town.points)} points", field="first"
        )
    for field, at in (("tail", first[:-1]), ("head", first[1:] - 1)):
        crossing = getattr(town, field)
        near = np.abs(town.points[at] - town.place[crossing]).max(axis=1) <= SAME_DEGREES
        check_each(TownError, "street", field, crossing, near, "be the crossing at that end of the street's course")


def _check_opening(opening: tuple[str, ...]) -> None:
    for text in set(opening):
        if open_minutes(text) is None:
            said = f"opening of street {opening.index(text)} is {text!r:.60}"
            raise TownError(f"{said}; it must be times of the week, such as Mo-Fr 08:00-18:00", field="opening")
