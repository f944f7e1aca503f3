"""The walks of a request: by expected times, and through simulated futures."""

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.environment.crossing import as_expected, cross
from sidestep.environment.rollout import Walk
from sidestep.environment.types import EnvParams, Instance
from sidestep.evaluation.metrics import spread
from sidestep.planners.base import Plan, Planner, Route, routes, walk_plan
from sidestep.planners.reactive import Snapshot
from sidestep.routing.alternatives import alternatives
from sidestep.routing.directions import Leg, crowding_word, mean_density, opening_word
from sidestep.routing.located import Located
from sidestep.routing.plan import BaselineTimes, RoutePlan, WalkTimes
from sidestep.routing.request import RouteRequest
from sidestep.scenarios.futures import make_environment, see_counts
from sidestep.scenarios.maps import purpose_key

T = TypeVar("T", Route, Walk)
FIRST_SLOTS = 4
"""Slots whose counts are shown to planners that see all counts; doubled until everybody has arrived within them."""
_LEGS_AT_ONCE = 64  # a route's legs are filled up to a multiple, so that routes of many lengths share programs


def planned(walker: "Walker", request: RouteRequest, within: float | None = None) -> RoutePlan:
    """Plan a route, walk it by expected times and through simulated futures, and walk baselines beside it.

    Parameters
    ----------
    walker
        Of the request on the streets.
    request
        What was asked for.
    within
        Minutes of the deadline after the departure; by default ``request.by``.

    Returns
    -------
    RoutePlan
        The route, and how its walks and those of the baselines went.

    Raises
    ------
    RouteError
        A departure so late that the crowds of the walk are not known (field ``depart``); alternatives of a planner that
        has none (``alternatives``).
    """
    located, planner, count = walker.located, walker.planner, walker.params.futures.count
    by = request.by if within is None else within
    route = walker.expected_route(planner)
    if request.arrive_by is None:
        located.check_covered(route.seconds)
    walks = walker.walk(planner, count, route.seconds)
    baselines = {
        other.name: walker.walk(other, located.futures_of(other, count), route.seconds).against(walks)
        for other in located.baselines
        if other.name != planner.name
    }
    plan = walker.described(route, walks, by, baselines)
    if not request.alternatives:
        return plan
    others = alternatives(
        planner, walker.alone, walker.instances(1), route, request.alternatives, located.pieces(), walker.key
    )
    described = [
        replace(
            walker.described(other.route, walker.walk(other.planner, count, other.route.seconds), by, {}),
            shared=other.shared,
        )
        for other in others
    ]
    return replace(plan, alternatives=tuple(described), asked_alternatives=request.alternatives)


@dataclass(frozen=True, eq=False)
class Walks:
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

    def against(self, plan: "Walks") -> BaselineTimes:
        """In the mean of those futures that both walked."""
        count, met = len(self.minutes), None
        if self.exposure is not None and plan.exposure is not None:
            met = float(np.mean(self.exposure - plan.exposure[:count]))
        there = replace(plan, minutes=plan.minutes[:count], arrived=plan.arrived[:count]).times()
        return BaselineTimes(
            **vars(self.times()),
            plan_median_minutes=there.median_minutes,
            plan_p90_minutes=there.p90_minutes,
            mean_difference_minutes=float(np.mean(self.minutes - plan.minutes[:count])),
            mean_difference_exposure=met,
        )


