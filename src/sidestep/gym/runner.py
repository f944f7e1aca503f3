"""What the environments have in common: a task, its walkers, and the way between NumPy and the compiled programs."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from sidestep.arguments import brief
from sidestep.environment.types import Instance
from sidestep.gym.choices import Walks, rows_of
from sidestep.gym.options import EnvOptions
from sidestep.gym.task import task_of
from sidestep.gym.walkers import Told, Walkers, programs, streams


class Report(NamedTuple):
    """What is told of walkers, as arrays of NumPy's that nobody else holds."""

    shown: Any
    mask: Int8[np.ndarray, "walker exit"]
    reward: Float[np.ndarray, " walker"]
    cost: Float[np.ndarray, " walker"]
    seconds: Float[np.ndarray, " walker"]
    departure: Float[np.ndarray, " walker"]
    node: Int[np.ndarray, " walker"]
    destination: Int[np.ndarray, " walker"]
    future: Int[np.ndarray, " walker"]
    terminated: Bool[np.ndarray, " walker"]
    truncated: Bool[np.ndarray, " walker"]

    @property
    def over(self) -> Bool[np.ndarray, " walker"]:
        """Whose walk has ended."""
        return self.terminated | self.truncated

    def info(self) -> dict[str, np.ndarray]:
        """What ``info`` has of every walker."""
        return {
            "action_mask": self.mask,
            "node": self.node,
            "destination": self.destination,
            "future": self.future,
            "departure": self.departure,
            "seconds": self.seconds,
            "cost": self.cost,
        }


def _report(told: Told) -> Report:
    # Copies: what JAX hands over may not be written to. Gymnasium's discrete spaces are of int64.
    shown = np.array(told.shown, np.int64 if told.shown.dtype == np.int32 else None)
    floats, ints, flags = np.array(told.floats, np.float64), np.array(told.ints, np.int64), np.array(told.flags)
    return Report(shown, np.array(told.mask), *floats, *ints, *flags)


class Runner:
    """Walkers of one task, all moved by one compiled call."""

    def __init__(self, options: EnvOptions, walkers: int, mode: str, most_steps: int | None = None) -> None:
        self.task = task_of(options)
        self.count, self.exits = walkers, self.task.exits
        self._walks = Walks(self.task, options.scenario.departures[1])
        self._leaves, structure = jax.tree.flatten(self.task)
        self._programs = programs(structure, mode, most_steps)
        self._walkers: Walkers | None = None
        self.begun = False
        """Whether all walkers are on a walk, or at the end of one."""
        self.mask = np.zeros((walkers, self.exits), np.int8)
        """Which exits may be taken now."""

    def seed(self, seeds: Iterable[int], now: Bool[np.ndarray, " walker"] | None = None) -> None:
        """Give walkers random streams, and no walk before their first one.

        Parameters
        ----------
        seeds
            Of 0 or more, one for each walker.
        now
            Which walkers; by default all.
        """
        stream, before = streams(seeds), np.full(self.count, -1, np.int32)
        if self._walkers is None:
            state = self.task.begin(Instance(jnp.int32(0), jnp.int32(0), jnp.float32(0), jnp.int32(0)))
            states = [jnp.broadcast_to(leaf, (self.count, *leaf.shape)) for leaf in jax.tree.leaves(state)]
            self._walkers = Walkers(states, jnp.asarray(stream), jnp.asarray(before), jnp.ones(self.count, bool))
        elif now is not None:
            stream = np.where(now[:, None], stream, self._walkers.stream)
            before = np.where(now, before, self._walkers.episode)
        self._walkers = self._walkers._replace(stream=jnp.asarray(stream), episode=jnp.asarray(before))
        self.begun = self.begun and now is not None

    @property
    def seeded(self) -> bool:
        """Whether walkers have random streams."""
        return self._walkers is not None

    def reset(self, wishes: Sequence[Mapping[str, Any]], now: Bool[np.ndarray, " walker"] | None = None) -> Report:
        """Begin the next walks, as drawn or as asked for.

        Parameters
        ----------
        wishes
            For each walker, some of :data:`sidestep.gym.choices.CHOICES`; or none at all.
        now
            Which walkers begin; by default, and the first time, all.

        Returns
        -------
        Report
            Of all walkers.

        Raises
        ------
        gymnasium.error.ResetNeeded
            They have no random streams yet.
        """
        walkers = self._walkers
        if walkers is None:
            raise gymnasium.error.ResetNeeded("walkers have no random streams yet")
        now = np.ones(self.count, bool) if now is None or not self.begun else now
        episode = walkers.episode + now
        instances = self._programs.sample(self._leaves, walkers.stream, episode)
        if any(wishes):
            instances = self._as_asked(instances, wishes)
        walkers = walkers._replace(episode=episode)
        self._walkers, told = self._programs.begin(self._leaves, walkers, instances, now)
        self.begun = True
        return self._kept(told)

    def step(self, actions: Int[np.ndarray, " walker"]) -> tuple[Report, Report | None]:
        """Walk one street each.

        Parameters
        ----------
        actions
            The exits.

        Returns
        -------
        report, final
            What came of it and, where walks begin in the same step, what was told of those that ended.

        Raises
        ------
        gymnasium.error.ResetNeeded
            No walks have begun.
        """
        if self._walkers is None or not self.begun:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        self._walkers, told, final = self._programs.step(self._leaves, self._walkers, actions)
        return self._kept(told), None if final is None else _report(final)

    def _kept(self, told: Told) -> Report:
        report = _report(told)
        self.mask = report.mask.copy()  # what is told may be written to
        return report

    def _as_asked(self, drawn: Instance, wishes: Sequence[Mapping[str, Any]]) -> Instance:
        each = zip(rows_of(drawn), wishes, strict=True)
        chosen = [self._walks.chosen(walk, asked) for walk, asked in each]
        origin, destination, departure, future = (np.array(column) for column in zip(*chosen, strict=True))
        whole = (jnp.asarray(column, jnp.int32) for column in (origin, destination, future))
        return Instance(next(whole), next(whole), jnp.asarray(departure, jnp.float32), next(whole))


def checked_actions(actions: Any, shape: tuple[int, ...], exits: int) -> Int[np.ndarray, "*walker"]:
    """Actions as an array.

    Parameters
    ----------
    actions
        What was given.
    shape, exits
        What is wanted: how many, and how many exits there are.

    Returns
    -------
    Int[np.ndarray, "*walker"]
        The exits.

    Raises
    ------
    gymnasium.error.InvalidAction
        Anything but whole numbers of exits in that shape.
    """
    try:
        given = np.asarray(actions)
    except (TypeError, ValueError):  # rows of different lengths
        given = np.empty(0)
    if (
        given.dtype.kind not in "iu"
        or given.shape != shape
        or (given.size and not 0 <= given.min() <= given.max() < exits)
    ):
        wanted = "a whole number" if shape == () else f"{shape[0]} whole numbers"
        raise gymnasium.error.InvalidAction(f"action must be {wanted} from 0 to {exits - 1}, not {brief(actions)}")
    return given.astype(np.int32)
