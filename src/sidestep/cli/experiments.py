"""The commands `demo`, `reproduce` and `trade-off`: one for each published result."""

import json
import math
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from sidestep.cli.compare import show_results
from sidestep.cli.console import new_table, print_table, progress
from sidestep.cli.options import (
    UNCHANGED,
    Changes,
    Json,
    Out,
    ScenarioOption,
    Seed,
    Whole,
    Workers,
    at_least,
    read_scenario,
    start_jax,
    thread_count,
)
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from sidestep.experiments.trade_off import TradeOffJson


def demo(*, out: Out = Path("demo"), seed: Seed = 0, as_json: Json = False) -> None:
    """Train on one congested map, compare all planners there, and draw where they walk."""
    at_least("seed", seed, 0)
    start_jax()
    from sidestep.agent.presets import PRESETS
    from sidestep.experiments.demo import demonstrate
    from sidestep.files import output_folder

    output_folder(out)
    config = PRESETS["default"]
    with progress("training on one congested map", config.rounds, config.round_steps, "steps") as advance:
        shown = demonstrate(out, seed, lambda run: advance(f"greedy walk {run.test_minutes.mean():.0f} min"))
    results = shown.comparison.as_json()
    if as_json:
        print(json.dumps(results, indent=2))
        return
    show_results(results)
    print(f"Map and routes: {shown.picture}")


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
    at_least("seed", seed, 0)
    at_least("maps", maps, 1)
    threads = thread_count(workers)
    start_jax()
    from sidestep.experiments.paper import QUICK, Plan
    from sidestep.experiments.paper import reproduce as run
    from sidestep.files import output_folder

    output_folder(out)
    plan = replace(QUICK, seed=seed) if quick else Plan(maps=maps, seed=seed)
    began = perf_counter()
    with progress("reproducing", plan.total, 1, "maps") as advance:
        results = run(plan, out, threads, lambda condition: advance(condition.replace("_", ", ")), rule)
    if as_json:
        print(json.dumps(results, indent=2))
        return
    for key, compared in results.items():
        if key not in ("claims", "curves"):
            print(f"\n{key.replace('_', ', ')}")
            show_results(compared)  # type: ignore[arg-type]
    for claim in results["claims"]:  # type: ignore[attr-defined]
        print(f"\n{claim['verdict'].upper():7} {claim['paper']}\n        {claim['ours']}\n        {claim['why']}")
    print(f"\n{perf_counter() - began:.0f} s; report: {out / 'report.html'}, numbers: {out / 'results.json'}")


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
    at_least("seed", seed, 0)
    at_least("walks", walks, 1)
    if out.suffix.lower() != ".png" or out.is_dir():
        raise SidestepError(f"--out must be a file for a picture, such as trade-off.png, not {out}")
    steps = [_weight(weight) for weight in weights.split(",")]
    start_jax()
    from sidestep.experiments.trade_off import trade_off as run
    from sidestep.files import output_folder
    from sidestep.plotting import save, trade_off_curve

    problem = read_scenario(scenario, changes)
    output_folder(out.parent)
    with progress("weighing", len(steps), 1, "weights") as advance:
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
    show_trade_off(found.as_json())
    print(f"Picture: {out}")


def _weight(text: str) -> float:
    try:
        weight = float(text)
    except ValueError:
        weight = math.nan
    if not math.isfinite(weight):
        raise SidestepError(f"--weights must be numbers with commas between, not {text.strip()!r:.40}")
    return weight


def show_trade_off(found: "TradeOffJson") -> None:
    """Print a trade-off between time and exposure as a table."""
    title = f"{found['scenario']}, map 0: {found['walks']} walks for each weight of exposure, seed {found['seed']}"
    columns = ("planner", ">weight", ">minutes", ">person·s/m² met", ">metres", ">arrive")
    table = new_table(*columns, title=f"{title}\n{found['summary']}" if found["summary"] else title)
    rows = [(name, point) for name, points in found["curves"].items() for point in points]
    for name, point in (("shortest-path", found["shortest_path"]), *rows):
        table.add_row(
            name,
            "" if point["weight"] is None else f"{point['weight']:g}",
            f"{point['minutes']:.2f}",
            f"{point['exposure']:,.0f}",
            f"{point['metres']:,.0f}",
            f"{point['arrival_rate']:.1%}",
        )
    print_table(table)
