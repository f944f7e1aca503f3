"""The ends of a request on the streets, and its departure. The only module here that tells grids from towns."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import MAXYEAR, datetime
from functools import partial
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from sidestep.crowds.counts import CountTable, read_counts
from sidestep.crowds.profile import time_of_week
from sidestep.crowds.wall_time import local_time
from sidestep.network.graph import ABSENT
from sidestep.network.snapping import Snapper, SplitStreets, StreetPoint, split_streets
from sidestep.planners.base import Planner
from sidestep.planners.reactive import Snapshot
from sidestep.planners.shortest_path import ShortestPath, distances_to
from sidestep.routing.directions import Leg, Step, directions
from sidestep.routing.plan import End, RequestFacts, StreetMap
from sidestep.routing.request import Counts, Place, RouteError, RouteRequest, at_fault
from sidestep.scenarios.maps import ScenarioMap, with_live_counts
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import Grid, Venue
from sidestep.scenarios.streets import walked_streets, walker_facts
from sidestep.scenarios.values import DAYS

FUTURES = 200
"""Futures that are simulated by default."""

LIVE_FUTURES = 20
"""The same in towns for planners that see all counts: forecasts in every slot of every future take long."""

BASELINES: tuple[Planner, ...] = (ShortestPath(), Snapshot())
"""Planners that plans in towns are compared with."""

SPARE_NODES, SPARE_SEGMENTS = 2, 4
"""Nodes and segments that two ends in the middle of streets add at most. Where they add fewer, arrays are padded, so
that all requests have the same shapes and share their compiled programs."""


OnMap = tuple[list[Leg], list[Step] | None, StreetMap | None]


@dataclass(frozen=True, eq=False, kw_only=True)
class LocatedRequest:
    """A request with all that a planner needs to know. On grids, as it stands, streets have no names or coordinates."""

    request: RouteRequest
    facts: RequestFacts
    scenario: Scenario

    scenario_map: ScenarioMap
    """The streets, split at the ends, and the crowds on them from clock 0 on."""

    hours: Sequence[float]
    """Hour of the week at clock 0, for the one destination."""

    baselines: tuple[Planner, ...] = ()
    """Planners that the plan is compared with."""

    live_futures: int = FUTURES
    """The most futures that planners that see all counts walk by default."""

    clock: float = 0.0
    """Departure, seconds since the scenario's start."""

    @property
    def futures(self) -> int:
        """Futures that are simulated by default."""
        return 1 if self.scenario.place.certain else FUTURES

    def futures_of(self, planner: Planner, count: int) -> int:
        """How many of ``count`` futures a planner walks by default."""
        return min(count, self.live_futures) if planner.observes == "live" else count

    def on_map(
        self,
        legs: list[Leg],
        density: Float[np.ndarray, " segment"],  # noqa: ARG002 - for maps of towns
    ) -> OnMap:
        """The legs with their streets, turns, and a map, given the densities on all segments in persons/m²."""
        return legs, None, None


@dataclass(frozen=True, eq=False, kw_only=True)
class TownRequest(LocatedRequest):
    """A request in a town."""

    streets: SplitStreets
    """The streets of the map with their names and coordinates."""

    baselines: tuple[Planner, ...] = BASELINES
    live_futures: int = LIVE_FUTURES

    def on_map(self, legs: list[Leg], density: Float[np.ndarray, " segment"]) -> OnMap:
        """Name the streets of the legs, put turns into words, and show the densest crowd of each street."""
        town, street_of = self.streets.town, self.streets.street
        named = []
        for leg in legs:
            street, course = int(street_of[leg.segment]), np.round(self.streets.course(leg.segment), 7).tolist()
            named.append(
                replace(leg, street=street, name=town.name[street], kind=town.kind[street], coordinates=course)
            )
        densest = np.zeros(town.streets, density.dtype)
        np.maximum.at(densest, street_of, density)
        return named, directions(named), StreetMap(town, densest)


def locator(scenario: Scenario, scenario_map: ScenarioMap) -> Callable[[RouteRequest], LocatedRequest]:
    """Prepare to locate requests on one map of a scenario.

    Parameters
    ----------
    scenario, scenario_map
        The problem, and its map.

    Returns
    -------
    Callable
        Finds the ends of a request, and the crowds at its departure. It raises a :class:`SidestepError`, whose
        ``field`` names the field of the request, for nodes that do not exist, places outside the town, ends that no
        path connects, and departures and live counts without known crowds.
    """
    if isinstance(scenario.place, Grid):
        return partial(_locate_on_grid, scenario, scenario_map)
    return TownLocator(scenario, scenario_map, scenario.place).locate


