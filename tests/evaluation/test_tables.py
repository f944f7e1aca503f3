"""Walks and results as tables, and on disk: pandas and DuckDB read the same."""

import sys
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import pytest

from sidestep.errors import SidestepError
from sidestep.evaluation.compare import Comparison, Results
from sidestep.evaluation.metrics import Record
from sidestep.evaluation.tables import results_table, save_tables
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
    save_tables([compared.to_frame()], tmp_path / "new" / "walks.csv", "walks_out")
    assert (tmp_path / "new" / "walks.csv").read_bytes().decode() == CSV
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["walks.csv"]


def test_parquet_holds_the_same(compared: Comparison, tmp_path: Path) -> None:
    table = compared.to_frame()
    save_tables([table, table], tmp_path / "walks.PARQUET", "walks_out")
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
        save_tables([compared.to_frame()], tmp_path / name, "walks_out")
    assert caught.value.field == "walks_out"
    assert [file.name for file in tmp_path.iterdir()] == ["folder.csv"]


def test_parquet_without_pyarrow_says_what_to_install(
    compared: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(SidestepError, match="pip install") as caught:
        save_tables([compared.to_frame()], tmp_path / "walks.parquet", "walks_out")
    assert caught.value.field == "walks_out"
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def results() -> list[Results]:
    """Three planners, without and with an objective, of whom one walked the first map only."""
    times = {"shortest-path": [[12.0, 24.0]] * 2, "expected": [[10.5, 20.25]] * 2, "clairvoyant": [[10.0, 20.0]] * 2}
    records = {name: record("map", minutes) for name, minutes in times.items()}
    totals = {name: np.ones((2, 2)) for name in ("exposure", "metres", "too_dense")}
    priced = {name: record("map", minutes, totals) for name, minutes in times.items()}
    problem = PROBLEM.changed(objective={"exposure": 1.0}, walker="older")
    return [
        Comparison(PROBLEM, (4, 2), 2, 7, records | {"mine": record("position", [[11.0, 12.0]])}).to_json(),
        Comparison(problem, (4, 2), 2, 7, priced).to_json(by=11.0, baseline="shortest-path"),
    ]


def test_a_row_for_each_planner(results: list[Results]) -> None:
    table = results_table(results)
    assert table["planner"].tolist() == [*results[0]["planners"], *results[1]["planners"]]
    assert table["walker"].unique().tolist() == ["adult (1.34 m/s)", "older (1.16 m/s)"]
    assert table["baseline"].tolist() == ["expected"] * 4 + ["shortest-path"] * 3
    rows = [row for each in results for row in each["planners"].values()]
    for name in ("mean_minutes", "gap", "arrival_rate", "maps", "level"):
        assert table[name].tolist() == [row[name] for row in rows]
    for end, name in enumerate(("ci95_low", "ci95_high")):
        assert table[name].tolist() == [row["ci95"][end] for row in rows]
    assert table["mean_exposure"].isna().tolist() == [True] * 4 + [False] * 3
    assert table["arrive_by"].isna().tolist() == [True] * 4 + [False] * 3
    assert table["by_minutes"].dtype == table["arrive_by"].dtype == np.float64


def test_duckdb_and_pandas_read_results_and_walks(compared: Comparison, results: list[Results], tmp_path: Path) -> None:
    for name, table in (("walks", compared.to_frame()), ("results", results_table(results[:1]))):
        file = tmp_path / f"{name}.parquet"
        save_tables([table], file, f"{name}_out")
        pd.testing.assert_frame_equal(pd.read_parquet(file), table)
        asked = "SELECT planner, count(*) AS walks FROM read_parquet($file) GROUP BY planner ORDER BY planner"
        found = duckdb.execute(asked, {"file": str(file)}).fetchall()
        assert found == sorted(table.groupby("planner").size().items())
    asked = "SELECT mean_minutes, arrive_by FROM read_parquet($file) WHERE planner = 'expected'"
    assert duckdb.execute(asked, {"file": str(file)}).fetchall()[0][0] == pytest.approx(15.375)
    typed = duckdb.execute("DESCRIBE SELECT * FROM read_parquet($file)", {"file": str(file)}).fetchall()
    assert {row[1] for row in typed} == {"VARCHAR", "BIGINT", "DOUBLE"}
