"""Tables in files: columns of a CSV or Parquet file, checked cell by cell. The only module that imports pyarrow."""

import csv
import io
import math
import re
import reprlib
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from sidestep.errors import SidestepError
from sidestep.files import reason

SUFFIXES = (".csv", ".parquet")
MOST_ROWS = 20_000_000  # more would not fit into memory as text
MOST_BYTES = 2**31

_WHOLE = re.compile(r"[-+]?[0-9]{1,19}")
_DIGITS = 18  # that a whole number may have


class TableError(SidestepError):
    """A table of crowds that cannot be used. One sentence that names the file and the line or row, and the column."""


@dataclass(frozen=True)
class Columns:
    """What a file holds: for each column its cells, and where each of them stands."""

    source: str
    cells: dict[str, list[Any]]  # text from CSV; whatever Parquet has, None where it is missing
    lines: list[int]  # of the file, or rows counted from 1
    line: str  # what these are called

    def __contains__(self, name: str) -> bool:
        return name in self.cells

    @property
    def rows(self) -> int:
        """Number of rows below the header."""
        return len(self.lines)

    def where(self, row: int, column: str | None = None) -> str:
        """The beginning of a sentence about one row, or one cell."""
        return f"{self.source}: {self.line} {self.lines[row]}" + ("" if column is None else f", column {column}")

    def refuse(self, row: int, column: str | None, what: str) -> TableError:
        """An error about one row or cell."""
        return TableError(f"{self.where(row, column)}: {' '.join(what.split())}")

    def whole(self, column: str) -> Int[np.ndarray, " row"]:
        """A column of whole numbers.

        Raises
        ------
        TableError
            A cell that is none.
        """
        return np.array(self._each(column, _whole), np.int64)

    def numbers(self, column: str, largest: float, unit: str) -> Float[np.ndarray, " row"]:
        """A column of numbers from 0 to ``largest``.

        Raises
        ------
        TableError
            A cell that is none, is negative or larger.
        """
        values = np.array(self._each(column, _number), np.float64)
        for wrong, said in ((values < 0, "is negative"), (values > largest, f"is more than {largest:g} {unit}")):
            if wrong.any():
                row = int(np.argmax(wrong))
                raise self.refuse(row, column, f"{_quoted(self.cells[column][row])} {said}")
        return values

    def times(self, column: str) -> Int[np.ndarray, " row"]:
        """A column of local wall times, in seconds since 1970.

        Raises
        ------
        TableError
            A cell that is none, has an offset or parts of a second.
        """
        seen: dict[Any, int] = {}  # one time usually stands in many rows

        def once(cell: object) -> int:
            if cell not in seen:
                seen[cell] = _seconds(cell)
            return seen[cell]

        return np.array(self._each(column, once), np.int64)

    def words(self, column: str, allowed: tuple[str, ...]) -> list[str]:
        """A column of some words; "" where it is empty.

        Raises
        ------
        TableError
            Another word.
        """

        def word(cell: object) -> str:
            text = "" if cell is None else cell.strip() if isinstance(cell, str) else None
            if text is None or text not in ("", *allowed):
                raise ValueError(f"must be {' or '.join(allowed)}, or empty for both, not {_quoted(cell)}")
            return text

        return self._each(column, word)

    def _each(self, column: str, read: Callable[[Any], Any]) -> list[Any]:
        row = 0
        found = []
        try:
            for row, cell in enumerate(self.cells[column]):  # noqa: B007 - the number is needed when it fails
                found.append(read(cell))
        except (ValueError, TypeError) as error:
            raise self.refuse(row, column, str(error)) from error
        return found


