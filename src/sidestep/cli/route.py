"""The command ``route``."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sidestep.cli import answers, options


def route(
    scenario: options.ScenarioOption,
    /,
    *,
    origin: answers.Origin = None,
    destination: answers.Destination = None,
    depart: answers.Depart = None,
    planner: str | None = None,
    model: Path | None = None,
    by: options.By = None,
    arrive_by: answers.Hyphened = None,
    confidence: float = 0.9,
    alternatives: options.Whole = 0,
    futures: options.Whole | None = None,
    live: answers.Live = None,
    avoid: answers.Avoid = None,
    output: Annotated[Literal["text", "geojson", "gpx", "png"], Parameter(name="--format")] = "text",
    out: answers.OutFile = None,
    index: options.MapNumber = 0,
    changes: options.Changes = options.UNCHANGED,
    seed: options.Seed = 0,
    as_json: options.Json = False,
) -> None:
    """Plan one route, and say how long it may take. Routes are searched for unless a model is given.

    Parameters
    ----------
    planner
        Who plans, by name (see sidestep planners) or as MODULE:NAME; by default expected, the fastest route if crowds
        are as usual, or darp with --model. snapshot and forecast see all counts on the way.
    model
        Folder of a trained model, for the planner darp; without one routes are searched.
    arrive_by
        When to be there, as --depart: the walk departs as late as --confidence allows, and not before --depart.
    confidence
        Least share of the futures in which it arrives by then.
    alternatives
        The most other routes to show, each different enough and not much worse.
    futures
        Simulated futures; by default 200, in towns 20 for planners that see all counts, 1 without chance.
    output
        What is printed, or written to --out.
    """
    options.check_least(seed=seed, map=index)
    answers.check_output(output, out, as_json=as_json)
    options.start_jax()
    from sidestep.routing.request import RouteRequest, read_departure, read_place
    from sidestep.routing.router import plan_route

    request = RouteRequest(
        origin=read_place("origin", origin),
        destination=read_place("destination", destination),
        depart=read_departure(depart),
        planner=planner,
        by=by,
        futures=futures,
        live=live,
        avoid=avoid,
        alternatives=alternatives,
        arrive_by=read_departure(arrive_by, "arrive_by"),
        confidence=confidence,
    )
    plan = plan_route(options.read_scenario(scenario, changes), request, model=model, seed=seed, index=index)
    answers.show(plan, "draw_route", output, out, as_json=as_json)
