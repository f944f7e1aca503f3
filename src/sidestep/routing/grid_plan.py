"""One planned walk: where it leads, and how long it may take."""

from dataclasses import dataclass
from typing import TypedDict

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from sidestep.environment.types import EnvParams, Instance
from sidestep.errors import SidestepError
from sidestep.evaluation.metrics import spread
from sidestep.planners.base import Planner, Route, routes, walk_plan
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import ScenarioMap, purpose_key
from sidestep.scenarios.model import Scenario


class RouteError(SidestepError):
    """A walk that cannot be: says why."""


class PlannedWalk(TypedDict):
    """A planned walk in ``route --json``."""

    planner: str
    level: str
    nodes: list[int]
    minutes: list[float]  # after departure, at which each node is reached if crowds are as expected
    metres: float
    expected_minutes: float
    arrives: bool
    futures: int
    median_minutes: float
    p90_minutes: float
    arrival_rate: float
    by_minutes: float | None
    arrive_by: float | None


@dataclass(frozen=True)
class Foresight:
    """A planned walk."""

    planner: Planner
    route: Route  # if crowds are as expected
    metres: float
    minutes: Float[np.ndarray, " future"]
    arrived: Bool[np.ndarray, " future"]

    def as_json(self, by: float | None = None) -> PlannedWalk:
        """The shape of ``route --json``; ``by`` are minutes to arrive within."""
        begins = self.route.clocks[0]
        found = spread(self.minutes, self.arrived, by)
        return {
            "planner": self.planner.name,
            "level": self.planner.level,
            "nodes": list(self.route.nodes),
            "minutes": [(clock - begins) / 60 for clock in self.route.clocks],
            "metres": self.metres,
            "expected_minutes": self.route.seconds / 60,
            "arrives": self.route.arrived,
            "futures": len(self.minutes),
            "median_minutes": found["median_minutes"],
            "p90_minutes": found["p90_minutes"],
            "arrival_rate": float(self.arrived.mean()),
            "by_minutes": by,
            "arrive_by": found["arrive_by"],
        }


def foresee(
    scenario: Scenario,
    scenario_map: ScenarioMap,
    planner: Planner,
    *,
    origin: int,
    destination: int,
    departure: float,
    futures: int,
) -> Foresight:
    """Plan one walk, take it through the expected crowds, and through simulated futures.

    Parameters
    ----------
    origin, destination
        Nodes.
    departure
        Seconds since the scenario's start.
    futures
        How many to simulate.

    Raises
    ------
    RouteError
        Nodes that there are not, a departure or a number of futures that cannot be.
    """
    nodes = scenario_map.network.nodes
    for name, node in (("origin", origin), ("destination", destination)):
        if not 0 <= node < nodes:
            raise RouteError(f"there is no node {node} to be the {name}; nodes are numbered 0 to {nodes - 1}")
    if not 0 <= departure < scenario.horizon:
        raise RouteError(
            f"the departure must lie between 0 and {scenario.horizon / 60:g} minutes, not {departure / 60:g}"
        )
    if futures < 1:
        raise RouteError(f"there must be at least one future, not {futures}")
    destinations = np.array([[destination]])

    def world(scenario: Scenario, futures: int) -> tuple[EnvParams, Instance]:
        params = make_environment(
            scenario, scenario_map, "test", futures, level=planner.observes, destinations=destinations
        )
        count = params.futures.count
        return params, Instance(
            origin=jnp.full(count, origin, jnp.int32),
            destination=jnp.full(count, destination, jnp.int32),
            departure=jnp.full(count, departure, jnp.float32),
            future=jnp.arange(count, dtype=jnp.int32),
        )

    key = purpose_key(scenario_map, "test")
    params, once = world(scenario.changed(flows="forecast"), 1)
    route = whole_route(planner, params, once, key)
    covered = scenario.slots * scenario.slot_seconds
    if departure + route.seconds > covered and departure > scenario.departures[1]:
        raise RouteError(
            f"crowds are known for {covered / 60:g} minutes, but a walk that departs at {departure / 60:g} takes "
            f"{route.seconds / 60:.0f}; depart earlier"
        )
    params, todo = world(scenario, futures)
    walked = walk_plan(planner, params, planner.plan(params, todo), todo, key)
    return Foresight(
        planner,
        route,
        float(np.asarray(scenario_map.network.length)[list(route.segments)].sum()),
        np.asarray(walked.seconds) / 60,
        np.asarray(walked.arrived),
    )


def whole_route(planner: Planner, params: EnvParams, once: Instance, key: Key[Array, ""]) -> Route:
    """All of one walk, however long it is."""
    trace = params.network.nodes
    (route,) = routes(planner, params, once, key, trace)
    while len(route.segments) == trace:  # it may go on
        trace *= 8
        (route,) = routes(planner, params, once, key, trace)
    return route
