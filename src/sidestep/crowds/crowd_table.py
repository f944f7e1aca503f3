"""Tables of crowds on whole streets: so many people, so fast or so dense on each segment in each slot."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float32, Int32

from sidestep.errors import SidestepError
from sidestep.files import check_unpacked, reading, whole_file
from sidestep.network.town import Town

FORMAT = 1  # of the files; counts up when what they hold changes

Quantity = Literal["volume", "speed", "density"]
LARGEST = {"volume": (1e6, "persons"), "speed": (13.0, "m/s"), "density": (20.0, "persons/m²")}
"""Largest value of each quantity, and its unit."""
MOST_CELLS = 2**27  # segments x slots; half a GiB

_STORED = ("quantity", "segment", "value", "slot_seconds", "begins", "segments", "streets")


class TableError(SidestepError):
    """A table of crowds that is not usable."""


@dataclass(frozen=True)
class TableRepair:
    """Something that was missing from a table, and what was done about it."""

    kind: str
    """``gap`` or ``not mentioned``."""
    number: int
    """How many segments, or slots of segments, as the detail says."""
    detail: str
    """What was done, in a few words."""


@dataclass(frozen=True, eq=False)
class CrowdTable:
    """Crowds on some segments of a town in every slot; the other segments are empty."""

    source: str
    """Name of the file."""
    quantity: Quantity
    """What the values are."""
    segment: Int32[np.ndarray, " mentioned"]
    """Numbers of the segments in ``Town.network()``, ascending."""
    value: Float32[np.ndarray, "slot mentioned"]
    """Persons on the segment, walking speed in m/s, or persons/m²."""
    slot_seconds: float
    """Length of a slot."""
    begins: datetime | None
    """Local wall time of the first slot; None where the table has no times."""
    segments: int
    """Number of segments of the town."""
    streets: str
    """Hash of the town's list of streets, by `street_hash`."""
    rows: int = 0
    """Number of rows of the file that was imported."""
    unused: tuple[str, ...] = ()
    """Columns of that file that mean nothing here."""
    repairs: tuple[TableRepair, ...] = ()
    """What the import filled in."""

    def __post_init__(self) -> None:
        for array in (self.segment, self.value):
            array.setflags(write=False)

    @property
    def slots(self) -> int:
        """Number of slots."""
        return len(self.value)

    def check_town(self, town: Town) -> None:
        """Check that a town has the streets that the table was made for.

        Raises
        ------
        TableError
            Another number of segments, or another list of streets.
        """
        segments, again = len(town.street_of_segment()[0]), "import the table again with this town"
        if segments != self.segments:
            towns = f"a town of {self.segments} segments, but this one has {segments}"
            raise TableError(f"{self.source}: made for {towns}; {again}", field="segments")
        if street_hash(town) != self.streets:
            raise TableError(f"{self.source}: made for other streets; {again}", field="streets")


def street_hash(town: Town) -> str:
    """Equal for equal streets in the same order, whatever their names and widths."""
    digest = hashlib.sha256()
    for part in (town.ids[town.tail], town.ids[town.head], town.one_way, town.length):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()[:32]


def save_crowd_table(table: CrowdTable, path: str | Path) -> None:
    """Write a table as .npz, whole or not at all; equal tables give equal bytes.

    Raises
    ------
    TableError
        A name that does not end in .npz.
    OutputError
        A place that does not take files.
    """
    path = check_suffix(Path(path))
    stored = {name: np.asarray(getattr(table, name)) for name in _STORED}
    stored["begins"] = np.asarray("" if table.begins is None else table.begins.isoformat())
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, format=np.array(FORMAT), **stored)


def check_suffix(path: Path) -> Path:
    """Make sure that the name of a table to be saved has the right ending.

    Returns
    -------
    path
        The same path.

    Raises
    ------
    TableError
        A name that does not end in .npz.
    """
    if path.suffix.lower() != ".npz":
        raise TableError(f"{path}: crowds are written as .npz; give a name that ends so", field="out")
    return path


def load_crowd_table(path: str | Path) -> CrowdTable:
    """Read a table that `save_crowd_table` wrote.

    Returns
    -------
    table
        As it was saved; of the import, only its results.

    Raises
    ------
    TableError
        A file that is not there, not readable, damaged, or no table of crowds; the ``field`` is the entry at fault.
    """
    path = Path(path)
    with reading(path, TableError, "crowds") as file:
        check_unpacked(file, TableError)
        with np.load(file, allow_pickle=False) as packed:
            stored = dict(packed)
        for field, wrong, problem in _faults(stored):
            if wrong:
                raise TableError(problem, field=field)
        begins = str(stored["begins"])
        scalars = {name: stored[name].item() for name in ("quantity", "slot_seconds", "segments", "streets")}
        time = datetime.fromisoformat(begins) if begins else None
        return CrowdTable(str(path), segment=stored["segment"], value=stored["value"], begins=time, **scalars)


def _faults(stored: Mapping[str, np.ndarray]) -> Iterator[tuple[str, bool, str]]:
    """Check a stored table, in order, since later checks rely on earlier ones: entry, whether it is wrong, message."""
    unknown = "format" not in stored or "quantity" not in stored
    yield "format", unknown, "it is not a table of crowds; make one with sidestep counts import"
    other = bool(stored["format"].shape) or stored["format"] != FORMAT
    said = f"{stored['format']!s:.20}, and this version reads {FORMAT}; import it again"
    yield "format", other, f"it has table format {said}"
    segment, value, quantity = stored["segment"], stored["value"], str(stored["quantity"])
    most, seconds, begins = int(stored["segments"]) - 1, float(stored["slot_seconds"]), str(stored["begins"])
    kinds = (segment.dtype, segment.ndim, value.dtype, value.ndim)
    wanted = (np.dtype(np.int32), 1, np.dtype(np.float32), 2)
    yield "value", kinds != wanted, f"its segments are {segment.dtype}, its values {value.dtype}"
    fits = value.size and value.shape[1] == len(segment)
    yield "value", not fits, f"it has values of shape {value.shape} for {len(segment)} segments"
    yield "quantity", quantity not in LARGEST, f"it holds none of {', '.join(LARGEST)}"
    ordered = segment.min() >= 0 and segment.max() <= most and (np.diff(segment) > 0).all()
    yield "segment", not ordered, f"its segments are not numbers from 0 to {most} in order"
    possible = (value >= 0) & (value <= LARGEST[quantity][0])  # NaN is not
    yield "value", not possible.all(), f"it has values that are no {quantity}"
    yield "slot_seconds", not 0 < seconds < 1e9, f"its slots have {seconds} s"
    yield "begins", bool(begins) and datetime.fromisoformat(begins).tzinfo is not None, "its time has an offset"
