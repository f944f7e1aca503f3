"""Live counts: which are taken, and what the latest of them say. docs/live-counts.md has the rules."""

import math
import operator
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from itertools import pairwise
from typing import NoReturn

import numpy as np

from sidestep.crowds.count_entries import LARGEST_COUNT
from sidestep.crowds.counts import CountsError, LatestCounts, no_sensor
from sidestep.crowds.wall_time import local_time, timezone_of

HOUR = timedelta(hours=1)
SHORTEST, LONGEST = timedelta(minutes=1), HOUR
"""Intervals that may be counted."""
AHEAD = timedelta(minutes=5)
"""How far the end of a counted interval may be ahead of now: clocks differ."""
OLDEST = timedelta(days=7)
"""How long ago a counted interval may have begun."""
LEAST_COUNTED = timedelta(minutes=15)
"""A sensor that was counted for less of its last hour is not known."""
SILENT = timedelta(minutes=90)
"""A sensor is not known from this time after its last count on, nor from half an hour more after the middle of the
time in which it was counted: hourly counts may come half an hour late."""
LASTING = timedelta(minutes=5)
"""Steps in which it is found out how long counts tell something."""
DEPARTURES = 64
"""Departures for which is kept what crowds go on from."""
LOOKBACK = SILENT + HOUR + LONGEST
"""Counts that began earlier say nothing of now."""
_LONGEST_NAME = 200
_ROUNDING = 1e-6  # of sums of two directions


class LiveError(CountsError):
    """A live count that is not taken.

    Parameters
    ----------
    message, field, line
        As every :class:`~sidestep.errors.SidestepError` has them.
    row
        Which of several counts it is, from 1 on; None where there is one.
    """

    def __init__(
        self, message: str, *, field: str | None = None, line: int | None = None, row: int | None = None
    ) -> None:
        super().__init__(message, field=field, line=line)
        self.row = row


@dataclass(frozen=True)
class LiveCount:
    """What one sensor counted in an interval; sensor and begin say which count it is, whatever it says."""

    sensor: str
    begins: datetime
    """In UTC, aware."""
    seconds: float
    """Length of the interval."""
    persons: float
    """In both directions."""
    towards: float | None = None
    """Those in one direction, where they were counted apart."""
    away: float | None = None
    """Those in the other."""

    @property
    def ends(self) -> datetime:
        """End of the interval."""
        return self.begins + timedelta(seconds=self.seconds)


@dataclass(frozen=True)
class LiveCounts:
    """What the sensors of a place counted lately: crowds of departures soon go on from there."""

    counts: tuple[LiveCount, ...]
    """As :func:`latest` takes them."""
    timezone: str | None
    """IANA name of the place's timezone; None: not known."""

    def latest(self, sensors: Sequence[str], departure: datetime) -> LatestCounts | None:
        """What crowds go on from that walkers meet who set out at a local time; see :func:`latest`.

        Parameters
        ----------
        sensors
            Names of the place's sensors.
        departure
            Local wall time; of an hour that the clock shows twice the first is taken.

        Returns
        -------
        LatestCounts or None
            None where no sensor is known any more.
        """
        known, key = self._latest, (tuple(sensors), departure, departure.fold)  # times of a fold are equal
        with suppress(KeyError):
            return known[key]
        if len(known) >= DEPARTURES:
            known.clear()
        zone = UTC if self.timezone is None else timezone_of(self.timezone)
        known[key] = found = latest(self.counts, sensors, departure.replace(tzinfo=zone), self.timezone)
        return found

    @cached_property
    def _latest(self) -> dict[tuple[tuple[str, ...], datetime, int], LatestCounts | None]:
        """Each departure's, since many set out in the same minute."""
        return {}

    def lasts(self, sensors: Sequence[str], departure: datetime) -> float:
        """How long departures from a local time on know of any count.

        Parameters
        ----------
        sensors, departure
            As for :meth:`latest`.

        Returns
        -------
        float
            Seconds, in steps of :data:`LASTING`; 0 where no sensor is known.
        """
        step, times = LASTING.total_seconds(), 0
        while self.latest(sensors, departure + times * LASTING) is not None:
            times += 1
        return max(times - 1, 0) * step


