"""The road network: nodes where streets meet, and directed segments between them."""

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int32

from sidestep.arguments import COUNT, checked
from sidestep.errors import SidestepError
from sidestep.network.checks import array, check_each, check_edges

ABSENT = -1
"""Stands where there is no street: in tables of nodes and segments, and in the paper's matrices D and P."""
SHUT = -2
"""Stands where segments are never open, in place of the restricted area that they enter."""


Areas = tuple[Int32[np.ndarray, " node"], Int32[np.ndarray, " segment"]]
""":attr:`RoadNetwork.area` and :attr:`RoadNetwork.enters`."""


_NODES = array(np.int32, "a list of numbers of nodes", 1)
_POSITIONS = array(np.float32, "a list of x and y in metres", 2)


class NetworkError(SidestepError):
    """An invalid road network; ``field`` names the argument at fault."""


class RoadNetwork(eqx.Module):
    """Nodes and directed segments, padded so that every node has the same number of exits.

    Exit k of node i is the segment ``exit_segment[i, k]`` and leads to node ``exit_node[i, k]``; both are -1 where the
    node has fewer exits. On grids the exits are the paper's actions (eq. 11): 0 up, 1 down, 2 right, 3 left.

    Examples
    --------
    >>> import sidestep
    >>> corners = [[0, 0], [300, 0], [0, 400]]
    >>> network = sidestep.road_network(corners, tail=[0, 1, 0], head=[1, 2, 2], length=[300, 500, 400])
    >>> network.nodes, network.segments, network.exits
    (3, 3, 2)
    >>> network.exit_node.tolist()
    [[1, 2], [2, -1], [-1, -1]]
    >>> network.distance_matrix().tolist()
    [[-1.0, 300.0, 400.0], [-1.0, -1.0, 500.0], [-1.0, -1.0, -1.0]]
    """

    position: Float[Array, "node 2"]
    """x and y in metres."""
    exit_node: Int[Array, "node exit"]
    """Node that each exit leads to, -1 where there is none."""
    exit_segment: Int[Array, "node exit"]
    """Segment that each exit is, -1 where there is none."""
    tail: Int[Array, " segment"]
    """Node where each segment begins."""
    head: Int[Array, " segment"]
    """Node where each segment ends."""
    length: Float[Array, " segment"]
    """Metres."""
    width: Float[Array, " segment"]
    """Metres."""
    area: Int[Array, " node"] | None = None
    """Restricted area that each node is inside of, -1 where it is in none; None where there are no such areas."""
    enters: Int[Array, " segment"] | None = None
    """Restricted area that each segment enters from outside, -1 where it enters none; -2 on segments that are never
    open. None where there are no such areas."""
    pace: Float[Array, " segment"] | None = None
    """Speed on each segment over that on level ground, for those who walk here; None where all are 1."""

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.exit_node.shape[0]

    @property
    def exits(self) -> int:
        """Largest number of segments that leave one node."""
        return self.exit_node.shape[1]

    @property
    def segments(self) -> int:
        """Number of directed segments."""
        return self.tail.shape[0]

    @property
    def valid(self) -> Bool[Array, "node exit"]:
        """Which exits exist."""
        return self.exit_node != ABSENT

    def exits_to(
        self, destination: Int[Array, ""] | Bool[Array, " node"], node: Int[Array, "*n"] | slice = slice(None)
    ) -> Bool[Array, "*n exit"]:
        """Say which exits a walk may take, by where it ends.

        Restricted areas may always be left, and are entered only by walks that end in them. Every search, every cost to
        go and every step of a walker goes by this rule.

        Parameters
        ----------
        destination
            Node where the walk ends, or the nodes at one of which it ends.
        node
            Nodes whose exits are wanted; by default all.

        Returns
        -------
        Bool[Array, "*n exit"]
            Which exits exist and may be taken.
        """
        exists = self.exit_node[node] != ABSENT
        return exists if self.enters is None else exists & self.may_take(destination, self.exit_segment[node])

    def may_take(
        self, destination: Int[Array, ""] | Bool[Array, " node"], segment: Int[Array, "*n"] | slice = slice(None)
    ) -> Bool[Array, "*n"]:
        """Say which segments a walk may take: the rule of :meth:`exits_to`.

        Parameters
        ----------
        destination
            As there.
        segment
            Segments; by default all.

        Returns
        -------
        Bool[Array, "*n"]
            Whether each may be taken.
        """
        if self.area is None or self.enters is None:
            return jnp.asarray(np.ones(self.tail[segment].shape, bool))  # plain numbers need no compiled program
        enters = self.enters[segment]
        if jnp.ndim(destination) == 0:
            ends_there = enters == self.area[destination]
        else:  # fewer areas than segments; the last entry is that of nodes in no area
            ends_in = jnp.zeros(self.segments + 1, bool).at[self.area].max(destination)
            ends_there = (enters >= 0) & ends_in[enters]
        return (enters == ABSENT) | ends_there

    def exits_from(
        self, origin: Int[Array, ""], node: Int[Array, "*n"] | slice = slice(None)
    ) -> Bool[Array, "*n exit"]:
        """Say which exits walks from a node may take that end at the nodes that they reach, wherever that is.

        A search for all destinations at once enters restricted areas, but leaves only that of the origin. (Where the
        way from one node of that area to another is shorter outside, walks may come back, and leave it once more.)

        Parameters
        ----------
        origin
            Node where the walks begin.
        node
            Nodes whose exits are wanted; by default all.

        Returns
        -------
        Bool[Array, "*n exit"]
            Which exits exist and may be taken.
        """
        exists = self.exit_node[node] != ABSENT
        if self.area is None or self.enters is None:
            return exists
        segment = self.exit_segment[node]
        enters = self.enters[segment]
        area = jnp.where(enters == ABSENT, self.area[self.tail[segment]], enters)
        leaves = (area >= 0) & (self.area[self.head[segment]] == ABSENT)
        return exists & (area != SHUT) & (~leaves | ((enters == ABSENT) & (area == self.area[origin])))

    def owners(self) -> Int[np.ndarray, " segment"]:
        """Number of the restricted area that each segment belongs to; negative for those of none.

        Returns
        -------
        Int[np.ndarray, " segment"]
            As in ``area`` and ``enters``.
        """
        if self.area is None or self.enters is None:
            return np.full(self.segments, ABSENT)
        enters = np.asarray(self.enters)
        return np.where(enters == ABSENT, np.asarray(self.area)[np.asarray(self.tail)], enters)

    def opened(self, area: int) -> "RoadNetwork":
        """The same network in which everybody may walk one of the restricted areas.

        Parameters
        ----------
        area
            Its number.

        Returns
        -------
        RoadNetwork
            Nodes, segments and exits have the same numbers.
        """
        if self.area is None or self.enters is None:
            return self
        rows = (
            np.where(np.asarray(row) == area, np.int32(ABSENT), np.asarray(row)) for row in (self.area, self.enters)
        )
        return replace(self, area=jax.device_put(next(rows)), enters=jax.device_put(next(rows)))

    def without(self, closed: Bool[np.ndarray, " segment"]) -> "RoadNetwork":
        """The same network in which nobody walks some of the segments: no exit leads onto them.

        Parameters
        ----------
        closed
            Which segments.

        Returns
        -------
        RoadNetwork
            Nodes, segments and exits have the same numbers.
        """
        segment = np.asarray(self.exit_segment)
        gone = (segment != ABSENT) & closed[segment]
        node = np.where(gone, ABSENT, np.asarray(self.exit_node))
        exits = jax.device_put((node.astype(np.int32), np.where(gone, ABSENT, segment).astype(np.int32)))
        return replace(self, exit_node=exits[0], exit_segment=exits[1])

    def distance_matrix(self) -> Float[Array, "node node"]:
        """Arrange lengths as the paper's matrix D (eq. 1).

        Returns
        -------
        Float[Array, "node node"]
            Metres from node i to node j, -1 where no segment leads there.
        """
        return self.matrix(self.length)

    def matrix(self, value: Float[Array, " segment"]) -> Float[Array, "node node"]:
        """Arrange a value per segment as a node-by-node matrix (the paper's eqs. 1 and 2).

        Parameters
        ----------
        value
            One number for each segment.

        Returns
        -------
        Float[Array, "node node"]
            The value of the segment from node i to node j, -1 where there is none.

        Raises
        ------
        NetworkError
            Too few values, or too many (field ``value``).
        """
        if jnp.shape(value) != (self.segments,):
            said = f"value must be one number for each of the {self.segments} segments"
            raise NetworkError(f"{said}, not of shape {jnp.shape(value)}", field="value")
        return jnp.full((self.nodes, self.nodes), float(ABSENT)).at[self.tail, self.head].set(jnp.asarray(value))

    def straight_line(self, node: Int[Array, ""], destination: Int[Array, ""]) -> Float[Array, ""]:
        """Compute the straight-line distance to a destination (the paper's phi).

        Parameters
        ----------
        node, destination
            Nodes.

        Returns
        -------
        Float[Array, ""]
            Metres.
        """
        return jnp.linalg.norm(self.position[node] - self.position[destination])


