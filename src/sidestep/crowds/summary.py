"""What ``sidestep counts`` reports: the counts, a model fitted to one sensor, and how well models predict it."""

from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from sidestep.crowds import arima, counts, profile
from sidestep.crowds.counts import CountsError, CountTable, Period
from sidestep.crowds.layouts import RECOGNISED, Layout
from sidestep.crowds.profile import HOURS_OF_WEEK
from sidestep.crowds.repairs import Repair

DEFAULT_SENSOR = "45 Queen Street"  # the one that the paper scenarios' model is fitted to
Order = tuple[int, int | None, int]
"""p, d and q of an ARIMA; with d None the data choose it."""
PERSISTENCE, LAST_WEEK, PROFILE = "persistence", "same hour last week", "log hour-of-week profile + AR(1)"


@dataclass(frozen=True, eq=False)
class OneStepErrors:
    """How well two models predict the next hour, beside the two predictions that need no model."""

    hours: int
    """Number of test hours for which every prediction and the count exist."""
    mean: float
    """Mean count of these hours, persons/h."""
    rmse: dict[str, float]
    """Root-mean-square error of each prediction on these hours, persons/h."""
    arima_model: arima.Arima
    """The fitted ARIMA."""


@dataclass(frozen=True)
class CountReport:
    """What a table of counts holds, and what was made of its file; plain numbers throughout."""

    source: str
    """Name of the file, or the publisher."""
    first: str
    """First hour, local wall time."""
    last: str
    """Last hour, local wall time."""
    hours: int
    """Number of hours."""
    sensors: tuple[str, ...]
    """Names of the sensors."""
    understood: tuple[str, ...]
    """How the file was read, in words."""
    repairs: tuple[Repair, ...]
    """What was wrong with the counts as published."""


@dataclass(frozen=True)
class CountSummary(CountReport):
    """Counts, repairs, a model and its errors; plain numbers throughout."""

    sensor: str
    """The sensor that the models are fitted to."""
    train: Period
    """Period to which they are fitted."""
    test: Period
    """Period on which they are tested."""
    order: tuple[int, int, int]
    """p, d and q of the ARIMA."""
    ar: list[float]
    """Autoregressive coefficients, in the paper's signs."""
    ma: list[float]
    """Moving-average coefficients, in the paper's signs."""
    mean: float
    """Mean of the d times differenced series, persons/h."""
    sigma: float
    """Standard deviation of the innovations, persons/h."""
    counted_mean: float
    """Mean of the training period, persons/h."""
    counted_sd: float
    """Standard deviation of the training period, persons/h."""
    simulated_mean: float
    """Mean of one simulated week, persons/h."""
    simulated_sd: float
    """Standard deviation of one simulated week, persons/h."""
    tested_hours: int
    """Number of test hours."""
    rmse: dict[str, float]
    """Root-mean-square error of the next hour's count by prediction, persons/h."""


def report_counts(table: CountTable) -> CountReport:
    """What a table of counts holds.

    Returns
    -------
    report
        All that ``sidestep counts --out --json`` prints.
    """
    return CountReport(
        source=table.source,
        first=str(table.times[0]),
        last=str(table.times[-1]),
        hours=len(table.times),
        sensors=table.sensors,
        understood=table.understood,
        repairs=table.repairs,
    )


