"""The shortest path by distance, for walkers that know the map but no crowds (the paper's baseline)."""

from collections.abc import Callable
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sidestep.environment.types import EnvParams, Instance, Level
from sidestep.network.graph import RoadNetwork
from sidestep.planners.base import Plan, Planned
from sidestep.programs import on_device, program


class ShortestPath(Planned):
    """Walk the shortest path, however crowded it is.

    By SciPy's Dijkstra. The paper uses A*, which finds the same path; but on the paper's random lengths straight lines
    are no lower bound, as its heuristic would have to be.

    A street that is shut at the departure counts as longer, by the metres that one walks until it opens.
    """

    name: ClassVar[str] = "shortest-path"
    level: ClassVar[Level] = "map"

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        network = params.network
        exit_node, exit_segment = np.asarray(network.exit_node), np.asarray(network.exit_segment)
        hour = np.asarray(params.futures.hour)[np.asarray(instances.future)]
        departures = np.stack([hour, np.asarray(instances.departure)], axis=1) * params.waits.gates

        def best_exits(destination: int, departure: Float[np.ndarray, "2"]) -> np.ndarray:
            shut = params.waits.gates
            length = np.asarray(_metres_at(params, *map(on_device, departure)) if shut else network.length)
            ahead = length[exit_segment] + distances_to(network, length, destination)[exit_node]
            valid = np.asarray(_exits_to(network, on_device(destination, np.int32)))
            return np.eye(network.exits, dtype=bool)[np.where(valid, ahead, np.inf).argmin(axis=1)]

        return Plan(None, table_per_walk(best_exits, np.asarray(instances.destination), departures))

    def plan_within(self, params: EnvParams, instances: Instance) -> Plan:
        """Expect nothing."""
        return self.plan(params, instances)


def metres_at(params: EnvParams, hour: Float[Array, ""], clock: Float[Array, ""]) -> Float[Array, " segment"]:
    """Give the lengths by which paths are chosen at a departure: streets that are shut then count as longer.

    Parameters
    ----------
    params
        The environment.
    hour, clock
        Hour of the week at clock 0, and clock of the departure.

    Returns
    -------
    Float[Array, " segment"]
        Metres, and for each second until a street opens those that one walks meanwhile.
    """
    every = jnp.arange(params.network.segments)
    shut = params.waits.until_open(hour, every, jnp.full(every.shape, clock))
    return params.network.length + params.free_speed * shut


_metres_at = program()(metres_at)


@program()
def _exits_to(network: RoadNetwork, destination: Int[Array, ""]) -> Bool[Array, "node exit"]:
    """The rule of :meth:`RoadNetwork.exits_to`, in one program."""
    return network.exits_to(destination)


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
        Infinite where no path leads to the destination that a walk may take.
    """
    # Row by row, and then backwards: as a list of (head, tail, weight) SciPy would add up parallel segments.
    taken = np.asarray(_exits_to(network, on_device(destination, np.int32)))
    walked, first = np.asarray(network.exit_segment)[taken], np.append(0, taken.sum(axis=1).cumsum())
    weights, heads = weight[walked].astype(np.float64), np.asarray(network.head)[walked]
    graph = csr_array((weights, heads, first), shape=(network.nodes, network.nodes))
    return dijkstra(graph.T, indices=destination)


def table_per_walk(
    table_for: Callable[..., Bool[np.ndarray, "node exit"]], destination: Int[np.ndarray, " walk"], *more: np.ndarray
) -> Bool[np.ndarray, "walk node exit"]:
    """Give each walk the table of its destination; walks that are alike share the work, not the memory.

    Parameters
    ----------
    table_for
        Makes a table for a destination, and for what else tells walks apart.
    destination, more
        Of each walk.

    Returns
    -------
    Bool[np.ndarray, "walk node exit"]
        The table of each.
    """
    alike = np.column_stack([destination, *more])
    _, first, which = np.unique(alike, axis=0, return_index=True, return_inverse=True)
    tables = [table_for(int(destination[walk]), *(each[walk] for each in more)) for walk in first.tolist()]
    return np.stack(tables)[which.reshape(-1)]
