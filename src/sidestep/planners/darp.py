"""The trained agent as a planner. No other planner may import the agent."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.agent.checkpoint import TrainingRun
from sidestep.agent.config import TrainConfig
from sidestep.agent.qnetwork import DuelingQNetwork
from sidestep.agent.train import greedy, shown, train
from sidestep.environment.types import EnvParams, Instance, Level, Observation
from sidestep.planners.base import DecideByPlan, Plan
from sidestep.scenarios import CrowdedMap, Scenario

OnRound = Callable[[int, Float[np.ndarray, " test"]], None]  # round number from 1, minutes of its greedy test walks


def _decide(network: DuelingQNetwork, _own: Array, observation: Observation, key: Key[Array, ""]) -> Int[Array, ""]:
    return greedy(network)(observation, key)


@dataclass(frozen=True, eq=False)
class Darp:
    """Greedy on the Q-values that it learned on this map."""

    network: DuelingQNetwork
    curve: Float[np.ndarray, "round test"]  # minutes of the greedy test walks after every round of training
    name: ClassVar[str] = "darp"
    level: ClassVar[Level] = "position"
    decide: ClassVar[DecideByPlan] = staticmethod(_decide)

    def plan(self, _params: EnvParams, instances: Instance) -> Plan:
        return Plan(self.network, jnp.asarray(np.zeros(instances.origin.shape[0])))


def train_darp(
    config: TrainConfig,
    scenario: Scenario,
    place: CrowdedMap,
    on_round: OnRound = lambda _number, _minutes: None,
) -> Darp:
    """Let an agent learn one map."""
    curve = []
    for state, report in train(config, scenario, place):
        network = shown(config, state)
        curve.append(np.asarray(report.test_minutes))
        on_round(len(curve), curve[-1])
    return Darp(network, np.stack(curve))


def trained_darp(run: TrainingRun) -> Darp:
    """The planner that a saved training run has to show."""
    return Darp(run.network, np.asarray(run.curve))
