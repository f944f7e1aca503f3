"""The commands `planners` and `scenarios`, which list what there is."""

import json

from sidestep.cli import options
from sidestep.cli.console import print_table


def planners(*, as_json: options.Json = False) -> None:
    """List all planners: what they know, how they decide, and when to use them."""
    options.start_jax()
    from sidestep.planners.registry import planner_infos

    found = [
        {"name": name, "level": info.level, "learns": info.learns, "summary": info.summary, "use": info.use}
        for name, info in planner_infos().items()
    ]
    if as_json:
        print(json.dumps(found, indent=2, ensure_ascii=False))
        return
    rows = [[str(info[column]) for column in ("name", "level", "summary", "use")] for info in found]
    print_table((), ("planner", "knows", "decides", "use"), rows)
    print("Planners of your own: --planner MODULE:NAME, or the entry point group sidestep.planners.")


def scenarios(*, as_json: options.Json = False) -> None:
    """List the built-in scenarios."""
    options.start_jax()
    from sidestep.scenarios.builtin import BUILT_IN

    found = [
        {"name": name, "summary": scenario.summary, "synthetic": scenario.place.synthetic}
        for name, scenario in BUILT_IN.items()
    ]
    if as_json:
        print(json.dumps(found, indent=2, ensure_ascii=False))
        return
    rows = [(one["name"], "; ".join(filter(None, (one["summary"], one["synthetic"])))) for one in found]
    print_table((), ("scenario", "summary"), rows)
    print("Scenarios of your own: sidestep new NAME writes a file to start from.")
