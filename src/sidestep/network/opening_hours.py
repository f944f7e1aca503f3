"""Opening times as minutes of an ordinary week, read from and written to OpenStreetMap's ``opening_hours`` syntax.

Weekdays and times of day are kept, and so are spans over midnight. Rules for public and school holidays, and for a few
dates such as Christmas, are ignored. Texts that depend on anything else are not read at all: months, longer spans of
dates, weeks of the year, the n-th weekday of a month, sunrise and sunset, spans without an end, and conditions in
words. To guess would open a gate that is shut.
"""

import re
from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise, product

import numpy as np
from jaxtyping import Bool

WEEK = 7 * 24 * 60
"""Minutes of a week; it begins on Monday at 0:00."""

OpenMinutes = Bool[np.ndarray, "10080"]
"""Whether something is open in each minute of a week, from Monday 0:00."""

_DAY = 24 * 60
_NAMES = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")
_SHORT = tuple(name[:2] for name in _NAMES)
_DAYS = {name[:letters].lower(): day for day, name in enumerate(_NAMES) for letters in (2, 3, len(name))}
_HOLIDAYS = frozenset({"ph", "sh"})
_MOST_DATES = 14  # in a row; more are a season
_MONTH = r"(?:jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)"
_DATE = (
    rf"(?:{_MONTH}\s+\d{{1,2}}(?:\s*-\s*\d{{1,2}})?|dec\s+\d{{1,2}}\s*-\s*jan\s+\d{{1,2}}"
    r"|easter(?:\s*[+-]\s*\d+\s+days?)?)"
)
_DATES = re.compile(rf"{_DATE}(?:\s*,\s*(?:{_DATE}|\d{{1,2}}(?:\s*-\s*\d{{1,2}})?))*", re.ASCII | re.IGNORECASE)
_FALLBACK = re.compile(r'\|\|\s*(?:off|closed)\s*(?:"[^"]*")?\s*$')  # shut when it is not open
_SPAN = re.compile(r"(\d{1,2})[:.](\d\d)\s*-\s*(\d{1,2})[:.](\d\d)", re.ASCII)
_TIMES = re.compile(r"(?:\d{1,2}[:.]\d\d|24/7).*", re.ASCII | re.DOTALL)
# A comma before a weekday begins another rule, unless it stands in a list of weekdays.
_ADDITION = re.compile(r'(?:(?<=\d)|(?<=")|(?<=\boff)|(?<=\bopen)|(?<=\bclosed))\s*,\s*(?=[a-z])')
_COMMENT = re.compile(r'"[^"]*"')
_CONDITION = re.compile(r"\s*([\w-]+)\s*@\s*(?:\(([^()]*)\)|([^();]+))\s*(?:;|$)")
_WHOLE_WEEK, _WHOLE_DAY = list(range(7)), [(0, _DAY)]
_LONGEST = 1000  # characters; OpenStreetMap takes no more than 255

Rule = tuple[bool, list[int], list[tuple[int, int]], bool]
"""Whether it adds to earlier rules, its days, its spans in minutes of a day, and whether it opens or closes."""


def open_minutes(text: str) -> OpenMinutes | None:
    """Read opening times.

    Later rules replace earlier ones on the days that they name; with a comma between them they add to them, and ``off``
    with times closes just these. Spans over midnight belong to the day on which they begin.

    Parameters
    ----------
    text
        Such as "24/7", "off", "Mo-Fr 08:00-18:00; Sa,Su 10:00-16:00" or "22:00-06:00"; "" is always open.

    Returns
    -------
    OpenMinutes or None
        Whether it is open in each minute of the week, read-only; None for a text that cannot be read.

    Examples
    --------
    >>> from sidestep.network.opening_hours import open_minutes
    >>> int(open_minutes("Mo-Fr 08:00-18:00; We 10:00-12:00").sum()) / 60
    42.0
    >>> open_minutes("sunrise-sunset") is None
    True
    """
    return _open_minutes(text.strip())


