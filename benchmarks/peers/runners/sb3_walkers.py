"""The problem's walkers as a vector environment of Stable-Baselines3, which sbx and sb3-contrib take as well."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from problem import Problem, Walkers
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv


class VecWalkers(VecEnv):
    """All walkers step in one call of NumPy."""

    def __init__(self, problem: Problem, seed: int) -> None:
        low, high = problem.features.min(axis=0), problem.features.max(axis=0)
        seen = gymnasium.spaces.Box(low, high, dtype=np.float32)
        self.walkers = Walkers(problem, seed)
        super().__init__(problem.task.walkers, seen, gymnasium.spaces.Discrete(problem.exits))

    def reset(self) -> np.ndarray:
        """Put all walkers at their origins."""
        return self.walkers.problem.features[self.walkers.reset()]

    def step_async(self, actions: np.ndarray) -> None:
        """Remember the exits that are to be taken."""
        self.actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take them."""
        features = self.walkers.problem.features
        there, reward, terminated, truncated, node = self.walkers.step(self.actions)
        infos: list[dict[str, Any]] = [{} for _ in there]
        for over in np.flatnonzero(terminated | truncated):
            infos[over] = {"terminal_observation": features[there[over]], "TimeLimit.truncated": bool(truncated[over])}
        return features[node], reward, terminated | truncated, infos

    def action_masks(self) -> np.ndarray:
        """Which exits there are, for each walker."""
        return self.walkers.problem.valid[self.walkers.node]

    def close(self) -> None:
        """Nothing is held."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of every walker."""
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Walkers have none of their own."""
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Sequence[Any]:  # noqa: ARG002
        """What a method says of each walker."""
        return list(getattr(self, method_name)(*args, **kwargs))

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:  # noqa: ARG002
        """No walker is wrapped."""
        return [False] * self.num_envs


class Checks(BaseCallback):
    """Calls a function after every so many transitions."""

    def __init__(self, every: int, check: Any) -> None:
        super().__init__()
        self.every, self.check = every, check

    def _on_step(self) -> bool:
        if self.num_timesteps % self.every == 0:
            self.check(self.model)
        return True
