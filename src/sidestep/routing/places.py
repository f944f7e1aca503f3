"""Places that are asked for, one by one or in a file."""

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sidestep.errors import SidestepError
from sidestep.files import reading
from sidestep.routing.request import Place, RouteError, at_fault, called, check_list, read_place

MOST_PLACES = 1_000
"""The most origins or destinations of one matrix."""


@dataclass(frozen=True)
class AskedPlace:
    """A place that is asked for."""

    field: str
    """The parameter that it is of."""

    place: Place | None
    """None where nothing was given."""

    label: str = ""
    """Its name, where a file of places has one."""

    file: Path | None = None
    """The file that it is from; None where it is from none."""

    line: int | None = None
    """Line of that file, counted from 1."""

    @property
    def called(self) -> str:
        """For people."""
        return called(self.field)

    @contextmanager
    def at_fault(self) -> Iterator[None]:
        """Let errors name the parameter and, where the place is from a file, the line."""
        try:
            yield
        except SidestepError as error:
            where = "" if self.file is None else f"{self.file}: line {self.line}: "
            raise RouteError(f"{where}{error}", field=self.field, line=self.line) from error


Places = Sequence[AskedPlace | Place | str] | Path | str
"""Places one after the other, or a file of them."""


def read_places(field: str, given: Places) -> list[AskedPlace]:
    """Read places, or a file of them.

    Parameters
    ----------
    field
        The parameter that they are of: ``origins`` or ``destinations``.
    given
        Places as :func:`~sidestep.routing.request.read_place` takes them. A file has one place a line, a node or
        latitude and longitude with a comma between them. After a second comma the place may have a name, in quotes if
        it has commas; a node then has nothing between both. Further cells, empty lines, lines that begin with #, and a
        heading are ignored.

    Returns
    -------
    list of AskedPlace
        At least one.

    Raises
    ------
    RouteError
        Files that cannot be read, text that is no place, no places, or more than ``MOST_PLACES``.
    """
    if isinstance(given, (str, Path)):
        with at_fault(field), reading(Path(given), RouteError, "places") as file:
            places = list(_lines(field, Path(given), file.read().decode("utf-8-sig")))
    else:
        check_list(field, given)
        if any(each is None for each in given):
            raise RouteError(f"{called(field)} must be a place, not None", field=field)
        places = [
            each if isinstance(each, AskedPlace) else AskedPlace(field, read_place(field, each)) for each in given
        ]
    if not 1 <= len(places) <= MOST_PLACES:
        raise RouteError(f"give 1 to {MOST_PLACES:,} {field}, not {len(places):,}", field=field)
    return places


def _lines(field: str, file: Path, text: str) -> Iterator[AskedPlace]:
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            first, *others = next(csv.reader([line], skipinitialspace=True), None) or [""]
        except csv.Error as error:
            raise RouteError(f"line {number}: {error}", field=field, line=number) from error
        words = [word.strip() for word in (*first.split(","), *others)]
        heading = number == 1 and words[0].lower() in ("lat", "latitude", "node")
        if heading or not any(words) or line.lstrip().startswith("#"):
            continue
        try:
            place = read_place(field, ",".join(filter(None, words[:2])))
        except RouteError as error:
            raise RouteError(f"line {number}: {error}", field=field, line=number) from error
        label = "".join(sign for sign in " ".join(words[2:3]) if sign.isprintable())
        yield AskedPlace(field, place, label, file, number)
