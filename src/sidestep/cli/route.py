"""The command ``route``."""

import json
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sidestep.cli.options import (
    UNCHANGED,
    By,
    Changes,
    Hyphened,
    Json,
    ScenarioOption,
    Seed,
    Whole,
    at_least,
    read_scenario,
    start_jax,
)
from sidestep.errors import SidestepError


def route(
    scenario: ScenarioOption,
    /,
    *,
    origin: Annotated[
        str | None,
        Hyphened(name="--from", help="Node, or in towns LAT,LON; by default the scenario's first node."),
    ] = None,
    destination: Annotated[
        str | None, Hyphened(name="--to", help="Node, or in towns LAT,LON; by default the scenario's last node.")
    ] = None,
    depart: Annotated[
        str | None,
        Hyphened(help="Minutes after the scenario's start; in towns local time, such as 2025-05-24T12:30."),
    ] = None,
    planner: Annotated[
        str | None,
        Parameter(
            help="Who plans; by default expected, the fastest route if crowds are as usual, or darp with --model. "
            "snapshot and forecast see all counts on the way."
        ),
    ] = None,
    model: Annotated[
        Path | None, Parameter(help="Folder of a trained model, for the planner darp; without one routes are searched.")
    ] = None,
    by: By = None,
    futures: Annotated[
        int | None,
        Whole(
            help="Simulated futures; by default 200, in towns 20 for planners that see all counts, 1 without chance."
        ),
    ] = None,
    live: Annotated[Path | None, Parameter(help="In towns: current counts, hourly, as CSV.")] = None,
    output: Annotated[
        Literal["text", "geojson", "gpx", "png"],
        Parameter(name="--format", help="What is printed, or written to --out."),
    ] = "text",
    out: Annotated[Path | None, Parameter(help="File to write to instead of printing.")] = None,
    index: Annotated[int, Whole(name="--map", help="Number of the map.")] = 0,
    changes: Changes = UNCHANGED,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Plan one route, and say how long it may take. Routes are searched for unless a model is given."""
    at_least("seed", seed, 0)
    at_least("map", index, 0)
    if output == "png" and out is None:
        raise SidestepError("--format png needs --out, the file for the picture", field="out")
    if as_json and output != "text":
        raise SidestepError(f"--json and --format {output} exclude each other", field="format")
    start_jax()
    from sidestep.files import output_folder, write_text
    from sidestep.routing.request import RouteRequest, read_departure, read_place
    from sidestep.routing.router import plan_route

    ends = read_place("origin", origin), read_place("destination", destination)
    request = RouteRequest(*ends, read_departure(depart), planner, by, futures, live)
    plan = plan_route(read_scenario(scenario, changes), request, model=model, seed=seed, index=index)
    if out is not None:
        output_folder(out.parent)
    if output == "png" and out is not None:
        from sidestep.plotting import draw_route, save

        save(draw_route(plan), out)
        return
    shown = {
        "json": lambda: _dumped(plan.to_json()),
        "geojson": lambda: _dumped(plan.to_geojson()),
        "gpx": plan.to_gpx,
        "text": plan.to_text,
    }["json" if as_json else output]()
    if out is None:
        print(shown, end="")
    else:
        write_text(out, shown)


def _dumped(found: object) -> str:
    return json.dumps(found, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
