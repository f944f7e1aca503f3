"""The command line: parses, calls, prints. Heavy modules are imported by the commands that need them."""

import json
import math
import os
import sys
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Literal, NoReturn

from cyclopts import App, CycloptsError, Parameter

from sidestep import __version__, console
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cyclopts import Token

    from sidestep.scenarios import Scenario

INTERRUPTED, BAD_INPUT = 130, 2
SAVE_EVERY = 2.0  # seconds of training between checkpoints

app = App(
    name="sidestep",
    help="Walks that take the least time through crowds that keep changing, learned by walking.",
    version=__version__,
    suppress_keyboard_interrupt=False,
)


def _whole(_type: object, tokens: "Sequence[Token]") -> int:
    """A whole number; left alone, the library would round 1.5 to 2 without a word."""
    text = tokens[0].value
    try:
        return int(text)
    except ValueError as error:
        raise ValueError(f"{text!r} is not a whole number") from error


Whole = partial(Parameter, converter=_whole)

Seed = Annotated[int, Whole(help="Seed of maps, crowds and training.")]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print JSON instead of tables.")]
Out = Annotated[Path, Parameter(help="Folder for what is written; made if it is not there.")]
Workers = Annotated[int | None, Whole(help="Maps at a time; by default one for each processor.")]
Preset = Annotated[Literal["default", "paper"], Parameter(help="How the agent learns.")]
FlowsOption = Annotated[
    Literal["arima", "forecast"] | None,
    Parameter(name="--flows", help="Crowds with the model's noise, or its forecast."),
]
RuleOption = Annotated[
    Literal["integrated", "entry"] | None,
    Parameter(name="--rule", help="Crossing times through all slots, or by the density at entry (the paper)."),
]
LawOption = Annotated[
    Literal["power", "power-capped", "weidmann"] | None, Parameter(name="--law", help="Walking speed by density.")
]
Side = Annotated[int | None, Whole(name="--side", help="Nodes along one side of the grid.")]
Crowded = Annotated[int | None, Whole(name="--crowded-nodes", help="Nodes whose streets begin crowded.")]


@app.command
def demo(*, out: Out = Path("demo"), seed: Seed = 0, as_json: Json = False) -> None:
    """Train on one congested map, compare all planners there, and draw where they walk."""
    _at_least("seed", seed, 0)
    _start_jax()
    from sidestep.agent.config import PRESETS
    from sidestep.experiments.demo import demonstrate
    from sidestep.files import output_folder

    output_folder(out)
    config = PRESETS["default"]
    with console.progress("training on one congested map", config.rounds, config.round_steps, "steps") as advance:
        shown = demonstrate(out, seed, lambda _, minutes: advance(f"greedy walk {minutes.mean():.0f} min"))
    results = shown.comparison.as_json()
    if as_json:
        print(json.dumps(results, indent=2))
        return
    console.show_results(results)
    print(f"Map and routes: {shown.picture}")


