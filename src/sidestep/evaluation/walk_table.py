"""Single walks as a table, one row for each walk and planner, in memory and on disk."""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd

from sidestep.errors import SidestepError
from sidestep.evaluation.metrics import Record
from sidestep.files import output_folder, whole_file
from sidestep.scenarios.model import Scenario

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


def check_walks_file(path: Path) -> None:
    """Make sure, before long work begins, that walks can be written to a file; missing folders are made.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    SidestepError
        Another ending than .csv or .parquet, a folder, or Parquet without pyarrow (field ``walks_out``).
    OutputError
        Its folder cannot be written to.
    """
    ending = path.suffix.lower()
    if ending not in (".csv", ".parquet") or path.is_dir():
        raise SidestepError(f"--walks-out must be a file that ends in .csv or .parquet, not {path}", field="walks_out")
    if ending == ".parquet" and find_spec("pyarrow") is None:
        raise SidestepError(
            f"--walks-out {path}: Parquet takes pyarrow: pip install 'sidestep[parquet]'", field="walks_out"
        )
    output_folder(path.parent)


def save_walks(tables: Sequence[WalkTable], path: Path) -> None:
    """Write walks into one file, whole or not at all, in the format that the file's ending says.

    Parameters
    ----------
    tables
        The walks, such as those of several walkers.
    path
        The file, .csv or .parquet.

    Raises
    ------
    SidestepError
        As for :func:`check_walks_file`.
    """
    check_walks_file(path)
    table = pd.concat(tables, ignore_index=True)
    with whole_file(path) as temporary:
        if path.suffix.lower() == ".csv":
            table.to_csv(temporary, index=False, lineterminator="\n")
        else:
            table.to_parquet(temporary, index=False, engine="pyarrow")
