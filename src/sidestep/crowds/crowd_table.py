"""Crowds as tables of (segment, slot, volume or speed), from any crowd simulator or counter system."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, Literal, get_args

import numpy as np
from jaxtyping import Float, Float32, Int, Int32

from sidestep.crowds.base import SLOT_SECONDS
from sidestep.crowds.table_columns import Columns, TableError, read_columns
from sidestep.files import check_unpacked, reading, whole_file
from sidestep.network.town import Town

FORMAT = 1  # of our own files; counts up when what they hold changes
SUFFIX = ".npz"

Quantity = Literal["volume", "speed", "density"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
LARGEST = {"volume": (1e6, "persons"), "speed": (13.0, "m/s"), "density": (20.0, "persons/m²")}
MOST_SLOTS = 366 * 24 * 12  # a year of five minutes; more is a wrong column
MOST_CELLS = 2**27  # segments x slots; half a GiB

_PLACES = ("street", "segment", "from", "to")
_DIRECTIONS = ("forward", "backward")
_KNOWN = (*_PLACES, "direction", "slot", "time", *QUANTITIES)
_STORED = ("format", "quantity", "segment", "value", "slot_seconds", "begins", "segments", "streets")


@dataclass(frozen=True)
class TableRepair:
    """Something that was missing from a table, and what was done about it."""

    kind: str
    number: int  # of segments, or of slots of segments, as the detail says
    detail: str


@dataclass(frozen=True, eq=False)
class CrowdTable:
    """What a table says about some segments of a town, in every slot. The others are empty."""

    source: str
    quantity: Quantity
    segment: Int32[np.ndarray, " mentioned"]  # of Town.network(), ascending
    value: Float32[np.ndarray, "slot mentioned"]  # persons on the segment, m/s or persons/m²
    slot_seconds: float
    begins: datetime | None  # local wall time of the first slot; None: the table does not know
    segments: int  # of the town
    streets: str  # hash of the town's list of streets
    rows: int = 0  # of the file that it was read from
    unused: tuple[str, ...] = ()  # columns of that file that mean nothing here
    repairs: tuple[TableRepair, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.segment, self.value):
            array.setflags(write=False)

    @property
    def slots(self) -> int:
        """Number of slots."""
        return len(self.value)

    def check_town(self, town: Town) -> None:
        """Refuse a town whose segments have other numbers.

        Raises
        ------
        TableError
            Another number of segments, or another list of streets.
        """
        segments = len(town.street_of_segment()[0])
        if segments != self.segments:
            raise TableError(f"{self.source}: made for a town of {self.segments} segments, but this one has {segments}")
        if street_hash(town) != self.streets:
            raise TableError(f"{self.source}: made for other streets; import the table anew with this town")


def street_hash(town: Town) -> str:
    """The same for the same streets in the same order, whatever their names and widths."""
    digest = hashlib.sha256()
    for part in (town.ids[town.tail], town.ids[town.head], town.one_way, town.length):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()[:32]


def read_table(path: str | Path, town: Town, slot_seconds: float | None = None) -> CrowdTable:
    """Read a table of crowds from a .csv or .parquet file.

    Its columns are a place, a time and a value; docs/counts.md has them all. Slots that a mentioned segment lacks are
    filled, linearly in time between those that are known, and reported; segments that are not mentioned are empty.

    Parameters
    ----------
    path
        The file.
    town
        Whose streets, segments or crossings it names.
    slot_seconds
        How long a slot is, where the table does not say it by two times or more; by default 300.

    Raises
    ------
    TableError
        A file that cannot be read or breaks a rule; the message names the line or row, and the column.
    """
    columns = read_columns(Path(path))
    place, clock, quantity = _choose(columns)
    value = columns.numbers(quantity, *LARGEST[quantity])
    row, segment = _segments(columns, place, town)
    begins = None
    if clock == "slot":
        slot, step = columns.whole("slot"), slot_seconds or SLOT_SECONDS
        _refuse_any(columns, "slot", slot < 0, "is negative")
        _refuse_any(columns, "slot", slot >= MOST_SLOTS, f"is more than the largest number, {MOST_SLOTS - 1}")
    else:
        seconds = columns.times("time")
        _check_order(columns, row, segment, seconds)
        slot, step = _slots(columns, seconds, slot_seconds)
        begins = datetime.fromtimestamp(int(seconds.min()), UTC).replace(tzinfo=None)
    segments = len(town.street_of_segment()[0])
    _check_twice(columns, row, slot[row], segment)
    slots = int(slot.max()) + 1
    mentioned, number = np.unique(segment, return_inverse=True)
    if slots * len(mentioned) > MOST_CELLS:
        raise columns.refuse(int(slot.argmax()), clock, f"{slots:,} slots of {len(mentioned):,} segments are too many")
    table = np.full((slots, len(mentioned)), np.nan)
    table[slot[row], number] = value[row]
    filled, repairs = _fill(table, segments - len(mentioned))
    return CrowdTable(
        source=str(path),
        quantity=quantity,
        segment=mentioned.astype(np.int32),
        value=filled.astype(np.float32),
        slot_seconds=float(step),
        begins=begins,
        segments=segments,
        streets=street_hash(town),
        rows=columns.rows,
        unused=tuple(name for name in columns.cells if name not in _KNOWN),
        repairs=repairs,
    )


def _choose(columns: Columns) -> tuple[str, str, Quantity]:
    """Which columns say where, when and how much."""
    source = columns.source
    places = [name for name in ("street", "segment") if name in columns]
    if "from" in columns or "to" in columns:
        if not ("from" in columns and "to" in columns):
            raise TableError(f"{source}: the columns from and to go together")
        places.append("from")
    if len(places) != 1:
        raise TableError(f"{source}: needs one of the columns street, segment, or from and to, and has {_some(places)}")
    if "direction" in columns and places != ["street"]:
        raise TableError(f"{source}: the column direction goes with the column street only")
    clocks = [name for name in ("slot", "time") if name in columns]
    if len(clocks) != 1:
        raise TableError(f"{source}: needs one of the columns slot and time, and has {_some(clocks)}")
    found: list[Quantity] = [name for name in QUANTITIES if name in columns]
    if len(found) != 1:
        raise TableError(f"{source}: needs one of the columns {', '.join(QUANTITIES)}, and has {_some(found)}")
    return places[0], clocks[0], found[0]


def _some(names: list[str] | list[Quantity]) -> str:
    return " and ".join(names) or "none"


def _refuse_any(columns: Columns, column: str, wrong: np.ndarray, what: str) -> None:
    if wrong.any():
        row = int(np.argmax(wrong))
        raise columns.refuse(row, column, f"{columns.cells[column][row]} {what}")


def _segments(columns: Columns, place: str, town: Town) -> tuple[Int[np.ndarray, " entry"], Int[np.ndarray, " entry"]]:
    """The rows and segments of all entries: a street without a direction makes one for each way it is walked."""
    segments = len(town.street_of_segment()[0])
    if place == "segment":
        segment = columns.whole("segment")
        _refuse_any(columns, "segment", (segment < 0) | (segment >= segments), f"is none of 0 to {segments - 1}")
        return np.arange(columns.rows), segment
    if place == "from":
        return np.arange(columns.rows), _between(columns, town)
    street = columns.whole("street")
    _refuse_any(columns, "street", (street < 0) | (street >= town.streets), f"is none of 0 to {town.streets - 1}")
    direction = np.array(columns.words("direction", _DIRECTIONS) if "direction" in columns else [""] * columns.rows)
    wrong = (direction == "backward") & town.one_way[street]
    if wrong.any():
        row = int(np.argmax(wrong))
        raise columns.refuse(row, "direction", f"street {street[row]} is not walked backward")
    backward = town.streets - 1 + np.cumsum(~town.one_way)  # number of the segment that leads back
    there = np.flatnonzero(direction != "backward")
    back = np.flatnonzero((direction != "forward") & ~town.one_way[street])
    return np.concatenate([there, back]), np.concatenate([street[there], backward[street[back]]])


def _between(columns: Columns, town: Town) -> Int[np.ndarray, " row"]:
    """Segments from one crossing to another."""
    street, backwards = town.street_of_segment()
    tail = town.ids[np.where(backwards, town.head[street], town.tail[street])]
    head = town.ids[np.where(backwards, town.tail[street], town.head[street])]
    ends = [columns.whole("from"), columns.whole("to")]
    for column, crossing in zip(("from", "to"), ends, strict=True):
        unknown = ~np.isin(crossing, town.ids)
        _refuse_any(columns, column, unknown, "is no crossing of this town")
    # A pair of crossings becomes one number: two ids would not fit into one.
    every = np.unique(town.ids)
    known = np.searchsorted(every, tail) * len(every) + np.searchsorted(every, head)
    asked = np.searchsorted(every, ends[0]) * len(every) + np.searchsorted(every, ends[1])
    order = np.argsort(known, kind="stable")
    first, last = (np.searchsorted(known[order], asked, side=side) for side in ("left", "right"))
    for wrong, said in ((last == first, "no street leads"), (last > first + 1, "several streets lead")):
        if wrong.any():
            row = int(np.argmax(wrong))
            more = "; give their numbers in a column street" if "several" in said else ""
            raise columns.refuse(row, "to", f"{said} from crossing {ends[0][row]} to {ends[1][row]}{more}")
    return order[first]


def _check_order(
    columns: Columns, row: Int[np.ndarray, " entry"], segment: Int[np.ndarray, " entry"], seconds: np.ndarray
) -> None:
    """Times of one segment must ascend; segments may follow one another or take turns."""
    order = np.lexsort((row, segment))
    before, after = order[:-1], order[1:]
    wrong = (segment[before] == segment[after]) & (seconds[row[after]] < seconds[row[before]])
    if wrong.any():
        late, early = min((int(row[j]), int(row[i])) for i, j in zip(before[wrong], after[wrong], strict=True))
        raise columns.refuse(
            late,
            "time",
            f"{columns.cells['time'][late]} comes before the time in {columns.line} {columns.lines[early]}",
        )


def _slots(
    columns: Columns, seconds: Int[np.ndarray, " row"], slot_seconds: float | None
) -> tuple[Int[np.ndarray, " row"], float]:
    """Numbers of slots and their length, which most times must be apart: gaps are welcome, but not as the rule."""
    every = np.unique(seconds)
    if len(every) == 1:
        return np.zeros(len(seconds), np.int64), slot_seconds or SLOT_SECONDS
    steps = np.sort(np.diff(every))
    step = int(steps[(len(steps) - 1) // 2])
    if slot_seconds is not None and step != slot_seconds:
        raise TableError(f"{columns.source}: times are {step} s apart, not {slot_seconds:g}")
    since = seconds - every[0]
    said = f"is not a whole number of steps of {step} s after the first time, {np.datetime64(int(every[0]), 's')}"
    _refuse_any(columns, "time", since % step != 0, said)
    slot = since // step
    _refuse_any(
        columns, "time", slot >= MOST_SLOTS, f"is more than {MOST_SLOTS} steps of {step} s after the first time"
    )
    return slot, float(step)


def _check_twice(columns: Columns, row: np.ndarray, slot: np.ndarray, segment: np.ndarray) -> None:
    order = np.lexsort((row, slot, segment))
    before, after = order[:-1], order[1:]
    same = (segment[before] == segment[after]) & (slot[before] == slot[after])
    if same.any():
        again, pick = min((int(row[j]), int(i)) for i, j in zip(before[same], after[same], strict=True))
        raise columns.refuse(
            again,
            None,
            f"segment {segment[pick]} in slot {slot[pick]} stands in {columns.line} {columns.lines[row[pick]]} already",
        )


def _fill(
    table: Float[np.ndarray, "slot mentioned"], empty: int
) -> tuple[Float[np.ndarray, "slot mentioned"], tuple[TableRepair, ...]]:
    """Linear in time between slots that are known; the first and the last known ones hold before and after them."""
    missing = np.isnan(table)
    number = np.arange(len(table))
    found = []
    if missing.any():
        some = np.flatnonzero(missing.any(axis=0))
        for column in some:
            known = ~missing[:, column]
            table[~known, column] = np.interp(number[~known], number[known], table[known, column])
        detail = f"slots without a row, of {len(some)} segments: filled linearly in time from those before and after"
        found.append(TableRepair("gap", int(missing.sum()), detail))
    if empty:
        found.append(TableRepair("not mentioned", empty, "segments without any row: nobody is there"))
    return table, tuple(found)


def save_crowd_table(table: CrowdTable, path: str | Path) -> None:
    """Write a table in our own format, whole or not at all; the same table gives the same bytes.

    Raises
    ------
    TableError
        A name that does not end in .npz.
    OutputError
        A place that cannot be written to.
    """
    path = check_suffix(Path(path))
    begins = "" if table.begins is None else table.begins.isoformat()
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            format=np.array(FORMAT),
            quantity=np.array(table.quantity),
            segment=table.segment,
            value=table.value,
            slot_seconds=np.array(table.slot_seconds),
            begins=np.array(begins),
            segments=np.array(table.segments),
            streets=np.array(table.streets),
        )


def check_suffix(path: Path) -> Path:
    """A name that a table can be saved under.

    Raises
    ------
    TableError
        Where it is another.
    """
    if path.suffix.lower() != SUFFIX:
        raise TableError(f"{path}: crowds are written as {SUFFIX}; give a name that ends so")
    return path


def load_crowd_table(path: str | Path) -> CrowdTable:
    """Read a table that `save_crowd_table` wrote.

    Raises
    ------
    TableError
        A file that is not there, cannot be read, is cut short or holds no table.
    """
    path = Path(path)
    with reading(path, TableError, "crowds") as file:
        return _read_npz(file, str(path))


def _read_npz(file: BinaryIO, source: str) -> CrowdTable:
    check_unpacked(file, TableError)
    with np.load(file, allow_pickle=False) as packed:
        columns = {name: packed[name] for name in _STORED if name in packed}
        _check_columns(columns)
        segment, value, time = columns["segment"], columns["value"], str(columns["begins"])
        table = CrowdTable(
            source=source,
            quantity=str(columns["quantity"]),  # type: ignore[arg-type]
            segment=segment,
            value=value,
            slot_seconds=float(columns["slot_seconds"]),
            begins=datetime.fromisoformat(time) if time else None,
            segments=int(columns["segments"]),
            streets=str(columns["streets"]),
        )
    _check(table)
    return table


def _check_columns(columns: Mapping[str, np.ndarray]) -> None:
    if "format" not in columns or "quantity" not in columns:
        raise TableError("it is not a table of crowds; sidestep counts import makes them")
    if columns["format"].shape or columns["format"] != FORMAT:
        raise TableError(f"it has table format {columns['format']!s:.20}, and this version reads {FORMAT}")
    segment, value = columns["segment"], columns["value"]
    if (segment.dtype, segment.ndim, value.dtype, value.ndim) != (np.dtype(np.int32), 1, np.dtype(np.float32), 2):
        raise TableError(f"its segments are {segment.dtype}, its values {value.dtype}")
    if not value.size or value.shape[1] != len(segment):
        raise TableError(f"it has values of shape {value.shape} for {len(segment)} segments")
    if str(columns["quantity"]) not in QUANTITIES:
        raise TableError(f"it holds none of {', '.join(QUANTITIES)}")


def _check(table: CrowdTable) -> None:
    segment, value = table.segment, table.value
    if segment.min() < 0 or segment.max() >= table.segments or (np.diff(segment) <= 0).any():
        raise TableError(f"its segments are not some of 0 to {table.segments - 1} in order")
    if not ((value >= 0) & (value <= LARGEST[table.quantity][0])).all():  # NaN is not
        raise TableError(f"it has values that are no {table.quantity}")
    if not 0 < table.slot_seconds < 1e9:
        raise TableError(f"its slots have {table.slot_seconds} s")
    if table.begins is not None and table.begins.tzinfo is not None:
        raise TableError("its time has an offset")
