"""The ends of a request on the streets, and its departure. The only module here that tells grids from towns."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sidestep.crowds.counts import CountTable
from sidestep.crowds.profile import time_of_week
from sidestep.crowds.sensors import SensorFlow
from sidestep.crowds.table import TableFlow
from sidestep.network.graph import ABSENT, RoadNetwork
from sidestep.network.snap import Snapped, Snapper
from sidestep.network.splice import Spliced, splice
from sidestep.network.town import Town
from sidestep.planners.base import Planner
from sidestep.planners.reactive import Snapshot
from sidestep.planners.shortest_path import ShortestPath, distances_to
from sidestep.routing.directions import Leg, Step, StreetPiece, directions
from sidestep.routing.request import (
    NO_COORDINATES,
    Departure,
    End,
    Place,
    RouteError,
    RouteRequest,
    at_fault,
    local_time,
    minutes_after_start,
)
from sidestep.scenarios.build import sensors_of, town_of, with_live_counts
from sidestep.scenarios.maps import ScenarioMap, knows_time
from sidestep.scenarios.model import DAYS, Scenario, Venue

FUTURES = 200
"""Futures that are simulated by default."""

LIVE_FUTURES = 20
"""The same in towns for planners that see all counts: forecasts in every slot of every future take long."""

SPARE_NODES, SPARE_SEGMENTS = 2, 4
"""Nodes and segments that two ends in the middle of streets add at most. Where they add fewer, arrays are padded, so
that all requests have the same shapes and share their compiled programs."""


class Streets(Protocol):
    """The streets of a located request, for people."""

    @property
    def attribution(self) -> str:
        """Whose data they are."""
        ...

    @property
    def town(self) -> Town:
        """Their map; grids raise a :class:`RouteError` (field ``format``)."""
        ...

    def piece(self, segment: int) -> StreetPiece:
        """The street that a segment is a piece of."""
        ...

    def steps(self, legs: tuple[Leg, ...]) -> tuple[Step, ...] | None:
        """Turn by turn, where streets have names and directions."""
        ...

    def densest(self, density: Float[np.ndarray, " segment"]) -> Float[np.ndarray, " street"]:
        """The largest density of each street's pieces and directions, in persons/m²."""
        ...


@dataclass(frozen=True, eq=False)
class LocatedRequest:
    """A request of which everything is known that a planner needs."""

    request: RouteRequest
    scenario: Scenario

    scenario_map: ScenarioMap
    """The streets, split at the ends, and the crowds on them from clock 0 on."""

    streets: Streets
    origin: End
    destination: End
    departure: Departure

    crowds: str
    """The source of the crowds."""

    expected_crowds: str
    """The crowds that are expected, after "Crowds are …"."""

    sensors: int | None = None
    """Number of sensors; None where crowds are not known from sensors."""

    counted_sensors: int | None = None
    """Number of those with current counts; None where none were given."""

    futures: int = FUTURES
    """Futures that are simulated by default."""

    live_futures: int = FUTURES
    """The most for planners that see all counts, by default."""

    baselines: tuple[Planner, ...] = ()
    """Planners that the plan is compared with."""

    @property
    def synthetic(self) -> str:
        """What is invented, and by how much."""
        venue = self.scenario.venue
        if venue is None:
            return "streets and crowds are synthetic"
        return "" if venue.crowding == 1 else f"demand {venue.crowding:g} × the counts (an invented event day)"


class Locator(Protocol):
    """Finds requests on the streets of one map."""

    def locate(self, request: RouteRequest) -> LocatedRequest:
        """Find both ends, and the crowds at the departure.

        Raises
        ------
        SidestepError
            Nodes that do not exist, places outside the town, ends that no way connects, a departure or current counts
            for which the crowds are not known. ``error.field`` names the field of the request.
        """
        ...


def locator(scenario: Scenario, scenario_map: ScenarioMap) -> Locator:
    """The locator for a scenario's kind of place."""
    if scenario.venue is None:
        return GridLocator(scenario, scenario_map)
    return TownLocator(scenario, scenario_map, scenario.venue)


def _check_node(name: str, node: int, nodes: int) -> int:
    if not 0 <= node < nodes:
        raise RouteError(f"the {name} is node {node}, but nodes are numbered 0 to {nodes - 1}", field=name)
    return node


class GridStreets:
    """Streets without names and coordinates."""

    attribution = "a grid of random lengths"

    @property
    def town(self) -> Town:
        raise RouteError(NO_COORDINATES, field="format")

    def piece(self, _segment: int) -> StreetPiece:
        return StreetPiece()

    def steps(self, _legs: tuple[Leg, ...]) -> None:
        return None

    def densest(self, density: Float[np.ndarray, " segment"]) -> Float[np.ndarray, " segment"]:
        return density


