"""Expected weeks and residuals, fitted to made-up series; whole weeks of a record."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.arima import SeriesError
from sidestep.crowds.counts import CountsError, CountTable
from sidestep.crowds.sensor_model import FEWEST_HOURS, SMALLEST_SIGMA, SensorModel, fit_sensors, recorded_weeks

WEEK = 168
MONDAY = np.datetime64("2024-01-01T00", "h")


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
EXPECTED = np.stack([5 + np.sin(np.arange(WEEK) / 24), 4 + np.arange(WEEK) % 24 / 24, np.full(WEEK, 6.0)], axis=1)
PHI, SIGMA = np.array([0.8, 0.3, 0.6]), np.array([0.4, 0.2, 0.3])
CORRELATION = np.array([[1, 0.6, 0], [0.6, 1, -0.3], [0, -0.3, 1]])


@pytest.fixture(scope="module")
def counted() -> np.ndarray:
    """Hourly counts of three sensors with these usual weeks and residuals, from a Monday on."""
    rng = np.random.default_rng(3)
    innovation = rng.multivariate_normal(np.zeros(3), CORRELATION, HOURS) * SIGMA * np.sqrt(1 - PHI**2)
    residual = np.zeros((HOURS, 3))
    residual[0] = innovation[0]
    for hour in range(1, HOURS):
        residual[hour] = PHI * residual[hour - 1] + innovation[hour]
    return np.expm1(np.tile(EXPECTED, (WEEKS, 1)) + residual)


def fits(model: SensorModel, share: float = 1.0) -> None:
    """As the series were made, within five standard errors; ``share`` of the hours were counted."""
    # A mean of a hundred hours a week apart, and numbers of all hours; hours that follow each other tell less.
    near(np.asarray(model.expected), EXPECTED, SIGMA / math.sqrt(WEEKS * share))
    apart = np.sqrt((1 + PHI**2) / (1 - PHI**2) / 2 / HOURS / share)
    # Quartiles tell a deviation with 1.65 times the error of squares.
    near(np.asarray(model.sigma).mean(axis=0), SIGMA, 1.65 * SIGMA * apart + SIGMA / WEEKS / 5)
    near(np.asarray(model.phi), PHI, np.sqrt((1 - PHI**2) / HOURS) / share)
    near(np.asarray(model.cholesky @ model.cholesky.T), CORRELATION, 1 / math.sqrt(HOURS) / share)


def test_what_series_were_made_of_is_found(counted) -> None:
    fits(fit_sensors(table(counted)))


def test_missing_hours_do_not_matter(counted) -> None:
    holes = np.where(np.random.default_rng(4).uniform(size=counted.shape) < 0.2, np.nan, counted)
    fits(fit_sensors(table(holes)), share=0.8)


def test_some_sensors_in_another_order(counted) -> None:
    every, some = fit_sensors(table(counted)), fit_sensors(table(counted), ["c", "a"])
    np.testing.assert_allclose(some.expected, every.expected[:, jnp.array([2, 0])], rtol=1e-6)
    assert some.phi.tolist() == pytest.approx(every.phi[jnp.array([2, 0])].tolist())
    assert some.cholesky.shape == (2, 2)


def test_the_hours_of_the_week_are_those_of_the_wall_clock(counted) -> None:
    # From the 30th hour on it is Tuesday 6:00.
    later = fit_sensors(table(counted[30:], MONDAY + 30))
    near(np.asarray(later.expected), EXPECTED, SIGMA / math.sqrt(WEEKS - 1))


def test_an_expected_week_is_the_mean_of_logarithms() -> None:
    # 0 and 8 persons in turn of weeks: log 1 and log 9, in the mean log 3; these are the quartiles as well. It is the
    # weeks that differ; their hours do not, and get the least deviation.
    counts = np.repeat([0.0, 8, 0, 8], WEEK)[:, None]
    model = fit_sensors(table(counts))
    np.testing.assert_allclose(model.expected, np.full((WEEK, 1), math.log(3)), rtol=1e-6)
    np.testing.assert_allclose(model.weekly, [math.log(9) / 1.349], rtol=1e-6)
    np.testing.assert_allclose(model.sigma, np.full((24, 1), SMALLEST_SIGMA), rtol=1e-6)


def test_a_week_has_a_level_if_half_of_it_was_counted() -> None:
    # Logarithms of 0, 1, 2 and 3, and of 9 in the last week, of which some hours only were counted. Of all five weeks
    # quartiles are 1 and 3 (less what is usual); of the first four they are 0.75 and 2.25.
    for counted_hours, apart in ((84, 2.0), (83, 1.5)):
        logs = np.repeat([0.0, 1, 2, 3, 9], WEEK)[:, None]
        logs[4 * WEEK + counted_hours :] = np.nan
        assert fit_sensors(table(np.expm1(logs))).weekly[0] == pytest.approx(apart / 1.349, rel=1e-5)


def test_the_coefficient_ends_before_one_and_is_not_negative() -> None:
    # A sensor whose days go up by steps of one from -3 to 3 in a week and down again in the next: squares of
    # 24 * 28 = 672 a week, and six steps of one, so that neighbours have 672 - 3 and the memory would be .9955. One
    # whose residual changes its sign every hour (an even week, so by turns of weeks too).
    steps = np.repeat(np.tile([-3, -2, -1, 0, 1, 2, 3, 3, 2, 1, 0, -1, -2, -3], 100), 24)
    sign = (-1.0) ** (np.arange(200 * WEEK) + np.arange(200 * WEEK) // WEEK)
    model = fit_sensors(table(np.stack([np.expm1(5 + steps / 10), 10 + 5 * sign], axis=1)))
    assert model.phi.tolist() == pytest.approx([0.99, 0])


LONG = 600  # weeks
WEEKLY, NIGHT, NOON, REMEMBERED = 0.3, 0.4, 0.2, 0.7


@pytest.fixture(scope="module")
def nightly() -> np.ndarray:
    """Weeks that differ as a whole, and hours beyond that, in the first half of the day twice as much."""
    rng = np.random.default_rng(6)
    residual = [rng.standard_normal(LONG)]
    for innovation in rng.standard_normal((WEEK - 1, LONG)) * math.sqrt(1 - REMEMBERED**2):
        residual.append(REMEMBERED * residual[-1] + innovation)
    logs = EXPECTED[:, 0] + WEEKLY * rng.standard_normal(LONG)[:, None] + np.stack(residual, axis=1) * every_hour()
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
    near(model.sigma[:, 0], deviation, 1.17 * deviation / math.sqrt(7 * LONG))
    # Neighbours, but not of two weeks, in units of their deviations
    units = left / np.tile(deviation, 7) / np.tile(deviation, 7)[:, None]
    memory = np.diag(units, 1).sum() / np.trace(units)
    assert memory == pytest.approx(REMEMBERED, abs=0.02)
    near(model.phi[0], memory, math.sqrt((1 - memory**2) / WEEK / LONG))


def test_a_broken_sensor_hardly_changes_how_much_counts_vary(nightly) -> None:
    # Nothing for three of three hundred weeks, from a Thursday on: two whole ones and two halves. Squares would make
    # it sqrt(.3^2 + (2 * 5^2 + 2 * 2.5^2) / 300) = .55 for weeks; of quartiles it is a hundredth of the ranks.
    counts = nightly[: 300 * WEEK].copy()
    whole = fit_sensors(table(counts))
    counts[40 * WEEK + 84 : 43 * WEEK + 84] = 0
    broken = fit_sensors(table(counts))
    np.testing.assert_allclose(broken.weekly, whole.weekly, rtol=0.07)
    np.testing.assert_allclose(broken.sigma, whole.sigma, rtol=0.07)
    # The hours of these halves are 2.5 below the mean of their week or above it: by more than four deviations, and
    # taken for as many. They are a 150th of all and add 16 / 150 = .11 squares to 1, all remembered:
    # (.68 + .11) / 1.11 = .71; with what they are, ten deviations of 1/4, it would be (.68 + .67) / 1.67 = .81.
    np.testing.assert_allclose(broken.phi, whole.phi, atol=0.06)


def test_sensors_that_always_count_alike_can_be_drawn_together(counted) -> None:
    model = fit_sensors(table(counted[:, [0, 0]]))
    factor = np.asarray(model.cholesky)
    assert np.isfinite(factor).all()
    np.testing.assert_allclose(factor @ factor.T, 1, atol=1e-5)


def test_too_few_counts(counted) -> None:
    assert FEWEST_HOURS == 672
    few = counted[:900].copy()
    few[671:, 1] = np.nan
    with pytest.raises(SeriesError) as caught:
        fit_sensors(table(few))
    assert caught.value.field == "b"
    few[671, 1] = 7
    fit_sensors(table(few))


def test_an_hour_of_the_week_that_was_never_counted(counted) -> None:
    never = counted.copy()
    never[50::WEEK, 2] = np.nan
    with pytest.raises(SeriesError) as caught:
        fit_sensors(table(never))
    assert caught.value.field == "c"
    fit_sensors(table(never), ["a", "b"])


def test_an_unknown_sensor(counted) -> None:
    with pytest.raises(CountsError) as caught:
        fit_sensors(table(counted), ["d"])
    assert caught.value.field == "d"


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
    weeks = recorded_weeks(replace(flat(2.0), expected=jnp.asarray(usual)), table(counts), ["a"])
    np.testing.assert_allclose(weeks, math.log(2), rtol=1e-5)


def test_too_few_weeks() -> None:
    counts = np.ones((2 * WEEK + 3, 1))
    # It begins on Monday at 1:00, so the first whole week begins a week later.
    with pytest.raises(SeriesError, match="not on 1"):
        recorded_weeks(flat(2.0), table(counts, MONDAY + 1), ["a"])
    with pytest.raises(SeriesError, match="not on 0"):
        recorded_weeks(flat(2.0), table(counts[:100], MONDAY + 1), ["a"])


def test_weeks_in_which_a_sensor_was_dead() -> None:
    counts = np.ones((2 * WEEK + 5, 2))
    counts[: 2 * WEEK, 1] = np.nan  # it counts again after the last whole week
    with pytest.raises(SeriesError) as caught:
        recorded_weeks(flat(2.0, 2), table(counts), ["a", "b"])
    assert caught.value.field == "b"
