"""Dates and times as publishers write them; the order of day and month is never guessed."""

import re
from dataclasses import dataclass
from datetime import UTC, date, datetime
from reprlib import repr as quoted
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Int

from sidestep.crowds.column_names import HOUR_WORDS, plain
from sidestep.crowds.sheets import Cells, Sheet

if TYPE_CHECKING:
    from collections.abc import Callable

HOUR, DAY = 3600, 86400
SINCE = "since 1970"
DAY_FIRST, MONTH_FIRST = "day-first", "month-first"
FIRST_YEAR, LAST_YEAR = 1900, 2200
"""Years in which people may have been counted; others are mistyped, and calendars and timezones end somewhere."""
_EPOCH = date(1970, 1, 1).toordinal()

_MONTHS = (
    "january", "januar", "february", "februar", "march", "märz", "maerz", "april", "may", "mai", "june", "juni", "july",
    "juli", "august", "september", "october", "oktober", "november", "december", "dezember",
)  # fmt: skip
_MONTH_OF = {
    "jan": 1,
    "feb": 2,
    "mar": 3,
    "mär": 3,
    "mae": 3,
    "apr": 4,
    "may": 5,
    "mai": 5,
    "jun": 6,
    "jul": 7,
    "aug": 8,
}
_MONTH_OF |= {"sep": 9, "oct": 10, "okt": 10, "nov": 11, "dec": 12, "dez": 12}
_CLOCK = r"(?P<H>\d{1,2})(?:[:.h](?P<M>\d{2})(?:[:.](?P<S>\d{2})(?:[.,]0+)?)?)?\s*(?:Uhr|h|(?P<p>[ap])\.?\s?m\.?)?"
_END = r"\d{1,2}(?:[:.]\d{2}){0,2}\s*(?:Uhr|h|[ap]\.?\s?m\.?)?"  # of an hour whose begin stands before it
_OFFSET = r"\s*(?P<z>Z|(?:UTC|GMT)?[-+][01]\d(?::?[0-5]\d)?|UTC|GMT)"
_WEEKDAY = r"(?:[^\W\d]{2,10}\.?,?\s+)?"
_THEN = rf"(?:(?:\s*[T,]\s*|\s+(?:at\s+|um\s+)?){_CLOCK}(?:{_OFFSET}|(?:\s+-\s+|\s*–\s*|\s+(?:to|bis)\s+){_END})?)?"
_FORMS = {
    name: re.compile(pattern, re.IGNORECASE)
    for name, pattern in {
        "year first": rf"{_WEEKDAY}(?P<y>\d{{4}})(?P<s>[-/.])(?P<m>\d{{1,2}})(?P=s)(?P<d>\d{{1,2}}){_THEN}",
        "year last": rf"{_WEEKDAY}(?P<a>\d{{1,2}})(?P<s>[-/.])(?P<b>\d{{1,2}})(?P=s)(?P<y>\d{{4}}|\d{{2}}){_THEN}",
        "digits": r"(?P<y>\d{4})(?P<m>\d{2})(?P<d>\d{2})(?:[T\s]?(?P<H>\d{2}):?(?:(?P<M>\d{2}):?(?P<S>\d{2})?)?)?"
        rf"(?:{_OFFSET})?",
        "month by name": rf"{_WEEKDAY}(?P<n>[^\W\d]{{3,9}})\.?\s+(?P<d>\d{{1,2}})(?:st|nd|rd|th)?,?\s+"
        rf"(?P<y>\d{{4}}){_THEN}",
        "day, month by name": rf"{_WEEKDAY}(?P<d>\d{{1,2}})(?:st|nd|rd|th)?[.\s-]*(?P<n>[^\W\d]{{3,9}})\.?[,\s-]*"
        rf"(?P<y>\d{{4}}){_THEN}",
    }.items()
}
_HOURS_ACROSS = 12  # columns that are called like hours; with fewer they may be sensors
# Since 1970; numbers that begin with 19 or 20 are years, and before 2030 no second begins so.
_SINCE = re.compile(r"(1[0-8]\d{8})(000)?(?:\.0+)?")
_HOURS = re.compile(rf"(?:{_CLOCK}|(?P<four>\d{{3,4}}))(?:\s*(?:-|–|to|bis)\s*(?:{_END}|\d{{3,4}}))?", re.IGNORECASE)
_WITH_TIME = re.compile(r"%[HIcXsT]")


