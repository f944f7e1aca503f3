"""Crowds of sensors: by hand between the hours, and what is drawn by statistics."""

import math
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.base import SensedField
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.crowds.sensor_model import SensorModel
from sidestep.crowds.sensors import SensorFlow

HOUR = 3600.0
WEEK = 168
KEY = jax.random.key(1)
MANY = 4_000
MOST = 12


@jax.jit
def _drawn(flow: SensorFlow, hours: jax.Array, key: jax.Array) -> jax.Array:
    return flow.draw(key, jnp.resize(hours, MANY), MOST).counted


def draw(flow: SensorFlow, hours: jax.Array, key: jax.Array = KEY, *, slots: int = 4) -> np.ndarray:
    """The first of many slots, so that all tests share compiled programs; the futures take the hours in turn."""
    return np.asarray(_drawn(flow, hours, key))[:, :slots]


@partial(jax.jit, static_argnames="slots")
def expected(flow: SensorFlow, hours: jax.Array, *, slots: int = 4) -> jax.Array:
    return flow.expected(hours, slots).counted


@partial(jax.jit, static_argnames="slots")
def ahead(flow: SensorFlow, hour: float, now: jax.Array, slot: int, *, slots: int = 4) -> jax.Array:
    return flow.ahead(now, jnp.float32(hour), slot, slots)


def at(*hours: float) -> jax.Array:
    return jnp.array(hours, float)


def near(found: np.ndarray, expected: float | np.ndarray, error: float | np.ndarray) -> None:
    """Within five standard errors."""
    assert (np.abs(np.asarray(found) - expected) < 5 * np.asarray(error)).all()


def flat(level: float, sensors: int = 1) -> SensorModel:
    """The same level in every hour."""
    ones = jnp.ones(sensors)
    return SensorModel(
        jnp.full((WEEK, sensors), level, float), 0.0 * ones, all_day(0.3 * ones), 0.5 * ones, jnp.eye(sensors)
    )


def all_day(sigma: jax.Array) -> jax.Array:
    """The same deviations in every hour of the day."""
    return jnp.tile(sigma, (24, 1))


# --- From hours of the week to slots --------------------------------------------------------------------------------

# Sensor 0 is expected to count 3, 15, 63, 255 persons in the hours 0 to 3 of each day and 1,023 in all others,
# logarithms (of one more) of 2, 4, 6, 8 and 10 times log 2; sensor 1 always 99, and stands where 200 are one per m².
DAY = np.array([2, 4, 6, 8] + [10] * 20) * math.log(2)
BOTH = InterpolationWeights(jnp.array([[0, 1]]), jnp.array([[0.5, 0.5]]))


def sensor_flow(slot_seconds: float = HOUR, sigma: float = 0.0, weekly: float = 0.0, **changes) -> SensorFlow:
    level = jnp.asarray(np.stack([np.tile(DAY, 7), np.full(WEEK, math.log(100))], axis=1), jnp.float32)
    model = SensorModel(
        level, jnp.full(2, weekly, float), jnp.full((24, 2), sigma, float), jnp.array([0.5, 0.5]), jnp.eye(2)
    )
    return replace(SensorFlow(model, BOTH, jnp.array([1.0, 0.005]), slot_seconds), **changes)


def test_expected_counts_are_those_of_the_middles_of_hours() -> None:
    # Slots of an hour from Monday 0:00 on have the middles of hours as theirs.
    found = np.asarray(expected(sensor_flow(), at(0, 24)))
    assert found.shape == (2, 4, 2)
    np.testing.assert_allclose(found, [[[count, 0.495] for count in (3, 15, 63, 255)]] * 2, rtol=1e-4)


def test_between_the_middles_logarithms_are_linear() -> None:
    # Slots of half an hour. From Monday 1:15 their middles are 1:30, 2:00, 2:30: 4, 5 and 6 log 2.
    # From Monday 1:00 they are 1:15, 1:45, 2:15: 3.5, 4.5 and 5.5 log 2: 11.3137, 22.6274, 45.2548, less one.
    found = np.asarray(expected(sensor_flow(HOUR / 2), at(1.25, 1)))[:, :3, 0]
    np.testing.assert_allclose(found[0], [15, 31, 63], rtol=1e-5)
    np.testing.assert_allclose(found[1], [10.3137, 21.6274, 44.2548], rtol=1e-5)


