"""Tables of crowds by hand: what the columns mean, what is filled, and files that are refused."""

from datetime import datetime
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from sidestep.crowds import columns, table_reader
from sidestep.crowds.crowd_table import CrowdTable, TableError
from sidestep.crowds.table_reader import read_table
from sidestep.network.town import Town


def dense(table: CrowdTable) -> dict[int, list[float]]:
    return {int(segment): table.value[:, column].tolist() for column, segment in enumerate(table.segment)}


@pytest.fixture
def read(tmp_path: Path, town: Town):
    def make(text: str, slot_seconds: float | None = None) -> CrowdTable:
        path = tmp_path / "t.csv"
        path.write_text(text, encoding="utf-8")
        return read_table(path, town, slot_seconds)

    return make


@pytest.fixture
def read_parquet(tmp_path: Path, town: Town):
    def make(columns: dict) -> CrowdTable:
        path = tmp_path / "t.parquet"
        parquet.write_table(pa.table(columns), path)
        return read_table(path, town)

    return make


# --- What the columns mean ------------------------------------------------------------------------------------------


def test_streets_with_and_without_a_direction(read) -> None:
    table = read("street,direction,slot,volume\n0,forward,0,5\n0,backward,0,7\n1,,0,2\n2,,0,9.5\n")
    # street 1 is walked one way only; the volume of street 2 is met in both directions
    assert dense(table) == {0: [5], 1: [2], 2: [9.5], 4: [7], 5: [9.5]}
    assert (table.quantity, table.slot_seconds, table.begins, table.rows) == ("volume", 300, None, 4)
    assert [(repair.kind, repair.number) for repair in table.repairs] == [("not mentioned", 2)]


def test_segments_and_crossings(read) -> None:
    assert dense(read("segment,slot,speed\n6,0,1.25\n1,0,0\n")) == {1: [0], 6: [1.25]}
    assert dense(read("FROM, To ,slot,density\n11,10,0,1\n10,11,0,2\n11,12,0,3\n")) == {0: [2], 1: [3], 4: [1]}


def test_gaps_are_filled_linearly_and_held_at_the_ends(read) -> None:
    table = read("segment,slot,volume\n0,1,10\n0,4,40\n1,0,1\n1,5,1\n")
    assert dense(table) == {0: [10, 10, 20, 30, 40, 40], 1: [1] * 6}
    # segment 0 lacks slots 0, 2, 3 and 5, segment 1 slots 1 to 4
    assert [(repair.kind, repair.number) for repair in table.repairs] == [("gap", 8), ("not mentioned", 5)]


def test_times_become_slots(read) -> None:
    text = "segment,time,volume\n0,2025-05-24T12:00,1\n0,2025-05-24T12:15,2\n0,2025-05-24 12:30:00,3\n"
    table = read(text + "0,2025-05-24T13:00,5\n1,2025-05-24T12:15,8\n")
    assert dense(table) == {0: [1, 2, 3, 4, 5], 1: [8] * 5}
    assert (table.slot_seconds, table.begins) == (900, datetime.fromisoformat("2025-05-24T12:00"))


def test_the_length_of_a_slot_may_be_told(read) -> None:
    assert read("segment,slot,volume\n0,0,1\n", 60.0).slot_seconds == 60
    assert read("segment,time,volume\n0,2025-05-24T12:00,1\n", 60.0).slot_seconds == 60
    two = "segment,time,volume\n0,2025-05-24T12:00,1\n0,2025-05-24T12:05,1\n"
    assert read(two, 300.0).slot_seconds == 300
    with pytest.raises(TableError) as caught:
        read(two, 60.0)
    assert caught.value.field == "time"


def test_parquet_says_the_same_as_csv(read, read_parquet) -> None:
    csv = read("street,direction,time,volume\n0,forward,2025-05-24T12:00,5\n2,,2025-05-24T12:05,0.1\n")
    times = [datetime.fromisoformat("2025-05-24T12:00"), datetime.fromisoformat("2025-05-24T12:05")]
    others = {"street": [0, 2], "direction": ["forward", None], "volume": [5, 0.1]}
    for column in (
        ["2025-05-24T12:00", "2025-05-24T12:05"],
        *(pa.array(times, pa.timestamp(unit)) for unit in ("s", "ms", "us", "ns")),
    ):
        found = read_parquet({**others, "time": column})
        assert (dense(found), found.begins, found.repairs) == (dense(csv), csv.begins, csv.repairs)
    whole = {
        "street": pa.array([0.0, 2.0]),
        "volume": pa.array([5, 1], pa.uint8()),
        "slot": pa.array([0, 0], pa.int16()),
    }
    assert dense(read_parquet(whole)) == {0: [5], 2: [1], 4: [5], 5: [1]}