@dataclass(frozen=True, eq=False)
class GridLocator:
    """Requests name nodes, and minutes after the scenario's start."""

    scenario: Scenario
    scenario_map: ScenarioMap

    def locate(self, request: RouteRequest) -> LocatedRequest:
        last = self.scenario_map.network.nodes - 1
        origin = self._end("origin", 0 if request.origin is None else request.origin)
        destination = self._end("destination", last if request.destination is None else request.destination)
        minutes = minutes_after_start(request.depart or 0)
        if not 0 <= 60 * minutes < self.scenario.horizon:
            raise RouteError(
                f"the departure must lie between 0 and {self.scenario.horizon / 60:g} minutes, not {minutes:g}",
                field="depart",
            )
        if request.live is not None:
            raise RouteError("a grid has no sensors; leave out the live counts", field="live")
        return LocatedRequest(
            request,
            self.scenario,
            self.scenario_map,
            GridStreets(),
            origin,
            destination,
            Departure(f"{minutes:g} min after the start", 60 * minutes),
            crowds="simulated",
            expected_crowds="those that the scenario expects",
        )

    def _end(self, name: str, place: Place) -> End:
        if not isinstance(place, int):
            raise RouteError(f"the {name} must be a node: a grid has no latitudes and longitudes", field=name)
        return End(_check_node(name, place, self.scenario_map.network.nodes), f"node {place}")


@dataclass(frozen=True, eq=False)
class TownStreets:
    """Streets of a town, some of them split where a route begins or ends."""

    spliced: Spliced

    @property
    def town(self) -> Town:
        return self.spliced.town

    @property
    def attribution(self) -> str:
        return self.town.attribution

    def piece(self, segment: int) -> StreetPiece:
        street = int(self.spliced.street[segment])
        return StreetPiece(street, self.town.name[street], self.town.kind[street], self.spliced.course(segment))

    def steps(self, legs: tuple[Leg, ...]) -> tuple[Step, ...]:
        return directions(legs)

    def densest(self, density: Float[np.ndarray, " segment"]) -> Float[np.ndarray, " street"]:
        found = np.zeros(self.town.streets, density.dtype)
        np.maximum.at(found, self.spliced.street, density)
        return found


