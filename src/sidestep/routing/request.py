"""Requests for routes, and how people write them."""

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import date, datetime, time
from pathlib import Path
from types import NoneType
from typing import Any, TypeGuard, TypeVar

import numpy as np

from sidestep.crowds.counts import CountTable
from sidestep.crowds.live import LiveCounts
from sidestep.crowds.wall_time import DAYS
from sidestep.errors import SidestepError
from sidestep.planners.base import Planner

T = TypeVar("T")

Place = int | tuple[float, float]
"""A node, by its number; or, in towns, latitude and longitude in degrees."""

Counts = CountTable | LiveCounts | Path | str
"""A table of counts, or its CSV file; or what sensors counted lately."""

Area = Path | str | dict[str, Any]
"""A GeoJSON file of polygons, or its content."""

CONFIDENCE = 0.9
"""The share of the futures in which walks arrive by a deadline where nobody asks for another."""

NO_COORDINATES = "a grid has no coordinates; choose text or json, or a scenario with real streets, such as helsinki"
_CALLED = {
    "depart": "the departure",
    "depart_at": "the departure",
    "until": "the last departure",
    "arrive_by": "the arrival",
    "at": "the time",
    "begin": "the time to begin with",
    "origin": "the origin",
    "destination": "the destination",
    "origins": "one of the origins",
    "destinations": "one of the destinations",
    "location": "the location",
    "time": "the time",
}
_NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+))\s*"
_PLACE = re.compile(f"{_NUMBER},{_NUMBER}", re.ASCII)
_NODE = re.compile(r"\s*[-+]?\d{1,18}\s*", re.ASCII)
_TIME = re.compile(r"(?:([a-z]{3,9})\.?\s+)?(\d{1,2})(:\d{2}(?::\d{2})?)", re.ASCII | re.IGNORECASE)


class RouteError(SidestepError):
    """A request that no plan can answer; ``field`` names the field at fault."""


def on_map(known: T | None) -> T:
    """Give what is drawn on a map; RouteError (field ``format``) on grids, which have no coordinates."""
    if known is None:
        raise RouteError(NO_COORDINATES, field="format")
    return known


@contextmanager
def at_fault(field: str) -> Iterator[None]:
    """Let errors of other modules name the field of the request that they concern."""
    try:
        yield
    except SidestepError as error:
        error.field = field
        raise


@dataclass(frozen=True)
class TimeOfWeek:
    """A time of day on no particular date: crowds depend on the hour of the week."""

    time: time
    day: int | None = None
    """0 is Monday. None: of a deadline the next such time after the departure, and else the first day of the week on
    which people usually set out."""


Departure = datetime | time | TimeOfWeek | float
"""Local wall time in towns, with a date, with a day of the week or with neither; minutes after the scenario's start on
grids."""


