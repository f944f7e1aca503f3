"""The ends of a request on the streets, and its departure. The only module here that tells grids from towns."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from datetime import MAXYEAR, datetime
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from sidestep.crowds.counts import CountTable, read_counts
from sidestep.crowds.profile import time_of_week
from sidestep.crowds.sensors import SensorFlow
from sidestep.crowds.table import TableFlow
from sidestep.network.graph import ABSENT, RoadNetwork
from sidestep.network.snap import Snapped, Snapper
from sidestep.network.splice import Spliced, splice
from sidestep.planners.base import Planner
from sidestep.planners.reactive import Snapshot
from sidestep.planners.shortest_path import ShortestPath, distances_to
from sidestep.routing.directions import Leg, Step, directions
from sidestep.routing.plan import End, RequestFacts, StreetMap
from sidestep.routing.request import Place, RouteError, RouteRequest, at_fault
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

OnMap = tuple[list[Leg], list[Step] | None, StreetMap | None]


@dataclass(frozen=True, eq=False, kw_only=True)
class LocatedRequest:
    """A request with all that a planner needs to know; on a grid, unless it is a :class:`TownRequest`."""

    request: RouteRequest
    facts: RequestFacts
    scenario: Scenario

    scenario_map: ScenarioMap
    """The streets, split at the ends, and the crowds on them from clock 0 on."""

    clock: float
    """Departure, seconds since the scenario's start."""

    futures: int = FUTURES
    """Futures that are simulated by default."""

    live_futures: int = FUTURES
    """The most of them, by default, for planners that see all counts."""

    baselines: tuple[Planner, ...] = ()
    """Planners that the plan is compared with."""

    def on_map(self, legs: list[Leg], _density: Float[np.ndarray, " segment"]) -> OnMap:
        """The legs with their streets, turns, and a map, given the densities on all segments in persons/m²."""
        return legs, None, None


@dataclass(frozen=True, eq=False, kw_only=True)
class TownRequest(LocatedRequest):
    """A request in a town, whose streets have names and coordinates."""

    spliced: Spliced

    def on_map(self, legs: list[Leg], density: Float[np.ndarray, " segment"]) -> OnMap:
        town, street_of = self.spliced.town, self.spliced.street

        def named(leg: Leg) -> Leg:
            street = int(street_of[leg.segment])
            course = np.round(self.spliced.course(leg.segment), 7).tolist()
            return replace(leg, street=street, name=town.name[street], kind=town.kind[street], coordinates=course)

        densest = np.zeros(town.streets, density.dtype)
        np.maximum.at(densest, street_of, density)
        legs = list(map(named, legs))
        return legs, directions(legs), StreetMap(town, densest)


def locator(scenario: Scenario, scenario_map: ScenarioMap) -> Callable[[RouteRequest], LocatedRequest]:
    """A function that finds the ends of requests, and the crowds at the departure, on one map of a scenario.

    It raises a :class:`SidestepError`, whose ``field`` names the field of the request, for nodes that do not exist,
    places outside the town, ends that no way connects, and departures and live counts for which crowds are not known.
    """
    if scenario.venue is None:
        return partial(_locate_on_grid, scenario, scenario_map)
    return TownLocator(scenario, scenario_map, scenario.venue).locate


def _either_end(request: RouteRequest, nodes: int) -> list[tuple[str, Place]]:
    """The places that were asked for, by field; by default the first node and the last."""
    ends = [("origin", request.origin, 0), ("destination", request.destination, nodes - 1)]
    asked = [(name, default if place is None else place) for name, place, default in ends]
    for name, place in asked:
        if isinstance(place, int) and not 0 <= place < nodes:
            raise RouteError(f"the {name} is node {place}, but nodes are numbered 0 to {nodes - 1}", field=name)
    return asked