def read_columns(path: Path) -> Columns:
    """Read a .csv or .parquet file; names of columns in lower case.

    Raises
    ------
    TableError
        A file that cannot be read or has no rows, another ending, a column without a name or with another's.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise TableError(f"{path} names no format for tables; its name must end in {' or '.join(SUFFIXES)}")
    try:
        if path.stat().st_size > MOST_BYTES:
            raise TableError(f"{path}: larger than {MOST_BYTES >> 30} GiB; cut it into several tables")
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        said = reason(error) if isinstance(error, OSError) else str(error)
        raise TableError(f"{path}: cannot be read: {said}") from error
    if not data.strip():
        raise TableError(f"{path}: the file is empty")
    columns = _read_csv(str(path), data) if suffix == ".csv" else _read_parquet(str(path), data)
    if not columns.rows:
        raise TableError(f"{path}: no rows below the header")
    return columns


def _read_csv(source: str, data: bytes) -> Columns:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise TableError(f"{source}: not a text file (UTF-8): byte {error.start} cannot be read") from error
    if "\0" in text:
        raise TableError(f"{source}: not a text file: it contains null characters")
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    names: list[str] = []
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if not names:
                names = _names(source, cells)
                continue
            if len(cells) != len(names):
                raise TableError(
                    f"{source}: line {reader.line_num} has {len(cells)} cells, the header has {len(names)}"
                )
            rows.append(cells)
            lines.append(reader.line_num)
            _check_rows(source, len(rows))
    except csv.Error as error:
        raise TableError(f"{source}: line {reader.line_num}: not comma-separated values: {error}") from error
    columns = [list(column) for column in zip(*rows, strict=True)] or [[] for _ in names]
    return Columns(source, dict(zip(names, columns, strict=True)), lines, "line")


def _read_parquet(source: str, data: bytes) -> Columns:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise TableError(f"{source}: Parquet takes pyarrow: pip install 'sidestep[parquet]'") from error
    try:
        file = parquet.ParquetFile(pa.BufferReader(data))
        names = _names(source, list(file.schema_arrow.names))
        _check_rows(source, file.metadata.num_rows)
        table = file.read()
        cells = {name: _cells(source, name, table.column(number)) for number, name in enumerate(names)}
    except TableError:
        raise
    except (pa.ArrowException, OSError, LookupError, TypeError, ValueError, ArithmeticError, MemoryError) as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise TableError(f"{source}: damaged, or not a Parquet file: {said:.200}") from error
    return Columns(source, cells, list(range(1, 1 + table.num_rows)), "row")


def _cells(source: str, name: str, column: Any) -> list[Any]:
    import pyarrow as pa

    if name == "time" and pa.types.is_timestamp(column.type):
        if column.type.tz is not None:
            raise TableError(
                f"{source}: column time has the time zone {column.type.tz}; give local wall time without one"
            )
        column = column.cast(pa.timestamp("us"))  # Python knows no nanoseconds
    return column.to_pylist()


def _check_rows(source: str, rows: int) -> None:
    if rows > MOST_ROWS:
        raise TableError(f"{source}: more than {MOST_ROWS:,} rows; cut it into several tables")


def _names(source: str, cells: list[str]) -> list[str]:
    names = [str(cell).strip().lower() for cell in cells]
    for number, name in enumerate(names):
        if not name:
            raise TableError(f"{source}: column {number + 1} of the header has no name")
        if name in names[:number]:
            raise TableError(f"{source}: column {_quoted(name)} appears twice in the header")
    return names


def _quoted(cell: object) -> str:
    return reprlib.repr(cell)  # shortened: a damaged file's "cell" can be megabytes long


def _whole(cell: object) -> int:
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        raise ValueError("is empty")
    if isinstance(cell, str) and _WHOLE.fullmatch(cell.strip()):
        number = int(cell)
    elif isinstance(cell, int) and not isinstance(cell, bool):
        number = cell
    elif isinstance(cell, float) and cell.is_integer():
        number = int(cell)
    else:
        raise ValueError(f"{_quoted(cell)} is not a whole number")
    if abs(number) >= 10**_DIGITS:
        raise ValueError(f"{_quoted(cell)} has more than {_DIGITS} digits")
    return number


def _number(cell: object) -> float:
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        raise ValueError("is empty; leave out rows that are not known")
    value = math.nan
    if isinstance(cell, str) and "_" not in cell:  # float() also takes 1_000
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
    elif isinstance(cell, int | float) and not isinstance(cell, bool):
        value = float(cell) if abs(cell) < 1e300 else math.inf
    if not math.isfinite(value):
        raise ValueError(f"{_quoted(cell)} is not a finite number")
    return value


def _seconds(cell: object) -> int:
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        raise ValueError("is empty")
    time = cell
    if isinstance(cell, str):
        try:
            time = datetime.fromisoformat(cell.strip())
        except ValueError as error:
            raise ValueError(f"{_quoted(cell)} is not an ISO 8601 time such as 2025-05-24T12:30") from error
    if not isinstance(time, datetime):
        raise ValueError(f"{_quoted(cell)} is not a time such as 2025-05-24T12:30")  # noqa: TRY004 - for the reader
    if time.tzinfo is not None:
        raise ValueError(f"{_quoted(str(cell))} has an offset; give local wall time without one")
    if time.microsecond:
        raise ValueError(f"{_quoted(str(cell))} has parts of a second")
    return int((time - datetime(1970, 1, 1)).total_seconds())  # noqa: DTZ001 - wall time
