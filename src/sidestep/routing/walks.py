"""The walks of a request: through the expected crowds, and through simulated futures."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from sidestep.environment.crossing import as_expected, cross
from sidestep.environment.rollout import Walk
from sidestep.environment.types import EnvParams, Instance
from sidestep.evaluation.metrics import spread
from sidestep.planners.base import Plan, Planner, Route, routes, walk_plan
from sidestep.planners.reactive import Snapshot
from sidestep.routing.directions import Leg, crowding_word, mean_density, opening_word
from sidestep.routing.locate import LocatedRequest
from sidestep.routing.plan import BaselineTimes, RoutePlan, WalkTimes
from sidestep.routing.request import RouteError
from sidestep.scenarios.futures import make_environment, see_counts
from sidestep.scenarios.maps import purpose_key

T = TypeVar("T", Route, Walk)
FIRST_SLOTS = 4
"""Slots whose counts are shown to planners that see all counts; doubled until everybody has arrived within them."""


def plan_located(located: LocatedRequest, planner: Planner) -> RoutePlan:
    """Plan a route, walk it through the expected crowds and simulated futures, and walk baselines beside it.

    Parameters
    ----------
    located
        The request.
    planner
        Who plans.

    Returns
    -------
    RoutePlan
        The route, and how its walks and those of the baselines went.

    Raises
    ------
    RouteError
        A departure so late that the crowds of the walk are not known (field ``depart``).
    """
    walker = _Walker(located, located.request.futures or located.futures_of(planner, located.futures))
    alone, count = as_expected(walker.params), walker.params.futures.count
    route = walker.expected_route(planner, alone)
    _check_covered(located, route)
    walks = walker.walk(planner, count, route.seconds)
    baselines = {
        other.name: walker.walk(other, located.futures_of(other, count), route.seconds).against(walks)
        for other in located.baselines
        if other.name != planner.name
    }
    density = np.asarray(walker.params.expected.of(jnp.int32(0)).known_density)
    legs, steps, streets = located.on_map(_legs(alone, density, route), density[:, 0])
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
        arrive_by=spread(walks.minutes, walks.arrived, located.request.by)["arrive_by"],
        baselines=baselines,
        streets=streets,
    )


def _check_covered(located: LocatedRequest, route: Route) -> None:
    scenario, departure = located.scenario, located.clock
    covered = scenario.slots * scenario.slot_seconds
    if departure + route.seconds > covered and departure > scenario.departures[1]:
        known = f"crowds are known for {covered / 60:g} minutes, but a walk that departs at {departure / 60:g}"
        raise RouteError(f"{known} takes {route.seconds / 60:.0f}; depart earlier", field="depart")


@dataclass(frozen=True, eq=False)
class _Walks:
    """One planner's walks through futures."""

    planner: Planner
    minutes: Float[np.ndarray, " future"]
    arrived: Bool[np.ndarray, " future"]
    exposure: Float[np.ndarray, " future"] | None

    def times(self) -> WalkTimes:
        found, rate = spread(self.minutes, self.arrived, None), float(self.arrived.mean())
        return WalkTimes(
            level=self.planner.level,
            futures=len(self.minutes),
            median_minutes=found["median_minutes"],
            p90_minutes=found["p90_minutes"],
            arrival_rate=rate,
        )

    def against(self, plan: "_Walks") -> BaselineTimes:
        """In the mean of those futures that both walked."""
        count, met = len(self.minutes), None
        if self.exposure is not None and plan.exposure is not None:
            met = float(np.mean(self.exposure - plan.exposure[:count]))
        longer = float(np.mean(self.minutes - plan.minutes[:count]))
        return BaselineTimes(**vars(self.times()), mean_difference_minutes=longer, mean_difference_exposure=met)


