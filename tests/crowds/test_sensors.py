"""Usual weeks and their residuals: fitted to series that are known, by hand between the hours, and by statistics."""

import math
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.arima import SeriesError
from sidestep.crowds.base import FlowModel, SensedField
from sidestep.crowds.counts import CountsError, CountTable
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.crowds.sensors import FEWEST_HOURS, LEAST_DEVIATION, SensorFlow, SensorModel, fit_sensors, recorded_weeks

HOUR = 3600.0
WEEK = 168
MONDAY = np.datetime64("2024-01-01T00", "h")
KEY = jax.random.key(1)
MANY = 4_000


@partial(jax.jit, static_argnums=(2, 3))
def _draw(flow: SensorFlow, key: jax.Array, futures: int, slots: int) -> jax.Array:
    return flow.draw(key, futures, slots).sensed


def draw(flow: SensorFlow, key: jax.Array = KEY, futures: int = MANY, slots: int = 4) -> jax.Array:
    """As many crowds and slots in most tests, so that they share compiled programs."""
    return _draw(flow, key, futures, slots)


@partial(jax.jit, static_argnames="slots")
def expected(flow: SensorFlow, slots: int = 4) -> jax.Array:
    return flow.expected(slots).sensed


@partial(jax.jit, static_argnames="slots")
def ahead(flow: SensorFlow, now: jax.Array, slot: jax.Array, slots: int = 4, future: int = 0) -> jax.Array:
    return flow.ahead(now, slot, slots, future)


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
    # 0 and 8 persons in turn of weeks: log 1 and log 9, in the mean log 3; these are the quartiles as well. It is the
    # weeks that differ; their hours do not, and get the least deviation.
    counts = np.repeat([0.0, 8, 0, 8], WEEK)[:, None]
    model = fit_sensors(table(counts))
    np.testing.assert_allclose(model.usual, np.full((WEEK, 1), math.log(3)), rtol=1e-6)
    np.testing.assert_allclose(model.weekly, [math.log(9) / 1.349], rtol=1e-6)
    np.testing.assert_allclose(model.deviation, np.full((24, 1), LEAST_DEVIATION), rtol=1e-6)


def test_a_week_has_a_level_if_half_of_it_was_counted() -> None:
    # Logarithms of 0, 1, 2 and 3, and of 9 in the last week, of which some hours only were counted. Of all five weeks
    # quartiles are 1 and 3 (less what is usual); of the first four they are 0.75 and 2.25.
    for counted_hours, apart in ((84, 2.0), (83, 1.5)):
        logs = np.repeat([0.0, 1, 2, 3, 9], WEEK)[:, None]
        logs[4 * WEEK + counted_hours :] = np.nan
        assert fit_sensors(table(np.expm1(logs))).weekly[0] == pytest.approx(apart / 1.349, rel=1e-5)


