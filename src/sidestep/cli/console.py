"""Tables and progress bars on a terminal. The only module that imports rich."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.table import Table

WIDTH = 180
"""Width of tables where the output is no terminal."""


class Advance:
    """Moves a progress bar one step further, with a note."""

    def __init__(self, bar: "Progress", what: str, total: int, each: int, unit: str) -> None:
        self._bar, self._each, self._unit, self._done, self._began = bar, each, unit, 0, perf_counter()
        self._task = bar.add_task(what, total=total * each, rate="", note="")

    def __call__(self, note: str) -> None:
        self._done += self._each
        rate = f"{self._done / (perf_counter() - self._began):,.3g} {self._unit}/s"
        self._bar.update(self._task, advance=self._each, rate=rate, note=note)


@contextmanager
def progress(what: str, total: int, each: int, unit: str) -> Iterator[Advance]:
    """Show a bar with rate and time left on standard error, or nothing where that is no terminal.

    Parameters
    ----------
    what
        Text before the bar.
    total
        Number of calls of the yielded function that fill the bar.
    each, unit
        What one call stands for, such as 2560 steps.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TextColumn("{task.completed:,.0f}/{task.total:,.0f} " + unit),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[note]}"),
        console=Console(stderr=True),
        disable=not sys.stderr.isatty(),
        transient=True,
    )
    with bar:
        yield Advance(bar, what, total, each, unit)


def new_table(*columns: str, title: str) -> "Table":
    """Make a table; columns whose heading begins with > hold numbers."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", title_style="")
    for column in columns:
        number = column.startswith(">")
        table.add_column(column.removeprefix(">"), justify="right" if number else "left", no_wrap=number)
    return table


def print_table(table: "Table") -> None:
    """Print a table, in a fixed width where the output is no terminal."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False).print(table)
