"""The statistics of what sensors count: expected weeks, and how counts differ from them.

The logarithm of a count (plus one, so that zero has one) is the sum of three: the expected level of the hour of the
week; how the whole week differs from it; and an AR(1) in units of how much counts vary at that hour of the day, since
nights vary more than noons. The innovations of the sensors are correlated.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from sidestep.crowds.arima import SeriesError
from sidestep.crowds.counts import CountTable
from sidestep.crowds.profile import HOURS_OF_WEEK, hour_of_week

LARGEST_PHI = 0.99  # from hour to hour; a residual that never fades has no stationary deviation
SMALLEST_SIGMA = 0.001  # of a logarithm
OUTLIER = 4.0  # standard deviations
FEWEST_HOURS = 4 * HOURS_OF_WEEK  # counted hours to fit to
_NORMAL_QUARTILES = 1.349  # between the quartiles of a standard normal number


class SensorModel(eqx.Module):
    """What sensors are expected to count, and how counts vary."""

    expected: Float[Array, "168 sensor"]
    """Mean of log(1 + persons/h) in each hour of the week, from Monday 0:00 on."""
    weekly: Float[Array, " sensor"]
    """Standard deviation of whole weeks from the expected one."""
    sigma: Float[Array, "24 sensor"]
    """Standard deviation of the residual beyond that, in each hour of the day."""
    phi: Float[Array, " sensor"]
    """Coefficient from hour to hour of this residual, in units of ``sigma``."""
    cholesky: Float[Array, "sensor sensor"]
    """Lower Cholesky factor of the correlations of the innovations."""


def fit_sensors(table: CountTable, sensors: Sequence[str] | None = None) -> SensorModel:
    """Fit expected weeks and residuals to hourly counts.

    Weeks begin on Monday; a week has a level if half of its hours or more were counted. Standard deviations are 0.74
    times the distance of the quartiles, which holidays and broken sensors hardly change; for the same reason residuals
    are cut at ``OUTLIER`` of them. The coefficient is the lag-one autocorrelation of the residuals; correlations are
    those of the innovations in hours that both sensors counted.

    Parameters
    ----------
    table
        Hourly counts.
    sensors
        Names of the sensors to fit; by default all of the table.

    Returns
    -------
    model
        With sensors in the order of ``sensors``.

    Raises
    ------
    SeriesError
        A sensor with too few counts, or none in some hour of the week; ``field`` is the sensor.
    CountsError
        An unknown sensor.
    """
    names = table.sensors if sensors is None else tuple(sensors)
    logs = np.log1p(np.stack([table.series(name) for name in names], axis=1))
    hours = hour_of_week(table.times)
    counted = np.isfinite(logs)
    for name, known in zip(names, counted.T, strict=True):
        sensor = f"{table.source}: sensor {name!r}"
        if known.sum() < FEWEST_HOURS:
            raise SeriesError(f"{sensor} has {known.sum()} counted hours, but the fit needs {FEWEST_HOURS}", field=name)
        if len(np.unique(hours[known])) < HOURS_OF_WEEK:
            raise SeriesError(f"{sensor} has no count in some hours of the week", field=name)
    expected = np.stack([np.nanmean(logs[hours == hour], axis=0) for hour in range(HOURS_OF_WEEK)])
    residual = logs - expected[hours]
    week = np.cumsum(hours == 0)
    level = np.stack([_mean(residual[week == number]) for number in range(week[-1] + 1)])
    weekly = _robust_sigma(level)
    residual -= np.where(np.isfinite(level), level, 0.0)[week]
    sigma = np.maximum([_robust_sigma(residual[hours % 24 == hour]) for hour in range(24)], SMALLEST_SIGMA)
    residual = np.clip(residual / sigma[hours % 24], -OUTLIER, OUTLIER)
    before, after = residual[:-1], residual[1:]
    paired = np.isfinite(before) & np.isfinite(after)
    products = np.where(paired, before * after, 0.0).sum(axis=0)
    phi = products / np.maximum(np.where(paired, before**2, 0.0).sum(axis=0), 1e-12)
    phi = np.clip(phi, 0.0, LARGEST_PHI)
    innovation = np.where(paired, after - phi * before, 0.0)
    squares = (innovation**2).T @ paired  # of each sensor over the hours that each other counted
    correlation = innovation.T @ innovation / np.sqrt(np.maximum(squares * squares.T, 1e-24))
    np.fill_diagonal(correlation, 1.0)
    parts = (expected, weekly, sigma, phi, cholesky_factor(correlation))
    return SensorModel(*jax.device_put(tuple(part.astype(np.float32) for part in parts)))


def _mean(hours: Float[np.ndarray, "hour sensor"]) -> Float[np.ndarray, " sensor"]:
    """Mean of the counted hours, if they are half a week or more; else NaN."""
    counted = np.isfinite(hours)
    mean = np.where(counted, hours, 0.0).sum(axis=0) / np.maximum(counted.sum(axis=0), 1)
    return np.where(counted.sum(axis=0) >= HOURS_OF_WEEK // 2, mean, np.nan)


def _robust_sigma(values: Float[np.ndarray, "n sensor"]) -> Float[np.ndarray, " sensor"]:
    """Standard deviation of normal numbers with these quartiles; 0 where there are fewer than two values."""
    known = [column[np.isfinite(column)] for column in values.T]
    quartiles = np.array([np.quantile(column, (0.25, 0.75)) if len(column) > 1 else (0.0, 0.0) for column in known])
    return (quartiles[:, 1] - quartiles[:, 0]) / _NORMAL_QUARTILES


def cholesky_factor(correlation: Float[np.ndarray, "sensor sensor"]) -> Float[np.ndarray, "sensor sensor"]:
    """Lower Cholesky factor of the nearest matrix that has one.

    Correlations over different hours are not always those of a joint distribution.

    Returns
    -------
    factor
        Of a matrix whose diagonal is 1.
    """
    values, vectors = np.linalg.eigh(correlation)
    fitting = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    scale = 1 / np.sqrt(np.diag(fitting))
    return np.linalg.cholesky(fitting * scale * scale[:, None])


def recorded_weeks(
    model: SensorModel, table: CountTable, sensors: Sequence[str]
) -> Float[np.ndarray, "week 168 sensor"]:
    """How whole recorded weeks differ from the expected one, in logarithms of one more than the count.

    Residuals of hours without a count are interpolated linearly in time.

    Parameters
    ----------
    model
        What the sensors are expected to count.
    table
        Hourly counts.
    sensors
        Names of the sensors of the model.

    Returns
    -------
    record
        By week, hour of the week and sensor.

    Raises
    ------
    SeriesError
        Fewer than two whole weeks, or a sensor that counted nothing in them; ``field`` is the sensor.
    """
    hours = hour_of_week(table.times)
    logs = np.log1p(np.stack([table.series(name) for name in sensors], axis=1))
    residual = logs - np.asarray(model.expected)[hours]
    first = int(np.argmax(hours == 0))
    weeks = (len(hours) - first) // HOURS_OF_WEEK
    if weeks < 2:
        raise SeriesError(f"{table.source}: walks are tested on two or more whole weeks of counts, not on {weeks}")
    residual = residual[first : first + weeks * HOURS_OF_WEEK]
    number = np.arange(len(residual))
    for name, column in zip(sensors, residual.T, strict=True):
        known = np.isfinite(column)
        if not known.any():
            raise SeriesError(f"{table.source}: sensor {name!r} counted nothing in the weeks to test on", field=name)
        column[~known] = np.interp(number[~known], number[known], column[known])
    return residual.reshape(weeks, HOURS_OF_WEEK, -1).astype(np.float32)
