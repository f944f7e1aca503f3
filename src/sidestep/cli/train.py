"""The command `train`."""

import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from sidestep.cli import options
from sidestep.cli.console import print_text, progress

if TYPE_CHECKING:
    from sidestep.agent.checkpoint import Metadata
    from sidestep.agent.runs import TrainingRun


@Parameter(name="*")
@dataclass(frozen=True)
class Settings:
    """Changes to the settings of a preset; None leaves a field as it is."""

    rounds: options.Whole | None = None
    """Rounds of training."""

    patience: options.Whole | None = None
    """End early after so many rounds without any change in the test walks."""

    destinations: options.Whole | None = None
    """How many destinations to learn: on grids the last node and others; in real places some of their own, or of all
    crossings."""

    gamma: float | None = None
    """Discount factor."""

    n_step: options.Whole | None = None
    """Steps of each return."""

    alpha: float | None = None
    """Prioritisation of the replay; 0 is uniform."""

    double: bool | None = None
    """Double Q-learning."""

    dueling: bool | None = None
    """Value and advantage apart."""

    potential: bool | None = None
    """Correct the level's own estimate of the cost to go, or learn all from nothing."""

    correction_margin_seconds: Annotated[float | None, Parameter(name="--correction-margin")] = None
    """Once trained: seconds that a learned correction must save against the level's own estimate."""

    estimate_when_revisiting: bool | None = None
    """Once trained: follow the level's own estimate where a walk comes back."""


AS_PRESET = Settings()


KEPT = {
    "best": "the network of the best walks",
    "last": "the last network",
    "mean": "the mean network of the last quarter of rounds",
}
"""What a training results in, by ``keep`` of its settings."""


def train(
    scenario: options.ScenarioOption,
    /,
    *,
    level: options.LevelOption = None,
    preset: options.PresetOption = "default",
    index: options.MapNumber = 0,
    settings: Settings = AS_PRESET,
    changes: options.Changes = options.UNCHANGED,
    out: Path | None = None,
    resume: options.Flag = False,
    overwrite: options.Flag = False,
    keep_checkpoints: options.Whole = 2,
    track: options.Flag = False,
    seed: options.Seed = 0,
    as_json: options.Json = False,
) -> None:
    """Train an agent on one map of a scenario, or on many where the scenario says so.

    Parameters
    ----------
    out
        Folder for the model, saved every few seconds, and for the picture of its learning curve.
    resume
        Go on with the training in --out, as if it had not been interrupted. More --rounds than before may be asked for.
    overwrite
        Replace the model in --out as soon as there is something to save.
    keep_checkpoints
        Checkpoints that stay in --out, the latest ones.
    track
        Write an event file for TensorBoard into --out as well.
    """
    options.check_least(seed=seed, map=index)
    options.start_jax()
    from sidestep.agent import runs
    from sidestep.agent.checkpoint import read_metadata
    from sidestep.agent.presets import preset_for
    from sidestep.experiments.folders import check_no_sweep
    from sidestep.files import OutputError
    from sidestep.planners.time_dependent import least_minutes

    if out is not None:
        check_no_sweep(out)
    problem = options.read_scenario(scenario, changes)
    config = preset_for(problem, preset, level).changed(**options.changed_fields(settings))
    before = len(read_metadata(out).curve) if resume and out is not None else 0
    trained: list[Metadata] = []
    try:
        with progress("training", (config.rounds - before) * config.round_steps, "steps") as advance:

            def on_round(run: "TrainingRun") -> None:
                trained[:] = [run.metadata]
                advance(f"greedy walk {run.test_minutes.mean():.0f} min", config.round_steps)

            run = runs.train(
                problem,
                config,
                seed=seed,
                index=index,
                out=out,
                resume=resume,
                overwrite=overwrite,
                keep_checkpoints=keep_checkpoints,
                track=track,
                least_minutes=least_minutes if out is not None else None,
                on_round=on_round,
            )
    except BaseException:  # also Ctrl-C: the picture is of what there is
        if out is not None and trained:
            with suppress(OutputError):  # the disk may be full, and that has been said
                draw_curve(out, *trained)
        raise
    picture = None if out is None else draw_curve(out, run.metadata)
    if as_json:
        print(json.dumps({**run.to_json(), "picture": picture and str(picture)}, indent=2))
    else:
        show_run(scenario, run)
        if picture is not None:
            print(f"Learning curve: {picture}")


def draw_curve(folder: Path, trained: "Metadata") -> Path:
    """Draw the learning curve of a training into the folder of its model."""
    from sidestep.plotting import draw_training, save

    picture = folder / "learning-curve.png"
    save(draw_training(trained), picture)
    return picture


def show_run(scenario: str, run: "TrainingRun") -> None:
    """Print what was trained, how fast, and how long the greedy test walks took."""
    metadata, config, problem, rates = run.metadata, run.metadata.config, run.metadata.scenario, run.metrics
    print_text(
        f"{scenario}, map {metadata.map}, level {config.level}: {len(metadata.curve)} rounds of "
        f"{config.round_steps:,} transitions in {run.seconds:.1f} s ({rates.steps_per_second:,.0f} transitions/s, "
        f"{rates.updates_per_second:,.0f} updates/s)"
    )
    for said in filter(None, (problem.summary, problem.place.synthetic, problem.walker.remark)):
        print_text(said)
    first, last = metadata.means[0], metadata.means[-1]
    unit = "min" if problem.objective.is_time else "min of cost"
    walks = f"{first:.1f} {unit} after the first round, {last:.1f} after the last, {run.best_minutes:.1f} at best"
    early = config.keep == "mean" and len(metadata.curve) <= config.rounds_before_mean
    print_text(f"greedy test walks: {walks}; {KEPT['last' if early else config.keep]} is kept")
    if run.folder is not None:
        print(f"Model: {run.folder}")
