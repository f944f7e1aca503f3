"""Tables and progress bars on a terminal. The only module that imports rich."""

import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from textwrap import wrap
from time import perf_counter

_AFTER_NUMBER, _UNBROKEN = re.compile(r"(?<=\d) (?=[^\W\d_]|[%×])"), "\ue000"  # which rich takes for a letter
WIDTH = 180
"""Width of tables where the output is no terminal and COLUMNS does not say another."""
SHORT, LEAST = 30, 20
"""Texts of tables up to this length are never wrapped; the columns of longer ones keep at least this width."""
GAP = 3
"""Width between columns; as much stands at both edges."""


@contextmanager
def progress(what: str, total: int, unit: str) -> Iterator[Callable[..., None]]:
    """Show a bar with rate and time left on standard error, or nothing where that is no terminal.

    Parameters
    ----------
    what
        Text before the bar.
    total, unit
        How much there is to do, such as 10 maps.

    Yields
    ------
    Callable
        Shows a note, and moves the bar on by the second argument, 1 by default. Threads may call it.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn

    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),  # as wide as the texts leave room for
        TextColumn("{task.completed:,.0f}/{task.total:,.0f} " + unit),
        TextColumn("{task.fields[rate]}"),
        TextColumn("{task.fields[note]}"),
        console=Console(stderr=True),
        disable=not sys.stderr.isatty(),
        transient=True,
    )
    task = bar.add_task(what, total=total, rate="", note="")
    began = perf_counter()

    def advance(note: str, done: int = 1) -> None:
        bar.update(task, advance=done, note=note)
        if completed := bar.tasks[0].completed:
            # Over all that was done: the latest steps may have waited for nothing that the next ones wait for.
            rate = completed / max(perf_counter() - began, 1e-9)
            left = timedelta(seconds=round((total - completed) / rate))
            bar.update(task, rate=f"{rate:,.{2 if rate < 100 else 0}f}/s, {left} left")

    with bar:
        yield advance


def print_text(text: str) -> None:
    """Print lines, wrapped on terminals, not between a number and its unit; elsewhere they go as they are.

    Parameters
    ----------
    text
        With or without a line break at the end.
    """
    if not _known_width():
        print(text.removesuffix("\n"))
        return
    from rich.console import Console
    from rich.text import Text

    whole = Text(_AFTER_NUMBER.sub(_UNBROKEN, text.removesuffix("\n")))
    console = Console()
    for line in whole.wrap(console, console.width):
        print(line.plain.rstrip().replace(_UNBROKEN, " "))


def _known_width() -> bool:
    """Whether there is a terminal, or COLUMNS says how wide lines may be."""
    return sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()


def print_table(
    title: Iterable[str], columns: Iterable[str], rows: Iterable[Iterable[str]], expendable: Iterable[str] = ()
) -> None:
    """Print a table; on a terminal that is too narrow for it, without its least important columns.

    Long texts are wrapped between words, and neither words nor numbers are broken. Where the output is no terminal, all
    columns are there.

    Parameters
    ----------
    title
        Lines above the table; empty ones are left out.
    columns
        Headings, all different; columns whose heading begins with > hold numbers.
    rows
        Texts by column.
    expendable
        Headings of columns that may be left out, the least important first. All others always stay.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if _known_width() else WIDTH, highlight=False, markup=False, emoji=False)
    texts = [list(column) for column in zip(columns, *rows, strict=True)]
    shown, left_out = {column[0].removeprefix(">"): column for column in texts}, []
    widths = {heading: _widths(*column) for heading, column in shown.items()}
    droppable = [heading for heading in expendable if heading in shown] if sys.stdout.isatty() else []
    # GAP between columns, and one space more in all at the edges
    while (spare := console.width - 1 - sum(GAP + widths[heading][0] for heading in shown)) < 0 and droppable:
        left_out.append(droppable.pop(0))
        del shown[left_out[-1]]
    console.width -= min(spare, 0)
    for line in filter(None, title):
        console.print(line)
    table = Table(box=box.SIMPLE_HEAD)
    for heading, width in _shared({heading: widths[heading] for heading in shown}, max(spare, 0)).items():
        number = shown[heading][0].startswith(">")
        table.add_column("\n".join(wrap(heading, width)), justify="right" if number else "left", width=width)
    for row in zip(*(column[1:] for column in shown.values()), strict=True):
        table.add_row(*row)
    console.print(table)
    if left_out:
        names = ", ".join(heading for heading in widths if heading in left_out)
        console.print(f"Left out: {names}. A wider terminal or --json shows them.\n", style="dim")


def _widths(heading: str, *cells: str) -> tuple[int, int]:
    """How narrow a column may become, and how wide it would be: numbers, words and short texts stay whole."""
    from rich.cells import cell_len

    said, longest = heading.removeprefix(">"), max(map(cell_len, cells), default=0)
    words = [cell_len(word) for text in (said, *cells) for word in text.split()]
    whole = longest if said != heading or longest <= SHORT else LEAST
    least = max([whole, *words])
    return least, max(least, longest, cell_len(said))


def _shared(widths: dict[str, tuple[int, int]], spare: int) -> dict[str, int]:
    """The columns' widths with the spare room shared out among those that would be wider, in equal parts."""
    given = {heading: least for heading, (least, _) in widths.items()}
    for number, heading in enumerate(sorted(widths, key=lambda heading: widths[heading][1] - widths[heading][0])):
        least, wanted = widths[heading]
        more = min(wanted - least, spare // (len(widths) - number))
        given[heading], spare = least + more, spare - more
    return given
