"""Which column of a file of counts says when, where and how many.

Columns are recognised by names that publishers use; what is not recognised must be named, never guessed. A *long* table
has one row for each sensor and time, a *wide* one a column for each sensor. docs/counts.md lists the names.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as quoted

from sidestep.crowds.column_names import (
    COUNTS,
    DATES,
    DIRECTIONS,
    HOURS,
    LATITUDES,
    LONGITUDES,
    NEVER_COUNTED,
    PAIRS,
    PLACES,
    SENSORS,
    TIMES,
    TOTALS,
    direction_in,
    plain,
)
from sidestep.crowds.dates import holds
from sidestep.crowds.layouts import SEVERAL, Layout
from sidestep.crowds.sheets import Sheet

_MOST_LISTED = 12  # names in one sentence


@dataclass(frozen=True)
class Roles:
    """Which column is for what."""

    when: tuple[str, ...]
    """Column of dates with times; or of dates, and of times of the day."""
    sensor: tuple[str, ...]
    """Columns of a long table that tell sensors apart, the names first, then their numbers, where there are both."""
    counts: dict[str, tuple[str, ...]]
    """Columns of counts that are summed, by sensor; of a long table they have the name ""."""
    direction: str = ""
    unused: tuple[str, ...] = ()
    place: tuple[str, ...] = ()
    """Columns of the sensors' latitudes and longitudes, or one of both; empty where they are not known."""

    @property
    def understood(self) -> list[str]:
        """The columns, in words."""
        said = [f"times in {_listed(self.when)}"]
        if self.sensor:
            said.append(f"one row for each sensor of {_listed(self.sensor)}, counts in {_listed(self.counts[''])}")
        elif "" not in self.counts:
            said.append(f"one column for each sensor: {_listed(self.counts)}")
        summed = [f"{name} = {' + '.join(parts)}" for name, parts in self.counts.items() if name and len(parts) > 1]
        if summed:
            said.append(f"directions summed: {', '.join(summed)}")
        elif len(self.counts.get("", ())) > 1:
            said.append(f"directions summed: {' + '.join(self.counts[''])}")
        if self.direction:
            said.append(f"directions summed: rows that differ in {self.direction!r}")
        if self.place:
            said.append(f"positions of sensors in {_listed(self.place)}")
        if self.unused:
            said.append(f"columns left out: {_listed(self.unused)}")
        return said


def _listed(names: Iterable[str]) -> str:
    first = list(names)
    more = f" and {len(first) - _MOST_LISTED} more" if len(first) > _MOST_LISTED else ""
    return ", ".join(map(repr, first[:_MOST_LISTED])) + more


def is_known(name: str, layout: Layout) -> bool:
    """Whether a header must have this name: of times, or one that is named."""
    named = {part for names in layout.named.values() for each in names for part in (each, *_summed(each))}
    return plain(name) in TIMES | DATES or name in named


def _summed(name: str) -> list[str]:
    return [part.strip() for part in name.split("+")]