def test_memory_ends_before_one_and_is_not_negative() -> None:
    # A sensor whose days go up by steps of one from -3 to 3 in a week and down again in the next: squares of
    # 24 * 28 = 672 a week, and six steps of one, so that neighbours have 672 - 3 and the memory would be .9955. One
    # whose residual changes its sign every hour (an even week, so by turns of weeks too).
    steps = np.repeat(np.tile([-3, -2, -1, 0, 1, 2, 3, 3, 2, 1, 0, -1, -2, -3], 100), 24)
    sign = (-1.0) ** (np.arange(200 * WEEK) + np.arange(200 * WEEK) // WEEK)
    model = fit_sensors(table(np.stack([np.expm1(5 + steps / 10), 10 + 5 * sign], axis=1)))
    assert model.memory.tolist() == pytest.approx([0.99, 0])


LONG = 600  # weeks
WEEKLY, NIGHT, NOON, REMEMBERED = 0.3, 0.4, 0.2, 0.7


@pytest.fixture(scope="module")
def nightly() -> np.ndarray:
    """Weeks that differ as a whole, and hours beyond that, in the first half of the day twice as much."""
    rng = np.random.default_rng(6)
    residual = [rng.standard_normal(LONG)]
    for innovation in rng.standard_normal((WEEK - 1, LONG)) * math.sqrt(1 - REMEMBERED**2):
        residual.append(REMEMBERED * residual[-1] + innovation)
    logs = USUAL[:, 0] + WEEKLY * rng.standard_normal(LONG)[:, None] + np.stack(residual, axis=1) * every_hour()
    return np.expm1(logs.reshape(-1, 1))


def every_hour() -> np.ndarray:
    return np.where(np.arange(WEEK) % 24 < 12, NIGHT, NOON)


def test_whole_weeks_and_hours_of_the_day_deviate(nightly) -> None:
    model = fit_sensors(table(nightly))
    hour = np.arange(WEEK)
    covariance = REMEMBERED ** abs(hour[:, None] - hour) * every_hour() * every_hour()[:, None]
    # The mean of a week's residuals is one of its difference: about (1 + .7) / (1 - .7) / 168 of the square of their
    # mean deviation, .09, adds to .3^2.
    mean = covariance.mean()
    assert mean == pytest.approx(0.09 * 1.7 / 0.3 / WEEK, rel=0.1)
    weekly = math.sqrt(WEEKLY**2 + mean)
    # Quartiles of n numbers tell a deviation but for 1.17 / sqrt n of it.
    near(model.weekly[0], weekly, 1.17 * weekly / math.sqrt(LONG))
    # What is left does not have this mean any more.
    left = covariance - covariance.mean(axis=0) - covariance.mean(axis=1)[:, None] + mean
    deviation = np.sqrt(np.diag(left).reshape(7, 24).mean(axis=0))
    assert deviation == pytest.approx(every_hour()[:24], rel=0.06)
    near(model.deviation[:, 0], deviation, 1.17 * deviation / math.sqrt(7 * LONG))
    # Neighbours, but not of two weeks, in units of their deviations
    units = left / np.tile(deviation, 7) / np.tile(deviation, 7)[:, None]
    memory = np.diag(units, 1).sum() / np.trace(units)
    assert memory == pytest.approx(REMEMBERED, abs=0.02)
    near(model.memory[0], memory, math.sqrt((1 - memory**2) / WEEK / LONG))


def test_a_broken_sensor_hardly_changes_how_much_counts_vary(nightly) -> None:
    # Nothing for three of three hundred weeks, from a Thursday on: two whole ones and two halves. Squares would make
    # it sqrt(.3^2 + (2 * 5^2 + 2 * 2.5^2) / 300) = .55 for weeks; of quartiles it is a hundredth of the ranks.
    counts = nightly[: 300 * WEEK].copy()
    whole = fit_sensors(table(counts))
    counts[40 * WEEK + 84 : 43 * WEEK + 84] = 0
    broken = fit_sensors(table(counts))
    np.testing.assert_allclose(broken.weekly, whole.weekly, rtol=0.07)
    np.testing.assert_allclose(broken.deviation, whole.deviation, rtol=0.07)
    # The hours of these halves are 2.5 below the mean of their week or above it: by more than four deviations, and
    # taken for as many. They are a 150th of all and add 16 / 150 = .11 squares to 1, all remembered:
    # (.68 + .11) / 1.11 = .71; with what they are, ten deviations of 1/4, it would be (.68 + .67) / 1.67 = .81.
    np.testing.assert_allclose(broken.memory, whole.memory, atol=0.06)


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
ALL_EARS = InterpolationWeights(jnp.array([[0, 1]]), jnp.array([[0.5, 0.5]]))


def sensor_flow(
    start: list[float], slot_seconds: float = HOUR / 2, deviation: float = 0.0, weekly: float = 0.0, **changes
) -> SensorFlow:
    usual = jnp.asarray(np.stack([np.tile(DAY, 7), np.full(WEEK, math.log(100))], axis=1), jnp.float32)
    model = SensorModel(usual, jnp.full(2, weekly), jnp.full((24, 2), deviation), jnp.array([0.5, 0.5]), jnp.eye(2))
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
    for future in range(4):
        np.testing.assert_allclose(ahead(flow, drawn[future, 0], 0, future=future), usual[future % 2], rtol=1e-4)


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


# Weeks deviate by .3, hours by .2 from noon to midnight and .4 before, and demand by .5 from place to place.
LASTING = 0.3**2 + 0.5**2


@pytest.fixture(scope="module")
def uneven() -> SensorFlow:
    """From 11:00 on in slots of half an hour, whose middles are a quarter and three quarters past."""
    deviation = jnp.where(jnp.arange(24)[:, None] < 12, 0.4, 0.2) * jnp.ones(2)
    model = replace(flat(6.0, 2), weekly=jnp.full(2, 0.3), deviation=deviation)
    return SensorFlow(model, ALL_EARS, jnp.ones(2), jnp.full(2, 11.0), HOUR / 2, uneven=0.5)


def test_what_lasts_is_drawn_once_for_each_crowd(uneven) -> None:
    logs = np.log1p(np.asarray(draw(uneven), np.float64))  # 11:15, 11:45, 12:15, 12:45
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
    found, mean = np.asarray(draw(uneven), np.float64), np.asarray(expected(uneven))[0]
    near(found.mean(axis=0), mean, found.std(axis=0) / math.sqrt(MANY))
    np.testing.assert_allclose(mean, expected(replace(uneven, uneven=0.0))[0], rtol=1e-5)
    # .09 of weeks, and .8125 of .4^2 at 11:15
    assert mean[0, 0] == pytest.approx(math.expm1(6 + (0.09 + 0.13) / 2), rel=1e-4)


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
    flow, futures = sensor_flow(start, slot_seconds, record=RECORD), 20
    sensed = np.asarray(draw(flow, futures=futures), np.float64)
    usual = np.asarray(expected(replace(flow, record=None)), np.float64)
    level = np.log1p(sensed / flow.per_count) - np.log1p(usual / flow.per_count)[np.arange(futures) % len(start)]
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


def test_recorded_weeks_are_uneven_too(uneven) -> None:
    # By .5, but do not differ as a whole beyond what was recorded: by the number of the week, and .3.
    record = jnp.broadcast_to(jnp.array([-0.3, 0.3])[:, None, None], (2, WEEK, 2))
    flow = replace(uneven, record=record)
    counts = np.asarray(draw(flow), np.float64) + 1
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
    flow = sensor_flow([1.0, 50.0], HOUR, deviation=0.4)
    found = ahead(flow, jnp.array([31.0, 0.495]), 0)
    assert found[:3, 0].tolist() == pytest.approx([31, 95.10647, 327.14788], rel=1e-4)
    # from a later slot on, hours 2 and 3: 128 are twice 64
    found = ahead(flow, jnp.array([127.0, 0.495]), 1)
    assert found[:2, 0].tolist() == pytest.approx([127, 256 * 1.4142136 * 1.0618365 - 1], rel=1e-4)


def test_half_an_hour_forgets_less() -> None:
    # Sensor 1 always has 100 (with one more); now, at 1:15, 200. All slots have their middle a quarter or three
    # quarters between those of hours, where 1 - 2 * 3 / 16 / 2 = .8125 of the variance of .16 is left, .13. The
    # residual of 1:15 is 1/4 of that of 0:30 and 3/4 of that of 1:30. With that of 1:45, 3/4 of that of 1:30 and 1/4
    # of that of 2:30, it has in common (3/16 + 3/16) / 2 + 1/16 / 4 + 9/16 = .765625: 2^(.765625 / .8125) = 1.921600
    # times as many, and exp((.13 - .765625^2 / .8125 * .16) / 2) = 1.007310 for what may come. At 2:15, of 1/4 and
    # 3/4, (1/16 + 9/16) / 2 + 3/16 / 4 + 3/16 = .546875: 1.594470 and 1.036192 times. All less one.
    found = ahead(sensor_flow([1.0, 1.0], deviation=0.4), jnp.array([15.0, 0.995]), 0)
    assert found[:3, 1].tolist() == pytest.approx([0.995, 0.005 * 192.5647, 0.005 * 164.2178], rel=1e-4)


def test_ahead_is_the_mean_of_what_comes_after_such_counts(uneven) -> None:
    # Whatever is counted at 11:15 or 11:45, what comes later differs from the forecast by nothing in the mean, and as
    # much after high counts as after low ones.
    futures = jnp.asarray(draw(uneven, jax.random.key(7)))
    for slot in (0, 1):
        told = np.asarray(jax.vmap(partial(ahead, uneven, slots=4), (0, None))(futures[:, slot], jnp.int32(slot)))
        later, forecast = np.asarray(futures, np.float64)[:, slot + 1 :], told[:, 1 : 4 - slot]
        miss = later / forecast - 1
        log_density_ratio = np.log(np.asarray(futures)[:, slot, None] / np.exp(6))
        for each in (miss, miss * log_density_ratio):
            near(each.mean(axis=0), 0, each.std(axis=0) / math.sqrt(MANY))


def test_ahead_a_part_of_the_surprise_lasts() -> None:
    # As above, but weeks deviate by .3: variance .09 + .16 = .25, covariances .09 + .16 / 2^hours = .17 and .13. Now
    # twice as many; then 2^.68 = 1.602140 times, and exp((.25 - .17^2 / .25) / 2) = exp(.0672) = 1.069509 for what may
    # come; then 2^.52 = 1.433955 times, and exp((.25 - .13^2 / .25) / 2) = exp(.0912) = 1.095488:
    # 64 * 1.713503 = 109.66420 and 256 * 1.570881 = 402.14554, all less one.
    flow = sensor_flow([1.0, 50.0], HOUR, deviation=0.4, weekly=0.3)
    found = ahead(flow, jnp.array([31.0, 0.495]), 0, slots=20)
    assert found[:3, 0].tolist() == pytest.approx([31, 108.66420, 401.14554], rel=1e-4)
    # In the end 2^.36 = 1.283426 times, .09 / .25, and exp((.25 - .09^2 / .25) / 2) = exp(.1088) = 1.114939.
    assert found[-1, 0] == pytest.approx(1024 * 1.283426 * 1.114939 - 1, rel=1e-4)


def test_ahead_where_demand_is_uneven() -> None:
    # By .4 beyond that: variance .41, covariance .33 an hour later. The median is .08 lower, in logarithms: the
    # surprise is log 2 + .08, of which .33 / .41 last, and (.41 - .33^2 / .41) / 2 is for what may come.
    flow = sensor_flow([1.0, 50.0], HOUR, deviation=0.4, weekly=0.3, uneven=0.4)
    found = ahead(flow, jnp.array([31.0, 0.495]), 0)
    later = 6 * math.log(2) - 0.08 + 0.33 / 0.41 * (math.log(2) + 0.08) + (0.41 - 0.33**2 / 0.41) / 2
    assert found[:2, 0].tolist() == pytest.approx([31, math.expm1(later)], rel=1e-4)


def test_ahead_starts_now_and_fades_to_the_expected() -> None:
    flow = sensor_flow([50.25, 0.0], HOUR, deviation=0.4)
    now = jnp.array([0.0, 3.0])
    found = ahead(flow, now, 1, slots=20)
    np.testing.assert_allclose(found[0], now, atol=1e-3)
    np.testing.assert_allclose(found[-5:], expected(flow, slots=21)[0, -5:], rtol=1e-3)