@dataclass(frozen=True)
class _Written:
    """What one cell says."""

    form: tuple[str, str]
    """Name of its form, and the mark between its numbers."""
    year: int
    first: int
    """Month, or the first of two numbers of which one is the month."""
    second: int
    second_of_day: int | None
    """None: the cell has a date only."""
    twelve: bool = False
    """Whether the hour has a.m. or p.m."""
    offset: int | None = None
    """Seconds that the clock is ahead of UTC."""


@dataclass(frozen=True, eq=False)
class WrittenTimes:
    """The times of the rows as they are written."""

    seconds: Int[np.ndarray, " row"]
    """Since 1970 on the clock that they are written by."""
    offset: Int[np.ndarray, " row"] | None
    """Seconds that this clock is ahead of UTC; None: nothing is said."""
    ends: bool
    """Whether they are those at which what was counted ends, as with hours from 1 to 24."""
    understood: tuple[str, ...]
    """How they were read, in words."""


def holds(text: str, date_format: str) -> Literal["time", "date", "hour", ""]:
    """Whether a cell has a date with a time of the day, only one of them, or neither."""
    if "%" in date_format:
        return "" if _by_format(text, date_format) is None else "time" if _WITH_TIME.search(date_format) else "date"
    written = _date(text)
    if written is None:
        return "" if _second_of_day(text) is None else "hour"
    return "date" if written.second_of_day is None else "time"


def read_times(sheet: Sheet, when: tuple[str, ...], date_format: str) -> WrittenTimes:
    """Read the times of all rows.

    Parameters
    ----------
    sheet
        The file.
    when
        Column of dates with times; or of dates, and of times of the day.
    date_format
        ``day-first``, ``month-first`` or a format of :meth:`datetime.datetime.strptime`; "": as the column tells.

    Returns
    -------
    WrittenTimes
        For each row.

    Raises
    ------
    SidestepError
        Of the sheet's type: cells that are no dates or times, two forms in one column, an order of day and month that
        the column does not tell, days without hours.
    """
    if date_format and "%" not in date_format and date_format not in (DAY_FIRST, MONTH_FIRST):
        said = f"must be {DAY_FIRST}, {MONTH_FIRST} or a format such as '%d/%m/%y %H:%M', not {date_format!r:.40}"
        raise sheet.error(f"{sheet.source}: the date format {said}", field="date_format")
    columns = sheet.read(*when)
    name, cells = when[0], columns[when[0]]
    written = _written(sheet, name, cells, date_format)
    days, understood = _days(sheet, name, cells, written, date_format)
    has_time = np.array([each.second_of_day is not None for each in written])
    if len(when) == 2:
        sheet.refuse_any(name, cells, has_time[cells.code], f"has a time of its own beside column {quoted(when[1])}")
        hours = columns[when[1]]
        parsed = [_second_of_day(text) for text in hours.texts]
        missing = np.array([each is None for each in parsed])
        sheet.refuse_any(when[1], hours, missing[hours.code], "is not an hour of the day such as 17 or 17:00")
        of_day = np.array([each or 0 for each in parsed], np.int64)
        within = of_day[hours.code]
    else:
        if not has_time.any():
            raise sheet.error(f"{sheet.source}: {_without_hours(sheet, name)}", field=name)
        of_day = np.array([each.second_of_day or 0 for each in written], np.int64)
        within = of_day[cells.code]
    offsets = [each.offset for each in written]
    offset = None if offsets[0] is None else np.array(offsets, np.int64)[cells.code]
    midnight = of_day == 0 if len(when) == 2 else (of_day == 0) & has_time
    ends = bool((of_day == DAY).any() and not midnight.any())
    if ends:
        understood.append("hours from 1 to 24 are those at which counting ends")
    return WrittenTimes(days[cells.code] * DAY + within, offset, ends, tuple(understood))