def _locate_on_grid(scenario: Scenario, scenario_map: ScenarioMap, request: RouteRequest) -> LocatedRequest:
    """Ends are nodes, and the departure is minutes after the scenario's start."""
    ends, minutes = [], 0 if request.depart is None else request.depart
    for name, place in _either_end(request, scenario_map.network.nodes):
        if not isinstance(place, int):
            raise RouteError(f"the {name} must be a node: a grid has no latitudes and longitudes", field=name)
        ends.append(End(place, f"node {place}"))
    if isinstance(minutes, datetime) or not 0 <= 60 * minutes < scenario.horizon:
        raise RouteError(
            f"the departure must be minutes between 0 and {scenario.horizon / 60:g}, not {minutes}", field="depart"
        )
    if request.live is not None:
        raise RouteError("a grid has no sensors; leave out the live counts", field="live")
    facts = RequestFacts(
        **_common(scenario, request),
        origin=ends[0],
        destination=ends[1],
        departs=f"{minutes:g} min after the start",
        departure_minutes=minutes,
        attribution="a grid of random lengths",
        crowds="simulated",
        expected_crowds="those that the scenario expects",
    )
    return LocatedRequest(
        request=request, facts=facts, scenario=scenario, scenario_map=scenario_map, clock=60 * minutes
    )


