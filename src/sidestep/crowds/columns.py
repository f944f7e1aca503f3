"""Columns of a CSV or Parquet file, read cell by cell, so that errors name the line and the column.

The only module that imports pyarrow. The CSV reader is the standard library's: pandas fills short rows silently and
does not know on which line a row stands.
"""

import codecs
import csv
import io
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from functools import cache, partial
from pathlib import Path
from reprlib import repr as quoted  # shortened: a damaged file's "cell" can be megabytes long
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from sidestep.errors import SidestepError
from sidestep.files import reason

MOST_ROWS = 20_000_000  # more would not fit into memory as text
MOST_BYTES = 2**31

Numbers = Float[np.ndarray, " row"]
WholeNumbers = Int[np.ndarray, " row"]

_NO_TEXT = {
    b"\x1f\x8b": "packed by gzip; unpack it first",
    b"PK\x03\x04": "an Excel workbook or a zip archive; save its table as CSV, or unpack it first",
    b"\xd0\xcf\x11\xe0": "an Excel workbook; save its table as CSV",
    b"PAR1": "Parquet, not text; save it as CSV",
    b"SQLite": "a database, not text; save its table as CSV",
}
"""How files begin that are often taken for text with columns, and what they are."""
_NO_COLUMNS = re.compile(r"\s*(?:<(?P<markup>!doctype|html|\?xml)|[\[{]\s*(?P<json>[\[{\"]))", re.IGNORECASE)
_WHOLE = re.compile(r"[-+]?[0-9]{1,19}")
_DIGITS = 18  # that a whole number may have


@dataclass(frozen=True)
class Columns:
    """The cells of a file by column, and where they stand.

    Methods raise errors of the type ``error``; their ``field`` is the column, their ``line`` the line or row.
    """

    source: str
    """Name of the file."""
    cells: dict[str, list[Any]]
    """Text without blanks around it from CSV, "" where a cell is empty; Python objects from Parquet."""
    lines: list[int]
    """Line of the file, or number of the row counted from 1, for each row of cells."""
    error: type[SidestepError]
    """Type of the errors that the methods raise."""
    line: str = "line"
    """The word for an entry of ``lines``."""

    def refuse(self, row: int, column: str | None, problem: str) -> SidestepError:
        """An error about a row, or about its cell in one column."""
        cell = "" if column is None else f", column {quoted(column)}"
        where = f"{self.source}: {self.line} {self.lines[row]}{cell}"
        return self.error(f"{where}: {' '.join(problem.split())}", field=column, line=self.lines[row])

    def refuse_any(self, column: str, wrong: Bool[np.ndarray, " row"], problem: str) -> None:
        """Raise an error about the first wrong cell of a column, if there is one; its message begins with the cell."""
        if wrong.any():
            row = int(np.argmax(wrong))
            raise self.refuse(row, column, f"{quoted(self.cells[column][row])} {problem}")

    def whole_numbers(self, column: str) -> WholeNumbers:
        """A column of whole numbers."""
        return np.fromiter(self._parsed(column, cache(_whole)), np.int64)

    def numbers(self, column: str, largest: float, unit: str, *, empty: float | None = None) -> Numbers:
        """A column of numbers from 0 to ``largest``; ``empty`` is the value of empty cells, where they are allowed."""
        values = np.fromiter(self._parsed(column, partial(_number, empty=empty)), np.float64)
        self.refuse_any(column, values < 0, "is negative")
        self.refuse_any(column, values > largest, f"is more than {largest:g} {unit}")
        return values

    def times(self, column: str) -> WholeNumbers:
        """A column of local wall times without an offset, in whole seconds since 1970."""
        return np.fromiter(self._parsed(column, cache(_seconds)), np.int64)

    def _parsed(self, column: str, parse: Callable[[Any], Any]) -> Iterator[Any]:
        """Every cell of a column parsed; a ``ValueError`` of ``parse`` becomes the sentence about the cell."""
        for row, cell in enumerate(self.cells[column]):
            try:
                yield parse(cell)
            except (ValueError, TypeError) as error:
                raise self.refuse(row, column, str(error)) from error


def read_csv(path: Path, error: type[SidestepError], *, fold_case: bool = False) -> Columns:
    """Read a comma-separated file with a header; blank lines are skipped.

    Parameters
    ----------
    path
        The file, in UTF-8.
    error
        Type of the errors about it.
    fold_case
        Whether names of columns become lower-case.

    Returns
    -------
    columns
        All columns, in their order in the file.

    Raises
    ------
    SidestepError
        Of type ``error``: a file that is not readable, not text or empty; a header with an empty name or the same name
        twice; a line with more or fewer cells than the header; no line below the header.
    """
    reader = csv.reader(io.StringIO(decoded(path, error), newline=""), strict=True)
    rows = filter(any, ([cell.strip() for cell in cells] for cells in reader))
    kept, lines = [], []
    try:
        names = [name.lower() if fold_case else name for name in next(rows, [])]
        check_names(path, names, error, reader.line_num)
        for cells in rows:
            if len(cells) != len(names):
                said = f"{len(cells)} cells, the header has {len(names)}"
                raise error(f"{path}: line {reader.line_num} has {said}", line=reader.line_num)
            kept.append(cells)
            lines.append(reader.line_num)
    except csv.Error as found:
        line = reader.line_num
        raise error(f"{path}: line {line}: not comma-separated values: {found}", line=line) from found
    check_rows(path, len(kept), error)
    return Columns(str(path), dict(zip(names, map(list, zip(*kept, strict=True)), strict=True)), lines, error)


