"""Reading tables of crowds from CSV or Parquet: which columns say where, when and how much; what is filled in."""

from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from sidestep.crowds.base import SLOT_SECONDS
from sidestep.crowds.columns import Columns, WholeNumbers, read_csv, read_parquet, typical_step
from sidestep.crowds.crowd_table import LARGEST, MOST_CELLS, CrowdTable, Quantity, TableError, TableRepair, street_hash
from sidestep.network.town import Town

MOST_SLOTS = 366 * 24 * 12  # a year of five minutes; more is a wrong column

_KNOWN = {"street", "segment", "from", "to", "direction", "slot", "time", *LARGEST}
_READERS: dict[str, Callable[..., Columns]] = {".csv": partial(read_csv, fold_case=True), ".parquet": read_parquet}


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
    path = Path(path)
    if path.suffix.lower() not in _READERS:
        raise TableError(f"{path} is no table of crowds; give a file whose name ends in .csv or .parquet")
    columns = _READERS[path.suffix.lower()](path, TableError)
    place, quantity, clock = _choose(columns)
    value = columns.numbers(quantity, *LARGEST[quantity])
    # Entries are the values of segments: a street without a direction makes one for each way in which it is walked.
    entries = _entries(columns, place, town)
    if clock == "slot":
        slot, step, begins = columns.whole_numbers("slot"), slot_seconds or SLOT_SECONDS, None
        columns.refuse_any("slot", slot < 0, "is negative")
        columns.refuse_any("slot", slot >= MOST_SLOTS, f"is more than the largest number, {MOST_SLOTS - 1}")
    else:
        slot, step, begins = _slots(columns, entries, slot_seconds)
    entries = entries.assign(slot=slot[entries["row"]], value=value[entries["row"]])
    _check_twice(columns, entries)
    slots, mentioned, segments = int(slot.max()) + 1, entries["segment"].nunique(), len(town.street_of_segment()[0])
    if slots * mentioned > MOST_CELLS:
        raise columns.refuse(int(slot.argmax()), clock, f"{slots:,} slots of {mentioned:,} segments are too many")
    # No two entries are added up: there is one for each slot and segment at most.
    table = entries.pivot(index="slot", columns="segment", values="value").reindex(range(slots))  # noqa: PD010
    missing = table.isna()
    some = missing.any().sum()
    gaps = f"slots without a row, of {some} segments: filled linearly in time from those before and after"
    repairs = (
        TableRepair("gap", int(missing.to_numpy().sum()), gaps),
        TableRepair("not mentioned", segments - mentioned, "segments without any row: nobody is there"),
    )
    return CrowdTable(
        source=str(path),
        quantity=quantity,
        segment=table.columns.to_numpy(np.int32),
        value=table.interpolate(limit_direction="both").to_numpy(np.float32),
        slot_seconds=float(step),
        begins=begins,
        segments=segments,
        streets=street_hash(town),
        rows=len(columns.lines),
        unused=tuple(name for name in columns.cells if name not in _KNOWN),
        repairs=tuple(repair for repair in repairs if repair.number),
    )


def _choose(columns: Columns) -> tuple[str, Quantity, str]:
    """Which columns say where, how much and when."""
    if ("from" in columns.cells) != ("to" in columns.cells):
        raise TableError(f"{columns.source}: the columns from and to go together; add the other one", field="from")
    place = _one_of(columns, "street", "segment", "from")
    if "direction" in columns.cells and place != "street":
        raise TableError(f"{columns.source}: the column direction goes with the column street only", field="direction")
    return place, _one_of(columns, *LARGEST), _one_of(columns, "slot", "time")  # type: ignore[return-value]


def _one_of(columns: Columns, *choice: str) -> str:
    found = [name for name in choice if name in columns.cells]
    if len(found) != 1:
        wanted, has = " or ".join(choice).replace("from", "from and to"), " and ".join(found) or "none of them"
        raise TableError(f"{columns.source}: needs one column {wanted}, and has {has}", field=choice[0])
    return found[0]