def roles_of(sheet: Sheet, layout: Layout) -> Roles:
    """Find which column is for what.

    Parameters
    ----------
    sheet
        The file.
    layout
        What is said of it.

    Returns
    -------
    Roles
        Of a long or a wide table.

    Raises
    ------
    SidestepError
        Of the sheet's type: a named column that does not exist, or is named twice; columns that are not recognised.
    """
    named = _check_named(sheet, layout)
    free = [name for name in sheet.names if not any(name in names for names in named.values())]
    when = _when(sheet, layout, free)
    place = _place(sheet, layout, free)
    free = [name for name in free if name not in (*when, *place)]
    sensor = (layout.sensor,) if layout.sensor else _sensor(sheet, layout, free)
    counts = named.get("count", ())
    if sensor and not counts:
        free = [name for name in free if name not in sensor]
        counts = _known(free, COUNTS)[:1] or _directions_of_rows(free)
        if not counts and layout.sensor:
            said = f"no column of counts is recognised; {_name('count', sheet)}"
            raise sheet.error(f"{sheet.source}: {said}", field="count")
    if counts:
        direction = layout.direction or next(iter(_known(free, DIRECTIONS)), "")
        used = {*when, *sensor, *counts, *place, direction}
        unused = tuple(name for name in sheet.names if name not in used)
        return Roles(when, sensor, {"": counts}, direction, unused, place)
    wide, times = _split_by(
        lambda name: holds(sheet.first[name], layout.date_format) not in ("time", "date"),
        [name for name in sheet.names if name in free and name not in when],
    )
    sensors, left_out = _wide(wide, Path(sheet.source).stem)
    if not sensors:
        said = f"no column of counts beside {_listed(when)}; give one for each sensor"
        raise sheet.error(f"{sheet.source}: {said}", field=when[0])
    left_out = (*left_out, *times, *named.get("ignore", ()))
    if len(sensors) > 1:  # whose place it is, nobody knows
        place, left_out = (), (*left_out, *place)
    return Roles(when, (), sensors, "", left_out, place)


def _check_named(sheet: Sheet, layout: Layout) -> dict[str, tuple[str, ...]]:
    """The columns that are named, by what they are for; names of counts with + between them are several columns."""
    for key, names in layout.named.items():
        for name in names:
            if key not in SEVERAL and name not in sheet.names and len(_summed(name)) > 1:
                hint = "; a date and a time of day that stand apart are date=… and hour=…" if key == "time" else ""
                said = f"{key} must be one column, not {quoted(name)}: + sums columns of counts only{hint}"
                raise sheet.error(f"{sheet.source}: {said}", field=key)
    found = {
        key: tuple(part for name in names for part in ((name,) if name in sheet.names else _summed(name)))
        for key, names in layout.named.items()
    }
    seen = set[str]()
    for key, names in found.items():
        for name in names:
            if name not in sheet.names:
                said = f"there is no column {quoted(name)} for {key}; the columns are"
                raise sheet.error(f"{sheet.source}: {said} {_listed(sheet.names)}", field=name)
            if name in seen:
                raise sheet.error(f"{sheet.source}: column {quoted(name)} is named twice", field=name)
            seen.add(name)
    if bool(layout.date) != bool(layout.hour) or (layout.time and layout.date):
        raise sheet.error(f"{sheet.source}: name either the column time, or date and hour", field="time")
    return found


def _when(sheet: Sheet, layout: Layout, free: list[str]) -> tuple[str, ...]:
    """The columns of times."""
    if layout.time or layout.date:
        return (layout.time,) if layout.time else (layout.date, layout.hour)
    dated = [name for name in free if plain(name) in TIMES | DATES | HOURS]
    dated.sort(key=lambda name: plain(name) not in TIMES)
    whole = [name for name in dated if holds(sheet.first[name], layout.date_format) == "time"]
    dates = [name for name in dated if holds(sheet.first[name], layout.date_format) == "date"]
    hours = [name for name in dated if plain(name) in HOURS and holds(sheet.first[name], "") == "hour"]
    if whole:
        return (whole[0],)
    if dates and hours:
        return dates[0], hours[0]
    if dates:  # of whole days, which is said where they are read
        return (dates[0],)
    if plain(sheet.names[0]) in TIMES | DATES:  # its first cell is no time, which is said there as well
        return (sheet.names[0],)
    said = f"no column of times is recognised; {_name('time', sheet)}"
    raise sheet.error(f"{sheet.source}: {said}", field=sheet.names[0])


def _sensor(sheet: Sheet, layout: Layout, free: list[str]) -> tuple[str, ...]:
    """The columns that tell sensors apart, if this is a long table: its counts have a known name as well."""
    found = [name for name in _known(free, SENSORS) if not _is_place(sheet.first[name])]
    if not found or not (layout.count or _known(free, COUNTS) or _directions_of_rows(free)):
        return ()
    numbers = [name for name in found if plain(name).endswith("id")]
    names = [name for name in found if name not in numbers]
    return (*names[:1], *numbers[:1])


