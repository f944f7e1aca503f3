"""The command `compare`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from sidestep.cli import options
from sidestep.cli.console import print_table, progress

if TYPE_CHECKING:
    from sidestep.evaluation.compare import Results


def compare(
    scenario: options.ScenarioOption,
    /,
    *,
    planners: Annotated[str | None, Parameter(alias="--planner")] = None,
    maps: options.Whole | None = None,
    walks: options.Whole | None = None,
    level: options.LevelOption = None,
    preset: options.PresetOption = "default",
    model: Annotated[list[Path] | None, Parameter(negative=())] = None,
    destinations: options.Whole | None = None,
    by: options.By = None,
    against: str = "expected",
    timing: options.Flag = False,
    changes: options.Changes = options.UNCHANGED,
    seed: options.Seed = 0,
    workers: options.Workers = None,
    as_json: options.Json = False,
) -> None:
    """Compare planners on the same maps and through the same crowds.

    Parameters
    ----------
    planners
        Planners, separated by commas: names (see sidestep planners) or MODULE:NAME; by default all that need no
        training, and darp. Models walk in any case.
    maps
        Number of maps; by default the scenario's.
    walks
        Walks on each map; by default the scenario's.
    model
        Folder of a trained model; repeat it for several.
    destinations
        Number of destinations to walk to, from anywhere; by default walks go from corner to corner on grids, and to all
        destinations in real places.
    against
        Planner that the others' minutes are set against.
    timing
        Measure how long decisions take; planning is then done twice.
    """
    options.check_least(seed=seed, maps=maps, walks=walks, workers=workers)
    options.check_minutes(by=by)
    options.start_jax()
    from sidestep.evaluation.compare import compare as run
    from sidestep.planners.registry import choose_planners

    problem = options.read_scenario(scenario, changes)
    chosen = choose_planners(
        problem,
        None if planners is None else options.names_in(planners),
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
            workers=workers or options.processors(),
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
    from sidestep.scenarios.model import objective_in_words

    by, objective, rows = results["by_minutes"], results["objective"], results["planners"]
    only = " (forecasts only)" if results["flows"] == "forecast" else ""
    maps = f"{results['maps']} map{'s' * (results['maps'] > 1)}"
    head = f"{results['scenario']}{only}: {maps}, {results['walks']} walks each, seed {results['seed']}"
    title = [head, results["summary"], results["synthetic"]]
    if objective is not None:
        title.append(f"cost in minutes: {objective_in_words(objective)}; all comparisons below are of cost")
    shown = {
        **dict.fromkeys(("minutes 95 %", "best map", "gap 95 %"), False),  # in reports only
        **dict.fromkeys(("cost", "exposure", "metres"), objective is not None),
        **dict.fromkeys(("median", "90 %"), objective is None),
        "too dense": objective and objective["max_density"],
        "in time": by,
        "µs a decision": any("decision_us" in row for row in rows.values()),
    }
    columns = [column for column in HEADINGS if shown.get(column, True)]
    headings = HEADINGS | {"in time": f"within {by:g} min" if by else "", "difference": f"over {results['baseline']}"}
    print_table(
        title,
        [headings[column] if column in TEXT_COLUMNS else f">{headings[column]}" for column in columns],
        [cells(name, row, results["maps"], columns).values() for name, row in rows.items()],
    )
