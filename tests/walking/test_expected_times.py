"""Expected times to cross are means over futures, by hand and against the crossing of each future."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.crowds.base import SensedField
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.walking.crossing_time import crosser, crossing_time, leaving_clock, mean_crossing_times
from sidestep.walking.expected_times import ExpectedTimes
from sidestep.walking.speed_field import SensedSpeeds, SpeedField, speed_field
from sidestep.walking.speed_laws import Weidmann

SLOT = 60.0
LENGTH = jnp.array([100.0])
# Two futures of one street of 100 m: one at 1 m/s, the other at 0.5 m/s for a minute and at 1 m/s ever after.
TWO = speed_field(jnp.array([[[1.0, 1.0, 1.0]], [[0.5, 1.0, 1.0]]]), SLOT, jnp.ones((2, 1, 3)))


def expected(speeds: SpeedField, length: jax.Array, rule: str = "integrated") -> ExpectedTimes:
    mean = speed_field(speeds.speed.mean(axis=0, keepdims=True), speeds.slot_seconds, jnp.ones((1, len(length), 3)))
    return ExpectedTimes(mean, mean_crossing_times(speeds, length, rule, 1)[None], length, speeds.slot_seconds)


def test_mean_times_by_hand() -> None:
    # Entered at 0: 100 s, and 60 s for 30 m and 70 s for the rest. Entered at 60 s: 100 s in both futures.
    np.testing.assert_allclose(mean_crossing_times(TWO, LENGTH, "integrated", 1), [[115.0, 100.0, 100.0]])
    # The paper's rule keeps the speed at entry: 100 and 200 s.
    np.testing.assert_allclose(mean_crossing_times(TWO, LENGTH, "entry", 1), [[150.0, 100.0, 100.0]])
    np.testing.assert_allclose(mean_crossing_times(TWO, LENGTH, "integrated", 2), [[115.0, 100.0]])


def test_times_are_unknown_where_slots_that_follow_may_matter() -> None:
    first = TWO.first(2)
    # Who enters at 60 s walks on in the last of these slots, in which nobody knows how long it lasts.
    np.testing.assert_allclose(mean_crossing_times(first, LENGTH, "integrated", 1, 3), [[np.nan] * 3])
    np.testing.assert_allclose(mean_crossing_times(first, LENGTH / 4, "integrated", 1, 3), [[37.5, np.nan, np.nan]])


def test_times_are_known_until_the_last_step_before_the_first_unknown_one() -> None:
    seconds = jnp.array([[[9.0, 9.0, 9.0, 9.0], [9.0, 9.0, 9.0, jnp.nan]]])
    assert expected(TWO, LENGTH).known_until == TWO.known_until == np.inf
    for unknown, until in ((3, 2 * SLOT), (2, SLOT), (0, -SLOT)):
        times = ExpectedTimes(TWO, seconds.at[0, 0, unknown:].set(jnp.nan), jnp.ones(2), SLOT)
        assert times.known_until == until


@pytest.mark.parametrize(("clock", "seconds"), [(0.0, 115.0), (30.0, 107.5), (60.0, 100.0), (1e6, 100.0)])
def test_times_are_linear_between_steps(clock: float, seconds: float) -> None:
    times, zero, at = expected(TWO, LENGTH), jnp.int32(0), jnp.float32(clock)
    assert float(leaving_clock(times, zero, zero, LENGTH[0], at)) == pytest.approx(clock + seconds)
    assert float(crossing_time(times.row(zero, zero), LENGTH[0], at)) == pytest.approx(seconds)
    np.testing.assert_allclose(crosser(times.of(zero), LENGTH, "integrated")(at[None]), [seconds])
    assert float(times.at(zero, zero, jnp.int32(0))) == pytest.approx(100 / 115)


means = jax.jit(mean_crossing_times, static_argnums=(2, 3))


@jax.jit
@partial(jax.vmap, in_axes=(0, None, None))
@partial(jax.vmap, in_axes=(0, 0, None))
def each_takes(one: SpeedField, length: jax.Array, clock: jax.Array) -> jax.Array:
    """Seconds across each segment in each future."""
    return crossing_time(one.row(), length, clock)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_means_over_futures_in_which_later_entry_is_later_exit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speeds = speed_field(jnp.asarray(rng.uniform(0.02, 2.0, (4, 3, 8)), jnp.float32), SLOT)
    length = jnp.asarray(rng.uniform(5, 300, 3), jnp.float32)
    found = means(speeds, length, "integrated", 1)
    by_hand = [np.mean(each_takes(speeds, length, jnp.float32(slot * SLOT)), axis=0) for slot in range(8)]
    np.testing.assert_allclose(found, np.stack(by_hand, axis=1), rtol=1e-4, atol=1e-2)
    assert (np.diff(np.arange(8) * SLOT + np.asarray(found), axis=1) >= -0.05).all()


def test_between_counters_times_are_means_over_what_counters_count() -> None:
    counted = jnp.asarray(np.random.default_rng(0).uniform(0, 5, (6, 5, 2)), jnp.float32)
    weights = InterpolationWeights(jnp.array([[0, 1], [1, 0], [0, 1]]), jnp.array([[0.5, 0.2], [0.9, 0.1], [0.0, 0.0]]))
    pace = jnp.array([1.0, 0.8, 1.2])
    speeds = SensedSpeeds(SensedField(counted, weights, SLOT), Weidmann(), pace)
    length = jnp.array([40.0, 80.0, 120.0])
    every = jax.vmap(speeds.of)(jnp.arange(6)).speed
    found = mean_crossing_times(speeds, length, "integrated", 2)
    np.testing.assert_allclose(found, np.mean(length[:, None] / every[..., ::2], axis=0), rtol=1e-5)
