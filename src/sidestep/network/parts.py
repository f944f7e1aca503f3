"""The part of a town that is left where some of its streets are not walked."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Int, Int64

from sidestep.network.connected import components
from sidestep.network.streets import ranges
from sidestep.network.town import ARRAYS, WORDS, Town, TownError


@dataclass(frozen=True, eq=False)
class TownPart:
    """Some streets of a town, in which every crossing that they lead to can be reached from every other.

    Crossings have the same numbers as in the whole town: those that are not in the part are crossings without streets.
    """

    whole: Town
    """The town."""
    town: Town
    """What is left of it; the town itself where that is all."""
    street: Int64[np.ndarray, " street"]
    """Number in the whole town of each street that is left."""

    @property
    def left_out(self) -> int:
        """Number of streets that are not in the part."""
        return self.whole.streets - self.town.streets

    @cached_property
    def crossings(self) -> Int[np.ndarray, " crossing"]:
        """Numbers of the crossings that streets of the part lead to, ascending."""
        return np.unique([self.town.tail, self.town.head])

    def segments(self) -> Int64[np.ndarray, " segment"]:
        """Relate the part's segments to those of the whole town.

        Returns
        -------
        Int64[np.ndarray, " segment"]
            Number in ``whole.network()`` of each segment of ``town.network()``.
        """
        back = np.cumsum(~self.whole.one_way) - 1 + self.whole.streets
        street, backwards = self.town.street_of_segment()
        return np.where(backwards, back[self.street[street]], self.street[street])


def largest_part(town: Town, walked: Bool[np.ndarray, " street"]) -> TownPart:
    """Leave out streets, and those that are then cut off from the largest part.

    Parameters
    ----------
    town
        The streets.
    walked
        Which of them to keep. If all are, the town stays as it is, even if it is not in one part.

    Returns
    -------
    TownPart
        The largest part in which every crossing can be reached from every other.

    Raises
    ------
    TownError
        Nothing is left.
    """
    if walked.all():
        return TownPart(town, town, np.arange(town.streets))
    rows = np.flatnonzero(walked)
    if len(rows):
        component = _components(town, rows)
        largest = np.bincount(component).argmax()
        rows = rows[(component[town.tail[rows]] == largest) & (component[town.head[rows]] == largest)]
    if not len(rows):
        raise TownError(f"none of the {town.streets} streets is left", field="walked")
    order, first = ranges(town.first[rows], np.diff(town.first)[rows])
    columns: dict[str, Any] = {
        name: getattr(town, name)[rows] for name in ARRAYS if name not in ("place", "ids", "points", "first")
    }
    columns |= {name: tuple(getattr(town, name)[row] for row in rows.tolist()) for name in WORDS}
    return TownPart(town, replace(town, **columns, points=town.points[order], first=first), rows)


def _components(town: Town, rows: Int[np.ndarray, " street"]) -> Int[np.ndarray, " node"]:
    """Number the component of each crossing in which all can be reached from each other by some of the streets."""
    back = rows[~town.one_way[rows]]
    tail = np.concatenate([town.tail[rows], town.head[back]])
    head = np.concatenate([town.head[rows], town.tail[back]])
    return components(town.nodes, tail, head)
