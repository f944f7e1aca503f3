"""Reading counts in any published layout into hours: sums of shorter intervals and of directions, clock changes.

What was understood is said in words, and what was changed is counted.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from sidestep.crowds import repairs as fix
from sidestep.crowds.column_roles import Roles, is_known, roles_of
from sidestep.crowds.count_clock import Clock, check_order, check_skipped, read_clock, with_doubled_hours
from sidestep.crowds.count_entries import Entries, read_entries
from sidestep.crowds.count_files import positions_within
from sidestep.crowds.dates import HOUR
from sidestep.crowds.layouts import Layout
from sidestep.crowds.sheets import Sheet, open_sheet
from sidestep.crowds.wall_time import clock_changes
from sidestep.errors import SidestepError

_MOST_CELLS = 2**26  # hours times columns


@dataclass(frozen=True, eq=False)
class HourlyCounts:
    """What a file says, hour by hour; nothing but clock changes is repaired."""

    times: fix.Times
    """Local wall time at which each hour starts."""
    sensors: tuple[str, ...]
    counts: fix.Counts
    """Persons/h; NaN where nothing, or not the whole hour, was counted."""
    repairs: tuple[fix.Repair, ...]
    explained: Bool[np.ndarray, " hour"]
    """Hours that are missing for a reason that a repair says."""
    understood: tuple[str, ...]
    """How the file was read, in words."""
    positions: Float[np.ndarray, "sensor 2"] | None
    """Latitude and longitude of the sensors in degrees, where the file has them."""


def read_hourly(path: Path, layout: Layout, error: type[SidestepError]) -> HourlyCounts:
    """Read a file of counts.

    Parameters
    ----------
    path
        Text with columns.
    layout
        What is said of it; the rest is recognised.
    error
        Type of the errors about it.

    Returns
    -------
    HourlyCounts
        With every hour from the first to the last.

    Raises
    ------
    SidestepError
        Of the type ``error``: a file that is not readable or not understood; ``field`` is the column, ``line`` the
        line.
    """
    sheet = open_sheet(path, error, partial(is_known, layout=layout))
    roles = roles_of(sheet, layout)
    clock = read_clock(sheet, roles, layout)
    entries, marks = read_entries(sheet, roles, layout)
    clock = with_doubled_hours(sheet, roles, layout, clock, entries)
    if not roles.sensor:
        check_order(sheet, roles.when[0], clock)
    times, counts, repairs, explained = _hours(sheet, roles, layout, clock, entries)
    if layout.timezone is not None:
        counts, changes = fix.repair_clocks(times, counts, layout.timezone)
        check_skipped(sheet, roles.when[0], clock, layout.timezone, times, counts)
        explained |= np.isnan(counts).all(axis=1) & np.isin(
            times, np.concatenate(clock_changes(layout.timezone, times))
        )
        repairs += changes
    said = [f"lines above the header skipped: {sheet.skipped}"] if sheet.skipped else []
    if sheet.aside:
        said.append(f"lines of units, totals and remarks skipped: {sheet.aside}")
    if sheet.delimiter != ",":
        said.append({";": "semicolons", "\t": "tabs", "|": "vertical bars"}[sheet.delimiter] + " between columns")
    if clock.step < HOUR:
        said.append(f"counts of {clock.step // 60} minutes summed to hours")
    understood = (*said, *roles.understood, *clock.said, *marks)
    sensor = entries.sensor_of[entries.part[: len(sheet.lines)]]
    positions = positions_within(sheet, roles.place, sensor, entries.sensors)
    return HourlyCounts(times, entries.sensors, counts, tuple(repairs), explained, understood, positions)


def _hours(
    sheet: Sheet, roles: Roles, layout: Layout, clock: Clock, entries: Entries
) -> tuple[fix.Times, fix.Counts, list[fix.Repair], Bool[np.ndarray, " hour"]]:
    """Sum up hours.

    Returns
    -------
    times, counts, repairs, explained
        As :class:`HourlyCounts` has them.

    Raises
    ------
    SidestepError
        More hours than memory has room for.
    """
    first, last = int(clock.wall.min()) // HOUR, int(clock.wall.max()) // HOUR
    number, parts = last - first + 1, len(entries.sensor_of)
    if number * parts > _MOST_CELLS:
        said = f"{number:,} hours of {parts:,} columns or sensors are too many"
        raise sheet.error(f"{sheet.source}: {said}; name those that are needed", field=roles.when[0])
    hour = clock.wall // HOUR - first
    counted = np.isfinite(entries.value)
    cell = (hour[entries.row] * parts + entries.part)[counted]
    size = number * parts
    total = np.bincount(cell, entries.value[counted], size).reshape(number, parts)
    intervals = np.bincount(cell, minlength=size).reshape(number, parts)
    whole = HOUR // clock.step
    twice = np.array(sorted(each - first for each in clock.twice), np.int64)
    intervals[twice] = 0
    of_parts = np.where(intervals == whole, total, np.nan)
    begun = ((intervals > 0) & (intervals != whole)).any(axis=1)
    counts = np.stack([of_parts[:, entries.sensor_of == each].sum(axis=1) for each in range(len(entries.sensors))], 1)
    absent = np.ones(number, bool)
    absent[hour] = False
    times = (first + np.arange(number)).astype("datetime64[h]")
    if layout.timezone is not None:  # these are said with the clock changes
        absent &= ~np.isin(times, clock_changes(layout.timezone, times)[0])
    kept = _without_ragged_ends(counts, begun)
    repairs = _said_repairs(
        times[kept], absent[kept], clock.step, int(begun.sum()), clock.twice if layout.timezone is None else ()
    )
    explained = absent | (begun & np.isnan(counts).all(axis=1))
    explained[twice] = True
    return times[kept], counts[kept], repairs, explained[kept]


def _without_ragged_ends(counts: fix.Counts, begun: Bool[np.ndarray, " hour"]) -> slice:
    """Without hours at the ends that were not counted whole."""
    ragged = begun & np.isnan(counts).all(axis=1)
    if ragged.all():
        return slice(0, len(counts))
    return slice(int(np.argmin(ragged)), len(counts) - int(np.argmin(ragged[::-1])))


def _said_repairs(
    times: fix.Times, absent: Bool[np.ndarray, " hour"], step: int, incomplete: int, twice: Iterable[int]
) -> list[fix.Repair]:
    found = []
    if absent.any():
        detail = f"hours without a line, the first {times[absent.argmax()]}, are missing"
        found.append(fix.Repair("gap", None, int(absent.sum()), detail))
    if incomplete:
        detail = f"hours of which not all intervals of {step // 60} minutes were counted are missing"
        found.append(fix.Repair("incomplete hour", None, incomplete, detail))
    if hours := [str(np.datetime64(each, "h")) for each in sorted(twice)]:
        detail = f"the clock goes through {', '.join(hours)} twice: missing, not twice as many"
        found.append(fix.Repair("clock back", None, len(hours), detail))
    return found
