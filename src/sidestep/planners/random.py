"""The two readings of the paper's "random selection"."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from sidestep.environment.types import EnvParams, Instance, Level
from sidestep.planners.base import Plan, Planned
from sidestep.planners.shortest_path import distances_to, table_per_walk


class RandomWalk(Planned):
    """Take any exit with the same probability."""

    name: ClassVar[str] = "random-walk"
    level: ClassVar[Level] = "position"

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        valid = params.network.valid
        return Plan(None, jnp.broadcast_to(valid, (instances.origin.shape[0], *valid.shape)))


class RandomProgress(Planned):
    """Take any exit that leaves fewer crossings to go: a random path of fewest segments."""

    name: ClassVar[str] = "random-progress"
    level: ClassVar[Level] = "position"

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        network = params.network
        valid, exit_node = np.asarray(network.valid), np.asarray(network.exit_node)

        def exits_ahead(destination: int) -> np.ndarray:
            hops = distances_to(network, np.ones(network.segments), destination)
            return valid & (hops[exit_node] < hops[:, None])

        return Plan(None, table_per_walk(instances, exits_ahead))
