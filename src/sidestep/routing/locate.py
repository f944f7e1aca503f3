"""The ends of a request on the streets, and its departure. With located.py all that tells grids from towns."""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, Self, runtime_checkable

import jax
import numpy as np

from sidestep.crowds.counts import CountTable, read_counts
from sidestep.crowds.live import LiveCounts
from sidestep.network.graph import ABSENT
from sidestep.network.polygons import read_polygons
from sidestep.network.snapping import Snapper, SplitStreets, StreetPoint, split_streets
from sidestep.planners.shortest_path import distances_to
from sidestep.routing.clocks import GridClock, TownClock, check_known, covered_before, next_after, town_clock
from sidestep.routing.facts import SceneFacts
from sidestep.routing.located import Located, LocatedInTown, NodeEnd
from sidestep.routing.paces import Paces
from sidestep.routing.places import AskedPlace
from sidestep.routing.request import NO_COORDINATES, Area, Counts, Departure, Place, RouteError, at_fault, called
from sidestep.scenarios.maps import ScenarioMap, sensor_names, with_latest_counts, with_live_counts
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import Grid, Venue
from sidestep.scenarios.streets import walked_streets, walker_facts

SPARE_NODES, SPARE_SEGMENTS = 2, 4
"""Nodes and segments that two ends in the middle of streets add at most. Where they add fewer, arrays are padded, so
that all requests have the same shapes and share their compiled programs."""

LEAST_WINDOW = 1800.0
"""Seconds; windows of departures are this long, twice as long, four times, …, which keeps the number of shapes low."""


@dataclass(frozen=True, kw_only=True)
class Circumstances:
    """What requests of all kinds may say beside their places."""

    depart: Departure | None = None
    """The departure, by default the first usual one."""

    live: Counts | None = None
    """Current counts."""

    avoid: Area | None = None
    """Polygons whose streets are not walked."""

    exclude: Sequence[str] = ()
    """Kinds of streets that are not walked."""

    after: Departure | None = None
    """Where ``depart`` is a time of day alone, it is the next one after this."""

    field: str = "depart"
    """The parameter that ``depart`` is of."""

    lookback: bool = False
    """Whether clock 0 lies as long before ``depart`` as a walk may take, instead of there."""

    until: Departure | None = None
    """The latest departure that matters."""

    window: float = 0.0
    """Seconds from the first departure to the latest that matters where ``until`` is not given."""


@runtime_checkable
class Locator(Protocol):
    """Locates requests on one map of a scenario."""

    def changed(self, scenario: Scenario, /) -> Self:
        """The same for a scenario that has another objective."""

    def locate(self, asked: Sequence[AskedPlace], given: Circumstances) -> Located:
        """Find places on the streets, and the crowds at the departure.

        Parameters
        ----------
        asked, given
            The places, and what else was asked.

        Returns
        -------
        Located
            Streets with a node at every place, and crowds from clock 0 on.

        Raises
        ------
        SidestepError
            With the parameter at fault as its ``field``, and its line where a place is from a file: nodes that do not
            exist, places outside the town or inside the area to avoid, departures and live counts without known crowds.
        """


def locator(scenario: Scenario, scenario_map: ScenarioMap) -> Locator:
    """Prepare to locate requests on one map of a scenario."""
    if isinstance(scenario.place, Grid):
        return GridLocator(scenario, scenario_map, Paces(scenario_map))
    return TownLocator(scenario, scenario_map, scenario.place)


def connected(located: Located) -> Located:
    """Refuse a route between two ends that no path connects, and leave out streets from which none leads on.

    Parameters
    ----------
    located
        With origin and destination as its ends.

    Returns
    -------
    Located
        The same where all streets lead to the destination.

    Raises
    ------
    RouteError
        With the field ``destination``, or ``avoid`` where the area to avoid is in the way.
    """
    network, (origin, destination) = located.scenario_map.network, located.ends
    if origin.node == destination.node and not located.may_stay:
        said = f"{origin.asked} and {destination.asked} are the same place on these streets; choose two"
        raise RouteError(said, field="destination")
    lost = ~np.isfinite(distances_to(network, np.asarray(network.length), destination.node))
    if not lost[origin.node]:
        # Streets of other programs have some, and those around an area to avoid: walkers must not stray there.
        astray = ~lost[np.asarray(network.tail)] & lost[np.asarray(network.head)]
        if not astray.any():
            return located
        return replace(located, scenario_map=replace(located.scenario_map, network=network.without(astray)))
    if located.facts.avoided_streets:
        said = f"no path leads from {origin.asked} to {destination.asked} around the area to avoid; make it smaller"
        raise RouteError(said, field="avoid")
    said = f"no path leads from {origin.asked} to {destination.asked}; streets may be one-way or unconnected"
    raise RouteError(said, field="destination")