def opening_text(minutes: OpenMinutes) -> str:
    """Write opening times in one canonical way.

    Parameters
    ----------
    minutes
        Whether it is open in each minute of the week.

    Returns
    -------
    str
        What `open_minutes` reads; "" for always open, "off" for never.

    Examples
    --------
    >>> from sidestep.network.opening_hours import open_minutes, opening_text
    >>> opening_text(open_minutes("mo-su 22:00-6:00; tu off; PH closed"))
    'Mo,We-Su 22:00-06:00'
    """
    if minutes.all():
        return ""
    spans: list[list[str]] = [[] for _ in _NAMES]
    for begin, length in _runs(minutes):
        end = begin + length
        midnights = range((begin // _DAY + 1) * _DAY, end, _DAY) if length >= _DAY else ()
        for start, stop in pairwise([begin, *midnights, end]):
            day, first = divmod(start, _DAY)
            last = stop - day * _DAY
            last -= _DAY * (last > _DAY)
            spans[day % 7].append(f"{first // 60:02}:{first % 60:02}-{last // 60:02}:{last % 60:02}")
    alike: dict[str, list[int]] = {}
    for day, texts in enumerate(spans):
        alike.setdefault(",".join(sorted(texts)), []).append(day)
    rules = [f"{_weekdays(days)} {times}".lstrip() for times, days in alike.items() if times]
    return "; ".join(rules) or "off"


def names_special_days(text: str) -> bool:
    """Tell whether opening times have rules for holidays or dates, which are ignored.

    Parameters
    ----------
    text
        Opening times, or a conditional value.

    Returns
    -------
    bool
        Whether they name public or school holidays, or dates.
    """
    return re.search(rf"\b(?:[PS]H|{_DATE})\b", text, re.IGNORECASE) is not None


def conditional_values(text: str) -> list[tuple[str, OpenMinutes | None]] | None:
    """Read a tag whose key ends in ``:conditional``.

    Parameters
    ----------
    text
        Such as "no @ (22:00-06:00); yes @ (Mo-Fr 06:00-22:00)".

    Returns
    -------
    list or None
        Each value in lower case and when it holds, None if its condition cannot be read; later ones take precedence.
        None for a text without clauses.

    Examples
    --------
    >>> from sidestep.network.opening_hours import conditional_values
    >>> [(value, when is None) for value, when in conditional_values("no @ (22:00-06:00); private @ (wet)")]
    [('no', False), ('private', True)]
    """
    clauses, at = [], 0
    while at < len(text):
        match = _CONDITION.match(text, at) if len(text) <= _LONGEST else None
        if match is None:
            return None
        value, inside, bare = match.groups()
        condition = (inside or bare or "").strip()
        clauses.append((value.lower(), _when_all(condition)))
        at = match.end()
    return clauses or None


def _when_all(condition: str) -> OpenMinutes | None:
    """Read times that hold together, with AND between them."""
    parts = [
        open_minutes(part) if part.strip() else None for part in re.split(r"\band\b", condition, flags=re.IGNORECASE)
    ]
    return None if any(part is None for part in parts) else np.all([part for part in parts if part is not None], axis=0)


@lru_cache(maxsize=4096)  # a town repeats the same few
def _open_minutes(text: str) -> OpenMinutes | None:
    if len(text) > _LONGEST:
        return None
    rules = _rules(text) if text else [(False, _WHOLE_WEEK, _WHOLE_DAY, True)]
    if rules is None:
        return None
    begun = np.zeros((7, 2 * _DAY), bool)  # by the day on which a span begins: a span may end on the next
    for adds, days, spans, opens in rules:
        if (opens and not adds) or (not opens and spans == _WHOLE_DAY):
            begun[days] = False
        for day, (begin, end) in product(days, spans):
            if opens:
                begun[day, begin:end] = True
            elif spans != _WHOLE_DAY:
                begun[day, begin:end] = False
                begun[day - 1, _DAY + begin : _DAY + end] = False
                begun[(day + 1) % 7, : max(end - _DAY, 0)] = False
    minutes = (begun[:, :_DAY] | np.roll(begun[:, _DAY:], 1, axis=0)).ravel()
    minutes.setflags(write=False)
    return minutes


def _rules(text: str) -> list[Rule] | None:
    """Split opening times into rules; None if any of them cannot be read."""
    rules: list[Rule] = []
    text = _FALLBACK.sub("", text.lower().replace("–", "-").replace("—", "-"))
    for part in re.split(r";", _COMMENT.sub(' "" ', text)):
        for number, piece in enumerate(_ADDITION.split(part)):
            if not piece.strip():
                continue  # a semicolon at the end
            rule = _rule(piece.strip(), number > 0)
            if rule is None:
                return None
            rules.append(rule)
    everything = [rule for rule in rules if rule[1] and (rule[3] or rule[1:3] == (_WHOLE_WEEK, _WHOLE_DAY))]
    return rules if everything else None  # "Su off" alone does not say when it is open


def _rule(text: str, adds: bool) -> Rule | None:
    words = text.replace('""', " ").strip()
    if not words:
        return None  # a comment alone, such as "by appointment"
    opens = True
    for word in ("off", "closed", "open"):
        if re.search(rf"(^|\s){word}$", words):
            words, opens = words[: -len(word)].rstrip(), word == "open"
            break
    else:
        if '""' in text:
            return None  # "18:00-22:00" with a comment: open or not, nobody knows
    match = _TIMES.search(words)
    days = _selected_days(words[: match.start()].rstrip(" :") if match else words)
    spans = _spans(match.group()) if match else _WHOLE_DAY
    return None if days is None or spans is None else (adds, days, spans, opens)


def _selected_days(text: str) -> list[int] | None:
    """Read a list of weekdays; none for holidays alone, all where there is no list."""
    if not text:
        return _WHOLE_WEEK
    if _DATES.fullmatch(text):
        return [] if all(1 <= dates <= _MOST_DATES for dates in _dates_in_a_row(text)) else None
    names = [name.strip() for name in text.split(",")]
    if any(name.split()[0] in _HOLIDAYS and len(name.split()) > 1 for name in names if name):
        text = re.sub(r"\b(ph|sh)\s+", "", text)  # on holidays only
        return None if _selected_days(text) is None else []
    days: set[int] = set()
    for name in names:
        ends = [_DAYS.get(end.strip(), -1) for end in name.split("-", 1)]
        if name in _HOLIDAYS:
            continue
        if -1 in ends:
            return None
        begin, end = ends[0], ends[-1]
        days |= {day % 7 for day in range(begin, end + 1 + 7 * (end < begin))}
    return sorted(days)


def _dates_in_a_row(text: str) -> Iterator[int]:
    """Count the dates of each span from one date to another."""
    for first, january, last in re.findall(r"(\d+)\s*-\s*(jan\s+)?(\d+)", text):
        yield int(last) - int(first) + 1 + 31 * bool(january)


def _spans(text: str) -> list[tuple[int, int]] | None:
    """Read spans of a day in minutes; one over midnight ends after 24:00."""
    if text == "24/7":
        return _WHOLE_DAY
    spans = []
    for part in text.split(","):
        match = _SPAN.fullmatch(part.strip())
        if match is None:
            return None
        hours, minutes, until, past = map(int, match.groups())
        begin, end = hours * 60 + minutes, until * 60 + past
        if begin >= _DAY or end > 2 * _DAY or minutes > 59 or past > 59:
            return None
        spans.append((begin, end if end > begin else end + _DAY))
    return spans


def _runs(minutes: OpenMinutes) -> Iterator[tuple[int, int]]:
    """Find the beginnings and lengths of runs of open minutes, round the end of the week; not all are open."""
    for begin in np.flatnonzero(minutes & ~np.roll(minutes, 1)).tolist():
        yield begin, int(np.argmin(np.roll(minutes, -begin)))


def _weekdays(days: list[int]) -> str:
    """Write a list of weekdays; "" for all of them."""
    runs: list[list[int]] = []
    for day in days:
        if runs and runs[-1][-1] == day - 1:
            runs[-1].append(day)
        else:
            runs.append([day])
    if len(days) == 7:
        return ""
    return ",".join(
        _SHORT[run[0]] if len(run) == 1 else f"{_SHORT[run[0]]}{'-' if len(run) > 2 else ','}{_SHORT[run[-1]]}"
        for run in runs
    )
