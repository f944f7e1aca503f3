"""The command `compare`."""

import json
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from sidestep.cli.console import new_table, print_table, progress
from sidestep.cli.options import (
    UNCHANGED,
    By,
    Changes,
    Json,
    LevelOption,
    Models,
    PresetOption,
    ScenarioOption,
    Seed,
    Whole,
    Workers,
    at_least,
    check_minutes,
    read_scenario,
    start_jax,
    thread_count,
)
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from sidestep.evaluation.compare import Results


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
    at_least("seed", seed, 0)
    check_minutes(by)
    threads = thread_count(workers)
    start_jax()
    from sidestep.evaluation.compare import compare as run
    from sidestep.planners.learned import load_planners, trainable
    from sidestep.planners.registry import BASELINES, REPLANNING, choose
    from sidestep.scenarios.maps import draw_map

    problem = read_scenario(scenario, changes)
    numbers = list(range(at_least("maps", problem.maps if maps is None else maps, 1)))
    count = at_least("walks", problem.walks if walks is None else walks, 1)
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
    with progress("comparing", len(numbers), 1, "maps") as advance:
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
        show_results(compared.as_json(by, against))


def show_results(results: "Results") -> None:
    """Print a comparison as a table."""
    from sidestep.evaluation.metrics import cells
    from sidestep.scenarios.objectives import objective_in_words

    only = " (forecasts only)" if results["flows"] == "forecast" else ""
    title = (
        f"{results['scenario']}{only}: {results['maps']} map{'s' * (results['maps'] > 1)}, "
        f"{results['walks']} walks each, seed {results['seed']}"
    )
    if results["summary"]:
        title += f"\n{results['summary']}"
    by, objective = results["by_minutes"], results["objective"]
    if objective is not None:
        title += f"\ncost in minutes: {objective_in_words(objective)}; savings, differences and regrets are of cost"
    headings = {
        "planner": "planner",
        "knows": "knows",
        "cost": ">cost" if objective else "",
        "minutes": ">minutes",
        "exposure": ">exposure" if objective else "",
        "metres": ">metres" if objective else "",
        "too dense": ">too dense" if objective and objective["max_density"] else "",
        "median": "" if objective else ">median",
        "90 %": "" if objective else ">90 % in",
        "in time": f">within {by:g}" if by else "",
        "saved": ">saved",
        "difference": f">over {results['baseline']}",
        "difference 95 %": ">95 %",
        "regret": ">regret",
        "arrive": ">arrive",
        "µs a decision": ">µs/decision",
    }
    shown = {column: heading for column, heading in headings.items() if heading}
    table = new_table(*shown.values(), title=title)
    for name, row in results["planners"].items():
        table.add_row(*cells(name, row, results["maps"], shown).values())
    print_table(table)
