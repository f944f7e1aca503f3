"""Trainings on disk, running or not: what they are of, how far they are, and how good."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sidestep.agent.checkpoint import MODEL, CheckpointError, Metadata, checkpoints, read_metadata
from sidestep.agent.metrics import METRICS, RoundMetrics, is_running, read_metrics
from sidestep.files import reason

State = Literal["running", "interrupted", "finished", "unreadable"]


@dataclass(frozen=True)
class RunFolder:
    """The folder of a training."""

    path: Path
    state: State
    """``interrupted``: it can go on; ``unreadable``: what was saved is damaged or of another version."""
    metadata: Metadata | None
    """Of what has been saved; None where nothing has, or it cannot be read."""
    metrics: Sequence[RoundMetrics]
    """Round by round; none of trainings from before there were metrics."""
    error: str | None = None
    """Why it cannot be read."""

    @property
    def minutes(self) -> list[float]:
        """Mean of the greedy test walks, round by round; of a running training also of rounds that are not saved."""
        saved = [] if self.metadata is None else self.metadata.means
        written = [line.minutes for line in self.metrics]
        ahead = self.state == "running" and len(written) > len(saved)
        return written if ahead else saved

    @property
    def best_round(self) -> int | None:
        """The round of the shortest test walks, from 1; None before the first."""
        minutes = self.minutes
        return 1 + min(range(len(minutes)), key=minutes.__getitem__) if minutes else None

    def after(self, number: int | None) -> RoundMetrics | None:
        """The metrics of a round, where they are known."""
        return next((line for line in self.metrics if line.round == number), None)

    def to_json(self) -> dict[str, Any]:
        """The shape of a row of ``runs --json``."""
        told, best, minutes = self.metadata, self.best_round, self.minutes
        line = self.after(best)
        return {
            "folder": str(self.path),
            "state": self.state,
            "scenario": told and told.scenario.name,
            "map": told and told.map,
            "seed": told and told.seed,
            "level": told and told.config.level,
            "rounds": len(minutes),
            "rounds_total": told and told.config.rounds,
            "seconds": self.metrics[-1].seconds if self.metrics else None,
            "best_minutes": None if best is None else minutes[best - 1],
            "best_round": best,
            "best_gap": line and line.gap,
            "latest_minutes": minutes[-1] if minutes else None,
            "error": self.error,
        }


def read_run(folder: Path) -> RunFolder:
    """Read what a training in a folder is of, and how far it is.

    Parameters
    ----------
    folder
        The folder that :func:`sidestep.train` wrote.

    Returns
    -------
    RunFolder
        Also of one that cannot be read; then with its ``error``.

    Raises
    ------
    CheckpointError
        The folder holds no training (field ``folder``).
    """
    if not holds_training(folder):
        raise CheckpointError(f"no training in {folder}: sidestep runs lists those there are", field="folder")
    running, metadata, error = False, None, None
    metrics: Sequence[RoundMetrics] = ()
    try:
        running, metrics = is_running(folder), read_metrics(folder)
        if checkpoints(folder) or (folder / MODEL).exists():
            metadata = read_metadata(folder)
    except CheckpointError as found:
        error = str(found)
    except OSError as found:
        error = f"cannot read the training in {folder}: {reason(found)}"
    state: State = "finished" if metadata is not None and metadata.finished else "interrupted"
    if running or error is not None:
        state = "running" if running else "unreadable"
    return RunFolder(folder, state, metadata, metrics, error)


def find_runs(folder: Path) -> list[RunFolder]:
    """Read all trainings in a folder and in those below it, but for hidden ones.

    Parameters
    ----------
    folder
        Where to look.

    Returns
    -------
    list of RunFolder
        By path.

    Raises
    ------
    CheckpointError
        There is no such folder (field ``folder``).
    """
    if not folder.is_dir():
        raise CheckpointError(f"{folder} is no folder", field="folder")
    found = []
    for path, below, _ in os.walk(folder):
        below[:] = [name for name in below if not name.startswith(".")]
        if holds_training(Path(path)):
            found.append(Path(path))
    return [read_run(path) for path in sorted(found)]


def holds_training(folder: Path) -> bool:
    """Whether a folder is that of a training, whatever has been saved of it."""
    return bool(checkpoints(folder)) or any((folder / name).exists() for name in (METRICS, MODEL))
