"""The command `compare`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from sidestep.cli import options
from sidestep.cli.console import print_table, progress
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sidestep.evaluation.compare import Results
    from sidestep.scenarios.model import Scenario


LEAST_FIRST = (
    "90 %", "median", "knows", "difference 95 %", "metres", "too dense", "difference", "saved", "exposure", "arrive",
    "in time", "gap",
)  # fmt: skip
"""Columns that narrow terminals leave out, the least important first."""


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
    changes: options.Changes = options.UNCHANGED,
    seed: options.Seed = 0,
    workers: options.Workers = None,
    walks_out: Path | None = None,
    results_out: options.ResultsOut = None,
    as_json: options.Json = False,
) -> None:
    """Compare planners on the same maps and through the same crowds, also for several walkers: --walker adult,older.

    Where some walkers cannot get everywhere, all of them walk where all can get to.

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
    walks_out
        File for the single walks, .csv or .parquet: a row for each walk and planner.

    Raises
    ------
    SidestepError
        One file for both tables (field ``results_out``), and all that the planners and the walks refuse.
    """
    options.check_least(seed=seed, maps=maps, walks=walks, workers=workers)
    options.check_minutes(by=by)
    options.start_jax()
    from sidestep.evaluation.compare import compare as run
    from sidestep.planners.registry import choose_planners

    lineups = [
        choose_planners(
            problem,
            None if planners is None else options.names_in(planners),
            models=model or (),
            against=against,
            seed=seed,
            level=level,
            preset=preset,
            destinations=destinations or 1,
        )
        for problem in options.read_scenarios(scenario, changes)
    ]
    numbers = lineups[0].map_numbers(maps)
    if walks_out is not None and results_out is not None and walks_out.resolve() == results_out.resolve():
        said = f"--walks-out and --results-out are both {walks_out}: give one of them another file"
        raise SidestepError(said, field="results_out")
    for field, out in (("walks_out", walks_out), ("results_out", results_out)):
        check_out(out, field, scenario, lineups[0].scenario, model or ())
    each = walks or lineups[0].scenario.walks
    total = each * len(numbers) * sum(len(chosen.factories) for chosen in lineups)
    with progress("comparing", total, "walks") as advance:
        every = [
            run(
                chosen.scenario,
                chosen.factories,
                maps=numbers,
                walks=each,
                seed=seed,
                workers=workers or options.processors(),
                destinations=destinations,
                on_walks=lambda index, planner, walked: advance(f"map {index}, {planner}", walked),
            )
            for chosen in lineups
        ]
    results = [found.to_json(by, chosen.baseline) for found, chosen in zip(every, lineups, strict=True)]
    if walks_out is not None or results_out is not None:
        from sidestep.evaluation.tables import results_table, save_tables

        if walks_out is not None:
            save_tables([compared.to_frame() for compared in every], walks_out, "walks_out")
        if results_out is not None:
            save_tables([results_table(results)], results_out, "results_out")
    if as_json:
        print(json.dumps(results if len(results) > 1 else results[0], indent=2, ensure_ascii=False))
        return
    show_results(*results)
    for what, out in (("Walks", walks_out), ("Results", results_out)):
        if out is not None:
            print(f"{what}: {out}")


def check_out(out: Path | None, field: str, name: str, scenario: "Scenario", models: "Sequence[Path]") -> None:
    """Refuse, before long work begins, a file that a table cannot be written to."""
    if out is None:
        return
    from sidestep.evaluation.tables import check_table_file
    from sidestep.files import check_apart
    from sidestep.scenarios.reader import files_of

    check_apart(out, (*files_of(name, scenario), *models), field)
    check_table_file(out, field)


def show_results(*compared: "Results") -> None:
    """Print a comparison as a table, or those of several walkers as one."""
    from sidestep.evaluation.metrics import HEADINGS, TEXT_COLUMNS, cells
    from sidestep.scenarios.model import objective_in_words
    from sidestep.scenarios.walkers import walker_in_words

    results, walkers = compared[0], _walkers(compared)
    by, objective = results["by_minutes"], results["objective"]
    rows = [(walker, *row) for walker, each in zip(walkers, compared, strict=True) for row in each["planners"].items()]
    only = " (forecasts only)" if results["flows"] == "forecast" else ""
    maps = f"{results['maps']} map{'s' * (results['maps'] > 1)}"
    head = f"{results['scenario']}{only}: {maps}, {results['walks']} walks each, seed {results['seed']}"
    title = [head, results["summary"], results["synthetic"]]
    if objective is not None:
        title.append(f"cost in minutes: {objective_in_words(objective)}; all comparisons below are of cost")
    title += [f"walker: {walker_in_words(each['walker'])}" for each in compared if each["walker"] is not None]
    shown = {
        **dict.fromkeys(("minutes 95 %", "best map", "gap 95 %"), False),  # in reports only
        **dict.fromkeys(("cost", "exposure", "metres"), objective is not None),
        **dict.fromkeys(("median", "90 %"), objective is None),
        "too dense": objective and objective["max_density"],
        "in time": by,
    }
    columns = [column for column in HEADINGS if shown.get(column, True)]
    headings = HEADINGS | {"in time": f"within {by:g} min" if by else "", "difference": f"over {results['baseline']}"}
    several = len(compared) > 1
    print_table(
        title,
        ["walker"] * several
        + [headings[column] if column in TEXT_COLUMNS else f">{headings[column]}" for column in columns],
        [[walker] * several + list(cells(name, row, results["maps"], columns).values()) for walker, name, row in rows],
        [headings[column] for column in LEAST_FIRST],
    )


def _walkers(compared: "Sequence[Results]") -> list[str]:
    """The walkers of comparisons, by their kinds or, where several are of one kind, with their numbers."""
    from sidestep.scenarios.walkers import ADULT, walker_in_words

    every = [each["walker"] or ADULT.model_dump() for each in compared]
    kinds = [walker["kind"] for walker in every]
    return kinds if len(set(kinds)) == len(kinds) else [walker_in_words(walker) for walker in every]