def _requested_ends(request: RouteRequest, nodes: int, first: int, last: int) -> dict[str, Place]:
    """The places that were asked for, by field; by default the ``first`` node and the ``last``."""
    asked: dict[str, Place] = {}
    for name, place, default in (("origin", request.origin, first), ("destination", request.destination, last)):
        asked[name] = end = default if place is None else place
        if isinstance(end, int) and not 0 <= end < nodes:
            raise RouteError(f"the {name} is node {end}, but nodes are numbered 0 to {nodes - 1}", field=name)
    return asked


def _locate_on_grid(scenario: Scenario, scenario_map: ScenarioMap, request: RouteRequest) -> LocatedRequest:
    """Ends are nodes, and the departure is minutes after the scenario's start."""
    ends: dict[str, End] = {}
    minutes = 0 if request.depart is None else request.depart
    nodes = scenario_map.network.nodes
    for name, place in _requested_ends(request, nodes, 0, nodes - 1).items():
        if not isinstance(place, int):
            raise RouteError(f"the {name} must be a node: a grid has no latitudes and longitudes", field=name)
        ends[name] = End(place, f"node {place}")
    if isinstance(minutes, datetime) or not 0 <= 60 * minutes < scenario.horizon:
        most = f"{scenario.horizon / 60:g}"
        raise RouteError(f"the departure must be minutes between 0 and {most}, not {minutes}", field="depart")
    if request.live is not None:
        raise RouteError("a grid has no sensors; leave out the live counts", field="live")
    facts = RequestFacts(
        scenario=scenario.name,
        objective=scenario.objective.to_json(),
        walker=walker_facts(scenario),
        by_minutes=request.by,
        synthetic=scenario.place.synthetic,
        origin=ends["origin"],
        destination=ends["destination"],
        departs=f"{minutes:g} min after the start",
        departure_minutes=minutes,
        attribution="a grid of random lengths",
        crowds="simulated",
        expected_crowds="those that the scenario expects",
    )
    return LocatedRequest(
        request=request,
        facts=facts,
        scenario=scenario,
        scenario_map=scenario_map,
        hours=scenario.place.departure_hours(1),
        clock=60 * minutes,
    )


