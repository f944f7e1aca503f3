"""One training run: start, resume, save, report progress. The command line, experiments and scripts all call it."""

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
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
from sidestep.agent.config import TrainConfig, TrainConfigError, differences
from sidestep.agent.memory import check_memory
from sidestep.agent.metrics import METRICS, MetricsFile, RoundMetrics, open_metrics
from sidestep.agent.tracking import EventFile, check_tracking, remove_events
from sidestep.agent.train import RoundReport, TrainState, training_rounds
from sidestep.arguments import COUNT, FLAG, FUNCTION, INDEX, PATH, SEED, checked, instance
from sidestep.environment.types import EnvParams, Instance
from sidestep.files import output_folder, remove_unfinished
from sidestep.scenarios.episodes import check_paths, destinations_of
from sidestep.scenarios.maps import draw_training_map
from sidestep.scenarios.model import A_SCENARIO, Scenario

SAVE_SECONDS = 2.0
"""Least time between two checkpoints, s."""
SAVE_SHARE = 0.005
"""Largest share of its time that a training spends on saving, but for the first two checkpoints and the last one: the
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
    metrics: RoundMetrics
    """How the latest round went, as ``metrics.jsonl`` has it."""
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
            "steps_per_second": self.metrics.steps_per_second,
            "updates_per_second": self.metrics.updates_per_second,
            "curve_minutes": self.metadata.means,
            "best_minutes": self.best_minutes,
            "model": None if self.folder is None else str(self.folder),
        }


OnRound = Callable[[TrainingRun], None]
LeastMinutes = Callable[[EnvParams, Instance], Float[np.ndarray, " walk"]]
"""Works out how many minutes walks through an environment take at least."""


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
    track=FLAG,
    least_minutes=FUNCTION,
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
    track: bool = False,
    least_minutes: LeastMinutes | None = None,
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
        where saving takes long), and at the end. ``metrics.jsonl`` there has a line for every round
        (:class:`~sidestep.agent.metrics.RoundMetrics`).
    resume
        Go on with the training in ``out``, which must be of the same scenario, map, seed and configuration. The result
        is the same, to the bit, as without the interruption. Only ``rounds`` may be more than before, also where all of
        them were done: schedules, such as that of ε, then go on as if there had always been so many.
    overwrite
        Replace the model in ``out``, finished or not, as soon as there is something to save. Without it, and without
        ``resume``, a model that is there is refused.
    keep_checkpoints
        How many checkpoints stay in ``out``, the latest ones.
    track
        Write an event file for TensorBoard into ``out`` as well, of all rounds, also of those before a resumption.
    least_minutes
        Works out the least minutes of the greedy test walks, such as
        :func:`sidestep.planners.time_dependent.least_minutes`; the metrics then have the gap to them.
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
        be resumed nor overwritten, or another training writes to it (field ``out``), or both flags (``overwrite``).
    TrainConfigError
        Anything that is not as above; the parameter is its field. Or a training that needs more memory than is free:
        the setting that takes most of it.
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
    _check_folder(out, resume=resume, overwrite=overwrite, track=track)
    resume = resume and not _saved_nothing(out)
    drawn = draw_training_map(scenario, seed, index)
    # What nobody can learn is refused before anything is written.
    destinations_of(drawn, config.destinations)
    check_paths(drawn)
    check_memory(config, scenario, drawn)
    metadata = Metadata(scenario=scenario, seed=seed, map=index, config=config, fingerprint=drawn.fingerprint)
    least: list[float] = []

    def on_tests(params: EnvParams, tests: Instance) -> None:
        if least_minutes is not None:
            least.append(float(np.mean(least_minutes(params, tests))))

    with ExitStack() as opened:
        folder = state = None
        if out is not None:
            if resume:
                _check_same(out, metadata)
            folder = opened.enter_context(_opened(output_folder(out), keep_checkpoints, track=track))
            _check_folder(out, resume=resume, overwrite=overwrite)  # another training may just have ended there
            if resume:
                metadata, state = _resumed(out, metadata)
        before = metadata
        began, first, earlier = perf_counter(), math.inf, 0.0
        for now, report in training_rounds(config, scenario, drawn, state, on_tests):
            at = perf_counter()
            if folder is not None and metadata is before:
                earlier = folder.begin(metadata)
            metadata = metadata.model_copy(update={"curve": (*metadata.curve, tuple(report.test_minutes.tolist()))})
            first, done = min(first, at), len(metadata.curve) - len(before.curve)
            rate = (done - 1) / (at - first) if done > 1 else 1 / (at - began)  # rounds per second
            metrics = _line(metadata, report, earlier + at - began, rate, *least)
            run = TrainingRun(metadata, now, at - began, metrics, out)
            if folder is not None:
                folder.add(run)
            on_round(run)
            if metadata.finished:
                break
    return run


def _saved_nothing(folder: Path | None) -> bool:
    """Whether a training was stopped before it saved anything: to go on with it is to begin."""
    return folder is not None and (folder / METRICS).exists() and not _has_model(folder)


def _has_model(folder: Path) -> bool:
    return bool(checkpoints(folder)) or (folder / MODEL).exists()


@contextmanager
def _opened(path: Path, keep: int, *, track: bool) -> Iterator["_Folder"]:
    """Keep other trainings out of a folder."""
    with open_metrics(path) as metrics:
        folder = _Folder(path, metrics, keep, track=track)
        try:
            yield folder
        finally:
            if folder.events is not None:
                folder.events.close()


class _Folder:
    """Where a training under way saves what it has learned, and how it went."""

    def __init__(self, path: Path, metrics: MetricsFile, keep: int, *, track: bool) -> None:
        self._path, self._metrics, self._keep, self._track = path, metrics, keep, track
        self.events: EventFile | None = None
        self._save_at, self._fastest = -math.inf, math.inf

    def begin(self, metadata: Metadata) -> float:
        """Clear away what the rounds so far did not write, and say how many seconds these took."""
        remove_unfinished(self._path, "*.eqx")
        kept = self._metrics.cut(metadata.means)
        remove_events(self._path)
        if self._track:
            self.events = EventFile(self._path, kept)
        return kept[-1].seconds if kept else 0.0

    def add(self, run: TrainingRun) -> None:
        """Write down how a round went and, at the end or if it is time, what has been learned."""
        self._metrics.append(run.metrics)
        if self.events is not None:
            self.events.add(run.metrics)
        began = perf_counter()
        if run.metadata.finished or began > self._save_at:
            save(run, self._path, self._keep)
            ended = perf_counter()
            wait = SAVE_SECONDS
            if self._save_at > 0:  # the first one takes longer than others, and any may by chance
                self._fastest = min(self._fastest, ended - began)
                wait = max(wait, self._fastest / SAVE_SHARE)
            self._save_at = ended + wait


def _line(
    metadata: Metadata, report: RoundReport, seconds: float, rate: float, least: float | None = None
) -> RoundMetrics:
    """How a training stands after a round, at so many rounds a second."""
    config, rounds, minutes = metadata.config, len(metadata.curve), fmean(metadata.curve[-1])
    return RoundMetrics(
        round=rounds,
        steps=rounds * config.round_steps,
        seconds=seconds,
        loss=float(report.learned.loss),
        td_error=float(report.learned.td_error),
        q=float(report.learned.q),
        epsilon=float(report.epsilon),
        minutes=minutes,
        gap=None if least is None else minutes / least - 1,
        arrival_rate=float(np.asarray(report.test_arrived).mean()),
        steps_per_second=rate * config.round_steps,
        updates_per_second=rate * config.iterations,
    )


def _check_folder(folder: Path | None, *, resume: bool, overwrite: bool, track: bool = False) -> None:
    """Refuse to lose a model that nobody said to replace."""
    if resume and overwrite:
        raise CheckpointError("--resume and --overwrite exclude each other", field="overwrite")
    if track:
        check_tracking()
    if folder is None:
        if resume or overwrite or track:
            word = "resume" if resume else "overwrite" if overwrite else "track"
            raise CheckpointError(f"to {word} a training, give the folder of its model: --out", field="out")
    elif not (resume or overwrite) and _has_model(folder):
        onward = "go on with it (--resume), " if checkpoints(folder) else ""
        said = f"{folder} has a model already: {onward}replace it (--overwrite) or choose another folder with --out"
        raise CheckpointError(said, field="out")


def _check_same(folder: Path, wanted: Metadata) -> None:
    """Refuse to go on with the training in a folder if it is another one."""
    for name, (old, new) in differences(read_metadata(folder).settings, wanted.settings).items():
        if name == "rounds" and new > old:
            continue
        more = " or more" if name == "rounds" else ""
        said = f"the training in {folder} has {name} {old!s:.60}, not {new!s:.60}"
        raise CheckpointError(f"{said}; ask for the same{more}, or --overwrite it", field=name)


def _resumed(folder: Path, wanted: Metadata) -> tuple[Metadata, TrainState]:
    """Where the training in a folder stands, unless it is over."""
    found = load(folder)
    metadata = wanted.model_copy(update={"curve": found.metadata.curve})
    if metadata.finished:
        done = len(metadata.curve)
        more = ", ask for more with --rounds" if done == metadata.config.rounds else ""  # or its walks have settled
        said = f"the model in {folder} has been trained to the end, {done} rounds; use it{more}, or --overwrite it"
        raise CheckpointError(said, field="rounds")
    return metadata, found.state
