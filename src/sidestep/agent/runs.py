"""One training run: start, resume, save, report progress. The command line, experiments and scripts all call it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float

from sidestep.agent.checkpoint import (
    MODEL,
    Checkpoint,
    CheckpointError,
    Metadata,
    checkpoints,
    load,
    read_metadata,
    save,
)
from sidestep.agent.config import TrainConfig, TrainConfigError
from sidestep.agent.train import training_rounds
from sidestep.arguments import COUNT, FLAG, FUNCTION, INDEX, PATH, SEED, checked, instance
from sidestep.files import output_folder
from sidestep.scenarios.episodes import check_paths, destinations_of
from sidestep.scenarios.maps import draw_training_map
from sidestep.scenarios.model import A_SCENARIO, Scenario

SAVE_SECONDS = 2.0
"""Least time between two checkpoints, s."""
SAVE_SHARE = 0.005
"""Largest share of its time that a training spends on saving, but for the first and the last checkpoint: the
larger they are, the longer it waits."""
KEEP_CHECKPOINTS = 2
"""Checkpoints that stay in the folder: should the latest be damaged, the training goes on from the one before."""


@dataclass(frozen=True)
class TrainingRun(Checkpoint):
    """A training run after one of its rounds; after the last, its result.

    Its ``state`` is used up by the next round: a callback that keeps it must copy it.
    """

    seconds: float
    """Time since the run was started or resumed, s."""
    steps_per_second: float
    """Environment steps; the first round is left out, since it waits for the compiler."""
    updates_per_second: float
    """Gradient steps."""
    folder: Path | None
    """Where the model is saved."""

    @property
    def test_minutes(self) -> Float[np.ndarray, " test"]:
        """Minutes of the greedy test walks after the latest round."""
        return np.asarray(self.metadata.curve[-1])

    @property
    def best_minutes(self) -> float:
        """Mean of the best round's test walks, min."""
        return float(self.state.best_minutes)

    def to_json(self) -> dict[str, Any]:
        """The shape of ``train --json``."""
        config = self.metadata.config
        return self.metadata.model_dump(mode="json", include={"scenario", "seed", "map"}) | {
            "synthetic": self.metadata.scenario.place.synthetic,
            "level": config.level,
            "config": config.model_dump(mode="json"),
            "seconds": self.seconds,
            "steps_per_second": self.steps_per_second,
            "updates_per_second": self.updates_per_second,
            "curve_minutes": [sum(walks) / len(walks) for walks in self.metadata.curve],
            "best_minutes": self.best_minutes,
            "model": None if self.folder is None else str(self.folder),
        }


OnRound = Callable[[TrainingRun], None]