class Walker:
    """Walks one request by expected times and through futures.

    Parameters
    ----------
    located
        The request on the streets, with origin and destination as its ends.
    planner
        Who plans.
    futures
        How many to simulate; by default as many as the request and the planner need.
    """

    def __init__(self, located: Located, planner: Planner, futures: int | None = None) -> None:
        scenario, here = located.scenario, located.scenario_map
        self.located, self.planner, self.key = located, planner, purpose_key(here, "test")
        observed = {each.observes for each in (planner, *located.baselines)}
        self.params = make_environment(
            scenario,
            here,
            "test",
            futures or located.futures_of(planner, located.futures),
            level="map" if observed & {"map", "live"} else "position",
            destinations=np.array([[located.ends[1].node]]),
            hours=located.hours,
            pace=located.pace,
            densities=True,
        ).begun_at(located.ends[0].node)
        self.alone = as_expected(self.params)
        self.density = np.asarray(self.params.expected.of(jnp.int32(0)).known_density)

    def departing(self, clock: float) -> "Walker":
        """The same with another departure, in seconds since the scenario's start."""
        other = copy(self)
        other.located = self.located.departing(clock)
        return other

    def expected_route(self, planner: Planner) -> Route:
        """All of the walk by expected times, however long it is."""

        def whole(params: EnvParams) -> Route:
            trace = params.network.nodes
            while True:
                (route,) = routes(planner, params, self.instances(1), self.key, trace)
                if len(route.segments) < trace:
                    return route
                trace *= 8  # it may go on

        return self._informed(planner, self.alone, 0.0, whole)

    def walk(self, planner: Planner, futures: int, seconds: float) -> Walks:
        """Walk through the first of the futures; ``seconds`` is about how long that takes."""
        todo = self.instances(futures)

        def through(params: EnvParams) -> Walk:
            return walk_plan(planner, params, self._plan(planner, params, todo), todo, self.key)

        params = replace(self.params, futures=self.params.futures.first(futures))
        walked = self._informed(planner, params, 1.2 * seconds, through)
        minutes, exposure = np.asarray(walked.seconds, np.float64) / 60, walked.measures.get("exposure")
        met = None if exposure is None else np.asarray(exposure, np.float64)
        return Walks(planner, minutes, np.asarray(walked.arrived), met)

    def described(
        self, route: Route, walks: Walks, by: float | None, baselines: Mapping[str, BaselineTimes]
    ) -> RoutePlan:
        """Say everything of a route by expected times, and of its walks through futures."""
        located, (origin, destination) = self.located, self.located.named_ends
        slot = min(int(located.clock // self.params.expected.slot_seconds), self.params.expected.slots - 1)
        legs, steps, streets = located.on_map(self._legs(route), self.density[:, slot])
        return RoutePlan(
            **vars(located.facts),
            **vars(walks.times()),
            origin=origin,
            destination=destination,
            by_minutes=by,
            planner=self.planner.name,
            nodes=list(map(located.named, route.nodes)),
            minutes=[(clock - route.clocks[0]) / 60 for clock in route.clocks],
            legs=legs,
            steps=steps,
            metres=sum(leg.metres for leg in legs),
            expected_minutes=route.seconds / 60,
            cost_minutes=route.cost / 60,
            arrives=route.arrived,
            mean_density=mean_density(legs),
            crowding=crowding_word(mean_density(legs)),
            exposure=sum(leg.exposure for leg in legs),
            too_dense=sum(leg.too_dense for leg in legs),
            arrive_by=spread(walks.minutes, walks.arrived, by, located.scenario.horizon / 60)["arrive_by"],
            baselines=baselines,
            streets=streets,
        )

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
        scenario, departure = self.located.scenario, self.located.clock
        if planner.observes != "live":
            return walk(params)
        slots, forecasts = FIRST_SLOTS, planner.name != Snapshot.name
        while slots * scenario.slot_seconds < departure + seconds:
            slots *= 2
        while True:
            flow, shown = self.located.scenario_map.flow, min(slots, scenario.slots)
            found = walk(see_counts(scenario, flow, params, shown, forecasts=forecasts))
            latest = departure + float(np.max(found.seconds))
            if latest <= slots * scenario.slot_seconds or slots >= scenario.slots:
                return found
            slots *= 2

    def _plan(self, planner: Planner, params: EnvParams, todo: Instance) -> Plan:
        """One plan serves all futures, except in hindsight."""
        if planner.level == "hindsight":
            return planner.plan(params, todo)
        plan = planner.plan(params, self.instances(1))
        own = jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf), len(todo.origin), axis=0), plan.own)
        return replace(plan, own=own)

    def instances(self, count: int) -> Instance:
        """The walk that was asked for in the first ``count`` futures."""
        origin, destination = (jnp.full(count, end.node, jnp.int32) for end in self.located.ends)
        departure = jnp.full(count, self.located.clock, jnp.float32)
        return Instance(origin, destination, departure, jnp.arange(count, dtype=jnp.int32))

    def _legs(self, route: Route) -> list[Leg]:
        """The segments of a route by expected times."""
        params = replace(self.alone, objective=self.alone.objective.measured())  # crossings then tell the crowds met
        length, expected, density = np.asarray(params.network.length), params.expected, self.density
        hour, number = float(params.futures.hour[0]), len(route.segments)
        padding = (0, -number % _LEGS_AT_ONCE)
        segment, clock = np.pad(np.array(route.segments, np.int32), padding), np.pad(route.clocks[:number], padding)
        found = jax.device_get(_crossed(params, segment, np.asarray(clock, np.float32)))

        def leg(segment: int, before: float, after: float, exposure: float, too_dense: float, shut: float) -> Leg:
            slot = min(int((before + after) / 2 // expected.slot_seconds), expected.slots - 1)
            return Leg(
                segment=segment,
                metres=float(length[segment]),
                minutes=(after - before) / 60,
                opens=opening_word(hour, before, shut),
                minutes_until_open=shut / 60,
                density=float(density[segment, slot]),
                exposure=exposure,
                too_dense=bool(too_dense),
            )

        walked = route.segments, route.clocks, route.clocks[1:]
        return list(map(leg, *walked, *(column[:number].tolist() for column in found)))


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0))
def _crossed(params: EnvParams, segment: Int[Array, ""], clock: Float[Array, ""]) -> tuple[Array, Array, Array]:
    """Exposure on segments in the only future, whether it is too dense there, and seconds until they open."""
    future = jnp.int32(0)
    met = cross(params, future, segment, clock).measures
    return met["exposure"], jnp.asarray(met["too_dense"], float), params.gates_in(future)(segment, clock)
