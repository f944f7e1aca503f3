"""Many walkers as one vector environment of Gymnasium's."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from jaxtyping import Bool

from sidestep.arguments import brief
from sidestep.gym.choices import CHOICES, check_names, each_walker
from sidestep.gym.options import EnvError, VectorOptions, read_options
from sidestep.gym.runner import Report, Runner, checked_actions
from sidestep.gym.scene import scene_of
from sidestep.gym.spaces import observation_space, with_mask
from sidestep.gym.task import Task


class WalkVectorEnv(VectorEnv[Any, Any, np.ndarray], EzPickle):
    """Walkers like those of :class:`~sidestep.gym.WalkEnv`, who all take their steps in one compiled call.

    Walker i of seed s walks as the single environment of seed s + i. Copies and pickles are environments of the same
    options, not yet reset.

    Parameters
    ----------
    scenario
        A scenario, its name or its file.
    num_envs
        Walkers.
    **options
        Fields of :class:`sidestep.gym.VectorOptions`.

    Raises
    ------
    SidestepError
        Unknown and wrong options, with their field, and files that cannot be read or do not fit.

    Examples
    --------
    >>> import gymnasium
    >>> import sidestep.gym
    >>> envs = gymnasium.make_vec("sidestep/PaperGrid-v0", num_envs=1000, futures=2)
    >>> observations, infos = envs.reset(seed=0)
    >>> observations.shape, infos["action_mask"].shape
    ((1000, 2), (1000, 4))
    >>> observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
    >>> rewards.shape
    (1000,)
    """

    def __init__(self, scenario: object, num_envs: int = 1, **options: Any) -> None:
        EzPickle.__init__(self, scenario, num_envs, **options)
        self.options = read_options(VectorOptions, scenario, {"num_envs": num_envs, **options})
        self.num_envs, mode = self.options.num_envs, self.options.autoreset_mode
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": self.options.render_fps,
            "autoreset_mode": AutoresetMode(mode),
        }
        self.render_mode = self.options.render_mode
        self._runner = Runner(self.options, self.num_envs, mode, self.options.max_episode_steps)
        self._scene = scene_of(self._runner.task, self.options, self.num_envs)
        self._over = np.ones(self.num_envs, bool)
        self.single_observation_space = observation_space(self._runner.task, self.options)
        self.single_action_space = spaces.Discrete(self._runner.exits)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin the next walks, or the first ones of a seed.

        Parameters
        ----------
        seed
            Of the first walker; the others have the numbers after it. Or a list with one for each.
        options
            As for the single environment, values being for all walkers or arrays with one for each; and
            ``reset_mask``, an array that is True for walkers who begin anew while the others go on.

        Returns
        -------
        observations, infos
            Of all walkers.

        Raises
        ------
        EnvError
            Unknown options, and values that do not fit, with the option as their field; and lists of other seeds.
        gymnasium.error.Error
            Another seed.
        """
        wishes = dict(check_names(options, (*CHOICES, "reset_mask")))
        now = self._reset_mask(wishes.pop("reset_mask", None))
        several = seed is not None and not isinstance(seed, int)
        seeds = self._seeds(seed) if several else range(0)
        super().reset(seed=seeds[0] if several else seed)
        if seed is not None or not self._runner.seeded:
            known = self.np_random_seed
            first = known if known is not None and known >= 0 else int(self.np_random.integers(2**63))
            partly = None if now.all() else now
            self._runner.seed(seeds if several else range(first, first + self.num_envs), partly)
        if not self._runner.begun:
            now[:] = True
        report = self._runner.reset(each_walker(wishes, self.num_envs), now)
        self._over &= ~now
        return self._told(report), _each(report.info(), now)

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Walk to the next crossings.

        Parameters
        ----------
        actions
            Number of the exit of each walker; that of one who begins anew in this step does not matter.

        Returns
        -------
        observations, rewards, terminated, truncated, infos
            As :class:`gymnasium.vector.SyncVectorEnv` has them. Where walks begin in the same step,
            ``infos["final_obs"]`` and ``infos["final_info"]`` tell of those that ended.

        Raises
        ------
        gymnasium.error.InvalidAction
            Anything but the number of an exit for each walker.
        gymnasium.error.ResetNeeded
            No walks have begun, or some are over and do not begin anew by themselves.
        """
        taken = checked_actions(actions, (self.num_envs,), self._runner.exits)
        mode = self.metadata["autoreset_mode"]
        if not self._runner.seeded or (mode is AutoresetMode.DISABLED and self._over.any()):
            raise gymnasium.error.ResetNeeded("some walks are over or not begun: call reset() before the next step()")
        report, final = self._runner.step(taken)
        infos = _each(report.info(), np.ones(self.num_envs, bool))
        self._over = report.over
        if final is not None and self._over.any():
            infos |= self._finals(final, self._over)
        return self._told(report), report.reward, report.terminated, report.truncated, infos

    @property
    def task(self) -> Task:
        """The walks as the functional core has them."""
        return self._runner.task

    def action_masks(self) -> Bool[np.ndarray, "walker exit"]:
        """Which exits may be taken now."""
        return self._runner.mask.astype(bool)

    def render(self) -> tuple[Any, ...] | None:
        """Draw all walks so far, one image for each walker.

        Returns
        -------
        tuple[numpy.ndarray, ...] | None
            Nothing without a ``render_mode``.
        """
        if self._scene is None:
            gymnasium.logger.warn("render() draws nothing without a render_mode: make the environment with rgb_array")
            return None
        return tuple(map(self._scene.pixels, range(self.num_envs)))

    def _told(self, report: Report) -> Any:
        if self._scene is not None:
            self._scene.follow(report)
        return with_mask(report.shown, report.mask, self.options)

    def _finals(self, final: Report, over: Bool[np.ndarray, " walker"]) -> dict[str, Any]:
        """What :class:`gymnasium.vector.SyncVectorEnv` tells of walks that ended in this step."""
        observations = np.full(self.num_envs, None, object)
        for number in np.flatnonzero(over).tolist():
            observations[number] = with_mask(final.shown[number], final.mask[number], self.options)
        told = {name: np.where(over.reshape(-1, *[1] * (row.ndim - 1)), row, 0) for name, row in final.info().items()}
        return {
            "final_obs": observations,
            "_final_obs": over.copy(),
            "final_info": _each(told, over),
            "_final_info": over.copy(),
        }

    def _seeds(self, given: Any) -> list[int]:
        seeds = list(given) if isinstance(given, Sequence | np.ndarray) else []
        if len(seeds) != self.num_envs or not all(isinstance(one, int | np.integer) and one >= 0 for one in seeds):
            many = f"or {self.num_envs} of them, one for each walker"
            raise EnvError(f"seed must be a whole number of 0 or more, {many}, not {brief(given)}", field="seed")
        return [int(one) for one in seeds]

    def _reset_mask(self, given: Any) -> Bool[np.ndarray, " walker"]:
        if given is None:
            return np.ones(self.num_envs, bool)
        if (
            not isinstance(given, np.ndarray)
            or given.shape != (self.num_envs,)
            or given.dtype != bool
            or not given.any()
        ):
            raise EnvError(
                f"reset_mask must be an array of {self.num_envs} truth values, some of them True, not {brief(given)}",
                field="reset_mask",
            )
        return given.copy()


def _each(told: dict[str, np.ndarray], of: Bool[np.ndarray, " walker"]) -> dict[str, Any]:
    """Infos as vector environments have them: each name with the walkers that it is told of."""
    return told | {f"_{name}": of.copy() for name in told}
