"""The two readings of the paper's "random selection"."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from sidestep.environment.types import EnvParams, Instance, Level
from sidestep.planners.base import Plan, Planned
from sidestep.planners.shortest_path import distances_to, table_per_walk


class RandomWalk(Planned):
    """Take any exit that may be taken with the same probability."""

    name: ClassVar[str] = "random-walk"
    level: ClassVar[Level] = "position"

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, jax.vmap(params.network.exits_to)(instances.destination))


class RandomProgress(Planned):
    """Take any exit that leaves fewer crossings to go: a random path of fewest segments."""

    name: ClassVar[str] = "random-progress"
    level: ClassVar[Level] = "position"

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        network = params.network
        exit_node = np.asarray(network.exit_node)

        def exits_ahead(destination: int) -> np.ndarray:
            hops = distances_to(network, np.ones(network.segments), destination)
            return np.asarray(network.exits_to(jnp.int32(destination))) & (hops[exit_node] < hops[:, None])

        return Plan(None, table_per_walk(exits_ahead, np.asarray(instances.destination)))
