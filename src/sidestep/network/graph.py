"""The road network: nodes where streets meet, and directed segments between them."""

from collections.abc import Iterable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.errors import SidestepError

ABSENT = -1  # where there is no street: in tables of nodes and segments, and in the paper's matrices D and P


class NetworkError(SidestepError):
    """A road network that cannot be: says which part is wrong."""


class RoadNetwork(eqx.Module):
    """Nodes and directed segments, padded so that every node has the same number of exits.

    An *exit* is a way out of a node: exit k of node i is segment ``exit_segment[i, k]`` and ends at
    ``exit_node[i, k]``; both are -1 where the node has fewer exits. On grids the exits are the paper's
    actions (eq. 11): 0 up, 1 down, 2 right, 3 left.
    """

    position: Float[Array, "node 2"]  # x, y in metres
    exit_node: Int[Array, "node exit"]
    exit_segment: Int[Array, "node exit"]
    tail: Int[Array, " segment"]  # node where a segment begins
    head: Int[Array, " segment"]  # node where it ends
    length: Float[Array, " segment"]  # m
    width: Float[Array, " segment"]  # m

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

    def distance_matrix(self) -> Float[Array, "node node"]:
        """Lengths in metres from node i to node j, -1 where no segment leads there (the paper's D, eq. 1)."""
        return self.matrix(self.length)

    def matrix(self, value: Float[Array, " segment"]) -> Float[Array, "node node"]:
        """A value per segment as a node-by-node matrix, -1 where there is no segment (eqs. 1 and 2)."""
        return jnp.full((self.nodes, self.nodes), float(ABSENT)).at[self.tail, self.head].set(value)

    def straight_line(self, node: Int[Array, ""], destination: Int[Array, ""]) -> Float[Array, ""]:
        """Distance in metres as the crow flies (the paper's phi)."""
        return jnp.linalg.norm(self.position[node] - self.position[destination])


def road_network(
    position: np.ndarray,
    tail: Sequence[int] | np.ndarray,
    head: Sequence[int] | np.ndarray,
    length: Sequence[float] | np.ndarray,
    *,
    width: Sequence[float] | np.ndarray | float = 1.0,
    exit_of: Sequence[int] | np.ndarray | None = None,
    exits: int | None = None,
) -> RoadNetwork:
    """Build a network from its directed segments.

    Parameters
    ----------
    position
        Nodes' x and y in metres, shape (node, 2).
    tail, head
        Node where each segment begins and ends.
    length, width
        Metres, positive. A width of 1 m makes density the paper's p/d.
    exit_of
        Which exit of its tail each segment is; by default in the order given.
    exits
        Number of exits to pad to; by default as many as the busiest node has.

    Raises
    ------
    NetworkError
        Unknown nodes, loops, lengths or widths that are not positive, unknown exits, two segments on one exit.
    """
    position = np.asarray(position, np.float32)
    tail, head = np.asarray(tail, np.int32), np.asarray(head, np.int32)
    length = np.asarray(length, np.float32)
    width = np.asarray(width, np.float32)
    if width.shape not in ((), length.shape):
        raise NetworkError(f"there are {len(length)} segments, but {len(width)} widths")
    width = np.broadcast_to(width, length.shape)
    nodes = len(position)
    if len(tail) == 0 or not len(tail) == len(head) == len(length):
        raise NetworkError(f"a network needs segments: {len(tail)} tails, {len(head)} heads, {len(length)} lengths")
    _check_segments(tail, head, length, width, nodes)
    if exit_of is None:
        exit_of = _rank_within(tail)
    exit_of = np.asarray(exit_of, np.int32)
    exits = int(exit_of.max()) + 1 if exits is None else exits
    if exit_of.min() < 0 or exit_of.max() >= exits:
        raise NetworkError(f"exits are numbered 0 to {exits - 1}, but there are {exit_of.min()} to {exit_of.max()}")
    exit_node = np.full((nodes, exits), ABSENT, np.int32)
    exit_segment = np.full((nodes, exits), ABSENT, np.int32)
    slot = tail.astype(np.int64) * exits + exit_of
    order = np.argsort(slot, kind="stable")
    shared = slot[order[1:]] == slot[order[:-1]]
    if shared.any():
        # The one that comes first in the list, as if the segments were put in one by one.
        segment = int(order[1:][shared].min())
        other = int(np.argmax(slot == slot[segment]))
        raise NetworkError(f"segments {other} and {segment} share exit {exit_of[segment]} of node {tail[segment]}")
    exit_node.flat[slot], exit_segment.flat[slot] = head, np.arange(len(head))
    return RoadNetwork(*map(jax.device_put, (position, exit_node, exit_segment, tail, head, length, width)))


def disjoint_union(networks: Sequence[RoadNetwork]) -> RoadNetwork:
    """Several networks as one, with no street between them: their nodes and segments one after the other."""
    if len(networks) == 1:
        return networks[0]
    exits = max(network.exits for network in networks)
    nodes = np.cumsum([0, *(network.nodes for network in networks)])
    segments = np.cumsum([0, *(network.segments for network in networks)])

    def shifted(table: Array, by: int) -> np.ndarray:
        padded = np.full((table.shape[0], exits), ABSENT, np.int32)
        padded[:, : table.shape[1]] = table
        return np.where(padded == ABSENT, ABSENT, padded + by)

    def joined(parts: Iterable[np.ndarray]) -> Array:
        return jnp.asarray(np.concatenate(list(parts)))

    counted = list(zip(networks, nodes.tolist(), segments.tolist(), strict=False))
    return RoadNetwork(
        position=joined(np.asarray(network.position) for network in networks),
        exit_node=joined(shifted(network.exit_node, node) for network, node, _ in counted),
        exit_segment=joined(shifted(network.exit_segment, segment) for network, _, segment in counted),
        tail=joined(np.asarray(network.tail) + np.int32(node) for network, node, _ in counted),
        head=joined(np.asarray(network.head) + np.int32(node) for network, node, _ in counted),
        length=joined(np.asarray(network.length) for network in networks),
        width=joined(np.asarray(network.width) for network in networks),
    )


def _check_segments(tail: np.ndarray, head: np.ndarray, length: np.ndarray, width: np.ndarray, nodes: int) -> None:
    for name, ends in (("tail", tail), ("head", head)):
        if ends.min() < 0 or ends.max() >= nodes:
            worst = int(np.argmax((ends < 0) | (ends >= nodes)))
            raise NetworkError(f"segment {worst} has {name} {ends[worst]}, but there are {nodes} nodes")
    for name, metres in (("length", length), ("width", width)):
        if not (np.isfinite(metres) & (metres > 0)).all():
            worst = int(np.argmin(np.isfinite(metres) & (metres > 0)))
            raise NetworkError(f"segment {worst} has {name} {metres[worst]} m; it must be positive")
    if (tail == head).any():
        loop = int(np.argmax(tail == head))
        raise NetworkError(f"segment {loop} begins and ends at node {tail[loop]}")


def _rank_within(group: np.ndarray) -> np.ndarray:
    """0, 1, 2, … within each group, in order of appearance."""
    order = np.argsort(group, kind="stable")
    ordered = group[order]
    first = np.searchsorted(ordered, ordered, side="left")
    rank = np.empty(len(group), np.int32)
    rank[order] = np.arange(len(group)) - first
    return rank
