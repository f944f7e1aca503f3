"""The shortest path by distance, for walkers that know the map but no crowds (the paper's baseline)."""

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sidestep.environment.types import EnvParams, Instance, Level
from sidestep.network.graph import RoadNetwork
from sidestep.planners.base import Plan, Planned


class ShortestPath(Planned):
    """Walk the shortest path, however crowded it is.

    By SciPy's Dijkstra. The paper uses A*, which finds the same path; but on the paper's random lengths straight lines
    are no lower bound, as its heuristic would have to be.
    """

    name: ClassVar[str] = "shortest-path"
    level: ClassVar[Level] = "map"

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        network = params.network
        valid, exit_node = np.asarray(network.valid), np.asarray(network.exit_node)
        length, exit_segment = np.asarray(network.length), np.asarray(network.exit_segment)

        def best_exits(destination: int) -> np.ndarray:
            ahead = length[exit_segment] + distances_to(network, length, destination)[exit_node]
            return np.eye(network.exits, dtype=bool)[np.where(valid, ahead, np.inf).argmin(axis=1)]

        return Plan(None, table_per_walk(instances, best_exits))


def distances_to(network: RoadNetwork, weight: np.ndarray, destination: int) -> Float[np.ndarray, " node"]:
    """Find the least total weight from every node to one.

    Parameters
    ----------
    network
        The streets.
    weight
        Weight of each segment.
    destination
        The node to go to.

    Returns
    -------
    Float[np.ndarray, " node"]
        Infinite where no path leads to the destination.
    """
    # Backwards, row by row: as a list of (head, tail, weight) SciPy would add up parallel segments.
    tail, head = np.asarray(network.tail), np.asarray(network.head)
    order = np.argsort(head, kind="stable")
    first = np.searchsorted(head[order], np.arange(network.nodes + 1))
    graph = csr_array((weight[order].astype(np.float64), tail[order], first), shape=(network.nodes, network.nodes))
    return dijkstra(graph, indices=destination)


def table_per_walk(instances: Instance, table_for: Callable[[int], np.ndarray]) -> Bool[np.ndarray, "walk node exit"]:
    """Give each walk the table of its destination; walks to the same destination share the work, not the memory."""
    destinations, which = np.unique(np.asarray(instances.destination), return_inverse=True)
    return np.stack([table_for(int(destination)) for destination in destinations])[which]
