"""A planned route, and what it looks like as JSON, text, GeoJSON and GPX."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

import numpy as np

from sidestep.environment.types import Level
from sidestep.network.geodesy import metres_between
from sidestep.routing.directions import Leg, Step
from sidestep.routing.facts import RequestFacts, StreetMap, collection, without_map
from sidestep.routing.formats import GpxRoute, Waypoint, feature, gpx, table
from sidestep.routing.request import on_map
from sidestep.scenarios.model import objective_in_words

T = TypeVar("T")
_DIGITS = {"metres": 2, "minutes": 3, "density": 4}  # in GeoJSON


@dataclass(frozen=True)
class WalkTimes:
    """The times of one planner's walks through simulated futures."""

    level: Level
    """What the planner knows."""

    futures: int
    """Number of simulated futures."""

    median_minutes: float
    """Median of the times; a walk that does not arrive counts as the horizon."""

    p90_minutes: float
    """Their 90 % quantile."""

    arrival_rate: float
    """Share of the walks that arrive."""

    def in_words(self) -> str:
        """For people."""
        arrive = f"{100 * self.arrival_rate:.1f} % arrive"
        return f"median {self.median_minutes:.1f} min, 90 % within {self.p90_minutes:.1f} min, {arrive}"


@dataclass(frozen=True, kw_only=True)
class BaselineTimes(WalkTimes):
    """Another planner in the same futures, or in the first of them."""

    plan_median_minutes: float
    """Median of the plan's times in the futures that both walked."""

    plan_p90_minutes: float
    """Their 90 % quantile."""

    mean_difference_minutes: float
    """In the mean of these futures; above zero where it takes longer than the plan."""

    mean_difference_exposure: float | None
    """Above zero where it meets more people, person·s/m²; None where time is all that counts."""


