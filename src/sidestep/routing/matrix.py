"""How long the walks from many places to many others take."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sidestep.planners.base import Planner
from sidestep.routing.facts import End, SceneFacts
from sidestep.routing.formats import table
from sidestep.routing.located import Located
from sidestep.routing.trees import NAMES, Paths, minutes_or_none

WIDE = 80
"""Characters of the widest line of a table."""

LONGEST_LABEL = 30
"""Characters of a place's name in the text."""


Minutes = list[list[float | None]]


@dataclass(frozen=True, kw_only=True)
class TimeMatrix(SceneFacts):
    """How long the walks from many places to many others take.

    Examples
    --------
    >>> import sidestep
    >>> router = sidestep.Router(sidestep.scenario("paper-congested", side=3, crowded_nodes=1))
    >>> matrix = router.matrix([0, 4], [4, 8])
    >>> matrix.minutes[1][0]
    0.0
    """

    origins: Sequence[End]
    destinations: Sequence[End]
    planner: str
    """Name of the planner whose paths are walked."""

    futures: int | None
    """Number of simulated futures; None if crowds are as expected."""

    minutes: Minutes
    """If crowds are as expected, a row for each origin; None where no path leads, or walks are given up before."""

    p50: Minutes | None = None
    """Minutes within which half of the walks arrive; None without futures."""

    p90: Minutes | None = None
    """Minutes within which 90 % of the walks arrive; None without futures."""

    def to_json(self) -> dict[str, Any]:
        """Everything, ready for ``json.dumps``."""
        return asdict(self)

    def to_csv(self) -> str:
        """A line for each pair: origin, destination, and minutes; empty where no path leads."""
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        tables = [each for each in (self.minutes, self.p50, self.p90) if each is not None]
        lines.writerow(["origin", "destination", *("minutes", "p50", "p90")[: len(tables)]])
        for row, origin in enumerate(self.origins):
            for column, destination in enumerate(self.destinations):
                found = (each[row][column] for each in tables)
                lines.writerow([origin.called, destination.called, *("" if each is None else each for each in found)])
        return text.getvalue()

    def to_text(self) -> str:
        """Tables for people."""
        crowds = "if crowds are as expected" if self.futures is None else f"in {self.futures} simulated futures"
        lines = [f"Minutes by {self.planner}, departing {self.departs}, {crowds}, from each row to each column:"]
        if self.destinations != self.origins:
            lines += ["", "columns:", *_numbered(self.destinations)]
        titled = (("expected", self.minutes), ("half arrive within", self.p50), ("90 % arrive within", self.p90))
        for title, minutes in titled:
            if minutes is not None:
                lines += ["", f"{title}:", *self._table(minutes)]
        return "\n".join([*lines, "", *self.notes()]) + "\n"

    def _table(self, minutes: Minutes) -> list[str]:
        """The numbers of the destinations stand above their columns, as many beside each other as there is room for."""
        froms = _numbered(self.origins) if self.destinations == self.origins else [_short(end) for end in self.origins]
        cells = [["none" if each is None else f"{each:.1f}" for each in row] for row in minutes]
        numbers = [f">{number}" for number in range(1, len(self.destinations) + 1)]
        widest = max(len(text) for row in [numbers, *cells] for text in row)
        room = max(1, (WIDE - max(map(len, froms))) // (widest + len("  ")))
        lines: list[str] = []
        for first in range(0, len(numbers), room):
            block = slice(first, first + room)
            rows = [[name, *row[block]] for name, row in zip(froms, cells, strict=True)]
            lines += [*([""] if lines else []), *table(["", *numbers[block]], rows)]
        return lines


def _short(end: End) -> str:
    return end.called if len(end.called) <= LONGEST_LABEL else f"{end.called[: LONGEST_LABEL - 1]}…"


def _numbered(ends: Sequence[End]) -> list[str]:
    width = len(str(len(ends)))
    return [f"{number:{width}}  {_short(end)}" for number, end in enumerate(ends, start=1)]


def time_matrix(located: Located, planner: Planner, origins: int, *, square: bool, futures: int | None) -> TimeMatrix:
    """Work out how long the walks take.

    Parameters
    ----------
    located
        With origins and then destinations as its ends.
    planner
        ``expected`` or ``shortest-path``: whose paths are walked.
    origins
        Number of origins.
    square
        Whether the origins are the destinations, too.
    futures
        How many to simulate; None: crowds are as expected.

    Returns
    -------
    TimeMatrix
        One search for each origin finds all of its row.

    Raises
    ------
    RouteError
        A departure so late that the crowds of the walks are not known (field ``depart``).
    """
    tos = slice(origins) if square else slice(origins, None)
    paths, ends = Paths(located, planner, futures), [end.node for end in located.ends[tos]]
    rows: dict[float | None, list[np.ndarray]] = {share: [] for share in paths.shares}
    for origin in located.ends[:origins]:
        reach = paths.reach(origin.node, ends)
        for share in paths.shares:
            rows[share].append(reach.seconds[share][ends])
    walked = np.stack(rows[None])
    located.check_covered(float(np.max(walked, initial=0.0, where=np.isfinite(walked))))
    found = {name: minutes_or_none(np.stack(rows[share])) for share, name in NAMES.items() if share in rows}
    return TimeMatrix(
        **vars(located.facts),
        origins=located.named_ends[:origins],
        destinations=located.named_ends[tos],
        planner=planner.name,
        futures=futures,
        minutes=found["expected"],
        p50=found.get("p50"),
        p90=found.get("p90"),
    )