def _requested(asked: AskedPlace, nodes: int) -> Place:
    """The place that is asked for; RouteError where there is none, and for nodes that do not exist."""
    place = asked.place
    if place is None:
        option = "--to" if asked.field == "destination" else "--from"
        said = f"{asked.called} ({option}) is missing; give LAT,LON such as 60.1699,24.9384, or a crossing's number"
        raise RouteError(said)
    if isinstance(place, int) and not 0 <= place < nodes:
        raise RouteError(f"{asked.called} is node {place}, but nodes are numbered 0 to {nodes - 1}")
    return place


@dataclass(frozen=True, eq=False)
class GridLocator:
    """Ends are nodes, and the departure is minutes after the scenario's start."""

    scenario: Scenario
    scenario_map: ScenarioMap
    paces: Paces

    def changed(self, scenario: Scenario, /) -> Self:
        return replace(self, scenario=scenario)

    def locate(self, asked: Sequence[AskedPlace], given: Circumstances) -> Located:
        scenario, ends = self.scenario, tuple(map(self._end, asked))
        start = GridClock(scenario.horizon)
        clock = start.clock(given.depart, given.field)
        if given.live is not None:
            raise RouteError("a grid has no sensors; leave out the live counts", field="live")
        if given.avoid is not None:
            raise RouteError(NO_COORDINATES, field="avoid")
        if given.exclude:
            raise RouteError("streets of grids are of no kind; leave out exclude", field="exclude")
        facts = SceneFacts(
            scenario=scenario.name,
            objective=scenario.objective.to_json(),
            walker=walker_facts(scenario),
            synthetic=scenario.place.synthetic,
            attribution="a grid of random lengths",
            crowds="simulated",
            expected_crowds="those that the scenario expects",
            **start.facts(clock),
        )
        return Located(
            ends=ends,
            facts=facts,
            scenario=scenario,
            scenario_map=self.scenario_map,
            start=start,
            paces=self.paces,
            clock=clock,
            latest=clock + given.window if given.until is None else start.clock(given.until, "until"),
        )

    def _end(self, asked: AskedPlace) -> NodeEnd:
        nodes = self.scenario_map.network.nodes
        corners = {"origin": 0, "destination": nodes - 1}  # as in the paper
        with asked.at_fault():
            place = _requested(asked if asked.place is not None else replace(asked, place=corners[asked.field]), nodes)
            if not isinstance(place, int):
                raise RouteError(f"{asked.called} must be a node: a grid has no latitudes and longitudes")
        return NodeEnd(place, f"node {place}", label=asked.label)


