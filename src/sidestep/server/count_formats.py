"""Counts as they are posted: JSON, CSV and NGSI-LD. docs/live-counts.md says what each of them must have.

Types are checked here, and everything else by :func:`~sidestep.crowds.live.check_counts`. Either all counts of a body
are understood, or none is.
"""

import csv
import io
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from reprlib import repr as quoted
from typing import Any, NoReturn
from urllib.parse import unquote

from sidestep.crowds.column_names import COUNTS, DIRECTIONS, PAIRS, SENSORS, TIMES, plain
from sidestep.crowds.column_roles import place_in
from sidestep.crowds.live import LiveCount, LiveError
from sidestep.crowds.wall_time import TimezoneError, instant
from sidestep.errors import hint

MOST_COUNTS = 10_000
"""In one body."""
SECONDS = 3600.0
"""How long was counted, where nothing says so."""
FLOW = "CrowdFlowObserved"

_KEYS = ("sensor", "time", "seconds", "count", "towards", "away")
_DURATIONS = ("seconds", "durationseconds", "intervalseconds")
_TIME = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d(:\d\d(:\d\d([.,]\d{1,9})?)?)?(Z|[+-]\d\d(:?\d\d)?)?", re.ASCII)
_NUMBER = re.compile(r"\d{1,15}(\.\d{1,15})?", re.ASCII)
_MAYBE_THOUSANDS = re.compile(r"[1-9]\d{0,2}\.\d{3}", re.ASCII)
_URN = re.compile(r"urn:ngsi-ld:[^:]+:(.+)", re.IGNORECASE)
_ROUNDING = 1e-6  # of sums of two directions
_DEEPEST = 4  # values within values of an attribute


def read_posted(body: bytes, content_type: str, timezone: str | None, seconds: float = SECONDS) -> list[LiveCount]:
    """Understand what was posted.

    Parameters
    ----------
    body
        JSON, CSV or NGSI-LD, in UTF-8.
    content_type
        As the header of HTTP says it.
    timezone
        IANA name of the place's timezone, for times without an offset; None: not known.
    seconds
        How long was counted, where nothing says so.

    Returns
    -------
    list[LiveCount]
        In the order of the body; none of them is checked.

    Raises
    ------
    LiveError
        ``field`` is ``content_type``, ``body`` or one of ``sensor``, ``time``, ``seconds`` and ``count``; ``row`` the
        count at fault, from 1 on, where there are several; ``line`` that of CSV.

    Examples
    --------
    >>> from sidestep.server.count_formats import read_posted
    >>> body = b'{"sensor": "Bridge", "time": "2025-05-24T12:00", "seconds": 900, "towards": 12, "away": 30}'
    >>> count = read_posted(body, "application/json", "Europe/Helsinki")[0]
    >>> count.persons, count.begins.isoformat()
    (42.0, '2025-05-24T09:00:00+00:00')
    """
    kind, _, rest = content_type.partition(";")
    kind = kind.strip().lower()
    charset = re.search(r"charset\s*=\s*\"?([^\s\";]+)", rest, re.IGNORECASE)
    if charset is not None and charset[1].lower() not in ("utf-8", "utf8", "us-ascii"):
        raise LiveError(f"counts must be in UTF-8, not in {quoted(charset[1])}", field="content_type")
    usual = _Usual(timezone, seconds)
    if kind == "text/csv":
        return _csv(_text(body), usual)
    if kind == "application/json" or re.fullmatch(r"application/[\w.+-]+\+json", kind):
        return _json(_text(body), usual)
    must = "counts must be application/json, application/ld+json or text/csv"
    raise LiveError(f"{must}, not {quoted(kind) if kind else 'without a type'}", field="content_type")


@dataclass(frozen=True)
class _Usual:
    """What holds where a body says nothing else."""

    timezone: str | None
    seconds: float


def _text(body: bytes) -> str:
    try:
        text = body.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise LiveError(f"the body must be text in UTF-8, but byte {error.start + 1} is not", field="body") from error
    if not text.strip():
        raise LiveError("the body is empty; give counts", field="body")
    return text


