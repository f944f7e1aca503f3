"""Gymnasium's spaces of an environment, and observations in the form that they have there."""

from typing import Any

import numpy as np
from gymnasium import spaces
from jaxtyping import Int8

from sidestep.gym.options import EnvOptions
from sidestep.gym.task import Task

KEYS = {"dict": ("observation", "action_mask"), "tianshou": ("obs", "mask")}
"""Names of the observation and of the mask where both are in one dictionary."""


def observation_space(task: Task, options: EnvOptions) -> spaces.Space[Any]:
    """The space of one walker's observations.

    Parameters
    ----------
    task, options
        The walks, and what is shown of them.

    Returns
    -------
    spaces.Space
        A Box or a Discrete space, in a dictionary with the mask if it stands there.
    """
    match options.observation:
        case "features":
            low, high = (np.asarray(limits) for limits in (task.encoder.low, task.encoder.high))
            shown: spaces.Space[Any] = spaces.Box(low, high, dtype=np.float32)
        case "node":
            shown = spaces.Discrete(task.encoder.nodes)
        case "one-hot":
            shown = spaces.Box(0.0, 1.0, (task.encoder.nodes,), np.float32)
    if options.mask == "info":
        return shown
    return spaces.Dict(dict(zip(KEYS[options.mask], (shown, spaces.MultiBinary(task.exits)), strict=True)))


def with_mask(shown: Any, mask: Int8[np.ndarray, "*walker exit"], options: EnvOptions) -> Any:
    """An observation, or those of many walkers, as the space has it.

    Parameters
    ----------
    shown, mask
        What is shown of it, and which exits may be taken.
    options
        Where the mask stands.

    Returns
    -------
    Any
        The observation alone, or a dictionary.
    """
    return shown if options.mask == "info" else dict(zip(KEYS[options.mask], (shown, mask.copy()), strict=True))