class TownLocator:
    """Ends are nodes or places near streets, which are split there; the departure is a local time."""

    def __init__(self, scenario: Scenario, scenario_map: ScenarioMap, venue: Venue) -> None:
        self._scenario, self._map, self._venue = scenario, scenario_map, venue
        self._streets = walked_streets(venue.streets, scenario.walker)
        self.snapper, self._crossings = Snapper(self._streets.town), set(self._streets.crossings.tolist())
        self._sensors = len(set(scenario_map.sensors)) or None
        self.paces = Paces(scenario_map)

    def changed(self, scenario: Scenario, /) -> Self:
        other = copy(self)
        other._scenario = scenario  # noqa: SLF001 - of this class
        return other

    def clock(self, depart: Departure | None, field: str) -> TownClock:
        """Let clock 0 be a departure (:func:`sidestep.routing.clocks.town_clock`)."""
        return town_clock(self._venue, self._map.flow, depart, field)

    def locate(self, asked: Sequence[AskedPlace], given: Circumstances) -> LocatedInTown:
        departs = self.clock(next_after(given.depart, given.after, self._venue.timezone), given.field)
        before = covered_before(departs, self._map.flow, self._scenario) if given.lookback else 0.0
        start = departs.earlier(before)
        latest = before + (given.window if given.until is None else departs.clock(given.until, "until"))
        check_known(self._venue, self._map.flow, start.earlier(-latest), "until")
        streets, ends, avoided = self._on_streets(asked, given)
        here, counted = self._with_counts(self._map.on_pieces(streets), given, start)
        facts = SceneFacts(
            scenario=self._scenario.name,
            objective=self._scenario.objective.to_json(),
            walker=walker_facts(self._scenario),
            synthetic=self._venue.synthetic,
            sensors=self._sensors,
            counted_sensors=counted,
            **avoided,
            attribution=streets.town.attribution,
            crowds=self._venue.attribution,
            expected_crowds=self._expected_crowds(start, counted),
            **start.facts(before),
        )
        # No slots are drawn that nobody walks in, and none after a deadline: crowds then stay as they are.
        window = (
            0.0
            if latest == 0 or given.lookback
            else LEAST_WINDOW * 2 ** max(0, math.ceil(math.log2(latest / LEAST_WINDOW)))
        )
        return LocatedInTown(
            ends=ends,
            facts=facts,
            scenario=self._scenario.changed(departures=(0.0, window)),
            scenario_map=here,
            start=start,
            paces=self.paces if counted is None else None,
            clock=before,
            latest=latest,
            streets=streets,
        )

    def _on_streets(
        self, asked: Sequence[AskedPlace], given: Circumstances
    ) -> tuple[SplitStreets, tuple[NodeEnd, ...], dict[str, Any]]:
        """All places on streets that are split there, and facts of what is avoided."""
        town, found = self.snapper.town, list(map(self._snapped, asked))
        streets = padded(split_streets(town, found), len(found))
        ends, avoid = tuple(map(self._end, streets.nodes, found, asked)), given.avoid
        if given.exclude:
            with at_fault("exclude"):
                closed = town.of_kinds(given.exclude)[streets.street]
            streets = replace(streets, network=streets.network.without(closed))
        if avoid is None:
            return streets, ends, {}
        with at_fault("avoid"):
            area = read_polygons(avoid, town)
        for each, end in zip(asked, ends, strict=True):
            points = [[end.longitude, end.latitude], *([each.place[::-1]] if isinstance(each.place, tuple) else [])]
            if area.contains(np.array(points)).any():
                said = f"{each.called}, {end.asked}, lies inside the area to avoid; choose another place or area"
                raise RouteError(said, field="avoid")
        closed = area.crossed(streets)
        network = streets.network.without(closed)
        avoided = {"avoided_streets": len(np.unique(streets.street[closed])), "avoided_area": area.rings}
        return replace(streets, network=network), ends, avoided

    def _snapped(self, asked: AskedPlace) -> int | StreetPoint:
        """The crossing that is asked for, or the place on the nearest street."""
        with asked.at_fault():
            place = _requested(asked, self.snapper.town.nodes)
            if not isinstance(place, int):
                return self.snapper.nearest(*place)
            if place not in self._crossings:
                said = f"{self._scenario.walker.called} cannot get to {asked.called}, crossing {place}; choose another"
                raise RouteError(said)
        return place

    def _end(self, node: int, found: int | StreetPoint, asked: AskedPlace) -> NodeEnd:
        if isinstance(found, StreetPoint) and isinstance(asked.place, tuple):
            latitude, longitude = asked.place
            return NodeEnd(node, f"{latitude:.5f},{longitude:.5f}", *found.place, found.distance, asked.label)
        longitude, latitude = self.snapper.town.place[node].tolist()
        return NodeEnd(node, f"crossing {node}", latitude, longitude, label=asked.label)

    def _with_counts(self, here: ScenarioMap, given: Circumstances, start: TownClock) -> tuple[ScenarioMap, int | None]:
        """The same crowds, but going on from current counts, and the number of sensors that these are of."""
        if (live := given.live) is None:
            return here, None
        if isinstance(live, LiveCounts):
            latest = None if start.date is None else live.latest(sensor_names(here), start.date)
            return (here, None) if latest is None else (with_latest_counts(here, latest), latest.known)
        if self._sensors is None:
            said = f"live counts are of sensors, but the crowds of {self._scenario.name} come from a table"
            raise RouteError(said, field="live")
        if start.date is None:
            said = f"live counts need {called(given.field)} with its day, such as 2025-05-24T12:30"
            raise RouteError(said, field=given.field)
        with at_fault("live"):
            counts = live if isinstance(live, CountTable) else read_counts(Path(live), self._venue.layout)
            return with_live_counts(here, counts, start.date)

    def _expected_crowds(self, start: TownClock, counted: int | None) -> str:
        if not start.timed:
            return "those of the table from its first slot on"
        whose = "of the table" if self._sensors is None else "that are expected"
        more = "" if counted is None else f", and go on from current counts of {counted} of {self._sensors} sensors"
        return f"those {whose} at this hour of the week, whatever the date{more}"


def padded(streets: SplitStreets, points: int = 2) -> SplitStreets:
    """Pad arrays to the size that they have for two ends in the middle of streets, for four, for eight, ….

    No exit leads to the spare nodes and segments, which are copies of the first segment: no walk, no search and no
    cost to go knows of them.

    Parameters
    ----------
    streets
        Split at some points.
    points
        At how many, or more.

    Returns
    -------
    SplitStreets
        The same streets.
    """
    town, network = streets.town, streets.network
    times = 2 ** max(0, math.ceil(math.log2(max(points, 1) / SPARE_NODES)))
    more = town.nodes + times * SPARE_NODES - network.nodes
    extra = len(town.street_of_segment()[0]) + times * SPARE_SEGMENTS - network.segments
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