def test_columns_that_mean_nothing_are_named(read) -> None:
    assert read("segment,slot,volume,directon\n0,0,1,back\n").unused == ("directon",)


# --- What is refused ------------------------------------------------------------------------------------------------

HEAD = "segment,slot,volume\n0,0,1\n"
TIMES = "segment,time,volume\n0,2025-05-24T12:00,1\n0,2025-05-24T12:05,1\n"


@pytest.mark.parametrize(
    ("text", "line", "field"),
    [
        ("", None, None),
        ("segment,slot,volume\n", None, None),
        ("segment,slot,volume\n0,0\n", 2, None),
        ('segment,slot,volume\n0,0,"1\n', 2, None),
        ("segment,slot,volume,\n0,0,1,2\n", 1, None),
        ("segment,slot,SLOT,volume\n0,0,0,1\n", 1, "slot"),
        ("slot,volume\n0,1\n", None, "street"),
        ("street,segment,slot,volume\n0,0,0,1\n", None, "street"),
        ("from,slot,volume\n10,0,1\n", None, "from"),
        ("segment,direction,slot,volume\n0,forward,0,1\n", None, "direction"),
        ("segment,volume\n0,1\n", None, "slot"),
        ("segment,slot,time,volume\n0,0,2025-01-01,1\n", None, "slot"),
        ("segment,slot\n0,1\n", None, "volume"),
        ("segment,slot,volume,speed\n0,0,1,1\n", None, "volume"),
        (HEAD + "\n0,1,-0.5\n", 4, "volume"),
        (HEAD + "0,1,nan\n", 3, "volume"),
        (HEAD + "0,1,inf\n", 3, "volume"),
        (HEAD + "0,1,1_0\n", 3, "volume"),
        (HEAD + "0,1,many\n", 3, "volume"),
        (HEAD + "0,1,\n", 3, "volume"),
        (HEAD + "0,1,2e6\n", 3, "volume"),
        ("segment,slot,speed\n0,0,14\n", 2, "speed"),
        ("segment,slot,density\n0,0,21\n", 2, "density"),
        (HEAD + "7,1,1\n", 3, "segment"),
        (HEAD + "-1,1,1\n", 3, "segment"),
        (HEAD + "1.5,1,1\n", 3, "segment"),
        (HEAD + ",1,1\n", 3, "segment"),
        (HEAD + "9999999999999999999,1,1\n", 3, "segment"),
        (HEAD + "0,-1,1\n", 3, "slot"),
        (HEAD + "0,200000,1\n", 3, "slot"),
        (HEAD + "1,0,1\n0,0,1\n", 4, None),
        ("street,slot,volume\n4,0,1\n", 2, "street"),
        ("street,direction,slot,volume\n0,,0,1\n0,up,0,1\n", 3, "direction"),
        ("street,direction,slot,volume\n1,backward,0,1\n", 2, "direction"),
        ("street,direction,slot,volume\n0,,0,1\n0,backward,0,1\n", 3, None),
        ("from,to,slot,volume\n10,11,0,1\n10,13,0,1\n", 3, "to"),
        ("from,to,slot,volume\n9,11,0,1\n", 2, "from"),
        ("from,to,slot,volume\n12,11,0,1\n", 2, "to"),
        ("from,to,slot,volume\n10,12,0,1\n", 2, "to"),
        (TIMES + "0,2025-05-24T12:10+03:00,1\n", 4, "time"),
        (TIMES + "0,2025-05-24T12:10Z,1\n", 4, "time"),
        (TIMES + "0,noon,1\n", 4, "time"),
        (TIMES + "0,,1\n", 4, "time"),
        (TIMES + "0,2025-05-24T12:10:00.5,1\n", 4, "time"),
        (TIMES + "0,2025-05-24T12:12,1\n", 4, "time"),
        (TIMES + "1,2025-05-24T12:00,1\n0,2025-05-24T11:55,1\n", 5, "time"),
        (TIMES + "0,2025-05-24T12:05,1\n", 4, None),
        (TIMES + "0,2035-05-24T12:05,1\n", 4, "time"),
    ],
)
def test_bad_files_have_a_line_and_a_column(
    read, tmp_path: Path, text: str, line: int | None, field: str | None
) -> None:
    with pytest.raises(TableError) as caught:
        read(text)
    assert (caught.value.line, caught.value.field) == (line, field)
    said = str(caught.value)
    assert said.startswith(f"{tmp_path / 't.csv'}: ")
    assert line in (None, 1) or f"line {line}" in said
    assert "\n" not in said


