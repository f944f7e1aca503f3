"""What is asked for: from where to where, when, and by which planner; and how people write that."""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import MAXYEAR, datetime
from pathlib import Path
from typing import TypedDict

from sidestep.crowds.counts import CountTable, read_counts
from sidestep.errors import SidestepError
from sidestep.planners.base import Planner

Place = int | tuple[float, float]
"""A node, by its number; or, in towns, latitude and longitude in degrees."""

NO_COORDINATES = "a grid has no coordinates; choose text or json, or a scenario with real streets, such as helsinki"
_PLACE = re.compile(r"\s*([-+]?[\d.]+)\s*,\s*([-+]?[\d.]+)\s*", re.ASCII)
_NODE = re.compile(r"\s*[-+]?\d{1,18}\s*", re.ASCII)


class RouteError(SidestepError):
    """A route that nobody can plan. ``field`` names the field of the request at fault."""


@contextmanager
def at_fault(field: str) -> Iterator[None]:
    """Let errors of other modules name the field of the request that they concern."""
    try:
        yield
    except SidestepError as error:
        error.field = field
        raise


@dataclass(frozen=True)
class RouteRequest:
    """A route that is asked for.

    Raises
    ------
    RouteError
        Minutes that are not positive (field ``by``), or less than one future (``futures``).

    Examples
    --------
    >>> import sidestep
    >>> request = sidestep.RouteRequest((60.1719, 24.9414), (60.1640, 24.9480), planner="snapshot", by=20)
    >>> request.origin
    (60.1719, 24.9414)
    """

    origin: Place | None = None
    """Where the route begins: a node, or latitude and longitude in degrees; by default the first node."""

    destination: Place | None = None
    """Where it ends; by default the last node."""

    depart: datetime | float | None = None
    """Departure: local wall time in towns, minutes after the scenario's start on grids. By default the first hour at
    which people usually set out, or the start."""

    planner: str | Planner | None = None
    """Who plans, by name or as an object; by default ``darp`` where a model was loaded, otherwise ``expected``."""

    by: float | None = None
    """Minutes after the departure; the plan then says how likely the walk arrives within them."""

    futures: int | None = None
    """How many futures to simulate; by default as many as give stable quantiles in a few seconds."""

    live: CountTable | Path | str | None = None
    """Current counts, or the CSV file that has them, from which crowds go on; in towns with counters."""

    def __post_init__(self) -> None:
        if self.by is not None and not (math.isfinite(self.by) and self.by > 0):
            raise RouteError(f"by must be a positive number of minutes, not {self.by:g}", field="by")
        if self.futures is not None and self.futures < 1:
            raise RouteError(f"futures must be at least 1, not {self.futures}", field="futures")

    def live_counts(self) -> CountTable | None:
        """The current counts, read if need be; None where none are given.

        Raises
        ------
        SidestepError
            A file that holds no counts.
        """
        if self.live is None or isinstance(self.live, CountTable):
            return self.live
        with at_fault("live"):
            return read_counts(Path(self.live))


@dataclass(frozen=True)
class Departure:
    """When a walk begins."""

    text: str
    """For people."""

    clock: float = 0.0
    """Seconds since the scenario's start; in towns the scenario starts with the departure."""

    hour: float | None = None
    """Hour of the week, 0 is Monday 0:00; None where crowds do not depend on it."""

    time: datetime | None = None
    """Local wall time, where a day was given."""


class EndJson(TypedDict):
    """Origin or destination of a route."""

    node: int
    asked: str
    latitude: float | None
    """Degrees, on the street; None on grids, as is the longitude."""
    longitude: float | None
    metres_away: float
    """From the place that was asked for to the street."""


@dataclass(frozen=True)
class End:
    """Where a route begins or ends."""

    node: int
    """Number of the node; on split streets one beyond those of the town."""

    asked: str
    """What was asked for, for people."""

    latitude: float | None = None
    """Degrees, on the street; None on grids."""

    longitude: float | None = None
    """Degrees, on the street; None on grids."""

    away: float = 0.0
    """Metres between this place and the one that was asked for."""

    def to_json(self) -> EndJson:
        """Ready for ``json.dumps``."""
        return {
            "node": self.node,
            "asked": self.asked,
            "latitude": self.latitude,
            "longitude": self.longitude,
            "metres_away": self.away,
        }


def read_place(field: str, given: str | Place | None) -> Place | None:
    """A node, or latitude and longitude in degrees; text as people write them, such as ``60.1699,24.9384``.

    Parameters
    ----------
    field
        For errors: ``origin`` or ``destination``.

    Raises
    ------
    RouteError
        Other text.
    """
    if not isinstance(given, str):
        return given
    if _NODE.fullmatch(given):
        return int(given)
    found = _PLACE.fullmatch(given)
    try:
        if found:
            return float(found[1]), float(found[2])
    except ValueError:
        pass
    raise RouteError(
        f"the {field} must be a node or LAT,LON such as 60.1699,24.9384, not {given.strip()!r:.60}", field=field
    )


def read_departure(given: str | datetime | float | None) -> datetime | float | None:
    """A local time, or minutes after the start; text such as ``2025-05-24T12:30`` or ``30``.

    Raises
    ------
    RouteError
        Other text.
    """
    if not isinstance(given, str):
        return given
    text = given.strip()
    for read in (float, datetime.fromisoformat):
        try:
            found: float | datetime = read(text)
        except ValueError:
            continue
        if isinstance(found, float) or len(text) > len("2025-05-24"):
            return found
    raise RouteError(
        f"the departure must be a local time such as 2025-05-24T12:30, or minutes on a grid, not {given!r:.60}",
        field="depart",
    )


def local_time(depart: datetime | float) -> datetime:
    """The departure in a town.

    Raises
    ------
    RouteError
        Minutes, and times with a zone or an offset, which the counts do not have.
    """
    if not isinstance(depart, datetime) or depart.year == MAXYEAR:
        raise RouteError(
            f"the departure must be a local time such as 2025-05-24T12:30, not {depart!s:.60}", field="depart"
        )
    if depart.tzinfo is not None:
        raise RouteError(
            f"the departure must be local time without zone or offset, such as 2025-05-24T12:30, not {depart}",
            field="depart",
        )
    return depart


def minutes_after_start(depart: datetime | float) -> float:
    """The departure on a grid.

    Raises
    ------
    RouteError
        A time of day, and what is no number.
    """
    if isinstance(depart, datetime) or not math.isfinite(depart):
        raise RouteError(
            f"on a grid the departure must be a number of minutes after the start, not {depart!s:.60}", field="depart"
        )
    return float(depart)
