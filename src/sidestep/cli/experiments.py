"""The commands `demo`, `reproduce` and `trade-off`: one for each published result."""

import json
import math
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from sidestep.cli import options
from sidestep.cli.compare import show_results
from sidestep.cli.console import print_table, print_text, progress
from sidestep.cli.sweep import sweeping
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from sidestep.agent.runs import TrainingRun
    from sidestep.experiments.trade_off import TradeOff


def demo(*, out: options.Out = Path("demo"), seed: options.Seed = 0, as_json: options.Json = False) -> None:
    """Train an agent on one congested map, compare it with other planners, and draw their paths."""
    options.check_least(seed=seed)
    options.start_jax()
    from sidestep.experiments.demo import CONFIG, demonstrate
    from sidestep.files import output_folder

    picture = output_folder(out) / "map.png"
    with progress("training", CONFIG.rounds * CONFIG.round_steps, "steps") as advance:

        def on_round(run: "TrainingRun") -> None:
            advance(f"greedy walk {run.test_minutes.mean():.0f} min", CONFIG.round_steps)

        compared = demonstrate(picture, seed, on_round)
    results = compared.to_json()
    if as_json:
        print(json.dumps(results, indent=2))
        return
    show_results(results)
    print(f"Map and routes: {picture}")


def reproduce(
    *,
    maps: options.Whole | None = None,
    quick: options.Flag = False,
    out: options.Out = Path("reproduction"),
    results_out: options.ResultsOut = None,
    seed: options.Seed = 0,
    rule: options.Rule = "integrated",
    workers: options.Processes = None,
    scheduler: options.Scheduler = None,
    as_json: options.Json = False,
) -> None:
    """Reproduce the paper's figures and numbers, and judge its claims; once stopped, the same command goes on.

    Parameters
    ----------
    maps
        Number of maps in each condition; 100 by default, 2 with --quick.
    quick
        Run everything in small, with 5 walks on each map; 2 maps are too few to judge the claims.
    """
    options.check_least(seed=seed, maps=maps, workers=workers)
    from sidestep.experiments.paper import QUICK, Plan
    from sidestep.experiments.paper import reproduce as run

    if results_out is not None:
        from sidestep.evaluation.tables import check_table_file

        check_table_file(results_out, "results_out")
    plan, began = replace(QUICK if quick else Plan(), seed=seed), perf_counter()
    if maps is not None:
        plan = replace(plan, maps=maps)
    with sweeping(workers, scheduler) as (processes, on_jobs):
        results = run(plan, out, processes, on_jobs, rule, scheduler)
    if results_out is not None:
        from sidestep.evaluation.tables import results_table, save_tables

        save_tables([results_table([*results.compared.values()])], results_out, "results_out")
    if as_json:
        print(json.dumps(results.to_json(), indent=2))
        return
    for key, compared in results.compared.items():
        print(f"\n{key.replace('_', ', ')}")
        show_results(compared)
    for claim in results.claims:
        print_text(f"\n{claim.verdict.upper()}: {claim.paper}\n  {claim.ours}\n  {claim.why}")
    print(f"\n{perf_counter() - began:.0f} s; report: {out / 'report.html'}, numbers: {out / 'results.json'}")
    if results_out is not None:
        print(f"Results: {results_out}")


def trade_off(
    scenario: options.ScenarioOption,
    /,
    *,
    planners: str = "expected,clairvoyant",
    weights: str = "0,0.1,0.2,0.5,1,2,5,10",
    walks: options.Whole = 20,
    changes: options.Changes = options.UNCHANGED,
    out: Path = Path("trade-off.png"),
    seed: options.Seed = 0,
    as_json: options.Json = False,
) -> None:
    """Take the same walks with more and more weight on the crowd met, and draw time against crowds.

    All walks are on map 0. The weights replace the exposure of --objective.

    Parameters
    ----------
    planners
        Planners that need no training, separated by commas; each gets a curve.
    weights
        Weights of exposure in seconds for each person·s/m², separated by commas.
    walks
        Number of walks for each weight.
    out
        File for the picture (.png).

    Raises
    ------
    SidestepError
        A file that is no picture's (field ``out``), weights that are no numbers, and all that the walks refuse.
    """
    options.check_least(seed=seed, walks=walks)
    if out.suffix.lower() != ".png" or out.is_dir():
        raise SidestepError(f"--out must be a picture's file, such as trade-off.png, not {out}", field="out")
    steps = [_weight(weight) for weight in weights.split(",")]
    options.start_jax()
    from sidestep.experiments.trade_off import trade_off as run
    from sidestep.files import check_apart, output_folder
    from sidestep.plotting import save, trade_off_curve
    from sidestep.scenarios.reader import files_of

    problem, names = options.read_scenario(scenario, changes), options.names_in(planners)
    check_apart(out, files_of(scenario, problem))
    output_folder(out.parent)
    with progress("weighing", len(steps), "weights") as advance:
        found = run(
            problem,
            planners=names,
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
    from sidestep.evaluation.metrics import percent

    scenario = found.scenario
    head = f"{scenario.name}, map 0, seed {found.seed}: {found.walks} walks for each weight of exposure"
    rows = [(name, point) for name, points in found.curves.items() for point in points]
    print_table(
        (head, scenario.summary, scenario.place.synthetic, scenario.walker.remark),
        ("planner", ">weight", ">minutes", ">person·s/m² met", ">metres", ">arrive"),
        [
            (
                name,
                "" if point["weight"] is None else f"{point['weight']:g}",
                f"{point['minutes']:.2f}",
                f"{point['exposure']:,.0f}",
                f"{point['metres']:,.0f}",
                percent(point["arrival_rate"]),
            )
            for name, point in (("shortest-path", found.shortest_path), *rows)
        ],
        ("metres", "arrive"),
    )
