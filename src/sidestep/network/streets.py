"""Streets and nodes while they are imported, as columns of tables; the streets that form one connected town."""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float64, Int, Int8, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sidestep.network.tags import SPECIAL, WIDTHS


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes along walkable ways, in the order of their numbers."""

    ids: Int64[np.ndarray, " node"]
    """OpenStreetMap's numbers, ascending."""
    place: Float64[np.ndarray, "node 2"]
    """Longitude and latitude in degrees; NaN where the file lacks the node."""
    kind: Int8[np.ndarray, " node"]
    """See `sidestep.network.tags.CrossingKind`."""


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
        special = np.array([kind in SPECIAL for kind in WIDTHS])[self.kind]
        codes = np.stack([special * (self.kind + 1), self.restricted, self.kerb > 0, self.opening], axis=1)
        return np.unique(np.vstack([np.zeros(4, np.int64), codes]), axis=0, return_inverse=True)[1][1:]

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


def largest_component(streets: Streets) -> Bool[np.ndarray, " street"]:
    """Find the largest part of a town in which every node can be reached from every other.

    Parameters
    ----------
    streets
        At least one.

    Returns
    -------
    Bool[np.ndarray, " street"]
        Whether each street is in the strongly connected component with the most nodes.
    """
    nodes = int(streets.ends.max()) + 1
    tail, head = np.concatenate([streets.ends, streets.ends[~streets.one_way, ::-1]]).T
    links = coo_array((np.ones(len(tail), np.int32), (tail, head)), shape=(nodes, nodes))
    _, component = connected_components(links, connection="strong")
    return (component[streets.ends] == np.bincount(component).argmax()).all(axis=1)
