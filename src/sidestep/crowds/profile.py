"""A model of the counts of one sensor: a profile of the hours of the week, and an AR(1) for how today differs from it.

log(1 + y) = expected(hour of the week) + r, where r is an AR(1). Unlike the paper's ARIMA on raw counts it knows
nights, noons and Sundays; one hour ahead it halves the error (see `sidestep.crowds.summary.one_step_errors`).
"""

from datetime import datetime

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from sidestep.crowds import arima
from sidestep.crowds.wall_time import DAYS

Series = Float[Array, " hour"]

HOURS_OF_WEEK = 168
_ALIKE = 1e-9  # deviation of logarithms that is rounding: weeks such as those of a square wave are all alike


class HourOfWeekProfile(eqx.Module):
    """Expected level of each hour of the week, and the model of the residual."""

    expected: Float[Array, "168"]
    """Mean of log(1 + y) in each hour of the week, y in persons/h; hour 0 is Monday 0:00 to 0:59."""
    residual: arima.Arima
    """AR(1) from hour to hour of log(1 + y) less its expected value."""


def hour_of_week(times: Shaped[np.ndarray, " hour"]) -> Int[np.ndarray, " hour"]:
    """Hour of the week of each wall time: 0 is Monday 0:00, 167 Sunday 23:00."""
    hours = times.astype("datetime64[h]").astype(np.int64)
    return np.asarray((hours + 3 * 24) % HOURS_OF_WEEK)  # day 0 of datetime64 is a Thursday


def time_of_week(time: datetime) -> float:
    """Hours since Monday 0:00, with fractions."""
    return 24.0 * time.weekday() + time.hour + time.minute / 60 + (time.second + time.microsecond / 1e6) / 3600


def day_and_time(hour: float) -> str:
    """An hour of the week as people write it, such as Saturday 12:30."""
    day, minute = divmod(round(60 * hour), 24 * 60)
    return f"{DAYS[day % 7]} {minute // 60:02}:{minute % 60:02}"


def fit_profile(times: Shaped[np.ndarray, " hour"], series: Float[np.ndarray, " hour"]) -> HourOfWeekProfile:
    """Fit a profile to an unbroken hourly series.

    Parameters
    ----------
    times
        Local wall times, an hour apart.
    series
        Persons/h; NaN where missing.

    Returns
    -------
    profile
        Means of the logarithms by hour of the week, and an ARIMA(1, 0, 0) of the residuals; of weeks that are all alike
        it has no innovations.

    Raises
    ------
    SeriesError
        Times with gaps, an hour of the week without any count, no two weeks to compare, or residuals that
        `arima.fit_arima` refuses.
    """
    if (np.diff(times.astype("datetime64[h]")).astype(np.int64) != 1).any():
        raise arima.SeriesError("the times of a profile must be hourly without gaps; mark missing counts as NaN")
    hours = hour_of_week(times)
    logs = np.log1p(series)
    counted = ~np.isnan(logs)
    numbers = np.bincount(hours[counted], minlength=HOURS_OF_WEEK)
    if not numbers.all():
        first = day_and_time(int(numbers.argmin()))
        raise arima.SeriesError(f"{(numbers == 0).sum()} hours of the week have no count, the first is {first}")
    if numbers.max() == 1:
        raise arima.SeriesError("every hour of the week was counted once; a profile needs weeks to compare")
    expected = np.bincount(hours[counted], weights=logs[counted], minlength=HOURS_OF_WEEK) / numbers
    residual = logs - expected[hours]
    alike = np.nanstd(residual) < _ALIKE
    model = arima.ar1(0.0, 0.0, 0.0) if alike else arima.fit_arima(residual, p=1, d=0, q=0)
    return HourOfWeekProfile(jnp.asarray(expected), model)


def one_step(model: HourOfWeekProfile, hours: Int[Array, " hour"], series: Series) -> Series:
    """Forecast each hourly count from all counts before it; NaN until a count has been observed.

    Parameters
    ----------
    model
        The fitted profile.
    hours
        Hours of the week.
    series
        Counts in these hours, persons/h; NaN where missing.

    Returns
    -------
    forecasts
        Persons/h, never negative.
    """
    residual = jnp.log1p(series) - model.expected[hours]
    return jnp.maximum(jnp.expm1(model.expected[hours] + arima.latent_one_step(model.residual, residual)), 0.0)
