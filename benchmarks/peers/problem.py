"""What every peer learns: one map as plain arrays, the sizes to learn it with, and its walkers in NumPy.

Nothing here imports Sidestep or JAX, so that a peer pays for what it needs and for nothing else.
"""

import json
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Task:
    """Sizes that are the same for all peers; what else they need they tune themselves."""

    name: str
    walkers: int
    """Side by side; one gradient step for each step of all of them."""
    batch: int
    hidden: tuple[int, ...]
    replay: int
    """Transitions that a replay holds."""
    transitions: int
    """The budget: steps of all walkers together."""
    check_every: int
    """Transitions between two looks at what is learned."""
    one_hot: bool
    """The network is told the crossing, one-hot, and x and y in [-1, 1]; else x and y in blocks alone."""
    random_origins: float
    """Share of the budget in which episodes begin anywhere, and not at the scenario's origin."""
    gamma: float
    unit: float
    """Minutes in one unit of reward."""

    @property
    def iterations(self) -> int:
        """Steps of each walker."""
        return self.transitions // self.walkers


CONGESTED = Task("congested", 64, 256, (50, 50), 51_200, 102_400, 2_560, True, 0.5, 1.0, 10.0)
"""To 1 % over the optimum, as fast as each can."""
PAPER = Task("paper", 1, 32, (50, 50), 10_000, 6_000, 1_000, False, 0.0, 0.95, 1.0)
"""The paper's sizes: how long a step takes, with its gradient step."""
TASKS = {task.name: task for task in (CONGESTED, PAPER)}


@dataclass(frozen=True, eq=False)
class Problem:
    """One map whose crowds come as forecast, so that all walks are alike."""

    task: Task
    scenario: str
    """The scenario as JSON."""
    seed: int
    index: int
    """Which of its maps this is: the map of that number, drawn from that seed."""
    exit_node: np.ndarray
    """[node, exit]: where each exit leads; -1 where there is none."""
    exit_segment: np.ndarray
    length: np.ndarray
    """[segment], m."""
    speed: np.ndarray
    """[segment, slot], m/s; the last slot lasts for ever."""
    position: np.ndarray
    """[node, 2], m."""
    slot_seconds: float
    origin: int
    destination: int
    horizon: float
    """Seconds after which a walk is cut off."""
    unit_seconds: float
    progress: float
    bonus: float
    """Weights of the scenario's reward."""
    optimum: float
    """Minutes of the best walk."""
    path: Path | None = None
    """The file that this was read from."""

    @property
    def nodes(self) -> int:
        """Crossings of the map."""
        return len(self.position)

    @property
    def exits(self) -> int:
        """Actions."""
        return self.exit_node.shape[1]

    @cached_property
    def valid(self) -> np.ndarray:
        """[node, exit]: which exits there are."""
        return self.exit_node >= 0

    @cached_property
    def taken(self) -> np.ndarray:
        """[node, exit]: the exit that is taken instead of one that does not exist, the next one round."""
        distance = (np.arange(self.exits) - np.arange(self.exits)[:, None]) % self.exits
        return np.argmin(np.where(self.valid[:, None], distance, self.exits), axis=2)

    @cached_property
    def features(self) -> np.ndarray:
        """[node, input]: what the network is told at each crossing."""
        low, extent = self.position.min(axis=0), np.ptp(self.position, axis=0)
        if not self.task.one_hot:
            blocks = np.sqrt(self.nodes) - 1
            return np.asarray((self.position - low) * blocks / extent, np.float32)
        return np.hstack([2 * (self.position - low) / extent - 1, np.eye(self.nodes)]).astype(np.float32)

    @cached_property
    def elsewhere(self) -> np.ndarray:
        """All nodes but the destination."""
        return np.setdiff1d(np.arange(self.nodes), [self.destination])

    @cached_property
    def potential(self) -> np.ndarray:
        """[node]: the reward's term for being there, in minutes."""
        far = np.linalg.norm(self.position - self.position[self.destination], axis=1)
        return self.bonus * (far == 0) - self.progress * far

    @cached_property
    def covered(self) -> np.ndarray:
        """[segment, slot]: metres that could be walked before each slot."""
        before = np.cumsum(self.speed[:, :-1] * self.slot_seconds, axis=1)
        return np.hstack([np.zeros((len(self.speed), 1)), before])

    def greedy(self, values: np.ndarray) -> np.ndarray:
        """Take the best exit that exists at each crossing, by values [node, exit]."""
        return np.argmax(np.where(self.valid, values, -np.inf), axis=1)

    def save(self, path: Path) -> None:
        """Write to an ``.npz`` file."""
        arrays = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in ("task", "path")}
        np.savez(path, task=json.dumps(asdict(self.task)), **arrays)


