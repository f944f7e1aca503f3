"""A walk that is asked for: where it begins and ends on the streets, when, and through which crowds."""

import math
import re
from dataclasses import dataclass, replace
from datetime import MAXYEAR, datetime
from pathlib import Path

import numpy as np

from sidestep.crowds.base import FlowModel
from sidestep.crowds.counts import CountTable
from sidestep.crowds.profile import time_of_week
from sidestep.crowds.sensors import SensorFlow
from sidestep.crowds.table_flow import TableFlow
from sidestep.network.snap import Snapped, Snapper
from sidestep.network.splice import Spliced, splice
from sidestep.network.town import Town
from sidestep.planners.shortest_path import distances_to
from sidestep.routing.grid_plan import RouteError
from sidestep.scenarios.build import town_of, with_live_counts
from sidestep.scenarios.maps import ScenarioMap
from sidestep.scenarios.model import DAYS, Scenario, Venue

_PLACE = re.compile(r"\s*([-+]?[\d.]+)\s*,\s*([-+]?[\d.]+)\s*", re.ASCII)


@dataclass(frozen=True)
class Departure:
    """When somebody sets out. Usual crowds depend on the hour of the week alone, or on no time at all."""

    hour: float | None  # of the week, 0 is Monday 0:00; None: with the first slot of crowds that know no time
    time: datetime | None = None  # local wall time, where a day was given

    @property
    def text(self) -> str:
        """Day of the week, date and time."""
        if self.time is not None:
            return f"{DAYS[self.time.weekday()]} {self.time:%Y-%m-%d %H:%M}"
        return "as the table begins" if self.hour is None else _day_and_time(self.hour)


def _day_and_time(hour: float) -> str:
    """Of an hour of the week."""
    day, minute = divmod(round(60 * hour), 24 * 60)
    return f"{DAYS[day % 7]} {minute // 60:02}:{minute % 60:02}"


@dataclass(frozen=True)
class End:
    """Where a walk begins or ends."""

    node: int  # of the spliced streets
    place: tuple[float, float]  # latitude and longitude on the street
    asked: tuple[float, float] | None = None  # where it was asked for; None where a crossing was
    away: float = 0.0  # m between the two

    @property
    def text(self) -> str:
        """What was asked for."""
        return f"crossing {self.node}" if self.asked is None else f"{self.asked[0]:.5f},{self.asked[1]:.5f}"


AUCKLAND = "Auckland's counts (Heart of the City Auckland, CC BY 4.0)"


@dataclass(frozen=True)
class Trip:
    """A walk that is to be planned."""

    scenario: Scenario
    venue: Venue
    streets: Spliced
    place: ScenarioMap  # at the hour of the departure
    origin: End
    destination: End
    departure: Departure
    counted: int | None  # sensors whose current counts are known; None where none were given

    @property
    def crowds(self) -> str:
        """Where the crowds come from."""
        if self.venue.tabled:
            return f"table {Path(self.venue.counts).name}"
        ours = self.venue.counts == "auckland"
        whose = AUCKLAND if ours else f"counts of {Path(self.venue.counts).name}"
        paired = not self.venue.sensors or any(sensor.place is None for sensor in self.venue.sensors)
        return f"{whose}, paired with these streets by a seed (synthetic)" if paired else whose

    @property
    def certain(self) -> bool:
        """Whether all futures are alike: crowds come exactly as in a table, and nobody waits at lights."""
        return self.venue.tabled and self.venue.noise[1] == 0 and self.venue.traffic is None

    @property
    def splits(self) -> bool:
        """Whether it begins or ends in the middle of a street."""
        return self.streets.network.nodes > self.streets.town.nodes


def read_place(option: str, text: str) -> int | tuple[float, float]:
    """A node, or latitude and longitude in degrees, as people write them.

    Raises
    ------
    RouteError
        What is neither.
    """
    if re.fullmatch(r"\s*[-+]?\d{1,18}\s*", text, re.ASCII):
        return int(text)
    found = _PLACE.fullmatch(text)
    try:
        if found:
            return float(found[1]), float(found[2])
    except ValueError:
        pass
    raise RouteError(f"{option} must be a node or LAT,LON such as 60.1699,24.9384, not {text!r:.60}")


def read_node(option: str, text: str) -> int:
    """A node of a grid.

    Raises
    ------
    RouteError
        What is none.
    """
    place = read_place(option, text)
    if isinstance(place, int):
        return place
    raise RouteError(f"{option} must be a node, not {text}: a grid has no latitudes and longitudes")


def read_minutes(text: str) -> float:
    """Minutes after the start of a scenario.

    Raises
    ------
    RouteError
        What is no number.
    """
    try:
        minutes = float(text)
    except ValueError:
        minutes = math.nan
    if not math.isfinite(minutes):
        raise RouteError(f"--depart must be a number of minutes, not {text!s:.60}")
    return minutes