@app.command
def reproduce(
    *,
    maps: Annotated[int, Whole(help="Maps in each condition.")] = 100,
    quick: Annotated[bool, Parameter(negative=(), help="A small run of everything: 2 maps, 5 walks.")] = False,
    out: Out = Path("reproduction"),
    seed: Seed = 0,
    rule: Annotated[Literal["integrated", "entry"], Parameter(help="How crossing times are counted.")] = "integrated",
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Reproduce the paper's figures and numbers, and say which of its claims hold."""
    _at_least("seed", seed, 0)
    _at_least("maps", maps, 1)
    threads = _threads(workers)
    _start_jax()
    from sidestep.experiments.paper import QUICK, Plan
    from sidestep.experiments.paper import reproduce as run
    from sidestep.files import output_folder

    output_folder(out)
    plan = replace(QUICK, seed=seed) if quick else Plan(maps=maps, seed=seed)
    began = perf_counter()
    with console.progress("reproducing", plan.total, 1, "maps") as advance:
        results = run(plan, out, threads, lambda condition: advance(condition.replace("_", ", ")), rule)
    if as_json:
        print(json.dumps(results, indent=2))
        return
    for key, compared in results.items():
        if key not in ("claims", "curves"):
            print(f"\n{key.replace('_', ', ')}")
            console.show_results(compared)  # type: ignore[arg-type]
    for claim in results["claims"]:  # type: ignore[attr-defined]
        print(f"\n{claim['verdict'].upper():7} {claim['paper']}\n        {claim['ours']}\n        {claim['why']}")
    print(f"\n{perf_counter() - began:.0f} s; report: {out / 'report.html'}, numbers: {out / 'results.json'}")


@app.command
def train(
    scenario: Annotated[str, Parameter(help="Name of a scenario, such as paper-congested.")],
    /,
    *,
    preset: Preset = "default",
    index: Annotated[int, Whole(name="--map", help="Number of the map.")] = 0,
    rounds: Annotated[int | None, Whole(help="Rounds of training.")] = None,
    gamma: Annotated[float | None, Parameter(help="Discount factor.")] = None,
    alpha: Annotated[float | None, Parameter(help="Prioritisation of the replay; 0 is uniform.")] = None,
    double: Annotated[bool | None, Parameter(help="Double Q-learning.")] = None,
    flows: FlowsOption = None,
    rule: RuleOption = None,
    law: LawOption = None,
    side: Side = None,
    crowded_nodes: Crowded = None,
    out: Annotated[Path | None, Parameter(help="Folder for the model, saved every few seconds.")] = None,
    resume: Annotated[bool, Parameter(negative=(), help="Go on with the model in --out.")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Train an agent on one map of a scenario."""
    _at_least("seed", seed, 0)
    _at_least("map", index, 0)
    if resume and out is None:
        raise SidestepError("--resume needs --out, the folder of the model to go on with")
    _start_jax()
    from sidestep.agent import checkpoint
    from sidestep.agent.config import PRESETS, changed
    from sidestep.agent.train import train as rounds_of
    from sidestep.files import output_folder
    from sidestep.scenarios import draw_map

    problem = _scenario(scenario, flows=flows, rule=rule, law=law, side=side, crowded_nodes=crowded_nodes)
    config = changed(PRESETS[preset], rounds=rounds, gamma=gamma, alpha=alpha, double=double)
    state, curve = None, []
    if resume and out is not None:
        run = checkpoint.load(out)
        if (run.scenario, run.seed, run.index, run.config) != (problem, seed, index, config):
            raise SidestepError(
                f"the model in {out} is of another scenario, map, seed or configuration; it cannot go on"
            )
        state, curve = run.state, list(run.curve)
    if out is not None:
        output_folder(out)
    began, before, saved = perf_counter(), len(curve), -math.inf
    with console.progress(
        f"training on {scenario}, map {index}", config.rounds - before, config.round_steps, "steps"
    ) as advance:
        for now, report in rounds_of(config, problem, draw_map(problem, seed, index), state):
            curve.append(tuple(report.test_minutes.tolist()))
            run = checkpoint.TrainingRun(problem, seed, index, config, tuple(curve), now)
            if out is not None and (len(curve) == config.rounds or perf_counter() - saved > SAVE_EVERY):
                checkpoint.save(run, out)
                saved = perf_counter()
            advance(f"greedy walk {report.test_minutes.mean():.0f} min")
    seconds = perf_counter() - began
    if len(curve) == before:
        raise SidestepError(f"the model in {out} has been trained to the end, {before} rounds")
    summary = {
        "scenario": asdict(problem),
        "seed": seed,
        "map": index,
        "config": asdict(config),
        "seconds": seconds,
        "steps_per_second": (len(curve) - before) * config.round_steps / seconds,
        "curve_minutes": [sum(walks) / len(walks) for walks in curve],
        "best_minutes": float(run.state.best_minutes),
        "model": None if out is None else str(out),
    }
    if as_json:
        print(json.dumps(summary, indent=2))
        return
    means = summary["curve_minutes"]
    print(f"{scenario}, map {index}: {len(curve)} rounds of {config.round_steps:,} steps in {seconds:.1f} s")
    print(f"greedy test walks: {means[0]:.1f} min after the first round, {means[-1]:.1f} after the last, ", end="")  # type: ignore[index]
    print(f"{summary['best_minutes']:.1f} at best" + ("" if out is None else f"; model: {out}"))


@app.command
def compare(
    scenario: Annotated[str, Parameter(help="Name of a scenario, such as paper-congested.")],
    /,
    *,
    planners: Annotated[str | None, Parameter(help="Planners with commas between; by default all of them.")] = None,
    maps: Annotated[int, Whole(help="Number of maps.")] = 10,
    walks: Annotated[int, Whole(help="Walks on each map.")] = 20,
    preset: Preset = "default",
    model: Annotated[Path | None, Parameter(help="Folder of a trained model: compare on its map only.")] = None,
    flows: FlowsOption = None,
    rule: RuleOption = None,
    law: LawOption = None,
    side: Side = None,
    crowded_nodes: Crowded = None,
    seed: Seed = 0,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Walk the same maps through the same crowds with every planner."""
    _at_least("seed", seed, 0)
    _at_least("maps", maps, 1)
    _at_least("walks", walks, 1)
    threads = _threads(workers)
    _start_jax()
    from sidestep.agent import checkpoint
    from sidestep.agent.config import PRESETS
    from sidestep.evaluation.compare import BASELINES, choose
    from sidestep.evaluation.compare import compare as run
    from sidestep.planners.darp import Darp, train_darp, trained_darp

    problem = _scenario(scenario, flows=flows, rule=rule, law=law, side=side, crowded_nodes=crowded_nodes)
    if model is None:
        numbers = list(range(maps))
        every = {**BASELINES, Darp.name: lambda place, _: train_darp(PRESETS[preset], problem, place)}
    else:
        trained = checkpoint.load(model)
        if trained.scenario != problem or trained.seed != seed:
            raise SidestepError(
                f"the model in {model} was trained on {trained.scenario.name} with seed {trained.seed} and its own "
                f"settings; this is {problem.name} with seed {seed}, or other settings"
            )
        numbers = [trained.index]
        every = {**BASELINES, Darp.name: lambda *_: trained_darp(trained)}
    names = list(every) if planners is None else [name.strip() for name in planners.split(",")]
    chosen = choose(names, every)
    with console.progress("comparing", len(numbers), 1, "maps") as advance:
        compared = run(
            problem,
            chosen,
            maps=numbers,
            walks=walks,
            seed=seed,
            workers=threads,
            on_map=lambda index, _: advance(f"map {index}"),
        )
    if as_json:
        print(json.dumps(compared.as_json(), indent=2))
    else:
        console.show_results(compared.as_json())


@app.command
def counts(
    file: Annotated[
        Path | None, Parameter(help="Hourly counts as CSV (time, then a column a sensor); by default Auckland's.")
    ] = None,
    /,
    *,
    sensor: Annotated[
        str | None, Parameter(help="Sensor to model; by default the one that the scenarios use, or the first.")
    ] = None,
    p: Annotated[int, Whole(help="Autoregressive order.")] = 1,
    d: Annotated[int | None, Whole(help="Differences; by default the data choose.")] = None,
    q: Annotated[int, Whole(help="Moving-average order.")] = 0,
    seed: Annotated[int, Whole(help="Seed of the simulated week that is set beside the counts.")] = 0,
    as_json: Json = False,
) -> None:
    """Show what was loaded, what was repaired, the fitted model, and how well it predicts the next hour."""
    _at_least("seed", seed, 0)
    _start_jax()
    from sidestep.flow.summary import summarise_counts

    summary = summarise_counts(file, sensor, (p, d, q), seed)
    if as_json:
        print(json.dumps(asdict(summary), indent=2))
        return
    console.show_counts(summary, seed)


def main() -> None:
    """Run the command line: 2 on bad input, 130 on Ctrl-C, one sentence for each."""
    try:
        app(exit_on_error=False, print_error=False)
    except CycloptsError as error:
        _leave(BAD_INPUT, " ".join(str(error).split()))
    except SidestepError as error:
        _leave(BAD_INPUT, str(error))
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except KeyboardInterrupt:
        _leave(INTERRUPTED, "stopped; what had been saved is kept")


def _leave(status: int, sentence: str) -> NoReturn:
    print(f"sidestep: {sentence}", file=sys.stderr, flush=True)
    sys.stdout.flush()
    # Threads may be in the middle of a map: they must not be waited for. Files are whole or not there.
    os._exit(status)


def _start_jax() -> None:
    """Keep compiled programs between runs: compiling takes longer than training."""
    import jax

    settings: dict[str, object] = {
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        settings["jax_compilation_cache_dir"] = str(Path(home) / "sidestep" / "jax")
    for name, value in settings.items():
        jax.config.update(name, value)  # type: ignore[no-untyped-call]


def _scenario(name: str, **changes: object) -> "Scenario":
    from sidestep.scenarios import scenario

    return scenario(name, **{field: value for field, value in changes.items() if value is not None})


def _at_least(name: str, value: int, least: int) -> None:
    if value < least:
        raise SidestepError(f"--{name} must be at least {least}, not {value}")


def _threads(workers: int | None) -> int:
    if workers is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    _at_least("workers", workers, 1)
    return workers