def _place(sheet: Sheet, layout: Layout, free: list[str]) -> tuple[str, ...]:
    """The columns of latitudes and longitudes, or the one that has both."""
    if bool(layout.latitude) != bool(layout.longitude):
        raise sheet.error(f"{sheet.source}: name both columns, latitude and longitude", field="latitude")
    if layout.latitude:
        return layout.latitude, layout.longitude
    latitude, longitude = ([name for name in free if plain(name) in names] for names in (LATITUDES, LONGITUDES))
    if len(latitude) == len(longitude) == 1:
        return (*latitude, *longitude)
    return tuple(name for name in free if plain(name) in PLACES and _is_place(sheet.first[name]))[:1]


def _is_place(cell: str) -> bool:
    return place_in(cell) is not None


def place_in(cell: str) -> tuple[str, str] | None:
    """Latitude and longitude as they are written in one cell; None where it has other text."""
    found = re.fullmatch(r"\(?([-+]?\d+\.\d+)\s*[,; ]\s*([-+]?\d+\.\d+)\)?", cell)
    return None if found is None else (found[1], found[2])


def _known(free: Iterable[str], names: Iterable[str]) -> tuple[str, ...]:
    """Columns with known names, in the order of these."""
    by_plain: dict[str, str] = {}
    for name in free:
        by_plain.setdefault(plain(name), name)
    return tuple(by_plain[name] for name in names if name in by_plain)


def _directions_of_rows(free: list[str]) -> tuple[str, ...]:
    """Two columns of counts of a long table that have the names of directions."""
    for pair in PAIRS:
        found = tuple(name for word in pair for name in free if plain(name) in (word, f"counts{word}", f"count{word}"))
        if len(found) == 2:
            return found
    return ()


def _wide(free: list[str], alone: str) -> tuple[dict[str, tuple[str, ...]], tuple[str, ...]]:
    """The columns of each sensor of a wide table, and those left out; a pair of directions alone is ``alone``."""
    free, never = _split_by(lambda name: plain(name) not in NEVER_COUNTED, free)
    parts: dict[str, dict[str, str]] = {}
    for name in free:
        base, word = direction_in(name)
        if word:
            parts.setdefault(base, {})[word] = name
    sensors: dict[str, tuple[str, ...]] = {}
    left_out = [*never]
    for name in free:
        base, word = direction_in(name)
        columns = parts.get(base, {})
        pair = _pair_of(word, columns)
        total = base if base in free else next((columns[each] for each in columns if each in TOTALS), "")
        if not pair:
            sensors[name] = (name,)
        elif not total:
            sensors.setdefault(base or alone, tuple(columns[part] for part in pair))
        elif name == total:
            sensors[base or alone] = (total,)
        else:
            left_out.append(name)
    of_all = [name for name in sensors if plain(name) in TOTALS]
    if len(sensors) - len(of_all) > 1:
        left_out += [sensors.pop(name)[0] for name in of_all]
    return sensors, tuple(left_out)


def _pair_of(word: str, parts: dict[str, str]) -> tuple[str, ...]:
    """The pair of directions among the columns of one sensor to which a word belongs, or whose sum it means."""
    for pair in PAIRS:
        if (word in pair or word in TOTALS) and all(part in parts for part in pair):
            return pair
    return ()


def _split_by(holds_for: Callable[[str], bool], names: list[str]) -> tuple[list[str], list[str]]:
    return [name for name in names if holds_for(name)], [name for name in names if not holds_for(name)]


def _name(key: str, sheet: Sheet) -> str:
    return f"name it, such as --columns {key}={quoted(sheet.names[0])}; the columns are {_listed(sheet.names)}"
