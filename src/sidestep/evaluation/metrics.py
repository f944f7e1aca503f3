"""What is reported of walks: means, savings and regrets with bootstrap intervals."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from typing import NotRequired, TypedDict

import numpy as np
from jaxtyping import Bool, Float

from sidestep.environment.rollout import Walk
from sidestep.environment.types import Level
from sidestep.planners.registry import BASELINE, BOUND, REFERENCE

RESAMPLES = 2_000


@dataclass(frozen=True)
class Totals:
    """What walks cost by an objective, and what that is made of."""

    cost: Float[np.ndarray, "*walks"]  # minutes, or what counts as much
    exposure: Float[np.ndarray, "*walks"]  # crowd met, person·s/m²
    metres: Float[np.ndarray, "*walks"]
    too_dense: Float[np.ndarray, "*walks"]  # streets entered above the maximum density


def totals_of(walked: Walk) -> Totals | None:
    """What walks cost, where that is not time alone."""
    if not walked.measures:
        return None
    measures = {name: np.asarray(total, np.float64) for name, total in walked.measures.items()}
    return Totals(np.asarray(walked.cost, np.float64) / 60, **measures)


def joined(several_totals: Sequence[Totals], join: Callable[[list[np.ndarray]], np.ndarray]) -> Totals | None:
    """Several tallies as one; None where there are none, since time was all that counted."""
    return (
        Totals(*(join([getattr(one, of.name) for one in several_totals]) for of in fields(Totals)))
        if several_totals
        else None
    )


@dataclass(frozen=True)
class Record:
    """How one planner's walks went. Walks are paired with those of the other planners, map by map."""

    level: Level
    minutes: Float[np.ndarray, "map walk"]  # the horizon where a walk did not arrive
    arrived: Bool[np.ndarray, "map walk"]
    decision_us: float  # microseconds of planning and deciding for each decision, without potentials and live feed
    totals: Totals | None = None  # None where time is all that counts

    @property
    def cost(self) -> Float[np.ndarray, "map walk"]:
        """What planners are judged by: minutes, or what the objective makes of them."""
        return self.minutes if self.totals is None else self.totals.cost

    @property
    def maps(self) -> int:
        """Number of maps walked: the first ones of the comparison."""
        return len(self.minutes)


PAPER_COLUMNS = (
    "planner", "knows", "minutes", "minutes 95 %", "saved", "best map", "regret", "regret 95 %", "arrive",
    "µs a decision",
)  # fmt: skip


class Row(TypedDict):
    """One planner in ``results.json``; intervals are [low, high], rates and savings are fractions."""

    level: Level
    maps: int
    mean_minutes: float
    ci95: list[float]
    saving_vs_shortest_path: float
    best_saving: float  # on the map (or walk, if there is one map) where it saved most
    regret: float
    regret_ci95: list[float]
    arrival_rate: float
    decision_us: float
    median_minutes: float  # of single walks, as is the next
    p90_minutes: float
    arrive_by: float | None  # share of the walks that arrive within the minutes asked about
    difference_minutes: float  # mean less that of the rival, by default `expected`: below zero where faster
    difference_ci95: list[float]  # paired
    # With an objective savings, regrets and differences are those of costs, and these are there:
    mean_cost_minutes: NotRequired[float]
    mean_exposure: NotRequired[float]  # person·s/m²
    mean_metres: NotRequired[float]
    mean_too_dense: NotRequired[float]  # streets entered above the maximum density, on each walk


def summarise(
    records: dict[str, Record], seed: int = 0, by: float | None = None, baseline: str = BASELINE
) -> dict[str, Row]:
    """One row per planner, in the shape of ``results.json``.

    ``by`` are the minutes that ``arrive_by`` asks about, ``baseline`` is the row that differences are taken to.

    ``saving_vs_shortest_path`` is 1 - mean/mean(shortest-path), ``regret`` mean/mean(clairvoyant) - 1. Intervals are
    95 % percentile bootstraps that resample whole maps, or walks where there is one map; the same resamples serve every
    planner, so that ratios are paired. A row that covers fewer maps is set against the same maps of the references.
    With an objective all of these are of costs, not of minutes.
    """
    return {name: _row(record, records, seed, by, records[baseline].cost) for name, record in records.items()}


