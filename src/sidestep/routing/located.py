"""Requests on the streets: with locate.py the only modules here that tell grids from towns."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from jaxtyping import Array, Float, Int

from sidestep.network.contours import Raster, Samples, ring_area
from sidestep.network.graph import ABSENT
from sidestep.network.polygons import in_degrees
from sidestep.network.snapping import SplitStreets
from sidestep.network.town import Town
from sidestep.planners.base import Planner
from sidestep.planners.reactive import Snapshot
from sidestep.planners.shortest_path import ShortestPath
from sidestep.programs import on_device, program
from sidestep.routing.clocks import Clock
from sidestep.routing.directions import Leg, Step, bearings, directions, plane_bearings, street_label
from sidestep.routing.facts import End, SceneFacts, StreetMap
from sidestep.routing.paces import Paces
from sidestep.routing.request import RouteError
from sidestep.scenarios.maps import ScenarioMap
from sidestep.scenarios.model import Scenario
from sidestep.walking.speed_laws import DENSEST, FREE_SPEED

FUTURES = 200
"""Futures that are simulated by default."""

LIVE_FUTURES = 20
"""The same in towns for planners that see all counts: forecasts in every slot of every future take long."""

BASELINES: tuple[Planner, ...] = (ShortestPath(), Snapshot())
"""Planners that plans in towns are compared with."""


OnMap = tuple[list[Leg], list[Step] | None, StreetMap | None]


class Outline(NamedTuple):
    """What is reached within a limit."""

    kilometres: float | None = None
    """Of streets; None on grids."""
    hectares: float | None = None
    """Of the area around them; None on grids."""
    polygons: list[list[list[list[float]]]] | None = None
    """Of each polygon its outer ring and its holes, as lists of longitude and latitude; None on grids."""


@dataclass(frozen=True)
class NodeEnd(End):
    """An end at which a node stands, if need be one in the middle of a street."""

    node: int
    """Number of the node; where a street is split, one beyond those of the town."""


OnSegments = tuple[Float[np.ndarray, " segment"], Float[np.ndarray, " segment"]]
"""When each segment is entered, in s, infinite where it is not; and seconds on it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Located:
    """A request with all that a planner needs to know. On grids, as it stands, streets have no names or coordinates."""

    ends: tuple[NodeEnd, ...]
    """The places, in the order given."""

    facts: SceneFacts
    scenario: Scenario

    scenario_map: ScenarioMap
    """The streets, split at the ends, and the crowds on them from clock 0 on."""

    start: Clock
    """What clock 0 is."""

    paces: Paces | None = None
    """Those that are expected on the whole map; None where crowds go on from live counts."""

    baselines: tuple[Planner, ...] = ()
    """Planners that the plan is compared with."""

    live_futures: int = FUTURES
    """The most futures that planners that see all counts walk by default."""

    clock: float = 0.0
    """Departure, seconds since the scenario's start."""

    latest: float = 0.0
    """The latest departure that matters, seconds since the scenario's start."""

    may_stay: ClassVar[bool] = True
    """Whether a route may end where it begins."""

    densest: ClassVar[float] = sys.float_info.max
    """Persons/m² that anybody sees at most; the paper's density is no number of persons for an area."""

    @property
    def hours(self) -> list[float]:
        """Hour of the week at clock 0, for the one destination."""
        return [self.start.hour]

    @property
    def pace(self) -> Float[Array, "segment step"] | None:
        """Mean seconds for each metre from clock 0 on; None where they are not known, or crowds are certain."""
        return None if self.paces is None else self.paces.at(self.scenario, self.start.hour)

    @property
    def futures(self) -> int:
        """Futures that are simulated by default."""
        return 1 if self.scenario.place.certain else FUTURES

    def futures_of(self, planner: Planner, count: int) -> int:
        """How many of ``count`` futures a planner walks by default."""
        return min(count, self.live_futures) if planner.observes == "live" else count

    def departing(self, clock: float) -> Self:
        """The same with another departure, in seconds since the scenario's start."""
        return replace(self, clock=clock, facts=replace(self.facts, **self.start.facts(clock)))

    def check_covered(self, seconds: float, field: str = "depart") -> None:
        """Refuse departures from which a walk goes on beyond the crowds that are known.

        Parameters
        ----------
        seconds
            What the walk takes.
        field
            The parameter at fault.

        Raises
        ------
        RouteError
            With the parameter as its field.
        """
        covered = self.scenario.slots * self.scenario.slot_seconds
        if self.clock + seconds > covered and self.clock > self.scenario.departures[1]:
            known = f"crowds are known for {covered / 60:g} minutes, but a walk that departs at {self.clock / 60:g}"
            raise RouteError(f"{known} takes {seconds / 60:.0f}; depart earlier", field=field)

    def pieces(self) -> Int[np.ndarray, "segment 3"]:
        """Name each segment so that both directions of a street, or of a piece of it, have the same name."""
        network = self.scenario_map.network
        ends = np.sort(np.stack([network.tail, network.head], axis=1), axis=1)
        return np.concatenate([ends, np.zeros((len(ends), 1), int)], axis=1)

    @property
    def nodes(self) -> int:
        """Number of nodes, without those at which streets are split."""
        return self.scenario_map.network.nodes

    def named(self, node: int) -> int | None:
        """The number of a node as people may give it; None where a street is split, which nobody else knows of."""
        return node if node < self.nodes else None

    @property
    def named_ends(self) -> tuple[End, ...]:
        """The ends as answers have them."""
        return tuple(End(**{**vars(end), "node": self.named(end.node)}) for end in self.ends)

    @property
    def town(self) -> Town | None:
        """The streets as people know them; None on grids."""
        return None

    @property
    def street_numbers(self) -> Int[np.ndarray, " segment"]:
        """A number for the street of each segment: the same both ways, on all its pieces, and for other requests."""
        return np.unique(self.pieces(), axis=0, return_inverse=True)[1].reshape(-1)

    def ends_of(self, segments: Sequence[int]) -> tuple[list[int], list[int]]:
        """The nodes where segments begin, and those where they end."""
        network, which = self.scenario_map.network, np.array(segments, int)
        # By NumPy: JAX would compile a program for each of these.
        return np.asarray(network.tail)[which].tolist(), np.asarray(network.head)[which].tolist()

    def metres_of(self, segments: Sequence[int]) -> list[float]:
        """The lengths of segments."""
        return np.asarray(self.scenario_map.network.length)[np.array(segments, int)].tolist()

    def street_name(self, segment: int) -> str:
        """What people call the street of a segment."""
        (tail,), (head,) = self.ends_of([segment])
        return f"the street from node {tail} to node {head}"

    def line(self, segment: int) -> Float[np.ndarray, "point 2"]:
        """Give the course of a segment.

        Parameters
        ----------
        segment
            Its number.

        Returns
        -------
        Float[np.ndarray, "point 2"]
            x and y in m, in walking direction; on grids a straight line.
        """
        ends = np.ravel(self.ends_of([segment]))
        return np.asarray(self.scenario_map.network.position)[ends].astype(np.float64)

    def bearings(self, segment: int) -> tuple[float, float]:
        """Bearings in which a segment begins and ends, degrees clockwise from north, or on grids from the y axis."""
        return plane_bearings(self.line(segment))

    def exits(self, node: int) -> list[int]:
        """The segments that leave a node."""
        exits = np.asarray(self.scenario_map.network.exit_segment)[node]
        return exits[exits != ABSENT].tolist()

    def on_plane(self, latitude: float, longitude: float) -> Float[np.ndarray, "2"]:  # noqa: ARG002 - for towns
        """The x and y in m of a place; RouteError (field ``location``) on grids, which have no coordinates."""
        said = "a grid has no latitudes and longitudes; give the location as the number of a node"
        raise RouteError(said, field="location")

    def in_degrees(self, xy: Float[np.ndarray, "*point 2"]) -> Float[np.ndarray, "*point 2"] | None:  # noqa: ARG002
        """Longitudes and latitudes of places on the plane; None on grids."""
        return None

    def outlines(self, walks: Sequence[OnSegments], limits: Float[np.ndarray, " limit"]) -> list[list[Outline]]:
        """Sizes and borders of what is reached from the first end; on grids there are none.

        Parameters
        ----------
        walks
            When segments are walked.
        limits
            Seconds, in rising order.

        Returns
        -------
        list of list of Outline
            For each of the walks one for each limit.
        """
        return [[Outline() for _ in limits] for _ in walks]

    def street_map(self, density: Float[np.ndarray, " segment"]) -> StreetMap | None:  # noqa: ARG002 - for towns
        """The densest crowd of each street, given persons/m² on all segments; None on grids."""
        return None

    def named_streets(self, density: Float[np.ndarray, " segment"]) -> Iterator[tuple[dict[str, Any], float]]:
        """Name all streets of a town, or all segments of a grid.

        Parameters
        ----------
        density
            Persons/m² on all segments.

        Yields
        ------
        dict, float
            Number, name, kind, ends and length of a street, and the density on it.
        """
        network = self.scenario_map.network
        columns = (np.asarray(column).tolist() for column in (network.tail, network.head, network.length, density))
        for tail, head, metres, persons in zip(*columns, strict=True):
            yield {"street": None, "name": None, "kind": None, "nodes": (tail, head), "metres": metres}, persons

    def on_map(self, legs: list[Leg], density: Float[np.ndarray, " segment"]) -> OnMap:
        """The legs with their streets, turns, and a map, given the densities on all segments in persons/m²."""
        return legs, None, self.street_map(density)


