"""The plan that answers a request: the route through the expected crowds, and its times in simulated futures."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from sidestep.environment.costs import cross, with_mean_waits
from sidestep.environment.rollout import Walk
from sidestep.environment.types import Crossing, EnvParams, Instance, Level
from sidestep.evaluation.metrics import spread, totals_of
from sidestep.planners.base import Plan, Planner, Route, routes, walk_plan
from sidestep.planners.reactive import Snapshot
from sidestep.routing import formats
from sidestep.routing.directions import Leg, crowding_word, mean_density
from sidestep.routing.locate import LocatedRequest
from sidestep.routing.request import RouteError
from sidestep.scenarios.futures import make_environment, see_counts
from sidestep.scenarios.maps import purpose_key
from sidestep.walking.objective import Objective

T = TypeVar("T")
FIRST_SLOTS = 4
"""Slots whose counts are shown to planners that see all counts; doubled until everybody has arrived within them."""


@dataclass(frozen=True, eq=False)
class FutureWalks:
    """The walks of one planner through simulated futures."""

    level: Level
    """What the planner knows."""

    minutes: Float[np.ndarray, " future"]
    """Travel times; the horizon where a walk did not arrive."""

    arrived: Bool[np.ndarray, " future"]

    exposure: Float[np.ndarray, " future"] | None
    """Crowd met, person·s/m²; None where time is all that counts."""

    @staticmethod
    def of(planner: Planner, walked: Walk) -> "FutureWalks":
        """The results of a planner's walks."""
        totals = totals_of(walked)
        return FutureWalks(
            planner.level,
            np.asarray(walked.seconds, np.float64) / 60,
            np.asarray(walked.arrived),
            None if totals is None else totals.exposure,
        )

    def to_json(self) -> formats.WalksJson:
        """Quantiles and the share of walks that arrive."""
        found = spread(self.minutes, self.arrived, None)
        return {
            "level": self.level,
            "futures": len(self.minutes),
            "median_minutes": found["median_minutes"],
            "p90_minutes": found["p90_minutes"],
            "arrival_rate": float(self.arrived.mean()),
        }

    def against(self, plan: "FutureWalks") -> formats.BaselineJson:
        """The same, with the mean differences from those of a plan's walks through the same futures."""

        def difference(ours: Float[np.ndarray, " some"], theirs: Float[np.ndarray, " future"]) -> float:
            return float(np.mean(ours - theirs[: len(ours)]))

        met = None
        if self.exposure is not None and plan.exposure is not None:
            met = difference(self.exposure, plan.exposure)
        return {
            **self.to_json(),
            "mean_difference_minutes": difference(self.minutes, plan.minutes),
            "mean_difference_exposure": met,
        }