def summarise_counts(
    file: Path | None, sensor: str | None, order: Order, seed: int, layout: Layout = RECOGNISED
) -> CountSummary:
    """Load Auckland's counts or a file, fit the models to one sensor and test them.

    Parameters
    ----------
    file
        A file of counts; None for Auckland's.
    sensor
        By default the one that the paper's scenarios use, or the first of the file.
    order
        Order (p, d, q) of the ARIMA; the data choose d where it is None.
    seed
        Of the simulated week.
    layout
        What the file does not say itself.

    Returns
    -------
    summary
        All that ``sidestep counts --json`` prints.

    Raises
    ------
    CountsError
        Counts that are not usable, or too few of them; an unknown sensor.
    """
    table = counts.load_auckland() if file is None else counts.read_counts(file, layout)
    sensor = sensor or (DEFAULT_SENSOR if file is None else table.sensors[0])
    train, test = periods(table)
    table.series(sensor)  # refuses an unknown one
    try:
        found = one_step_errors(table, sensor, train, test, order)
    except CountsError as error:
        hint = "--out clean.csv writes the counts as they were understood, without a model"
        raise CountsError(f"{error}; {hint}", field=error.field) from error
    model = found.arima_model
    training = table.between(*train).series(sensor)
    innovations = jax.random.normal(jax.random.key(seed % 2**32), (HOURS_OF_WEEK,))
    last = jnp.asarray(training[~np.isnan(training)][-HOURS_OF_WEEK:])
    week = np.asarray(arima.simulate(model, last, innovations))
    return CountSummary(
        **vars(report_counts(table)),
        sensor=sensor,
        train=train,
        test=test,
        order=model.order,
        ar=model.ar.tolist(),
        ma=model.ma.tolist(),
        mean=float(model.mean),
        sigma=float(model.sigma),
        counted_mean=float(np.nanmean(training)),
        counted_sd=float(np.nanstd(training)),
        simulated_mean=float(week.mean()),
        simulated_sd=float(week.std()),
        tested_hours=found.hours,
        rmse=found.rmse,
    )


def periods(table: CountTable) -> tuple[Period, Period]:
    """Where to train and where to test: `TRAIN` and `TEST` for Auckland, else the first four fifths and the rest."""
    if table.source == counts.AUCKLAND_SOURCE:
        return counts.TRAIN, counts.TEST
    first, last = table.times[0], table.times[-1] + np.timedelta64(1, "h")
    border = table.times[len(table.times) * 4 // 5]
    return (str(first), str(border)), (str(border), str(last))


def one_step_errors(
    table: CountTable, sensor: str, train: Period = counts.TRAIN, test: Period = counts.TEST, order: Order = (1, 0, 0)
) -> OneStepErrors:
    """Fit both models to a sensor's training period and predict every hour of its test period from the hours before.

    Parameters
    ----------
    table, sensor
        Counts, and the sensor to predict.
    train, test
        First hour, and the one past the last (local wall time). The test may look back before its start, never ahead.
    order
        Order (p, d, q) of the ARIMA.

    Returns
    -------
    errors
        All on the same test hours.

    Raises
    ------
    CountsError
        An unknown sensor, a period without hours, or too few counts to fit or to test a model.
    """
    training = table.between(*train)
    first = table.between(*test).times[0]
    # The hours before the test, long enough for the models to forget how they began.
    tested = table.between(first - np.timedelta64(2 * HOURS_OF_WEEK, "h"), test[1])
    series, learned = tested.series(sensor), training.series(sensor)
    where = f"{table.source}: sensor {sensor!r}"
    try:
        arima_model = arima.fit_arima(learned, *order)
        profile_model = profile.fit_profile(training.times, learned)
    except ValueError as error:
        raise CountsError(f"{where}, {train[0]} to {train[1]}: {error}", field=sensor) from error
    hours = jnp.asarray(profile.hour_of_week(tested.times))
    predictions = {
        PERSISTENCE: _before(series, 1),
        LAST_WEEK: _before(series, HOURS_OF_WEEK),
        f"ARIMA{arima_model.order}": np.asarray(arima.one_step(arima_model, jnp.asarray(series))),
        PROFILE: np.asarray(profile.one_step(profile_model, hours, jnp.asarray(series))),
    }
    usable = ~np.isnan(series + sum(predictions.values())) & (tested.times >= first)
    if not usable.any():
        nothing = f"{where}, {test[0]} to {test[1]}: no hour has a count and all predictions"
        raise CountsError(nothing, field=sensor)
    rmse = {name: float(np.sqrt(np.mean((series - each)[usable] ** 2))) for name, each in predictions.items()}
    return OneStepErrors(int(usable.sum()), float(series[usable].mean()), rmse, arima_model)


def _before(series: Float[np.ndarray, " hour"], lag: int) -> Float[np.ndarray, " hour"]:
    return np.concatenate([np.full(min(lag, len(series)), np.nan), series[:-lag]])
