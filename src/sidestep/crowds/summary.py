"""All that `sidestep counts` shows of a table of counts."""

from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

from sidestep.crowds.arima import simulate
from sidestep.crowds.counts import Period, Repair, load_auckland, read_counts
from sidestep.crowds.profile import HOURS_OF_WEEK
from sidestep.crowds.skill import one_step_errors, periods

DEFAULT_SENSOR = "45 Queen Street"  # the one that the paper scenarios' model is fitted to


@dataclass(frozen=True)
class CountSummary:
    """Counts, repairs, model and errors; plain numbers throughout."""

    source: str
    first: str
    last: str
    hours: int
    sensors: tuple[str, ...]
    repairs: tuple[Repair, ...]
    sensor: str
    train: Period
    test: Period
    order: tuple[int, int, int]
    ar: list[float]
    ma: list[float]  # in the paper's signs
    mean: float  # of the d times differenced series, persons/h
    sigma: float  # persons/h
    counted_mean: float
    counted_sd: float
    simulated_mean: float  # of one simulated week
    simulated_sd: float
    tested_hours: int
    rmse: dict[str, float]  # one-step errors, persons/h


def summarise_counts(
    file: Path | None, sensor: str | None, order: tuple[int, int | None, int], seed: int
) -> CountSummary:
    """Load Auckland's counts or a file, fit the models to one sensor and test them."""
    table = load_auckland() if file is None else read_counts(file)
    sensor = sensor or (DEFAULT_SENSOR if file is None else table.sensors[0])
    train, test = periods(table)
    found = one_step_errors(table, sensor, train, test, *order)
    model = found.arima_model
    training = table.between(*train).series(sensor)
    innovations = jax.random.normal(jax.random.key(seed), (HOURS_OF_WEEK,))
    week = np.asarray(simulate(model, jax.numpy.asarray(training[~np.isnan(training)][-HOURS_OF_WEEK:]), innovations))
    return CountSummary(
        source=table.source,
        first=str(table.times[0]),
        last=str(table.times[-1]),
        hours=len(table.times),
        sensors=table.sensors,
        repairs=table.repairs,
        sensor=sensor,
        train=train,
        test=test,
        order=(model.ar.shape[0], model.d, model.ma.shape[0]),
        ar=model.ar.tolist(),
        ma=model.ma.tolist(),
        mean=float(model.mean),
        sigma=float(model.sigma),
        counted_mean=float(np.nanmean(training)),
        counted_sd=float(np.nanstd(training)),
        simulated_mean=float(week.mean()),
        simulated_sd=float(week.std()),
        tested_hours=found.hours,
        rmse={
            "persistence": found.persistence,
            "same hour last week": found.last_week,
            f"ARIMA({model.ar.shape[0]}, {model.d}, {model.ma.shape[0]})": found.arima,
            "log hour-of-week profile + AR(1)": found.profile,
        },
    )