@dataclass(frozen=True, kw_only=True)
class RoutePlan(RequestFacts, WalkTimes):
    """A planned route: the walk if crowds are as expected, and its times in simulated futures.

    Fields that mean nothing on a grid, such as names of streets, are None there. The keys of :meth:`to_json` are the
    fields, except ``streets``.

    Examples
    --------
    >>> import sidestep
    >>> grid = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
    >>> plan = sidestep.plan_route(grid, sidestep.RouteRequest(origin=0, destination=8, futures=10))
    >>> plan.nodes[0], plan.nodes[-1], len(plan.legs), plan.arrival_rate
    (0, 8, 4, 1.0)
    >>> print(plan.to_text().splitlines()[0])
    expected (map), departing 0 min after the start, if crowds are as expected:
    """

    planner: str
    """Name of the planner."""

    nodes: list[int | None]
    """Nodes along the route; None for an end in the middle of a street."""

    minutes: list[float]
    """Minutes after the departure at which each node is reached."""

    legs: list[Leg]
    """The segments between the nodes."""

    steps: list[Step] | None
    """Turn by turn; None on grids."""

    metres: float
    """Length of the route."""

    expected_minutes: float
    """Expected travel time: each street takes the mean of its times in many futures, entered when it is reached."""

    arrives: bool
    """Whether that walk arrives."""

    mean_density: float
    """Persons/m², averaged over the time."""

    crowding: str
    """A word for the mean density."""

    exposure: float
    """Crowd met, person·s/m²."""

    too_dense: int
    """Number of segments entered above the objective's maximum density."""

    arrive_by: float | None
    """Share of the futures in which the walk arrives within these minutes."""

    baselines: Mapping[str, BaselineTimes]
    """The walks of other planners, by name."""

    cost_minutes: float
    """Cost by the objective in expected times and mean crowds; travel time where time is all that counts."""

    shared: float | None = None
    """Of an alternative: largest share of its length, or of that of a better route, that both have in common."""

    alternatives: Sequence["RoutePlan"] = ()
    """Other routes, the best first. Each is fixed beforehand, whatever crowds do."""

    asked_alternatives: int = 0
    """The most that were asked for."""

    streets: StreetMap | None = field(compare=False, repr=False)
    """For pictures; None on grids."""

    @property
    def course(self) -> list[list[float]]:
        """Longitude and latitude of the whole route, degrees; points at which two legs meet come once.

        Returns
        -------
        list
            One ``[longitude, latitude]`` for each point.

        Raises
        ------
        RouteError
            On grids, which have no coordinates (field ``format``).
        """
        points = _joined([leg.coordinates or [] for leg in self.legs])
        return on_map(points or None)

    def to_json(self) -> dict[str, Any]:
        """Everything but the map, ready for ``json.dumps``; alternatives do not repeat what was asked."""
        found = without_map(replace(self, alternatives=()), "streets")
        repeated = {*(asked.name for asked in fields(RequestFacts)), "baselines", "alternatives", "asked_alternatives"}
        others = [other.to_json().items() for other in self.alternatives]
        found["alternatives"] = [{name: value for name, value in other if name not in repeated} for other in others]
        return found

    def to_geojson(self) -> dict[str, Any]:
        """A GeoJSON feature collection (RFC 7946): the whole route, its legs, and both ends.

        Returns
        -------
        dict
            Ready for ``json.dumps``; coordinates are longitudes and latitudes in degrees.

        Raises
        ------
        RouteError
            On grids, which have no coordinates (field ``format``).
        """
        ends = [
            feature("Point", [end.longitude, end.latitude], part=part, asked=end.asked)
            for part, end in (("origin", self.origin), ("destination", self.destination))
        ]
        legs = []
        for leg in self.legs:
            rounded = {name: round(getattr(leg, name), digits) for name, digits in _DIGITS.items()}
            legs.append(feature("LineString", leg.coordinates or [], part="leg", street=leg.label, **rounded))
        whole = feature("LineString", self.course, part="route", **self._properties())
        others = [
            feature("LineString", other.course, part="alternative", **other._properties())  # noqa: SLF001
            for other in self.alternatives
        ]
        return collection(self, [whole, *legs, *others, *ends])

    def _properties(self) -> dict[str, Any]:
        """What GeoJSON says of the whole route."""
        elsewhere = {"attribution", "crowds", "synthetic", "origin", "destination", "avoided_area"}
        elsewhere |= {"legs", "nodes", "minutes", "alternatives"}
        return {name: value for name, value in self.to_json().items() if name not in elsewhere}

    def to_gpx(self) -> str:
        """GPX 1.1: a route of the turns and a track of the whole course, and the same for each alternative.

        Times are local wall time without a zone, and left out where the departure has no day.

        Returns
        -------
        str
            An XML document.

        Raises
        ------
        RouteError
            On grids, which have no coordinates (field ``format``).
        """
        summary = f"{self.planner}, departing {self.departs}: {self._length()} if crowds are as expected"
        zone = [] if self.departure is None else ["Times are local wall time"]
        about = ". ".join([summary, *self._arrival(), *self.sources[1:], *zone]) + "."
        name = f"{self.origin.asked} to {self.destination.asked}"
        others = [
            other._gpx_route(f"alternative {number}, by {other.by_way_of}")  # noqa: SLF001
            for number, other in enumerate(self.alternatives, start=1)
        ]
        return gpx(name, about, self.attribution, self.departure, [self._gpx_route(name), *others])

    def _length(self) -> str:
        return f"{self.metres:,.0f} m, {self.expected_minutes:.1f} min"

    def _gpx_route(self, name: str) -> GpxRoute:
        """The turns and the course, with the minutes at which each point is reached."""
        course = self.course
        tracks = [
            [Waypoint(place, entered + share * leg.minutes) for place, share in _with_shares(leg.coordinates or [])]
            for leg, entered in zip(self.legs, self.minutes, strict=False)
        ]
        turns = []
        for step in self.steps or []:
            turn, lasts = f"{step.turn}: {step.street}", f"{step.metres:.0f} m, {step.minutes:.1f} min"
            turns.append(replace(tracks[step.first_leg][0], name=turn, about=lasts))
        turns.append(Waypoint(course[-1], self.minutes[-1], "arrive" if self.arrives else "end"))
        return GpxRoute(name, self._length(), turns, _joined(tracks))

    def to_text(self) -> str:
        """Directions and times for people."""
        low = "" if self.objective is None else f", keeping low {objective_in_words(self.objective)}"
        missed = "" if self.arrives else " without arriving"
        length = f"{self._length()}{missed}"
        crowds = f"{self.crowding}, {self.mean_density:.2f} persons/m², {self.exposure:,.0f} person·s/m² met"
        warning = f"{self.too_dense} of its streets are entered above the density that nobody should enter."
        ends = [end for end in (self.origin, self.destination) if end.metres_away >= 1]
        lines = [
            f"{self.planner} ({self.level}), departing {self.departs}{low}, if crowds are as expected:",
            *(f"{end.asked} is {end.metres_away:,.0f} m from the street" for end in ends),
            "",
            *self._table(),
            "",
            f"{length}; crowds on the way: {crowds}",
            *([warning] if self.too_dense else []),
            f"In {self.futures} simulated future{'s' * (self.futures > 1)}: {self.in_words()}",
            *self._arrival(),
            *(self._against(name, baseline) for name, baseline in self.baselines.items()),
            *self._others(),
            "",
            *self.notes(),
        ]
        return "\n".join(lines) + "\n"

    def _arrival(self) -> list[str]:
        """A sentence, if the request asked."""
        if self.arrive_by is None:
            return []
        if self.deadline is not None:
            sure = f"by {self.deadline} with probability {self.confidence:g} or more"
            return [f"The latest departure that arrives {sure}; it does with probability {self.arrive_by:.2f}"]
        return [f"Arrives within {self.by_minutes:g} min with probability {self.arrive_by:.2f}"]

    def _table(self) -> list[str]:
        """Turn by turn, or, where turns have no names, node by node."""
        if self.steps is None:
            reached = zip(self.nodes, self.minutes, strict=True)
            return table((">node", ">minutes"), [(str(node), f"{minutes:.1f}") for node, minutes in reached])
        rows = [
            (s.turn, s.street, f"{s.metres:,.0f}", f"{s.minutes:.1f}", s.crowding, f"{s.density:.2f}")
            for s in self.steps
        ]
        end = [("arrive", "", "", "", "", "")] if self.arrives else []
        return table(("", "street", ">metres", ">minutes", "crowds", ">persons/m²"), [*rows, *end])

    def _others(self) -> list[str]:
        """One line for each alternative, and one if there are fewer than were asked for."""
        lines = [""] if self.asked_alternatives else []
        for number, other in enumerate(self.alternatives, start=1):
            length = f"{other._length()}, {100 * (other.shared or 0):.0f} % shared"  # noqa: SLF001
            lines.append(f"Alternative {number}, by {other.by_way_of}: {length}; {other.crowding}; {other.in_words()}")
        if len(self.alternatives) < self.asked_alternatives:
            found = len(self.alternatives) or "No"
            lines.append(
                f"{found} of {self.asked_alternatives} alternatives: others differ too little or cost too much"
            )
        return lines

    @property
    def by_way_of(self) -> str:
        """The longest streets of the route, in its order; its nodes where streets have no names."""
        if self.steps is None:
            return f"nodes {' '.join(map(str, self.nodes))}"
        named = [step for step in self.steps if any(leg.name == step.street for leg in self.legs)] or self.steps
        longest = sorted(named, key=lambda step: -step.metres)[:3]
        return ", ".join(dict.fromkeys(step.street for step in named if step in longest))

    def _against(self, name: str, baseline: BaselineTimes) -> str:
        futures = "the same futures" if baseline.futures == self.futures else f"the first {baseline.futures} of them"
        more, met = baseline.mean_difference_minutes, baseline.mean_difference_exposure
        crowd = "" if met is None else f", {abs(met):,.0f} person·s/m² {'more' if met >= 0 else 'less'} met"
        minutes = f"{abs(more):.1f}"
        longer, than = f"{minutes} min {'longer' if more >= 0 else 'shorter'}", "than"
        if float(minutes) == 0:
            longer, than = "as long", "as"
        if baseline.futures != self.futures:  # other futures, other times: those of the route above do not compare
            there = f"median {baseline.plan_median_minutes:.1f} min, 90 % within {baseline.plan_p90_minutes:.1f} min"
            longer = f"{longer} {than} the route (in these: {there})"
        return f"{name} in {futures}: {baseline.in_words()}; on average {longer}{crowd}"


def _joined(parts: Sequence[Sequence[T]]) -> list[T]:
    """The points of all parts; those at which two of them meet come once."""
    return [point for number, part in enumerate(parts) for point in part[number > 0 :]]


def _with_shares(course: list[list[float]]) -> list[tuple[list[float], float]]:
    """Points of a course, each with the share of the length that lies before it."""
    points = np.array(course)
    along = np.append(0.0, metres_between(points[:-1], points[1:]).cumsum())
    return list(zip(course, (along / max(float(along[-1]), 1e-12)).tolist(), strict=True))
