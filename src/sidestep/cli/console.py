"""Tables and progress bars on a terminal. The only module that imports rich."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import count
from time import perf_counter

WIDTH = 180
"""Width of tables where the output is no terminal."""


@contextmanager
def progress(what: str, total: int, each: int, unit: str) -> Iterator[Callable[[str], None]]:
    """Show a bar with rate and time left on standard error, or nothing where that is no terminal.

    Parameters
    ----------
    what
        Text before the bar.
    total
        Number of calls of the yielded function that fill the bar.
    each, unit
        What one call stands for, such as 2560 steps.

    Yields
    ------
    Callable
        Moves the bar one call further, with a note.
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
    task = bar.add_task(what, total=total * each, rate="", note="")
    began, done = perf_counter(), count(each, each)

    def advance(note: str) -> None:
        rate = f"{next(done) / (perf_counter() - began):,.3g} {unit}/s"
        bar.update(task, advance=each, rate=rate, note=note)

    with bar:
        yield advance


def print_table(title: Iterable[str], columns: Iterable[str], rows: Iterable[Iterable[str]]) -> None:
    """Print a table, in a fixed width where the output is no terminal.

    Parameters
    ----------
    title
        Lines above the table; empty ones are left out.
    columns
        Headings; columns whose heading begins with > hold numbers.
    rows
        Texts by column.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    head = "\n".join(filter(None, title))
    table = Table(box=box.SIMPLE_HEAD, title=head, title_justify="left", title_style="")
    for column in columns:
        number = column.startswith(">")
        table.add_column(column.removeprefix(">"), justify="right" if number else "left", no_wrap=number)
    for row in rows:
        table.add_row(*row)
    Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False).print(table)
