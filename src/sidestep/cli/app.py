"""The command line: parses, calls, prints. Heavy modules are imported by the commands that need them."""

import json
import math
import os
import sys
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass, replace
from functools import partial
from io import StringIO
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Literal, NoReturn

from cyclopts import App, CycloptsError, Parameter

from sidestep import __version__
from sidestep.cli import console
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cyclopts import Token

    from sidestep.network.osm import ImportReport
    from sidestep.planners.base import Planner
    from sidestep.routing.plan import Journey
    from sidestep.scenarios.maps import ScenarioMap
    from sidestep.scenarios.model import Scenario
    from sidestep.scenarios.tables import TableReport

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
Hyphened = partial(Parameter, allow_leading_hyphen=True)  # southern latitudes

Seed = Annotated[int, Whole(help="Seed of maps, crowds and training.")]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print JSON instead of tables.")]
Out = Annotated[Path, Parameter(help="Folder for what is written; made if it is not there.")]
Workers = Annotated[int | None, Whole(help="Maps at a time; by default one for each processor.")]
PresetOption = Annotated[
    Literal["default", "paper", "dqn", "tabular-q"],
    Parameter(
        name="--preset",
        help="How the agent learns: our way, the paper's settings as printed, or as a baseline (no dueling, double or "
        "priorities; a table).",
    ),
]
LevelOption = Annotated[
    Literal["position", "local", "map", "live"] | None,
    Parameter(name="--level", help="What the agent sees; by default what the scenario says."),
]
Models = Annotated[
    list[Path] | None,
    Parameter(name="--model", negative=(), help="Folder of a trained model; may be given several times."),
]
By = Annotated[float | None, Parameter(name="--by", help="Minutes: how likely is it to arrive within them?")]
ScenarioOption = Annotated[str, Parameter(help="Name of a scenario, such as rush-16, or a scenario file.")]


@Parameter(name="*")
@dataclass(frozen=True)
class Changes:
    """What may be changed of a scenario; None leaves it as it is."""

    flows: Annotated[
        Literal["arima", "forecast"] | None,
        Parameter(name="--flows", help="Crowds with the model's noise, or its forecast."),
    ] = None
    rule: Annotated[
        Literal["integrated", "entry"] | None,
        Parameter(name="--rule", help="Crossing times through all slots, or by the density at entry (the paper)."),
    ] = None
    law: Annotated[
        Literal["power", "power-capped", "weidmann"] | None, Parameter(name="--law", help="Walking speed by density.")
    ] = None
    side: Annotated[int | None, Whole(name="--side", help="Nodes along one side of the grid.")] = None
    crowded_nodes: Annotated[
        int | None, Whole(name="--crowded-nodes", help="Nodes whose streets begin crowded, on grids.")
    ] = None
    crowding: Annotated[
        float | None,
        Parameter(
            name="--crowding", help="Demand over that which was counted, instead of the scenario's; real places."
        ),
    ] = None
    objective: Annotated[
        str | None,
        Parameter(
            name="--objective",
            help="What walkers keep low: time, distance, exposure, or weights, such as exposure=0.5,max_density=4.",
        ),
    ] = None


UNCHANGED = Changes()


