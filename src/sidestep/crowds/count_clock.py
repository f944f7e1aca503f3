"""When counts were counted, by the clock of their place: UTC offsets, intervals, hours skipped and hours twice."""

from dataclasses import dataclass, replace
from reprlib import repr as quoted

import numpy as np

from sidestep.crowds import repairs as fix
from sidestep.crowds.column_roles import Roles
from sidestep.crowds.columns import typical_step
from sidestep.crowds.count_entries import Entries, Rows
from sidestep.crowds.dates import DAY, HOUR, WrittenTimes, read_times
from sidestep.crowds.layouts import Layout
from sidestep.crowds.sheets import Sheet
from sidestep.crowds.wall_time import clock_changes, timezones_going_back, wall_seconds

_LONGEST_GAP = 366 * DAY  # more is a mistyped year, and would fill the memory with NaN
_MOST_CHANGES = 200  # hours that come twice in one file
_OFFSET_BITS = 18  # for the seconds that two clocks are apart, up to 36 hours either way


@dataclass(frozen=True, eq=False)
class Clock:
    """When each row was counted, and hours that the clock goes through twice."""

    wall: Rows
    """Seconds since 1970 as the clock shows them."""
    instant: Rows
    """The same in an order that clock changes do not disturb, where the file tells it."""
    step: int
    """Seconds that each row counts."""
    said: tuple[str, ...]
    """How times were read, in words."""
    twice: frozenset[int] = frozenset()
    """Hours since 1970 that come twice."""


def read_clock(sheet: Sheet, roles: Roles, layout: Layout) -> Clock:
    """Read when rows were counted, by the clock of the place.

    Parameters
    ----------
    sheet, roles, layout
        The file, which of its columns is for what, and what is said of it.

    Returns
    -------
    Clock
        Of intervals of which a whole number makes up an hour.

    Raises
    ------
    SidestepError
        Of the sheet's type: times that are not understood, longer intervals, times between them, times in UTC where no
        timezone is known.
    """
    written = read_times(sheet, roles.when, layout.date_format)
    name, said = roles.when[0], list(written.understood)
    wall = instant = written.seconds
    if written.offset is not None:
        instant = wall - written.offset
        wall = _local(sheet, name, written, layout, said)
    every = np.unique(instant)
    steps = np.diff(every)
    if (steps > _LONGEST_GAP).any():
        row = int(np.argmax(instant == every[1:][np.argmax(steps > _LONGEST_GAP)]))
        raise sheet.refuse(row, name, "this time is more than a year after the one before")
    step = typical_step(every) if len(every) > 1 else HOUR
    if step > HOUR or HOUR % step or step < 60:
        if step % DAY == 0:
            hours = "these are totals of days" if step == DAY else f"these are totals of {step // DAY} days"
            raise sheet.error(f"{sheet.source}: {hours}; hours are needed, or shorter intervals", field=name)
        apart = f"{step // HOUR} hours" if step % HOUR == 0 else f"{step / 60:g} minutes"
        said_so = f"times are {apart} apart; give hourly counts, or intervals that make up hours"
        raise sheet.error(f"{sheet.source}: {said_so}", field=name)
    if written.ends:
        wall, instant = wall - step, instant - step
    off = wall % step != 0
    if off.any():
        row = int(np.argmax(off))
        where = "on the hour" if step == HOUR else f"a whole number of {step // 60} minutes after the hour"
        local = f"{np.datetime64(int(wall[row]), 's')} is not {where}; give hourly counts"
        raise sheet.refuse(row, name, local)
    return Clock(wall, instant, step, tuple(said))


def _local(sheet: Sheet, name: str, written: WrittenTimes, layout: Layout, said: list[str]) -> Rows:
    """The wall times of times with offsets."""
    offset = written.offset
    assert offset is not None  # noqa: S101 - for the type checker
    if layout.timezone is not None:
        said.append(f"times with UTC offsets, turned into local time of {layout.timezone}")
        return wall_seconds(written.seconds - offset, layout.timezone)
    if not offset.any():
        raise sheet.refuse(0, name, "times are in UTC; give the place's timezone, such as --timezone Europe/Helsinki")
    several = ", ".join(
        f"{'-' if each < 0 else '+'}{abs(each) // HOUR:02}:{abs(each) // 60 % 60:02}" for each in np.unique(offset)
    )
    said.append(f"local times as written, at UTC offsets {several}")
    return written.seconds