class TownLocator:
    """Ends are nodes or places near streets, which are split there; the departure is a local time."""

    def __init__(self, scenario: Scenario, scenario_map: ScenarioMap, venue: Venue) -> None:
        self._scenario, self._map, self._venue = scenario, scenario_map, venue
        self._streets = walked_streets(venue.streets, scenario.walker)
        self._snapper = Snapper(self._streets.town)
        self._source = Path(venue.crowd_source.file).name
        self._sensors = len(set(scenario_map.sensors)) or None

    def locate(self, request: RouteRequest) -> LocatedRequest:
        """Find both ends on the streets, and the crowds at the departure."""
        hour, time, departs = self._departure(request.depart)
        streets, origin, destination = self._ends(request)
        here, counted = self._with_counts(self._map.on_pieces(streets), request.live, time)
        facts = RequestFacts(
            scenario=self._scenario.name,
            objective=self._scenario.objective.to_json(),
            walker=walker_facts(self._scenario),
            by_minutes=request.by,
            synthetic=self._venue.synthetic,
            origin=origin,
            destination=destination,
            departure=None if time is None else time.isoformat(),
            departs=departs,
            hour_of_week=hour,
            sensors=self._sensors,
            counted_sensors=counted,
            attribution=streets.town.attribution,
            crowds=self._venue.attribution,
            expected_crowds=self._expected_crowds(hour, counted),
        )
        scenario = self._scenario.changed(departures=(0.0, 0.0))  # so that no slots are drawn that nobody walks in
        hours = self._venue.departure_hours(1) if hour is None else [hour]
        return TownRequest(
            request=request, facts=facts, scenario=scenario, scenario_map=here, hours=hours, streets=streets
        )

    def _departure(self, depart: datetime | float | None) -> tuple[float | None, datetime | None, str]:
        """Hour of the week and local time, where there are such, and both for people."""
        flow = self._map.flow
        if not flow.timed:
            if depart is None:
                return None, None, "as the table begins"
            said = "has slots without times, so walks depart as it begins; leave out the departure"
            raise RouteError(f"{self._source} {said}", field="depart")
        if depart is None:
            hour, time = self._venue.departure_hours(1)[0], None
            day, minute = divmod(round(60 * hour), 24 * 60)
            departs = f"{DAYS[day % 7]} {minute // 60:02}:{minute % 60:02}"
        elif isinstance(depart, datetime) and depart.year < MAXYEAR:
            with at_fault("depart"):
                time = local_time(depart, self._venue.timezone)
            hour, departs = time_of_week(time), f"{DAYS[time.weekday()]} {time:%Y-%m-%d %H:%M}"
        else:
            said = "the departure must be a local time, such as 2025-05-24T12:30"
            raise RouteError(f"{said}, not {depart}", field="depart")
        if not flow.covers(hour):
            raise RouteError(f"{self._source} covers {flow.coverage}, but the departure is {departs}", field="depart")
        return hour, time, departs

    def _ends(self, request: RouteRequest) -> tuple[SplitStreets, End, End]:
        """Both ends, on streets that are split there, so that either end of the street can be walked to."""
        town, known = self._snapper.town, self._streets.crossings.tolist()
        asked = _requested_ends(request, town.nodes, known[0], known[-1])
        found: list[int | StreetPoint] = []
        for name, place in asked.items():
            if isinstance(place, int) and place not in known:
                said = f"{self._scenario.walker.called} cannot get to the {name}, crossing {place}; choose another"
                raise RouteError(said, field=name)
            with at_fault(name):
                found.append(place if isinstance(place, int) else self._snapper.nearest(*place))
        streets = padded(split_streets(town, found))
        origin, destination = map(self._end, streets.nodes, found, asked.values())
        if origin.node == destination.node:
            said = f"{origin.asked} and {destination.asked} are the same place on these streets; choose two"
            raise RouteError(said, field="destination")
        away = distances_to(streets.network, np.asarray(streets.network.length), destination.node)
        if not math.isfinite(away[origin.node]):
            said = f"no path leads from {origin.asked} to {destination.asked}; streets may be one-way or unconnected"
            raise RouteError(said, field="destination")
        return streets, origin, destination

    def _end(self, node: int, found: int | StreetPoint, asked: Place) -> End:
        if isinstance(found, StreetPoint) and not isinstance(asked, int):
            return End(node, f"{asked[0]:.5f},{asked[1]:.5f}", *found.place, found.distance)
        return End(node, f"crossing {node}", *self._snapper.town.place[node, ::-1].tolist())

    def _with_counts(
        self, here: ScenarioMap, live: Counts | None, time: datetime | None
    ) -> tuple[ScenarioMap, int | None]:
        """The same crowds, but going on from current counts, and the number of sensors that these are of."""
        if live is None:
            return here, None
        if self._sensors is None:
            said = f"live counts are of sensors, but the crowds of {self._scenario.name} come from a table"
            raise RouteError(said, field="live")
        if time is None:
            raise RouteError("live counts need a departure with its day, such as 2025-05-24T12:30", field="depart")
        with at_fault("live"):
            counts = live if isinstance(live, CountTable) else read_counts(Path(live), self._venue.layout)
            return with_live_counts(here, counts, time)

    def _expected_crowds(self, hour: float | None, counted: int | None) -> str:
        if hour is None:
            return "those of the table from its first slot on"
        whose = "of the table" if self._sensors is None else "that are expected"
        more = "" if counted is None else f", and go on from current counts of {counted} of {self._sensors} sensors"
        return f"those {whose} at this hour of the week, whatever the date{more}"


def padded(streets: SplitStreets) -> SplitStreets:
    """Pad arrays to the size that they have for two ends in the middle of streets.

    No exit leads to the spare nodes and segments, which are copies of the first segment: no walk, no search and no
    cost to go knows of them.

    Parameters
    ----------
    streets
        Split at one end, at two, or at none.

    Returns
    -------
    SplitStreets
        The same streets.
    """
    town, network = streets.town, streets.network
    more = town.nodes + SPARE_NODES - network.nodes
    extra = len(town.street_of_segment()[0]) + SPARE_SEGMENTS - network.segments
    kept = np.append(np.arange(network.segments), np.zeros(extra, int))
    columns = {name: getattr(network, name) for name in ("tail", "head", "length", "width", "enters")}
    of_segments = {name: np.asarray(column)[kept] for name, column in columns.items() if column is not None}
    of_nodes = {
        name: np.pad(getattr(network, name), [(0, more), (0, 0)], constant_values=value)
        for name, value in (("position", 0), ("exit_node", ABSENT), ("exit_segment", ABSENT))
    }
    if network.area is not None:
        of_nodes["area"] = np.pad(network.area, (0, more), constant_values=ABSENT)
    pieces = {name: getattr(streets, name)[kept] for name in ("parent", "street", "begin", "end")}
    return replace(streets, network=replace(network, **jax.device_put(of_nodes | of_segments)), **pieces)