def read_parquet(path: Path, error: type[SidestepError]) -> Columns:
    """Read a Parquet file; as `read_csv` with lower-case names, but errors count rows from 1, and pyarrow is needed."""
    data = _content(path, error)
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as found:
        raise error(f"{path}: Parquet takes pyarrow: pip install 'sidestep[parquet]'") from found
    try:
        file = parquet.ParquetFile(pa.BufferReader(data))
        names = [name.strip().lower() for name in file.schema_arrow.names]
        check_names(path, names, error, None)
        check_rows(path, file.metadata.num_rows, error)
        cells = {
            name: list(map(_stripped, column.to_pylist()))
            for name, column in zip(names, file.read().columns, strict=True)
        }
    except SidestepError:
        raise
    except (pa.ArrowException, OSError, LookupError, TypeError, ValueError, ArithmeticError, MemoryError) as found:
        said = " ".join(str(found).split()) or type(found).__name__
        raise error(f"{path}: damaged, or not a Parquet file: {said:.200}") from found
    return Columns(str(path), cells, list(range(1, 1 + file.metadata.num_rows)), error, "row")


def typical_step(ascending: Int[np.ndarray, " time"]) -> int:
    """The median difference of two or more ascending whole numbers, the lower one of two: gaps hardly change it."""
    return int(np.quantile(np.diff(ascending), 0.5, method="lower"))


def decoded(path: Path, error: type[SidestepError]) -> str:
    """The text of a file in UTF-8, or in UTF-16 with a byte-order mark."""
    data = _content(path, error)
    if said := next((said for begins, said in _NO_TEXT.items() if data.startswith(begins)), ""):
        raise error(f"{path}: it is {said}")
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as found:
        said = f"not a text file in UTF-8: byte {found.start} cannot be read; save it as UTF-8"
        raise error(f"{path}: {said}") from found
    if "\0" in text:
        raise error(f"{path}: not a text file: it contains null characters")
    if other := _NO_COLUMNS.match(text):
        said = "a web page or XML" if other["markup"] else "JSON"
        raise error(f"{path}: it is {said}, not text with columns; save its table as CSV")
    return text


def _content(path: Path, error: type[SidestepError]) -> bytes:
    try:
        too_large = path.stat().st_size > MOST_BYTES
        data = b"" if too_large else path.read_bytes()
    except (OSError, ValueError) as found:  # ValueError: a path with a null character
        said = reason(found) if isinstance(found, OSError) else str(found)
        raise error(f"{path}: cannot be read: {said}") from found
    if too_large:
        raise error(f"{path}: larger than {MOST_BYTES >> 30} GiB; split it into several files")
    if not data.strip():
        raise error(f"{path}: the file is empty")
    return data


def check_rows(path: Path, rows: int, error: type[SidestepError]) -> None:
    """Refuse a table without rows, or with more than fit into memory."""
    if not rows:
        raise error(f"{path}: no rows below the header")
    if rows > MOST_ROWS:
        raise error(f"{path}: more than {MOST_ROWS:,} rows; split it into several files")


def check_names(path: Path, names: list[str], error: type[SidestepError], line: int | None) -> None:
    """Refuse columns without a name, and two of the same name; ``line`` is that of the header."""
    for number, name in enumerate(names):
        if not name:
            raise error(f"{path}: column {number + 1} of the header has no name", line=line)
        if name in names[:number]:
            raise error(f"{path}: column {quoted(name)} appears twice in the header", field=name, line=line)


def _stripped(cell: Any) -> Any:
    return "" if cell is None else cell.strip() if isinstance(cell, str) else cell


def _whole(cell: Any) -> int:
    is_text = isinstance(cell, str) and _WHOLE.fullmatch(cell)
    if not (is_text or (isinstance(cell, int | float) and not isinstance(cell, bool) and cell % 1 == 0)):
        raise _no("a whole number", cell)
    if abs(number := int(cell)) >= 10**_DIGITS:
        raise _no(f"a whole number of at most {_DIGITS} digits", cell)
    return number


def _number(cell: Any, empty: float | None) -> float:
    if cell == "" and empty is not None:
        return empty
    try:
        value = math.nan if isinstance(cell, bool) else float(cell)
    except (ValueError, TypeError, OverflowError):
        value = math.nan
    if not math.isfinite(value) or (isinstance(cell, str) and "_" in cell):  # float() also takes 1_000
        raise _no("a finite number", cell)
    return value


def _seconds(cell: Any) -> int:
    try:
        time = datetime.fromisoformat(cell) if isinstance(cell, str) else cell
        since = time - datetime(1970, 1, 1, tzinfo=time.tzinfo)
    except (ValueError, AttributeError) as error:
        raise _no("an ISO 8601 time such as 2025-05-24T12:30", cell) from error
    if time.tzinfo is not None:
        raise _no("local wall time: it has an offset", cell)
    if time.microsecond:
        raise _no("in whole seconds", cell)
    return int(since.total_seconds())


def _no(wanted: str, cell: Any) -> ValueError:
    return ValueError("is empty" if cell == "" else f"{quoted(cell)} is not {wanted}")
