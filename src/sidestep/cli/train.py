"""The command `train`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from sidestep.cli.console import progress
from sidestep.cli.options import (
    UNCHANGED,
    Changes,
    Json,
    LevelOption,
    PresetOption,
    ScenarioOption,
    Seed,
    Whole,
    at_least,
    read_scenario,
    start_jax,
)

if TYPE_CHECKING:
    from sidestep.agent.runs import TrainingRun


def train(
    scenario: ScenarioOption,
    /,
    *,
    level: LevelOption = None,
    preset: PresetOption = "default",
    index: Annotated[int, Whole(name="--map", help="Number of the map.")] = 0,
    rounds: Annotated[int | None, Whole(help="Rounds of training.")] = None,
    destinations: Annotated[
        int | None,
        Whole(
            help="How many destinations to learn: on grids the last node and others; in real places some of their "
            "own, or of all crossings."
        ),
    ] = None,
    gamma: Annotated[float | None, Parameter(help="Discount factor.")] = None,
    n_step: Annotated[int | None, Whole(help="Steps of each return.")] = None,
    alpha: Annotated[float | None, Parameter(help="Prioritisation of the replay; 0 is uniform.")] = None,
    double: Annotated[bool | None, Parameter(help="Double Q-learning.")] = None,
    dueling: Annotated[bool | None, Parameter(help="Value and advantage apart.")] = None,
    potential: Annotated[
        bool | None, Parameter(help="Correct the level's own estimate of the cost to go, or learn all from nothing.")
    ] = None,
    correction_margin: Annotated[
        float | None,
        Parameter(help="Once trained: seconds that a learned correction must save against the level's own estimate."),
    ] = None,
    estimate_when_revisiting: Annotated[
        bool | None, Parameter(help="Once trained: follow the level's own estimate where a walk comes back.")
    ] = None,
    changes: Changes = UNCHANGED,
    out: Annotated[Path | None, Parameter(help="Folder for the model, saved every few seconds.")] = None,
    resume: Annotated[bool, Parameter(negative=(), help="Go on with the model in --out.")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Train an agent on one map of a scenario, or on many where the scenario says so."""
    at_least("seed", seed, 0)
    at_least("map", index, 0)
    start_jax()
    from sidestep.agent import runs
    from sidestep.agent.checkpoint import read_metadata
    from sidestep.agent.presets import preset_for

    problem = read_scenario(scenario, changes)
    asked = {
        "rounds": rounds, "destinations": destinations, "gamma": gamma, "n_step": n_step, "alpha": alpha,
        "double": double, "dueling": dueling, "potential": potential, "correction_margin_seconds": correction_margin,
        "estimate_when_revisiting": estimate_when_revisiting,
    }  # fmt: skip
    config = preset_for(problem, preset, level).changed(
        **{name: value for name, value in asked.items() if value is not None}
    )
    before = len(read_metadata(out).curve) if resume and out is not None else 0
    with progress(
        f"training on {scenario}, map {index}", config.rounds - before, config.round_steps, "transitions"
    ) as advance:
        run = runs.train(
            problem,
            config,
            seed=seed,
            index=index,
            out=out,
            resume=resume,
            on_round=lambda run: advance(f"greedy walk {run.test_minutes.mean():.0f} min"),
        )
    if as_json:
        print(json.dumps(run.to_json(), indent=2))
    else:
        show_run(scenario, run)


def show_run(scenario: str, run: "TrainingRun") -> None:
    """Print what was trained, how fast, and how long the greedy test walks took."""
    metadata, config = run.metadata, run.metadata.config
    print(
        f"{scenario}, map {metadata.map}, level {config.level}: {len(metadata.curve)} rounds of "
        f"{config.round_steps:,} transitions in {run.seconds:.1f} s ({run.steps_per_second:,.0f} transitions/s, "
        f"{run.updates_per_second:,.0f} updates/s)"
    )
    for said in filter(None, (metadata.scenario.summary, metadata.scenario.place.synthetic)):
        print(said)
    first, last = (sum(walks) / len(walks) for walks in (metadata.curve[0], metadata.curve[-1]))
    unit = "min" if metadata.scenario.objective.is_time else "min of cost"
    print(f"greedy test walks: {first:.1f} {unit} after the first round, {last:.1f} after the last, ", end="")
    print(f"{run.best_minutes:.1f} at best" + ("" if run.folder is None else f"; model: {run.folder}"))
