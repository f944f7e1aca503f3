"""Whole walks, beside the same walk step by step."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.environment.dynamics import random_exit, reset, step
from sidestep.environment.rollout import Decide, walk
from sidestep.environment.types import EnvParams, Instance, Observation
from sidestep.network.graph import road_network
from sidestep.walking.objective import WeightedObjective
from sidestep.walking.speed_field import speed_field

KEY = jax.random.key(0)


def always(exit_of: list[int]) -> Decide:
    """The same exit at each visit of a node."""
    return lambda observation, _key: jnp.array(exit_of, jnp.int32)[observation.node]


def at_random(observation: Observation, key: jax.Array) -> jax.Array:
    return random_exit(observation.valid, jax.random.uniform(key))


@pytest.fixture(scope="module")
def steady(diamond, constant_field, make_params) -> EnvParams:
    return make_params(diamond, constant_field(diamond), horizon=1000)


@pytest.fixture(scope="module")
def busy(make_busy) -> EnvParams:
    return make_busy(horizon=20_000)


@pytest.mark.parametrize("future", [0, 1])
@pytest.mark.parametrize("departure", [0.0, 250.0])
def test_a_walk_is_its_steps(busy, make_instance, future: int, departure: float) -> None:
    instance = make_instance(destination=8, departure=departure, future=future)
    # right, right, up, left, left, up, right, right: past every node of the grid, row by row and back
    exits = [2, 2, 0, 0, 3, 3, 2, 2, 0]
    walked = jax.jit(lambda: walk(busy, always(exits), instance, KEY, trace=12))()
    state, _ = reset(busy, instance)
    nodes, segments, clocks, seconds = [0], [], [], 0.0
    for _ in range(8):
        state, outcome = step(busy, state, jnp.int32(exits[int(state.node)]))
        nodes.append(int(state.node))
        segments.append(int(outcome.segment))
        clocks.append(float(state.clock))
        seconds += float(outcome.crossed.seconds)
    assert nodes == [0, 1, 2, 5, 4, 3, 6, 7, 8]
    assert bool(outcome.terminated)
    assert bool(walked.arrived)
    assert int(walked.steps) == 8
    assert float(walked.seconds) == pytest.approx(seconds, rel=1e-5)
    assert walked.segments.tolist() == segments + [-1] * 4
    np.testing.assert_allclose(walked.clocks, clocks + clocks[-1:] * 4, rtol=1e-5)
    assert busy.network.head[walked.segments[:8]].tolist() == nodes[1:]


def test_by_hand(steady, make_instance) -> None:
    # down 150 m, then 250 m, at 1 m/s
    walked = walk(steady, always([1, 0, 0, 0]), make_instance(departure=30.0), KEY, trace=5)
    assert (bool(walked.arrived), int(walked.steps), float(walked.seconds)) == (True, 2, 400)
    assert walked.segments.tolist() == [2, 3, -1, -1, -1]
    assert walked.clocks.tolist() == [180, 430, 430, 430, 430]
    assert (float(walked.cost), walked.measures) == (400, {})


def test_a_walk_that_does_not_arrive_counts_as_the_horizon(steady, make_instance) -> None:
    # to and fro between 0 and 1, 100 s each: over at 1000 s, after 10 steps
    walked = walk(steady, always([0, 1, 1, 0]), make_instance(departure=30.0), KEY, trace=12)
    assert (bool(walked.arrived), int(walked.steps), float(walked.seconds)) == (False, 10, 1000)
    assert walked.segments.tolist() == [0, 4] * 5 + [-1, -1]
    # to and fro between 0 and 2, 150 s each: the seventh step ends at 1050 s, and still the walk counts 1000
    walked = walk(steady, always([1, 1, 1, 0]), make_instance(departure=30.0), KEY)
    assert (bool(walked.arrived), int(walked.steps), float(walked.seconds)) == (False, 7, 1000)


def test_a_walk_that_goes_round_is_not_walked_to_the_horizon(steady, make_instance) -> None:
    to_and_fro, four_nodes = always([0, 1, 1, 0]), 4
    walked = walk(steady, to_and_fro, make_instance(departure=30.0), KEY, by_node=True)
    assert int(walked.steps) == four_nodes
    assert (bool(walked.arrived), float(walked.seconds), float(walked.cost)) == (False, 1000, 1000)


def test_a_walk_whose_every_metre_counts_goes_round_to_the_horizon(diamond, make_params, make_instance) -> None:
    nobody_met = speed_field(jnp.ones((8, 2)), 300.0, jnp.zeros((8, 2)))
    objective = WeightedObjective(time=0.0, distance=1.0)
    by_metres = replace(make_params(diamond, nobody_met, horizon=1000), objective=objective)
    walked = walk(by_metres, always([0, 1, 1, 0]), make_instance(departure=30.0), KEY, by_node=True)
    # ten streets of 100 m, and the horizon since it did not arrive
    assert (int(walked.steps), float(walked.cost)) == (10, 2000)


def test_a_walk_past_every_node_arrives_before_it_counts_as_going_round(busy, make_instance) -> None:
    exits = always([2, 2, 0, 0, 3, 3, 2, 2, 0])  # as above
    walked = walk(busy, exits, make_instance(destination=8), KEY, by_node=True)
    assert (bool(walked.arrived), int(walked.steps)) == (True, busy.network.nodes - 1)


def test_a_short_trace_keeps_the_beginning(steady, make_instance) -> None:
    walked = walk(steady, always([0, 0, 0, 0]), make_instance(), KEY, trace=2)
    assert walked.segments.tolist() == [0, 1]
    assert walked.clocks.tolist() == [100, 300]
    assert float(walked.seconds) == 300


def test_no_trace_unless_asked_for(steady, make_instance) -> None:
    walked = walk(steady, always([0, 0, 0, 0]), make_instance(), KEY)
    assert walked.segments.shape == walked.clocks.shape == (0,)


def test_being_there_already_takes_no_time(steady, make_instance) -> None:
    walked = walk(steady, always([0, 0, 0, 0]), make_instance(origin=3, departure=77.0), KEY, trace=3)
    assert (bool(walked.arrived), int(walked.steps), float(walked.seconds)) == (True, 0, 0)
    assert walked.segments.tolist() == [-1, -1, -1]
    assert walked.clocks.tolist() == [77, 77, 77]


def test_every_crossing_has_its_own_random_numbers(make_params, make_instance) -> None:
    # Two streets of 1 m and 3 m from node 0 to 1, and two back; nobody ever gets to node 2.
    network = road_network(np.zeros((3, 2)), tail=[0, 0, 1, 1], head=[1, 1, 0, 0], length=[1.0, 3.0, 1.0, 3.0])
    params = make_params(network, speed_field(jnp.ones((4, 1)), 300.0), horizon=400)
    walked = walk(params, at_random, make_instance(destination=2), KEY, trace=100)
    metres = np.diff(walked.clocks, prepend=0.0)
    assert set(metres.tolist()) == {1, 3}
    assert 30 < (metres == 1).sum() < 70


def test_walks_side_by_side_are_walks_alone(busy, make_instance) -> None:
    several = make_instance(origin=[0, 4, 2], destination=[8, 0, 2], departure=[0.0, 100.0, 5.0], future=[0, 1, 0])
    keys = jax.random.split(KEY, 3)

    @jax.jit
    def one(instance: Instance, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        walked = walk(busy, at_random, instance, key, trace=30)
        return walked.seconds, walked.segments

    seconds, segments = jax.vmap(one)(several, keys)
    for i in range(3):
        alone_seconds, alone_segments = one(jax.tree.map(lambda leaf, i=i: leaf[i], several), keys[i])
        assert float(alone_seconds) == pytest.approx(float(seconds[i]), rel=1e-5)
        assert alone_segments.tolist() == segments[i].tolist()


def test_nothing_counts_more_than_the_horizon(make_params, make_instance) -> None:
    # 1,000 m at 1 m/s in one street: arrived, but 400 s after the horizon.
    network = road_network(np.zeros((2, 2)), tail=[0, 1], head=[1, 0], length=[1000.0, 1000.0])
    params = make_params(network, speed_field(jnp.ones((2, 1)), 300.0), horizon=600)
    walked = walk(params, always([0, 0]), make_instance(destination=1), KEY, trace=2)
    assert (bool(walked.arrived), float(walked.seconds)) == (True, 600)
    assert walked.clocks.tolist() == [1000, 1000]
