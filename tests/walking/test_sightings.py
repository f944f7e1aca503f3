"""Crowds that were seen: on their streets they count instead of others, in every kind of speeds."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.base import SensedField
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.walking.crossing_time import crossing_time
from sidestep.walking.expected_times import ExpectedTimes
from sidestep.walking.sightings import Sightings
from sidestep.walking.speed_field import SensedSpeeds, SpeedField, dense_speeds, walking_speeds
from sidestep.walking.speed_laws import Weidmann

LAW, SLOTS, SLOT = Weidmann(), 6, 300.0
SEEN, DENSITY = 2, 3.0
PACE = jnp.array([1.0, 1.0, 0.5, 1.0, 1.0, 1.0, 0.5, 1.0])
SHARE = [0.0, 1.0, 1.0, 0.5, 0.25, 0.0]
FUTURE = jnp.int32(0)


@pytest.fixture(scope="module")
def sightings() -> Sightings:
    """What was seen on one of the eight segments of the diamond, in the second slot."""
    there = np.arange(8) == SEEN
    return Sightings(jnp.array(there * DENSITY, jnp.float32), jnp.array(there[:, None] * np.array(SHARE), jnp.float32))


@pytest.fixture(scope="module")
def sensed(diamond) -> SensedSpeeds:
    weights = InterpolationWeights(jnp.zeros((8, 1), int), jnp.linspace(0.2, 1.0, 8)[:, None])
    counted = jnp.linspace(0.3, 0.8, 2 * SLOTS).reshape(2, SLOTS, 1)
    network = replace(diamond, pace=PACE)
    return walking_speeds(network, SensedField(counted, weights, SLOT), LAW, densities=True)


@pytest.fixture(scope="module")
def table(diamond, sensed) -> SpeedField:
    """The same, worked out on all segments."""
    return dense_speeds(replace(diamond, pace=PACE), sensed.crowds, LAW, densities=True)


def test_what_is_seen_counts_and_fades(table, sightings) -> None:
    found = table.seeing(sightings, LAW, PACE)
    before, after = (np.asarray(each.known_density) for each in (table, found))
    assert after[:, SEEN, 1] == pytest.approx(DENSITY)
    assert after[:, SEEN, 3] == pytest.approx((DENSITY + before[:, SEEN, 3]) / 2)
    assert after[:, SEEN, [0, 5]] == pytest.approx(before[:, SEEN, [0, 5]])
    others = np.arange(8) != SEEN
    assert (after[:, others] == before[:, others]).all()
    assert (np.asarray(found.speed)[:, others] == np.asarray(table.speed)[:, others]).all()
    assert np.asarray(found.speed)[:, SEEN, 1] == pytest.approx(0.5 * float(LAW.speed(jnp.float32(DENSITY))))


def test_speeds_between_counters_agree_with_a_table(diamond, table, sensed, sightings) -> None:
    dense, lazy = (each.seeing(sightings, LAW, PACE) for each in (table, sensed))
    for future in (jnp.int32(0), jnp.int32(1)):
        assert np.asarray(lazy.of(future).speed) == pytest.approx(np.asarray(dense.of(future).speed), rel=1e-5)
        assert np.asarray(lazy.of(future).density) == pytest.approx(np.asarray(dense.of(future).density), rel=1e-5)
        for slot in map(jnp.int32, range(SLOTS)):
            every = jnp.arange(8)
            assert lazy.at(future, every, slot).tolist() == pytest.approx(
                dense.at(future, every, slot).tolist(), rel=1e-5
            )
        row, same = (each.row(future, jnp.int32(SEEN)) for each in (lazy, dense))
        assert float(crossing_time(row, jnp.float32(300), jnp.float32(100))) == pytest.approx(
            float(crossing_time(same, jnp.float32(300), jnp.float32(100))), rel=1e-5
        )
    # The first slots are those of all.
    assert np.asarray(lazy.first(3).of(FUTURE).speed) == pytest.approx(np.asarray(dense.of(FUTURE).speed)[:, :3])
    # Of later slots it is what counts in these, and nothing beyond the last one.
    assert sightings.later(jnp.int32(3), 5).share[SEEN].tolist() == [*SHARE[3:], 0, 0]
    # Counters know nothing of it.
    assert lazy.field(diamond) is sensed.crowds


@pytest.mark.parametrize("metres", [20.0, 150.0, 600.0])
def test_expected_times_where_a_crowd_was_seen(table, sightings, metres: float) -> None:
    length = jnp.full(8, metres)
    usual = jnp.stack([metres / 1.2 + 5 * jnp.arange(8.0), metres / 1.1 + 5 * jnp.arange(8.0)], axis=1)[None]
    times = ExpectedTimes(jax.tree.map(lambda leaf: leaf[:1], table), usual, length, SLOT * 5)
    found = times.seeing(sightings, LAW, PACE)
    # On other streets they are what they were, whenever these are entered.
    for clock in np.linspace(0, 2000, 41):
        for segment in (0, 7):
            every = (FUTURE, jnp.int32(segment), jnp.float32(clock))
            assert float(found.leaving(*every)) == pytest.approx(float(times.leaving(*every)), rel=1e-5)
    # There nobody who enters later leaves earlier.
    leaves = [float(found.leaving(FUTURE, jnp.int32(SEEN), jnp.float32(clock))) for clock in np.linspace(0, 2000, 201)]
    assert (np.diff(leaves) > -1e-3).all()
    crowded = metres / (0.5 * float(LAW.speed(jnp.float32(DENSITY))))
    if crowded <= 2 * SLOT:
        assert leaves[30] - 300 == pytest.approx(crowded, rel=1e-4)
    assert leaves[-1] - 2000 == pytest.approx(float(usual[0, SEEN, 1]), rel=1e-4)
    # The expected crowd is what was seen as well.
    assert float(found.density_at(FUTURE, jnp.int32(SEEN), jnp.int32(1))) == pytest.approx(DENSITY)