def check_counts(counts: Sequence[LiveCount], sensors: Collection[str], now: datetime) -> None:
    """Refuse counts that cannot be right.

    Parameters
    ----------
    counts
        Posted together.
    sensors
        Names of the place's sensors.
    now
        By the clock of the place, aware.

    Raises
    ------
    LiveError
        The first that is wrong; ``field`` is ``sensor``, ``time``, ``seconds`` or ``count``.
    """
    names = list(sensors)
    known = frozenset(names)
    for row, count in enumerate(counts, 1):
        wrong = _wrong_sensor(count, names, known) or _wrong_interval(count, now) or _wrong_persons(count)
        if wrong:
            _refuse(counts, row, *wrong)
    _check_apart(counts)


def _refuse(counts: Sequence[LiveCount], row: int, field: str, said: str) -> NoReturn:
    several = len(counts) > 1
    raise LiveError(f"{f'row {row}: ' if several else ''}{said}", field=field, row=row if several else None)


def _wrong_sensor(count: LiveCount, names: Sequence[str], known: frozenset[str]) -> tuple[str, str] | None:
    if count.sensor in known:
        return None
    if len(count.sensor) > _LONGEST_NAME:
        return "sensor", f"sensor must be a name of at most {_LONGEST_NAME} characters, not of {len(count.sensor):,}"
    return "sensor", no_sensor("live counts", count.sensor, names)


def _wrong_interval(count: LiveCount, now: datetime) -> tuple[str, str] | None:
    shortest, longest = SHORTEST.total_seconds(), LONGEST.total_seconds()
    if not shortest <= count.seconds <= longest:
        return "seconds", f"seconds must be {shortest:g} to {longest:g}, not {count.seconds:g}"
    begins = count.begins.isoformat(timespec="seconds")
    if not now - OLDEST <= count.begins:
        said = f"{begins} is more than {OLDEST.days} days before {now.isoformat(timespec='seconds')}"
        return "time", f"time must be that of a recent count, but {said}"
    if count.begins > now + AHEAD - timedelta(seconds=count.seconds):
        said = f"the {count.seconds:g} s from {begins} on are not over at {now.isoformat(timespec='seconds')}"
        return "time", f"time must be that at which counting began, but {said}; check the clock and the UTC offset"
    return None


def _wrong_persons(count: LiveCount) -> tuple[str, str] | None:
    most = LARGEST_COUNT * count.seconds / 3600
    if not 0 <= count.persons <= most:
        said = f"0 to {most:,.0f} persons in {count.seconds:g} s"
        return "count", f"count must be {said}, not {count.persons:g}"
    if (count.towards is None) != (count.away is None):
        return "count", "towards and away must be given together"
    if count.towards is None or count.away is None:
        return None
    if not (count.towards >= 0 and count.away >= 0):
        return "count", f"towards and away must be 0 or more persons, not {count.towards:g} and {count.away:g}"
    if not math.isclose(count.towards + count.away, count.persons, rel_tol=_ROUNDING, abs_tol=_ROUNDING):
        parts = f"{count.towards:g} towards and {count.away:g} away"
        return "count", f"count must be the sum of both directions, but {count.persons:g} is not that of {parts}"
    return None


def _check_apart(counts: Sequence[LiveCount]) -> None:
    """Refuse intervals of a sensor that overlap: most likely they are shorter than is said, or of two directions."""
    rows: dict[str, list[int]] = {}
    for row, count in enumerate(counts, 1):
        rows.setdefault(count.sensor, []).append(row)
    for sensor, mine in rows.items():
        for first, second in pairwise(sorted(mine, key=lambda row: (counts[row - 1].begins, row))):
            before, after = counts[first - 1], counts[second - 1]
            begins = after.begins.isoformat(timespec="seconds")
            if before != after and before.begins == after.begins:
                said = f"{sensor!r} has two different counts from {begins} on, here and in row {first}"
                _refuse(counts, second, "time", f"{said}; give one, with towards and away if it is of both")
            if before != after and before.ends > after.begins:
                said = f"from {begins} on the {before.seconds:g} s of row {first} are not over"
                _refuse(counts, second, "seconds", f"{sensor!r} is counted twice: {said}; give their seconds")


