"""The commands that answer questions about many walks: `when`, `isochrone`, `matrix`, `crowds`."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sidestep.cli import answers, options
from sidestep.errors import SidestepError

Minutes = Annotated[str, Parameter(help="Minutes of walking, with commas between them.")]
Search = Annotated[
    str | None, Parameter(name="--planner", help="Whose paths are walked: expected, the default, or shortest-path.")
]
AskedFutures = Annotated[
    options.Whole | None, Parameter(name="--futures", help="Simulated futures; without, crowds are as expected.")
]
Several = Annotated[list[str] | None, Parameter(allow_leading_hyphen=True, negative=())]


def when(
    scenario: options.ScenarioOption,
    /,
    *,
    origin: answers.Origin = None,
    destination: answers.Destination = None,
    depart: answers.Depart = None,
    until: answers.Hyphened = None,
    step: float | None = None,
    planner: str | None = None,
    model: Path | None = None,
    futures: options.Whole | None = None,
    live: answers.Live = None,
    avoid: answers.Avoid = None,
    output: Annotated[Literal["text", "png"], Parameter(name="--format")] = "text",
    out: answers.OutFile = None,
    index: options.MapNumber = 0,
    changes: options.Changes = options.UNCHANGED,
    seed: options.Seed = 0,
    as_json: options.Json = False,
) -> None:
    """Find the best departure in a window: how long the walk takes at every one, half of the time and 90 % of it.

    Parameters
    ----------
    depart
        First departure of the window: local time, such as 2025-05-24T12:30, Sat 12:30 or 12:30; on grids minutes.
    until
        Last departure of the window, as --depart; by default two hours later.
    step
        Minutes between departures; by default one slot of the scenario, usually 5.
    planner
        Who plans, by name (see sidestep planners) or as MODULE:NAME; by default expected, or darp with --model.
    model
        Folder of a trained model, for the planner darp.
    futures
        Simulated futures; by default 200, in towns 20 for planners that see all counts, 1 without chance.
    output
        What is printed, or written to --out.
    """
    options.check_least(seed=seed, map=index)
    answers.check_output(output, out, as_json=as_json)
    options.start_jax()
    found = answers.router(scenario, changes, model=model, seed=seed, index=index).when(
        origin,
        destination,
        depart=depart,
        until=until,
        step=step,
        planner=planner,
        futures=futures,
        live=live,
        avoid=avoid,
    )
    answers.show(found, "draw_departures", output, out, as_json=as_json)


def isochrone(
    scenario: options.ScenarioOption,
    /,
    *,
    origin: answers.Origin = None,
    minutes: Minutes = "5,10,15",
    depart: answers.Depart = None,
    planner: Search = None,
    futures: AskedFutures = None,
    live: answers.Live = None,
    avoid: answers.Avoid = None,
    output: Annotated[Literal["text", "geojson", "png"], Parameter(name="--format")] = "text",
    out: answers.OutFile = None,
    index: options.MapNumber = 0,
    changes: options.Changes = options.UNCHANGED,
    seed: options.Seed = 0,
    as_json: options.Json = False,
) -> None:
    """Show how far one gets in some minutes, as areas in towns and as nodes on grids.

    Parameters
    ----------
    output
        What is printed, or written to --out.

    Raises
    ------
    SidestepError
        Minutes that are no numbers.
    """
    options.check_least(seed=seed, map=index)
    answers.check_output(output, out, as_json=as_json)
    try:
        limits = [float(each) for each in minutes.split(",")]
    except ValueError as error:
        said = "--minutes must be numbers with commas between them, such as 5,10,15"
        raise SidestepError(f"{said}, not {minutes!r:.60}", field="minutes") from error
    options.start_jax()
    found = answers.router(scenario, changes, seed=seed, index=index).isochrone(
        origin, minutes=limits, depart=depart, planner=planner, futures=futures, live=live, avoid=avoid
    )
    answers.show(found, "draw_isochrone", output, out, as_json=as_json)


def matrix(
    scenario: options.ScenarioOption,
    /,
    *,
    origin: Annotated[Several, Parameter(name="--from")] = None,
    destination: Annotated[Several, Parameter(name="--to")] = None,
    origins: Path | None = None,
    destinations: Path | None = None,
    depart: answers.Depart = None,
    planner: Search = None,
    futures: AskedFutures = None,
    live: answers.Live = None,
    avoid: answers.Avoid = None,
    output: Annotated[Literal["text", "csv", "png"], Parameter(name="--format")] = "text",
    out: answers.OutFile = None,
    index: options.MapNumber = 0,
    changes: options.Changes = options.UNCHANGED,
    seed: options.Seed = 0,
    as_json: options.Json = False,
) -> None:
    """Say how long the walks from many places to many others take.

    Parameters
    ----------
    origin
        Node, or in towns LAT,LON; repeatable.
    destination
        Node, or in towns LAT,LON; repeatable. By default the destinations are the origins.
    origins
        File with more of them, one a line.
    destinations
        File with more of them, one a line.
    output
        What is printed, or written to --out.
    """
    options.check_least(seed=seed, map=index)
    answers.check_output(output, out, as_json=as_json)
    options.start_jax()
    from sidestep.routing.matrix import NamedPlace, read_places

    froms: list[NamedPlace | str] = [*(origin or []), *([] if origins is None else read_places("origins", origins))]
    tos: list[NamedPlace | str] = [
        *(destination or []),
        *([] if destinations is None else read_places("destinations", destinations)),
    ]
    found = answers.router(scenario, changes, seed=seed, index=index).matrix(
        froms, tos or None, depart=depart, planner=planner, futures=futures, live=live, avoid=avoid
    )
    answers.show(found, "draw_matrix", output, out, as_json=as_json)


def crowds(
    scenario: options.ScenarioOption,
    /,
    *,
    at: answers.Hyphened = None,
    live: answers.Live = None,
    output: Annotated[Literal["text", "geojson", "png"], Parameter(name="--format")] = "text",
    out: answers.OutFile = None,
    index: options.MapNumber = 0,
    changes: options.Changes = options.UNCHANGED,
    seed: options.Seed = 0,
    as_json: options.Json = False,
) -> None:
    """Show how crowded the streets are expected to be.

    Parameters
    ----------
    at
        In towns local time, such as 2025-05-24T12:30, Sat 12:30 or 12:30; on grids minutes after the start.
    output
        What is printed, or written to --out.
    """
    options.check_least(seed=seed, map=index)
    answers.check_output(output, out, as_json=as_json)
    options.start_jax()
    found = answers.router(scenario, changes, seed=seed, index=index).crowds(at, live=live)
    answers.show(found, "draw_crowds", output, out, as_json=as_json)