@checked(
    TrainConfigError,
    scenario=A_SCENARIO,
    config=instance(TrainConfig, "settings, such as sidestep.preset('default')"),
    seed=SEED,
    index=INDEX,
    out=PATH,
    resume=FLAG,
    overwrite=FLAG,
    keep_checkpoints=COUNT,
    on_round=FUNCTION,
)
def train(
    scenario: Scenario,
    config: TrainConfig,
    *,
    seed: int = 0,
    index: int = 0,
    out: Path | str | None = None,
    resume: bool = False,
    overwrite: bool = False,
    keep_checkpoints: int = KEEP_CHECKPOINTS,
    on_round: OnRound = lambda _run: None,
) -> TrainingRun:
    """Train an agent on one map of a scenario, or on its training maps where it has such.

    Parameters
    ----------
    scenario
        What is learned.
    config
        How it is learned; see :func:`sidestep.preset`.
    seed
        Seed of the map, its crowds and the training. The same seed gives the same run, to the bit.
    index
        Number of the map.
    out
        Folder for the model and its checkpoints; both are saved after the first round, every few seconds (less often
        where saving takes long), and at the end.
    resume
        Go on with the training in ``out``, which must be of the same scenario, map, seed and configuration. The result
        is the same, to the bit, as without the interruption. Only ``rounds`` may be more than before, also where all of
        them were done: schedules, such as that of ε, then go on as if there had always been so many.
    overwrite
        Replace the model in ``out``, finished or not, as soon as there is something to save. Without it, and without
        ``resume``, a model that is there is refused.
    keep_checkpoints
        How many checkpoints stay in ``out``, the latest ones.
    on_round
        Called after every round with the run so far, to report progress or to judge what has been learned.

    Returns
    -------
    TrainingRun
        Its ``model`` is what was learned; :func:`sidestep.trained_darp` makes a planner of it.

    Raises
    ------
    CheckpointError
        There is nothing to resume, or it was trained otherwise or to the end; or ``out`` has a model that is neither to
        be resumed nor overwritten (field ``out``), or both (``overwrite``).
    TrainConfigError
        Anything that is not as above; the parameter is its field.
    ScenarioError
        There are fewer destinations than are to be learned, or no way on from a crossing.
    OutputError
        The folder cannot be written to; what was saved before stays.

    Warns
    -----
    SidestepWarning
        The latest checkpoint is damaged, and the training goes on from one before it.

    Examples
    --------
    >>> import sidestep
    >>> small = sidestep.preset("default").changed(rounds=2, round_steps=64, walkers=8, batch=16, capacity=64)
    >>> run = sidestep.train(sidestep.scenario("paper-congested", side=3, crowded_nodes=1), small)
    >>> len(run.metadata.curve), run.model.q_network.crossings
    (2, 9)
    """
    out = None if out is None else Path(out)
    _check_folder(out, resume=resume, overwrite=overwrite)
    drawn = draw_training_map(scenario, seed, index)
    # What nobody can learn is refused before anything is written.
    destinations_of(drawn, config.destinations)
    check_paths(drawn)
    metadata = Metadata(scenario=scenario, seed=seed, map=index, config=config, fingerprint=drawn.fingerprint)
    state = None
    if out is not None:
        if resume:
            _check_same(out, metadata)
            found = load(out)
            metadata, state = metadata.model_copy(update={"curve": found.metadata.curve}), found.state
            _check_unfinished(out, metadata)
        output_folder(out)
    before = len(metadata.curve)
    began, first, save_at = perf_counter(), math.inf, -math.inf
    for now, report in training_rounds(config, scenario, drawn, state):
        curve = (*metadata.curve, tuple(report.test_minutes.tolist()))
        metadata = metadata.model_copy(update={"curve": curve})
        at = perf_counter()
        first, done = min(first, at), len(curve) - before
        rate = (done - 1) / (at - first) if done > 1 else 1 / (at - began)  # rounds per second
        run = TrainingRun(metadata, now, at - began, rate * config.round_steps, rate * config.iterations, folder=out)
        if out is not None and (metadata.finished or at > save_at):
            save(run, out, keep_checkpoints)
            saved = perf_counter()
            save_at = saved + max(SAVE_SECONDS, (saved - at) / SAVE_SHARE)
        on_round(run)
        if metadata.finished:
            break
    return run


def _check_folder(folder: Path | None, *, resume: bool, overwrite: bool) -> None:
    """Refuse to lose a model that nobody said to replace."""
    if resume and overwrite:
        raise CheckpointError("--resume and --overwrite exclude each other", field="overwrite")
    if folder is None:
        if resume or overwrite:
            word = "resume" if resume else "overwrite"
            raise CheckpointError(f"to {word} a training, give the folder of its model: --out", field="out")
    elif not (resume or overwrite) and ((there := checkpoints(folder)) or (folder / MODEL).exists()):
        onward = "go on with it (--resume), " if there else ""
        said = f"{folder} has a model already: {onward}replace it (--overwrite) or choose another folder with --out"
        raise CheckpointError(said, field="out")


def _check_same(folder: Path, wanted: Metadata) -> None:
    """Refuse to go on with the training in a folder if it is another one."""
    found = read_metadata(folder)
    before, asked = found.settings, wanted.settings
    for name in before | asked:
        old, new = (f"{settings.get(name)!s:.60}" for settings in (before, asked))
        if before.get(name) != asked.get(name) and not (name == "rounds" and asked[name] > before[name]):
            more = " or more" if name == "rounds" else ""
            said = f"the training in {folder} has {name} {old}, not {new}"
            raise CheckpointError(f"{said}; ask for the same{more}, or --overwrite it", field=name)


def _check_unfinished(folder: Path, metadata: Metadata) -> None:
    """Refuse to go on with a training that is over."""
    if metadata.finished:
        done = len(metadata.curve)
        more = ", ask for more with --rounds" if done == metadata.config.rounds else ""  # or its walks have settled
        said = f"the model in {folder} has been trained to the end, {done} rounds; use it{more}, or --overwrite it"
        raise CheckpointError(said, field="rounds")
