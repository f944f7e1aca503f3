"""One walker as a Gymnasium environment."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from jaxtyping import Bool

from sidestep.gym.choices import CHOICES, check_names
from sidestep.gym.options import EnvOptions, read_options
from sidestep.gym.runner import Report, Runner, checked_actions
from sidestep.gym.scene import scene_of
from sidestep.gym.spaces import observation_space, with_mask
from sidestep.gym.task import Task


class WalkEnv(gymnasium.Env[Any, np.int64], EzPickle):
    """A walker who decides at every crossing which street to take, through crowds that change.

    An action is the number of an exit; the mask says which may be taken. One that may not is replaced by the next that
    may, counting upwards and round. Rewards are those of the scenario. An episode terminates on arrival, and is
    truncated at the scenario's horizon. Copies and pickles are environments of the same options, not yet reset.

    Parameters
    ----------
    scenario
        A scenario, its name or its file.
    **options
        Fields of :class:`sidestep.gym.EnvOptions`.

    Raises
    ------
    SidestepError
        Unknown and wrong options, with their field, and files that cannot be read or do not fit.

    Examples
    --------
    >>> import gymnasium
    >>> import sidestep.gym
    >>> env = gymnasium.make("sidestep/PaperGrid-v0", futures=2)
    >>> observation, info = env.reset(seed=0)
    >>> info["action_mask"].tolist(), info["node"], info["destination"]
    ([1, 0, 1, 0], 0, 35)
    >>> observation, reward, terminated, truncated, info = env.step(2)
    >>> info["node"], terminated, reward < 0
    (1, False, True)
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 4}  # noqa: RUF012 # gymnasium looks for it here

    def __init__(self, scenario: object, **options: Any) -> None:
        EzPickle.__init__(self, scenario, **options)
        self.options = read_options(EnvOptions, scenario, options)
        self._runner = Runner(self.options, 1, "Disabled")
        self._scene = scene_of(self._runner.task, self.options, 1)
        self._over = True
        self.observation_space = observation_space(self._runner.task, self.options)
        self.action_space = spaces.Discrete(self._runner.exits)
        self.render_mode = self.options.render_mode
        self.metadata = {**self.metadata, "render_fps": self.options.render_fps}

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin the next walk, or the first one of a seed.

        Parameters
        ----------
        seed
            Walks are the same for the same seed. Without one, the walks of the last seed go on.
        options
            What to choose instead of drawing it: ``future``, ``origin``, ``destination``, ``departure`` in seconds; or
            ``walk``, the number of a walk of comparisons, where the purpose is ``test``.

        Returns
        -------
        observation, info
            Of the walker at its origin.

        Raises
        ------
        EnvError
            Unknown options, and values that do not fit, with the option as their field.
        """
        wishes = check_names(options, CHOICES)
        super().reset(seed=seed)
        if seed is not None or not self._runner.seeded:
            known = self.np_random_seed
            self._runner.seed([known if known is not None and known >= 0 else int(self.np_random.integers(2**63))])
        report = self._runner.reset([wishes])
        self._over = False
        return self._told(report)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Walk to the next crossing.

        Parameters
        ----------
        action
            Number of the exit.

        Returns
        -------
        observation, reward, terminated, truncated, info
            As Gymnasium has them.

        Raises
        ------
        gymnasium.error.InvalidAction
            Anything but the number of an exit.
        gymnasium.error.ResetNeeded
            The walk is over, or none has begun.
        """
        taken = checked_actions(action, (), self._runner.exits)
        if self._over:
            raise gymnasium.error.ResetNeeded("the walk is over: call reset() before the next step()")
        report, _ = self._runner.step(taken[None])
        self._over = bool(report.over[0])
        observation, info = self._told(report)
        return observation, float(report.reward[0]), bool(report.terminated[0]), bool(report.truncated[0]), info

    @property
    def task(self) -> Task:
        """The walks as the functional core has them."""
        return self._runner.task

    def action_masks(self) -> Bool[np.ndarray, " exit"]:
        """Which exits may be taken now, as ``sb3_contrib.MaskablePPO`` asks for them."""
        return self._runner.mask[0].astype(bool)

    def render(self) -> Any:
        """Draw the walk so far, and how fast people walk now; see ``render_mode``.

        Returns
        -------
        numpy.ndarray | None
            An image; None where there is a window, which is drawn after every step by itself.
        """
        if self._scene is None:
            gymnasium.logger.warn("render() draws nothing without a render_mode: make the environment with rgb_array")
            return None
        return self._scene.pixels(0)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._scene is not None:
            self._scene.close()

    def _told(self, report: Report) -> tuple[Any, dict[str, Any]]:
        if self._scene is not None:
            self._scene.follow(report)
        info = {name: row[0] if row.ndim > 1 else row[0].item() for name, row in report.info().items()}
        return with_mask(report.shown[0], info["action_mask"], self.options), info
