"""The walks of a request: by expected times, and through simulated futures."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.environment.crossing import as_expected, cross
from sidestep.environment.rollout import Past
from sidestep.environment.types import EnvParams, Futures, Instance, SeeSlot
from sidestep.evaluation.metrics import in_time, spread
from sidestep.planners.base import Plan, Planner, Route, routes_along, walk_plan
from sidestep.planners.reactive import Snapshot
from sidestep.programs import on_device, program
from sidestep.routing.alternatives import alternatives
from sidestep.routing.directions import Leg, crowding_word, mean_density, opening_word
from sidestep.routing.located import Located
from sidestep.routing.plan import BaselineTimes, RoutePlan, WalkTimes
from sidestep.routing.request import RouteRequest
from sidestep.scenarios.futures import make_environment, see_counts
from sidestep.scenarios.maps import purpose_key
from sidestep.walking.expected_times import Speeds

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
    walks = walker.walk(planner, count)
    baselines = {
        other.name: walker.walk(other, located.futures_of(other, count)).against(walks)
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
            walker.described(other.route, walker.walk(other.planner, count), by, {}),
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

    @cached_property
    def times(self) -> WalkTimes:
        """Their median and the like."""
        found, rate = spread(self.minutes, self.arrived, None), float(self.arrived.mean())
        return WalkTimes(
            level=self.planner.level,
            futures=len(self.minutes),
            median_minutes=found["median_minutes"],
            p90_minutes=found["p90_minutes"],
            arrival_rate=rate,
        )

    def in_time(self, by: float, horizon: float) -> float:
        """The share that arrives within some minutes, and before the horizon."""
        return float(in_time(self.minutes, self.arrived, by, horizon).mean())

    def against(self, plan: "Walks") -> BaselineTimes:
        """In the mean of those futures that both walked."""
        count, met = len(self.minutes), None
        if self.exposure is not None and plan.exposure is not None:
            met = float(np.mean(self.exposure - plan.exposure[:count]))
        both = plan
        if count < len(plan.minutes):
            both = replace(plan, minutes=plan.minutes[:count], arrived=plan.arrived[:count])
        there = both.times
        return BaselineTimes(
            **vars(self.times),
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
    inside
        Whether the walker has come to the origin along its street, and so is past the gate that the street may have.
    past
        What the walker brings along where the walk goes on from another.
    """

    def __init__(
        self,
        located: Located,
        planner: Planner,
        futures: int | None = None,
        *,
        inside: bool = False,
        past: Past | None = None,
    ) -> None:
        scenario, here = located.scenario, located.scenario_map
        self.located, self.planner, self.key = located, planner, purpose_key(here, "test")
        looking = [each for each in (planner, *located.baselines) if each.observes in ("map", "live")]
        self.past = past
        params = make_environment(
            scenario,
            here,
            "test",
            futures or located.futures_of(planner, located.futures),
            level="map" if looking else "position",
            destinations=np.array([[located.ends[1].node]]),
            hours=located.hours,
            pace=located.pace,
            costs=any(map(_looks_ahead, looking)),
            densities=True,
        )
        self.params = params if inside else params.begun_at(located.ends[0].node)
        self.alone = as_expected(self.params)
        self.density = np.asarray(densities(self.params.expected))
        self._plans: list[tuple[Planner, Plan]] = []
        self._instances: dict[int, Instance] = {}

    def departing(self, clock: float) -> "Walker":
        """The same with another departure, in seconds since the scenario's start."""
        other = copy(self)
        other.located = self.located.departing(clock)
        other._plans, other._instances = [], {}  # noqa: SLF001 - of this class
        return other

    def expected_route(self, planner: Planner) -> Route:
        """All of the walk by expected times, however long it is."""
        params, see = self.alone, self._counts(planner, self.alone)
        plan, todo, trace = self._plan(planner), self.instances(1), params.network.nodes
        while True:
            (route,) = routes_along(planner, params, plan, todo, self.key, trace, self.past, see)
            if len(route.segments) < trace:
                return route
            trace *= 8  # it may go on

    def walk(self, planner: Planner, futures: int) -> Walks:
        """Walk through the first of the futures."""
        todo = self.instances(size := _size(futures))
        params, drawn = self.params, self.params.futures
        if not futures == size == drawn.count:
            params = replace(params, futures=_some(drawn, on_device(np.arange(size) % futures, np.int32)))
        plan = planner.plan(params, todo) if planner.level == "hindsight" else self._plan(planner)
        see = self._counts(planner, params)
        walked = walk_plan(planner, params, plan, todo, self.key, past=self.past, see=see)
        exposure = walked.measures.get("exposure")
        met = None if exposure is None else np.asarray(exposure, np.float64)[:futures]
        minutes = np.asarray(walked.seconds, np.float64)[:futures] / 60
        return Walks(planner, minutes, np.asarray(walked.arrived)[:futures], met)

    def described(
        self, route: Route, walks: Walks, by: float | None, baselines: Mapping[str, BaselineTimes]
    ) -> RoutePlan:
        """Say everything of a route by expected times, and of its walks through futures."""
        located, (origin, destination) = self.located, self.located.named_ends
        slot = min(int(located.clock // self.params.expected.slot_seconds), self.params.expected.slots - 1)
        legs, steps, streets = located.on_map(self._legs(route), self.density[:, slot])
        return RoutePlan(
            **vars(located.facts),
            **vars(walks.times),
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
            arrive_by=None if by is None else walks.in_time(by, located.scenario.horizon / 60),
            baselines=baselines,
            streets=streets,
        )

    def _counts(self, planner: Planner, params: EnvParams) -> SeeSlot | None:
        """How a planner sees all counts as its walks get on; None where it sees none."""
        if planner.observes != "live":
            return None
        scenario, flow = self.located.scenario, self.located.scenario_map.flow
        return see_counts(scenario, flow, params, forecasts=_looks_ahead(planner))

    def _plan(self, planner: Planner) -> Plan:
        """One plan serves all futures: planners know of none of them, and of what is expected the same in each."""
        plan = next((plan for other, plan in self._plans if other is planner), None)
        if plan is None:
            plan = planner.plan(self.alone, self.instances(1))
            self._plans.append((planner, plan))
        return plan

    def instances(self, count: int) -> Instance:
        """The walk that was asked for in the first ``count`` futures."""
        if count not in self._instances:
            origin, destination = (np.full(count, end.node, np.int32) for end in self.located.ends)
            departure, future = np.full(count, self.located.clock, np.float32), np.arange(count, dtype=np.int32)
            self._instances[count] = Instance(*jax.device_put((origin, destination, departure, future)))
        return self._instances[count]

    def _legs(self, route: Route) -> list[Leg]:
        """The segments of a route by expected times."""
        params = replace(self.alone, objective=self.alone.objective.measured())  # crossings then tell the crowds met
        length, expected, density = np.asarray(params.network.length), params.expected, self.density
        hour, number = self.located.hours[0], len(route.segments)
        padding = (0, -number % _LEGS_AT_ONCE)
        segment, clock = np.pad(route.segments, padding), np.pad(route.clocks[:number], padding)
        found = jax.device_get(_crossed(params, on_device(segment, np.int32), on_device(clock)))

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


def _looks_ahead(planner: Planner) -> bool:
    """Whether a planner that sees all counts, or the map, looks at more than counts as they stand."""
    return planner.name != Snapshot.name


def _size(futures: int) -> int:
    """How many walks are walked at a time: as many as there are futures, or the next of 1, 2, 5, 10, 20, 50, ….

    Some futures are then walked twice, and few programs compiled.

    Parameters
    ----------
    futures
        How many there are.

    Returns
    -------
    int
        As many, or more.
    """
    tens = 10 ** (len(str(futures)) - 1)
    return next(times * tens for times in (1, 2, 5, 10) if futures <= times * tens)


@program()
def _some(futures: Futures, which: Int[Array, " future"]) -> Futures:
    """Some of the futures, in this order."""
    return futures.taken(which)


@program()
def densities(expected: Speeds) -> Float[Array, "segment slot"]:
    """Persons/m² that are expected at the only hour."""
    return expected.of(jnp.int32(0)).known_density


@program()
def _crossed(params: EnvParams, segment: Int[Array, " leg"], clock: Float[Array, " leg"]) -> tuple[Array, Array, Array]:
    """Exposure on segments in the only future, whether it is too dense there, and seconds until they open."""
    future = jnp.int32(0)

    def one(segment: Array, clock: Array) -> tuple[Array, Array, Array]:
        met = cross(params, future, segment, clock).measures
        return met["exposure"], jnp.asarray(met["too_dense"], float), params.gates_in(future)(segment, clock)

    return jax.vmap(one)(segment, clock)