def test_sunday_night_goes_on_into_monday() -> None:
    # Middles from Sunday 23:45 on: Monday 0:00, 0:30, 1:00, between 10 and 2, then 2, then 3 log 2. From Monday 0:00
    # on: 0:15, a quarter before the middle of the first hour, 4 log 2; then 0:45, 2.5 log 2, and 1:15, 3.5 log 2.
    found = np.asarray(expected(sensor_flow(HOUR / 2), at(167.75, 0)))[:, :3, 0]
    np.testing.assert_allclose(found, [[63, 3, 7], [15, 4.65685, 10.3137]], rtol=2e-4)


def test_the_mean_is_above_the_median() -> None:
    # Of log-normal counts, by exp(.4^2 / 2) = 1.083287: 4 and 100 times that, less one; the second by .005
    found = expected(sensor_flow(sigma=0.4), at(0, 24))[0, 0]
    assert found.tolist() == pytest.approx([3.333148, 0.536644], rel=1e-5)


def test_nobody_is_the_least() -> None:
    # log(1 + count) may come out below 0 where few are counted.
    sensed = draw(sensor_flow(model=flat(0.1, 2)), at(0, 0))
    # Residuals are below -.1, a third of their deviation, in 37 % of the hours.
    assert sensed.min() == 0
    assert (sensed == 0).mean() == pytest.approx(0.3694, abs=0.02)


def test_crowding_multiplies_all_densities() -> None:
    flow, hours = sensor_flow(sigma=0.4), at(1.25, 100)
    more = replace(flow, per_count=100 * flow.per_count)
    np.testing.assert_allclose(expected(more, hours), 100 * expected(flow, hours), rtol=1e-5)
    np.testing.assert_allclose(draw(more, hours), 100 * draw(flow, hours), rtol=1e-5)
    now = jnp.array([20.0, 0.7])
    np.testing.assert_allclose(ahead(more, 1.25, 100 * now, 2), 100 * ahead(flow, 1.25, now, 2), rtol=1e-4)


def test_every_future_has_its_hour() -> None:
    # Without deviation a draw is as expected: futures 0, 2 and 4 from Monday 1:15 on, 1 and 3 from Wednesday noon.
    flow, hours = sensor_flow(), at(1.25, 60)
    drawn, mean = np.asarray(draw(flow, hours)), np.asarray(expected(flow, hours))
    assert (mean[0] != mean[1]).any()
    np.testing.assert_allclose(drawn[:5], mean[[0, 1, 0, 1, 0]], rtol=1e-4)
    for future in range(4):
        np.testing.assert_allclose(ahead(flow, hours[future % 2], drawn[future, 0], 0), mean[future % 2], rtol=1e-4)


def test_it_depends_on_the_hour_and_gives_densities_at_sensors() -> None:
    flow = sensor_flow(HOUR / 2)
    assert flow.timed
    assert flow.covers(100.5)
    field = jax.eval_shape(lambda: flow.draw(KEY, jnp.zeros(5), 3))
    assert isinstance(field, SensedField)
    assert (field.counted.shape, field.slot_seconds) == ((5, 3, 2), HOUR / 2)


def test_pieces_of_a_segment_are_as_dense_as_the_whole() -> None:
    weights = InterpolationWeights(jnp.array([[0, 1], [1, 0]]), jnp.array([[0.5, 0.25], [1.0, 0.0]]))
    pieces = sensor_flow(weights=weights).on_pieces(jnp.array([0, 1, 1]), jnp.array([1.0, 0.3, 0.7]))
    sensed = jnp.array([2.0, 4.0])
    assert weights.everywhere(sensed).tolist() == [2, 4]
    assert pieces.weights.everywhere(sensed).tolist() == [2, 4, 4]


# --- What is drawn --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drawn() -> np.ndarray:
    """Residuals of two sensors with coefficients of .9 and .5, whose innovations have a correlation of .6."""
    model = replace(
        flat(6.0, 2),
        phi=jnp.array([0.9, 0.5]),
        sigma=all_day(jnp.array([0.4, 0.2])),
        cholesky=jnp.linalg.cholesky(jnp.array([[1, 0.6], [0.6, 1]])),
    )
    flow = SensorFlow(model, BOTH, jnp.ones(2), HOUR)
    return np.log1p(np.asarray(draw(flow, at(0, 0), slots=MOST), np.float64)) - 6


def test_residuals_are_stationary(drawn) -> None:
    assert drawn.shape == (MANY, 12, 2)
    deviation = np.array([0.4, 0.2])
    near(drawn.mean(axis=0), 0, deviation / math.sqrt(MANY))
    # as large in the first hour as in the last
    near(drawn.std(axis=0), deviation, deviation / math.sqrt(2 * MANY))


