"""Speeds from sensors are those of a dense field; what level map sees where crowds spread from sensors."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sidestep.crowds.base import FlowField
from sidestep.crowds.interpolation import InterpolationWeights, interpolation_weights
from sidestep.environment.knowledge import expected_cost_to_go
from sidestep.environment.observation import EMPTY, observe
from sidestep.environment.rollout import walk
from sidestep.environment.types import (
    DENSITY_SCALE,
    EnvParams,
    EnvState,
    Instance,
    Observation,
    field_of,
    walking_speeds,
)
from sidestep.network.graph import road_network
from sidestep.network.grid import grid_network
from sidestep.scenarios.futures import replace_futures
from sidestep.walking.crossing_time import crossing_time_in
from sidestep.walking.speed_field import SensedSpeeds, speed_field
from sidestep.walking.speed_laws import Weidmann

SLOT = 300.0
LAW = Weidmann()


def sensed(density: np.ndarray, weights: InterpolationWeights) -> SensedSpeeds:
    return SensedSpeeds(jnp.asarray(density, jnp.float32), weights, LAW, SLOT)


# --- As good as a dense field ---------------------------------------------------------------------------------------

LINE = road_network(np.zeros((6, 2)), [0, 1, 2, 3, 4], [1, 2, 3, 4, 5], [100.0] * 5)
LINE_SPREAD = interpolation_weights(LINE, np.array([0, 3, 4]), 80.0)
CLOCKS = jnp.arange(0, 1500, 37.0)


@jax.jit
def both_ways(density: jax.Array) -> tuple[tuple[jax.Array, ...], tuple[jax.Array, ...]]:
    """Everything there is to ask, of speeds from sensors and of the same speeds worked out beforehand."""
    few = SensedSpeeds(density, LINE_SPREAD, LAW, SLOT)
    dense = speed_field(LAW.speed(jnp.swapaxes(LINE_SPREAD.everywhere(density), -1, -2)), SLOT)
    segments, futures, slots = jnp.arange(5), jnp.arange(2), jnp.arange(4)

    def ask(speeds) -> tuple[jax.Array, ...]:
        rows = jax.vmap(lambda c: jax.vmap(lambda s: speeds.through(c, s))(segments))(futures)
        at = jax.vmap(lambda c: jax.vmap(lambda t: speeds.at(c, segments, t))(slots))(futures)
        of = jax.vmap(lambda c: speeds.of(c).speed)(futures)
        covered = jax.vmap(lambda c: speeds.of(c).covered)(futures)
        cross = jax.vmap(lambda v, c, t: crossing_time_in(v, c, SLOT, jnp.float32(250), t), (None, None, 0))
        return *rows, at, of, covered, jax.vmap(jax.vmap(lambda v, c: cross(v, c, CLOCKS)))(*rows)

    return ask(few), ask(dense)


@settings(max_examples=30)
@given(hnp.arrays(np.float32, (2, 4, 3), elements=st.floats(0, 5, width=32)))
def test_as_a_dense_field(density: np.ndarray) -> None:
    few, dense = (tuple(map(np.asarray, answers)) for answers in both_ways(jnp.asarray(density)))
    for one, other in zip(few, dense, strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=2e-4, atol=1e-3)
    # Whoever enters later does not leave earlier.
    assert (np.diff(np.asarray(CLOCKS) + few[-1], axis=-1) > -0.01).all()


def test_people_behind_speeds_and_the_first_of_them() -> None:
    volume = jnp.arange(2 * 4 * 5, dtype=jnp.float32).reshape(2, 4, 5)
    dense = walking_speeds(LINE, FlowField(volume, SLOT), LAW, densities=True)
    np.testing.assert_allclose(field_of(LINE, dense).counted, volume, rtol=1e-6)
    few = sensed(np.arange(24).reshape(2, 4, 3) / 10, LINE_SPREAD)
    np.testing.assert_array_equal(field_of(LINE, few).counted, few.density)
    for name in ("speed", "covered", "density"):
        np.testing.assert_array_equal(getattr(dense.first(1, 3), name), np.asarray(getattr(dense, name))[:1, :, :3])
    np.testing.assert_array_equal(few.first(1, 3).density, np.asarray(few.density)[:1, :3])
    assert (few.first().count, few.first().slots) == (dense.first().count, dense.first().slots) == (2, 4)
    with pytest.raises(ValueError, match="made without their densities"):
        field_of(LINE, walking_speeds(LINE, FlowField(volume, SLOT), LAW))


def test_sensed_speeds_by_hand() -> None:
    # Segment 0 hears sensors 1 and 0, .75 of 2 and .25 of 4 persons/m²: 2.5. Weidmann: 1 / 2.5 - 1 / 5.4 = .214815,
    # times -1.913 is -.410941, exp .663026: 1.34 * .336974 = .451545 m/s; in the slot before it .1 and .3: .15,
    # 1 / .15 - 1 / 5.4 = 6.481481, which is as good as free: 1.34 * (1 - 4.1e-6).
    spread = InterpolationWeights(jnp.array([[1, 0], [0, 1]]), jnp.array([[0.75, 0.25], [0.0, 0.0]]))
    speeds = sensed(np.array([[[0, 0], [0, 0]], [[0.3, 0.1], [4, 2]]]), spread)
    assert (speeds.count, speeds.slots) == (2, 2)
    future, segment = jnp.int32(1), jnp.int32(0)
    assert float(speeds.density_at(future, segment, jnp.int32(1))) == pytest.approx(2.5)
    assert speeds.at(future, jnp.array([0, 1]), jnp.int32(1)).tolist() == pytest.approx([0.451545, 1.34], rel=1e-5)
    speed, covered = speeds.through(future, segment)
    assert speed.tolist() == pytest.approx([1.339995, 0.451545], rel=1e-5)
    assert covered.tolist() == pytest.approx([0, 300 * 1.339995], rel=1e-5)


# --- What level map sees --------------------------------------------------------------------------------------------

GOAL = 15


@pytest.fixture(scope="module")
def town() -> EnvParams:
    """4 x 4 nodes and three sensors. Crowd 0 is as expected, always the same; crowd 1 thrice, crowd 2 half as dense."""
    network = grid_network(4, np.random.default_rng(2))
    spread = interpolation_weights(network, np.array([3, 20, 40]), 400.0)
    usual = np.tile([0.4, 2.0, 1.2], (1, 3, 1))
    futures, expected = sensed(usual * np.array([1, 3, 0.5])[:, None, None], spread), sensed(usual, spread)
    goals = (jnp.arange(16) == GOAL)[None]
    params = EnvParams(network, futures, expected, jnp.float32(1e5), level="map")
    return replace(params, usual=jax.jit(expected_cost_to_go)(params, goals))


def walks(future: int) -> Instance:
    """From everywhere else to the goal."""
    each = jnp.arange(15, dtype=jnp.int32)
    return Instance(each, jnp.full(15, GOAL, jnp.int32), jnp.full(15, 70.0), jnp.full(15, future, jnp.int32))


@jax.jit
def see_all(params: EnvParams, instances: Instance) -> Observation:
    recent_nodes = jnp.full(8, -1)
    return jax.vmap(lambda one: observe(params, EnvState(one.origin, one.departure, one, recent_nodes, jnp.int32(0))))(
        instances
    )


@jax.jit
def walk_all(params: EnvParams, instances: Instance):
    def decide(seen: Observation, _key: jax.Array) -> jax.Array:
        return jnp.argmin(jnp.where(seen.valid, seen.estimate, jnp.inf))

    return jax.vmap(lambda one: walk(params, decide, one, jax.random.key(0)))(instances)


def test_crowds_as_expected_surprise_nobody(town) -> None:
    seen = see_all(town, walks(0))
    valid = np.asarray(seen.valid)
    np.testing.assert_allclose(np.asarray(seen.usual.log_density_ratio)[valid], 0, atol=1e-6)
    np.testing.assert_allclose(seen.usual.cost, seen.local.crossing, rtol=1e-6)


def test_surprise_is_a_logarithm(town) -> None:
    segment = np.asarray(town.network.exit_segment)[:15]
    usual = np.asarray(town.expected.weights.everywhere(jnp.array([0.4, 2.0, 1.2])))[segment]
    for future, times in ((1, 3), (2, 0.5)):
        seen = see_all(town, walks(future))
        valid = np.asarray(seen.valid)
        by_hand = np.log((times * usual + EMPTY) / (usual + EMPTY))
        np.testing.assert_allclose(
            np.asarray(seen.usual.log_density_ratio)[valid], by_hand[valid], rtol=1e-4, atol=1e-5
        )
        assert (np.sign(by_hand[valid]) == np.sign(times - 1)).all()


def test_heavier_crowds_take_longer(town) -> None:
    seen = see_all(town, walks(0))
    valid = np.asarray(seen.valid)
    cost_to_go_scaled = np.asarray(seen.usual.cost_to_go_scaled)
    assert (cost_to_go_scaled[valid] >= -0.02).all()
    assert cost_to_go_scaled[valid].max() > 10
    # It is what it takes if the expected crowds are HEAVIER times as dense.
    dense = replace(town.expected, density=DENSITY_SCALE * town.expected.density)
    goals = (jnp.arange(16) == GOAL)[None]
    other = jax.jit(expected_cost_to_go)(replace(town, expected=dense), goals).table[0, 0]
    onto = np.asarray(town.network.exit_node)[:15]
    np.testing.assert_allclose(
        cost_to_go_scaled[valid], (np.asarray(other - town.usual.table[0, 0])[onto])[valid], atol=0.1
    )


def test_who_meets_what_is_expected_takes_the_expected_time(town) -> None:
    done = walk_all(town, walks(0))
    assert np.asarray(done.arrived).all()
    np.testing.assert_allclose(done.seconds, town.usual.table[0, 0, :15], rtol=1e-4, atol=0.1)
    # The best estimate at the origin is that time as well.
    seen = see_all(town, walks(0))
    best = np.where(np.asarray(seen.valid), np.asarray(seen.estimate), np.inf).min(axis=1)
    np.testing.assert_allclose(best, done.seconds, rtol=1e-4, atol=0.1)


@pytest.mark.parametrize("future", [1, 2])
def test_nobody_walks_to_and_fro_whatever_the_crowd(town, future: int) -> None:
    # The way through the expected crowds, crossing by crossing, however long it then takes.
    usual, done = walk_all(town, walks(0)), walk_all(town, walks(future))
    assert np.asarray(done.arrived).all()
    np.testing.assert_array_equal(done.steps, usual.steps)
    assert (np.asarray(done.seconds > usual.seconds) == (future == 1)).all()


def test_each_goal_is_expected_at_its_own_hour(town) -> None:
    # Two worlds expect other densities; crowd number c meets what number c modulo 2 expects.
    usual = np.tile([0.4, 2.0, 1.2], (2, 3, 1)) * np.array([1, 2])[:, None, None]
    spread = town.futures.weights
    both = replace(town, expected=sensed(usual, spread), futures=sensed(usual[[0, 1, 0]], spread))
    for future in range(3):
        seen = see_all(both, walks(future))
        np.testing.assert_allclose(np.asarray(seen.usual.log_density_ratio)[np.asarray(seen.valid)], 0, atol=1e-6)


def test_fresh_crowds_keep_the_spread(town) -> None:
    fresh = sensed(
        np.full((1, 3, 3), 0.7), InterpolationWeights(town.futures.weights.sensor, 0 * town.futures.weights.weight)
    )
    after = replace_futures(town, (fresh, None), jnp.int32(1))
    np.testing.assert_array_equal(after.futures.weights.weight, town.futures.weights.weight)
    np.testing.assert_array_equal(after.futures.density[1], fresh.density[0])
    np.testing.assert_array_equal(after.futures.density[jnp.array([0, 2])], town.futures.density[jnp.array([0, 2])])
    assert after.futures.slot_seconds == SLOT
