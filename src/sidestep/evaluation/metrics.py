"""The measures of a comparison: means, savings, gaps and differences, with bootstrap intervals."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NotRequired, TypedDict

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float

from sidestep.environment.types import Level
from sidestep.planners.registry import BASELINE, BOUND, REFERENCE

RESAMPLES = 2_000
"""Number of bootstrap resamples behind each interval."""


class Record(eqx.Module):
    """How one planner's walks went. Walks are paired with those of the other planners, map by map."""

    level: Level = eqx.field(static=True)
    """What the planner knows."""

    minutes: Float[np.ndarray, "*walks"]
    """Travel times; the horizon where a walk did not arrive."""

    arrived: Bool[np.ndarray, "*walks"]
    """Which walks arrived by the horizon."""

    cost: Float[np.ndarray, "*walks"]
    """What planners are judged by, in minutes: travel times, or what the objective makes of them."""

    totals: dict[str, Float[np.ndarray, "*walks"]] = eqx.field(default_factory=dict)
    """Under an objective: ``exposure`` (crowd met, person·s/m²), ``metres``, and ``too_dense`` (streets entered above
    the maximum density); empty where time is all that counts."""

    @property
    def maps(self) -> int:
        """Number of maps walked: the first ones of the comparison."""
        return len(self.minutes)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers and lists of them, from which :meth:`of_json` makes the same record to the bit."""
        arrays = {"minutes": self.minutes, "arrived": self.arrived, "cost": self.cost}
        totals = {name: total.tolist() for name, total in self.totals.items()}
        return {"level": self.level, **{name: array.tolist() for name, array in arrays.items()}, "totals": totals}

    @classmethod
    def of_json(cls, found: dict[str, Any]) -> "Record":
        """The record of which :meth:`to_json` made this."""
        minutes, arrived, cost = (np.asarray(found[name]) for name in ("minutes", "arrived", "cost"))
        totals = {name: np.asarray(total) for name, total in found["totals"].items()}
        return cls(found["level"], minutes, arrived, cost, totals)


def join_records(records: Sequence[Record], join: Callable[[Sequence[np.ndarray]], np.ndarray]) -> Record:
    """Join the walks of one planner's records.

    Parameters
    ----------
    records
        Of one planner, all under the same objective.
    join
        Joins arrays, one of each record.

    Returns
    -------
    Record
        All walks, at the level of the first record.
    """
    alike = (replace(record, level=records[0].level) for record in records)
    return jax.tree.map(lambda *arrays: join(arrays), *alike)


class Spread(TypedDict):
    """How much single walks differ."""

    median_minutes: float
    """Median of single walks."""

    p90_minutes: float
    """Minutes within which nine walks in ten are done."""

    arrive_by: float | None
    """Share of the walks that arrive within the minutes asked about."""


class Row(Spread):
    """One planner in ``results.json``. Intervals are 95 % and [low, high]; rates, savings and gaps are fractions.

    With an objective, savings, gaps, regrets and differences are those of costs.
    """

    level: Level
    maps: int
    mean_minutes: float
    ci95: list[float]

    saving_vs_shortest_path: float | None
    """1 - mean / mean of ``shortest-path``; None where one of its walks did not arrive, for the horizon is no time."""

    best_saving: float | None
    """Saving on the map (on the walk, if there is one map) where it is largest; None as above."""

    gap: float
    """Mean / mean of ``clairvoyant`` - 1: how far the planner stays behind the bound."""

    gap_ci95: list[float]

    regret_minutes: float
    """Mean less that of ``clairvoyant``: the same distance, in minutes."""

    arrival_rate: float

    difference_minutes: float
    """Mean less that of the baseline, by default ``expected``: below zero where faster."""

    difference_ci95: list[float]
    """Of paired differences."""

    mean_cost_minutes: NotRequired[float]
    """Only with an objective, as the three after it."""

    mean_exposure: NotRequired[float]
    """Crowd met, person·s/m²."""

    mean_metres: NotRequired[float]

    mean_too_dense: NotRequired[float]
    """Streets entered above the maximum density on each walk."""


def summarise(
    records: Mapping[str, Record],
    seed: int = 0,
    by: float | None = None,
    baseline: str = BASELINE,
    horizon: float = math.inf,
    resamples: int = RESAMPLES,
) -> dict[str, Row]:
    """Sum up walks in one row for each planner.

    Intervals are 95 % percentile bootstraps that resample whole maps, or walks where there is one map. The same
    resamples serve every planner, so ratios and differences are paired. A row that covers fewer maps is set against
    the same maps of the others.

    Parameters
    ----------
    records
        Walks by planner. ``shortest-path``, ``clairvoyant`` and the baseline are among them.
    seed
        Seed of the resamples.
    by
        Minutes that ``arrive_by`` asks about.
    baseline
        The planner that differences are taken to.
    horizon
        Minutes after which walks are given up.
    resamples
        How many intervals are of; they take most of the time, and one is enough where no interval is looked at.

    Returns
    -------
    dict of Row
        By planner.
    """
    references = [records[name] for name in (REFERENCE, BOUND, baseline)]
    return {name: _row(record, references, seed, by, horizon, resamples) for name, record in records.items()}


def _row(
    record: Record, references: Sequence[Record], seed: int, by: float | None, horizon: float, resamples: int
) -> Row:
    minutes, cost = _units(record.minutes), _units(record.cost)
    shortest, bound, baseline = (_units(reference.cost[: record.maps]) for reference in references)
    again = np.random.default_rng(seed).integers(len(cost), size=(resamples, len(cost)))
    means, bounds = cost[again].mean(axis=1), bound[again].mean(axis=1)
    saved = bool(references[0].arrived[: record.maps].all())
    single = spread(record.minutes, record.arrived, by, horizon)
    row: Row = {
        "level": record.level,
        "maps": record.maps,
        "mean_minutes": float(minutes.mean()),
        "ci95": _interval(minutes[again].mean(axis=1)),
        "saving_vs_shortest_path": float(1 - cost.mean() / shortest.mean()) if saved else None,
        "best_saving": float(1 - (cost / shortest).min()) if saved else None,
        "gap": float(cost.mean() / bound.mean() - 1),
        "gap_ci95": _interval(means / bounds - 1),
        "regret_minutes": float(cost.mean() - bound.mean()),
        "arrival_rate": float(record.arrived.mean()),
        "median_minutes": single["median_minutes"],
        "p90_minutes": single["p90_minutes"],
        "arrive_by": single["arrive_by"],
        "difference_minutes": float(cost.mean() - baseline.mean()),
        "difference_ci95": _interval(means - baseline[again].mean(axis=1)),
    }
    if record.totals:
        row["mean_cost_minutes"] = float(cost.mean())
        row["mean_exposure"] = float(record.totals["exposure"].mean())
        row["mean_metres"] = float(record.totals["metres"].mean())
        row["mean_too_dense"] = float(record.totals["too_dense"].mean())
    return row


def spread(
    minutes: Float[np.ndarray, "*walks"],
    arrived: Bool[np.ndarray, "*walks"],
    by: float | None,
    horizon: float = math.inf,
) -> Spread:
    """Describe how much single walks differ.

    Parameters
    ----------
    minutes, arrived
        Travel times, and which walks arrived.
    by
        Minutes to arrive within; None if nobody asks.
    horizon
        Minutes as which later arrivals count: these are never in time.

    Returns
    -------
    Spread
        Median, 90 % quantile, and the share that arrives in time.
    """
    return {
        "median_minutes": float(np.median(minutes)),
        "p90_minutes": float(np.quantile(minutes, 0.9)),
        "arrive_by": None if by is None else float(in_time(minutes, arrived, by, horizon).mean()),
    }


def in_time(
    minutes: Float[np.ndarray, "*walks"], arrived: Bool[np.ndarray, "*walks"], by: float, horizon: float
) -> Bool[np.ndarray, "*walks"]:
    """Say which walks arrive within some minutes.

    Parameters
    ----------
    minutes, arrived, by, horizon
        As for :func:`spread`.

    Returns
    -------
    Bool[np.ndarray, "*walks"]
        Whether each is in time.
    """
    return arrived & (minutes <= by) & (minutes < horizon)


def percent(share: float | None, digits: int = 1) -> str:
    """Format a share in per cent; None, which is not known, is a dash."""
    return "–" if share is None else f"{100 * share:.{digits}f} %"


_COLUMNS: dict[str, tuple[str, Callable[[Row], str]]] = {
    "knows": ("knows", lambda row: row["level"]),
    "cost": ("cost", lambda row: f"{row.get('mean_cost_minutes', row['mean_minutes']):.1f}"),
    "minutes": ("minutes", lambda row: f"{row['mean_minutes']:.1f}"),
    "minutes 95 %": ("95 %", lambda row: "{:.1f} to {:.1f}".format(*row["ci95"])),
    "exposure": ("exposure", lambda row: f"{row.get('mean_exposure', math.nan):,.0f}"),
    "metres": ("metres", lambda row: f"{row.get('mean_metres', math.nan):,.0f}"),
    "too dense": ("too dense", lambda row: f"{row.get('mean_too_dense', math.nan):.2f}"),
    "median": ("median", lambda row: f"{row['median_minutes']:.1f}"),
    "90 %": ("90 % in", lambda row: f"{row['p90_minutes']:.1f}"),
    "in time": ("in time", lambda row: "" if row["arrive_by"] is None else percent(row["arrive_by"])),
    "saved": ("saved", lambda row: percent(row["saving_vs_shortest_path"])),
    "best map": ("best map", lambda row: percent(row["best_saving"])),
    "difference": ("over `expected`", lambda row: f"{row['difference_minutes']:+.2f}"),
    "difference 95 %": ("95 %", lambda row: "{:+.2f} to {:+.2f}".format(*row["difference_ci95"])),
    "gap": ("over the clairvoyant", lambda row: percent(row["gap"], 2)),
    "gap 95 %": ("95 %", lambda row: "{:.2f} to {:.2f}".format(*(100 * bound for bound in row["gap_ci95"]))),
    "arrive": ("arrive", lambda row: percent(row["arrival_rate"])),
}
"""What is written above each column after that of the planner, and how each row's cell in it."""

