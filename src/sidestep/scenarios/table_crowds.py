"""Tables of crowds on the streets of a town: the crowds of a venue, and what an import reports."""

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32

from sidestep.crowds.crowd_table import MOST_CELLS
from sidestep.crowds.crowd_table import CrowdTable as TableData
from sidestep.crowds.profile import time_of_week
from sidestep.crowds.table_flow import TableFlow
from sidestep.crowds.wall_time import DAYS
from sidestep.network.graph import RoadNetwork
from sidestep.network.town import Town
from sidestep.scenarios.places import Venue
from sidestep.scenarios.spec import ScenarioError
from sidestep.walking.speed_laws import DENSEST, LAWS, Law, density_at_speed

DENSE, JAMMED = 1.0, 4.0  # persons/m²: where people begin to slow down, and where they hardly move


def table_flow(
    venue: Venue, noise: tuple[float, float], table: TableData, network: RoadNetwork, slot_seconds: float, law: Law
) -> TableFlow:
    """The crowds of a venue as its table has them.

    Parameters
    ----------
    venue
        The place.
    noise
        AR(1) noise around the table, in the logarithm of volume: coefficient from slot to slot, standard deviation.
    table, network
        The numbers, and the streets that they are of.
    slot_seconds
        Seconds in which crowds do not change.
    law
        Turns speeds into densities, where the table has speeds.

    Returns
    -------
    TableFlow
        The crowds at the table's numbers times the crowding of the venue.

    Raises
    ------
    ScenarioError
        Slots longer than the table's; hours to set out in about which it says nothing; more numbers than memory has
        room for.
    """
    if table.slot_seconds < slot_seconds:
        raise ScenarioError(
            f"{table.source}: its slots of {table.slot_seconds:g} s are shorter than the scenario's of "
            f"{slot_seconds:g} s; set slot_seconds to {table.slot_seconds:g}",
            field="slot_seconds",
        )
    if table.slots * network.segments > MOST_CELLS:
        raise ScenarioError(
            f"{table.source}: {table.slots} slots of {network.segments} segments are more than {MOST_CELLS:,} numbers",
            field="place.crowd_source.file",
        )
    volume = np.zeros((table.slots, network.segments), np.float32)
    volume[:, table.segment], _ = _volumes(table, network, law)
    begins = None if table.begins is None else time_of_week(table.begins)
    expected = jnp.asarray(venue.crowding * volume, jnp.float32)
    flow = TableFlow(*noise, slot_seconds, expected, table.slot_seconds, begins)
    for hour in venue.every_hour:
        if not flow.covers(hour) and table.begins is not None:
            raise ScenarioError(
                f"{table.source}: it covers {flow.span / 3600:g} hours from {table.begins:%A %H:%M} on, but the "
                f"venue's days and hours have people set out on {DAYS[hour // 24]} at {hour % 24}:00",
                field="place.hours",
            )
    return flow


def _volumes(table: TableData, network: RoadNetwork, law: Law) -> tuple[Float32[np.ndarray, "slot mentioned"], int]:
    """Persons on the segments that are mentioned, and how many speeds are below the law's lowest."""
    value, slower = table.value, 0
    if table.quantity == "speed":
        lowest = float(LAWS[law].speed(jnp.float32(DENSEST)))
        slower = int((value < lowest).sum())
        value = density_at_speed(LAWS[law], value)
    return value if table.quantity == "volume" else value * _area(table, network), slower


def _area(table: TableData, network: RoadNetwork) -> Float32[np.ndarray, " mentioned"]:
    return (np.asarray(network.length) * np.asarray(network.width))[table.segment]


@dataclass(frozen=True)
class TableReport:
    """What a table holds, and what was filled in."""

    source: str
    """The file."""
    quantity: str
    """``volume``, ``density`` or ``speed``."""
    rows: int
    segments: int
    """Of the town."""
    mentioned: int
    """Of them, in the table."""
    slots: int
    slot_seconds: float
    begins: str | None
    """Local wall time; None: the table has no times."""
    ends: str | None
    filled: dict[str, int]
    """How often something was repaired, by what it was."""
    details: dict[str, str]
    """What was done about each."""
    unused_columns: tuple[str, ...]
    largest_density: float
    """Persons/m²."""
    share_above_1: float
    """Of all slots of all segments, those with more than one person per m²."""
    share_above_4: float
    law: str | None
    """By which speeds became densities; None: there were none."""
    slower_than_law: int
    """Speeds below the law's lowest, which count as the lowest density that has that."""


def import_table(
    path: Path, town: Town, *, slot_seconds: float | None = None, law: Law = "weidmann"
) -> tuple[TableData, TableReport]:
    """Read a table of crowds and say what it holds.

    Parameters
    ----------
    path
        CSV or Parquet; docs/counts.md describes the columns.
    town
        The streets that its rows are of.
    slot_seconds
        Length of the slots; by default as the table's times tell.
    law
        Turns speeds into densities, for the report only.

    Returns
    -------
    table, report
        The crowds, and what was found and filled in.

    Raises
    ------
    TableError
        A file that cannot be read or breaks a rule.
    """
    from sidestep.crowds.table_reader import read_table  # with pandas, which other commands need not load

    table, network = read_table(path, town, slot_seconds), town.network()
    # Only of what is mentioned: most towns are larger than their tables, and elsewhere is nobody.
    volume, slower = _volumes(table, network, law)
    density, cells = volume / _area(table, network), table.slots * network.segments
    as_read = ("source", "quantity", "rows", "slots", "slot_seconds")
    return table, TableReport(
        **{name: getattr(table, name) for name in as_read},
        segments=network.segments,
        mentioned=len(table.segment),
        begins=None if table.begins is None else table.begins.isoformat(),
        ends=None if table.begins is None else _later(table.begins, table.slots * table.slot_seconds),
        filled={repair.kind: repair.number for repair in table.repairs},
        details={repair.kind: repair.detail for repair in table.repairs},
        unused_columns=table.unused,
        largest_density=float(density.max()),
        share_above_1=float((density > DENSE).sum() / cells),
        share_above_4=float((density > JAMMED).sum() / cells),
        law=law if table.quantity == "speed" else None,
        slower_than_law=slower,
    )


def _later(time: datetime, seconds: float) -> str | None:
    try:
        return (time + timedelta(seconds=seconds)).isoformat()
    except OverflowError:  # the last slot of the year 9999
        return None
