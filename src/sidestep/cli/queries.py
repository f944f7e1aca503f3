"""The commands that answer questions about many walks: `when`, `isochrone`, `matrix`, `crowds`."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sidestep.cli import answers, options
from sidestep.errors import SidestepError

Minutes = Annotated[str, Parameter(help="Minutes of walking, with commas between them.")]
Several = Annotated[list[str] | None, Parameter(allow_leading_hyphen=True, negative=())]
_Departures = Literal["text", "png"]
_Isochrones = Literal["text", "geojson", "png"]
_Matrices = Literal["text", "csv", "png"]
_Crowds = Literal["text", "geojson", "png"]


def when(
    scenario: options.ScenarioOption,
    /,
    *,
    origin: answers.Origin = None,
    destination: answers.Destination = None,
    given: answers.Planned = answers.PLANNED,
    until: answers.Hyphened = None,
    step: float | None = None,
    model: answers.Model = None,
    output: Annotated[_Departures | None, Parameter(name="--format")] = None,
    out: answers.OutFile = None,
    chosen: answers.MapChoice = answers.FIRST_MAP,
    as_json: options.Json = False,
) -> None:
    """Find the best departure from --depart to --until: how long the walk takes, half of the time and 90 % of it.

    Parameters
    ----------
    until
        Last departure of the window, as --depart; by default two hours later.
    step
        Minutes between departures; by default one slot of the scenario, usually 5.
    output
        What is printed, or written to --out; by default as the ending of --out says, or text.
    """
    chosen.check()
    written = answers.choose_format(output, out, _Departures, as_json=as_json)
    options.start_jax()
    found = chosen.router(scenario, out, given.live, given.avoid, model=model).when(
        origin, destination, until=until, step=step, **vars(given)
    )
    answers.show(found, "draw_departures", written, out)


def isochrone(
    scenario: options.ScenarioOption,
    /,
    *,
    origin: answers.Origin = None,
    minutes: Minutes = "5,10,15",
    given: answers.Searched = answers.SEARCHED,
    output: Annotated[_Isochrones | None, Parameter(name="--format")] = None,
    out: answers.OutFile = None,
    chosen: answers.MapChoice = answers.FIRST_MAP,
    as_json: options.Json = False,
) -> None:
    """Show how far one gets in some minutes, as areas in towns and as nodes on grids.

    Parameters
    ----------
    output
        What is printed, or written to --out; by default as the ending of --out says, or text.

    Raises
    ------
    SidestepError
        Minutes that are no numbers.
    """
    chosen.check()
    written = answers.choose_format(output, out, _Isochrones, as_json=as_json)
    try:
        limits = [float(each) for each in minutes.split(",")]
    except ValueError as error:
        said = "--minutes must be numbers with commas between them, such as 5,10,15"
        raise SidestepError(f"{said}, not {minutes!r:.60}", field="minutes") from error
    options.start_jax()
    found = chosen.router(scenario, out, given.live, given.avoid).isochrone(origin, minutes=limits, **vars(given))
    answers.show(found, "draw_isochrone", written, out)


def matrix(
    scenario: options.ScenarioOption,
    /,
    *,
    origin: Annotated[Several, Parameter(name="--from")] = None,
    destination: Annotated[Several, Parameter(name="--to")] = None,
    origins: Path | None = None,
    destinations: Path | None = None,
    given: answers.Searched = answers.SEARCHED,
    output: Annotated[_Matrices | None, Parameter(name="--format")] = None,
    out: answers.OutFile = None,
    chosen: answers.MapChoice = answers.FIRST_MAP,
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
        What is printed, or written to --out; by default as the ending of --out says, or text.
    """
    chosen.check()
    written = answers.choose_format(output, out, _Matrices, as_json=as_json)
    options.start_jax()
    from sidestep.routing.places import AskedPlace, read_places

    froms: list[AskedPlace | str] = [*(origin or []), *([] if origins is None else read_places("origins", origins))]
    tos: list[AskedPlace | str] = [
        *(destination or []),
        *([] if destinations is None else read_places("destinations", destinations)),
    ]
    found = chosen.router(scenario, out, given.live, given.avoid, origins, destinations).matrix(
        froms, tos or None, **vars(given)
    )
    answers.show(found, "draw_matrix", written, out)


def crowds(
    scenario: options.ScenarioOption,
    /,
    *,
    at: answers.Hyphened = None,
    live: answers.Live = None,
    output: Annotated[_Crowds | None, Parameter(name="--format")] = None,
    out: answers.OutFile = None,
    chosen: answers.MapChoice = answers.FIRST_MAP,
    as_json: options.Json = False,
) -> None:
    """Show how crowded the streets are expected to be.

    Parameters
    ----------
    at
        In towns local time, such as 2025-05-24T12:30, Sat 12:30 or 12:30; on grids minutes after the start.
    output
        What is printed, or written to --out; by default as the ending of --out says, or text.
    """
    chosen.check()
    written = answers.choose_format(output, out, _Crowds, as_json=as_json)
    options.start_jax()
    found = chosen.router(scenario, out, live).crowds(at, live=live)
    answers.show(found, "draw_crowds", written, out)
