"""The trained agent as a planner. No other planner may import the agent."""

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Int, Key

from sidestep.agent.qnetwork import DuelingQNetwork
from sidestep.agent.train import greedy
from sidestep.environment.types import EnvParams, Instance, Level, Observation
from sidestep.planners.base import DecideByPlan, Plan


def _decide(network: DuelingQNetwork, _own: Array, observation: Observation, key: Key[Array, ""]) -> Int[Array, ""]:
    return greedy(network)(observation, key)


@dataclass(frozen=True)
class Darp:
    """Greedy on the Q-values that it learned."""

    network: DuelingQNetwork
    name: ClassVar[str] = "darp"
    level: ClassVar[Level] = "position"
    decide: ClassVar[DecideByPlan] = staticmethod(_decide)

    def plan(self, _params: EnvParams, instances: Instance) -> Plan:
        return Plan(self.network, jnp.zeros(instances.origin.shape[0]))
