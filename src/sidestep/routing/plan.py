"""A planned route, and what it looks like as JSON, text, GeoJSON and GPX."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from sidestep.environment.types import Level
from sidestep.network.geodesy import metres_between
from sidestep.network.town import Town
from sidestep.routing.directions import Leg, Step
from sidestep.routing.formats import Waypoint, feature, gpx, table
from sidestep.routing.request import NO_COORDINATES, RouteError
from sidestep.scenarios.model import objective_in_words
from sidestep.scenarios.walkers import walker_in_words

T = TypeVar("T")
_DIGITS = {"metres": 2, "minutes": 3, "density": 4}  # in GeoJSON


@dataclass(frozen=True)
class End:
    """Where a route begins or ends."""

    node: int
    """Number of the node; on split streets one beyond those of the town."""

    asked: str
    """What was asked for, for people."""

    latitude: float | None = None
    """Degrees, on the street; None on grids."""

    longitude: float | None = None
    """Degrees, on the street; None on grids."""

    metres_away: float = 0.0
    """Between the place that was asked for and the one on the street."""


@dataclass(frozen=True, kw_only=True)
class RequestFacts:
    """What is known of a request before a route is planned."""

    scenario: str
    """Name of the scenario."""

    objective: dict[str, float | None] | None
    """Weights of the objective; None: time alone."""

    walker: dict[str, Any] | None = None
    """The walker's numbers, and how many streets are left out; None for the adult that walks unless told otherwise."""

    origin: End
    destination: End

    departure: str | None = None
    """Local time, ISO 8601; None where no day was given."""

    departure_minutes: float = 0.0
    """Minutes after the scenario's start; a scenario in a town starts with the departure."""

    departs: str
    """The departure for people."""

    hour_of_week: float | None = None
    """Of the departure, 0 is Monday 0:00; None where crowds do not depend on it."""

    by_minutes: float | None
    """The minutes that were asked about."""

    sensors: int | None = None
    """Number of sensors; None where crowds are not known from sensors."""

    counted_sensors: int | None = None
    """Number of sensors with current counts; None where no counts were given."""

    attribution: str
    """Source and licence of the streets."""

    crowds: str
    """Source of the crowds."""

    expected_crowds: str
    """The crowds that are expected, after "Crowds are …"."""

    synthetic: str
    """What is invented, and by how much; empty where nothing is."""


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

    mean_difference_minutes: float
    """Above zero where it takes longer than the plan."""

    mean_difference_exposure: float | None
    """Above zero where it meets more people, person·s/m²; None where time is all that counts."""


