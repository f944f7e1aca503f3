"""Walks and results as tables, in memory and on disk: a row for each walk and planner, or for each planner."""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd

from sidestep.errors import SidestepError
from sidestep.evaluation.compare import Results
from sidestep.evaluation.metrics import Record, Row
from sidestep.files import output_folder, whole_file
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.walkers import ADULT, walker_in_words

WalkTable: TypeAlias = pd.DataFrame
"""One row for each walk and planner; see :meth:`sidestep.evaluation.compare.Comparison.to_frame`."""


def walk_table(scenario: Scenario, seed: int, maps: Sequence[int], records: Mapping[str, Record]) -> WalkTable:
    """Put walks into a table; see :meth:`sidestep.evaluation.compare.Comparison.to_frame`."""
    tables = []
    for planner, record in records.items():
        walked, each = record.minutes.shape
        costs = {"cost_minutes": record.cost, **record.totals} if record.totals else {}
        table = {
            "scenario": scenario.name,
            "walker": scenario.walker.in_words(),
            "seed": seed,
            "map": np.repeat(maps[:walked], each),
            "walk": np.tile(np.arange(each), walked),
            "planner": planner,
            "level": record.level,
            "minutes": record.minutes.ravel(),
            "arrived": record.arrived.ravel(),
            **{name: values.ravel() for name, values in costs.items()},
        }
        tables.append(pd.DataFrame(table))
    return pd.concat(tables, ignore_index=True)


def results_table(results: Sequence[Results]) -> pd.DataFrame:
    """Put the results of comparisons into a table, one row for each planner of each.

    Parameters
    ----------
    results
        What :meth:`sidestep.evaluation.compare.Comparison.to_json` returns.

    Returns
    -------
    pandas.DataFrame
        Columns ``scenario``, ``flows``, ``walker``, ``seed``, ``walks``, ``baseline``, ``by_minutes``, ``planner`` and
        the fields of :class:`~sidestep.evaluation.metrics.Row`; of an interval ``ci95`` there are ``ci95_low`` and
        ``ci95_high``.
    """
    rows = []
    for each in results:
        of = {name: each[name] for name in ("scenario", "flows", "seed", "walks", "baseline", "by_minutes")}
        of["walker"] = walker_in_words(each["walker"] or ADULT.model_dump())
        for planner, row in each["planners"].items():
            rows.append({**of, "planner": planner, **_without_intervals(row)})
    table = pd.DataFrame(rows)
    # What is None everywhere would have no type.
    return table.astype({"by_minutes": float, **dict.fromkeys(_MAY_BE_NONE, float)})


_MAY_BE_NONE = ("saving_vs_shortest_path", "best_saving", "arrive_by")


def _without_intervals(row: Row) -> dict[str, object]:
    flat: dict[str, object] = {}
    for name, value in row.items():
        flat |= {f"{name}_low": value[0], f"{name}_high": value[1]} if isinstance(value, list) else {name: value}
    return flat


def check_table_file(path: Path, field: str) -> None:
    """Make sure, before long work begins, that a table can be written to a file; missing folders are made.

    Parameters
    ----------
    path, field
        The file, and the parameter that it is of.

    Raises
    ------
    SidestepError
        Another ending than .csv or .parquet, a folder, or Parquet without pyarrow, with the parameter as its field.
    OutputError
        Its folder cannot be written to.
    """
    ending, option = path.suffix.lower(), f"--{field.replace('_', '-')}"
    if ending not in (".csv", ".parquet") or path.is_dir():
        raise SidestepError(f"{option} must be a file that ends in .csv or .parquet, not {path}", field=field)
    if ending == ".parquet" and find_spec("pyarrow") is None:
        raise SidestepError(f"{option} {path}: Parquet takes pyarrow: pip install 'sidestep[parquet]'", field=field)
    output_folder(path.parent)


def save_tables(tables: Sequence[pd.DataFrame], path: Path, field: str) -> None:
    """Write tables into one file, whole or not at all, in the format that the file's ending says.

    Parameters
    ----------
    tables
        Such as the walks of several walkers, or results.
    path, field
        The file, .csv or .parquet, and the parameter that it is of.

    Raises
    ------
    SidestepError
        As for :func:`check_table_file`.
    """
    check_table_file(path, field)
    table = pd.concat(tables, ignore_index=True)
    with whole_file(path) as temporary:
        if path.suffix.lower() == ".csv":
            table.to_csv(temporary, index=False, lineterminator="\n")
        else:
            table.to_parquet(temporary, index=False, engine="pyarrow")
