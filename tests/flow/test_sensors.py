"""Usual weeks and their residuals: fitted to series that are known, by hand between the hours, and by statistics."""

import math
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.flow.arima import SeriesError
from sidestep.flow.counts import CountsError, CountTable
from sidestep.flow.field import FlowModel, SensedField
from sidestep.flow.sensors import FEWEST_HOURS, SensorFlow, SensorModel, fit_sensors, recorded_weeks
from sidestep.network.spread import Spread

HOUR = 3600.0
WEEK = 168
MONDAY = np.datetime64("2024-01-01T00", "h")
KEY = jax.random.key(1)
MANY = 4_000


@partial(jax.jit, static_argnums=(2, 3))
def _draw(flow: SensorFlow, key: jax.Array, crowds: int, slots: int) -> jax.Array:
    return flow.draw(key, crowds, slots).sensed


def draw(flow: SensorFlow, key: jax.Array = KEY, crowds: int = MANY, slots: int = 4) -> jax.Array:
    """As many crowds and slots in most tests, so that they share compiled programs."""
    return _draw(flow, key, crowds, slots)


@partial(jax.jit, static_argnames="slots")
def expected(flow: SensorFlow, slots: int = 4) -> jax.Array:
    return flow.expected(slots).sensed


@partial(jax.jit, static_argnames="slots")
def ahead(flow: SensorFlow, now: jax.Array, slot: jax.Array, slots: int = 4, crowd: int = 0) -> jax.Array:
    return flow.ahead(now, slot, slots, crowd)


def near(found: np.ndarray, expected: float | np.ndarray, error: float | np.ndarray) -> None:
    """Within five standard errors."""
    assert (np.abs(np.asarray(found) - expected) < 5 * np.asarray(error)).all()


def table(counts: np.ndarray, start: np.datetime64 = MONDAY) -> CountTable:
    counts = np.array(counts, np.float64)  # tables make what they hold read-only
    names = tuple("abc"[: counts.shape[1]])
    return CountTable(start + np.arange(len(counts)), names, counts, None, (), "made up")


# --- Fitting --------------------------------------------------------------------------------------------------------

WEEKS = 100
HOURS = WEEKS * WEEK
USUAL = np.stack([5 + np.sin(np.arange(WEEK) / 24), 4 + np.arange(WEEK) % 24 / 24, np.full(WEEK, 6.0)], axis=1)
MEMORY, DEVIATION = np.array([0.8, 0.3, 0.6]), np.array([0.4, 0.2, 0.3])
TOGETHER = np.array([[1, 0.6, 0], [0.6, 1, -0.3], [0, -0.3, 1]])


@pytest.fixture(scope="module")
def counted() -> np.ndarray:
    """Hourly counts of three sensors with these usual weeks and residuals, from a Monday on."""
    rng = np.random.default_rng(3)
    innovation = rng.multivariate_normal(np.zeros(3), TOGETHER, HOURS) * DEVIATION * np.sqrt(1 - MEMORY**2)
    residual = np.zeros((HOURS, 3))
    residual[0] = innovation[0]
    for hour in range(1, HOURS):
        residual[hour] = MEMORY * residual[hour - 1] + innovation[hour]
    return np.expm1(np.tile(USUAL, (WEEKS, 1)) + residual)


def fits(model: SensorModel, share: float = 1.0) -> None:
    """As the series were made, within five standard errors; ``share`` of the hours were counted."""
    # A mean of a hundred hours a week apart, and numbers of all hours; hours that follow each other tell less.
    near(np.asarray(model.usual), USUAL, DEVIATION / math.sqrt(WEEKS * share))
    apart = np.sqrt((1 + MEMORY**2) / (1 - MEMORY**2) / 2 / HOURS / share)
    # Quartiles tell a deviation with 1.65 times the error of squares.
    near(np.asarray(model.deviation).mean(axis=0), DEVIATION, 1.65 * DEVIATION * apart + DEVIATION / WEEKS / 5)
    near(np.asarray(model.memory), MEMORY, np.sqrt((1 - MEMORY**2) / HOURS) / share)
    near(np.asarray(model.together @ model.together.T), TOGETHER, 1 / math.sqrt(HOURS) / share)


def test_what_series_were_made_of_is_found(counted) -> None:
    fits(fit_sensors(table(counted)))