def _without_hours(sheet: Sheet, name: str) -> str:
    """What to say of a column of days alone: hours may stand side by side, as columns."""
    across = {hour: each for each in reversed(sheet.names) if (hour := _hour_of_column(each)) is not None}
    if len(across) < _HOURS_ACROSS:
        return f"column {quoted(name)} has days without hours; hours are needed, a day's totals are not enough"
    first, second, *_, last = (quoted(across[hour]) for hour in sorted(across))
    said = f"column {quoted(name)} has days, and {first}, {second} to {last} look like hours of the day side by side"
    return f"{said}; write a row for each hour instead, with the day and the hour in front"


def _hour_of_column(name: str) -> int | None:
    """Seconds since midnight, where a column is called like an hour of the day, such as 7, 07:00, h7 or Hour 7."""
    word = re.match(r"[^\W\d]*", name)[0]  # type: ignore[index] # matches anything
    return _second_of_day(name[len(word) :].strip(" _")) if not word or plain(word) in HOUR_WORDS else None


def _written(sheet: Sheet, name: str, cells: Cells, date_format: str) -> list[_Written]:
    """The dates of a column, all of one form."""
    given = "%" in date_format
    parse: Callable[[str], _Written | None] = (lambda text: _by_format(text, date_format)) if given else _date
    found = [parse(text) for text in cells.texts]
    no_date = np.array([each is None for each in found])
    expected = f"of the form {date_format!r}" if given else "a date with a time such as 2025-05-24T12:30"
    hint = "" if given else "; other forms are named by --date-format"
    sheet.refuse_any(name, cells, no_date[cells.code], f"is not {expected}{hint}")
    written = [each for each in found if each is not None]
    first = written[cells.code[0]]
    timed = next((written[code] for code in cells.code.tolist() if written[code].second_of_day is not None), first)

    def alike(each: _Written) -> bool:
        same_clock = each.second_of_day is None or each.twelve == timed.twelve
        return each.form == first.form and same_clock and (each.offset is None) == (first.offset is None)

    other = np.array([not alike(each) for each in written])
    before = f"{quoted(cells.texts[cells.code[0]])} in line {sheet.lines[0]}"
    sheet.refuse_any(name, cells, other[cells.code], f"is of another format than {before}; give all dates one format")
    return written


def _days(
    sheet: Sheet, name: str, cells: Cells, written: list[_Written], date_format: str
) -> tuple[Int[np.ndarray, " text"], list[str]]:
    """Days since 1970 of each different cell, and how they were read."""
    numbers = np.array([(each.year, each.first, each.second) for each in written], np.int64)
    understood = []
    if written[0].form[0] == SINCE:
        understood.append(f"times are {written[0].form[1]} since 1970, in UTC")
    if written[0].form[0] == "year last":
        day_first, why = _order(sheet, name, cells, numbers, date_format)
        understood.append(f"dates have the {'day' if day_first else 'month'} first{why}")
        if day_first:
            numbers = numbers[:, [0, 2, 1]]
        short = (numbers[:, 0] < 100)[cells.code]
        if not date_format:
            hint = "has a year of two digits; give --date-format, such as '%d/%m/%y %H:%M'"
            sheet.refuse_any(name, cells, short, hint)
        numbers[:, 0] += 2000 * (numbers[:, 0] < 100)
    strange = (numbers[:, 0] < FIRST_YEAR) | (numbers[:, 0] > LAST_YEAR)
    sheet.refuse_any(name, cells, strange[cells.code], f"is not in the years {FIRST_YEAR} to {LAST_YEAR}")
    days = [_ordinal(*each) for each in numbers.tolist()]
    sheet.refuse_any(name, cells, np.array([day is None for day in days])[cells.code], "is no day of the calendar")
    return np.array([day for day in days if day is not None], np.int64) - _EPOCH, understood