def test_an_earlier_line_at_fault_is_named_too(read) -> None:
    for text, earlier in (
        (HEAD + "1,0,1\n0,0,1\n", "line 2"),
        (TIMES + "1,2025-05-24T12:00,1\n0,2025-05-24T11:55,1\n", "line 3"),
        ("street,direction,slot,volume\n2,,0,1\n0,,0,1\n0,backward,0,1\n", "line 3"),
    ):
        with pytest.raises(TableError, match=earlier):
            read(text)


@pytest.mark.parametrize(
    ("columns", "row", "field"),
    [
        ({"volume": [1.0, -2.0]}, 2, "volume"),
        ({"volume": [1.0, None]}, 2, "volume"),
        ({"volume": [1.0, float("nan")]}, 2, "volume"),
        ({"volume": [True, False]}, 1, "volume"),
        ({"slot": [0, None]}, 2, "slot"),
        ({"slot": [0.0, 0.5]}, 2, "slot"),
        ({"segment": [0, 9]}, 2, "segment"),
        ({"slot": [[0], [1]]}, 1, "slot"),
        ({"slot": [0, 0], "segment": [3, 3]}, 2, None),
    ],
)
def test_bad_parquet_has_a_row_and_a_column(read_parquet, columns: dict, row: int, field: str | None) -> None:
    with pytest.raises(TableError, match=f"row {row}") as caught:
        read_parquet({"segment": [0, 1], "slot": [0, 0], "volume": [1.0, 1.0], **columns})
    assert (caught.value.line, caught.value.field) == (row, field)


def test_parquet_with_a_time_zone_is_refused(read_parquet) -> None:
    time = pa.array([datetime.fromisoformat("2025-05-24")], pa.timestamp("s", "UTC"))
    with pytest.raises(TableError) as caught:
        read_parquet({"segment": [0], "time": time, "volume": [1.0]})
    assert (caught.value.line, caught.value.field) == (1, "time")


def test_files_that_are_none(tmp_path: Path, town: Town, monkeypatch) -> None:
    (tmp_path / "t.parquet").write_bytes(b"PAR1 not really PAR1")
    for name, said in (
        ("t.xlsx", r"\.csv or \.parquet"),
        ("t.csv", "no such file"),
        ("a\0b.csv", "null"),
        ("t.parquet", "not a Parquet file"),
    ):
        with pytest.raises(TableError, match=said):
            read_table(tmp_path / name, town)
    (tmp_path / "t.csv").write_bytes(b"segment,slot,volume\n\xff")
    with pytest.raises(TableError, match="byte 20"):
        read_table(tmp_path / "t.csv", town)
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(TableError, match=r"pip install 'sidestep\[parquet\]'"):
        read_table(tmp_path / "t.parquet", town)


def test_files_that_are_too_large(read, monkeypatch) -> None:
    monkeypatch.setattr(columns, "MOST_ROWS", 1)
    assert read(HEAD).rows == 1
    with pytest.raises(TableError, match="more than 1 rows"):
        read(HEAD + "0,1,1\n")
    monkeypatch.setattr(columns, "MOST_BYTES", 10)
    with pytest.raises(TableError, match="larger than"):
        read(HEAD)
    monkeypatch.undo()
    monkeypatch.setattr(table_reader, "MOST_CELLS", 5)
    with pytest.raises(TableError) as caught:
        read(HEAD + "1,2,1\n")
    assert (caught.value.line, caught.value.field) == (3, "slot")
