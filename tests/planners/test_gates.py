"""A gate across a block of footways, shut from 22:00 to 06:00, one on the only way, and a street for residents."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.environment.cost_to_go import UNREACHABLE, expected_cost_to_go, static_cost_to_go
from sidestep.environment.crossing import LOST
from sidestep.environment.dynamics import reset, step
from sidestep.environment.types import EnvParams, Instance, futures_in_turn
from sidestep.network.town import Town
from sidestep.planners.base import Planner, Route, routes
from sidestep.planners.random import RandomProgress
from sidestep.planners.reactive import GreedyLocal, GreedyMap
from sidestep.planners.real_time import LrtaStar
from sidestep.planners.shortest_path import ShortestPath, distances_to
from sidestep.planners.time_dependent import Clairvoyant, Expected, earliest_arrivals
from sidestep.walking.objective import Objective, TravelTime, WeightedObjective
from sidestep.walking.opening import AnyWaits
from sidestep.walking.speed_field import speed_field

SLOTS, SLOT, HORIZON = 12, 300.0, 3600.0
OPEN = "06:00-22:00"
KEY = jax.random.key(0)


PLANNERS = (ShortestPath(), Expected(), Clairvoyant(), GreedyMap(), GreedyLocal(), LrtaStar())
costs = jax.jit(expected_cost_to_go)


def environment(
    town: Town,
    waits: AnyWaits,
    hour: float,
    end: int,
    objective: Objective = TravelTime(),  # noqa: B008
) -> EnvParams:
    """Empty streets, walked at 1 m/s, at level map."""
    network, hours = town.network(), jnp.array([hour])
    row = (1, network.segments, SLOTS)
    field = speed_field(jnp.ones(row), SLOT, jnp.zeros(row))
    params = EnvParams(network, futures_in_turn(field, hours), field, jnp.float32(HORIZON), objective=objective)
    params = replace(params, waits=waits, level="map")
    return replace(params, cost_to_go=costs(params, (jnp.arange(network.nodes) == end)[None], hours))


def walk(planner: Planner, params: EnvParams, origin: int, end: int, clock: float = 0.0) -> Route:
    todo = Instance(jnp.array([origin]), jnp.array([end]), jnp.array([float(clock)]), jnp.array([0]))
    return routes(planner, params, todo, KEY, 40)[0]


def test_at_night_one_walks_round_the_gate(block, gates) -> None:
    town = block(OPEN)
    for hour, clock, metres in ((23.5, 0, 240), (12.0, 0, 170), (21.5, 1800, 240), (21.5, 1700, 170), (6.0, 0, 170)):
        params = environment(town, gates(town), hour, 10)
        for planner in PLANNERS:
            found = walk(planner, params, 5, 10, clock)
            assert found.arrived
            assert found.seconds == pytest.approx(metres, abs=0.5), (planner.name, hour, clock)


def test_with_an_objective_as_well(block, gates) -> None:
    town = block(OPEN)
    for hour, metres in ((23.5, 240), (12.0, 170), (5.5 + 29.5 / 60, 200)):
        # A wait of 30 s costs less than 70 m more.
        params = environment(town, gates(town), hour, 10, WeightedObjective(distance=0.1))
        for planner in (Expected(), Clairvoyant(), GreedyMap()):
            assert walk(planner, params, 5, 10).seconds == pytest.approx(metres, abs=0.5), (planner.name, hour)


@pytest.fixture(scope="module")
def garden(make_town) -> Town:
    """0 and 1 are joined by a gate that opens at 6:00, 1 and 2 by 100 m without one."""
    return make_town([(0, 0), (100, 0), (200, 0)], [(0, 1), (1, 2)], opening=(OPEN, ""))


def test_where_the_gate_is_the_only_way_one_waits(garden, gates) -> None:
    params, early = (environment(garden, gates(garden), hour, 2) for hour in (5.75, 4.5))
    for planner in PLANNERS:
        assert walk(planner, params, 0, 2).seconds == pytest.approx(900 + 200, abs=0.1)
        # Longer than a walk may take: it never arrives, and stands there until it is given up.
        late = walk(planner, early, 0, 2)
        assert (late.arrived, late.seconds, late.clocks[-1]) == (False, HORIZON, HORIZON)
    # From level local on it is seen at the gate.
    _, seen = reset(replace(params, level="local"), Instance(*map(jnp.int32, (0, 2)), jnp.float32(60), jnp.int32(0)))
    assert float(seen.local.crossing[0]) == pytest.approx(840 + 100)


def test_who_gives_up_at_a_gate_is_still_before_it(garden, gates) -> None:
    params = environment(garden, gates(garden), 4.5, 1, WeightedObjective(distance=1.0))
    start, _ = reset(params, Instance(*map(jnp.int32, (0, 1)), jnp.float32(100), jnp.int32(0)))
    after, outcome = step(params, start, jnp.int32(0))
    assert (int(after.node), float(after.clock)) == (0, HORIZON + 100)
    assert (bool(outcome.terminated), bool(outcome.truncated)) == (False, True)
    assert (float(outcome.crossed.cost), float(outcome.crossed.measures["metres"])) == (HORIZON, 0)
    # Beforehand there is then no way; half an hour later it is worth the wait.
    table = np.asarray(params.cost_to_go.table)[0, :: params.cost_to_go.steps, 0]
    assert table[0] == UNREACHABLE
    assert table[7] == pytest.approx(1.5 * 3600 - 7 * SLOT + 2 * 100)


def test_a_street_for_residents_is_not_on_the_way(block, gates) -> None:
    town = block(restricted=True)
    params = environment(town, gates(town), 12.0, 10)
    for planner in (*PLANNERS, RandomProgress()):
        assert walk(planner, params, 5, 10).seconds == pytest.approx(240, abs=0.5)


def test_costs_to_go_and_searches_know_restricted_areas(make_town) -> None:
    # 0 to 1: 100 m on the street, 80 m through the yard behind 2.
    town = make_town([(0, 0), (100, 0), (50, 1)], [(0, 1), (0, 2), (2, 1)], restricted=np.array([False, True, True]))
    town = replace(town, length=np.array([100, 40, 40], np.float32))
    network = town.network()
    metres = np.asarray(network.length)
    for end, expected in ((1, [100, 0, 40]), (0, [0, 100, 40]), (2, [40, 40, 0])):
        assert distances_to(network, metres, end).tolist() == expected
        assert static_cost_to_go(network, network.length, jnp.arange(3) == end).tolist() == expected

    def along(segment: jax.Array, clock: jax.Array) -> jax.Array:
        return clock + network.length[segment]

    for origin, expected in ((0, [0, 100, 40]), (2, [40, 40, 0])):
        arrival, _ = earliest_arrivals(network, along, jnp.int32(origin), jnp.float32(0))
        assert arrival.tolist() == expected
    # To either end of the yard, by whichever is nearer.
    either = static_cost_to_go(network, network.length, jnp.array([False, True, True]))
    assert either.tolist() == [40, 0, 0]
    assert UNREACHABLE == LOST


def test_actions_that_may_not_be_taken_are_replaced(block, gates) -> None:
    town = block(restricted=True)
    params = environment(town, gates(town), 12.0, 10)
    state, seen = reset(params, Instance(*map(jnp.int32, (5, 10)), jnp.float32(0), jnp.int32(0)))
    onto = np.asarray(params.network.exit_node[5])
    closed = int(np.flatnonzero(onto == 10)[0])
    assert seen.valid.tolist() == [node not in (-1, 10) for node in onto.tolist()]
    after, _ = step(params, state, jnp.int32(closed))
    assert int(after.node) != 10
