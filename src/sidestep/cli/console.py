"""Tables and progress bars on a terminal. The only module that imports rich."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import count
from time import perf_counter

WIDTH = 180
"""Width of tables where the output is no terminal and COLUMNS does not say another."""


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


def print_text(text: str) -> None:
    """Print lines, wrapped between words on terminals; into files and other programs they go as they are.

    Parameters
    ----------
    text
        With or without a line break at the end.
    """
    if not _known_width():
        print(text.removesuffix("\n"))
        return
    from rich.console import Console

    Console(highlight=False).print(text.removesuffix("\n"), markup=False, emoji=False)


def _known_width() -> bool:
    """Whether there is a terminal, or COLUMNS says how wide lines may be."""
    return sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()


def print_table(title: Iterable[str], columns: Iterable[str], rows: Iterable[Iterable[str]]) -> None:
    """Print a table, in a fixed width where the output is no terminal and COLUMNS is not set.

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

    console = Console(width=None if _known_width() else WIDTH, highlight=False)
    headings, cells = list(columns), [list(row) for row in rows]
    head = "\n".join(filter(None, title))
    for block in _blocks(headings, cells, console.width):
        table = Table(box=box.SIMPLE_HEAD, title=head, title_justify="left", title_style="")
        for column in (headings[index] for index in block):
            number = column.startswith(">")
            table.add_column(column.removeprefix(">"), justify="right" if number else "left", no_wrap=number)
        for row in cells:
            table.add_row(*(row[index] for index in block))
        console.print(table)
        head = ""


def _blocks(columns: list[str], rows: list[list[str]], width: int) -> list[list[int]]:
    """Columns of one table or, where numbers do not fit, of several, each with all columns of text."""
    gap = 3
    headings = [column.removeprefix(">") for column in columns]
    needs = [gap + max(map(len, cells)) for cells in zip(headings, *rows, strict=True)]
    numbers = [index for index, column in enumerate(columns) if column.startswith(">")]
    texts = [index for index in range(len(columns)) if index not in numbers]
    left = width - gap - sum(min(needs[index], 20) for index in texts)  # longer texts are wrapped
    blocks: list[list[int]] = [[]]
    for index in numbers:
        if blocks[-1] and sum(needs[each] for each in (*blocks[-1], index)) > left:
            blocks.append([])
        blocks[-1].append(index)
    return [sorted((*texts, *block)) for block in blocks]
