"""Text files with columns, as publishers write them: which separator, where the header is, and the cells of columns.

The lines are checked one by one, so that errors name them; pandas then reads the columns that are needed. Equal cells
are kept once: a table of millions of rows has few sensors and not many hours.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as quoted
from typing import Any

import numpy as np
from jaxtyping import Bool, Int, Shaped

from sidestep.crowds.asides import is_aside, like_data, like_time
from sidestep.crowds.columns import check_names, check_rows, decoded
from sidestep.errors import SidestepError

DELIMITERS = (";", "\t", "|", ",")
_Row = tuple[int, int, str]  # line number, number of cells, and text
_SAMPLE = 200  # lines that show what the header is
_CHUNK = 500_000  # rows that are in memory as text
# "March 04, 2024" without quotes in a file with commas between columns, as Melbourne publishes.
_COMMA_IN_DATE = re.compile(
    r"\b((?:jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*\.? \d{1,2}),(?= \d{4}\b)", re.IGNORECASE
)


@dataclass(frozen=True, eq=False)
class Cells:
    """One column: its different cells, and which of them stands in each row."""

    texts: tuple[str, ...]
    """Without blanks around them; "" where a cell is empty."""
    code: Int[np.ndarray, " row"]

    def values(self, parse: Callable[[str], Any], dtype: Any) -> Shaped[np.ndarray, " row"]:
        """A value for each row."""
        return np.array([parse(text) for text in self.texts], dtype)[self.code]


@dataclass(frozen=True, eq=False)
class Sheet:
    """A file with columns, of which the header is known. Methods raise errors of the type ``error``."""

    source: str
    """Name of the file."""
    names: tuple[str, ...]
    """Of the columns."""
    delimiter: str
    skipped: int
    """Lines with something in them above the header."""
    aside: int
    """Lines of units below it, and of totals and remarks at the end."""
    lines: Int[np.ndarray, " row"]
    """Line of the file of each row, counted from 1."""
    body: str
    """The rows as text."""
    width: int
    """Most cells in a row; those that have no name are empty."""
    first: dict[str, str]
    """The first cell of each column that is not empty, within the first rows; "" where there is none."""
    error: type[SidestepError]

    def read(self, *names: str) -> dict[str, Cells]:
        """The cells of some columns, by name."""
        import pandas as pd

        wanted = sorted(map(self.names.index, names))
        number: dict[int, dict[str, int]] = {column: {} for column in wanted}
        code: dict[int, list[Any]] = {column: [] for column in wanted}
        try:
            for frame in pd.read_csv(
                io.StringIO(self.body),
                sep=self.delimiter,
                header=None,
                names=list(range(self.width)),
                usecols=wanted,
                index_col=False,
                dtype=object,  # as text, which is faster than as pandas' own texts
                keep_default_na=False,
                skipinitialspace=True,
                chunksize=_CHUNK,
            ):
                for column, known in number.items():
                    codes, texts = pd.factorize(frame[column])
                    numbers = [known.setdefault(str(text).strip(), len(known)) for text in texts]
                    code[column].append(np.array(numbers, np.int64)[codes])
        except (pd.errors.ParserError, pd.errors.EmptyDataError, MemoryError, OverflowError) as found:
            raise self.error(f"{self.source}: not a table: {' '.join(str(found).split()):.200}") from found
        cells = {column: Cells(tuple(number[column]), np.concatenate(code[column])) for column in wanted}
        if any(len(each.code) != len(self.lines) for each in cells.values()):
            raise self.error(f"{self.source}: not a table: quotes are not closed, or line breaks stand in them")
        return {self.names[column]: each for column, each in cells.items()}

    def refuse(self, row: int, column: str | None, problem: str) -> SidestepError:
        """An error about a row, or about its cell in one column."""
        cell = "" if column is None else f", column {quoted(column)}"
        line = int(self.lines[row])
        return self.error(f"{self.source}: line {line}{cell}: {' '.join(problem.split())}", field=column, line=line)

    def refuse_any(self, column: str, cells: Cells, wrong: Bool[np.ndarray, " row"], problem: str) -> None:
        """Raise an error about the first wrong cell of a column, if there is one; its message begins with the cell."""
        if wrong.any():
            row = int(np.argmax(wrong))
            raise self.refuse(row, column, f"{quoted(cells.texts[cells.code[row]])} {problem}")


def open_sheet(path: Path, error: type[SidestepError], known: Callable[[str], bool]) -> Sheet:
    """Find separator, header and rows of a file, and check that every row has the header's cells.

    Columns are separated by commas, semicolons, tabs or ``|``. Lines above the header, blank lines, and separators at
    the ends of lines are skipped; so are units between the header and the rows, and totals and remarks below the rows.

    Parameters
    ----------
    path
        The file, in UTF-8 or, with a byte-order mark, UTF-16.
    error
        Type of the errors about it.
    known
        Whether a name is one that a header must have: where several lines may be the header, it is the one that has it.

    Returns
    -------
    sheet
        Ready to read its columns.

    Raises
    ------
    SidestepError
        Of type ``error``: a file that is not readable, not text or empty; a header with an empty name or the same name
        twice; a row with more or fewer cells than the header; no row below the header.
    """
    text = decoded(path, error).replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise error(f"{path}: the file is empty")
    if _COMMA_IN_DATE.search(text, 0, 1 << 16):
        text = _COMMA_IN_DATE.sub(r"\1", text)
    lines = text.rstrip("\n").split("\n")
    delimiter, header = _header(lines, known)
    rows = _rows(path, lines, header, delimiter, error)
    names, found = _names(path, list(rows), delimiter, header + 1, error)
    begin, end = _without_asides(found, delimiter)
    kept: list[str] = []
    numbers: list[int] = []
    width = len(names)
    first = dict.fromkeys(names, "")
    for line, number, whole in found[begin:end]:
        if number != len(names):
            if number < len(names) or any(_split(whole, delimiter)[len(names) :]):
                raise error(f"{path}: line {line} has {number} cells, the header has {len(names)}", line=line)
            width = max(width, number)
        kept.append(whole)
        numbers.append(line)
    for whole in kept[:_SAMPLE]:
        cells = _split(whole, delimiter)
        first = {name: seen or cell for (name, seen), cell in zip(first.items(), cells, strict=False)}
    check_rows(path, len(kept), error)
    skipped = sum(bool(line.strip()) for line in lines[:header])
    body = "\n".join(kept)
    aside = len(found) - len(kept)
    return Sheet(str(path), tuple(names), delimiter, skipped, aside, np.array(numbers), body, width, first, error)


def _names(
    path: Path, rows: list[_Row], delimiter: str, line: int, error: type[SidestepError]
) -> tuple[list[str], list[_Row]]:
    """The names in the header, which is the first of the rows, and the other rows."""
    cells = _split(rows[0][2], delimiter) if rows else []
    names = [" ".join(name.split()) for name in cells]
    while names and not names[-1]:
        names.pop()
    if not names:
        raise error(f"{path}: no header and no rows")
    if not names[0] and len(rows) > 1 and len(names) > 1:  # as pandas writes an index
        first = "".join(_split(rows[1][2], delimiter)[:1])
        names[0] = "time" if like_time(first) and "time" not in names else "index"
    check_names(path, names, error, line)
    return names, rows[1:]


def _without_asides(rows: list[_Row], delimiter: str) -> tuple[int, int]:
    """The first of the rows that is one of the table, and the end of these rows."""
    of_table = (number for number, row in enumerate(rows) if not is_aside(_split(row[2], delimiter)))
    begin = next(of_table, len(rows))
    end = len(rows)
    while end > begin and is_aside(_split(rows[end - 1][2], delimiter)):
        end -= 1
    return begin, end


def _rows(path: Path, lines: list[str], header: int, delimiter: str, error: type[SidestepError]) -> Iterator[_Row]:
    """Line number, number of cells and text of each row that is not blank, from the header on."""
    blank = f' \t"{delimiter}'
    if not any('"' in line for line in lines[header:]):  # most files; counting is much faster
        for number, line in enumerate(lines[header:], header + 1):
            if line.strip(blank):
                yield number, line.count(delimiter) + 1, line
        return
    reader = csv.reader(
        (f"{line}\n" for line in lines[header:]), delimiter=delimiter, strict=True, skipinitialspace=True
    )
    before = header
    try:
        for cells in reader:
            first, before = before, header + reader.line_num
            if any(map(str.strip, cells)):
                yield before, len(cells), "\n".join(lines[first:before])
    except csv.Error as found:
        last = header + reader.line_num
        raise error(f"{path}: line {last}: not separated values: {found}", line=last) from found


def _header(lines: list[str], known: Callable[[str], bool]) -> tuple[str, int]:
    """The separator, and which line is the header, counted from 0."""
    sample = [number for number, line in enumerate(lines[: 10 * _SAMPLE]) if line.strip()][:_SAMPLE]
    best: tuple[Any, str, int] = ((), ",", sample[0])
    for delimiter in DELIMITERS:
        cells = {number: _split(lines[number], delimiter) for number in sample}
        widths = Counter(len(row) for row in cells.values() if len(row) > 1)
        if not widths:
            continue
        width = max(widths, key=lambda each: (widths[each], each))
        found = _header_among(cells, sample, width, known)
        score = (found is not None and any(map(known, cells[found])), found is not None, widths[width], width)
        best = max(best, (score, delimiter, sample[0] if found is None else found), key=lambda each: each[0])
    return best[1], best[2]


def _header_among(
    cells: dict[int, list[str]], sample: list[int], width: int, known: Callable[[str], bool]
) -> int | None:
    """The first line of names, as many as there are columns, with a line of data below it."""
    candidates = []
    for number, below in zip(sample, [*sample[1:], None], strict=True):
        names = list(cells[number])
        while names and not names[-1]:
            names.pop()
        as_wide = len(names) > 1 and all(names) and abs(len(cells[number]) - width) <= 1
        if any(map(known, names)) and as_wide:
            return number
        data_below = below is None or any(map(like_data, cells[below]))
        if as_wide and data_below and not any(map(like_data, names)):
            candidates.append(number)
    return candidates[0] if candidates else None


def _split(line: str, delimiter: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return []