@checked(
    NetworkError,
    position=_POSITIONS,
    tail=_NODES,
    head=_NODES,
    length=array(np.float32, "a list of metres", 1),
    width=array(np.float32, "metres, one number or a list", 0, 1),
    exit_of=array(np.int32, "a list of numbers of exits", 1),
    exits=COUNT,
)
def road_network(
    position: Sequence[Sequence[float]] | np.ndarray,
    tail: Sequence[int] | np.ndarray,
    head: Sequence[int] | np.ndarray,
    length: Sequence[float] | np.ndarray,
    *,
    width: Sequence[float] | np.ndarray | float = 1.0,
    exit_of: Sequence[int] | np.ndarray | None = None,
    exits: int | None = None,
    areas: Areas | None = None,
) -> RoadNetwork:
    """Build a network from its directed segments.

    Parameters
    ----------
    position
        x and y of the nodes in metres, shape (node, 2).
    tail, head
        Node where each segment begins and ends.
    length, width
        Metres, positive. A width of 1 m makes density the paper's p/d.
    exit_of
        Which exit of its tail each segment is; by default in the order given.
    exits
        Number of exits to pad to; by default as many as the busiest node has.
    areas
        Restricted areas: the one that each node is inside of, and the one that each segment enters; by default none.

    Returns
    -------
    RoadNetwork
        The network.

    Raises
    ------
    NetworkError
        Unknown nodes, loops, lengths or widths that are not positive, unknown exits, two segments on one exit.

    Examples
    --------
    A street of 80 m, walked in both directions, and a one-way street of 60 m:

    >>> import sidestep
    >>> network = sidestep.road_network(
    ...     [[0, 0], [80, 0], [80, 60]], tail=[0, 1, 1], head=[1, 0, 2], length=[80, 80, 60], width=[3, 3, 1.5]
    ... )
    >>> network.exit_segment.tolist()
    [[0, -1], [1, 2], [-1, -1]]
    """
    position = np.asarray(position, np.float32)
    tail, head = np.asarray(tail, np.int32), np.asarray(head, np.int32)
    length, width = np.asarray(length, np.float32), np.asarray(width, np.float32)
    if width.shape not in ((), length.shape):
        raise NetworkError(f"there are {len(length)} segments, but {len(width)} widths", field="width")
    width = np.broadcast_to(width, length.shape)
    nodes, segments = len(position), len(tail)
    if segments == 0 or not segments == len(head) == len(length):
        raise NetworkError(
            f"a network needs a tail, a head and a length for each segment: there are {segments} tails, "
            f"{len(head)} heads and {len(length)} lengths",
            field="tail",
        )
    if position.shape[1:] != (len(("x", "y")),) or not np.isfinite(position).all():
        raise NetworkError("position must be x and y in metres, two finite numbers for each node", field="position")
    check_edges(NetworkError, "segment", nodes, {"tail": tail, "head": head, "length": length, "width": width})
    exit_of = np.asarray(_rank_within(tail) if exit_of is None else exit_of, np.int32)
    if exit_of.shape != tail.shape:
        raise NetworkError(f"there are {segments} segments, but {len(exit_of)} exits", field="exit_of")
    exits = int(exit_of.max()) + 1 if exits is None else exits
    known = (exit_of >= 0) & (exit_of < exits)
    check_each(NetworkError, "segment", "exit_of", exit_of, known, f"be an exit, 0 to {exits - 1}")
    slot = tail.astype(np.int64) * exits + exit_of
    _, first, which = np.unique(slot, return_index=True, return_inverse=True)
    alone = first[which] == np.arange(segments)
    check_each(NetworkError, "segment", "exit_of", exit_of, alone, "differ from that of other segments with its tail")
    exit_node = np.full((nodes, exits), ABSENT, np.int32)
    exit_segment = np.full((nodes, exits), ABSENT, np.int32)
    exit_node.flat[slot], exit_segment.flat[slot] = head, np.arange(segments)
    columns = (position, exit_node, exit_segment, tail, head, length, width, *(areas or ()))
    return RoadNetwork(*map(jax.device_put, columns))