def _entries(columns: Columns, place: str, town: Town) -> pd.DataFrame:
    """The rows and segments of all entries, by row."""
    street, backwards = town.street_of_segment()
    ends = np.stack([town.ids[town.tail], town.ids[town.head]])[:, street]
    tail, head = np.where(backwards, ends[::-1], ends)
    ways = pd.DataFrame({"street": street, "backwards": backwards, "from": tail, "to": head}).rename_axis("segment")
    keys = ["from", "to"] if place == "from" else [place]
    rows = pd.DataFrame({key: columns.whole_numbers(key) for key in keys}).rename_axis("row").reset_index()
    several_ways = ways.reset_index()[[*dict.fromkeys((*keys, "backwards", "segment"))]]
    entries = rows.merge(several_ways, on=keys).sort_values("row", kind="stable", ignore_index=True)
    number = np.bincount(entries["row"], minlength=len(rows))
    if place == "from":
        for key in keys:
            columns.refuse_any(key, ~np.isin(rows[key], town.ids), "is no crossing of this town")
        several = "is where several streets lead from there; give numbers in a column street"
        columns.refuse_any("to", number == 0, "is not where a street leads from there")
        columns.refuse_any("to", number > 1, several)
    else:
        most = (town.streets if place == "street" else len(street)) - 1
        columns.refuse_any(place, number == 0, f"is not one of 0 to {most}")
    if "direction" in columns.cells:
        direction = np.array(list(map(str, columns.cells["direction"])))
        known = np.isin(direction, ["", "forward", "backward"])
        columns.refuse_any("direction", ~known, "is neither forward nor backward nor empty")
        entries = entries[direction[entries["row"]] != np.where(entries["backwards"], "forward", "backward")]
        columns.refuse_any("direction", ~np.isin(rows["row"], entries["row"]), "is not how this street is walked")
    return entries[["row", "segment"]]


def _slots(columns: Columns, entries: pd.DataFrame, told: float | None) -> tuple[WholeNumbers, float, datetime]:
    """Numbers of slots, their length, which is the typical step of the times, and the first time."""
    seconds = columns.times("time")
    # Times of one segment must ascend; segments may follow one another or take turns.
    of_segment = entries.assign(second=seconds[entries["row"]]).groupby("segment")
    wrong = (of_segment["second"].diff() < 0).to_numpy()
    if wrong.any():
        late, early = (int(rows.iloc[np.argmax(wrong)]) for rows in (entries["row"], of_segment["row"].shift()))
        time, before = columns.cells["time"][late], f"{columns.line} {columns.lines[early]}"
        raise columns.refuse(late, "time", f"{time} comes before the time in {before}")
    every = np.unique(seconds)
    begins = datetime.fromtimestamp(int(every[0]), UTC).replace(tzinfo=None)
    step = typical_step(every) if len(every) > 1 else told or SLOT_SECONDS
    if told is not None and step != told:
        raise TableError(f"{columns.source}: times are {step} s apart, not {told:g}", field="time")
    since = seconds - every[0]
    uneven = f"is not a whole number of steps of {step} s after the first time, {begins.isoformat()}"
    columns.refuse_any("time", since % step != 0, uneven)
    slot = (since // step).astype(np.int64)
    columns.refuse_any("time", slot >= MOST_SLOTS, f"is more than {MOST_SLOTS} steps of {step} s after the first time")
    return slot, step, begins


def _check_twice(columns: Columns, entries: pd.DataFrame) -> None:
    """No segment may have two values in one slot."""
    twice = entries.loc[entries.duplicated(["segment", "slot"]), ["row", "segment", "slot"]]
    if len(twice):
        again, segment, slot = twice.iloc[0].tolist()
        before = int(entries.query("segment == @segment and slot == @slot")["row"].iloc[0])
        already = f"{columns.line} {columns.lines[before]} already"
        raise columns.refuse(again, None, f"segment {segment} in slot {slot} stands in {already}")
