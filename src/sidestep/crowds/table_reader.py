"""Reading tables of crowds from CSV or Parquet: which columns say where, when and how much; what is filled in."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Int

from sidestep.crowds.base import SLOT_SECONDS
from sidestep.crowds.columns import Columns, read_csv, read_parquet, typical_step
from sidestep.crowds.crowd_table import (
    LARGEST,
    MOST_CELLS,
    QUANTITIES,
    CrowdTable,
    Quantity,
    TableError,
    TableRepair,
    street_hash,
)
from sidestep.network.town import Town

MOST_SLOTS = 366 * 24 * 12  # a year of five minutes; more is a wrong column

_PLACES = ("street", "segment", "from", "to")
_DIRECTIONS = ("forward", "backward")
_KNOWN = (*_PLACES, "direction", "slot", "time", *QUANTITIES)


def read_table(path: str | Path, town: Town, slot_seconds: float | None = None) -> CrowdTable:
    """Read a table of crowds from a .csv or .parquet file.

    Its columns are a place, a time and a value; docs/counts.md lists them. Slots that a mentioned segment lacks are
    filled linearly in time and reported; segments that are not mentioned are empty.

    Parameters
    ----------
    path
        The file.
    town
        The town whose streets, segments or crossings the table names.
    slot_seconds
        Length of a slot, where the table does not have two times or more; by default 300.

    Returns
    -------
    table
        With a value for every mentioned segment in every slot.

    Raises
    ------
    TableError
        A file that is not readable or breaks a rule; ``field`` is the column, ``line`` the line or row.
    """
    columns = _read(Path(path))
    place, clock, quantity = _choose(columns)
    value = columns.numbers(quantity, *LARGEST[quantity])
    # Entries are the values of segments: a street without a direction makes one for each way in which it is walked.
    entries = _entries(columns, place, town)
    begins = None
    if clock == "slot":
        slot, step = columns.whole_numbers("slot"), slot_seconds or SLOT_SECONDS
        columns.refuse_any("slot", slot < 0, "is negative")
        columns.refuse_any("slot", slot >= MOST_SLOTS, f"is more than the largest number, {MOST_SLOTS - 1}")
    else:
        seconds = columns.times("time")
        _check_order(columns, entries.assign(second=seconds[entries["row"]]))
        slot, step = _slots(columns, seconds, slot_seconds)
        begins = datetime.fromtimestamp(int(seconds.min()), UTC).replace(tzinfo=None)
    entries = entries.assign(slot=slot[entries["row"]], value=value[entries["row"]])
    _check_twice(columns, entries)
    slots, segments = int(slot.max()) + 1, len(town.street_of_segment()[0])
    mentioned = entries["segment"].nunique()
    if slots * mentioned > MOST_CELLS:
        raise columns.refuse(int(slot.argmax()), clock, f"{slots:,} slots of {mentioned:,} segments are too many")
    # No two entries are added up: there is one for each slot and segment at most.
    table = entries.pivot(index="slot", columns="segment", values="value").reindex(range(slots))  # noqa: PD010
    return CrowdTable(
        source=str(path),
        quantity=quantity,
        segment=table.columns.to_numpy(np.int32),
        value=table.interpolate(limit_direction="both").to_numpy(np.float32),
        slot_seconds=float(step),
        begins=begins,
        segments=segments,
        streets=street_hash(town),
        rows=columns.rows,
        unused=tuple(name for name in columns.cells if name not in _KNOWN),
        repairs=_repairs(table.isna().to_numpy(), segments - mentioned),
    )


def _read(path: Path) -> Columns:
    match path.suffix.lower():
        case ".csv":
            return read_csv(path, TableError, fold_case=True)
        case ".parquet":
            return read_parquet(path, TableError)
    raise TableError(f"{path} is no table of crowds; give a file whose name ends in .csv or .parquet")


def _choose(columns: Columns) -> tuple[str, str, Quantity]:
    """Which columns say where, when and how much."""
    if ("from" in columns) != ("to" in columns):
        raise TableError(f"{columns.source}: the columns from and to go together; add the other one", field="from")
    place = _one_of(columns, ("street", "segment", "from"))
    if "direction" in columns and place != "street":
        raise TableError(f"{columns.source}: the column direction goes with the column street only", field="direction")
    quantity: Quantity = _one_of(columns, QUANTITIES)  # type: ignore[assignment]
    return place, _one_of(columns, ("slot", "time")), quantity


def _one_of(columns: Columns, choice: tuple[str, ...]) -> str:
    found = [name for name in choice if name in columns]
    if len(found) != 1:
        wanted, has = " or ".join(choice).replace("from", "from and to"), " and ".join(found) or "none of them"
        raise TableError(f"{columns.source}: needs one column {wanted}, and has {has}", field=choice[0])
    return found[0]


def _entries(columns: Columns, place: str, town: Town) -> pd.DataFrame:
    """The rows and segments of all entries, by row."""
    if place != "street":
        segments = len(town.street_of_segment()[0])
        segment = _between(columns, town) if place == "from" else _numbered(columns, "segment", segments)
        return pd.DataFrame({"row": np.arange(columns.rows), "segment": segment})
    street = _numbered(columns, "street", town.streets)
    direction = np.array(list(map(str, columns.cells.get("direction", [""] * columns.rows))))
    columns.refuse_any(
        "direction", ~np.isin(direction, ["", *_DIRECTIONS]), "is neither forward nor backward nor empty"
    )
    columns.refuse_any(
        "direction", (direction == "backward") & town.one_way[street], "is not how this street is walked"
    )
    backward = town.streets - 1 + np.cumsum(~town.one_way)  # number of the segment that leads back
    there = np.flatnonzero(direction != "backward")
    back = np.flatnonzero((direction != "forward") & ~town.one_way[street])
    entries = pd.DataFrame(
        {"row": np.concatenate([there, back]), "segment": np.concatenate([street[there], backward[street[back]]])}
    )
    return entries.sort_values("row", kind="stable", ignore_index=True)


def _numbered(columns: Columns, column: str, count: int) -> Int[np.ndarray, " row"]:
    """A column of numbers below a count."""
    number = columns.whole_numbers(column)
    columns.refuse_any(column, (number < 0) | (number >= count), f"is not one of 0 to {count - 1}")
    return number


def _between(columns: Columns, town: Town) -> Int[np.ndarray, " row"]:
    """Segments from one crossing to another."""
    street, backwards = town.street_of_segment()
    tail = town.ids[np.where(backwards, town.head[street], town.tail[street])]
    head = town.ids[np.where(backwards, town.tail[street], town.head[street])]
    ends = [columns.whole_numbers("from"), columns.whole_numbers("to")]
    for column, crossing in zip(("from", "to"), ends, strict=True):
        columns.refuse_any(column, ~np.isin(crossing, town.ids), "is no crossing of this town")
    pairs, asked = pd.MultiIndex.from_arrays([tail, head]), pd.MultiIndex.from_arrays(ends)
    several = pairs.duplicated(keep=False)
    for wrong, problem in (
        (~asked.isin(pairs), "is not where a street leads from there"),
        (asked.isin(pairs[several]), "is where several streets lead from there; give numbers in a column street"),
    ):
        columns.refuse_any("to", wrong, problem)
    return np.flatnonzero(~several)[pairs[~several].get_indexer(asked)]


def _check_order(columns: Columns, entries: pd.DataFrame) -> None:
    """Times of one segment must ascend; segments may follow one another or take turns."""
    of_segment = entries.groupby("segment")
    wrong = (of_segment["second"].diff() < 0).to_numpy()
    if wrong.any():
        late, early = (int(rows.iloc[np.argmax(wrong)]) for rows in (entries["row"], of_segment["row"].shift()))
        time, before = columns.cells["time"][late], f"{columns.line} {columns.lines[early]}"
        raise columns.refuse(late, "time", f"{time} comes before the time in {before}")


def _slots(
    columns: Columns, seconds: Int[np.ndarray, " row"], slot_seconds: float | None
) -> tuple[Int[np.ndarray, " row"], float]:
    """Numbers of slots and their length, the typical step of the times."""
    every = np.unique(seconds)
    if len(every) == 1:
        return np.zeros(len(seconds), np.int64), slot_seconds or SLOT_SECONDS
    step = typical_step(every)
    if slot_seconds is not None and step != slot_seconds:
        raise TableError(f"{columns.source}: times are {step} s apart, not {slot_seconds:g}", field="time")
    since = seconds - every[0]
    begins = np.datetime64(int(every[0]), "s")
    columns.refuse_any(
        "time", since % step != 0, f"is not a whole number of steps of {step} s after the first time, {begins}"
    )
    slot = since // step
    columns.refuse_any("time", slot >= MOST_SLOTS, f"is more than {MOST_SLOTS} steps of {step} s after the first time")
    return slot, float(step)


def _check_twice(columns: Columns, entries: pd.DataFrame) -> None:
    """No segment may have two values in one slot."""
    twice = entries.duplicated(["segment", "slot"]).to_numpy()
    if twice.any():
        again, segment, slot = entries[["row", "segment", "slot"]].to_numpy()[np.argmax(twice)].tolist()
        same = ((entries["segment"] == segment) & (entries["slot"] == slot)).to_numpy()
        first = columns.lines[entries["row"].iloc[np.argmax(same)]]
        raise columns.refuse(again, None, f"segment {segment} in slot {slot} stands in {columns.line} {first} already")


def _repairs(missing: Bool[np.ndarray, "slot mentioned"], empty: int) -> tuple[TableRepair, ...]:
    found = []
    if missing.any():
        some = int(missing.any(axis=0).sum())
        detail = f"slots without a row, of {some} segments: filled linearly in time from those before and after"
        found.append(TableRepair("gap", int(missing.sum()), detail))
    if empty:
        found.append(TableRepair("not mentioned", empty, "segments without any row: nobody is there"))
    return tuple(found)