def _order(
    sheet: Sheet, name: str, cells: Cells, numbers: Int[np.ndarray, "text 3"], date_format: str
) -> tuple[bool, str]:
    """Whether the day stands first, and why."""
    if date_format:
        return date_format == DAY_FIRST, ""
    first, second = (numbers[:, column][cells.code] > 12 for column in (1, 2))
    if first.any() and second.any():
        row, before = (int(np.argmax(each)) for each in ((second, first) if first[0] else (first, second)))
        row, before = max(row, before), min(row, before)
        seen = f"{quoted(cells.texts[cells.code[before]])} in line {sheet.lines[before]}"
        said = f"{quoted(cells.texts[cells.code[row]])} has day and month in another order than {seen}"
        raise sheet.refuse(row, name, f"{said}; give all dates one format")
    if (numbers[:, 1] == numbers[:, 2]).all():
        return True, ", or the month: they are the same"
    if not first.any() and not second.any():
        row = int(np.argmax(numbers[cells.code, 1] != numbers[cells.code, 2]))
        year, one, two = numbers[cells.code[row]].tolist()
        days = (
            f"{day} {date(2000, month, 1):%B} {year}"
            for day, month in ((one, two), (two, one))
            if month in range(1, 13)
        )
        said = f"{quoted(cells.texts[cells.code[row]])} may be {' or '.join(days)}, and no date of the file tells"
        raise sheet.refuse(row, name, f"{said}; give --date-format {DAY_FIRST} or {MONTH_FIRST}")
    row = int(np.argmax(first | second))
    return bool(first.any()), f", as {quoted(cells.texts[cells.code[row]])} in line {sheet.lines[row]} tells"


def _ordinal(year: int, month: int, day: int) -> int | None:
    try:
        return date(year, month, day).toordinal()
    except ValueError:
        return None


def _date(text: str) -> _Written | None:
    if found := _SINCE.fullmatch(text):
        time = datetime.fromtimestamp(int(found[1]), UTC)
        unit = "milliseconds" if found[2] else "seconds"
        return _Written((SINCE, unit), time.year, time.month, time.day, int(found[1]) % DAY, offset=0)
    for name, pattern in _FORMS.items():
        if (found := pattern.fullmatch(text)) is None:
            continue
        said = {"s": "", "n": "", "p": None, **found.groupdict()}
        second = _seconds(said) if said["H"] else None
        month = _month(said["n"]) if said["n"] else None
        if (said["H"] and second is None) or (said["n"] and month is None):
            continue
        first = month or said.get("m") or said.get("a")
        last = said.get("d") or said.get("b")
        form = (name, said["s"])
        return _Written(form, int(said["y"]), int(first), int(last), second, said["p"] is not None, _offset(said["z"]))  # type: ignore[arg-type]
    return None


def _month(name: str) -> int | None:
    """The number of a month, by its name or the beginning of it; other languages have names that begin alike."""
    lower = name.lower()
    return _MONTH_OF[lower[:3]] if any(each.startswith(lower) for each in _MONTHS) else None


def _by_format(text: str, date_format: str) -> _Written | None:
    try:
        time = datetime.strptime(text, date_format)  # noqa: DTZ007 - with an offset only where the format has one
    except (ValueError, re.error):
        return None
    offset = time.utcoffset()
    second = 3600 * time.hour + 60 * time.minute + time.second if _WITH_TIME.search(date_format) else None
    ahead = None if offset is None else round(offset.total_seconds())
    return _Written(("", ""), time.year, time.month, time.day, second, offset=ahead)


def _second_of_day(text: str) -> int | None:
    """Seconds since midnight, up to and with 24:00."""
    if (found := _HOURS.fullmatch(text)) is None:
        return None
    said = found.groupdict()
    if said["four"]:
        said |= {"H": said["four"][:-2], "M": said["four"][-2:], "S": None}
    return _seconds(said)


def _seconds(said: dict[str, str | None]) -> int | None:
    hour, minute, second = (int(said[key] or 0) for key in "HMS")
    if said["p"] is not None:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if said["p"].lower() == "p" else 0)
    total = HOUR * hour + 60 * minute + second
    return total if minute < 60 and second < 60 and total <= DAY else None


def _offset(text: str | None) -> int | None:
    if text is None:
        return None
    digits = re.sub(r"\D", "", text)
    seconds = HOUR * int(digits[:2] or 0) + 60 * int(digits[2:] or 0)
    return -seconds if "-" in text else seconds
