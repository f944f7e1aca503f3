"""The command `compare`."""

import json
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from sidestep.cli import options
from sidestep.cli.console import new_table, print_table, progress

if TYPE_CHECKING:
    from sidestep.evaluation.compare import Results


def compare(
    scenario: options.ScenarioOption,
    /,
    *,
    planners: Annotated[
        str | None,
        Parameter(
            help="Planners, separated by commas: names (see sidestep planners) or MODULE:NAME; by default all that "
            "need no training, and darp. Models walk in any case."
        ),
    ] = None,
    maps: Annotated[int | None, options.Whole(help="Number of maps; by default the scenario's.")] = None,
    walks: Annotated[int | None, options.Whole(help="Walks on each map; by default the scenario's.")] = None,
    level: options.LevelOption = None,
    preset: options.PresetOption = "default",
    model: options.Models = None,
    destinations: Annotated[
        int | None,
        options.Whole(
            help="Number of destinations to walk to, from anywhere; by default walks go from corner to corner on "
            "grids, and to all destinations in real places."
        ),
    ] = None,
    by: options.By = None,
    against: Annotated[str, Parameter(help="Planner that the others' minutes are set against.")] = "expected",
    timing: Annotated[
        bool, Parameter(negative=(), help="Measure how long decisions take; planning is then done twice.")
    ] = False,
    changes: options.Changes = options.UNCHANGED,
    seed: options.Seed = 0,
    workers: options.Workers = None,
    as_json: options.Json = False,
) -> None:
    """Compare planners on the same maps and through the same crowds."""
    options.at_least("seed", seed, 0)
    options.check_minutes(by)
    for option, number in (("maps", maps), ("walks", walks)):
        options.at_least(option, 1 if number is None else number, 1)
    threads = options.thread_count(workers)
    options.start_jax()
    from sidestep.evaluation.compare import compare as run
    from sidestep.planners.registry import choose_planners

    problem = options.read_scenario(scenario, changes)
    chosen = choose_planners(
        problem,
        options.names_in(planners),
        models=model or (),
        against=against,
        seed=seed,
        level=level,
        preset=preset,
        destinations=destinations or 1,
    )
    numbers = chosen.map_numbers(maps)
    with progress("comparing", len(numbers), 1, "maps") as advance:
        compared = run(
            problem,
            chosen.factories,
            maps=numbers,
            walks=walks or problem.walks,
            seed=seed,
            workers=threads,
            destinations=destinations,
            timing=timing,
            on_map=lambda index, _: advance(f"map {index}"),
        )
    results = compared.to_json(by, chosen.baseline)
    if as_json:
        print(json.dumps(results, indent=2, ensure_ascii=False))
    else:
        show_results(results)


def show_results(results: "Results") -> None:
    """Print a comparison as a table."""
    from sidestep.evaluation.metrics import HEADINGS, TEXT_COLUMNS, cells
    from sidestep.scenarios.objectives import objective_in_words

    by, objective = results["by_minutes"], results["objective"]
    only = " (forecasts only)" if results["flows"] == "forecast" else ""
    maps = f"{results['maps']} map{'s' * (results['maps'] > 1)}"
    title = [
        f"{results['scenario']}{only}: {maps}, {results['walks']} walks each, seed {results['seed']}",
        results["summary"],
        results["synthetic"],
    ]
    if objective is not None:
        title.append(f"cost in minutes: {objective_in_words(objective)}; all comparisons below are of cost")
    shown = {
        "planner": True,
        "knows": True,
        "cost": objective,
        "minutes": True,
        "exposure": objective,
        "metres": objective,
        "too dense": objective and objective["max_density"],
        "median": not objective,
        "90 %": not objective,
        "in time": by,
        "saved": True,
        "difference": True,
        "difference 95 %": True,
        "gap": True,
        "arrive": True,
        "µs a decision": any("decision_us" in row for row in results["planners"].values()),
    }
    columns = [column for column in shown if shown[column]]
    headings = HEADINGS | {"in time": f"within {by:g} min" if by else "", "difference": f"over {results['baseline']}"}
    table = new_table(
        *(headings[column] if column in TEXT_COLUMNS else f">{headings[column]}" for column in columns),
        title="\n".join(filter(None, title)),
    )
    for name, row in results["planners"].items():
        table.add_row(*cells(name, row, results["maps"], columns).values())
    print_table(table)