@dataclass(frozen=True)
class RouteRequest:
    """A route to plan: its ends, its departure, and the planner.

    Raises
    ------
    RouteError
        Minutes that are not positive (field ``by``), less than one future (``futures``), a negative number of
        alternatives (``alternatives``), a confidence that is no probability, or that has no deadline (``confidence``),
        two deadlines (``arrive_by``), or a deadline with current counts (``live``).

    Examples
    --------
    >>> import sidestep
    >>> request = sidestep.RouteRequest((60.1719, 24.9414), (60.1640, 24.9480), planner="snapshot", by=20)
    >>> request.origin
    (60.1719, 24.9414)
    """

    origin: Place | None = None
    """Where the route begins: a node, or latitude and longitude in degrees; on grids by default the first node."""

    destination: Place | None = None
    """Where it ends; on grids by default the last node."""

    depart: Departure | None = None
    """By default the first hour at which people usually set out, or on grids the scenario's start. With ``arrive_by``
    the earliest departure."""

    planner: str | Planner | None = None
    """Who plans, by name or as an object; by default ``darp`` where a model was loaded, otherwise ``expected``."""

    by: float | None = None
    """Minutes after the departure; the plan then says how likely the walk arrives within them."""

    futures: int | None = None
    """Number of futures to simulate; by default 200, in towns 20 for planners that see all counts, and 1 where all
    futures are alike."""

    live: Counts | None = None
    """Current counts, from which crowds go on; only where crowds are known from sensors."""

    avoid: Area | None = None
    """Streets that cross these polygons are not walked; only in towns."""

    alternatives: int = 0
    """The most other routes to plan beside the best one, where there are others that differ enough."""

    arrive_by: Departure | None = None
    """When to be there; the plan then departs as late as ``confidence`` allows."""

    confidence: float | None = None
    """The least share of the futures in which the walk arrives by then; by default ``CONFIDENCE``."""

    exclude: Sequence[str] = ()
    """Kinds of streets that are not walked, such as ``steps``; only in towns."""

    def __post_init__(self) -> None:
        for field in ("origin", "destination"):
            read_place(field, getattr(self, field))
        for field in ("depart", "arrive_by"):
            read_departure(getattr(self, field), field)
        check_planner(self.planner)
        if self.by is not None:
            check_minutes("by", self.by)
        check_count("futures", self.futures)
        check_count("alternatives", self.alternatives, least=0)
        check_files(live=self.live, avoid=self.avoid)
        check_list("exclude", self.exclude)
        if not all(isinstance(kind, str) for kind in self.exclude):
            raise RouteError(f"exclude must be kinds of streets, not {self.exclude!r:.60}", field="exclude")
        if self.confidence is not None and not (_is_number(self.confidence) and 0 < self.confidence <= 1):
            said = "the confidence must be a probability above 0 and at most 1"
            raise RouteError(f"{said}, not {self.confidence!r:.60}", field="confidence")
        if self.confidence is not None and self.arrive_by is None:
            said = "the confidence is that of arriving by a deadline"
            raise RouteError(f"{said}; give arrive_by as well, or leave out confidence", field="confidence")
        if self.arrive_by is not None and self.by is not None:
            said = "arrive_by and by are both deadlines; give the time of the arrival, or minutes after the departure"
            raise RouteError(said, field="arrive_by")
        if self.arrive_by is not None and self.live is not None:
            said = "counts are current as of the departure, which arrive_by looks for"
            raise RouteError(f"{said}; give depart instead of arrive_by, or leave out live", field="live")


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def check_minutes(field: str, minutes: object) -> None:
    """Refuse minutes that are not positive.

    Parameters
    ----------
    field, minutes
        Name of the parameter, and its value.

    Raises
    ------
    RouteError
        With the parameter as its field.
    """
    if not (_is_number(minutes) and math.isfinite(minutes) and minutes > 0):
        raise RouteError(f"{field} must be a positive number of minutes, not {minutes!r:.60}", field=field)


def check_count(field: str, number: object, least: int = 1) -> None:
    """Refuse what is no whole number, and numbers below the least.

    Parameters
    ----------
    field, number, least
        Name of the parameter, its value where it is given, and the least one.

    Raises
    ------
    RouteError
        With the parameter as its field.
    """
    if number is None:
        return
    if not isinstance(number, (int, np.integer)) or isinstance(number, bool) or number < least:
        raise RouteError(f"{field} must be a whole number of at least {least}, not {number!r:.60}", field=field)


def check_list(field: str, given: object) -> None:
    """Refuse what is no list, such as a number or text; RouteError with the parameter as its field."""
    if isinstance(given, str) or not isinstance(given, (Sequence, np.ndarray)):
        raise RouteError(f"{field} must be a list, not {given!r:.60}", field=field)


def check_planner(planner: object) -> None:
    """Refuse what is neither a name nor a planner; RouteError with the field ``planner``."""
    if not isinstance(planner, (str, Planner, NoneType)):
        raise RouteError(f"planner must be a name or a planner, not {planner!r:.60}", field="planner")