HEADINGS = {"planner": "planner"} | {column: heading for column, (heading, _) in _COLUMNS.items()}
"""Columns of tables, in their usual order, and what is written above them."""

TEXT_COLUMNS = ("planner", "knows")
"""Columns that hold text; all others hold numbers."""

PAPER_COLUMNS = ("planner", "knows", "minutes", "minutes 95 %", "saved", "best map", "gap", "gap 95 %", "arrive")
"""Columns of the tables about the paper."""


def cells(name: str, row: Row, maps: int, columns: Iterable[str] = PAPER_COLUMNS) -> dict[str, str]:
    """Format one planner's row for people.

    Parameters
    ----------
    name, row
        The planner and its row.
    maps
        Number of maps of the comparison; rows that cover fewer say so.
    columns
        Which columns to show, in this order.

    Returns
    -------
    dict of str
        Texts by column.
    """
    fewer = "1 map" if row["maps"] == 1 else f"{row['maps']} maps"
    planner = name if row["maps"] == maps else f"{name} ({fewer})"
    return {column: planner if column == "planner" else _COLUMNS[column][1](row) for column in columns}


def markdown_table(rows: Mapping[str, Row], maps: int, columns: Sequence[str] = PAPER_COLUMNS) -> str:
    """Format rows as a table in Markdown.

    Parameters
    ----------
    rows
        By planner.
    maps, columns
        As for :func:`cells`.

    Returns
    -------
    str
        The table's lines.
    """
    lines = [
        [HEADINGS[column] for column in columns],
        ["---" if column in TEXT_COLUMNS else "--:" for column in columns],
        *(list(cells(name, row, maps, columns).values()) for name, row in rows.items()),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _units(minutes: Float[np.ndarray, "map walk"]) -> Float[np.ndarray, " unit"]:
    """The units that are resampled: means of maps, or the walks of the only map."""
    return minutes[0] if len(minutes) == 1 else minutes.mean(axis=1)


def _interval(resampled: Float[np.ndarray, " resample"]) -> list[float]:
    if len(resampled) == 1:  # nobody looks at it, and percentiles take longer than all else
        return 2 * [float(resampled[0])]
    return [float(bound) for bound in np.percentile(resampled, [2.5, 97.5])]
