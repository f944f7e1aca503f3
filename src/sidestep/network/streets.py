"""Streets and nodes while they are imported, as columns of tables."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float64, Int, Int8, Int64

from sidestep.network.geodesy import course_lengths
from sidestep.network.tags import KINDS, SPECIAL

LONG_LOOP = 50.0
"""Metres from which a street that leads back to where it begins is kept, as two streets."""


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes along walkable ways, in the order of their numbers; after them invented ones, if any."""

    ids: Int64[np.ndarray, " node"]
    """OpenStreetMap's numbers, ascending; invented ones are negative and lower than all others."""
    place: Float64[np.ndarray, "node 2"]
    """Longitude and latitude in degrees; NaN where the file lacks the node."""
    kind: Int8[np.ndarray, " node"]
    """See `sidestep.network.tags.CrossingKind`."""

    def indices(self, numbers: Collection[int]) -> Int64[np.ndarray, " number"]:
        """Find nodes by their numbers, before any are invented.

        Parameters
        ----------
        numbers
            Numbers of nodes that are among these.

        Returns
        -------
        Int64[np.ndarray, " number"]
            Their indices, in the order given.
        """
        return np.searchsorted(self.ids, np.array(list(numbers), np.int64))

    def copied(self, which: Int[np.ndarray, " copy"]) -> "Nodes":
        """Add nodes with invented numbers.

        Parameters
        ----------
        which
            The node in whose place each new one stands.

        Returns
        -------
        Nodes
            These and, at the end, the new ones, which are no crossings.
        """
        invented = min(int(self.ids.min(initial=0)), 0) - 1 - np.arange(len(which))
        place = np.concatenate([self.place, self.place[which]])
        return Nodes(np.append(self.ids, invented), place, np.append(self.kind, np.zeros(len(which), np.int8)))


@dataclass(frozen=True, eq=False)
class Streets:
    """Streets between numbered nodes, with their courses; see `sidestep.network.town.Town` for the columns.

    ``ends`` are tail and head; ``traffic`` are crossings of vehicle traffic without signals, and with them. Kinds,
    names and opening times are codes; code 0 of the last is always open. Unlike a town, streets may be loops, and there
    may be none.
    """

    ends: Int64[np.ndarray, "street 2"]
    one_way: Bool[np.ndarray, " street"]
    length: Float64[np.ndarray, " street"]
    width: Float64[np.ndarray, " street"]
    kind: Int64[np.ndarray, " street"]
    name: Int64[np.ndarray, " street"]
    traffic: Int64[np.ndarray, "street 2"]
    opening: Int64[np.ndarray, " street"]
    restricted: Bool[np.ndarray, " street"]
    incline: Float64[np.ndarray, " street"]
    kerb: Float64[np.ndarray, " street"]
    points: Float64[np.ndarray, "point 2"]
    first: Int64[np.ndarray, " border"]

    def __len__(self) -> int:
        return len(self.ends)

    @property
    def category(self) -> Int64[np.ndarray, " street"]:
        """Number of what each street is to walkers; 0: open to everybody at all times, and level.

        Streets of different categories are never joined or weighed against each other, and none but the ordinary ones
        of category 0 vanish in merged crossings: behind a gate, up stairs or by a lift not everybody can go.
        """
        special = np.array([kind in SPECIAL for kind in KINDS])[self.kind]
        code = (2 * special * (self.kind + 1) + self.restricted) * 2 + (self.kerb > 0)
        code = code * (self.opening.max(initial=0) + 1) + self.opening
        return np.unique(np.append(0, code), return_inverse=True)[1][1:]

    def keep(self, which: Bool[np.ndarray, " street"]) -> "Streets":
        """Select streets.

        Parameters
        ----------
        which
            Whether to keep each street.

        Returns
        -------
        Streets
            Those to keep, in their order.
        """
        rows = np.flatnonzero(which)
        order, first = ranges(self.first[rows], np.diff(self.first)[rows])
        columns = {field.name: getattr(self, field.name)[rows] for field in fields(self)[:-2]}
        return Streets(**columns, points=self.points[order], first=first)


def straight_streets(
    ends: Int[np.ndarray, "street 2"], place: Float64[np.ndarray, "node 2"], kind: int, width: float
) -> Streets:
    """Make straight streets without names, walked both ways by everybody at all times.

    Parameters
    ----------
    ends
        Nodes that each street joins.
    place
        Longitude and latitude of all nodes.
    kind
        Code of their kind.
    width
        Metres available to walkers.

    Returns
    -------
    Streets
        One street for each pair of ends.
    """
    points, many = place[ends.ravel()], len(ends)
    first = np.arange(0, 2 * many + 1, 2)
    return Streets(
        ends=ends,
        one_way=np.zeros(many, bool),
        length=course_lengths(points, first),
        width=np.full(many, width),
        kind=np.full(many, kind),
        name=np.zeros(many, np.int64),
        traffic=np.zeros((many, 2), np.int64),
        opening=np.zeros(many, np.int64),
        restricted=np.zeros(many, bool),
        incline=np.full(many, np.nan),
        kerb=np.zeros(many),
        points=points,
        first=first,
    )


def join_streets(parts: Sequence[Streets]) -> Streets:
    """Put tables of streets one after another.

    Parameters
    ----------
    parts
        Streets between the same nodes.

    Returns
    -------
    Streets
        All of them.
    """
    columns = {field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Streets)}
    counts = np.concatenate([np.diff(part.first) for part in parts])
    return Streets(**{**columns, "first": np.append(0, np.cumsum(counts))})


def ranges(
    start: Int[np.ndarray, " range"], count: Int[np.ndarray, " range"], step: Int[np.ndarray, " range"] | int = 1
) -> tuple[Int[np.ndarray, " number"], Int64[np.ndarray, " border"]]:
    """List the numbers of several ranges one after another.

    Parameters
    ----------
    start, count, step
        First number of each range, how many there are, and the distance between them.

    Returns
    -------
    Int[np.ndarray, " number"], Int64[np.ndarray, " border"]
        The numbers; and where among them each range begins, with their total at last.
    """
    first = np.concatenate([[0], np.cumsum(count, dtype=np.int64)]).astype(np.int64)
    within = np.arange(first[-1]) - np.repeat(first[:-1], count)
    return np.repeat(start, count) + within * np.repeat(np.broadcast_to(step, len(count)), count), first
