"""What an OpenStreetMap file holds for walkers, as tables: ways, areas, nodes, and what stands in the way."""

from array import array
from collections import Counter
from dataclasses import dataclass, field, fields

import numpy as np
from jaxtyping import Float64, Int64

from sidestep.network.access import Access
from sidestep.network.streets import Nodes
from sidestep.network.tags import ACROSS, AREA, KINDS, SPECIAL


@dataclass(eq=False)
class Courses:
    """Ways as lists of nodes, compactly: extracts hold millions of nodes."""

    refs: "array[int]" = field(default_factory=lambda: array("q"))
    """Node numbers of all ways one after another."""
    counts: "array[int]" = field(default_factory=lambda: array("q"))
    """Nodes of each way."""
    names: "array[int]" = field(default_factory=lambda: array("l"))
    """Code of each way's name."""

    def add(self, refs: list[int], name: int = 0) -> None:
        """Add a way."""
        self.refs.extend(refs)
        self.counts.append(len(refs))
        self.names.append(name)


@dataclass(eq=False)
class Ways(Courses):
    """Walkable ways; their nodes are in walking direction where a way is one-way."""

    kinds: "array[int]" = field(default_factory=lambda: array("l"))
    """Position of each way's kind in ``KINDS``."""
    widths: "array[float]" = field(default_factory=lambda: array("d"))
    """Metres available to walkers."""
    one_way: "array[int]" = field(default_factory=lambda: array("b"))
    """1 where a way is walked in one direction only."""
    second: "array[int]" = field(default_factory=lambda: array("b"))
    """1 for the second of two rows of one way, which differ in direction and access."""
    openings: "array[int]" = field(default_factory=lambda: array("l"))
    """Code of each way's opening times."""
    restricted: "array[int]" = field(default_factory=lambda: array("b"))
    """1 for ways that only lead to destinations."""
    inclines: "array[float]" = field(default_factory=lambda: array("d"))
    """Rise for each metre; NaN where it is unknown."""
    kerbs: "array[float]" = field(default_factory=lambda: array("d"))
    """Metres of the highest kerb."""
    levels: "array[int]" = field(default_factory=lambda: array("l"))
    """Code of the level of each way; 0 where none is tagged."""
    crossing: "array[int]" = field(default_factory=lambda: array("b"))
    """1 where a way leads over a carriageway."""
    storeys: "array[int]" = field(default_factory=lambda: array("b"))
    """Storey on which each way meets areas without a common node; -1 for none."""

    def replace_nodes(self, refs: Int64[np.ndarray, " stop"], counts: Int64[np.ndarray, " way"]) -> None:
        """Give ways other nodes.

        Parameters
        ----------
        refs
            Node numbers of all ways one after another.
        counts
            Nodes of each way.
        """
        self.refs, self.counts = array("q", refs.tobytes()), array("q", counts.astype(np.int64).tobytes())

    def copy(self, other: "Ways", row: int, refs: list[int], across: float | None = None) -> None:
        """Add a way with the tags of another, which is an area if there is a width across; it is walked both ways.

        Parameters
        ----------
        other, row
            Table and row of the other.
        refs
            Node numbers of the new one.
        across
            Metres that are available to walkers on the way across the area.
        """
        self.add(refs, other.names[row])
        for column in _COLUMNS:
            getattr(self, column).append(getattr(other, column)[row])
        if across is not None:
            self.widths[-1] = across
            if KINDS[self.kinds[-1]] not in ACROSS | SPECIAL:
                self.kinds[-1] = KINDS.index(AREA)


_COLUMNS = [column.name for column in fields(Ways)[len(fields(Courses)) :]]


@dataclass(eq=False)
class Areas(Ways):
    """Walkable areas by their rings; those of one area come one after another and have the same tags."""

    numbers: "array[int]" = field(default_factory=lambda: array("l"))
    """Number of the area that each ring belongs to."""
    inner: "array[int]" = field(default_factory=lambda: array("b"))
    """1 for rings around holes."""
    whole: "array[int]" = field(default_factory=lambda: array("b"))
    """1 for rings of areas all of whose rings are known and close."""


class Codes(dict[str, int]):
    """Texts and their codes, in order; "" is 0."""

    def __init__(self) -> None:
        super().__init__({"": 0})

    def __missing__(self, text: str) -> int:
        return self.setdefault(text, len(self))


@dataclass(eq=False)
class Extract:
    """What a file holds for walkers."""

    ways: Ways = field(default_factory=Ways)
    """What is walked."""
    areas: Areas = field(default_factory=Areas)
    """What is walked across; `sidestep.network.areas` makes ways of it."""
    roads: Courses = field(default_factory=Courses)
    """Streets with names that are not walked themselves, such as those whose pavements are ways of their own."""
    ferries: Courses = field(default_factory=Courses)
    """Ferries that take walkers."""
    nodes: Nodes = field(default_factory=lambda: Nodes(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0, np.int8)))
    """All nodes along these, also those that the file lacks."""
    passages: dict[int, Access] = field(default_factory=dict)
    """Who may pass the nodes, by number, that are not always open to everybody."""
    kerbs: dict[int, float] = field(default_factory=dict)
    """Metres of the kerbs at nodes, by number."""
    lifts: set[int] = field(default_factory=set)
    """Numbers of nodes that are lifts between levels."""
    names: Codes = field(default_factory=Codes)
    openings: Codes = field(default_factory=Codes)
    levels: Codes = field(default_factory=Codes)
    read: int = 0
    """Ways and areas that people might walk: those with a ``highway`` tag, platforms, piers and ferries."""
    walkable: int = 0
    """Ways and areas of these that are walked."""
    crossed: int = 0
    """Areas that are walked across."""
    dropped: Counter[str] = field(default_factory=Counter)
    """Number of ways that are not walked, by reason."""
    repaired: Counter[str] = field(default_factory=Counter)
    """Number of ways and nodes that were changed, or tags ignored, by what was done."""
    limited: Counter[str] = field(default_factory=Counter)
    """Number of ways and nodes that are not open to everybody at all times, by how."""
    located: tuple["array[int]", "array[float]"] = field(default_factory=lambda: (array("q"), array("d")))
    """Numbers of nodes whose places stand with the ways, and these places: longitude, latitude."""

    def add_nodes(self, places: Float64[np.ndarray, "new 2"]) -> Int64[np.ndarray, " node"]:
        """Add nodes with invented numbers, lower than all others.

        Parameters
        ----------
        places
            Their longitudes and latitudes.

        Returns
        -------
        Int64[np.ndarray, " node"]
            The numbers of all nodes, those that were there in their order before the new ones in the order given.
        """
        old, new = self.nodes, len(places)
        invented = min(int(old.ids.min(initial=0)), 0) - new + np.arange(new)
        self.nodes = Nodes(
            np.concatenate([invented, old.ids]),
            np.concatenate([places, old.place]),
            np.append(np.zeros(new, np.int8), old.kind),
        )
        return np.concatenate([old.ids, invented])
