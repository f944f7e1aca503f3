"""The commands `demo`, `reproduce` and `trade-off`: one for each published result."""

import json
import math
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from sidestep.cli import options
from sidestep.cli.compare import show_results
from sidestep.cli.console import new_table, print_table, progress
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from sidestep.experiments.trade_off import TradeOff


def demo(*, out: options.Out = Path("demo"), seed: options.Seed = 0, as_json: options.Json = False) -> None:
    """Train an agent on one congested map, compare it with other planners, and draw their paths."""
    options.at_least("seed", seed, 0)
    options.start_jax()
    from sidestep.experiments.demo import CONFIG, demonstrate
    from sidestep.files import output_folder

    picture = output_folder(out) / "map.png"
    with progress("training on one congested map", CONFIG.rounds, CONFIG.round_steps, "steps") as advance:
        compared = demonstrate(picture, seed, lambda run: advance(f"greedy walk {run.test_minutes.mean():.0f} min"))
    results = compared.to_json()
    if as_json:
        print(json.dumps(results, indent=2))
        return
    show_results(results)
    print(f"Map and routes: {picture}")


def reproduce(
    *,
    maps: Annotated[int, options.Whole(help="Number of maps in each condition.")] = 100,
    quick: Annotated[bool, Parameter(negative=(), help="Run everything in small: 2 maps, 5 walks.")] = False,
    out: options.Out = Path("reproduction"),
    seed: options.Seed = 0,
    rule: Annotated[
        Literal["integrated", "entry"],
        Parameter(help="Integrate crossing times over all slots, or keep the density at entry (the paper)."),
    ] = "integrated",
    workers: options.Workers = None,
    as_json: options.Json = False,
) -> None:
    """Reproduce the paper's figures and numbers, and judge its claims."""
    options.at_least("seed", seed, 0)
    options.at_least("maps", maps, 1)
    threads = options.thread_count(workers)
    options.start_jax()
    from sidestep.experiments.paper import QUICK, Plan
    from sidestep.experiments.paper import reproduce as run
    from sidestep.files import output_folder

    output_folder(out)
    plan = replace(QUICK, seed=seed) if quick else Plan(maps=maps, seed=seed)
    began = perf_counter()
    with progress("reproducing", plan.total, 1, "maps") as advance:
        results = run(plan, out, threads, lambda condition: advance(condition.replace("_", ", ")), rule)
    if as_json:
        print(json.dumps(results.to_json(), indent=2))
        return
    for key, compared in results.compared.items():
        print(f"\n{key.replace('_', ', ')}")
        show_results(compared)
    for claim in results.claims:
        print(f"\n{claim.verdict.upper():7} {claim.paper}\n        {claim.ours}\n        {claim.why}")
    print(f"\n{perf_counter() - began:.0f} s; report: {out / 'report.html'}, numbers: {out / 'results.json'}")


def trade_off(
    scenario: options.ScenarioOption,
    /,
    *,
    planners: Annotated[
        str, Parameter(help="Planners that need no training, separated by commas; each gets a curve.")
    ] = "expected,clairvoyant",
    weights: Annotated[
        str, Parameter(help="Weights of exposure in seconds for each person·s/m², separated by commas.")
    ] = "0,0.1,0.2,0.5,1,2,5,10",
    walks: Annotated[int, options.Whole(help="Number of walks for each weight.")] = 20,
    changes: options.Changes = options.UNCHANGED,
    out: Annotated[Path, Parameter(help="File for the picture (.png).")] = Path("trade-off.png"),
    seed: options.Seed = 0,
    as_json: options.Json = False,
) -> None:
    """Take the same walks with more and more weight on the crowd met, and draw time against crowds.

    All walks are on map 0. The weights replace the exposure of --objective.
    """
    options.at_least("seed", seed, 0)
    options.at_least("walks", walks, 1)
    if out.suffix.lower() != ".png" or out.is_dir():
        raise SidestepError(f"--out must be a picture's file, such as trade-off.png, not {out}", field="out")
    steps = [_weight(weight) for weight in weights.split(",")]
    options.start_jax()
    from sidestep.experiments.trade_off import trade_off as run
    from sidestep.files import output_folder
    from sidestep.plotting import save, trade_off_curve

    problem = options.read_scenario(scenario, changes)
    output_folder(out.parent)
    with progress("weighing", len(steps), 1, "weights") as advance:
        found = run(
            problem,
            planners=options.names_in(planners) or (),
            weights=steps,
            walks=walks,
            seed=seed,
            on_weight=lambda weight: advance(f"weight {weight:g}"),
        )
    save(trade_off_curve(found.title, found.caption, found.curves), out)
    if as_json:
        print(json.dumps({**found.to_json(), "picture": str(out)}, indent=2, ensure_ascii=False))
        return
    show_trade_off(found)
    print(f"Picture: {out}")


def _weight(text: str) -> float:
    try:
        weight = float(text)
    except ValueError:
        weight = math.nan
    if not math.isfinite(weight):
        raise SidestepError(f"--weights must be numbers separated by commas, not {text.strip()!r:.40}", field="weights")
    return weight


def show_trade_off(found: "TradeOff") -> None:
    """Print a trade-off between time and exposure as a table."""
    scenario = found.scenario
    head = f"{scenario.name}, map 0, seed {found.seed}: {found.walks} walks for each weight of exposure"
    columns = ("planner", ">weight", ">minutes", ">person·s/m² met", ">metres", ">arrive")
    table = new_table(*columns, title="\n".join(filter(None, (head, scenario.summary, scenario.place.synthetic))))
    rows = [(name, point) for name, points in found.curves.items() for point in points]
    for name, point in (("shortest-path", found.shortest_path), *rows):
        table.add_row(
            name,
            "" if point["weight"] is None else f"{point['weight']:g}",
            f"{point['minutes']:.2f}",
            f"{point['exposure']:,.0f}",
            f"{point['metres']:,.0f}",
            f"{point['arrival_rate']:.1%}",
        )
    print_table(table)