# --- What all formats share -----------------------------------------------------------------------------------------


_Directions = tuple[float | None, float | None]


def _count(sensor: str, begins: datetime, seconds: float, persons: float | None, directions: _Directions) -> LiveCount:
    """A count of what was read; of persons and both directions, one or the other may be missing."""
    towards, away = directions
    if (towards is None) != (away is None):
        raise LiveError("towards and away must be given together", field="count")
    if towards is not None and away is not None:
        both = towards + away
        if persons is not None and not math.isclose(persons, both, rel_tol=_ROUNDING, abs_tol=_ROUNDING):
            said = f"{persons:g} is not that of {towards:g} towards and {away:g} away"
            raise LiveError(f"count must be the sum of both directions, but {said}", field="count")
        persons = both
    if persons is None:
        raise LiveError("count is missing; give it, or towards and away", field="count")
    return LiveCount(sensor, begins, seconds, persons, towards, away)


def _instant(text: object, timezone: str | None) -> datetime:
    """A time as ISO 8601 has it, in UTC."""
    must = "time must be a date and time such as 2025-05-24T12:30 or 2025-05-24T09:30Z"
    if not isinstance(text, str) or not _TIME.fullmatch(text):
        raise LiveError(f"{must}, not {quoted(text)}", field="time")
    try:
        return instant(datetime.fromisoformat(text), timezone)
    except TimezoneError as error:
        raise LiveError(f"time {error}", field="time") from error
    except ValueError as error:
        raise LiveError(f"{must}, not {quoted(text)}", field="time") from error


