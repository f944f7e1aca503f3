"""Objectives and waits in the environment: by hand on the diamond, and searches beside every way there is."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.environment.cost_to_go import Ahead, expected_cost_to_go, live_cost_to_go
from sidestep.environment.crossing import as_expected, cross, crossings
from sidestep.environment.dynamics import reset, step
from sidestep.environment.rollout import walk
from sidestep.environment.types import EnvParams, futures_in_turn
from sidestep.network.graph import RoadNetwork
from sidestep.network.grid import grid_network
from sidestep.planners.base import walk_plan
from sidestep.planners.reactive import GreedyMap
from sidestep.planners.time_dependent import Clairvoyant, Expected
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import ObjectiveSpec
from sidestep.walking.objective import PENALTY_SECONDS, Objective, TravelTime, WeightedObjective
from sidestep.walking.speed_field import SpeedField, speed_field
from sidestep.walking.waits import Waits

KEY = jax.random.key(0)
SLOT = 100.0
ONE_HOUR = jnp.zeros(1)
crossed = jax.jit(cross)


def crowded(network: RoadNetwork, speed: np.ndarray, density: np.ndarray, objective: Objective) -> EnvParams:
    """One crowd, which is expected as well."""
    field = speed_field(jnp.asarray(speed)[None], SLOT, jnp.asarray(density)[None])
    return EnvParams(network, futures_in_turn(field, ONE_HOUR), field, jnp.float32(1e5), objective=objective)


def shown(params: EnvParams, ahead: Ahead) -> EnvParams:
    """With forecasts from counts that do not matter."""
    costs = live_cost_to_go(params, jnp.ones((1, 2, 8)), ahead)
    return replace(params, futures=replace(params.futures, cost_to_go=costs))


@pytest.fixture(scope="module")
def steady(diamond) -> EnvParams:
    """1 m/s everywhere; 2 persons/m² by node 1, till 100 s, and 1 from then on; nobody by node 2."""
    density = np.zeros((8, 2), np.float32)
    density[[0, 1, 4, 5]] = (2, 1)
    return crowded(diamond, np.ones((8, 2), np.float32), density, WeightedObjective(exposure=0.5, distance=0.1))


def test_a_crossing_by_hand(steady) -> None:
    # 0 > 1 entered at 50 s: 50 s at 2 persons/m² and 50 at 1
    one = crossed(steady, jnp.int32(0), jnp.int32(0), jnp.float32(50))
    assert (float(one.seconds), float(one.measures["metres"]), float(one.measures["exposure"])) == (100, 100, 150)
    assert float(one.cost) == pytest.approx(100 + 0.1 * 100 + 0.5 * 150)
    # Long after the last slot.
    assert float(crossed(steady, jnp.int32(0), jnp.int32(1), jnp.float32(1e4)).measures["exposure"]) == pytest.approx(
        200
    )


def test_all_segments_at_once_are_each_alone(steady) -> None:
    every = crossings(steady, steady.futures.speeds.of(jnp.int32(0)), steady.wait_in(jnp.int32(0)), every=4)
    assert every.cost.shape == (8, 8)
    for number, clock in ((0, 0.0), (3, 75.0), (7, 175.0)):
        for segment in (0, 1, 3):
            one = crossed(steady, jnp.int32(0), jnp.int32(segment), jnp.float32(clock))
            assert float(every.cost[number, segment]) == pytest.approx(float(one.cost), rel=1e-6)


def test_the_objective_decides_the_way(steady, make_instance) -> None:
    def way(objective: Objective) -> tuple[list[int], float]:
        params = replace(steady, objective=objective)
        walked = walk_plan(Expected(), params, Expected().plan(params, make_instance([0])), make_instance([0]), KEY, 2)
        return walked.segments[0].tolist(), float(walked.seconds[0])

    # By 1 300 m, and 200 + 200 person·s/m² met; by 2 400 m and nobody.
    assert way(TravelTime()) == ([0, 1], 300)
    assert way(WeightedObjective(exposure=0.2)) == ([0, 1], 300)
    assert way(WeightedObjective(exposure=0.3)) == ([2, 3], 400)
    assert way(WeightedObjective(exposure=0.3, distance=0.3)) == ([0, 1], 300)
    # At 0 s there are more than 1.5 persons/m² by node 1.
    assert way(WeightedObjective(max_density=1.5)) == ([2, 3], 400)
    assert way(WeightedObjective(max_density=2.5)) == ([0, 1], 300)


def test_crowds_that_come_as_expected(steady) -> None:
    # Two futures for two destinations, with other crowds than are expected; lights are at their mean wait.
    speeds = speed_field(jnp.full((2, 8, 2), 0.5), SLOT, jnp.full((2, 8, 2), 3.0))
    none = jnp.zeros(8)
    waits = Waits(none + 1, none, none + 90, none + 30, none, jnp.zeros(24), 8.0)
    params = as_expected(replace(steady, futures=futures_in_turn(speeds, jnp.array([7.0, 30.0])), waits=waits))
    assert (params.futures.count, params.futures.hour.tolist()) == (1, [7])
    # 20 s of waiting and 100 s of walking among 2 persons/m² till 100 s, then among 1
    one = crossed(params, jnp.int32(0), jnp.int32(0), jnp.float32(0))
    assert (float(one.seconds), float(one.measures["exposure"])) == (120, 220)


def test_rewards_and_tallies_are_of_costs(steady, make_instance) -> None:
    state, _ = reset(steady, make_instance())
    _, outcome = step(steady, state, jnp.int32(0))
    cost = 100 + 0.1 * 100 + 0.5 * 200
    weights, straight = steady.reward, 200 - np.hypot(100, 100)
    assert float(outcome.reward) == pytest.approx(-cost / weights.unit_seconds + weights.progress * straight, rel=1e-5)
    forbidding = replace(steady, objective=WeightedObjective(max_density=1.5))
    walked = walk(forbidding, lambda *_: jnp.int32(0), make_instance(), KEY)
    # 0 > 1 is entered at 2 persons/m², and 1 > 3 at 1.
    assert {name: float(total) for name, total in walked.measures.items()} == dict(
        metres=300, exposure=400, too_dense=1
    )
    assert float(walked.cost) == PENALTY_SECONDS + 300


def test_a_street_that_is_seen_to_be_too_dense_is_not_entered(diamond, make_instance) -> None:
    # Nobody is expected; on 0 > 1 there are 3 persons/m².
    speed, density = np.ones((8, 2), np.float32), np.zeros((8, 2), np.float32)
    params = crowded(diamond, speed, density, WeightedObjective(max_density=2.5))
    dense = speed_field(jnp.asarray(speed)[None], SLOT, jnp.asarray(density).at[0].set(3.0)[None])
    params = replace(params, futures=futures_in_turn(dense, ONE_HOUR), level="map")
    params = replace(params, cost_to_go=expected_cost_to_go(params, (jnp.arange(4) == 3)[None], ONE_HOUR))
    for planner, totals in ((GreedyMap(), (400, 0)), (Expected(), (300, 1))):
        plan = planner.plan(params, make_instance([0]))
        walked = walk_plan(planner, params, plan, make_instance([0]), KEY)
        assert (float(walked.measures["metres"][0]), float(walked.measures["too_dense"][0])) == totals


def test_who_does_not_arrive_pays_the_horizon_more(steady, make_instance) -> None:
    # To and fro between 0 and 1, 200 s there and back; cut off after 300 s. At 0 and 1 persons/m² met beside 1 m/s.
    short = replace(steady, objective=WeightedObjective(exposure=1.0), horizon=jnp.float32(300.0))
    walked = walk(short, lambda *_: jnp.int32(0), make_instance(origin=0, destination=2), KEY)
    assert not walked.arrived
    # Two steps to 1 and one back, among 2 and then 1 persons/m².
    assert float(walked.cost) == pytest.approx(300 + float(walked.measures["exposure"]) + 300)
    assert float(walked.cost) > 300 + 300


@pytest.mark.parametrize(("clock", "seen"), [(0.0, 3.0), (95.0, 3.0), (100.0, 0.0)])
def test_live_walkers_see_what_is_too_dense_until_it_is_over(diamond, make_instance, clock: float, seen: float) -> None:
    # On 0 > 1 there are 3 persons/m² till 100 s, then nobody; the forecast knows it.
    density = np.zeros((8, 2), np.float32)
    density[0, 0] = 3
    params = crowded(diamond, np.ones((8, 2), np.float32), density, WeightedObjective(max_density=2.0))
    costs = expected_cost_to_go(params, (jnp.arange(4) == 3)[None], ONE_HOUR)
    params = replace(params, cost_to_go=costs, level="live")

    def ahead(_now: jax.Array, _hour: jax.Array, slot: jax.Array) -> SpeedField:
        later = jnp.asarray(density)[:, jnp.minimum(slot + jnp.arange(3), 1)]
        return speed_field(jnp.ones((8, 3)), SLOT, later)

    params = shown(params, ahead)
    _, found = reset(params, make_instance(departure=clock))
    penalty = PENALTY_SECONDS if seen else 0
    np.testing.assert_allclose(found.live.forecast, [300 + penalty, 400], atol=0.05)
    np.testing.assert_allclose(found.live.snapshot, [300 + penalty, 400], atol=0.05)


def test_lights_and_crowds_are_both_in_what_live_walkers_reckon(diamond, make_instance) -> None:
    # A light on 0 > 1, red for 60 s more: 40 s more than the mean, in a crowd of 2 persons/m².
    density = np.zeros((8, 2), np.float32)
    density[0] = 2
    params = crowded(diamond, np.ones((8, 2), np.float32), density, WeightedObjective(exposure=0.5))
    none = jnp.zeros(8)
    waits = Waits(none.at[0].set(1), none, none + 90, none + 30, none + 20, jnp.zeros(24), 8.0)
    params = replace(params, waits=waits)
    costs = expected_cost_to_go(params, (jnp.arange(4) == 3)[None], ONE_HOUR)
    params = replace(params, cost_to_go=costs, level="live")
    stays = speed_field(jnp.ones((8, 3)), SLOT, jnp.asarray(density)[:, [0, 0, 0]])
    params = shown(params, lambda *_: stays)
    _, found = reset(params, make_instance(departure=50.0))
    # 60 s of waiting and 100 s of walking among 2 persons/m², then 200 s alone
    np.testing.assert_allclose(found.estimate, [160 * (1 + 0.5 * 2) + 200, 400], atol=0.05)
    np.testing.assert_allclose(found.local.crossing, [160, 150])


@pytest.mark.parametrize(
    "objective",
    [ObjectiveSpec(max_density=1.0), ObjectiveSpec(exposure=10.0), ObjectiveSpec(time=0.01, exposure=1.0)],
)
def test_nobody_beats_the_clairvoyant_even_where_it_pays_to_walk_to_and_fro(objective: ObjectiveSpec) -> None:
    problem = scenario("paper-congested", side=4, crowded_nodes=3, horizon=8 * 3600.0, objective=objective)
    place = draw_map(problem, 0)
    params = make_environment(problem, place, "test", 12, level="map")
    todo = instances(problem, place, params, 12)
    cost = {}
    for planner in (Clairvoyant(), Expected(), GreedyMap()):
        walked = walk_plan(planner, params, planner.plan(params, todo), todo, KEY)
        cost[planner.name] = np.asarray(walked.cost)
        assert np.asarray(walked.arrived).all() or planner.name == "greedy-map"
    for name in ("expected", "greedy-map"):
        assert (cost["clairvoyant"] <= 1.02 * cost[name] + 1).all(), name


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
    params = crowded(
        network, 1.34 - 0.25 * density, density, WeightedObjective(exposure=0.7, distance=0.2, max_density=3.7)
    )
    if lit:
        offset = jnp.asarray(rng.uniform(0, 90, network.segments), jnp.float32)
        one = jnp.ones(network.segments)
        waits = Waits(one, 0 * one, 90 * one, 30 * one, offset, jnp.zeros(24), 8.0)
        params = replace(params, waits=waits)

    def over(segment: int, clock: float) -> Any:
        return crossed(params, jnp.int32(0), jnp.int32(segment), jnp.float32(clock))

    def cost(way: list[int], departure: float) -> float:
        clock, total = departure, 0.0
        for segment in way:
            one = over(segment, clock)
            clock, total = clock + float(one.seconds), total + float(one.cost)
        return total

    departures = [0.0, 130.0, 333.0]
    best = [min(cost(way, at) for way in ways(network, 0, 8)) for at in departures]
    planner = Clairvoyant()
    for objective in (params.objective, TravelTime()):
        known = replace(params, objective=objective)
        walks = make_instance([0] * 3, 8, departures)
        walked = walk_plan(planner, known, planner.plan(known, walks), walks, KEY)
        if not objective.needs_density:
            fastest = [min(seconds(over, way, at) for way in ways(network, 0, 8)) for at in departures]
            np.testing.assert_allclose(walked.seconds, fastest, rtol=1e-5)
        else:
            # Between steps costs are taken to be linear.
            np.testing.assert_array_less(np.array(best) * (1 - 1e-5), walked.cost)
            np.testing.assert_allclose(walked.cost, best, rtol=0.03 if lit else 0.01)


def seconds(over, way: list[int], departure: float) -> float:
    clock = departure
    for segment in way:
        clock += float(over(segment, clock).seconds)
    return clock - departure