def test_missing_hours_do_not_matter(counted) -> None:
    holes = np.where(np.random.default_rng(4).uniform(size=counted.shape) < 0.2, np.nan, counted)
    fits(fit_sensors(table(holes)), share=0.8)


def test_some_sensors_in_another_order(counted) -> None:
    every, some = fit_sensors(table(counted)), fit_sensors(table(counted), ["c", "a"])
    np.testing.assert_allclose(some.usual, every.usual[:, jnp.array([2, 0])], rtol=1e-6)
    assert some.memory.tolist() == pytest.approx(every.memory[jnp.array([2, 0])].tolist())
    assert some.together.shape == (2, 2)


def test_the_hours_of_the_week_are_those_of_the_wall_clock(counted) -> None:
    # From the 30th hour on it is Tuesday 6:00.
    later = fit_sensors(table(counted[30:], MONDAY + 30))
    near(np.asarray(later.usual), USUAL, DEVIATION / math.sqrt(WEEKS - 1))


def test_a_usual_week_is_the_mean_of_logarithms() -> None:
    # 0 and 8 persons in turn of weeks: log 1 and log 9, in the mean log 3; these are the quartiles as well.
    counts = np.repeat([0.0, 8, 0, 8], WEEK)[:, None]
    model = fit_sensors(table(counts))
    np.testing.assert_allclose(model.usual, np.full((WEEK, 1), math.log(3)), rtol=1e-6)
    np.testing.assert_allclose(model.deviation, np.full((24, 1), math.log(9) / 1.349), rtol=1e-6)


