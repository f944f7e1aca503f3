"""Requests for routes, and how people write them."""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from sidestep.crowds.counts import CountTable
from sidestep.errors import SidestepError
from sidestep.planners.base import Planner

Place = int | tuple[float, float]
"""A node, by its number; or, in towns, latitude and longitude in degrees."""

Counts = CountTable | Path | str
"""A table of counts, or its CSV file."""

NO_COORDINATES = "a grid has no coordinates; choose text or json, or a scenario with real streets, such as helsinki"
_NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+))\s*"
_PLACE = re.compile(f"{_NUMBER},{_NUMBER}", re.ASCII)
_NODE = re.compile(r"\s*[-+]?\d{1,18}\s*", re.ASCII)


class RouteError(SidestepError):
    """A request that no plan can answer; ``field`` names the field at fault."""


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
    """A route to plan: its ends, its departure, and the planner.

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
    """Local wall time in towns, minutes after the scenario's start on grids; by default the first hour at which people
    usually set out, or the start."""

    planner: str | Planner | None = None
    """Who plans, by name or as an object; by default ``darp`` where a model was loaded, otherwise ``expected``."""

    by: float | None = None
    """Minutes after the departure; the plan then says how likely the walk arrives within them."""

    futures: int | None = None
    """Number of futures to simulate; by default 200, in towns 20 for planners that see all counts, and 1 where all
    futures are alike."""

    live: Counts | None = None
    """Current counts, from which crowds go on; only where crowds are known from sensors."""

    def __post_init__(self) -> None:
        if self.by is not None and not (math.isfinite(self.by) and self.by > 0):
            raise RouteError(f"by must be a positive number of minutes, not {self.by:g}", field="by")
        if self.futures is not None and self.futures < 1:
            raise RouteError(f"futures must be at least 1, not {self.futures}", field="futures")


def read_place(field: str, given: str | Place | None) -> Place | None:
    """Read a node, or latitude and longitude.

    Parameters
    ----------
    field
        For errors: ``origin`` or ``destination``.
    given
        As people write it, such as ``60.1699,24.9384``, or as it is to be.

    Returns
    -------
    Place or None
        The node, or the degrees of latitude and longitude; None if nothing is given.

    Raises
    ------
    RouteError
        Other text.
    """
    if not isinstance(given, str):
        return given
    if _NODE.fullmatch(given):
        return int(given)
    if found := _PLACE.fullmatch(given):
        return float(found[1]), float(found[2])
    said = f"the {field} must be a node or LAT,LON such as 60.1699,24.9384"
    raise RouteError(f"{said}, not {given.strip()!r:.60}", field=field)


def read_departure(given: str | datetime | float | None) -> datetime | float | None:
    """Read a departure.

    Parameters
    ----------
    given
        Text such as ``2025-05-24T12:30`` or ``30``, or as it is to be.

    Returns
    -------
    datetime or float or None
        The local time, or the minutes after the start; None if nothing is given.

    Raises
    ------
    RouteError
        Other text.
    """
    if not isinstance(given, str):
        return given
    text = given.strip()
    with suppress(ValueError):
        return float(text)
    with suppress(ValueError):
        if len(text) > len("2025-05-24"):
            return datetime.fromisoformat(text)
    said = "the departure must be a local time such as 2025-05-24T12:30, or minutes on a grid"
    raise RouteError(f"{said}, not {given!r:.60}", field="depart")