class TownLocator:
    """Requests name nodes or places near streets, which are split there, and local times."""

    def __init__(self, scenario: Scenario, scenario_map: ScenarioMap, venue: Venue) -> None:
        self._scenario, self._scenario_map, self._venue = scenario, scenario_map, venue
        self._snapper = Snapper(town_of(venue.streets))
        self._sensors = None if venue.tabled else len(sensors_of(venue))

    def locate(self, request: RouteRequest) -> LocatedRequest:
        departure = self._departure(request)
        streets, origin, destination = self._ends(request)
        here = self._scenario_map.spliced(streets)
        if departure.hour is not None:
            here = here.beginning([departure.hour])
        here, counted = self._with_counts(here, request.live_counts(), departure)
        venue = self._venue
        # Crowds exactly as in a table and no lights: all futures are alike.
        alike = venue.tabled and venue.noise[1] == 0 and venue.traffic is None
        return LocatedRequest(
            request,
            replace(self._scenario, departures=(0.0, 0.0)),  # so that no slots are drawn in which nobody walks
            here,
            TownStreets(streets),
            origin,
            destination,
            departure,
            _source_of_crowds(venue),
            self._expected_crowds(departure, counted),
            self._sensors,
            counted,
            1 if alike else FUTURES,
            LIVE_FUTURES,
            (ShortestPath(), Snapshot()),
        )

    def _departure(self, request: RouteRequest) -> Departure:
        source, flow = Path(self._venue.counts).name, self._scenario_map.flow
        if not knows_time(flow):
            if request.depart is None:
                return Departure("as the table begins")
            raise RouteError(
                f"{source} has slots without times, so all walks depart as it begins; leave out the departure",
                field="depart",
            )
        time = None if request.depart is None else local_time(request.depart)
        hour = self._venue.starts(1)[0] if time is None else time_of_week(time)
        text = _day_and_time(hour) if time is None else f"{DAYS[time.weekday()]} {time:%Y-%m-%d %H:%M}"
        if isinstance(flow, TableFlow) and flow.begins is not None and not flow.covers(hour):
            raise RouteError(
                f"{source} covers {flow.span / 3600:g} hours from {_day_and_time(flow.begins)} on, "
                f"but the departure is {text}",
                field="depart",
            )
        return Departure(text, hour=hour, time=time)

    def _ends(self, request: RouteRequest) -> tuple[Spliced, End, End]:
        """Both ends, on streets that are split there, so that either end of the street can be walked to."""
        town = self._snapper.town
        asked = (
            0 if request.origin is None else request.origin,
            town.nodes - 1 if request.destination is None else request.destination,
        )
        found = [self._find(name, place) for name, place in zip(("origin", "destination"), asked, strict=True)]
        spliced = padded(splice(town, found))
        origin, destination = (
            _end(town, node, on, place) for node, on, place in zip(spliced.nodes, found, asked, strict=True)
        )
        if origin.node == destination.node:
            raise RouteError(
                f"{origin.asked} and {destination.asked} are the same place on these streets", field="destination"
            )
        network = spliced.network
        away = distances_to(network, np.asarray(network.length), destination.node)[origin.node]
        if not math.isfinite(away):
            raise RouteError(
                f"no way leads from {origin.asked} to {destination.asked}; streets may be one-way or unconnected",
                field="destination",
            )
        return spliced, origin, destination

    def _find(self, name: str, place: Place) -> int | Snapped:
        if isinstance(place, int):
            return _check_node(name, place, self._snapper.town.nodes)
        with at_fault(name):
            return self._snapper.nearest(*place)

    def _with_counts(
        self, here: ScenarioMap, counts: CountTable | None, departure: Departure
    ) -> tuple[ScenarioMap, int | None]:
        """The same crowds, but going on from current counts, and the number of sensors that these are of."""
        if counts is None:
            return here, None
        if not isinstance(here.flow, SensorFlow):
            raise RouteError(
                f"live counts are of sensors, but the crowds of {self._scenario.name} come from a table", field="live"
            )
        if departure.time is None:
            raise RouteError("live counts need a departure with its day, such as 2025-05-24T12:30", field="depart")
        with at_fault("live"):
            flow, counted = with_live_counts(self._venue, here.flow, counts, departure.time)
        return replace(here, flow=flow), counted

    def _expected_crowds(self, departure: Departure, counted: int | None) -> str:
        if departure.hour is None:
            return "those of the table from its first slot on"
        whose = "of the table" if self._venue.tabled else "that are usual"
        more = "" if counted is None else f", and go on from current counts of {counted} of {self._sensors} sensors"
        return f"those {whose} at this hour of the week, whatever the date{more}"


def _source_of_crowds(venue: Venue) -> str:
    name = Path(venue.counts).name
    if venue.tabled:
        return f"table {name}"
    whose = "Auckland's counts (Heart of the City Auckland, CC BY 4.0)" if name == "auckland" else f"counts of {name}"
    paired = not venue.sensors or any(sensor.place is None for sensor in venue.sensors)
    return f"{whose}, paired with these streets by a seed (synthetic)" if paired else whose


def _end(town: Town, node: int, found: int | Snapped, asked: Place) -> End:
    if isinstance(found, Snapped) and not isinstance(asked, int):
        return End(node, f"{asked[0]:.5f},{asked[1]:.5f}", *found.place, found.away)
    longitude, latitude = town.place[node].tolist()
    return End(node, f"crossing {node}", latitude, longitude)


def _day_and_time(hour: float) -> str:
    day, minute = divmod(round(60 * hour), 24 * 60)
    return f"{DAYS[day % 7]} {minute // 60:02}:{minute % 60:02}"


def padded(spliced: Spliced) -> Spliced:
    """The same streets with arrays as large as for two ends in the middle of streets.

    No exit leads to the spare nodes and segments, which are copies of the first segment: no walk, no search and no
    cost to go knows of them.
    """
    town, network = spliced.town, spliced.network
    more = town.nodes + SPARE_NODES - network.nodes
    extra = len(town.street_of_segment()[0]) + SPARE_SEGMENTS - network.segments
    kept = np.append(np.arange(network.segments), np.zeros(extra, int))

    def rows(array: Array, value: float) -> Array:
        return jnp.asarray(np.pad(np.asarray(array), [(0, more), (0, 0)], constant_values=value))

    def segments(array: Array) -> Array:
        return jnp.asarray(np.asarray(array)[kept])

    return replace(
        spliced,
        network=RoadNetwork(
            rows(network.position, 0),
            rows(network.exit_node, ABSENT),
            rows(network.exit_segment, ABSENT),
            *map(segments, (network.tail, network.head, network.length, network.width)),
        ),
        parent=spliced.parent[kept],
        street=spliced.street[kept],
        begin=spliced.begin[kept],
        end=spliced.end[kept],
    )