@dataclass(frozen=True, eq=False)
class StreetMap:
    """The streets around a route, for pictures."""

    town: Town

    density: Float[np.ndarray, " street"]
    """Persons/m² that are expected on every street at the departure; of both directions the larger."""


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

    nodes: list[int]
    """Nodes along the route."""

    minutes: list[float]
    """Minutes after the departure at which each node is reached."""

    legs: list[Leg]
    """The segments between the nodes."""

    steps: list[Step] | None
    """Turn by turn; None on grids."""

    metres: float
    """Length of the route."""

    expected_minutes: float
    """Travel time if crowds are as expected."""

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
        if not points:
            raise RouteError(NO_COORDINATES, field="format")
        return points

    @property
    def sources(self) -> list[str]:
        """Where streets and crowds come from, and what is synthetic."""
        said = {"Streets": self.attribution, "Crowds": self.crowds, "Synthetic": self.synthetic}
        return [f"{what}: {words}" for what, words in said.items() if words]

    def to_json(self) -> dict[str, Any]:
        """Everything but the map, ready for ``json.dumps``."""
        return {name: value for name, value in asdict(replace(self, streets=None)).items() if name != "streets"}

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
        course, found = self.course, self.to_json()
        sources = {name: found.pop(name) for name in ("attribution", "crowds", "synthetic")}
        ends = [
            feature("Point", [end.longitude, end.latitude], part=part, asked=end.asked)
            for part, end in (("origin", self.origin), ("destination", self.destination))
        ]
        for name in ("origin", "destination", "legs", "nodes", "minutes"):
            del found[name]
        legs = []
        for leg in self.legs:
            rounded = {name: round(getattr(leg, name), digits) for name, digits in _DIGITS.items()}
            legs.append(feature("LineString", leg.coordinates or [], part="leg", street=leg.label, **rounded))
        whole = feature("LineString", course, part="route", **found)
        return {"type": "FeatureCollection", **sources, "features": [whole, *legs, *ends]}

    def to_gpx(self) -> str:
        """GPX 1.1: a route of the turns, and a track of the whole course.

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
        course = self.course
        length = f"{self.metres:,.0f} m, {self.expected_minutes:.1f} min"
        summary = f"{self.planner}, departing {self.departs}: {length} if crowds are as expected"
        zone = [] if self.departure is None else ["Times are local wall time"]
        about = ". ".join([summary, *self._arrival(), *self.sources[1:], *zone]) + "."
        tracks = [
            [Waypoint(place, entered + share * leg.minutes) for place, share in _with_shares(leg.coordinates or [])]
            for leg, entered in zip(self.legs, self.minutes, strict=False)
        ]
        turns = []
        for step in self.steps or []:
            turn, lasts = f"{step.turn}: {step.street}", f"{step.metres:.0f} m, {step.minutes:.1f} min"
            turns.append(replace(tracks[step.first_leg][0], name=turn, about=lasts))
        turns.append(Waypoint(course[-1], self.minutes[-1], "arrive" if self.arrives else "end"))
        name = f"{self.origin.asked} to {self.destination.asked}"
        return gpx(name, about, self.attribution, self.departure, turns, _joined(tracks))

    def to_text(self) -> str:
        """Directions and times for people."""
        low = "" if self.objective is None else f", keeping low {objective_in_words(self.objective)}"
        missed = "" if self.arrives else " without arriving"
        length = f"{self.metres:,.0f} m, {self.expected_minutes:.1f} min{missed}"
        crowds = f"{self.crowding}, {self.mean_density:.2f} persons/m², {self.exposure:,.0f} person·s/m² met"
        warning = f"{self.too_dense} of its streets are entered above the density that nobody should enter."
        ends = [end for end in (self.origin, self.destination) if end.metres_away >= 1]
        lines = [
            f"{self.planner} ({self.level}), departing {self.departs}{low}, if crowds are as expected:",
            *([] if self.walker is None else [f"Walker: {walker_in_words(self.walker)}"]),
            *(f"{end.asked} is {end.metres_away:,.0f} m from the street" for end in ends),
            "",
            *self._table(),
            "",
            f"{length}; crowds on the way: {crowds}",
            *([warning] if self.too_dense else []),
            f"In {self.futures} simulated future{'s' * (self.futures > 1)}: {self.in_words()}",
            *self._arrival(),
            *(self._against(name, baseline) for name, baseline in self.baselines.items()),
            "",
            f"Crowds are {self.expected_crowds}.",
            f"{'. '.join(self.sources)}.",
        ]
        return "\n".join(lines) + "\n"

    def _arrival(self) -> list[str]:
        """A sentence, if the request asked."""
        if self.arrive_by is None:
            return []
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

    def _against(self, name: str, baseline: BaselineTimes) -> str:
        futures = "the same futures" if baseline.futures == self.futures else f"the first {baseline.futures} of them"
        more, met = baseline.mean_difference_minutes, baseline.mean_difference_exposure
        crowd = "" if met is None else f", {abs(met):,.0f} person·s/m² {'more' if met >= 0 else 'less'} met"
        longer = f"on average {abs(more):.1f} min {'longer' if more >= 0 else 'shorter'}{crowd}"
        return f"{name} in {futures}: {baseline.in_words()}; {longer}"


def _joined(parts: Sequence[Sequence[T]]) -> list[T]:
    """The points of all parts; those at which two of them meet come once."""
    return [point for number, part in enumerate(parts) for point in part[number > 0 :]]


def _with_shares(course: list[list[float]]) -> list[tuple[list[float], float]]:
    """Points of a course, each with the share of the length that lies before it."""
    points = np.array(course)
    along = np.append(0.0, metres_between(points[:-1], points[1:]).cumsum())
    return list(zip(course, (along / max(float(along[-1]), 1e-12)).tolist(), strict=True))
