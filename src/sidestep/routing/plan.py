"""A walk through a real place, street by street, and what other planners would have taken."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from sidestep.environment.crossing import as_expected, cross
from sidestep.environment.rollout import Walk
from sidestep.environment.types import EnvParams, Instance
from sidestep.evaluation.metrics import totals_of
from sidestep.network.snapping import SplitStreets
from sidestep.planners.base import Plan, Planner, Route, walk_plan
from sidestep.planners.reactive import Snapshot
from sidestep.planners.shortest_path import ShortestPath
from sidestep.routing.directions import Leg
from sidestep.routing.grid_plan import RouteError, whole_route
from sidestep.routing.request import Trip
from sidestep.scenarios.futures import make_environment, see_counts
from sidestep.scenarios.maps import purpose_key
from sidestep.scenarios.model import Scenario

FUTURES, LIVE_FUTURES = 200, 20  # by default; forecasts from the counts of every slot of every future take long


@dataclass(frozen=True, eq=False)
class Others:
    """What another planner takes in the first of the same futures."""

    planner: Planner
    minutes: Float[np.ndarray, " future"]
    arrived: Bool[np.ndarray, " future"]
    exposure: Float[np.ndarray, " future"] | None  # crowd met, person·s/m²; None where time is all that counts


@dataclass(frozen=True, eq=False)
class Journey:
    """A planned walk."""

    trip: Trip
    planner: Planner
    route: Route  # if crowds are as expected
    legs: tuple[Leg, ...]
    minutes: Float[np.ndarray, " future"]
    arrived: Bool[np.ndarray, " future"]
    exposure: Float[np.ndarray, " future"] | None  # crowd met, person·s/m²; None where time is all that counts
    others: Mapping[str, Others]
    streets_density: Float[np.ndarray, " street"]  # persons/m² on every street that are expected at the departure

    @property
    def course(self) -> Float[np.ndarray, "point 2"]:
        """Longitude and latitude of the whole route."""
        return whole_course(self.legs)


def travel(trip: Trip, planner: Planner, futures: int | None = None) -> Journey:
    """Plan a walk, take it through the expected crowds, and through simulated futures, beside two other planners.

    Parameters
    ----------
    futures
        How many to simulate; by default ``FUTURES``, or ``LIVE_FUTURES`` for planners that see all counts, or one where
        all are alike.
    """
    if futures is None:
        futures = 1 if trip.certain else LIVE_FUTURES if planner.observes == "live" else FUTURES
    if futures < 1:
        raise RouteError(f"there must be at least one future, not {futures}")
    scenario = trip.scenario.changed(departures=(0.0, 0.0))  # so that no slots are drawn that nobody walks in
    destinations = np.array([[trip.destination.node]])
    hours = None if trip.departure.hour is None else [trip.departure.hour]
    params = make_environment(
        scenario, trip.place, "test", futures, level="map", destinations=destinations, hours=hours, densities=True
    )
    futures = params.futures.count  # one, where the forecast comes true
    density = np.asarray(params.expected.of(jnp.int32(0)).known_density)
    world = _World(scenario, trip, params, purpose_key(trip.place, "test"))
    route = world.expected_route(planner)
    walked = world.walk(planner, futures, route.seconds)
    baselines: list[tuple[Planner, int]] = [(ShortestPath(), futures), (Snapshot(), min(futures, LIVE_FUTURES))]
    others = {
        baseline.name: Others(baseline, *_results(world.walk(baseline, count, route.seconds)))
        for baseline, count in baselines
        if baseline.name != planner.name
    }
    return Journey(
        trip,
        planner,
        route,
        _legs(trip.streets, params, density, route),
        *_results(walked),
        others,
        _densest(trip.streets, density[:, 0]),
    )


def _results(
    walked: Walk,
) -> tuple[Float[np.ndarray, " future"], Bool[np.ndarray, " future"], Float[np.ndarray, " future"] | None]:
    return (
        np.asarray(walked.seconds, np.float64) / 60,
        np.asarray(walked.arrived),
        totals_of(walked).get("exposure"),
    )


def _densest(streets: SplitStreets, density: Float[np.ndarray, " segment"]) -> Float[np.ndarray, " street"]:
    """The densest of each street's pieces and directions; tables may tell directions apart."""
    found = np.zeros(streets.town.streets, density.dtype)
    np.maximum.at(found, streets.street, density)
    return found


