"""A model of the counts of one sensor: a profile of the hours of the week, and an AR(1) for how today differs from it.

log(1 + y) = expected(hour of the week) + r, where r is an AR(1). Unlike the paper's ARIMA on raw counts it knows
nights, noons and Sundays; one hour ahead it halves the error (see `sidestep.crowds.summary.one_step_errors`).
"""

from datetime import datetime

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, ScalarLike, Shaped

from sidestep.crowds import arima

HOURS_OF_WEEK = 168
DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")


class HourOfWeekProfile(eqx.Module):
    """Expected level of each hour of the week, and the model of the residual."""

    expected: Float[Array, "168"]
    """Mean of log(1 + y) in each hour of the week, y in persons/h; hour 0 is Monday 0:00 to 0:59."""
    residual: arima.Arima
    """AR(1) of log(1 + y) less its expected value; its step is the step of the whole model."""


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

    Raises
    ------
    SeriesError
        Times with gaps, an hour of the week without any count, or residuals that `arima.fit_arima` refuses.
    """
    if (np.diff(times.astype("datetime64[h]")).astype(np.int64) != 1).any():
        raise arima.SeriesError("the times of a profile must be hourly without gaps; mark missing counts as NaN")
    hours = hour_of_week(times)
    logs = np.log1p(series)
    counted = ~np.isnan(logs)
    numbers = np.bincount(hours[counted], minlength=HOURS_OF_WEEK)
    if (numbers == 0).any():
        first = int((numbers == 0).argmax())
        raise arima.SeriesError(
            f"{(numbers == 0).sum()} hours of the week have no count, the first is {day_and_time(first)}"
        )
    expected = np.bincount(hours[counted], weights=logs[counted], minlength=HOURS_OF_WEEK) / numbers
    return HourOfWeekProfile(jnp.asarray(expected), arima.fit_arima(logs - expected[hours], p=1, d=0, q=0))


def change_step(model: HourOfWeekProfile, step: float) -> HourOfWeekProfile:
    """The same model sampled every `step` seconds; exact, as `arima.change_step` is, whose errors it raises."""
    return HourOfWeekProfile(model.expected, arima.change_step(model.residual, step))


def simulate(
    model: HourOfWeekProfile,
    start_hour_of_week: ScalarLike,
    initial_residual: Float[Array, " *batch"],
    innovations: Float[Array, "slot *batch"],
) -> Float[Array, "slot *batch"]:
    """Simulate volumes from an hour of the week on, in persons/h, never negative.

    Parameters
    ----------
    model
        The model; its step is the slot.
    start_hour_of_week
        Wall time of the first slot returned, hours since Monday 0:00; any number, taken modulo a week. Slots shorter
        than an hour have the expected level of the hour in which they begin.
    initial_residual
        Residual of the slot *before* the first; 0 is an ordinary day.
    innovations
        Standard normal numbers, one for each slot.
    """
    residuals = arima.latent(model.residual, initial_residual[None], innovations)
    # Known when compiling, so NumPy may count in double precision. Single precision may turn noon into 11:59:59.98: a
    # second is added to keep it in the right hour.
    offsets = np.arange(innovations.shape[0]) * (model.residual.step / 3600.0) % HOURS_OF_WEEK + 1.0 / 3600.0
    clock = start_hour_of_week + jnp.asarray(offsets)
    expected = model.expected[jnp.floor(clock).astype(int) % HOURS_OF_WEEK]
    return _volumes(expected.reshape(-1, *(1,) * initial_residual.ndim) + residuals)


def forecast(
    model: HourOfWeekProfile,
    start_hour_of_week: ScalarLike,
    initial_residual: Float[Array, " *batch"],
    slots: int,
) -> Float[Array, "slots *batch"]:
    """Forecast median volumes of `slots` slots: `simulate` without innovations."""
    return simulate(model, start_hour_of_week, initial_residual, jnp.zeros((slots, *initial_residual.shape)))


def residuals(
    model: HourOfWeekProfile, hours: Int[Array, " hour"], series: Float[Array, " hour"]
) -> Float[Array, " hour"]:
    """How counts in persons/h differ from the expected ones of their hours of the week, in logarithms."""
    return jnp.log1p(series) - model.expected[hours]


def one_step(
    model: HourOfWeekProfile, hours: Int[Array, " hour"], series: Float[Array, " hour"]
) -> Float[Array, " hour"]:
    """Forecast each hourly value from all values before it; NaN until a value has been observed."""
    return _volumes(model.expected[hours] + arima.latent_one_step(model.residual, residuals(model, hours, series)))


def _volumes(logs: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.maximum(jnp.expm1(logs), 0.0)
