"""Positions beside counts, and counts written as they were understood."""

from pathlib import Path

import numpy as np
import pytest

from sidestep.crowds.count_files import check_out, positions_path, save_counts
from sidestep.crowds.counts import CountsError, CountTable, read_counts
from sidestep.files import OutputError

COUNTS = "time,Quay,Hall\n2024-03-04T00,1.5,\n2024-03-04T01,,3\n2024-03-04T03,1e5,0.1\n"


@pytest.fixture
def counts(tmp_path: Path) -> Path:
    (tmp_path / "c.csv").write_text(COUNTS)
    return tmp_path / "c.csv"


def beside(counts: Path, text: str) -> CountTable:
    positions_path(counts).write_text(text)
    return read_counts(counts)


@pytest.mark.parametrize(
    ("read", "out"),
    [
        ("c.csv", "c.csv"),
        ("c.csv", "c.positions.csv"),
        ("c.csv", "new.positions.csv"),
        ("c.csv", "new.Positions.CSV"),
        (None, "new.positions.csv"),
        ("c.csv", "c.txt"),
        ("c.csv", "link.csv"),
        ("c.csv", "other.csv"),  # whose positions are a link to those that are read
        ("c.positions.csv", "c.csv"),  # its positions would be written over what is read
    ],
)
def test_counts_are_not_written_over_what_is_read(
    counts: Path, monkeypatch: pytest.MonkeyPatch, read: str | None, out: str
) -> None:
    monkeypatch.chdir(counts.parent)
    positions_path(counts).touch()
    Path("link.csv").symlink_to("c.csv")
    Path("other.positions.csv").hardlink_to("c.positions.csv")
    given = None if read is None else Path(read)
    with pytest.raises(OutputError) as caught:
        check_out(Path(out), given)
    assert caught.value.field == "out"
    check_out(Path("new.csv"), given)


def test_positions_stand_beside_the_counts(counts: Path) -> None:
    assert positions_path(counts).name == "c.positions.csv"
    assert read_counts(counts).positions is None
    found = [[60.17, 24.94], [-60.5, 180]]
    for text in (
        "sensor,latitude,longitude\nHall,-60.5,180\nelsewhere,1,2\nQuay,60.17,24.94\n",
        "Lat;Lon;Sensor_Name\n60,17;24,94;Quay\n-60,5;180;Hall\n",
    ):
        table = beside(counts, text)
        assert table.positions is not None
        assert table.positions.tolist() == found


@pytest.mark.parametrize(
    ("text", "line", "field"),
    [
        ("sensor,latitude,longitude\nQuay,60,24\n", None, "Hall"),
        ("sensor,latitude\nQuay,60\nHall,61\n", None, "sensor"),
        ("place,latitude,longitude\nQuay,60,24\nHall,61,25\n", None, "sensor"),
        ("sensor,latitude,longitude\nQuay,60,24\nHall,144.9,-37.8\n", 3, "latitude"),  # swapped
        ("sensor,latitude,longitude\nQuay,60,24\nHall,61,181\n", 3, "longitude"),
        ("sensor,latitude,longitude\nQuay,60,24\nHall,,25\n", 3, "latitude"),
        ("sensor,latitude,longitude\nQuay,60,24\nHall,nan,25\n", 3, "latitude"),
        ("", None, None),
    ],
)
def test_positions_that_are_none(counts: Path, text: str, line: int | None, field: str | None) -> None:
    with pytest.raises(CountsError, match=r"c\.positions\.csv") as caught:
        beside(counts, text)
    assert (caught.value.line, caught.value.field) == (line, field)
    assert "\n" not in str(caught.value)


def test_the_file_beside_outranks_the_columns(counts: Path) -> None:
    counts.write_text("time,site,count,lat,lon\n2024-03-04T00,Quay,1,60,24\n2024-03-04T01,Quay,1,60,24\n")
    assert read_counts(counts).positions.tolist() == [[60, 24]]
    assert beside(counts, "sensor,latitude,longitude\nQuay,61,25\n").positions.tolist() == [[61, 25]]


def test_what_is_written_is_read_alike(counts: Path, tmp_path: Path) -> None:
    table = beside(counts, "sensor,latitude,longitude\nHall,-60.5,180\nQuay,60.17,24.94\n")
    save_counts(table, tmp_path / "clean.csv")
    again = read_counts(tmp_path / "clean.csv")
    for name in ("times", "counts", "positions"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))
    assert again.sensors == table.sensors
    assert (tmp_path / "clean.csv").read_text().splitlines()[:2] == ["time,Quay,Hall", "2024-03-04T00:00,1.5,"]
    assert {"gap"} == {repair.kind for repair in table.repairs} - {repair.kind for repair in again.repairs}
    with pytest.raises(OutputError) as caught:
        save_counts(table, tmp_path / "clean.txt")
    assert caught.value.field == "out"


def test_positions_of_others_are_not_left_beside_counts_without(counts: Path, tmp_path: Path) -> None:
    stale = tmp_path / "clean.positions.csv"
    stale.write_text("sensor,latitude,longitude\nQuay,60,24\nHall,61,25\n")
    with pytest.raises(OutputError, match=r"clean\.positions\.csv") as caught:
        save_counts(read_counts(counts), tmp_path / "clean.csv")
    assert caught.value.field == "out"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.csv", "clean.positions.csv"]
    located = beside(counts, "sensor,latitude,longitude\nQuay,1,2\nHall,3,4\n")
    save_counts(located, tmp_path / "clean.csv")
    assert read_counts(tmp_path / "clean.csv").positions.tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    "names",
    [
        "Quay in;Quay out",
        "Total;Quay;Hall",
        "time;b",
        "month;id",
        "sensor;count",
        "Quay  N;Hall",
        "temperature",
        'Q, "N";é',
    ],
)
def test_whatever_sensors_are_called_it_is_read_alike(tmp_path: Path, names: str) -> None:
    sensors = tuple(names.split(";"))
    times = np.arange("2024-03-04T00", "2024-03-04T05", dtype="datetime64[h]")
    counts = np.arange(5.0 * len(sensors)).reshape(5, -1)
    counts[2, 0] = np.nan
    save_counts(CountTable(times, sensors, counts, None, (), ""), tmp_path / "clean.csv")
    again = read_counts(tmp_path / "clean.csv")
    assert again.sensors == sensors
    np.testing.assert_array_equal(again.counts, counts)


def test_the_bundled_counts_are_written_with_their_positions(auckland: CountTable, tmp_path: Path) -> None:
    part = auckland.between("2024-04-06", "2024-04-09")
    save_counts(part, tmp_path / "a.csv")
    again = read_counts(tmp_path / "a.csv")
    np.testing.assert_array_equal(again.counts, part.counts)
    np.testing.assert_array_equal(again.positions, part.positions)