@dataclass(frozen=True, eq=False)
class RoutePlan:
    """A planned route, from which every output is made.

    Examples
    --------
    >>> import sidestep
    >>> grid = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
    >>> plan = sidestep.plan_route(grid, sidestep.RouteRequest(origin=0, destination=8, futures=10))
    >>> plan.route.nodes[0], plan.route.nodes[-1], len(plan.legs)
    (0, 8, 4)
    >>> plan.to_json()["arrival_rate"]
    1.0
    """

    located: LocatedRequest
    """The request, found on the streets."""

    planner: str
    """Name of the planner."""

    route: Route
    """The walk if crowds are as expected."""

    legs: tuple[Leg, ...]
    """Its segments."""

    walks: FutureWalks
    """The planner's walks through simulated futures."""

    baselines: Mapping[str, FutureWalks]
    """The walks of other planners through the first of the same futures, by name."""

    street_density: Float[np.ndarray, " street"]
    """Persons/m² that are expected on every street at the departure; on grids, on every segment."""

    def to_json(self) -> formats.PlanJson:
        """All that is known of the route, ready for ``json.dumps``."""
        located, request, objective = self.located, self.located.request, self.located.scenario.objective
        density, begins = mean_density(self.legs), self.route.clocks[0]
        steps = located.streets.steps(self.legs)
        return {
            "scenario": located.scenario.name,
            "objective": None if objective is None else asdict(objective),
            "planner": self.planner,
            "departure": None if located.departure.time is None else located.departure.time.isoformat(),
            "departure_minutes": located.departure.clock / 60,
            "departs": located.departure.text,
            "hour_of_week": located.departure.hour,
            "counted_sensors": located.counted_sensors,
            "sensors": located.sensors,
            "origin": located.origin.to_json(),
            "destination": located.destination.to_json(),
            "steps": None if steps is None else [step.to_json() for step in steps],
            "legs": [leg.to_json() for leg in self.legs],
            "nodes": list(self.route.nodes),
            "minutes": [(clock - begins) / 60 for clock in self.route.clocks],
            "metres": sum(leg.metres for leg in self.legs),
            "expected_minutes": self.route.seconds / 60,
            "arrives": self.route.arrived,
            "mean_density": density,
            "exposure": sum(leg.exposure for leg in self.legs),
            "too_dense": sum(leg.too_dense for leg in self.legs),
            "crowding": crowding_word(density),
            **self.walks.to_json(),
            "by_minutes": request.by,
            "arrive_by": spread(self.walks.minutes, self.walks.arrived, request.by)["arrive_by"],
            "baselines": {name: walks.against(self.walks) for name, walks in self.baselines.items()},
            "attribution": located.streets.attribution,
            "crowds": located.crowds,
            "expected_crowds": located.expected_crowds,
            "synthetic": located.synthetic,
        }

    def to_geojson(self) -> formats.GeoJson:
        """A GeoJSON feature collection (RFC 7946): the whole route, its legs, and both ends.

        Raises
        ------
        RouteError
            On grids, which have no coordinates (field ``format``).
        """
        return formats.geojson(self.to_json())

    def to_gpx(self) -> str:
        """GPX 1.1: a route of the turns, and a track of the whole course.

        GPX wants UTC, but counts are in local wall time of no given zone: times are written without one, and left out
        where the departure has no day.

        Raises
        ------
        RouteError
            On grids, which have no coordinates (field ``format``).
        """
        return formats.gpx(self.to_json())

    def to_text(self) -> str:
        """Directions and times for people, one line each."""
        return formats.text(self.to_json())


def plan_located(located: LocatedRequest, planner: Planner) -> RoutePlan:
    """Plan a route, walk it through the expected crowds and simulated futures, and walk baselines beside it.

    Raises
    ------
    RouteError
        A departure so late that the crowds on the way are not known (field ``depart``).
    """
    walker = _Walker.of(located, located.request.futures or _default_futures(located, planner))
    count = walker.params.futures.count  # one, where the forecast comes true
    route = walker.expected_route(planner)
    _check_covered(located, route)
    baselines = {
        baseline.name: walker.walk(
            baseline, min(count, located.live_futures) if baseline.observes == "live" else count, route.seconds
        )
        for baseline in located.baselines
        if baseline.name != planner.name
    }
    density = np.asarray(walker.params.expected.of(jnp.int32(0)).known_density)
    return RoutePlan(
        located,
        planner.name,
        route,
        _legs(located, walker.alone, density, route),
        walker.walk(planner, count, route.seconds),
        baselines,
        located.streets.densest(density[:, 0]),
    )


def _default_futures(located: LocatedRequest, planner: Planner) -> int:
    return min(located.futures, located.live_futures) if planner.observes == "live" else located.futures


def _check_covered(located: LocatedRequest, route: Route) -> None:
    scenario, departure = located.scenario, located.departure.clock
    covered = scenario.slots * scenario.slot_seconds
    if departure + route.seconds > covered and departure > scenario.departures[1]:
        raise RouteError(
            f"crowds are known for {covered / 60:g} minutes, but a walk that departs at {departure / 60:g} takes "
            f"{route.seconds / 60:.0f}; depart earlier",
            field="depart",
        )


