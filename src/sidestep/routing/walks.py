"""The walks of a request: through the expected crowds, and through simulated futures."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from sidestep.environment.crossing import as_expected, cross
from sidestep.environment.rollout import Walk
from sidestep.environment.types import EnvParams, Instance
from sidestep.evaluation.metrics import spread
from sidestep.planners.base import Plan, Planner, Route, routes, walk_plan
from sidestep.planners.reactive import Snapshot
from sidestep.routing.directions import Leg, crowding_word, mean_density
from sidestep.routing.locate import LocatedRequest
from sidestep.routing.plan import BaselineTimes, RoutePlan, WalkTimes
from sidestep.routing.request import RouteError
from sidestep.scenarios.futures import make_environment, see_counts
from sidestep.scenarios.maps import purpose_key
from sidestep.walking.objective import Crossing

T = TypeVar("T")
FIRST_SLOTS = 4
"""Slots whose counts are shown to planners that see all counts; doubled until everybody has arrived within them."""


def plan_located(located: LocatedRequest, planner: Planner) -> RoutePlan:
    """Plan a route, walk it through the expected crowds and simulated futures, and walk baselines beside it.

    Raises
    ------
    RouteError
        A departure so late that the crowds of the walk are not known (field ``depart``).
    """
    by, by_default = located.facts.by_minutes, located.futures
    if planner.observes == "live":
        by_default = min(by_default, located.live_futures)
    walker = _Walker.of(located, located.request.futures or by_default)
    route = walker.expected_route(planner)
    _check_covered(located, route)
    walks = walker.walk(planner, walker.params.futures.count, route.seconds)
    density = np.asarray(walker.params.expected.of(jnp.int32(0)).known_density)
    legs, steps, streets = located.on_map(_legs(walker.alone, density, route), density[:, 0])
    return RoutePlan(
        **vars(located.facts),
        **vars(walks.times()),
        planner=planner.name,
        nodes=list(route.nodes),
        minutes=[(clock - route.clocks[0]) / 60 for clock in route.clocks],
        legs=legs,
        steps=steps,
        metres=sum(leg.metres for leg in legs),
        expected_minutes=route.seconds / 60,
        arrives=route.arrived,
        mean_density=mean_density(legs),
        crowding=crowding_word(mean_density(legs)),
        exposure=sum(leg.exposure for leg in legs),
        too_dense=sum(leg.too_dense for leg in legs),
        arrive_by=spread(walks.minutes, walks.arrived, by)["arrive_by"],
        baselines=walker.baselines(walks, route.seconds),
        streets=streets,
    )


def _check_covered(located: LocatedRequest, route: Route) -> None:
    scenario, departure = located.scenario, located.clock
    covered = scenario.slots * scenario.slot_seconds
    if departure + route.seconds > covered and departure > scenario.departures[1]:
        raise RouteError(
            f"crowds are known for {covered / 60:g} minutes, but a walk that departs at {departure / 60:g} takes "
            f"{route.seconds / 60:.0f}; depart earlier",
            field="depart",
        )


@dataclass(frozen=True, eq=False)
class _Walks:
    """One planner's walks through futures."""

    planner: Planner
    minutes: Float[np.ndarray, " future"]
    arrived: Bool[np.ndarray, " future"]
    exposure: Float[np.ndarray, " future"] | None

    def times(self) -> WalkTimes:
        found = spread(self.minutes, self.arrived, None)
        return WalkTimes(
            level=self.planner.level,
            futures=len(self.minutes),
            median_minutes=found["median_minutes"],
            p90_minutes=found["p90_minutes"],
            arrival_rate=float(self.arrived.mean()),
        )

    def against(self, plan: "_Walks") -> BaselineTimes:
        """In the mean of those futures that both walked."""
        count, met = len(self.minutes), None
        if self.exposure is not None and plan.exposure is not None:
            met = float(np.mean(self.exposure - plan.exposure[:count]))
        return BaselineTimes(
            **vars(self.times()),
            mean_difference_minutes=float(np.mean(self.minutes - plan.minutes[:count])),
            mean_difference_exposure=met,
        )


