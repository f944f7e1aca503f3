"""The commands `planners` and `scenarios`, which list what there is."""

import json

from sidestep.cli.console import new_table, print_table
from sidestep.cli.options import Json, start_jax


def planners(*, as_json: Json = False) -> None:
    """List all planners: what they know, how they decide, and when to use them."""
    start_jax()
    from sidestep.planners.registry import planner_infos

    found = [
        {"name": name, "level": info.level, "learns": info.planner is None, "summary": info.summary, "use": info.use}
        for name, info in planner_infos().items()
    ]
    if as_json:
        print(json.dumps(found, indent=2, ensure_ascii=False))
        return
    table = new_table("planner", "knows", "decides", "use", title="")
    for info in found:
        table.add_row(*(str(info[column]) for column in ("name", "level", "summary", "use")))
    print_table(table)
    print("Planners of your own: --planner MODULE:NAME, or the entry point group sidestep.planners.")


def scenarios(*, as_json: Json = False) -> None:
    """List the built-in scenarios."""
    start_jax()
    from sidestep.scenarios.builtin import BUILT_IN

    found = [
        {"name": name, "summary": scenario.summary, "synthetic": scenario.place.synthetic}
        for name, scenario in BUILT_IN.items()
    ]
    if as_json:
        print(json.dumps(found, indent=2, ensure_ascii=False))
        return
    table = new_table("scenario", "summary", title="")
    for one in found:
        table.add_row(one["name"], "; ".join(filter(None, (one["summary"], one["synthetic"]))))
    print_table(table)
    print("Scenarios of your own: sidestep new NAME writes a file to start from.")