class _Walker:
    """Walks one request through expected crowds and through futures."""

    def __init__(self, located: LocatedRequest, futures: int) -> None:
        scenario, here, nodes = located.scenario, located.scenario_map, np.array([[located.facts.destination.node]])
        self._located, self._key = located, purpose_key(here, "test")
        self.params = make_environment(
            scenario, here, "test", futures, level="map", destinations=nodes, hours=located.hours, densities=True
        )

    def expected_route(self, planner: Planner, alone: EnvParams) -> Route:
        """All of the walk through the expected crowds, the only future of ``alone``, however long it is."""

        def whole(params: EnvParams) -> Route:
            trace = params.network.nodes
            while True:
                (route,) = routes(planner, params, self._instances(1), self._key, trace)
                if len(route.segments) < trace:
                    return route
                trace *= 8  # it may go on

        return self._informed(planner, alone, 0.0, whole)

    def walk(self, planner: Planner, futures: int, seconds: float) -> _Walks:
        """Walk through the first of the futures; ``seconds`` is about how long that takes."""
        todo = self._instances(futures)

        def through(params: EnvParams) -> Walk:
            return walk_plan(planner, params, self._plan(planner, params, todo), todo, self._key)

        params = replace(self.params, futures=self.params.futures.first(futures))
        walked = self._informed(planner, params, 1.2 * seconds, through)
        minutes, exposure = np.asarray(walked.seconds, np.float64) / 60, walked.measures.get("exposure")
        met = None if exposure is None else np.asarray(exposure, np.float64)
        return _Walks(planner, minutes, np.asarray(walked.arrived), met)

    def _informed(self, planner: Planner, params: EnvParams, seconds: float, walk: Callable[[EnvParams], T]) -> T:
        """The result of a walk whose planner sees what its level allows.

        Parameters
        ----------
        planner, params
            The planner, and an environment of level ``map``.
        seconds
            Planners that see all counts are shown those of the first slots: enough for a walk of these seconds, and
            more if it takes longer.
        walk
            Walks an environment.

        Returns
        -------
        Route or Walk
            What ``walk`` returns.
        """
        scenario, departure = self._located.scenario, self._located.clock
        if planner.observes != "live":
            return walk(params)
        slots, forecasts = FIRST_SLOTS, planner.name != Snapshot.name
        while slots * scenario.slot_seconds < departure + seconds:
            slots *= 2
        while True:
            flow, shown = self._located.scenario_map.flow, min(slots, scenario.slots)
            found = walk(see_counts(scenario, flow, params, shown, forecasts=forecasts))
            latest = departure + float(np.max(found.seconds))
            if latest <= slots * scenario.slot_seconds or slots >= scenario.slots:
                return found
            slots *= 2

    def _plan(self, planner: Planner, params: EnvParams, todo: Instance) -> Plan:
        """One plan serves all futures, except in hindsight."""
        if planner.level == "hindsight":
            return planner.plan(params, todo)
        plan = planner.plan(params, self._instances(1))
        own = jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf), len(todo.origin), axis=0), plan.own)
        return replace(plan, own=own)

    def _instances(self, count: int) -> Instance:
        facts = self._located.facts
        origin, destination = (jnp.full(count, end.node, jnp.int32) for end in (facts.origin, facts.destination))
        departure = jnp.full(count, self._located.clock, jnp.float32)
        return Instance(origin, destination, departure, jnp.arange(count, dtype=jnp.int32))


_cross = jax.jit(cross)


def _legs(alone: EnvParams, density: Float[np.ndarray, "segment slot"], route: Route) -> list[Leg]:
    """The segments of a route through the expected crowds, whose densities are given in persons/m²."""
    params = replace(alone, objective=alone.objective.measured())  # crossings then tell the crowds that they met
    length, expected, hour = np.asarray(alone.network.length), alone.expected, float(alone.futures.hour[0])

    def leg(segment: int, before: float, after: float) -> Leg:
        crossed = _cross(params, jnp.int32(0), jnp.int32(segment), jnp.float32(before))
        shut = float(params.gates_in(jnp.int32(0))(jnp.int32(segment), jnp.float32(before)))
        slot = min(int((before + after) / 2 // expected.slot_seconds), expected.slots - 1)
        return Leg(
            segment=segment,
            metres=float(length[segment]),
            minutes=(after - before) / 60,
            opens=opening_word(hour, before, shut),
            minutes_until_open=shut / 60,
            density=float(density[segment, slot]),
            exposure=float(crossed.measures["exposure"]),
            too_dense=bool(crossed.measures["too_dense"]),
        )

    return list(map(leg, route.segments, route.clocks, route.clocks[1:]))
