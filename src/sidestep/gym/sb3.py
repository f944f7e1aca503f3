"""Walkers as a ``VecEnv`` of Stable-Baselines3, which takes no vector environments of Gymnasium's.

The only module that imports Stable-Baselines3; Sidestep does not require it.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from sidestep.gym.options import EnvError
from sidestep.gym.vector import WalkVectorEnv


class SB3VecEnv(VecEnv):  # type: ignore[misc] # without types where it is not installed
    """A thousand walkers for Stable-Baselines3: all take their steps in one compiled call.

    An info has ``TimeLimit.truncated``; where a walk has ended it has ``terminal_observation`` as well, and what the
    info of the single environment has. Masks are what ``env_method("action_masks")`` gives, as
    ``sb3_contrib.MaskablePPO`` asks for them. Wrap it in ``VecMonitor`` to log returns.

    Parameters
    ----------
    scenario
        A scenario, its name or its file.
    num_envs
        Walkers.
    **options
        Fields of :class:`sidestep.gym.VectorOptions` but ``autoreset_mode``: here walks begin in the same step.

    Raises
    ------
    SidestepError
        Unknown and wrong options, with their field, and files that cannot be read or do not fit.
    """

    def __init__(self, scenario: object, num_envs: int = 1, **options: Any) -> None:
        if "autoreset_mode" in options:
            raise EnvError("autoreset_mode cannot be chosen: Stable-Baselines3 wants SameStep", field="autoreset_mode")
        self.envs = WalkVectorEnv(scenario, num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **options)
        self._actions: Any = None
        super().__init__(self.envs.num_envs, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> Any:
        names = {name for options in self._options for name in options}
        wishes = {name: [options.get(name) for options in self._options] for name in names}
        seed = None if self._seeds[0] is None else self._seeds
        observations, infos = self.envs.reset(seed=seed, options=wishes or None)
        self.reset_infos = _split(infos, range(self.num_envs))
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        observations, rewards, terminated, truncated, told = self.envs.step(self._actions)
        over = terminated | truncated
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": cut} for cut in truncated.tolist()]
        if over.any():
            ended = np.flatnonzero(over).tolist()
            finals, begun = _split(told["final_info"], ended), _split(told, ended)
            for number, final, fresh in zip(ended, finals, begun, strict=True):
                infos[number] |= final | {"terminal_observation": told["final_obs"][number]}
                self.reset_infos[number] = fresh
        return observations, rewards.astype(np.float32), over, infos

    def close(self) -> None:
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        single = {"observation_space": self.observation_space, "action_space": self.action_space}
        value = single[attr_name] if attr_name in single else getattr(self.envs, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(f"{attr_name} cannot be set: all walkers are one environment")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        if method_name != "action_masks":
            raise AttributeError(f"walkers have no method {method_name} of their own, only action_masks")
        masks = self.envs.action_masks(*method_args, **method_kwargs)
        return [masks[number] for number in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> list[np.ndarray | None]:
        return list(self.envs.render() or [None] * self.num_envs)


def _split(infos: dict[str, Any], walkers: Iterable[int]) -> list[dict[str, Any]]:
    """Infos of some walkers, one by one."""
    names = [name for name in infos if name[0] != "_" and not name.startswith("final_")]
    return [{name: infos[name][number] for name in names} for number in walkers]
