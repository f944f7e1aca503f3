"""Printing and writing answers, and the options that ask for them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    """Who plans, by name (see sidestep planners) or as MODULE:NAME; by default expected, the fastest route if crowds
    are as usual, or darp with --model. snapshot and forecast see all counts on the way."""

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

    def router(self, scenario: str, model: Path | None = None) -> "Router":
        """The router of a scenario with these options applied."""
        from sidestep.routing.router import Router

        found = options.read_scenario(scenario, self.changes)
        return Router(found, model=model, seed=self.seed, index=self.index)


PLANNED, SEARCHED, FIRST_MAP = Planned(), Searched(), MapChoice()


def check_output(output: str, out: Path | None, *, as_json: bool) -> None:
    """Refuse options for output that exclude each other.

    Parameters
    ----------
    output, out, as_json
        The options ``--format``, ``--out`` and ``--json``.

    Raises
    ------
    SidestepError
        With the option at fault as its field.
    """
    if output == "png" and out is None:
        raise SidestepError("--format png needs --out, the file for the picture", field="out")
    if as_json and output != "text":
        raise SidestepError(f"--json and --format {output} exclude each other", field="format")


def show(answer: Any, draw: str, output: str, out: Path | None, *, as_json: bool) -> None:
    """Print an answer, or write it to a file.

    Parameters
    ----------
    answer
        An object with a method ``to_…`` for each format but pictures.
    draw
        Name of the function of :mod:`sidestep.plotting` that draws it.
    output, out, as_json
        The options ``--format``, ``--out`` and ``--json``.
    """
    from sidestep.files import output_folder, write_text

    if out is not None:
        output_folder(out.parent)
    if output == "png" and out is not None:
        from sidestep import plotting

        plotting.save(getattr(plotting, draw)(answer), out)
        return
    writer: Callable[[], Any] = getattr(answer, f"to_{'json' if as_json else output}")
    shown = writer()
    if not isinstance(shown, str):
        shown = json.dumps(shown, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if out is None and output == "text" and not as_json:
        print_text(shown)
    elif out is None:
        print(shown, end="")
    else:
        write_text(out, shown)
