"""The command ``route``."""

import json
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sidestep.cli import options
from sidestep.errors import SidestepError

Hyphened = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
"""For values such as southern latitudes."""


def route(
    scenario: options.ScenarioOption,
    /,
    *,
    origin: Annotated[Hyphened, Parameter(name="--from")] = None,
    destination: Annotated[Hyphened, Parameter(name="--to")] = None,
    depart: Hyphened = None,
    planner: str | None = None,
    model: Path | None = None,
    by: options.By = None,
    futures: options.Whole | None = None,
    live: Path | None = None,
    output: Annotated[Literal["text", "geojson", "gpx", "png"], Parameter(name="--format")] = "text",
    out: Path | None = None,
    index: options.MapNumber = 0,
    changes: options.Changes = options.UNCHANGED,
    seed: options.Seed = 0,
    as_json: options.Json = False,
) -> None:
    """Plan one route, and say how long it may take. Routes are searched for unless a model is given.

    Parameters
    ----------
    origin
        Node, or in towns LAT,LON; by default the scenario's first node.
    destination
        Node, or in towns LAT,LON; by default the scenario's last node.
    depart
        Minutes after the scenario's start; in towns local time, such as 2025-05-24T12:30.
    planner
        Who plans, by name (see sidestep planners) or as MODULE:NAME; by default expected, the fastest route if crowds
        are as usual, or darp with --model. snapshot and forecast see all counts on the way.
    model
        Folder of a trained model, for the planner darp; without one routes are searched.
    futures
        Simulated futures; by default 200, in towns 20 for planners that see all counts, 1 without chance.
    live
        In towns: current counts, hourly, as CSV.
    output
        What is printed, or written to --out.
    out
        File to write to instead of printing.

    Raises
    ------
    SidestepError
        Options that exclude each other, or a request that cannot be answered.
    """
    options.check_least(seed=seed, map=index)
    if output == "png" and out is None:
        raise SidestepError("--format png needs --out, the file for the picture", field="out")
    if as_json and output != "text":
        raise SidestepError(f"--json and --format {output} exclude each other", field="format")
    options.start_jax()
    from sidestep.files import output_folder, write_text
    from sidestep.routing.request import RouteRequest, read_departure, read_place
    from sidestep.routing.router import plan_route

    ends = read_place("origin", origin), read_place("destination", destination)
    request = RouteRequest(*ends, read_departure(depart), planner, by, futures, live)
    plan = plan_route(options.read_scenario(scenario, changes), request, model=model, seed=seed, index=index)
    if out is not None:
        output_folder(out.parent)
    if output == "png" and out is not None:
        from sidestep.plotting import draw_route, save

        save(draw_route(plan), out)
        return
    writers = {"text": plan.to_text, "gpx": plan.to_gpx, "geojson": plan.to_geojson, "json": plan.to_json}
    shown = writers["json" if as_json else output]()
    if not isinstance(shown, str):
        shown = json.dumps(shown, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if out is None:
        print(shown, end="")
    else:
        write_text(out, shown)
