"""The default model of real counts: the usual hour of the week, and an AR(1) for how today differs from it.

log(1 + y) = usual(hour of week) + r, where r is an AR(1). Beside the paper's ARIMA on raw counts this knows about
nights, noons and Sundays; one hour ahead it halves the error (see `sidestep.crowds.skill`).
"""

from datetime import datetime

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, ScalarLike, Shaped

from sidestep.crowds import arima

HOURS_OF_WEEK = 168


class HourOfWeekProfile(eqx.Module):
    """Usual level of each hour of the week, and the model of the residual."""

    usual: Float[Array, "168"]  # mean of log(1 + y); hour 0 is Monday 0:00 to 0:59
    residual: arima.Arima  # AR(1) of log(1 + y) - usual; its step is the step of the whole model


def hour_of_week(times: Shaped[np.ndarray, " hour"]) -> Int[np.ndarray, " hour"]:
    """Hour of the week of each wall time: 0 is Monday 0:00, 167 Sunday 23:00."""
    hours = times.astype("datetime64[h]").astype(np.int64)
    return np.asarray((hours + 3 * 24) % HOURS_OF_WEEK)  # day 0 of datetime64 is a Thursday


def time_of_week(time: datetime) -> float:
    """Hours since Monday 0:00, parts of an hour included."""
    return 24.0 * time.weekday() + time.hour + time.minute / 60 + (time.second + time.microsecond / 1e6) / 3600


def fit_profile(times: Shaped[np.ndarray, " hour"], series: Float[np.ndarray, " hour"]) -> HourOfWeekProfile:
    """Fit to an unbroken hourly series (persons/h, NaN where missing) with its wall times.

    Raises
    ------
    SeriesError
        If an hour of the week never has a count, or the residuals cannot be fitted (see `arima.fit_arima`).
    """
    if (np.diff(times.astype("datetime64[h]")).astype(np.int64) != 1).any():
        raise arima.SeriesError("the times of a profile must be hourly and without gaps (missing counts are NaN)")
    hours = hour_of_week(times)
    logs = np.log1p(series)
    counted = ~np.isnan(logs)
    numbers = np.bincount(hours[counted], minlength=HOURS_OF_WEEK)
    if (numbers == 0).any():
        first = int((numbers == 0).argmax())
        raise arima.SeriesError(f"{(numbers == 0).sum()} hours of the week have no count, the first is hour {first}")
    usual = np.bincount(hours[counted], weights=logs[counted], minlength=HOURS_OF_WEEK) / numbers
    return HourOfWeekProfile(usual=jnp.asarray(usual), residual=arima.fit_arima(logs - usual[hours], p=1, d=0, q=0))


def change_step(model: HourOfWeekProfile, step: float) -> HourOfWeekProfile:
    """The same model every `step` seconds; exact, as for `arima.change_step`, whose errors it raises."""
    return HourOfWeekProfile(usual=model.usual, residual=arima.change_step(model.residual, step))


def simulate(
    model: HourOfWeekProfile,
    start_hour_of_week: ScalarLike,
    initial_residual: Float[Array, " *batch"],
    innovations: Float[Array, "slot *batch"],
) -> Float[Array, "slot *batch"]:
    """Volumes from an hour of the week on, persons/h, never negative.

    Parameters
    ----------
    start_hour_of_week
        Wall time of the first slot returned, hours since Monday 0:00; any number, taken modulo a week. Slots shorter
        than an hour take the usual level of the hour in which they begin.
    initial_residual
        Residual of the slot *before* the first: log(1 + y) - usual; 0 is an ordinary day.
    innovations
        Standard normal numbers, one a slot.
    """
    residuals = arima.latent(model.residual, initial_residual[None], innovations)
    # Known when compiling, so NumPy can count in double precision; the second added keeps 11:59:59.98, which single
    # precision may make of noon, in the right hour.
    offsets = np.arange(innovations.shape[0]) * (model.residual.step / 3600.0) % HOURS_OF_WEEK + 1.0 / 3600.0
    clock = start_hour_of_week + jnp.asarray(offsets)
    usual = model.usual[jnp.floor(clock).astype(int) % HOURS_OF_WEEK]
    return _volumes(usual.reshape(-1, *(1,) * initial_residual.ndim) + residuals)


def forecast(
    model: HourOfWeekProfile,
    start_hour_of_week: ScalarLike,
    initial_residual: Float[Array, " *batch"],
    slots: int,
) -> Float[Array, "slots *batch"]:
    """The median volumes of `slots` slots: `simulate` without innovations."""
    return simulate(model, start_hour_of_week, initial_residual, jnp.zeros((slots, *initial_residual.shape)))


def residuals(
    model: HourOfWeekProfile, hours: Int[Array, " hour"], series: Float[Array, " hour"]
) -> Float[Array, " hour"]:
    """How each count (persons/h) differs from the usual one of its hour of the week: log(1 + y) - usual."""
    return jnp.log1p(series) - model.usual[hours]


def one_step(
    model: HourOfWeekProfile, hours: Int[Array, " hour"], series: Float[Array, " hour"]
) -> Float[Array, " hour"]:
    """Forecast each hourly value from all values before it; NaN as long as nothing has been observed."""
    return _volumes(model.usual[hours] + arima.latent_one_step(model.residual, residuals(model, hours, series)))


def _volumes(logs: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.maximum(jnp.expm1(logs), 0.0)