class TownLocator:
    """Ends are nodes or places near streets, which are split there; the departure is a local time."""

    def __init__(self, scenario: Scenario, scenario_map: ScenarioMap, venue: Venue) -> None:
        self._scenario, self._map, self._venue = scenario, scenario_map, venue
        self._snapper = Snapper(town_of(venue.streets))
        self._source = Path(venue.counts).name
        self._sensors = None if venue.tabled else len(sensors_of(venue))
        # Crowds exactly as in a table, and nobody waits at lights: all futures are alike.
        self._futures = 1 if venue.tabled and venue.noise[1] == 0 and venue.traffic is None else FUTURES

    def locate(self, request: RouteRequest) -> LocatedRequest:
        """Find both ends on the streets, and the crowds at the departure."""
        hour, time, departs = self._departure(request.depart)
        spliced, origin, destination = self._ends(request)
        here = self._map.spliced(spliced)
        if hour is not None:
            here = here.beginning([hour])
        here, counted = self._with_counts(here, request.live, time)
        facts = RequestFacts(
            **_common(self._scenario, request),
            origin=origin,
            destination=destination,
            departure=None if time is None else time.isoformat(),
            departs=departs,
            hour_of_week=hour,
            sensors=self._sensors,
            counted_sensors=counted,
            attribution=spliced.town.attribution,
            crowds=self._crowds(),
            expected_crowds=self._expected_crowds(hour, counted),
        )
        return TownRequest(
            request=request,
            facts=facts,
            scenario=replace(self._scenario, departures=(0.0, 0.0)),  # so that no slots are drawn that nobody walks in
            scenario_map=here,
            clock=0.0,
            futures=self._futures,
            live_futures=LIVE_FUTURES,
            baselines=(ShortestPath(), Snapshot()),
            spliced=spliced,
        )

    def _departure(self, depart: datetime | float | None) -> tuple[float | None, datetime | None, str]:
        """Hour of the week and local time, where there are such, and both for people."""
        flow = self._map.flow
        if not knows_time(flow):
            if depart is None:
                return None, None, "as the table begins"
            raise RouteError(
                f"{self._source} has slots without times, so walks depart as it begins; leave out the departure",
                field="depart",
            )
        if depart is None:
            hour, time = self._venue.starts(1)[0], None
            departs = _day_and_time(hour)
        elif isinstance(depart, datetime) and depart.tzinfo is None and depart.year < MAXYEAR:
            hour, time = time_of_week(depart), depart
            departs = f"{DAYS[depart.weekday()]} {depart:%Y-%m-%d %H:%M}"
        else:
            raise RouteError(
                f"the departure must be a local time without zone, such as 2025-05-24T12:30, not {depart}",
                field="depart",
            )
        if isinstance(flow, TableFlow) and flow.begins is not None and not flow.covers(hour):
            raise RouteError(
                f"{self._source} covers {flow.span / 3600:g} hours from {_day_and_time(flow.begins)} on, "
                f"but the departure is {departs}",
                field="depart",
            )
        return hour, time, departs

    def _ends(self, request: RouteRequest) -> tuple[Spliced, End, End]:
        """Both ends, on streets that are split there, so that either end of the street can be walked to."""
        town = self._snapper.town
        asked = _either_end(request, town.nodes)
        found: list[int | Snapped] = []
        for name, place in asked:
            with at_fault(name):
                found.append(place if isinstance(place, int) else self._snapper.nearest(*place))
        spliced = padded(splice(town, found))
        origin, destination = map(self._end, spliced.nodes, found, (place for _, place in asked))
        network, way = spliced.network, f"{origin.asked} to {destination.asked}"
        if origin.node == destination.node:
            raise RouteError(f"{way} is no way: both are the same place on these streets", field="destination")
        away = distances_to(network, np.asarray(network.length), destination.node)
        if not math.isfinite(away[origin.node]):
            raise RouteError(f"no way leads from {way}; streets may be one-way or unconnected", field="destination")
        return spliced, origin, destination

    def _end(self, node: int, found: int | Snapped, asked: Place) -> End:
        if isinstance(found, Snapped) and not isinstance(asked, int):
            return End(node, f"{asked[0]:.5f},{asked[1]:.5f}", *found.place, found.away)
        longitude, latitude = self._snapper.town.place[node].tolist()
        return End(node, f"crossing {node}", latitude, longitude)

    def _with_counts(
        self, here: ScenarioMap, live: CountTable | Path | str | None, time: datetime | None
    ) -> tuple[ScenarioMap, int | None]:
        """The same crowds, but going on from current counts, and the number of sensors that these are of."""
        if live is None:
            return here, None
        if not isinstance(here.flow, SensorFlow):
            raise RouteError(
                f"live counts are of sensors, but the crowds of {self._scenario.name} come from a table", field="live"
            )
        if time is None:
            raise RouteError("live counts need a departure with its day, such as 2025-05-24T12:30", field="depart")
        with at_fault("live"):
            counts = live if isinstance(live, CountTable) else read_counts(Path(live))
            flow, counted = with_live_counts(self._venue, here.flow, counts, time)
        return replace(here, flow=flow), counted

    def _crowds(self) -> str:
        venue, source = self._venue, f"counts of {self._source}"
        if venue.tabled:
            return f"table {self._source}"
        if venue.counts == "auckland":
            source = "Auckland's counts (Heart of the City Auckland, CC BY 4.0)"
        paired = not venue.sensors or any(sensor.place is None for sensor in venue.sensors)
        return f"{source}, paired with these streets by a seed (synthetic)" if paired else source

    def _expected_crowds(self, hour: float | None, counted: int | None) -> str:
        if hour is None:
            return "those of the table from its first slot on"
        whose = "of the table" if self._venue.tabled else "that are usual"
        more = "" if counted is None else f", and go on from current counts of {counted} of {self._sensors} sensors"
        return f"those {whose} at this hour of the week, whatever the date{more}"


def _common(scenario: Scenario, request: RouteRequest) -> dict[str, Any]:
    """Facts of any request."""
    venue, synthetic = scenario.venue, "streets and crowds are synthetic"
    if venue is not None:
        synthetic = "" if venue.crowding == 1 else f"demand {venue.crowding:g} × the counts (an invented event day)"
    return {
        "scenario": scenario.name,
        "objective": None if scenario.objective is None else asdict(scenario.objective),
        "by_minutes": request.by,
        "synthetic": synthetic,
    }


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

    def nodes(array: Array, value: float) -> Array:
        return jax.device_put(np.pad(np.asarray(array), [(0, more), (0, 0)], constant_values=value))

    def segments(array: Array) -> Array:
        return jax.device_put(np.asarray(array)[kept])

    exits = (nodes(network.exit_node, ABSENT), nodes(network.exit_segment, ABSENT))
    of_segments = map(segments, (network.tail, network.head, network.length, network.width))
    return replace(
        spliced,
        network=RoadNetwork(nodes(network.position, 0), *exits, *of_segments),
        parent=spliced.parent[kept],
        street=spliced.street[kept],
        begin=spliced.begin[kept],
        end=spliced.end[kept],
    )
