"""The command ``route``."""

from typing import Annotated, Literal

from cyclopts import Parameter

from sidestep.cli import answers, options

_Routes = Literal["text", "geojson", "gpx", "png"]


def route(
    scenario: options.ScenarioOption,
    /,
    *,
    origin: answers.Origin = None,
    destination: answers.Destination = None,
    given: answers.Planned = answers.PLANNED,
    model: answers.Model = None,
    by: options.By = None,
    arrive_by: answers.Hyphened = None,
    confidence: float | None = None,
    alternatives: options.Whole = 0,
    output: Annotated[_Routes | None, Parameter(name="--format")] = None,
    out: answers.OutFile = None,
    chosen: answers.MapChoice = answers.FIRST_MAP,
    as_json: options.Json = False,
) -> None:
    """Plan one route, and say how long it may take. Routes are searched for unless a model is given.

    Parameters
    ----------
    arrive_by
        When to be there, as --depart: the walk departs as late as --confidence allows, and not before --depart.
    confidence
        Least share of the futures in which it arrives by then; by default 0.9.
    alternatives
        The most other routes to show, each different enough and not much worse.
    output
        What is printed, or written to --out; by default as the ending of --out says, or text.
    """
    chosen.check()
    written = answers.choose_format(output, out, _Routes, as_json=as_json)
    options.start_jax()
    from sidestep.routing.request import RouteRequest, read_departure, read_place

    request = RouteRequest(
        origin=read_place("origin", origin),
        destination=read_place("destination", destination),
        depart=read_departure(given.depart),
        planner=given.planner,
        by=by,
        futures=given.futures,
        live=given.live,
        avoid=given.avoid,
        alternatives=alternatives,
        arrive_by=read_departure(arrive_by, "arrive_by"),
        confidence=confidence,
    )
    plan = chosen.router(scenario, out, given.live, given.avoid, model=model).answer(request)
    answers.show(plan, "draw_route", written, out)
