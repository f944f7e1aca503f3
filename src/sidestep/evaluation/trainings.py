"""Several trainings of the same agents together: means, with intervals over trainings and over walks."""

from collections.abc import Mapping, Sequence
from typing import Any, NotRequired

import numpy as np
from numpy.typing import ArrayLike

from sidestep.evaluation.compare import Comparison
from sidestep.evaluation.metrics import Row
from sidestep.planners.registry import BASELINE

MEANS = {"ci95": "mean_minutes", "gap_ci95": "gap", "difference_ci95": "difference_minutes"}
"""Intervals of rows, and what they are of."""


class TrainingsRow(Row):
    """One planner or agent over all trainings: means, with intervals over trainings (None of a single one)."""

    trainings: NotRequired[int]
    """Maps and seeds on which it has walked."""
    ci95_walks: NotRequired[list[float] | None]
    """Interval of the mean over all walks, taking the trainings as they are."""
    difference_ci95_walks: NotRequired[list[float] | None]
    """The same of the difference to the baseline, of paired walks."""


def student_interval(values: ArrayLike) -> list[float] | None:
    """95 % interval of a mean, Student's, for few values or many.

    Parameters
    ----------
    values
        At least one.

    Returns
    -------
    list of float or None
        Low and high; None of a single value, which says nothing about chance.
    """
    from scipy.stats import t as student

    array = np.asarray(values, np.float64).ravel()
    if len(array) == 1:
        return None
    mean, half = array.mean(), student.ppf(0.975, len(array) - 1) * array.std(ddof=1) / len(array) ** 0.5
    return [float(mean - half), float(mean + half)]


def mean_row(rows: Sequence[Row]) -> TrainingsRow:
    """One planner's mean over trainings, with intervals over them; a number that one of them lacks is None."""
    mean: dict[str, Any] = dict(rows[0])
    for name in mean.keys() - {"level", "maps", *MEANS}:
        values: list[Any] = [row[name] for row in rows]  # type: ignore[literal-required]
        mean[name] = None if None in values else float(np.mean(values))
    for interval, name in MEANS.items():
        mean[interval] = student_interval([row[name] for row in rows])  # type: ignore[literal-required]
    return mean | {"trainings": len(rows)}  # type: ignore[return-value]


def mean_rows(results: Sequence[Mapping[str, Any]]) -> dict[str, TrainingsRow]:
    """The means of all planners of some comparisons, one for each training, in the shape of ``results.json``."""
    names = dict.fromkeys(name for found in results for name in found["planners"])
    every = {name: [found["planners"].get(name) for found in results] for name in names}
    return {name: mean_row([row for row in rows if row is not None]) for name, rows in every.items()}


def over_trainings(compared: Sequence[Comparison], baseline: str = BASELINE) -> dict[str, TrainingsRow]:
    """Sum up the same comparison on several maps or with several seeds, each with agents that were trained for it.

    Parameters
    ----------
    compared
        One comparison for each training. An agent may be missing in some.
    baseline
        Who the others' minutes are set against, in each comparison.

    Returns
    -------
    dict of TrainingsRow
        By planner.

    Raises
    ------
    PlannerError
        The baseline, ``shortest-path`` or ``clairvoyant`` has not walked everywhere (field ``baseline``).
    """
    # Intervals are over trainings here: resamples of each one's walks would take minutes for thousands.
    rows = mean_rows([{"planners": each.rows(baseline=baseline, resamples=1)} for each in compared])
    for name, row in rows.items():
        records = [each.records for each in compared if name in each.records]
        minutes, cost, other = (
            np.concatenate([getattr(record[who], what).ravel() for record in records])
            for who, what in ((name, "minutes"), (name, "cost"), (baseline, "cost"))
        )
        row["ci95_walks"] = student_interval(minutes)
        row["difference_ci95_walks"] = student_interval(cost - other)
    return rows