def test_residuals_remember(drawn) -> None:
    for sensor, memory in enumerate((0.9, 0.5)):
        for hours in (1, 3):
            found = np.corrcoef(drawn[:, 2, sensor], drawn[:, 2 + hours, sensor])[0, 1]
            near(found, memory**hours, (1 - memory ** (2 * hours)) / math.sqrt(MANY))


def test_innovations_go_together(drawn) -> None:
    innovation = drawn[:, 1:] - np.array([0.9, 0.5]) * drawn[:, :-1]
    for hour in range(11):
        near(np.corrcoef(innovation[:, hour], rowvar=False)[0, 1], 0.6, (1 - 0.36) / math.sqrt(MANY))


def test_crowds_have_nothing_to_do_with_each_other(drawn) -> None:
    near(np.corrcoef(drawn[:-1, 3, 0], drawn[1:, 3, 0])[0, 1], 0, 1 / math.sqrt(MANY))


def test_expected_is_the_mean_of_many_draws() -> None:
    flow, hours = sensor_flow(sigma=0.4), at(1, 25)
    found = np.asarray(draw(flow, hours), np.float64)
    near(found.mean(axis=0), np.asarray(expected(flow, hours))[0], found.std(axis=0) / math.sqrt(MANY))


# Weeks deviate by .3, hours by .2 from noon to midnight and .4 before, and demand by .5 from place to place.
LASTING = 0.3**2 + 0.5**2


ELEVEN = at(11, 11)


@pytest.fixture(scope="module")
def uneven() -> SensorFlow:
    """In slots of half an hour; from 11:00 on their middles are a quarter and three quarters past."""
    sigma = jnp.where(jnp.arange(24)[:, None] < 12, 0.4, 0.2) * jnp.ones(2)
    model = replace(flat(6.0, 2), weekly=jnp.full(2, 0.3, float), sigma=sigma)
    return SensorFlow(model, BOTH, jnp.ones(2), HOUR / 2, uneven=0.5)


def test_what_lasts_is_drawn_once_for_each_crowd(uneven) -> None:
    logs = np.log1p(np.asarray(draw(uneven, ELEVEN), np.float64))  # 11:15, 11:45, 12:15, 12:45
    # Deviations in the middles of hours are .4 at 10:30 and 11:30, .2 at 12:30 and later, .25 at 12:15 and .35 at
    # 11:45. All are a quarter of an hour from a middle: 1 - 2 * 3 / 16 / 2 = .8125 of their squares is left.
    variance = LASTING + 0.8125 * np.array([0.4, 0.35, 0.25, 0.2])[:, None] ** 2
    near(logs.mean(axis=0), 6 - 0.125, np.sqrt(variance / MANY))
    near(logs.var(axis=0), variance, variance * math.sqrt(2 / MANY))
    # 11:45 and 12:15 are of the same two middles: 3/4 and 1/4 of one, 1/4 and 3/4 of the other, so that
    # 3/16 + 3/16 + (9/16 + 1/16) / 2 = .6875 of the product of their deviations goes together.
    covariance = LASTING + 0.6875 * 0.35 * 0.25
    error = math.sqrt((float(variance[1, 0] * variance[2, 0]) + covariance**2) / MANY)
    near(np.cov(logs[:, 1, 0], logs[:, 2, 0])[0, 1], covariance, error)
    # What lasts is of one sensor, not of all.
    near(np.corrcoef(logs[:, 0].T)[0, 1], 0, 1 / math.sqrt(MANY))


def test_uneven_demand_is_as_large_in_the_mean(uneven) -> None:
    found, mean = np.asarray(draw(uneven, ELEVEN), np.float64), np.asarray(expected(uneven, ELEVEN))[0]
    near(found.mean(axis=0), mean, found.std(axis=0) / math.sqrt(MANY))
    np.testing.assert_allclose(mean, expected(replace(uneven, uneven=0.0), ELEVEN)[0], rtol=1e-5)
    # .09 of weeks, and .8125 of .4^2 at 11:15
    assert mean[0, 0] == pytest.approx(math.expm1(6 + (0.09 + 0.13) / 2), rel=1e-4)


def test_the_same_key_draws_the_same() -> None:
    flow, hours = sensor_flow(sigma=0.4), at(1.25, 2)
    first, again, other = (np.asarray(draw(flow, hours, key)) for key in (KEY, KEY, jax.random.key(2)))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.99


# --- Recorded weeks -------------------------------------------------------------------------------------------------

# Residuals that tell the week and the hour: 1 + week + hour / 1000
RECORD = jnp.asarray(1 + np.arange(2)[:, None, None] + np.arange(WEEK)[:, None] / 1000 + np.zeros(2), jnp.float32)


