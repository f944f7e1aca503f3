"""Objectives and waits in the environment: by hand on the diamond, and searches beside every way there is."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.environment.costs import cross, crossings
from sidestep.environment.dynamics import reset, step
from sidestep.environment.knowledge import usual_to_go
from sidestep.environment.types import FORBIDDEN, EnvParams, Objective
from sidestep.environment.walk import walk
from sidestep.network.graph import RoadNetwork
from sidestep.network.grid import grid_network
from sidestep.planners.base import walk_plan
from sidestep.planners.greedy import GreedyMap
from sidestep.planners.search import Clairvoyant, Expected
from sidestep.travel_time import exposure_in, speed_field
from sidestep.waiting import Waits

KEY = jax.random.key(0)
SLOT = 100.0


def crowded(network: RoadNetwork, speed: np.ndarray, density: np.ndarray, objective: Objective | None) -> EnvParams:
    """One crowd, which is expected as well."""
    field = speed_field(jnp.asarray(speed)[None], SLOT, jnp.asarray(density)[None])
    return EnvParams(network, field, field, jnp.float32(1e5), objective=objective)


@pytest.fixture(scope="module")
def steady(diamond) -> EnvParams:
    """1 m/s everywhere; 2 persons/m² by node 1, till 100 s, and 1 from then on; nobody by node 2."""
    density = np.zeros((8, 2), np.float32)
    density[[0, 1, 4, 5]] = (2, 1)
    return crowded(diamond, np.ones((8, 2), np.float32), density, Objective(exposure=0.5, distance=0.1))


def test_a_crossing_by_hand(steady) -> None:
    # 0 > 1 entered at 50 s: 50 s at 2 persons/m² and 50 at 1
    one = cross(steady, jnp.int32(0), jnp.int32(0), jnp.float32(50))
    assert (float(one.seconds), float(one.metres), float(one.exposure)) == (100, 100, 150)
    assert float(one.cost) == pytest.approx(100 + 0.1 * 100 + 0.5 * 150)
    # Long after the last slot.
    assert float(cross(steady, jnp.int32(0), jnp.int32(1), jnp.float32(1e4)).exposure) == pytest.approx(200)


@pytest.mark.parametrize(
    ("begin", "end", "met"), [(0, 100, 200), (90, 110, 30), (150, 450, 300), (50, 50, 0), (0, 1000, 1100)]
)
def test_exposure_is_the_integral_of_density(begin: float, end: float, met: float) -> None:
    assert float(exposure_in(jnp.array([2.0, 1.0]), SLOT, jnp.float32(begin), jnp.float32(end))) == pytest.approx(met)


def test_all_segments_at_once_are_each_alone(steady) -> None:
    every = crossings(steady, steady.crowds.of(jnp.int32(0)), jnp.int32(0), every=4)
    assert every.cost.shape == (8, 8)
    for number, clock in ((0, 0.0), (3, 75.0), (7, 175.0)):
        for segment in (0, 1, 3):
            one = cross(steady, jnp.int32(0), jnp.int32(segment), jnp.float32(clock))
            assert float(every.cost[number, segment]) == pytest.approx(float(one.cost), rel=1e-6)


def test_the_objective_decides_the_way(steady, make_instance) -> None:
    def way(objective: Objective | None) -> tuple[list[int], float]:
        params = replace(steady, objective=objective)
        walked = walk_plan(Expected(), params, Expected().plan(params, make_instance([0])), make_instance([0]), KEY, 3)
        return walked.nodes[0].tolist(), float(walked.seconds[0])

    # By 1 300 m, and 200 + 200 person·s/m² met; by 2 400 m and nobody.
    assert way(None) == ([0, 1, 3], 300)
    assert way(Objective(exposure=0.2)) == ([0, 1, 3], 300)
    assert way(Objective(exposure=0.3)) == ([0, 2, 3], 400)
    assert way(Objective(exposure=0.3, distance=0.3)) == ([0, 1, 3], 300)
    # At 0 s there are more than 1.5 persons/m² by node 1.
    assert way(Objective(max_density=1.5)) == ([0, 2, 3], 400)
    assert way(Objective(max_density=2.5)) == ([0, 1, 3], 300)


def test_rewards_and_tallies_are_of_costs(steady, make_instance) -> None:
    state, _ = reset(steady, make_instance())
    _, outcome = step(steady, state, jnp.int32(0))
    cost = 100 + 0.1 * 100 + 0.5 * 200
    weights, straight = steady.reward, 200 - np.hypot(100, 100)
    assert float(outcome.reward) == pytest.approx(-cost / weights.unit_seconds + weights.progress * straight, rel=1e-5)
    forbidding = replace(steady, objective=Objective(max_density=1.5))
    walked = walk(forbidding, lambda *_: jnp.int32(0), make_instance(), KEY)
    # 0 > 1 is entered at 2 persons/m², and 1 > 3 at 1.
    assert (float(walked.tally.too_dense), float(walked.tally.exposure), float(walked.tally.metres)) == (1, 400, 300)
    assert float(walked.tally.cost) == FORBIDDEN + 300


def test_a_street_that_is_seen_to_be_too_dense_is_not_entered(diamond, make_instance) -> None:
    # Nobody is expected; on 0 > 1 there are 3 persons/m².
    speed, density = np.ones((8, 2), np.float32), np.zeros((8, 2), np.float32)
    params = crowded(diamond, speed, density, Objective(max_density=2.5))
    dense = speed_field(jnp.asarray(speed)[None], SLOT, jnp.asarray(density).at[0].set(3.0)[None])
    params = replace(params, crowds=dense, level="map")
    params = replace(params, usual=usual_to_go(params, (jnp.arange(4) == 3)[None]))
    for planner, tally in ((GreedyMap(), (400, 0)), (Expected(), (300, 1))):
        plan = planner.plan(params, make_instance([0]))
        walked = walk_plan(planner, params, plan, make_instance([0]), KEY)
        assert (float(walked.tally.metres[0]), float(walked.tally.too_dense[0])) == tally


def ways(network: RoadNetwork, here: int, end: int, been: tuple[int, ...] = ()) -> list[list[int]]:
    """Every simple way, as segments."""
    if here == end:
        return [[]]
    found = []
    for onto, segment in zip(np.asarray(network.exit_node)[here], np.asarray(network.exit_segment)[here], strict=True):
        if onto >= 0 and onto not in (*been, here):
            found += [[int(segment), *rest] for rest in ways(network, int(onto), end, (*been, here))]
    return found


@pytest.mark.parametrize("lit", [False, True])
def test_searches_are_as_good_as_the_best_of_all_ways(make_instance, lit: bool) -> None:
    rng = np.random.default_rng(5)
    network = grid_network(3, rng)
    density = rng.uniform(0, 4, (network.segments, 12)).astype(np.float32)
    params = crowded(network, 1.34 - 0.25 * density, density, Objective(exposure=0.7, distance=0.2, max_density=3.7))
    if lit:
        offset = jnp.asarray(rng.uniform(0, 90, network.segments), jnp.float32)
        one = jnp.ones(network.segments)
        waits = Waits(one, 0 * one, offset, jnp.zeros(24), jnp.zeros(1), 90.0, 30.0, 8.0)
        params = replace(params, waits=waits)
    crossed = jax.jit(lambda segment, clock: cross(params, jnp.int32(0), segment, clock))

    def cost(way: list[int], departure: float) -> float:
        clock, total = departure, 0.0
        for segment in way:
            one = crossed(jnp.int32(segment), jnp.float32(clock))
            clock, total = clock + float(one.seconds), total + float(one.cost)
        return total

    departures = [0.0, 130.0, 333.0]
    best = [min(cost(way, at) for way in ways(network, 0, 8)) for at in departures]
    for objective, planner in ((params.objective, Clairvoyant()), (None, Clairvoyant())):
        known = replace(params, objective=objective)
        walks = make_instance([0] * 3, 8, departures)
        walked = walk_plan(planner, known, planner.plan(known, walks), walks, KEY)
        if objective is None:
            fastest = [min(seconds(crossed, way, at) for way in ways(network, 0, 8)) for at in departures]
            np.testing.assert_allclose(walked.seconds, fastest, rtol=1e-5)
        else:
            # Between steps costs are taken to be linear.
            np.testing.assert_array_less(np.array(best) * (1 - 1e-5), walked.tally.cost)
            np.testing.assert_allclose(walked.tally.cost, best, rtol=0.03 if lit else 0.01)


def seconds(crossed, way: list[int], departure: float) -> float:
    clock = departure
    for segment in way:
        clock += float(crossed(jnp.int32(segment), jnp.float32(clock)).seconds)
    return clock - departure
