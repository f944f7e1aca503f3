"""The commands `planners`, `scenarios` and `walkers`, which list what there is."""

import json

from sidestep.cli import options
from sidestep.cli.console import print_table, print_text


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
    print_text("Planners of your own: --planner MODULE:NAME, or the entry point group sidestep.planners.")


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
    print_text("Scenarios of your own: sidestep new NAME writes a file to start from.")


def walkers(*, as_json: options.Json = False) -> None:
    """List the walkers that --walker takes: how fast they are, and what they cannot take."""
    from inspect import getdoc

    from sidestep.scenarios.walkers import WALKERS, Custom

    every = [(name, getdoc(kind) or "", None if kind is Custom else kind()) for name, kind in WALKERS.items()]
    if as_json:
        found = [
            {"name": name, "summary": summary, **({} if walker is None else walker.model_dump(exclude={"kind"}))}
            for name, summary, walker in every
        ]
        print(json.dumps(found, indent=2, ensure_ascii=False))
        return
    rows = [
        (name, summary, "" if walker is None else walker.in_words().partition(" ")[2].strip("()"))
        for name, summary, walker in every
    ]
    print_table((), ("walker", "who", "numbers"), rows)
    print_text("Any number may be changed: --walker older,free_speed=1.0,lift_wait=90; see docs/walkers.md.")