def recorded(hours: jax.Array, slot_seconds: float = HOUR) -> np.ndarray:
    """Residuals of twenty futures in four slots; their two sensors have one."""
    flow, futures = sensor_flow(slot_seconds, record=RECORD), 20
    sensed = draw(flow, hours)[:futures].astype(np.float64)
    mean = np.asarray(expected(replace(flow, record=None), hours), np.float64)
    level = np.log1p(sensed / flow.per_count) - np.log1p(mean / flow.per_count)[np.arange(futures) % len(hours)]
    np.testing.assert_allclose(level[..., 0], level[..., 1], atol=1e-4)
    return level[..., 0]


def test_futures_are_the_weeks_that_were_counted() -> None:
    # From Tuesday 6:00 on, hour 30.
    found = recorded(at(30, 30))[:, :3]
    weeks = [[1.030, 1.031, 1.032], [2.030, 2.031, 2.032]]
    which = (found[:, 0] > 2).astype(int)
    assert set(which) == {0, 1}
    np.testing.assert_allclose(found, np.array(weeks)[which], atol=2e-4)


def test_futures_between_the_middles_of_hours() -> None:
    # From 6:15 on in slots of half an hour: middles 6:30, 7:00, 7:30. From 6:00 on: 6:15, a quarter before hour 30.
    found = recorded(at(30.25, 30), HOUR / 2)[:, :3] % 1
    np.testing.assert_allclose(found[::2], [[0.030, 0.0305, 0.031]] * 10, atol=2e-4)
    np.testing.assert_allclose(found[1::2], [[0.02975, 0.03025, 0.03075]] * 10, atol=2e-4)


def test_after_a_recorded_week_comes_the_next() -> None:
    found = recorded(at(166, 166))
    for row in found:
        first = [1.166, 1.167, 2.0, 2.001]  # then the second week
        last = [2.166, 2.167, 1.0, 1.001]  # after the last the first again
        np.testing.assert_allclose(row, first if row[0] < 2 else last, atol=2e-4)


def test_recorded_weeks_are_uneven_too(uneven) -> None:
    # By .5, but do not differ as a whole beyond what was recorded: by the number of the week, and .3.
    record = jnp.broadcast_to(jnp.array([-0.3, 0.3])[:, None, None], (2, WEEK, 2))
    flow = replace(uneven, record=record)
    counts = np.asarray(draw(flow, ELEVEN), np.float64) + 1
    logs = np.log(counts) - 6
    # The same in all slots: nothing else varies within a week.
    np.testing.assert_allclose(logs - logs[:, :1], 0, atol=1e-4)
    variance = 0.5**2 + 0.3**2
    near(logs[:, 0].mean(axis=0), -0.125, math.sqrt(variance / MANY))
    # The fourth moment of a sum of these two: 3 * .5^4 + 6 * .5^2 * .3^2 + .3^4
    fourth = 3 * 0.5**4 + 6 * 0.5**2 * 0.3**2 + 0.3**4
    near(logs[:, 0].var(axis=0), variance, math.sqrt((fourth - variance**2) / MANY))
    # The week is the same one for both sensors, what differs from place to place is not.
    error = math.sqrt((variance**2 + 0.09**2) / MANY)
    near(np.cov(logs[:, 0].T)[0, 1], 0.09, error)
    # As many in the mean as without: exp(6) cosh(.3)
    near(counts[:, 0].mean(axis=0), math.exp(6) * math.cosh(0.3), counts[:, 0].std(axis=0) / math.sqrt(MANY))


# --- From the counts of now -----------------------------------------------------------------------------------------


def test_ahead_by_hand() -> None:
    # Hours 1 to 3 of Monday: usually 16, 64, 256 with one more. Now 32: twice as many. After an hour sqrt 2 times, then
    # 2^.25 times; and exp(.16 (1 - fading^2) / 2) = 1, exp(.06), exp(.075) for what may come:
    # 32, 64 * 1.4142136 * 1.0618365 = 96.10647, 256 * 1.1892071 * 1.0778842 = 328.14788; all less one.
    flow = sensor_flow(sigma=0.4)
    found = ahead(flow, 1, jnp.array([31.0, 0.495]), 0)
    assert found[:3, 0].tolist() == pytest.approx([31, 95.10647, 327.14788], rel=1e-4)
    # from a later slot on, hours 2 and 3: 128 are twice 64
    found = ahead(flow, 1, jnp.array([127.0, 0.495]), 1)
    assert found[:2, 0].tolist() == pytest.approx([127, 256 * 1.4142136 * 1.0618365 - 1], rel=1e-4)