def is_late(count: LiveCount, now: datetime) -> bool:
    """Whether a count is too old to say anything of now by itself; it is kept all the same.

    Parameters
    ----------
    count
        The count.
    now
        By the clock of the place, aware.

    Returns
    -------
    bool
        True from :data:`SILENT` after its end on.
    """
    return now - count.ends >= SILENT


def latest(
    counts: Iterable[LiveCount], sensors: Sequence[str], now: datetime, timezone: str | None
) -> LatestCounts | None:
    """What flows go on from: how many persons an hour each sensor counted in its last hour.

    The last hour of a sensor ends with its last interval that is over. Intervals that are partly in it count in part;
    where two overlap, the one that begins later is taken.

    Parameters
    ----------
    counts
        In any order; of several for one sensor and begin the last is taken. Those from :data:`LOOKBACK` before now on
        are enough.
    sensors
        Names of the place's sensors; counts of others are left out.
    now
        By the clock of the place, aware: that of the departure.
    timezone
        IANA name of the place's timezone; None: not known, and its clocks are taken to show UTC.

    Returns
    -------
    LatestCounts or None
        For each sensor, NaN where it is not known; None where none is.

    Examples
    --------
    >>> from datetime import UTC, datetime, timedelta
    >>> from sidestep.crowds.live import LiveCount, latest
    >>> noon = datetime(2025, 5, 24, 9, tzinfo=UTC)
    >>> counts = [LiveCount("Bridge", noon - timedelta(minutes=15 * number), 900.0, 30.0) for number in (1, 2)]
    >>> found = latest(counts, ["Bridge", "Quay"], noon, "Europe/Helsinki")
    >>> found.counts.tolist(), str(found.hour[0]), float(found.since[0])
    ([120.0, nan], '2025-05-24T11:15:00.000000', 0.25)
    """
    mine: dict[str, dict[datetime, LiveCount]] = {name: {} for name in sensors}
    for count in counts:
        if count.sensor in mine:
            mine[count.sensor][count.begins] = count
    found = [_in_last_hour(list(mine[name].values()), now) for name in sensors]
    if not any(found):
        return None
    half, here = HOUR / 2, _wall(now, timezone)
    # Hours of sensors that are not known are those of clocks: crowds are then as if nothing had been counted.
    full = (here - half).replace(minute=0, second=0, microsecond=0)
    unknown = math.nan, full, (here - half - full) / HOUR
    known = ((rate, _wall(middle, timezone) - half, (now - middle) / HOUR) for rate, middle in filter(None, found))
    rates, begins, since = zip(*(next(known) if each else unknown for each in found), strict=True)
    return LatestCounts(np.array(rates), np.array(begins, "datetime64[us]"), np.array(since))


def _in_last_hour(counts: list[LiveCount], now: datetime) -> tuple[float, datetime] | None:
    """Persons an hour in the last hour of one sensor, and the middle of the time in which it was counted."""
    done_by = now + AHEAD
    ends = [(each.ends, each) for each in counts]
    end = max((ended for ended, _ in ends if ended <= done_by), default=None)
    if end is None or now - end >= SILENT:
        return None
    first, hour = end - HOUR, round(HOUR.total_seconds())
    over = sorted((each for ended, each in ends if first < ended <= done_by), key=operator.attrgetter("begins"))
    whose = np.full(hour, -1)  # which count each second is of
    for number, each in enumerate(over):
        begun, done = (round((time - first).total_seconds()) for time in (each.begins, each.ends))
        whose[max(begun, 0) : max(done, 0)] = number
    counted = np.flatnonzero(whose >= 0)
    middle = first + timedelta(seconds=float(counted.mean()) + 0.5) if len(counted) else first
    if len(counted) < LEAST_COUNTED.total_seconds() or now - middle >= SILENT + HOUR / 2:
        return None
    seconds = np.bincount(whose[counted], minlength=len(over)).tolist()
    persons = math.fsum(each.persons * (part / each.seconds) for each, part in zip(over, seconds, strict=True))
    return persons * hour / len(counted), middle


def _wall(time: datetime, timezone: str | None) -> datetime:
    return time.astimezone(UTC).replace(tzinfo=None) if timezone is None else local_time(time, timezone)