@dataclass(frozen=True, eq=False)
class _Walker:
    """Walks one request through expected crowds and through futures."""

    located: LocatedRequest
    params: EnvParams
    key: Key[Array, ""]

    @staticmethod
    def of(located: LocatedRequest, futures: int) -> "_Walker":
        scenario, here = located.scenario, located.scenario_map
        params = make_environment(
            scenario,
            here,
            "test",
            futures,
            level="map",
            destinations=np.array([[located.facts.destination.node]]),
            hours=located.hours,
            densities=True,
        )
        return _Walker(located, params, purpose_key(here, "test"))

    @property
    def alone(self) -> EnvParams:
        """The expected crowds as the only future."""
        return as_expected(self.params)

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

    def walk(self, planner: Planner, futures: int, seconds: float) -> _Walks:
        """Walk through the first of the futures; ``seconds`` is about how long that takes."""
        todo = self._instances(futures)

        def through(params: EnvParams) -> tuple[Walk, float]:
            walked = walk_plan(planner, params, self._plan(planner, params, todo), todo, self.key)
            return walked, float(walked.seconds.max())

        params = replace(self.params, futures=self.params.futures.first(futures))
        walked = self._informed(planner, params, 1.2 * seconds, through)
        minutes, exposure = np.asarray(walked.seconds, np.float64) / 60, walked.measures.get("exposure")
        met = None if exposure is None else np.asarray(exposure, np.float64)
        return _Walks(planner, minutes, np.asarray(walked.arrived), met)

    def baselines(self, walks: _Walks, seconds: float) -> dict[str, BaselineTimes]:
        """Other planners in the same futures; those that see all counts in the first of them."""
        located, count = self.located, len(walks.minutes)
        few = min(count, located.live_futures)
        return {
            planner.name: self.walk(planner, few if planner.observes == "live" else count, seconds).against(walks)
            for planner in located.baselines
            if planner.name != walks.planner.name
        }

    def _informed(
        self, planner: Planner, params: EnvParams, seconds: float, walk: Callable[[EnvParams], tuple[T, float]]
    ) -> T:
        """The result of a walk whose planner sees what its level allows.

        Planners that see all counts are shown those of the first slots: enough for a walk of ``seconds``, and more if
        ``walk``, which returns a result and its seconds, takes longer.
        """
        scenario, departure = self.located.scenario, self.located.clock
        if planner.observes != "live":
            return walk(params)[0]
        slots, forecasts = FIRST_SLOTS, planner.name != Snapshot.name
        while slots * scenario.slot_seconds < departure + seconds:
            slots *= 2
        while True:
            flow, shown = self.located.scenario_map.flow, min(slots, scenario.slots)
            found, took = walk(see_counts(scenario, flow, params, shown, forecasts=forecasts))
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
            origin=jnp.full(count, located.facts.origin.node, jnp.int32),
            destination=jnp.full(count, located.facts.destination.node, jnp.int32),
            departure=jnp.full(count, located.clock, jnp.float32),
            future=jnp.arange(count, dtype=jnp.int32),
        )


@jax.jit
def _cross(params: EnvParams, segment: Array, clock: Array) -> Crossing:
    return cross(params, jnp.int32(0), segment, clock)


def _legs(alone: EnvParams, density: Float[np.ndarray, "segment slot"], route: Route) -> list[Leg]:
    """The segments of a route through the expected crowds, whose densities are given in persons/m²."""
    params = replace(alone, objective=alone.objective.measured())  # crossings then tell the crowds that they met
    length, expected = np.asarray(alone.network.length), alone.expected

    def leg(segment: int, before: float, after: float) -> Leg:
        crossed = _cross(params, jnp.int32(segment), jnp.float32(before))
        slot = min(int((before + after) / 2 // expected.slot_seconds), expected.slots - 1)
        return Leg(
            segment=segment,
            metres=float(length[segment]),
            minutes=(after - before) / 60,
            density=float(density[segment, slot]),
            exposure=float(crossed.measures["exposure"]),
            too_dense=bool(crossed.measures["too_dense"]),
        )

    return list(map(leg, route.segments, route.clocks, route.clocks[1:]))
