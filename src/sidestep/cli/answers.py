"""Printing and writing answers, and the options that ask for them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

from cyclopts import Parameter

from sidestep.cli import options
from sidestep.cli.console import print_text
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sidestep.routing.router import Router

Hyphened = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
"""For values such as southern latitudes."""
Origin = Annotated[Hyphened, Parameter(name="--from", help="LAT,LON or a node; on grids by default the first.")]
Destination = Annotated[Hyphened, Parameter(name="--to", help="LAT,LON or a node; on grids by default the last.")]
Depart = Annotated[
    Hyphened,
    Parameter(
        help="In towns local time, such as 2025-05-24T12:30, Sat 12:30 or 12:30; on grids minutes after the start."
    ),
]
Live = Annotated[Path | None, Parameter(help="In towns: current counts, hourly, as CSV.")]
Avoid = Annotated[
    Path | None, Parameter(help="In towns: GeoJSON file of polygons; streets that cross them are not walked.")
]
Futures = Annotated[
    options.Whole | None,
    Parameter(
        help="Simulated futures; by default 200, in towns 20 for planners that see all counts, 1 without chance."
    ),
]
Model = Annotated[Path | None, Parameter(help="Folder of a trained model, for the planner darp.")]
OutFile = Annotated[Path | None, Parameter(help="File to write to instead of printing.")]


@Parameter(name="*")
@dataclass(frozen=True)
class Given:
    """What most questions say beside their places."""

    depart: Depart = None

    live: Live = None

    avoid: Avoid = None


@Parameter(name="*")
@dataclass(frozen=True)
class Planned(Given):
    """The same, and who plans."""

    planner: str | None = None
    """Who plans, by name (see sidestep planners) or as MODULE:NAME; by default expected, the route of least expected
    time, or darp with --model. snapshot and forecast see all counts on the way."""

    futures: Futures = None


@Parameter(name="*")
@dataclass(frozen=True)
class Searched(Given):
    """The same, and who searches the paths to everywhere."""

    planner: str | None = None
    """Whose paths are walked: expected, the default, or shortest-path."""

    futures: options.Whole | None = None
    """Simulated futures; without, crowds are as expected."""


@Parameter(name="*")
@dataclass(frozen=True)
class MapChoice:
    """Which of a scenario's maps, and what is changed there."""

    index: options.MapNumber = 0
    changes: options.Changes = options.UNCHANGED
    seed: options.Seed = 0

    def check(self) -> None:
        """Refuse numbers below their least value."""
        options.check_least(seed=self.seed, map=self.index)

    def router(self, scenario: str, out: Path | None, *read: Path | None, model: Path | None = None) -> "Router":
        """The router of a scenario with these options applied.

        Parameters
        ----------
        scenario
            Its name or file.
        out
            The file to write to, which must be none of those that are read.
        *read
            Files that are read beside the scenario's.
        model
            Folder of a trained model.

        Returns
        -------
        Router
            With the scenario's streets and crowds.
        """
        from sidestep.files import check_above, check_apart
        from sidestep.routing.router import Router
        from sidestep.scenarios.reader import files_of

        found = options.read_scenario(scenario, self.changes)
        if out is not None:
            check_above(out.parent)
            check_apart(out, (*files_of(scenario, found), *read, model))
        return Router(found, model=model, seed=self.seed, index=self.index)


PLANNED, SEARCHED, FIRST_MAP = Planned(), Searched(), MapChoice()


ENDINGS = {".png": "png", ".geojson": "geojson", ".json": "json", ".gpx": "gpx", ".csv": "csv"}
"""Formats by the endings of their files."""
_OTHERS = (".bmp", ".gif", ".html", ".jpeg", ".jpg", ".kml", ".pdf", ".svg", ".tif", ".tiff", ".webp", ".xlsx")
"""Endings of formats that no answer has."""


def choose_format(output: str | None, out: Path | None, formats: Any, *, as_json: bool) -> str:
    """Choose the format of an answer, which is that of the file's ending where no option says it.

    Parameters
    ----------
    output, out, as_json
        The options ``--format``, ``--out`` and ``--json``.
    formats
        The values of ``--format``, as a ``Literal``.

    Returns
    -------
    str
        One of them, or "json"; "text" where nothing says another.

    Raises
    ------
    SidestepError
        Options that exclude each other, also an ending of another format; with the option at fault as its field.
    """
    if as_json and output not in (None, "text"):
        raise SidestepError(f"--json and --format {output} exclude each other", field="format")
    ending = "" if out is None else out.suffix.lower()
    said = ENDINGS.get(ending)
    known = ("json", *get_args(formats))
    chosen = "json" if as_json else output or (said if said and said in known else "text")
    of_another = said not in (None, chosen) and (said, chosen) != ("json", "geojson")  # GeoJSON is JSON
    if of_another or ending in _OTHERS:
        rule = f"--out {out} must not end in {ending}, which is no file of {chosen}"
        raise SidestepError(f"{rule}; answers are {', '.join(known)}", field="out")
    if chosen == "png" and out is None:
        raise SidestepError("--format png needs --out, the file for the picture", field="out")
    return chosen


def show(answer: Any, draw: str, output: str, out: Path | None) -> None:
    """Print an answer, or write it to a file.

    Parameters
    ----------
    answer
        An object with a method ``to_…`` for each format but pictures.
    draw
        Name of the function of :mod:`sidestep.plotting` that draws it.
    output, out
        The format, and the option ``--out``.
    """
    from sidestep.files import output_folder, write_text

    if out is not None:
        output_folder(out.parent)
    if output == "png" and out is not None:
        from sidestep import plotting

        plotting.save(getattr(plotting, draw)(answer), out)
        return
    writer: Callable[[], Any] = getattr(answer, f"to_{output}")
    shown = writer()
    if not isinstance(shown, str):
        shown = json.dumps(shown, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if out is None and output == "text":
        print_text(shown)
    elif out is None:
        print(shown, end="")
    else:
        write_text(out, shown)