def test_memory_ends_before_one_and_is_not_negative() -> None:
    # A sensor that jumps once; one whose residual changes its sign every hour (an even week, so by turns of weeks too).
    jump = np.repeat([0.0, 8], 100 * WEEK)
    sign = (-1.0) ** (np.arange(200 * WEEK) + np.arange(200 * WEEK) // WEEK)
    model = fit_sensors(table(np.stack([jump, 10 + 5 * sign], axis=1)))
    assert model.memory.tolist() == pytest.approx([0.99, 0])


def test_sensors_that_always_count_alike_can_be_drawn_together(counted) -> None:
    model = fit_sensors(table(counted[:, [0, 0]]))
    factor = np.asarray(model.together)
    assert np.isfinite(factor).all()
    np.testing.assert_allclose(factor @ factor.T, 1, atol=1e-5)


def test_too_few_counts(counted) -> None:
    assert FEWEST_HOURS == 672
    few = counted[:900].copy()
    few[671:, 1] = np.nan
    with pytest.raises(SeriesError, match="made up: sensor 'b' has 671 counted hours; a usual week takes 672"):
        fit_sensors(table(few))
    few[671, 1] = 7
    fit_sensors(table(few))


def test_an_hour_of_the_week_that_was_never_counted(counted) -> None:
    never = counted.copy()
    never[50::WEEK, 2] = np.nan
    with pytest.raises(SeriesError, match="sensor 'c' has no count in some hours of the week"):
        fit_sensors(table(never))
    fit_sensors(table(never), ["a", "b"])


def test_an_unknown_sensor(counted) -> None:
    with pytest.raises(CountsError, match="no sensor 'd'"):
        fit_sensors(table(counted), ["d"])


# --- Whole weeks ----------------------------------------------------------------------------------------------------


def flat(level: float, sensors: int = 1) -> SensorModel:
    """The same level in every hour."""
    ones = jnp.ones(sensors)
    return SensorModel(jnp.full((WEEK, sensors), level), 0.0 * ones, all_day(0.3 * ones), 0.5 * ones, jnp.eye(sensors))


def all_day(deviation: jax.Array) -> jax.Array:
    """The same deviations in every hour of the day."""
    return jnp.tile(deviation, (24, 1))


def test_whole_weeks_begin_on_monday() -> None:
    # From Sunday 20:00 on: four hours, two weeks, and five hours more.
    counts = np.expm1(2 + np.arange(4 + 2 * WEEK + 5) / 1000)[:, None]
    weeks = recorded_weeks(flat(2.0), table(counts, MONDAY - 4), ["a"])
    assert weeks.shape == (2, WEEK, 1)
    np.testing.assert_allclose(weeks.ravel(), np.arange(4, 4 + 2 * WEEK) / 1000, atol=1e-6)


def test_missing_hours_are_bridged() -> None:
    counts = np.full((2 * WEEK, 2), math.expm1(2.0))
    counts[[9, 12], 0] = np.expm1([2.1, 2.4])
    counts[10:12, 0] = np.nan  # between residuals of .1 and .4
    counts[:3, 1] = np.nan  # before the first, which is .5
    counts[3, 1] = np.expm1(2.5)
    weeks = recorded_weeks(flat(2.0, 2), table(counts), ["a", "b"])
    np.testing.assert_allclose(weeks[0, 8:14, 0], [0, 0.1, 0.2, 0.3, 0.4, 0], atol=1e-6)
    np.testing.assert_allclose(weeks[0, :5, 1], [0.5, 0.5, 0.5, 0.5, 0], atol=1e-6)


def test_it_is_the_residual_that_is_bridged() -> None:
    # Usually log levels of 1, 5, 3 in the first hours: twice as many before and after are twice as many in between.
    usual = np.full((WEEK, 1), 2.0)
    usual[:3, 0] = [1, 5, 3]
    counts = np.tile(np.expm1(usual + math.log(2)), (2, 1))
    counts[1] = np.nan
    weeks = recorded_weeks(replace(flat(2.0), usual=jnp.asarray(usual)), table(counts), ["a"])
    np.testing.assert_allclose(weeks, math.log(2), rtol=1e-5)


def test_too_few_weeks() -> None:
    counts = np.ones((2 * WEEK + 3, 1))
    # It begins on Monday at 1:00, so the first whole week begins a week later.
    with pytest.raises(SeriesError, match="two whole weeks of counts or more, not on 1"):
        recorded_weeks(flat(2.0), table(counts, MONDAY + 1), ["a"])
    with pytest.raises(SeriesError, match="not on 0"):
        recorded_weeks(flat(2.0), table(counts[:100], MONDAY + 1), ["a"])


def test_weeks_in_which_a_sensor_was_dead() -> None:
    counts = np.ones((2 * WEEK + 5, 2))
    counts[: 2 * WEEK, 1] = np.nan  # it counts again after the last whole week
    with pytest.raises(SeriesError, match="sensor 'b' counted nothing in the weeks to test on"):
        recorded_weeks(flat(2.0, 2), table(counts), ["a", "b"])


# --- From hours of the week to slots --------------------------------------------------------------------------------

# Sensor 0 usually counts 3, 15, 63, 255 persons in the hours 0 to 3 of each day and 1,023 in all others, logarithms
# (of one more) of 2, 4, 6, 8 and 10 times log 2; sensor 1 always 99, and stands where 200 count as one per m².
DAY = np.array([2, 4, 6, 8] + [10] * 20) * math.log(2)
ALL_EARS = Spread(jnp.array([[0, 1]]), jnp.array([[0.5, 0.5]]))


def sensor_flow(start: list[float], slot_seconds: float = HOUR / 2, deviation: float = 0.0, **changes) -> SensorFlow:
    usual = jnp.asarray(np.stack([np.tile(DAY, 7), np.full(WEEK, math.log(100))], axis=1), jnp.float32)
    model = SensorModel(usual, jnp.zeros(2), jnp.full((24, 2), deviation), jnp.array([0.5, 0.5]), jnp.eye(2))
    flow = SensorFlow(model, ALL_EARS, jnp.array([1.0, 0.005]), jnp.array(start, float), slot_seconds)
    return replace(flow, **changes)


def test_usual_counts_are_those_of_the_middles_of_hours() -> None:
    # Slots of an hour from Monday 0:00 on have the middles of hours as theirs.
    flow = sensor_flow([0.0, 24.0], HOUR)
    found = np.asarray(expected(flow))
    assert found.shape == (2, 4, 2)
    np.testing.assert_allclose(found, [[[count, 0.495] for count in (3, 15, 63, 255)]] * 2, rtol=1e-4)


def test_between_the_middles_logarithms_are_linear() -> None:
    # Slots of half an hour. From Monday 1:15 their middles are 1:30, 2:00, 2:30: 4, 5 and 6 log 2.
    # From Monday 1:00 they are 1:15, 1:45, 2:15: 3.5, 4.5 and 5.5 log 2: 11.3137, 22.6274, 45.2548, less one.
    found = np.asarray(expected(sensor_flow([1.25, 1.0])))[:, :3, 0]
    np.testing.assert_allclose(found[0], [15, 31, 63], rtol=1e-5)
    np.testing.assert_allclose(found[1], [10.3137, 21.6274, 44.2548], rtol=1e-5)


def test_sunday_night_goes_on_into_monday() -> None:
    # Middles from Sunday 23:45 on: Monday 0:00, 0:30, 1:00, between 10 and 2, then 2, then 3 log 2. From Monday 0:00
    # on: 0:15, a quarter before the middle of the first hour, 4 log 2; then 0:45, 2.5 log 2, and 1:15, 3.5 log 2.
    found = np.asarray(expected(sensor_flow([167.75, 0.0])))[:, :3, 0]
    np.testing.assert_allclose(found, [[63, 3, 7], [15, 4.65685, 10.3137]], rtol=2e-4)


def test_the_mean_is_above_the_median() -> None:
    # Of log-normal counts, by exp(.4^2 / 2) = 1.083287: 4 and 100 times that, less one; the second by .005
    found = expected(sensor_flow([0.0, 24.0], HOUR, deviation=0.4))[0, 0]
    assert found.tolist() == pytest.approx([3.333148, 0.536644], rel=1e-5)


def test_nobody_is_the_least() -> None:
    # log(1 + count) may come out below 0 where few are counted.
    flow = replace(sensor_flow([0.0, 0.0], HOUR), model=flat(0.1, 2))
    sensed = np.asarray(draw(flow))
    # Residuals are below -.1, a third of their deviation, in 37 % of the hours.
    assert sensed.min() == 0
    assert (sensed == 0).mean() == pytest.approx(0.3694, abs=0.02)


def test_crowding_multiplies_all_densities() -> None:
    flow = sensor_flow([1.25, 100.0], HOUR, deviation=0.4)
    more = replace(flow, per_count=100 * flow.per_count)
    np.testing.assert_allclose(expected(more), 100 * expected(flow), rtol=1e-5)
    np.testing.assert_allclose(draw(more), 100 * draw(flow), rtol=1e-5)
    now = jnp.array([20.0, 0.7])
    np.testing.assert_allclose(ahead(more, 100 * now, 2), 100 * ahead(flow, now, 2), rtol=1e-4)


def test_crowds_take_the_hours_in_turn() -> None:
    # Without deviation a draw is as usual: crowds 0, 2 and 4 from Monday 1:15 on, 1 and 3 from Wednesday noon.
    flow = sensor_flow([1.25, 60.0], HOUR)
    drawn, usual = np.asarray(draw(flow)), np.asarray(expected(flow))
    assert (usual[0] != usual[1]).any()
    np.testing.assert_allclose(drawn[:5], usual[[0, 1, 0, 1, 0]], rtol=1e-4)
    for crowd in range(4):
        np.testing.assert_allclose(ahead(flow, drawn[crowd, 0], 0, crowd=crowd), usual[crowd % 2], rtol=1e-4)


def test_it_is_a_flow_model() -> None:
    flow = sensor_flow([0.0])
    assert isinstance(flow, FlowModel)
    field = jax.eval_shape(lambda: flow.draw(KEY, 5, 3))
    assert isinstance(field, SensedField)
    assert (field.sensed.shape, field.slot_seconds) == ((5, 3, 2), HOUR / 2)


# --- What is drawn --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drawn() -> np.ndarray:
    """Residuals of two sensors with memories of .9 and .5, whose innovations have a correlation of .6."""
    model = replace(
        flat(6.0, 2),
        memory=jnp.array([0.9, 0.5]),
        deviation=all_day(jnp.array([0.4, 0.2])),
        together=jnp.linalg.cholesky(jnp.array([[1, 0.6], [0.6, 1]])),
    )
    flow = SensorFlow(model, ALL_EARS, jnp.ones(2), jnp.zeros(2), HOUR)
    return np.log1p(np.asarray(draw(flow, slots=12), np.float64)) - 6


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
    flow = sensor_flow([1.0, 25.0], HOUR, deviation=0.4)
    found = np.asarray(draw(flow), np.float64)
    near(found.mean(axis=0), np.asarray(expected(flow))[0], found.std(axis=0) / math.sqrt(MANY))


def test_the_same_key_draws_the_same() -> None:
    flow = sensor_flow([1.25, 2.0], HOUR, deviation=0.4)
    first, again, other = (np.asarray(draw(flow, key)) for key in (KEY, KEY, jax.random.key(2)))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.99


# --- Recorded weeks -------------------------------------------------------------------------------------------------

# Residuals that tell the week and the hour: 1 + week + hour / 1000
RECORD = jnp.asarray(1 + np.arange(2)[:, None, None] + np.arange(WEEK)[:, None] / 1000 + np.zeros(2), jnp.float32)


def recorded(start: list[float], slot_seconds: float = HOUR) -> np.ndarray:
    """Residuals of twenty crowds in four slots; their two sensors have one."""
    flow, crowds = sensor_flow(start, slot_seconds, record=RECORD), 20
    sensed = np.asarray(draw(flow, crowds=crowds), np.float64)
    usual = np.asarray(expected(replace(flow, record=None)), np.float64)
    level = np.log1p(sensed / flow.per_count) - np.log1p(usual / flow.per_count)[np.arange(crowds) % len(start)]
    np.testing.assert_allclose(level[..., 0], level[..., 1], atol=1e-4)
    return level[..., 0]


def test_futures_are_the_weeks_that_were_counted() -> None:
    # From Tuesday 6:00 on, hour 30.
    found = recorded([30.0, 30.0])[:, :3]
    weeks = [[1.030, 1.031, 1.032], [2.030, 2.031, 2.032]]
    which = (found[:, 0] > 2).astype(int)
    assert set(which) == {0, 1}
    np.testing.assert_allclose(found, np.array(weeks)[which], atol=2e-4)


def test_futures_between_the_middles_of_hours() -> None:
    # From 6:15 on in slots of half an hour: middles 6:30, 7:00, 7:30. From 6:00 on: 6:15, a quarter before hour 30.
    found = recorded([30.25, 30.0], HOUR / 2)[:, :3] % 1
    np.testing.assert_allclose(found[::2], [[0.030, 0.0305, 0.031]] * 10, atol=2e-4)
    np.testing.assert_allclose(found[1::2], [[0.02975, 0.03025, 0.03075]] * 10, atol=2e-4)


def test_after_a_recorded_week_comes_the_next() -> None:
    found = recorded([166.0, 166.0])
    for row in found:
        first = [1.166, 1.167, 2.0, 2.001]  # then the second week
        last = [2.166, 2.167, 1.0, 1.001]  # after the last the first again
        np.testing.assert_allclose(row, first if row[0] < 2 else last, atol=2e-4)


# --- From the counts of now -----------------------------------------------------------------------------------------


def test_ahead_by_hand() -> None:
    # Hours 1 to 3 of Monday: usually 16, 64, 256 with one more. Now 32: twice as many. After an hour sqrt 2 times, then
    # 2^.25 times; and exp(.16 (1 - fading^2) / 2) = 1, exp(.06), exp(.075) for what may come:
    # 32, 64 * 1.4142136 * 1.0618365 = 96.10647, 256 * 1.1892071 * 1.0778842 = 328.14788; all less one.
    flow = sensor_flow([1.0, 50.0], HOUR, deviation=0.4)
    found = ahead(flow, jnp.array([31.0, 0.495]), 0)
    assert found[:3, 0].tolist() == pytest.approx([31, 95.10647, 327.14788], rel=1e-4)
    # from a later slot on, hours 2 and 3: 128 are twice 64
    found = ahead(flow, jnp.array([127.0, 0.495]), 1)
    assert found[:2, 0].tolist() == pytest.approx([127, 256 * 1.4142136 * 1.0618365 - 1], rel=1e-4)


def test_half_an_hour_forgets_less() -> None:
    # Sensor 1 always has 100 (with one more); now 200. Half an hour later 2^(sqrt .5) = 1.632527 times as many.
    found = ahead(sensor_flow([1.0, 1.0]), jnp.array([15.0, 0.995]), 0)
    assert found[:3, 1].tolist() == pytest.approx([0.995, 0.005 * 162.2527, 0.005 * 140.42136], rel=1e-4)


def test_ahead_starts_now_and_fades_to_the_expected() -> None:
    flow = sensor_flow([50.25, 0.0], HOUR, deviation=0.4)
    now = jnp.array([0.0, 3.0])
    found = ahead(flow, now, 1, slots=20)
    np.testing.assert_allclose(found[0], now, atol=1e-3)
    np.testing.assert_allclose(found[-5:], expected(flow, slots=21)[0, -5:], rtol=1e-3)
