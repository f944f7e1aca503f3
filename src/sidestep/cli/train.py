"""The command `train`."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Annotated

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
from sidestep.errors import SidestepError

SAVE_EVERY = 2.0  # seconds of training between checkpoints


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
            help="How many destinations to learn: of a grid its last node and others; of a real place some of its own, "
            "or of all crossings."
        ),
    ] = None,
    gamma: Annotated[float | None, Parameter(help="Discount factor.")] = None,
    n_step: Annotated[int | None, Whole(help="Steps of each return.")] = None,
    alpha: Annotated[float | None, Parameter(help="Prioritisation of the replay; 0 is uniform.")] = None,
    double: Annotated[bool | None, Parameter(help="Double Q-learning.")] = None,
    dueling: Annotated[bool | None, Parameter(help="Value and advantage apart.")] = None,
    potential: Annotated[
        bool | None, Parameter(help="Correct the level's own estimate of the time to go, or learn all from nothing.")
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
    if resume and out is None:
        raise SidestepError("--resume needs --out, the folder of the model to go on with")
    start_jax()
    from sidestep.agent import checkpoint
    from sidestep.agent.config import changed
    from sidestep.agent.presets import preset_for
    from sidestep.agent.train import learned_place
    from sidestep.agent.train import train as rounds_of
    from sidestep.files import output_folder
    from sidestep.scenarios.maps import draw_training_map, fingerprint

    problem = read_scenario(scenario, changes)
    config = changed(
        preset_for(problem, preset, level),
        rounds=rounds, destinations=destinations, gamma=gamma, n_step=n_step, alpha=alpha, double=double,
        dueling=dueling, potential=potential,
    )  # fmt: skip
    state, curve = None, []
    if resume and out is not None:
        run = checkpoint.load(out)
        if run.config.level != config.level:
            raise SidestepError(f"the model in {out} is of level {run.config.level}, not {config.level}")
        if (run.scenario, run.seed, run.index, run.config) != (problem, seed, index, config):
            raise SidestepError(
                f"the model in {out} is of another scenario, map, seed or configuration; it cannot go on"
            )
        state, curve = run.state, list(run.curve)
    place = draw_training_map(problem, seed, index)
    learned = fingerprint(place)
    learned_place(config, problem, place)  # refuses what cannot be learned, before anything is written
    if out is not None:
        output_folder(out)
    began, before, saved, first = perf_counter(), len(curve), -math.inf, math.inf
    with progress(
        f"training on {scenario}, map {index}", config.rounds - before, config.round_steps, "transitions"
    ) as advance:
        for now, report in rounds_of(config, problem, place, state):
            curve.append(tuple(report.test_minutes.tolist()))
            first = min(first, perf_counter())
            run = checkpoint.TrainingRun(problem, seed, index, config, tuple(curve), learned, now)
            if out is not None and (len(curve) == config.rounds or perf_counter() - saved > SAVE_EVERY):
                checkpoint.save(run, out)
                saved = perf_counter()
            advance(f"greedy walk {report.test_minutes.mean():.0f} min")
    ended = perf_counter()
    if len(curve) == before:
        raise SidestepError(f"the model in {out} has been trained to the end, {before} rounds")
    # The first round is left out of the rates, since it waits for the compiler.
    done = len(curve) - before
    rate = (done - 1) / (ended - first) if done > 1 else 1 / (ended - began)
    summary = {
        "scenario": asdict(problem),
        "seed": seed,
        "map": index,
        "level": config.level,
        "config": asdict(config),
        "seconds": ended - began,
        "steps_per_second": rate * config.round_steps,
        "updates_per_second": rate * config.iterations,
        "curve_minutes": [sum(walks) / len(walks) for walks in curve],
        "best_minutes": float(run.state.best_minutes),
        "model": None if out is None else str(out),
    }
    if as_json:
        print(json.dumps(summary, indent=2))
        return
    means = summary["curve_minutes"]
    print(
        f"{scenario}, map {index}, level {config.level}: {len(curve)} rounds of {config.round_steps:,} transitions in "
        f"{summary['seconds']:.1f} s ({summary['steps_per_second']:,.0f} transitions/s, "
        f"{summary['updates_per_second']:,.0f} updates/s)"
    )
    print(problem.summary, end="\n" if problem.summary else "")
    unit = "min" if problem.objective is None else "min of cost"
    print(f"greedy test walks: {means[0]:.1f} {unit} after the first round, {means[-1]:.1f} after the last, ", end="")  # type: ignore[index]
    print(f"{summary['best_minutes']:.1f} at best" + ("" if out is None else f"; model: {out}"))
