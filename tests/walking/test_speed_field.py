"""Speeds from counters are those of a dense field."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sidestep.crowds.base import FlowField, SensedField
from sidestep.crowds.interpolation import InterpolationWeights, interpolation_weights
from sidestep.network.graph import road_network
from sidestep.walking.crossing_time import crossing_time
from sidestep.walking.speed_field import KnownSpeeds, SensedSpeeds, dense_speeds, speed_field, walking_speeds
from sidestep.walking.speed_laws import Weidmann

SLOT = 300.0
LAW = Weidmann()


def sensed(density: np.ndarray, weights: InterpolationWeights) -> SensedSpeeds:
    return SensedSpeeds(SensedField(jnp.asarray(density, jnp.float32), weights, SLOT), LAW)


# --- As good as a dense field ---------------------------------------------------------------------------------------

LINE = road_network(np.zeros((6, 2)), [0, 1, 2, 3, 4], [1, 2, 3, 4, 5], [100.0] * 5)
LINE_SPREAD = interpolation_weights(LINE, np.array([0, 3, 4]), 80.0)
CLOCKS = jnp.arange(0, 1500, 37.0)


@jax.jit
def both_ways(density: jax.Array) -> tuple[tuple[jax.Array, ...], tuple[jax.Array, ...]]:
    """Everything there is to ask, of speeds from sensors and of the same speeds worked out beforehand."""
    few = SensedSpeeds(SensedField(density, LINE_SPREAD, SLOT), LAW)
    dense = speed_field(LAW.speed(jnp.swapaxes(LINE_SPREAD.everywhere(density), -1, -2)), SLOT)
    segments, futures, slots = jnp.arange(5), jnp.arange(2), jnp.arange(4)

    def ask(speeds: KnownSpeeds) -> tuple[jax.Array, ...]:
        def on_one(future: jax.Array, segment: jax.Array) -> tuple[jax.Array, ...]:
            row = speeds.row(future, segment)
            crossing = jax.vmap(lambda clock: crossing_time(row, jnp.float32(250), clock))(CLOCKS)
            return row.speed(slots), row.covered(slots), row.covered_from(jnp.int32(1), 2), crossing

        rows = jax.vmap(lambda c: jax.vmap(lambda s: on_one(c, s))(segments))(futures)
        at = jax.vmap(lambda c: jax.vmap(lambda t: speeds.at(c, segments, t))(slots))(futures)
        of = jax.vmap(lambda c: speeds.of(c).speed)(futures)
        covered = jax.vmap(lambda c: speeds.of(c).covered)(futures)
        return *rows[:3], at, of, covered, rows[3]

    return ask(few), ask(dense)


@settings(max_examples=30)
@given(hnp.arrays(np.float32, (2, 4, 3), elements=st.floats(0, 5, width=32)))
def test_as_a_dense_field(density: np.ndarray) -> None:
    few, dense = (tuple(map(np.asarray, answers)) for answers in both_ways(jnp.asarray(density)))
    for one, other in zip(few, dense, strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=2e-4, atol=1e-3)
    # Nobody who enters later leaves earlier.
    assert (np.diff(np.asarray(CLOCKS) + few[-1], axis=-1) > -0.01).all()


VOLUME = jnp.arange(2 * 4 * 5, dtype=jnp.float32).reshape(2, 4, 5)


def test_crowds_behind_speeds() -> None:
    dense = walking_speeds(LINE, FlowField(VOLUME, SLOT), LAW, densities=True)
    assert (dense.interpolated, dense.keeps_density) == (False, True)
    np.testing.assert_allclose(dense.field(LINE).counted, VOLUME, rtol=1e-6)
    few = sensed(np.arange(24).reshape(2, 4, 3) / 10, LINE_SPREAD)
    assert (few.interpolated, few.keeps_density) == (True, True)
    np.testing.assert_array_equal(few.field(LINE).counted, few.crowds.counted)
    np.testing.assert_array_equal(walking_speeds(LINE, few.crowds, LAW).crowds.counted, few.crowds.counted)
    without = dense_speeds(LINE, FlowField(VOLUME, SLOT), LAW)
    assert not without.keeps_density
    with pytest.raises(ValueError, match="made without their densities"):
        without.field(LINE)


def test_some_futures_and_the_first_slots() -> None:
    dense = dense_speeds(LINE, FlowField(VOLUME, SLOT), LAW, densities=True)
    for name in ("speed", "covered", "density"):
        np.testing.assert_array_equal(getattr(dense.first(3), name), np.asarray(getattr(dense, name))[:, :, :3])
        taken = getattr(dense.taken(jnp.array([1, 0, 1])), name)
        np.testing.assert_array_equal(taken, np.asarray(getattr(dense, name))[[1, 0, 1]])
    few = sensed(np.arange(24).reshape(2, 4, 3) / 10, LINE_SPREAD)
    np.testing.assert_array_equal(few.first(3).crowds.counted, np.asarray(few.crowds.counted)[:, :3])
    np.testing.assert_array_equal(few.taken(jnp.array([1, 1])).crowds.counted, np.asarray(few.crowds.counted)[[1, 1]])
    assert (few.first(3).count, few.first(3).slots) == (dense.first(3).count, dense.first(3).slots) == (2, 3)


def test_replaced_futures() -> None:
    dense = dense_speeds(LINE, FlowField(VOLUME, SLOT), LAW)
    other = dense_speeds(LINE, FlowField(VOLUME[:1] + 5, SLOT), LAW)
    after = dense.replaced(other, jnp.array([1]))
    np.testing.assert_array_equal(after.speed[1], other.speed[0])
    np.testing.assert_array_equal(after.covered[0], dense.covered[0])
    # What counters count is replaced, how it is interpolated is not.
    few = sensed(np.arange(36).reshape(3, 4, 3) / 10, LINE_SPREAD)
    weights = InterpolationWeights(LINE_SPREAD.sensor, 0 * LINE_SPREAD.weight)
    after = few.replaced(sensed(np.full((2, 4, 3), 0.7), weights), jnp.array([2, 0]))
    np.testing.assert_array_equal(after.crowds.weights.weight, LINE_SPREAD.weight)
    np.testing.assert_array_equal(after.crowds.counted[1], few.crowds.counted[1])
    np.testing.assert_array_equal(after.crowds.counted[::2], jnp.full((2, 4, 3), 0.7))


def test_paces_slow_walkers_down_wherever_speeds_are_asked_for() -> None:
    pace = jnp.array([1.0, 0.5, 1.0, 0.25, 1.0])
    stairs, counted = replace(LINE, pace=pace), np.arange(24, dtype=np.float32).reshape(2, 4, 3) / 10
    crowds = SensedField(jnp.asarray(counted), LINE_SPREAD, SLOT)
    slower, level = (walking_speeds(network, crowds, LAW) for network in (stairs, LINE))
    assert (slower.pace is pace, level.pace) == (True, None)
    future, segments = jnp.int32(1), jnp.arange(5)
    at = [each.at(future, segments, jnp.int32(2)) for each in (slower, level)]
    np.testing.assert_allclose(at[0], pace * at[1], rtol=1e-6)
    np.testing.assert_allclose(slower.of(future).speed, pace[:, None] * level.of(future).speed, rtol=1e-6)
    rows = [each.row(future, jnp.int32(3)) for each in (slower, level)]
    slots = jnp.arange(4)
    np.testing.assert_allclose(rows[0].speed(slots), 0.25 * rows[1].speed(slots), rtol=1e-6)
    np.testing.assert_allclose(rows[0].covered(slots), 0.25 * rows[1].covered(slots), rtol=1e-6)
    np.testing.assert_array_equal(rows[0].known_density, rows[1].known_density)
    assert slower.first(1).pace is slower.scaled(2.0).pace is pace
    slower, level = (dense_speeds(network, FlowField(VOLUME, SLOT), LAW) for network in (stairs, LINE))
    np.testing.assert_allclose(slower.speed, pace[:, None] * level.speed, rtol=1e-6)


def test_denser_crowds() -> None:
    few = sensed(np.arange(24).reshape(2, 4, 3) / 10, LINE_SPREAD)
    np.testing.assert_array_equal(few.scaled(1.5).crowds.counted, 1.5 * few.crowds.counted)


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
    row, slots = speeds.row(future, segment), jnp.arange(2)
    assert row.speed(slots).tolist() == pytest.approx([1.339995, 0.451545], rel=1e-5)
    assert row.covered(slots).tolist() == pytest.approx([0, 300 * 1.339995], rel=1e-5)
    assert row.known_density.tolist() == pytest.approx([0.15, 2.5])