def read_departure(text: str | None, venue: Venue, *, timed: bool = True) -> Departure:
    """Local wall time in ISO 8601; by default the first hour at which people usually set out.

    Crowds that are not ``timed`` know no hours: walks begin with their first slot, and no time can be asked for.

    Raises
    ------
    RouteError
        What is no such time, and times with a zone or an offset, which the counts do not have; any time where crowds
        know none.
    """
    if not timed:
        if text is None:
            return Departure(None)
        raise RouteError(
            f"{Path(venue.counts).name} has slots without times, so all walks set out as it begins; leave out --depart"
        )
    if text is None:
        return Departure(venue.starts(1)[0])
    try:
        time = datetime.fromisoformat(text.strip())
    except ValueError:
        time = None
    if time is None or len(text.strip()) <= len("2025-05-24") or time.year == MAXYEAR:
        raise RouteError(f"--depart must be a local time such as 2025-05-24T12:30, not {text!r:.60}")
    if time.tzinfo is not None:
        raise RouteError(
            f"--depart must be local wall time without zone or offset, such as 2025-05-24T12:30, not {text}"
        )
    return Departure(time_of_week(time), time)


def prepare(
    scenario: Scenario,
    place: ScenarioMap,
    origin: int | tuple[float, float],
    destination: int | tuple[float, float],
    departure: Departure,
    counts: CountTable | None = None,
) -> Trip:
    """Find both ends on the streets, and the crowds at the hour of the departure.

    A place in the middle of a street splits it, so that it can be left by either end, and entered by either.

    Parameters
    ----------
    scenario, place
        Of a venue, and its only map.
    origin, destination
        Nodes, or latitude and longitude in degrees.
    counts
        Current counts, from which crowds go on.

    Raises
    ------
    SidestepError
        Nodes that there are not, places outside the town, no way between them, a departure about which a table says
        nothing, counts of another place or time, or where crowds come from a table.
    """
    venue = scenario.venue
    if venue is None:
        raise RouteError(f"{scenario.name} is no real place; give nodes and minutes")
    town = town_of(venue.streets)
    snap = Snapper(town)
    found = [_find(town, snap, "origin", origin), _find(town, snap, "destination", destination)]
    streets = splice(town, found)
    ends = (_end(town, streets.nodes[0], found[0], origin), _end(town, streets.nodes[1], found[1], destination))
    if streets.nodes[0] == streets.nodes[1]:
        raise RouteError(f"{ends[0].text} and {ends[1].text} are the same place on these streets: no way to walk")
    network = streets.network
    if not math.isfinite(distances_to(network, np.asarray(network.length), streets.nodes[1])[streets.nodes[0]]):
        raise RouteError(f"no way leads from {ends[0].text} to {ends[1].text}; streets may be one-way or apart")
    # Futures are simulated: there are only as many recorded weeks as were counted, and none goes on from now.
    here, counted = place.spliced(streets), None
    if departure.hour is not None:
        _check_covered(place.flow, departure.hour, departure.text, venue)
        here = here.beginning([departure.hour])
    if counts is not None:
        if not isinstance(here.flow, SensorFlow):
            raise RouteError(f"--live takes counts of sensors, but the crowds of {scenario.name} come from a table")
        if departure.time is None:
            raise RouteError("current counts need a departure with its day, such as --depart 2025-05-24T12:30")
        flow, counted = with_live_counts(venue, here.flow, counts, departure.time)
        here = replace(here, flow=flow)
    return Trip(scenario, venue, streets, here, *ends, departure, counted)


def _check_covered(flow: FlowModel, hour: float, said: str, venue: Venue) -> None:
    """Refuse hours of the week about which a table says nothing."""
    if isinstance(flow, TableFlow) and flow.begins is not None and not flow.covers(hour):
        raise RouteError(
            f"{Path(venue.counts).name} covers {flow.span / 3600:g} hours from {_day_and_time(flow.begins)} on, "
            f"but the departure is {said}"
        )


def _find(town: Town, snap: Snapper, name: str, place: int | tuple[float, float]) -> int | Snapped:
    if not isinstance(place, int):
        return snap.nearest(*place)
    if not 0 <= place < town.nodes:
        raise RouteError(f"there is no node {place} to be the {name}; nodes are numbered 0 to {town.nodes - 1}")
    return place


def _end(town: Town, node: int, found: int | Snapped, asked: int | tuple[float, float]) -> End:
    if isinstance(found, int) or isinstance(asked, int):
        longitude, latitude = town.place[node].tolist()
        return End(node, (latitude, longitude))
    return End(node, found.place, asked, found.away)