@app.command
def demo(*, out: Out = Path("demo"), seed: Seed = 0, as_json: Json = False) -> None:
    """Train on one congested map, compare all planners there, and draw where they walk."""
    _at_least("seed", seed, 0)
    _start_jax()
    from sidestep.agent.presets import PRESETS
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
    _at_least("seed", seed, 0)
    _at_least("map", index, 0)
    if resume and out is None:
        raise SidestepError("--resume needs --out, the folder of the model to go on with")
    _start_jax()
    from sidestep.agent import checkpoint
    from sidestep.agent.config import changed
    from sidestep.agent.presets import preset_for
    from sidestep.agent.train import learned_place
    from sidestep.agent.train import train as rounds_of
    from sidestep.files import output_folder
    from sidestep.scenarios.maps import draw_training_map, fingerprint

    problem = _scenario(scenario, changes)
    config = changed(
        preset_for(problem, preset, level),
        rounds=rounds, goals=destinations, gamma=gamma, n_step=n_step, alpha=alpha, double=double, dueling=dueling,
        potential=potential,
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
    with console.progress(
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


@app.command
def compare(
    scenario: ScenarioOption,
    /,
    *,
    planners: Annotated[
        str | None, Parameter(help="Planners with commas between; by default all but baselines that learn.")
    ] = None,
    maps: Annotated[int | None, Whole(help="Number of maps; by default what the scenario says.")] = None,
    walks: Annotated[int | None, Whole(help="Walks on each map; by default what the scenario says.")] = None,
    level: LevelOption = None,
    preset: PresetOption = "default",
    model: Models = None,
    destinations: Annotated[
        int | None,
        Whole(
            help="Walk to so many destinations: on grids from anywhere, not from corner to corner; in real places to "
            "some of their own, or of all crossings, not to all."
        ),
    ] = None,
    by: By = None,
    against: Annotated[str, Parameter(help="Whom the others' minutes are set against, walk by walk.")] = "expected",
    changes: Changes = UNCHANGED,
    seed: Seed = 0,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Walk the same maps through the same crowds with every planner."""
    _at_least("seed", seed, 0)
    _minutes(by)
    threads = _threads(workers)
    _start_jax()
    from sidestep.evaluation.compare import compare as run
    from sidestep.planners.learned import load_planners, trainable
    from sidestep.planners.registry import BASELINES, REPLANNING, choose
    from sidestep.scenarios.maps import draw_map

    problem = _scenario(scenario, changes)
    numbers = list(range(_at_least("maps", problem.maps if maps is None else maps, 1)))
    count = _at_least("walks", problem.walks if walks is None else walks, 1)
    if model:
        learned = load_planners(model, problem, seed, level)
        if learned.index is not None:
            if maps is not None:
                raise SidestepError(f"--maps cannot be chosen: the model remembers map {learned.index} alone")
            numbers = [learned.index]
        learned.check_destinations(draw_map(problem, seed, numbers[0]), destinations or 1)
        every = {**BASELINES, **REPLANNING, **learned.factories}
        names = list(every)
    else:
        every = {
            **BASELINES,
            **REPLANNING,
            **trainable(problem, seed, level or problem.level, preset, destinations or 1),
        }
        names = [*BASELINES, *REPLANNING, "darp"]
    if planners is not None:
        names = [name.strip() for name in planners.split(",")]
    chosen = choose([*names, against], every)
    with console.progress("comparing", len(numbers), 1, "maps") as advance:
        compared = run(
            problem,
            chosen,
            maps=numbers,
            walks=count,
            seed=seed,
            workers=threads,
            destinations=destinations,
            on_map=lambda index, _: advance(f"map {index}"),
        )
    if as_json:
        print(json.dumps(compared.as_json(by, against), indent=2))
    else:
        console.show_results(compared.as_json(by, against))


@app.command
def route(
    scenario: ScenarioOption,
    /,
    *,
    origin: Annotated[
        str | None,
        Hyphened(name="--from", help="Node, or in towns LAT,LON; by default the scenario's first node."),
    ] = None,
    destination: Annotated[
        str | None, Hyphened(name="--to", help="Node, or in towns LAT,LON; by default the scenario's last node.")
    ] = None,
    depart: Annotated[
        str | None,
        Hyphened(help="Minutes after the scenario's start; in towns local time, such as 2025-05-24T12:30."),
    ] = None,
    planner: Annotated[str | None, Parameter(help="Who plans; by default expected, or darp with --model.")] = None,
    model: Annotated[Path | None, Parameter(help="Folder of a trained model, for the planner darp.")] = None,
    by: By = None,
    futures: Annotated[
        int | None,
        Whole(
            help="Simulated futures; by default 200, in towns 20 for planners that see all counts, 1 without chance."
        ),
    ] = None,
    live: Annotated[Path | None, Parameter(help="In towns: current counts, hourly, as CSV.")] = None,
    output: Annotated[
        Literal["text", "geojson", "gpx", "png"],
        Parameter(name="--format", help="What is printed, or written to --out."),
    ] = "text",
    out: Annotated[Path | None, Parameter(help="File to write to instead of printing.")] = None,
    index: Annotated[int, Whole(name="--map", help="Number of the map.")] = 0,
    changes: Changes = UNCHANGED,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Plan one walk, and say how long it may take."""
    _at_least("seed", seed, 0)
    _at_least("map", index, 0)
    if futures is not None:
        _at_least("futures", futures, 1)
    _minutes(by)
    if output == "png" and out is None:
        raise SidestepError("--format png needs --out, the file for the picture")
    if as_json and output != "text":
        raise SidestepError(f"--json and --format {output} cannot go together")
    _start_jax()
    from sidestep.crowds.counts import read_counts
    from sidestep.files import output_folder
    from sidestep.routing.grid_plan import foresee
    from sidestep.routing.plan import travel
    from sidestep.routing.request import prepare, read_departure, read_minutes, read_node, read_place
    from sidestep.scenarios.maps import draw_map, knows_time

    problem = _scenario(scenario, changes)
    place = draw_map(problem, seed, index)
    last = str(place.network.nodes - 1)
    if problem.venue is None:
        if output != "text" or live is not None:
            what = "--live" if live is not None else f"--format {output}"
            raise SidestepError(f"{what} needs a scenario with real streets, such as helsinki; {scenario} is a grid")
        ends = read_node("--from", origin or "0"), read_node("--to", destination or last)
        departure = 60 * read_minutes(depart or "0")
        who = _planner(planner, model, problem, place, seed, index, ends[1])
        if out is not None:
            output_folder(out.parent)
        found = foresee(
            problem, place, who, origin=ends[0], destination=ends[1], departure=departure, futures=futures or 200
        ).as_json(by)
        _hand_over(out, lambda: print(json.dumps(found, indent=2)) if as_json else console.show_walk(found))
        return
    trip = prepare(
        problem,
        place,
        read_place("--from", origin or "0"),
        read_place("--to", destination or last),
        read_departure(depart, problem.venue, timed=knows_time(place.flow)),
        None if live is None else read_counts(live),
    )
    who = _planner(planner, model, problem, place, seed, index, trip.destination.node, splits=trip.splits)
    if out is not None:
        output_folder(out.parent)
    _hand_over_journey(travel(trip, who, futures), "json" if as_json else output, out, by)


def _planner(
    name: str | None,
    model: Path | None,
    problem: "Scenario",
    place: "ScenarioMap",
    seed: int,
    index: int,
    end: int,
    *,
    splits: bool = False,
) -> "Planner":
    """Who plans a walk to the node ``end``; ``splits`` says that it begins or ends where no node was before."""
    from sidestep.planners.learned import load_planners
    from sidestep.planners.registry import BASELINES, REPLANNING, PlannerError

    every = {**BASELINES, **REPLANNING}
    if model is not None:
        learned = load_planners([model], problem, seed)
        if learned.index not in (None, index):
            raise SidestepError(f"the model in {model} remembers map {learned.index}, not {index}")
        if learned.index is not None and splits:
            raise SidestepError(f"the model in {model} remembers crossings; give --from and --to as nodes")
        learned.check_destination(end)
        every |= learned.factories
    name = name or ("expected" if model is None else "darp")
    if name not in every:
        hint = "; darp needs --model" if name == "darp" else ""
        raise PlannerError(f"unknown planner {name!r}; there are {', '.join(every)}{hint}")
    who = every[name](place, index)
    if who is None:
        raise PlannerError(f"{name} does not walk map {index}")
    return who


def _hand_over_journey(journey: "Journey", output: str, out: Path | None, by: float | None) -> None:
    """Print a planned walk through a town, or write it to a file."""
    from sidestep.routing.formats import route_geojson, route_gpx
    from sidestep.routing.serialise import itinerary

    if output == "png" and out is not None:
        from sidestep.plotting import route_map, save

        save(route_map(journey), out)
        return
    shown = {
        "json": lambda: print(json.dumps(itinerary(journey, by), indent=2, ensure_ascii=False)),
        "geojson": lambda: print(route_geojson(journey, by), end=""),
        "gpx": lambda: print(route_gpx(journey, by), end=""),
        "text": lambda: console.show_journey(itinerary(journey, by)),
    }
    _hand_over(out, shown[output])


def _hand_over(out: Path | None, show: "Callable[[], None]") -> None:
    """Print, or write what would be printed to a file, whole or not at all."""
    from sidestep.files import write_text

    if out is None:
        show()
        return
    with redirect_stdout(StringIO()) as text:
        show()
    write_text(out, text.getvalue())


@app.command(name="trade-off")
def trade_off(
    scenario: ScenarioOption,
    /,
    *,
    planners: Annotated[str, Parameter(help="Planners with commas between, a curve each.")] = "expected,clairvoyant",
    weights: Annotated[
        str, Parameter(help="Weights of exposure with commas between, in seconds for each person·s/m².")
    ] = "0,0.1,0.2,0.5,1,2,5,10",
    walks: Annotated[int, Whole(help="Walks for each weight.")] = 20,
    changes: Changes = UNCHANGED,
    out: Annotated[Path, Parameter(help="File for the picture, PNG.")] = Path("trade-off.png"),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Weigh the crowd that is met against time, more and more, and draw what each costs in terms of the other.

    Walks are those of map 0. What --objective says of exposure gives way to the weights.
    """
    _at_least("seed", seed, 0)
    _at_least("walks", walks, 1)
    if out.suffix.lower() != ".png" or out.is_dir():
        raise SidestepError(f"--out must be a file for a picture, such as trade-off.png, not {out}")
    steps = [_weight(weight) for weight in weights.split(",")]
    _start_jax()
    from sidestep.experiments.trade_off import trade_off as run
    from sidestep.files import output_folder
    from sidestep.plotting import save, trade_off_curve

    problem = _scenario(scenario, changes)
    output_folder(out.parent)
    with console.progress("weighing", len(steps), 1, "weights") as advance:
        found = run(
            problem,
            planners=[name.strip() for name in planners.split(",")],
            weights=steps,
            walks=walks,
            seed=seed,
            on_weight=lambda weight: advance(f"weight {weight:g}"),
        )
    save(trade_off_curve(found.title, found.caption, found.curves), out)
    if as_json:
        print(json.dumps({**found.as_json(), "picture": str(out)}, indent=2, ensure_ascii=False))
        return
    console.show_trade_off(found.as_json())
    print(f"Picture: {out}")


counts_app = App(name="counts", help="Counts and crowds: what a file holds, and what is made of it.")
app.command(counts_app)


@counts_app.default
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
    from sidestep.crowds.summary import summarise_counts

    summary = summarise_counts(file, sensor, (p, d, q), seed)
    if as_json:
        print(json.dumps(asdict(summary), indent=2))
        return
    console.show_counts(summary, seed)


@counts_app.command(name="import")
def import_counts(
    table: Annotated[Path, Parameter(help="Crowds by segment and slot: .csv or .parquet; see docs/counts.md.")],
    /,
    *,
    network: Annotated[str, Parameter(help="Streets that the table is about: a file, or helsinki.")],
    out: Annotated[Path, Parameter(help="File for the crowds, .npz; a venue's counts may name it.")],
    slot: Annotated[
        float | None, Parameter(help="Minutes of a slot, where the table numbers them; by default 5.")
    ] = None,
    law: Annotated[
        Literal["power", "power-capped", "weidmann"], Parameter(help="Density by speed, for what is printed.")
    ] = "weidmann",
    as_json: Json = False,
) -> None:
    """Turn a table of crowds into crowds on streets, and say what was filled in."""
    _minutes(slot, "slot")
    _start_jax()
    from sidestep.crowds.crowd_table import check_suffix, save_crowd_table
    from sidestep.files import output_folder
    from sidestep.scenarios.build import town_of
    from sidestep.scenarios.tables import import_table

    check_suffix(out)
    seconds = None if slot is None else 60 * slot
    crowds, report = import_table(table, town_of(network), slot_seconds=seconds, law=law)
    output_folder(out.parent)
    save_crowd_table(crowds, out)
    _report(report, console.show_table, f"Crowds: {out}", out, as_json=as_json)


@app.command(name="import-osm")
def import_osm(
    file: Annotated[Path, Parameter(help="OpenStreetMap extract: .osm, .osm.gz, .osm.bz2 or .osm.pbf.")],
    /,
    *,
    out: Annotated[
        Path, Parameter(help="File for the streets; its ending, .npz, .graphml or .geojson, is the format.")
    ],
    merge: Annotated[float, Parameter(help="Metres: crossings nearer than this along a street become one.")] = 8.0,
    width: Annotated[
        list[str] | None,
        Parameter(negative=(), help="KIND=METRES that walkers have where no tag says it; may be given several times."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Turn an OpenStreetMap extract into streets for walkers, and say what was kept and dropped."""
    from sidestep.files import output_folder
    from sidestep.network.formats import check_suffix, save_town
    from sidestep.network.osm import import_osm as read

    check_suffix(out)
    widths = dict(_width(option) for option in width or [])
    output_folder(out.parent)
    town, report = read(file, merge=merge, widths=widths)
    save_town(town, out)
    _report(report, console.show_import, f"Streets: {out} ({town.attribution})", out, as_json=as_json)


def _report(
    report: "ImportReport | TableReport", show: "Callable[..., None]", made: str, out: Path, *, as_json: bool
) -> None:
    """Say what an import found, and which file it ``made``."""
    if as_json:
        print(json.dumps({**asdict(report), "out": str(out)}, indent=2, ensure_ascii=False))
        return
    show(report)
    print(made)


@app.command
def new(
    name: Annotated[str, Parameter(help="Name of the scenario, and of the folder to make for it here.")],
    /,
    *,
    as_json: Json = False,
) -> None:
    """Write a commented scenario file to start from; it runs as it is."""
    from sidestep.scenarios.template import new_scenario

    file = new_scenario(Path(), name)
    if as_json:
        print(json.dumps({"scenario": str(file)}, indent=2))
        return
    print(f"{file}: try `sidestep compare {file} --walks 50 --planners shortest-path`, then make it yours")


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


def _scenario(name: str, changes: Changes) -> "Scenario":
    from sidestep.scenarios.reader import find_scenario

    return find_scenario(name, **{field: value for field, value in asdict(changes).items() if value is not None})


def _at_least(name: str, value: int, least: int) -> int:
    if value < least:
        raise SidestepError(f"--{name} must be at least {least}, not {value}")
    return value


def _width(option: str) -> tuple[str, float]:
    kind, _, metres = option.partition("=")
    try:
        return kind.strip(), float(metres)
    except ValueError as error:
        raise SidestepError(f"--width must be KIND=METRES, such as footway=2.5, not {option!r}") from error


def _weight(text: str) -> float:
    try:
        weight = float(text)
    except ValueError:
        weight = math.nan
    if not math.isfinite(weight):
        raise SidestepError(f"--weights must be numbers with commas between, not {text.strip()!r:.40}")
    return weight


def _minutes(by: float | None, option: str = "by") -> None:
    if by is not None and not (math.isfinite(by) and by > 0):
        raise SidestepError(f"--{option} must be a positive number of minutes, not {by}")


def _threads(workers: int | None) -> int:
    if workers is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    _at_least("workers", workers, 1)
    return workers
