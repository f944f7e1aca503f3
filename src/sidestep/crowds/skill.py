"""How well each model predicts the next hour, beside the two predictions that need no model."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from sidestep.crowds import arima, profile
from sidestep.crowds.arima import Arima
from sidestep.crowds.counts import AUCKLAND_SOURCE, TEST, TRAIN, CountsError, CountTable, Period
from sidestep.crowds.profile import HOURS_OF_WEEK, HourOfWeekProfile


@dataclass(frozen=True, eq=False)
class OneStepErrors:
    """Root-mean-square errors of the next hour's count, persons/h, all on the same test hours."""

    sensor: str
    hours: int  # test hours for which every prediction and the count exist
    mean: float  # mean count of these hours, persons/h
    persistence: float  # as many as in the hour before
    last_week: float  # as many as in the same hour a week before
    arima: float
    profile: float
    arima_model: Arima
    profile_model: HourOfWeekProfile


def periods(table: CountTable) -> tuple[Period, Period]:
    """Where to train and where to test: `TRAIN` and `TEST` for Auckland, else the first four fifths and the rest."""
    if table.source == AUCKLAND_SOURCE:
        return TRAIN, TEST
    first, last = table.times[0], table.times[-1] + np.timedelta64(1, "h")
    border = table.times[len(table.times) * 4 // 5]
    return (str(first), str(border)), (str(border), str(last))


def one_step_errors(
    table: CountTable,
    sensor: str,
    train: Period = TRAIN,
    test: Period = TEST,
    p: int = 1,
    d: int | None = 0,
    q: int = 0,
) -> OneStepErrors:
    """Fit both models to a sensor's training period and predict every hour of its test period from the hours before.

    Parameters
    ----------
    train, test
        First hour, and the one past the last (local wall time). The test may look back before its start, never ahead.
    p, d, q
        Order of the ARIMA; d None lets the data choose.

    Raises
    ------
    CountsError
        If the sensor is unknown, a period holds no hours, or too few counts to fit or to test a model.
    """
    training = table.between(*train)
    first = table.between(*test).times[0]
    # The hours before the test, long enough for the models to forget how they began.
    tested = table.between(first - np.timedelta64(2 * HOURS_OF_WEEK, "h"), test[1])
    series, learned = tested.series(sensor), training.series(sensor)
    try:
        arima_model = arima.fit_arima(learned, p, d, q)
        profile_model = profile.fit_profile(training.times, learned)
    except ValueError as error:
        raise CountsError(f"{table.source}: sensor '{sensor}', {train[0]} to {train[1]}: {error}") from error
    hours = jnp.asarray(profile.hour_of_week(tested.times))
    predictions = {
        "persistence": _before(series, 1),
        "last_week": _before(series, HOURS_OF_WEEK),
        "arima": np.asarray(arima.one_step(arima_model, jnp.asarray(series))),
        "profile": np.asarray(profile.one_step(profile_model, hours, jnp.asarray(series))),
    }
    usable = ~np.isnan(series + sum(predictions.values())) & (tested.times >= first)
    if not usable.any():
        raise CountsError(f"{table.source}: sensor '{sensor}', {test[0]} to {test[1]}: no hour can be tested")
    rmse = {name: _rmse(series[usable] - predicted[usable]) for name, predicted in predictions.items()}
    return OneStepErrors(
        sensor=sensor,
        hours=int(usable.sum()),
        mean=float(series[usable].mean()),
        arima_model=arima_model,
        profile_model=profile_model,
        **rmse,
    )


def _before(series: Float[np.ndarray, " hour"], lag: int) -> Float[np.ndarray, " hour"]:
    return np.concatenate([np.full(min(lag, len(series)), np.nan), series[:-lag]])


def _rmse(errors: Float[np.ndarray, " hour"]) -> float:
    return float(np.sqrt(np.mean(errors**2)))