def check_files(*, live: object = None, avoid: object = None) -> None:
    """Refuse counts and areas to avoid that are neither files nor what such files hold.

    Parameters
    ----------
    live, avoid
        What was given; None where nothing was.

    Raises
    ------
    RouteError
        With the field ``live`` or ``avoid``.
    """
    if not isinstance(live, (CountTable, LiveCounts, Path, str, NoneType)):
        raise RouteError(f"live must be a file of counts or a CountTable, not {live!r:.60}", field="live")
    if not isinstance(avoid, (Path, str, dict, NoneType)):
        raise RouteError(f"avoid must be a GeoJSON file or its content as a dict, not {avoid!r:.60}", field="avoid")


def check_request(request: object) -> None:
    """Refuse what is no request; RouteError with the field ``request``."""
    if not isinstance(request, RouteRequest):
        raise RouteError(f"request must be a RouteRequest, not {request!r:.60}", field="request")


def read_place(field: str, given: object) -> Place | None:
    """Read a node, or latitude and longitude.

    Parameters
    ----------
    field
        For errors: the parameter that it is of.
    given
        As people write it, such as ``60.1699,24.9384``, or as it is to be.

    Returns
    -------
    Place or None
        The node, or the degrees of latitude and longitude; None if nothing is given.

    Raises
    ------
    RouteError
        Anything else.
    """
    if given is None:
        return None
    if isinstance(given, (int, np.integer)) and not isinstance(given, bool):
        return int(given)
    if isinstance(given, np.ndarray) and given.ndim == 1:
        given = tuple(given)
    if isinstance(given, (tuple, list)) and len(given) == len(("latitude", "longitude")):
        latitude, longitude = given
        if _is_number(latitude) and _is_number(longitude):
            return float(latitude), float(longitude)
    if not isinstance(given, str):
        said = f"{called(field)} must be the number of a node, or latitude and longitude such as (60.1699, 24.9384)"
        raise RouteError(f"{said}, not {given!r:.60}", field=field)
    if _NODE.fullmatch(given):
        return int(given)
    if found := _PLACE.fullmatch(given):
        return float(found[1]), float(found[2])
    said = f"{called(field)} must be a node or LAT,LON such as 60.1699,24.9384, with a comma and no space"
    raise RouteError(f"{said}, not {given.strip()!r:.60}", field=field)


def read_departure(
    given: object, field: str = "depart", today: date | None = None, *, grids: bool = True
) -> Departure | None:
    """Read a departure, or an arrival.

    Parameters
    ----------
    given
        Text such as ``2025-05-24T12:30``, ``Fri 17:30``, ``17:30`` or, on grids, ``30``; or as it is to be.
    field
        For errors: the parameter that it is of.
    today
        The day of texts that are times of day alone; None leaves it open.
    grids
        Whether the error speaks of grids.

    Returns
    -------
    Departure or None
        The local time, or the minutes after the start; None if nothing is given.

    Raises
    ------
    RouteError
        Anything else.
    """
    if isinstance(given, time) and given.tzinfo is not None:
        raise RouteError(f"{called(field)} must be a time of the place, without a timezone, not {given}", field=field)
    if given is None or isinstance(given, (datetime, time, TimeOfWeek)):
        return given
    if _is_number(given):
        return float(given)
    text = given.strip() if isinstance(given, str) else ""
    with suppress(ValueError):
        return float(text)
    with suppress(ValueError):
        if len(text) > len("2025-05-24"):
            return datetime.fromisoformat(text)
    with suppress(ValueError):
        if found := _TIME.fullmatch(text):
            of_day = time.fromisoformat(found[2].zfill(2) + found[3])
            if found[1] is None and today is not None:
                return datetime.combine(today, of_day)
            return TimeOfWeek(of_day, None if found[1] is None else _day(found[1]))
    said = f"{called(field)} must be a local time such as 2025-05-24T12:30, Fri 17:30 or 17:30"
    also = ", or minutes on a grid" if grids else ""
    raise RouteError(f"{said}{also}, not {given!r:.60}", field=field)


def called(field: str) -> str:
    """What people call the time or the place that a parameter gives."""
    return _CALLED[field]


def _day(name: str) -> int:
    """Number of a day of the week, 0 is Monday, from its name or the beginning of it; ValueError for other words."""
    return [day[: len(name)].lower() for day in DAYS].index(name.lower())