@dataclass(frozen=True, eq=False)
class _World:
    """The futures of one walk."""

    scenario: Scenario
    trip: Trip
    params: EnvParams
    key: Key[Array, ""]

    def expected_route(self, planner: Planner) -> Route:
        once, alone = self._instances(1), as_expected(self.params)
        if planner.observes != "live":
            return whole_route(planner, alone, once, self.key)
        slots = _FIRST_SLOTS
        while True:
            route = whole_route(planner, self._seen(planner, alone, slots), once, self.key)
            if route.seconds <= slots * self.scenario.slot_seconds or slots >= self.scenario.slots:
                return route
            slots *= 2

    def walk(self, planner: Planner, futures: int, seconds: float) -> Walk:
        """Walk through the first of the futures; ``seconds`` is about how long that takes."""
        params = replace(self.params, futures=self.params.futures.first(futures))
        todo = self._instances(futures)
        if planner.observes != "live":
            return walk_plan(planner, params, self._plan(planner, params, todo), todo, self.key)
        slots = _FIRST_SLOTS
        while slots * self.scenario.slot_seconds < 1.2 * seconds:
            slots *= 2
        while True:
            seen = self._seen(planner, params, slots)
            walked = walk_plan(planner, seen, planner.plan(seen, todo), todo, self.key)
            if walked.seconds.max() <= slots * self.scenario.slot_seconds or slots >= self.scenario.slots:
                return walked
            slots *= 2

    def _seen(self, planner: Planner, params: EnvParams, slots: int) -> EnvParams:
        slots, forecasts = min(slots, self.scenario.slots), planner.name != Snapshot.name
        return see_counts(self.scenario, self.trip.place.flow, params, slots, forecasts=forecasts)

    def _plan(self, planner: Planner, params: EnvParams, todo: Instance) -> Plan:
        """Only hindsight plans otherwise for another future."""
        if planner.level == "hindsight":
            return planner.plan(params, todo)
        plan = planner.plan(params, self._instances(1))
        count = todo.origin.shape[0]
        own = jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf), count, axis=0), plan.own)
        return eqx.tree_at(lambda plan: plan.own, plan, own)

    def _instances(self, count: int) -> Instance:
        return Instance(
            origin=jnp.full(count, self.trip.origin.node, jnp.int32),
            destination=jnp.full(count, self.trip.destination.node, jnp.int32),
            departure=jnp.zeros(count, jnp.float32),
            future=jnp.arange(count, dtype=jnp.int32),
        )


_FIRST_SLOTS = 4  # for which counts are shown; doubled until everybody has arrived within them


def _legs(
    streets: SplitStreets, params: EnvParams, density: Float[np.ndarray, "segment slot"], route: Route
) -> tuple[Leg, ...]:
    """The streets of a route through the expected crowds, which are so dense, in persons/m²."""
    town, length, expected = streets.town, np.asarray(params.network.length), params.expected
    alone = replace(as_expected(params), objective=params.objective.measured())

    def one(segment: int, before: float, after: float) -> Leg:
        crossed = cross(alone, jnp.int32(0), jnp.int32(segment), jnp.float32(before))
        slot = min(int((before + after) / 2 // expected.slot_seconds), expected.slots - 1)
        street = int(streets.street[segment])
        return Leg(
            street,
            town.name[street],
            town.kind[street],
            metres=float(length[segment]),
            minutes=(after - before) / 60,
            entered=(before - route.clocks[0]) / 60,
            density=float(density[segment, slot]),
            exposure=float(crossed.measures["exposure"]),
            too_dense=bool(crossed.measures["too_dense"]),
            course=streets.course(segment),
        )

    steps = zip(route.segments, route.clocks, route.clocks[1:], strict=False)
    return tuple(one(*step) for step in steps)


def whole_course(legs: tuple[Leg, ...]) -> Float[np.ndarray, "point 2"]:
    """Longitude and latitude along all legs; points at which two of them meet come once."""
    return np.concatenate([legs[0].course[:1], *(leg.course[1:] for leg in legs)])
