"""How long the walks from many places to many others take."""

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sidestep.files import reading
from sidestep.planners.base import Planner
from sidestep.routing.facts import End, SceneFacts
from sidestep.routing.formats import table
from sidestep.routing.located import Located
from sidestep.routing.request import Place, RouteError, at_fault, check_list, read_place
from sidestep.routing.trees import NAMES, Paths, minutes_or_none

MOST_PLACES = 1_000
"""The most origins or destinations of one matrix."""

Places = Sequence[Place | str] | Path | str
"""Places one after the other, or a file of them."""

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
                lines.writerow([origin.asked, destination.asked, *("" if each is None else each for each in found)])
        return text.getvalue()

    def to_text(self) -> str:
        """Tables for people."""
        crowds = "if crowds are as expected" if self.futures is None else f"in {self.futures} simulated futures"
        lines = [f"Minutes by {self.planner}, departing {self.departs}, {crowds}, from each row to each column:"]
        titled = (("expected", self.minutes), ("half arrive within", self.p50), ("90 % arrive within", self.p90))
        for title, minutes in titled:
            if minutes is not None:
                lines += ["", f"{title}:", *self._table(minutes)]
        return "\n".join([*lines, "", *self.notes()]) + "\n"

    def _table(self, minutes: Minutes) -> list[str]:
        rows = [
            [origin.asked, *("none" if each is None else f"{each:.1f}" for each in row)]
            for origin, row in zip(self.origins, minutes, strict=True)
        ]
        return table(["", *(f">{end.asked}" for end in self.destinations)], rows)


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
    """
    froms, tos = located.ends[:origins], located.ends[:origins] if square else located.ends[origins:]
    paths, ends = Paths(located, planner, futures), [end.node for end in tos]
    rows: dict[float | None, list[np.ndarray]] = {share: [] for share in paths.shares}
    for origin in froms:
        reach = paths.reach(origin.node, ends)
        for share in paths.shares:
            rows[share].append(reach.seconds[share][ends])
    found = {name: minutes_or_none(np.stack(rows[share])) for share, name in NAMES.items() if share in rows}
    return TimeMatrix(
        **vars(located.facts),
        origins=froms,
        destinations=tos,
        planner=planner.name,
        futures=futures,
        minutes=found["expected"],
        p50=found.get("p50"),
        p90=found.get("p90"),
    )


def read_places(field: str, given: Places) -> list[Place]:
    """Read places, or a file of them.

    Parameters
    ----------
    field
        For errors: ``origins`` or ``destinations``.
    given
        Places as :func:`~sidestep.routing.request.read_place` takes them. A file has one place a line, a node or
        latitude and longitude with a comma between them; what follows a second comma is ignored, and so are empty
        lines, lines that begin with #, and a heading.

    Returns
    -------
    list of Place
        At least one.

    Raises
    ------
    RouteError
        Files that cannot be read, text that is no place, no places, or more than ``MOST_PLACES``.
    """
    if isinstance(given, (str, Path)):
        with at_fault(field), reading(Path(given), RouteError, "places") as file:
            places = list(_lines(field, file.read().decode("utf-8-sig")))
    else:
        check_list(field, given)
        places = [found for each in given if (found := read_place(field, each)) is not None]
    if not 1 <= len(places) <= MOST_PLACES:
        raise RouteError(f"give 1 to {MOST_PLACES:,} {field}, not {len(places):,}", field=field)
    return places


def _lines(field: str, text: str) -> Iterator[Place]:
    for number, line in enumerate(text.splitlines(), start=1):
        words = [word.strip() for word in line.split(",")]
        heading = number == 1 and words[0].lower() in ("lat", "latitude", "node")
        if heading or not any(words) or line.lstrip().startswith("#"):
            continue
        try:
            place = read_place(field, ",".join(words[:2]) if len(words) > 1 else words[0])
        except RouteError as error:
            raise RouteError(f"line {number}: {error}", field=field, line=number) from error
        if place is not None:
            yield place