def load_problem(path: Path) -> Problem:
    """Read what :meth:`Problem.save` wrote."""
    with np.load(path) as file:
        found = {name: file[name] for name in file.files}
    task = json.loads(found.pop("task").item())
    task["hidden"] = tuple(task["hidden"])
    return Problem(
        Task(**task), **{name: each if each.ndim else each.item() for name, each in found.items()}, path=path
    )


class Walkers:
    """Walkers side by side; those whose episode ends begin another at once."""

    def __init__(self, problem: Problem, seed: int) -> None:
        self.problem = problem
        self.rng = np.random.default_rng(seed)
        self.count, self.iteration = problem.task.walkers, 0
        slots = problem.speed.shape[1]
        # One sorted row for all segments, so that one search finds all walkers' slots.
        self._apart = problem.covered.max() + 10 * problem.length.max()
        self._rows = (problem.covered + self._apart * np.arange(len(problem.speed))[:, None]).ravel()
        self._covered, self._speed, self._slots = problem.covered.ravel(), problem.speed.ravel().astype(float), slots
        self.node, self.clock = self._origins(), np.zeros(self.count)

    def _origins(self) -> np.ndarray:
        problem, task = self.problem, self.problem.task
        if self.iteration >= task.random_origins * task.iterations:
            return np.full(self.count, problem.origin)
        return problem.elsewhere[self.rng.integers(len(problem.elsewhere), size=self.count)]

    def reset(self) -> np.ndarray:
        """Put all walkers at their origins, and say where these are."""
        self.node, self.clock = self._origins(), np.zeros(self.count)
        return self.node

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Walk to the next crossings.

        Returns
        -------
        there, reward, terminated, truncated, node
            The crossings that the steps lead to, and those at which walkers stand afterwards, some at a new origin.
        """
        problem, before = self.problem, self.node
        self.iteration += 1
        taken = problem.taken[before, actions]
        there, seconds = problem.exit_node[before, taken], self._crossing_seconds(problem.exit_segment[before, taken])
        self.clock = self.clock + seconds
        reward = problem.potential[there] - problem.potential[before] - seconds / problem.unit_seconds
        terminated = there == problem.destination
        truncated = ~terminated & (self.clock >= problem.horizon)
        over = terminated | truncated
        self.node = there
        if over.any():
            self.node, self.clock = np.where(over, self._origins(), there), np.where(over, 0.0, self.clock)
        return there, (reward / problem.task.unit).astype(np.float32), terminated, truncated, self.node

    def _crossing_seconds(self, segment: np.ndarray) -> np.ndarray:
        """Walk through the slots that crossings span, at each slot's speed."""
        problem, first = self.problem, segment * self._slots
        slot_seconds, last = problem.slot_seconds, self._slots - 1
        now = np.minimum((self.clock // slot_seconds).astype(int), last)
        at = first + now
        end = self._covered[at] + self._speed[at] * (self.clock - now * slot_seconds) + problem.length[segment]
        then = np.searchsorted(self._rows, end + self._apart * segment, side="right") - 1 - first
        then = np.clip(then, now, last)
        at = first + then
        return then * slot_seconds + (end - self._covered[at]) / self._speed[at] - self.clock
