"""DQN of tianshou, with masks, in PyTorch."""

from typing import Any

import gymnasium
import numpy as np
import torch
from problem import Problem, Walkers
from protocol import OnCheck
from tianshou.algorithm import DQN
from tianshou.algorithm.algorithm_base import policy_within_training_step
from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory, LRSchedulerFactoryLinear, RMSpropOptimizerFactory
from tianshou.data import Batch, Collector, VectorReplayBuffer
from tianshou.env import BaseVectorEnv
from tianshou.utils.net.common import Net

PACKAGES = ("tianshou", "torch", "gymnasium", "numpy")


class VecWalkers(BaseVectorEnv):
    """All walkers step in one call of NumPy."""

    def __init__(self, problem: Problem, seed: int) -> None:  # not the parent's, which makes an object for each walker
        self.walkers, self.env_num = Walkers(problem, seed), problem.task.walkers
        self.is_async, self.is_closed = False, False
        self.spaces = {
            "action_space": gymnasium.spaces.Discrete(problem.exits),
            "observation_space": gymnasium.spaces.Box(-np.inf, np.inf, problem.features.shape[1:]),
        }
        self.nothing = np.array([{} for _ in range(self.env_num)], dtype=object)

    def get_env_attr(self, key: str, id: Any = None) -> list[Any]:  # noqa: A002 - the parent's word
        """An attribute of every walker."""
        return [self.spaces[key]] * (self.env_num if id is None else len(id))

    def reset(self, env_id: Any = None, **_: Any) -> tuple[Batch, np.ndarray]:
        """Say where walkers begin; those whose episode is over have begun another in :meth:`step`."""
        if env_id is None:
            return self.seen(self.walkers.reset()), self.nothing
        return self.seen(self.walkers.node[env_id]), self.nothing[env_id]

    def step(self, action: np.ndarray, id: Any = None) -> Any:  # noqa: A002, ARG002
        """Take an exit each; all are always ready."""
        there, reward, terminated, truncated, _ = self.walkers.step(action)
        return self.seen(there), reward, terminated, truncated, self.nothing

    def seen(self, node: np.ndarray) -> Batch:
        """What walkers see at crossings."""
        return Batch(obs=self.walkers.problem.features[node], mask=self.walkers.problem.valid[node])

    def close(self) -> None:
        """Nothing is held."""


def learn(_algorithm: str, problem: Problem, seed: int, on_check: OnCheck) -> None:
    """Learn with double DQN."""
    torch.set_num_threads(1)  # serves networks this small best
    torch.manual_seed(seed)
    np.random.seed(seed)  # noqa: NPY002 - it draws from there
    task, walkers = problem.task, VecWalkers(problem, seed)
    one = task.walkers == 1
    features = torch.as_tensor(problem.features)
    network = Net(state_shape=features.shape[1:], action_shape=problem.exits, hidden_sizes=task.hidden)
    policy = DiscreteQLearningPolicy(model=network, action_space=gymnasium.spaces.Discrete(problem.exits))
    adam, falling = AdamOptimizerFactory(lr=3e-3), LRSchedulerFactoryLinear(1, task.transitions, task.walkers)
    rmsprop = RMSpropOptimizerFactory(lr=1e-4, alpha=0.9, eps=1e-10)
    learner = DQN(
        policy=policy,
        optim=rmsprop if one else adam.with_lr_scheduler_factory(falling),
        gamma=task.gamma,
        target_update_freq=200 if one else 10,
        is_double=not one,
    )
    replay = VectorReplayBuffer(task.replay, task.walkers)
    collector = Collector(learner, walkers, replay, exploration_noise=True, raise_on_nan_in_buffer=False)
    collector.reset()
    done = updates = 0
    for iteration in range(task.iterations):
        policy.set_eps_training(0.1 if one else max(1 - iteration / task.iterations / 0.375, 0.2))
        with policy_within_training_step(policy):
            collector.collect(n_step=task.walkers)
            done += task.walkers
            if done >= task.batch:
                learner.update(replay, task.batch)
                updates += 1
        if done % task.check_every == 0:
            with torch.no_grad():
                values, _ = network(features)
            on_check(done, updates, problem.greedy(values.numpy()))
