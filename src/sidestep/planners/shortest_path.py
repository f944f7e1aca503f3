"""The shortest path by distance, which knows the map and no crowds (the paper's baseline)."""

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sidestep.environment.types import EnvParams, Information, Instance, Level
from sidestep.network.graph import RoadNetwork
from sidestep.planners.base import DecideByPlan, Plan, choose_allowed


class ShortestPath:
    """Walk the shortest way, however crowded; Dijkstra's algorithm, by SciPy.

    The paper uses A*. Its result is the same, but on the paper's random lengths straight lines are no lower bound.
    """

    name: ClassVar[str] = "shortest-path"
    level: ClassVar[Level] = "map"
    observes: ClassVar[Information] = "position"
    decide: ClassVar[DecideByPlan] = staticmethod(choose_allowed)

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        network = params.network
        valid, exit_node = np.asarray(network.valid), np.asarray(network.exit_node)
        length = np.asarray(network.length)[np.asarray(network.exit_segment)]

        def best_exits(destination: int) -> np.ndarray:
            ahead = np.where(
                valid, length + distances_to(network, np.asarray(network.length), destination)[exit_node], np.inf
            )
            return np.eye(network.exits, dtype=bool)[ahead.argmin(axis=1)]

        return Plan(None, per_walk(instances, best_exits))


def distances_to(network: RoadNetwork, weight: np.ndarray, destination: int) -> np.ndarray:
    """Least total weight from every node to one; weight is per segment, infinity where there is no way."""
    # Backwards, row by row: as a list of (head, tail, weight) SciPy would add up parallel segments.
    tail, head = np.asarray(network.tail), np.asarray(network.head)
    order = np.argsort(head, kind="stable")
    first = np.searchsorted(head[order], np.arange(network.nodes + 1))
    graph = csr_array((weight[order].astype(np.float64), tail[order], first), shape=(network.nodes, network.nodes))
    distance: np.ndarray = dijkstra(graph, indices=destination)
    return distance


def per_walk(instances: Instance, table_for: Callable[[int], np.ndarray]) -> np.ndarray:
    """A table per walk from one per destination, each worked out once."""
    destinations, which = np.unique(np.asarray(instances.destination), return_inverse=True)
    return np.stack([table_for(int(destination)) for destination in destinations])[which]