def _row(
    record: Record,
    records: dict[str, Record],
    seed: int,
    by: float | None,
    baselines: Float[np.ndarray, "map walk"],
) -> Row:
    minutes, cost = _units(record.minutes), _units(record.cost)
    reference = _units(records[REFERENCE].cost[: record.maps])
    bound = _units(records[BOUND].cost[: record.maps])
    baseline = _units(baselines[: record.maps])
    again = np.random.default_rng(seed).integers(len(cost), size=(RESAMPLES, len(cost)))
    means, bounds = cost[again].mean(axis=1), bound[again].mean(axis=1)
    single = spread(record.minutes, record.arrived, by)
    row: Row = {
        "level": record.level,
        "maps": record.maps,
        "mean_minutes": float(minutes.mean()),
        "ci95": _interval(minutes[again].mean(axis=1)),
        "saving_vs_shortest_path": float(1 - cost.mean() / reference.mean()),
        "best_saving": float(1 - (cost / reference).min()),
        "regret": float(cost.mean() / bound.mean() - 1),
        "regret_ci95": _interval(means / bounds - 1),
        "arrival_rate": float(record.arrived.mean()),
        "decision_us": record.decision_us,
        "median_minutes": single["median_minutes"],
        "p90_minutes": single["p90_minutes"],
        "arrive_by": single["arrive_by"],
        "difference_minutes": float(cost.mean() - baseline.mean()),
        "difference_ci95": _interval(means - baseline[again].mean(axis=1)),
    }
    if record.totals is not None:
        row["mean_cost_minutes"] = float(cost.mean())
        row["mean_exposure"] = float(record.totals.exposure.mean())
        row["mean_metres"] = float(record.totals.metres.mean())
        row["mean_too_dense"] = float(record.totals.too_dense.mean())
    return row


class InterpolationWeights(TypedDict):
    """How much single walks differ."""

    median_minutes: float
    p90_minutes: float
    arrive_by: float | None


def spread(
    minutes: Float[np.ndarray, "*walks"], arrived: Bool[np.ndarray, "*walks"], by: float | None
) -> InterpolationWeights:
    """Median, 90 % quantile, and the share that arrives within ``by`` minutes."""
    return {
        "median_minutes": float(np.median(minutes)),
        "p90_minutes": float(np.quantile(minutes, 0.9)),
        "arrive_by": None if by is None else float((arrived & (minutes <= by)).mean()),
    }


def cells(name: str, row: Row, maps: int, columns: Iterable[str] = ()) -> dict[str, str]:
    """One planner's row as people read it, column by column; ``maps`` is how many the comparison has.

    By default all columns but those that other tables add.
    """
    low, high = row["ci95"]
    regret_low, regret_high = row["regret_ci95"]
    less, more = row["difference_ci95"]
    every = {
        "planner": name if row["maps"] == maps else f"{name} ({row['maps']} maps)",
        "knows": row["level"],
        "minutes": f"{row['mean_minutes']:.1f}",
        "minutes 95 %": f"{low:.1f} to {high:.1f}",
        "median": f"{row['median_minutes']:.1f}",
        "90 %": f"{row['p90_minutes']:.1f}",
        "in time": "" if row["arrive_by"] is None else percent(row["arrive_by"]),
        "cost": f"{row.get('mean_cost_minutes', row['mean_minutes']):.1f}",
        "exposure": f"{row.get('mean_exposure', math.nan):,.0f}",
        "metres": f"{row.get('mean_metres', math.nan):,.0f}",
        "too dense": f"{row.get('mean_too_dense', math.nan):.2f}",
        "saved": percent(row["saving_vs_shortest_path"]),
        "best map": percent(row["best_saving"]),
        "difference": f"{row['difference_minutes']:+.2f}",
        "difference 95 %": f"{less:+.2f} to {more:+.2f}",
        "regret": percent(row["regret"], 2),
        "regret 95 %": f"{100 * regret_low:.2f} to {100 * regret_high:.2f}",
        "arrive": percent(row["arrival_rate"]),
        "µs a decision": f"{row['decision_us']:,.1f}",
    }
    return {column: every[column] for column in columns or PAPER_COLUMNS}


def percent(share: float, digits: int = 1) -> str:
    """A share as people read it."""
    return f"{100 * share:.{digits}f} %"


def _units(minutes: Float[np.ndarray, "map walk"]) -> Float[np.ndarray, " unit"]:
    """What is resampled: maps, or the walks of the only map."""
    return minutes[0] if len(minutes) == 1 else minutes.mean(axis=1)


def _interval(resampled: Float[np.ndarray, " resample"]) -> list[float]:
    return [float(bound) for bound in np.percentile(resampled, [2.5, 97.5])]