@dataclass(frozen=True, eq=False, kw_only=True)
class LocatedInTown(Located):
    """A request in a town."""

    streets: SplitStreets
    """The streets of the map with their names and coordinates."""

    baselines: tuple[Planner, ...] = BASELINES
    live_futures: int = LIVE_FUTURES
    may_stay: ClassVar[bool] = False
    densest: ClassVar[float] = DENSEST

    def pieces(self) -> Int[np.ndarray, "segment 3"]:
        ends = super().pieces()
        ends[:, 2] = self.streets.street  # parallel streets have the same ends
        return ends

    @property
    def pace(self) -> Float[Array, "segment step"] | None:
        """The same; pieces of streets are as slow as the whole ones."""
        whole = super().pace
        return None if whole is None else _taken(whole, on_device(self.streets.parent, np.int32))

    @property
    def nodes(self) -> int:
        return self.streets.town.nodes

    @property
    def town(self) -> Town:
        return self.streets.town

    @property
    def street_numbers(self) -> Int[np.ndarray, " segment"]:
        return self.streets.street

    def street_name(self, segment: int) -> str:
        street = int(self.streets.street[segment])
        return street_label(self.town.name[street], self.town.kind[street])

    def line(self, segment: int) -> Float[np.ndarray, "point 2"]:
        return self.town.project(self.streets.course(segment))

    def bearings(self, segment: int) -> tuple[float, float]:
        return bearings(self.streets.course(segment))

    def on_plane(self, latitude: float, longitude: float) -> Float[np.ndarray, "2"]:
        return self.town.project(np.array([longitude, latitude]))

    def in_degrees(self, xy: Float[np.ndarray, "*point 2"]) -> Float[np.ndarray, "*point 2"]:
        return self.town.projection.unproject(xy)

    def outlines(self, walks: Sequence[OnSegments], limits: Float[np.ndarray, " limit"]) -> list[list[Outline]]:
        town, samples, (origin, *_) = self.town, samples_of(self.town), self.ends
        plane = town.projection
        reached = [samples.reached(self.streets, *walk) for walk in walks]
        inside = samples.xy[np.min(reached, axis=0) <= limits.max()]
        here = town.project(np.array([[origin.longitude, origin.latitude]], float))
        raster = Raster.around(samples, np.concatenate([here, inside]))

        def outline(
            seconds: Float[np.ndarray, " sample"], around: Float[np.ndarray, "row column"], limit: float
        ) -> Outline:
            metres = float(samples.metres[seconds <= limit].sum())
            areas = raster.areas(around, limit, FREE_SPEED)
            square = sum(ring_area(ring) for rings in areas for ring in rings)
            return Outline(metres / 1000, square / 10_000, in_degrees(areas, plane))

        around = [raster.seconds(seconds, FREE_SPEED) for seconds in reached]
        return [[outline(*there, limit) for limit in limits.tolist()] for there in zip(reached, around, strict=True)]

    def street_map(self, density: Float[np.ndarray, " segment"]) -> StreetMap:
        densest = np.zeros(self.streets.town.streets, density.dtype)
        np.maximum.at(densest, self.streets.street, density)
        return StreetMap(self.streets.town, densest)

    def named_streets(self, density: Float[np.ndarray, " segment"]) -> Iterator[tuple[dict[str, Any], float]]:
        town = self.town
        persons = self.street_map(density).density.tolist()
        ends = zip(town.tail.tolist(), town.head.tolist(), strict=True)
        columns = (town.name, town.kind, ends, town.length.tolist(), persons)
        for street, (name, kind, nodes, metres, dense) in enumerate(zip(*columns, strict=True)):
            yield {"street": street, "name": name, "kind": kind, "nodes": nodes, "metres": metres}, dense

    def on_map(self, legs: list[Leg], density: Float[np.ndarray, " segment"]) -> OnMap:
        """Name the streets of the legs, put turns into words, and show the densest crowd of each street."""
        town, street_of = self.streets.town, self.streets.street
        named = []
        for leg in legs:
            street, course = int(street_of[leg.segment]), np.round(self.streets.course(leg.segment), 7).tolist()
            named.append(
                replace(leg, street=street, name=town.name[street], kind=town.kind[street], coordinates=course)
            )
        return named, directions(named), self.street_map(density)


@program()
def _taken(paces: Float[Array, "segment step"], segments: Int[Array, " piece"]) -> Float[Array, "piece step"]:
    """Paces of some segments."""
    return paces[segments]


@lru_cache(maxsize=4)
def samples_of(town: Town) -> Samples:
    """Points along all streets of a town, made once."""
    return Samples.of(town)