def disjoint_union(networks: Sequence[RoadNetwork]) -> RoadNetwork:
    """Join networks into one without streets between them; nodes and segments are numbered on in the order given.

    Parameters
    ----------
    networks
        At least one.

    Returns
    -------
    RoadNetwork
        All nodes, segments and restricted areas; one network alone is returned as it is.
    """
    if len(networks) == 1:
        return networks[0]
    names = ("position", "tail", "head", "length", "width")
    position, tail, head, length, width = (np.concatenate([getattr(each, name) for each in networks]) for name in names)
    first_node = np.cumsum([0, *(each.nodes for each in networks[:-1])])
    shift = np.repeat(first_node, [each.segments for each in networks])
    exit_of = np.concatenate([_exit_of(each) for each in networks])
    exits = max(each.exits for each in networks)
    areas = _areas_of_all(networks)
    return road_network(
        position, tail + shift, head + shift, length, width=width, exit_of=exit_of, exits=exits, areas=areas
    )


def _areas_of_all(networks: Sequence[RoadNetwork]) -> Areas | None:
    """The restricted areas of several networks, numbered on in the order given; None where none has any."""
    if all(each.enters is None for each in networks):
        return None
    found: list[list[np.ndarray]] = [[], []]
    first = 0
    for each in networks:
        for numbers, own, count in zip(found, (each.area, each.enters), (each.nodes, each.segments), strict=True):
            mine = np.full(count, ABSENT, np.int32) if own is None else np.asarray(own)
            numbers.append(np.where(mine >= 0, mine + first, mine))
        first = 1 + max(first - 1, *(int(numbers[-1].max()) for numbers in found))
    area, enters = map(np.concatenate, found)
    return area, enters


def _exit_of(network: RoadNetwork) -> Int[np.ndarray, " segment"]:
    """Which exit of its tail each segment is."""
    exit_segment = np.asarray(network.exit_segment)
    node, number = np.nonzero(exit_segment != ABSENT)
    return number[np.argsort(exit_segment[node, number])]


def _rank_within(group: Int[np.ndarray, " item"]) -> Int[np.ndarray, " item"]:
    """0, 1, 2, … within each group, in order of appearance."""
    order = np.argsort(group, kind="stable")
    rank = np.empty(len(group), np.int32)
    rank[order] = np.arange(len(group)) - np.searchsorted(group[order], group[order])
    return rank