@dataclass(frozen=True, eq=False)
class _Walker:
    """Walks one request through expected crowds and through futures."""

    located: LocatedRequest
    params: EnvParams
    key: Key[Array, ""]

    @staticmethod
    def of(located: LocatedRequest, futures: int) -> "_Walker":
        """The walker of a request through so many futures."""
        destinations = np.array([[located.destination.node]])
        params = make_environment(
            located.scenario,
            located.scenario_map,
            "test",
            futures,
            level="map",
            destinations=destinations,
            densities=True,
        )
        return _Walker(located, params, purpose_key(located.scenario_map, "test"))

    @property
    def alone(self) -> EnvParams:
        """The expected crowds as the only future."""
        return replace(with_mean_waits(self.params), futures=self.params.expected)

    def expected_route(self, planner: Planner) -> Route:
        """All of the walk through the expected crowds, however long it is."""
        once = self._instances(1)

        def whole(params: EnvParams) -> tuple[Route, float]:
            trace = params.network.nodes
            while True:
                (route,) = routes(planner, params, once, self.key, trace)
                if len(route.segments) < trace:
                    return route, route.seconds
                trace *= 8  # it may go on

        return self._informed(planner, self.alone, 0.0, whole)

    def walk(self, planner: Planner, futures: int, seconds: float) -> FutureWalks:
        """Walk through the first of the futures; ``seconds`` is about how long that takes."""
        todo = self._instances(futures)

        def through(params: EnvParams) -> tuple[Walk, float]:
            walked = walk_plan(planner, params, self._plan(planner, params, todo), todo, self.key)
            return walked, float(walked.seconds.max())

        params = replace(self.params, futures=self.params.futures.first(futures))
        return FutureWalks.of(planner, self._informed(planner, params, 1.2 * seconds, through))

    def _informed(
        self, planner: Planner, params: EnvParams, seconds: float, walk: Callable[[EnvParams], tuple[T, float]]
    ) -> T:
        """The result of a walk whose planner sees what it needs to.

        Planners that see all counts are shown those of the first slots, enough for about so many ``seconds``, and of
        more if the walk, which also returns its seconds, takes longer.
        """
        scenario, departure = self.located.scenario, self.located.departure.clock
        if planner.observes != "live":
            return walk(params)[0]
        slots = FIRST_SLOTS
        while slots * scenario.slot_seconds < departure + seconds:
            slots *= 2
        while True:
            shown, forecasts = min(slots, scenario.slots), planner.name != Snapshot.name
            found, took = walk(see_counts(scenario, self.located.scenario_map.flow, params, shown, forecasts=forecasts))
            if departure + took <= slots * scenario.slot_seconds or slots >= scenario.slots:
                return found
            slots *= 2

    def _plan(self, planner: Planner, params: EnvParams, todo: Instance) -> Plan:
        """One plan serves all futures, except in hindsight."""
        if planner.level == "hindsight":
            return planner.plan(params, todo)
        plan = planner.plan(params, self._instances(1))
        count = todo.origin.shape[0]
        own = jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf), count, axis=0), plan.own)
        return eqx.tree_at(lambda plan: plan.own, plan, own)

    def _instances(self, count: int) -> Instance:
        located = self.located
        return Instance(
            origin=jnp.full(count, located.origin.node, jnp.int32),
            destination=jnp.full(count, located.destination.node, jnp.int32),
            departure=jnp.full(count, located.departure.clock, jnp.float32),
            future=jnp.arange(count, dtype=jnp.int32),
        )


_cross_expected = jax.jit(lambda params, segment, clock: cross(params, jnp.int32(0), segment, clock))


def _legs(
    located: LocatedRequest, alone: EnvParams, density: Float[np.ndarray, "segment slot"], route: Route
) -> tuple[Leg, ...]:
    """The segments of a route through the expected crowds, whose densities are given in persons/m²."""
    params = replace(alone, objective=alone.objective or Objective())  # which makes crossings say what crowds they met
    length, expected = np.asarray(alone.network.length), alone.expected

    def one(segment: int, before: float, after: float) -> Leg:
        crossed: Crossing = _cross_expected(params, jnp.int32(segment), jnp.float32(before))
        slot = min(int((before + after) / 2 // expected.slot_seconds), expected.slots - 1)
        return Leg(
            segment,
            located.streets.piece(segment),
            metres=float(length[segment]),
            minutes=(after - before) / 60,
            density=float(density[segment, slot]),
            exposure=float(jnp.asarray(crossed.exposure)),
            too_dense=bool(crossed.too_dense),
        )

    steps = zip(route.segments, route.clocks, route.clocks[1:], strict=False)
    return tuple(one(*step) for step in steps)