def with_doubled_hours(sheet: Sheet, roles: Roles, layout: Layout, clock: Clock, entries: Entries) -> Clock:
    """Recognise the hours that clocks go through twice.

    With UTC offsets they are known. Without, a sensor has two counts of one time, in an hour in which the clock of the
    place, or, where its timezone is not known, of any place, goes back.

    Parameters
    ----------
    sheet, roles, layout
        The file, which of its columns is for what, and what is said of it.
    clock, entries
        Times and counts of its rows.

    Returns
    -------
    Clock
        The same, with these hours.

    Raises
    ------
    SidestepError
        Of the sheet's type: other times that come twice.
    """
    pairs = np.unique((clock.wall << _OFFSET_BITS) + (clock.wall - clock.instant) + (1 << _OFFSET_BITS - 1))
    shown = pairs >> _OFFSET_BITS  # hours may begin at half hours of UTC
    twice = set((shown[1:][shown[1:] == shown[:-1]] // HOUR).tolist())
    key = np.stack([entries.part, clock.instant[entries.row]])
    order = np.lexsort((entries.row, *key))
    same = (key[:, order[1:]] == key[:, order[:-1]]).all(axis=0)
    again = order[1:][same]
    if not len(again):
        return replace(clock, twice=frozenset(twice))
    hours = np.unique(clock.instant[entries.row[again]] // HOUR)
    thrice = (same[1:] & same[:-1]).any()
    possible = len(hours) <= _MOST_CHANGES and not thrice and (clock.wall == clock.instant).all()
    zones = timezones_going_back(hours.astype("datetime64[h]")) if possible else []
    if not zones or (layout.timezone is not None and layout.timezone not in zones):
        first = again[np.argmin(entries.row[again])]
        row, sensor = int(entries.row[first]), entries.sensors[entries.sensor_of[entries.part[first]]]
        whose = f" of {quoted(sensor)}" if roles.sensor else ""
        column, rows = ("direction", "directions") if roles.sensor else ("sensor", "sensors")
        hint = "" if roles.direction else f"; if rows are {rows}, name their column by --columns {column}=…"
        time = np.datetime64(int(clock.wall[row]), "s")
        raise sheet.refuse(row, roles.when[0], f"a second count{whose} at {time}, where no clock goes back{hint}")
    said = f"clocks go back as in {zones[0]} and {len(zones) - 1} other timezones"
    known = layout.timezone is not None
    return replace(clock, twice=frozenset(twice | set(hours.tolist())), said=(*clock.said, *([] if known else [said])))


def check_order(sheet: Sheet, name: str, clock: Clock) -> None:
    """Refuse rows of a wide table that are not in order, the oldest first or the newest first."""
    once = np.flatnonzero(~np.isin(clock.instant // HOUR, list(clock.twice)))
    steps = np.diff(clock.instant[once])
    if (steps < 0).any() and not (len(steps) > 1 and (steps < 0).all()):
        down = int(np.argmax(steps < 0))
        raise sheet.refuse(int(once[down + 1]), name, "this time does not come after the one in the line before")


def check_skipped(sheet: Sheet, name: str, clock: Clock, timezone: str, times: fix.Times, counts: fix.Counts) -> None:
    """Refuse people who were counted in an hour that the clock skips: the file has another clock."""
    for hour in clock_changes(timezone, times)[0]:
        at = int((hour - times[0]).astype(np.int64))
        if np.nansum(counts[at]) > 0:
            row = int(np.argmax(clock.wall // HOUR == hour.astype(np.int64)))
            said = f"people are counted from {hour}:00 on, which does not exist in {timezone}"
            raise sheet.refuse(row, name, f"{said}; the file's times are of another timezone, or in UTC or winter time")
