"""Single walks as a table, and on disk."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sidestep.errors import SidestepError
from sidestep.evaluation.compare import Comparison
from sidestep.evaluation.metrics import Record
from sidestep.evaluation.walk_table import save_walks
from sidestep.scenarios.builtin import scenario

PROBLEM = scenario("paper-congested")
CSV = """scenario,walker,seed,map,walk,planner,level,minutes,arrived
paper-congested,adult (1.34 m/s),7,4,0,expected,map,10.5,True
paper-congested,adult (1.34 m/s),7,4,1,expected,map,20.25,True
paper-congested,adult (1.34 m/s),7,2,0,expected,map,30.0,True
paper-congested,adult (1.34 m/s),7,2,1,expected,map,1440.0,False
paper-congested,adult (1.34 m/s),7,4,0,mine,position,11.0,True
paper-congested,adult (1.34 m/s),7,4,1,mine,position,12.0,True
"""


def record(level: str, minutes: list[list[float]], totals: dict[str, np.ndarray] | None = None) -> Record:
    times = np.array(minutes)
    return Record(level, times, times < 1440, 2 * times, totals or {})


@pytest.fixture
def compared() -> Comparison:
    """Two walks on maps 4 and 2, of which one planner walked the first only."""
    records = {
        "expected": record("map", [[10.5, 20.25], [30.0, 1440.0]]),
        "mine": record("position", [[11.0, 12.0]]),
    }
    return Comparison(PROBLEM, (4, 2), 2, 7, records)


def test_a_row_for_each_walk_and_planner(compared: Comparison, tmp_path: Path) -> None:
    save_walks([compared.to_frame()], tmp_path / "new" / "walks.csv")
    assert (tmp_path / "new" / "walks.csv").read_bytes().decode() == CSV
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["walks.csv"]


def test_parquet_holds_the_same(compared: Comparison, tmp_path: Path) -> None:
    table = compared.to_frame()
    save_walks([table, table], tmp_path / "walks.PARQUET")
    found = pd.read_parquet(tmp_path / "walks.PARQUET")
    pd.testing.assert_frame_equal(found, pd.concat([table, table], ignore_index=True))
    assert found["minutes"].dtype == np.float64
    assert (found["arrived"].dtype, found["map"].dtype) == (bool, np.int64)


def test_an_objective_has_its_cost_and_totals() -> None:
    names = ("exposure", "metres", "too_dense")
    totals = {name: np.full((1, 2), float(number)) for number, name in enumerate(names)}
    problem = PROBLEM.changed(objective={"exposure": 1.0})
    table = Comparison(problem, (0,), 2, 0, {"mine": record("map", [[5.0, 6.0]], totals)}).to_frame()
    assert table["cost_minutes"].tolist() == [10, 12]
    assert [table[name].tolist() for name in names] == [[0, 0], [1, 1], [2, 2]]
    assert list(table.columns[-4:]) == ["cost_minutes", *names]


@pytest.mark.parametrize("name", ["walks", "walks.xlsx", "walks.csv.gz", ".csv", "folder.csv"])
def test_other_files_are_refused(compared: Comparison, tmp_path: Path, name: str) -> None:
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(SidestepError) as caught:
        save_walks([compared.to_frame()], tmp_path / name)
    assert caught.value.field == "walks_out"
    assert [file.name for file in tmp_path.iterdir()] == ["folder.csv"]


def test_parquet_without_pyarrow_says_what_to_install(
    compared: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(SidestepError, match="pip install") as caught:
        save_walks([compared.to_frame()], tmp_path / "walks.parquet")
    assert caught.value.field == "walks_out"
    assert list(tmp_path.iterdir()) == []