def test_half_an_hour_forgets_less() -> None:
    # Sensor 1 always has 100 (with one more); now, at 1:15, 200. All slots have their middle a quarter or three
    # quarters between those of hours, where 1 - 2 * 3 / 16 / 2 = .8125 of the variance of .16 is left, .13. The
    # residual of 1:15 is 1/4 of that of 0:30 and 3/4 of that of 1:30. With that of 1:45, 3/4 of that of 1:30 and 1/4
    # of that of 2:30, it has in common (3/16 + 3/16) / 2 + 1/16 / 4 + 9/16 = .765625: 2^(.765625 / .8125) = 1.921600
    # times as many, and exp((.13 - .765625^2 / .8125 * .16) / 2) = 1.007310 for what may come. At 2:15, of 1/4 and
    # 3/4, (1/16 + 9/16) / 2 + 3/16 / 4 + 3/16 = .546875: 1.594470 and 1.036192 times. All less one.
    found = ahead(sensor_flow(HOUR / 2, sigma=0.4), 1, jnp.array([15.0, 0.995]), 0)
    assert found[:3, 1].tolist() == pytest.approx([0.995, 0.005 * 192.5647, 0.005 * 164.2178], rel=1e-4)


def test_ahead_is_the_mean_of_what_comes_after_such_counts(uneven) -> None:
    # Whatever is counted at 11:15 or 11:45, what comes later differs from the forecast by nothing in the mean, and as
    # much after high counts as after low ones.
    futures = jnp.asarray(draw(uneven, ELEVEN, jax.random.key(7)))
    for slot in (0, 1):
        told = np.asarray(jax.vmap(partial(ahead, uneven, 11.0), (0, None))(futures[:, slot], slot))
        later, forecast = np.asarray(futures, np.float64)[:, slot + 1 :], told[:, 1 : 4 - slot]
        miss = later / forecast - 1
        log_density_ratio = np.log(np.asarray(futures)[:, slot, None] / np.exp(6))
        for each in (miss, miss * log_density_ratio):
            near(each.mean(axis=0), 0, each.std(axis=0) / math.sqrt(MANY))


def test_ahead_a_part_of_what_was_not_expected_lasts() -> None:
    # As above, but weeks deviate by .3: variance .09 + .16 = .25, covariances .09 + .16 / 2^hours = .17 and .13. Now
    # twice as many; then 2^.68 = 1.602140 times, and exp((.25 - .17^2 / .25) / 2) = exp(.0672) = 1.069509 for what may
    # come; then 2^.52 = 1.433955 times, and exp((.25 - .13^2 / .25) / 2) = exp(.0912) = 1.095488:
    # 64 * 1.713503 = 109.66420 and 256 * 1.570881 = 402.14554, all less one.
    flow = sensor_flow(sigma=0.4, weekly=0.3)
    found = ahead(flow, 1, jnp.array([31.0, 0.495]), 0, slots=20)
    assert found[:3, 0].tolist() == pytest.approx([31, 108.66420, 401.14554], rel=1e-4)
    # In the end 2^.36 = 1.283426 times, .09 / .25, and exp((.25 - .09^2 / .25) / 2) = exp(.1088) = 1.114939.
    assert found[-1, 0] == pytest.approx(1024 * 1.283426 * 1.114939 - 1, rel=1e-4)


def test_ahead_where_demand_is_uneven() -> None:
    # By .4 beyond that: variance .41, covariance .33 an hour later. The median is .08 lower, in logarithms: the
    # surprise is log 2 + .08, of which .33 / .41 last, and (.41 - .33^2 / .41) / 2 is for what may come.
    flow = sensor_flow(sigma=0.4, weekly=0.3, uneven=0.4)
    found = ahead(flow, 1, jnp.array([31.0, 0.495]), 0)
    later = 6 * math.log(2) - 0.08 + 0.33 / 0.41 * (math.log(2) + 0.08) + (0.41 - 0.33**2 / 0.41) / 2
    assert found[:2, 0].tolist() == pytest.approx([31, math.expm1(later)], rel=1e-4)


def test_ahead_starts_now_and_fades_to_the_expected() -> None:
    flow = sensor_flow(sigma=0.4)
    now = jnp.array([0.0, 3.0])
    found = ahead(flow, 50.25, now, 1, slots=20)
    np.testing.assert_allclose(found[0], now, atol=1e-3)
    np.testing.assert_allclose(found[-5:], expected(flow, at(50.25, 0), slots=21)[0, -5:], rtol=1e-3)