def _number(field: str, value: object) -> float:
    """A JSON number: neither text, nor true, nor one that is too large for a number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e300:
        shown = json.dumps(value) if isinstance(value, (bool, type(None))) else quoted(value)
        name = "count" if field in ("towards", "away") else field
        raise LiveError(f"{field} must be a number, not {shown}", field=name)
    return float(value)


def _name(field: str, value: object) -> str:
    if not isinstance(value, str) or not value.strip():
        raise LiveError(f"{field} must be text, not {quoted(value)}", field=field)
    return value


def _each(rows: Sequence[Any], read: Callable[[Any], LiveCount], lines: Sequence[int] = ()) -> list[LiveCount]:
    """The counts of all rows; errors say which row is at fault, if there are several."""
    if not rows:
        raise LiveError("there are no counts in the body", field="body")
    if len(rows) > MOST_COUNTS:
        raise LiveError(f"at most {MOST_COUNTS:,} counts may be posted at once, not {len(rows):,}", field="body")
    found = []
    for number, row in enumerate(rows):
        try:
            found.append(read(row))
        except LiveError as error:
            line = lines[number] if lines else None
            several = len(rows) > 1
            where = f"line {line}: " if line else f"row {number + 1}: " if several else ""
            which = number + 1 if several else None
            raise LiveError(f"{where}{error}", field=error.field, line=line, row=which) from error
    return found


# --- JSON -----------------------------------------------------------------------------------------------------------


def _json(text: str, usual: _Usual) -> list[LiveCount]:
    content = _parsed(text)
    if isinstance(content, dict) and "data" in content and _is_notification(content):
        content = content["data"]
        if not isinstance(content, list):
            raise LiveError("data of a notification must be a list of entities", field="body")
    rows = content if isinstance(content, list) else [content]
    return _each(rows, lambda row: _entity(row, usual) if _has_type(row) else _plain(row, usual))


def _parsed(text: str) -> Any:
    def refuse(constant: str) -> NoReturn:
        raise LiveError(f"the body is not JSON, which has no {constant}", field="body")

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise LiveError(f"{quoted(twice)} stands twice in one object", field=twice if twice in _KEYS else "body")
        return found

    try:
        return json.loads(text, parse_constant=refuse, object_pairs_hook=once)
    except LiveError:
        raise
    except json.JSONDecodeError as error:
        said = f"{error.msg} in line {error.lineno}, column {error.colno}"
        raise LiveError(f"the body is not JSON: {said}", field="body", line=error.lineno) from error
    except RecursionError as error:
        raise LiveError("the body is nested too deep", field="body") from error
    except ValueError as error:  # whole numbers of thousands of digits
        raise LiveError("the body has a number that is too long", field="body") from error


def _has_type(row: object) -> bool:
    return isinstance(row, dict) and "type" in row


def _plain(row: object, usual: _Usual) -> LiveCount:
    if not isinstance(row, dict):
        raise LiveError(f"a count must be an object with sensor, time and count, not {quoted(row)}", field="body")
    for key in row:
        if key not in _KEYS:
            raise LiveError(f"a count has no {quoted(key)}{hint(key, _KEYS)}", field=key[:40])
    for key in ("sensor", "time"):
        if key not in row:
            raise LiveError(f"{key} is missing", field=key)
    numbers = {key: _number(key, row[key]) for key in _KEYS[2:] if key in row}
    sensor, begins = _name("sensor", row["sensor"]), _instant(row["time"], usual.timezone)
    directions = (numbers.get("towards"), numbers.get("away"))
    return _count(sensor, begins, numbers.get("seconds", usual.seconds), numbers.get("count"), directions)


# --- NGSI-LD --------------------------------------------------------------------------------------------------------


def _is_notification(content: Mapping[str, Any]) -> bool:
    return content.get("type") == "Notification" or ("type" not in content and "subscriptionId" in content)


def _entity(row: Mapping[str, Any], usual: _Usual) -> LiveCount:
    """A CrowdFlowObserved; attributes are normalised, concise or plain values."""
    types = row["type"] if isinstance(row["type"], list) else [row["type"]]
    if not any(isinstance(each, str) and re.split(r"[/#:]", each)[-1] == FLOW for each in types):
        raise LiveError(f"type must be {FLOW}, not {quoted(row['type'])}", field="body")
    found = {key: _value(row[key]) for key in row if key in _ATTRIBUTES}
    numbers = {key: _number(field, found[key]) for key, field in _PEOPLE.items() if found.get(key) is not None}
    directions = (numbers.get("peopleCountTowards"), numbers.get("peopleCountAway"))

    begin, end = _interval(found)
    begins, seconds = _instant(begin, usual.timezone), usual.seconds
    if end is not None:
        seconds = (_instant(end, usual.timezone) - begins).total_seconds()
    return _count(_sensor(found), begins, seconds, numbers.get("peopleCount"), directions)


_PEOPLE = {"peopleCount": "count", "peopleCountTowards": "towards", "peopleCountAway": "away"}
_TIMES = ("dateObservedFrom", "dateObservedTo", "dateObserved")
_NAMES = ("refDevice", "name", "id")
_ATTRIBUTES = frozenset((*_PEOPLE, *_TIMES, *_NAMES))


def _value(content: Any) -> Any:
    """The value of an attribute, whichever form it has."""
    for _ in range(_DEEPEST):
        if isinstance(content, dict):
            inner = next((each for each in ("value", "object", "@value") if each in content), None)
            if inner is None:
                break
            content = content[inner]
        elif isinstance(content, list) and len(content) == 1:
            content = content[0]
    return content


def _interval(found: Mapping[str, Any]) -> tuple[Any, Any]:
    """Begin and end as they are written; the end is None where only the begin is known."""
    begin, end, both = (found.get(key) for key in _TIMES)
    if isinstance(both, str) and "/" in both and (begin is None or end is None):
        begin, end = both.split("/", 1)
    begin = both if begin is None else begin
    if begin is None:
        raise LiveError("time is missing: give dateObservedFrom and dateObservedTo, or dateObserved", field="time")
    return begin, end


def _sensor(found: Mapping[str, Any]) -> str:
    """The device, the name or the identifier, whichever is given first; of a URN what stands after its type."""
    given = next((found[key] for key in _NAMES if found.get(key) not in (None, "")), None)
    if given is None:
        raise LiveError("sensor is missing: give refDevice, name or id", field="sensor")
    name = _name("sensor", given)
    urn = _URN.fullmatch(name)
    return name if urn is None else unquote(urn[1])


# --- CSV ------------------------------------------------------------------------------------------------------------


def _csv(text: str, usual: _Usual) -> list[LiveCount]:
    header = text.lstrip("\r\n").splitlines()[0]
    lines_of = io.StringIO(text, newline="")
    reader = csv.reader(lines_of, delimiter=max(",;\t", key=header.count), strict=True, skipinitialspace=True)
    rows, lines = [], []
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                rows.append([cell.strip() for cell in cells])
                lines.append(reader.line_num)
            if len(rows) > MOST_COUNTS + 1:
                raise LiveError(f"at most {MOST_COUNTS:,} counts may be posted at once", field="body")
    except csv.Error as error:
        raise LiveError(f"the body is not CSV: {error} in line {reader.line_num}", field="body") from error
    names, rows, lines = rows[0], rows[1:], lines[1:]
    roles = _roles(names, rows[0] if rows else [])
    return _each(rows, lambda cells: _flat(names, roles, cells, usual), lines)


def _roles(names: Sequence[str], first: Sequence[str]) -> dict[str, int]:
    """Which column is for what; names are those of files of counts."""
    known = [plain(name) for name in names]
    if twice := next((name for name, word in zip(names, known, strict=True) if known.count(word) > 1), None):
        raise LiveError(f"two columns have the name {quoted(twice)}", field="body", line=1)
    if row_each := next((name for name, word in zip(names, known, strict=True) if word in DIRECTIONS), None):
        said = "a row for each direction is not understood; give both in one row, as towards and away"
        raise LiveError(f"column {quoted(row_each)}: {said}", field="count", line=1)
    places = [word for word, cell in zip(known, first, strict=False) if place_in(cell)]
    pair = next((each for each in PAIRS if all(word in known for word in each)), ())
    wanted: dict[str, Iterable[str]] = {
        "time": sorted(TIMES),
        "sensor": [word for word in SENSORS if word not in places],
        "seconds": _DURATIONS,
        "count": COUNTS,
        **dict(zip(("towards", "away"), ([word] for word in pair), strict=False)),
    }
    roles = {}
    for role, words in wanted.items():
        found = [known.index(word) for word in words if word in known]
        if role == "time" and len(found) > 1:
            several = " and ".join(quoted(names[column]) for column in found[:2])
            raise LiveError(f"columns {several} both may be the times; leave one out", field="time", line=1)
        if found:
            roles[role] = found[0]
    for role in ("time", "sensor"):
        if role not in roles:
            said = f"no column of the header is the {role}: {', '.join(map(quoted, names[:12]))}"
            raise LiveError(f"{said}; call it {role}", field=role, line=1)
    if "count" not in roles and "towards" not in roles:
        raise LiveError("no column is the count; call it count, or two columns towards and away", field="count", line=1)
    return roles


def _flat(names: Sequence[str], roles: Mapping[str, int], cells: Sequence[str], usual: _Usual) -> LiveCount:
    if len(cells) != len(names):
        raise LiveError(f"the header has {len(names)} cells, but this row {len(cells)}", field="body")

    def number(role: str) -> float | None:
        if role not in roles:
            return None
        text = cells[roles[role]]
        if not _NUMBER.fullmatch(text):
            said = f"column {quoted(names[roles[role]])} must have a number such as 12 or 12.5, not {quoted(text)}"
            more = "; leave out rows of what was not counted" if not text else ""
            raise LiveError(f"{said}{more}", field="seconds" if role == "seconds" else "count")
        if role != "seconds" and _MAYBE_THOUSANDS.fullmatch(text):
            whole, _, rest = text.partition(".")
            said = f"column {quoted(names[roles[role]])}: {text} may be {whole}{rest} or {float(text):g}"
            raise LiveError(f"{said}; write it as one of these", field="count")
        return float(text)

    sensor, begins = _name("sensor", cells[roles["sensor"]]), _instant(cells[roles["time"]], usual.timezone)
    seconds = number("seconds")
    length = usual.seconds if seconds is None else seconds
    return _count(sensor, begins, length, number("count"), (number("towards"), number("away")))
