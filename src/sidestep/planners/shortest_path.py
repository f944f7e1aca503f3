"""The shortest path by distance, which knows the map and no crowds (the paper's baseline)."""

from collections.abc import Callable
from typing import ClassVar

import numpy as np
import rustworkx

from sidestep.environment.types import EnvParams, Instance, Level, Seen
from sidestep.network.graph import RoadNetwork
from sidestep.planners.base import DecideByPlan, Plan, choose_allowed


class ShortestPath:
    """Walk the shortest way, however crowded; Dijkstra's algorithm, by rustworkx.

    The paper uses A*. Its result is the same, but on the paper's random lengths straight lines are no lower bound.
    """

    name: ClassVar[str] = "shortest-path"
    level: ClassVar[Level] = "map"
    sees: ClassVar[Seen] = "position"
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
    graph = rustworkx.PyDiGraph()
    graph.add_nodes_from(range(network.nodes))
    backwards = zip(np.asarray(network.head).tolist(), np.asarray(network.tail).tolist(), weight.tolist(), strict=True)
    graph.add_edges_from(list(backwards))
    found = rustworkx.dijkstra_shortest_path_lengths(graph, destination, float)
    distance = np.full(network.nodes, np.inf)
    distance[list(found.keys())] = list(found.values())
    distance[destination] = 0.0
    return distance


def per_walk(instances: Instance, table_for: Callable[[int], np.ndarray]) -> np.ndarray:
    """A table per walk from one per destination, each worked out once."""
    destinations, which = np.unique(np.asarray(instances.destination), return_inverse=True)
    return np.stack([table_for(int(destination)) for destination in destinations])[which]
