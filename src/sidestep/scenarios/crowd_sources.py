"""Crowds of a venue from its counters or its table, and what an import reports about a table.

This is the one place that tells counters and tables apart.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32
from scipy.linalg import block_diag

from sidestep.crowds.base import FlowModel
from sidestep.crowds.count_files import positions_path
from sidestep.crowds.counts import AUCKLAND_SOURCE, CountTable, load_auckland, read_counts
from sidestep.crowds.crowd_table import MOST_CELLS, load_crowd_table
from sidestep.crowds.crowd_table import CrowdTable as TableData
from sidestep.crowds.interpolation import interpolation_weights
from sidestep.crowds.layouts import RECOGNISED, Layout
from sidestep.crowds.profile import time_of_week
from sidestep.crowds.sensor_model import SensorModel, cholesky_factor, fit_sensors, recorded_weeks
from sidestep.crowds.sensors import SensorFlow
from sidestep.crowds.table_flow import TableFlow
from sidestep.crowds.wall_time import DAYS
from sidestep.files import cached_by_files
from sidestep.network.graph import RoadNetwork
from sidestep.network.snapping import Snapper
from sidestep.network.town import Town, TownError
from sidestep.scenarios.builtin import AUCKLAND_SENSORS
from sidestep.scenarios.places import Counters, CrowdTable, Sensor, Venue
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.stations import nearest, stations
from sidestep.walking.speed_laws import DENSEST, FREE_SPEED, LAWS, Law, density_at_speed

HOUR = 3600.0
DENSE, JAMMED = 1.0, 4.0  # persons/m²: where people begin to slow down, and where they hardly move

Crowds = tuple[FlowModel, FlowModel, tuple[str, ...]]
"""The crowds on the streets; those that walks are tested on, which are recorded ones where there are any; and the
sensor behind each counter, as often as it stands on a street."""


@cached_by_files(lambda counts, *_: (counts, str(positions_path(Path(counts)))))
def counts_of(counts: str, layout: Layout = RECOGNISED) -> CountTable:
    """The counts in a file, or Auckland's."""
    return load_auckland() if counts == "auckland" else read_counts(counts, layout)


def standing_sensors(table: CountTable, town: Town) -> tuple[Sensor, ...]:
    """The sensors of a table that stand in a town, where the table knows it.

    Parameters
    ----------
    table
        Counts; of Auckland's, only sensors whose cameras were not exchanged are taken.
    town
        The streets.

    Returns
    -------
    tuple[Sensor, ...]
        With their places; none if their positions are not known.
    """
    if table.positions is None:
        return ()
    lasting = {sensor.name for sensor in AUCKLAND_SENSORS} if table.source == AUCKLAND_SOURCE else set(table.sensors)
    found, snapper = [], Snapper(town)
    for name, (latitude, longitude) in zip(table.sensors, table.positions.tolist(), strict=True):
        if name in lasting:
            with suppress(TownError):
                snapper.nearest(latitude, longitude)
                found.append(Sensor(name=name, place=(latitude, longitude)))
    return tuple(found)


def _table_of(file: str, town: Town) -> TableData:
    table = load_crowd_table(file)
    table.check_town(town)
    return table


def crowds_of(venue: Venue, snapper: Snapper, network: RoadNetwork, slot_seconds: float, law: Law) -> Crowds:
    """The crowds of a venue.

    Parameters
    ----------
    venue
        The place.
    snapper, network
        Its streets.
    slot_seconds
        Seconds in which crowds do not change.
    law
        Turns speeds into densities, where a table has speeds.

    Returns
    -------
    Crowds
        From its counters or from its table.

    Raises
    ------
    SidestepError
        Files that cannot be read, sensors that are unknown or outside the town, too few counts, a table that does not
        fit.
    """
    match venue.crowd_source:
        case Counters() as source:
            return _counted(venue, source, snapper, network, slot_seconds)
        case CrowdTable() as source:
            table = _table_of(source.file, snapper.town)
            flow = _tabled(venue, source.noise, table, network, slot_seconds, law)
            return flow, flow, ()


def check_crowds(venue: Venue, snapper: Snapper, attempt: Callable[..., Any]) -> object:
    """Find mistakes in what the file of a venue's crowds has for it.

    Parameters
    ----------
    venue
        The place.
    snapper
        Its streets.
    attempt
        Calls a function for a field: ``attempt(keys, function, *arguments)`` is what it returns, and None where it
        raises, which is a mistake of the field.

    Returns
    -------
    object
        What the file holds; None where it is of no use.
    """
    match venue.crowd_source:
        case Counters() as source:
            table = attempt(("crowd_source", "file"), counts_of, source.file, venue.layout)
            if table is not None:
                for name in ("fitted", "tested"):
                    attempt(("crowd_source", name), table.between, *getattr(source, name))
                for sensor in source.sensors:
                    keys = ("crowd_source", "sensors", sensor.name)
                    attempt(keys, table.series, sensor.name)
                    if sensor.place is not None:
                        attempt(keys, nearest, snapper, sensor.place, "sensors", sensor.name)
            return table
        case CrowdTable() as source:
            return attempt(("crowd_source", "file"), _table_of, source.file, snapper.town)


def _counted(venue: Venue, source: Counters, snapper: Snapper, network: RoadNetwork, slot_seconds: float) -> Crowds:
    """Simulated crowds, and those that were recorded in the weeks to test on.

    Returns
    -------
    Crowds
        Those on tests go through the recorded weeks.

    Raises
    ------
    ScenarioError
        More streets for each sensor than recorded weeks.
    """
    table, streets = counts_of(source.file, venue.layout), source.streets_per_sensor
    sensors = source.sensors or tuple(Sensor(name=name) for name in table.sensors)
    names = [sensor.name for sensor in sensors]
    model = fit_sensors(table.between(*source.fitted), names)
    record = recorded_weeks(model, table.between(*source.tested), names)
    if streets > len(record):
        raise ScenarioError(
            f"streets_per_sensor must be at most {len(record)}, the recorded weeks from {source.tested[0]} to "
            f"{source.tested[1]}, one for each street, not {streets}",
            field="place.crowd_source.streets_per_sensor",
        )
    model, record = _on_several_streets(model, record, streets)
    segment = stations(snapper, network, sensors * streets, source.pairing)
    # Each person who passes in an hour is on a given metre of street for 1 / FREE_SPEED seconds.
    per_count = venue.crowding / (HOUR * FREE_SPEED * np.asarray(network.width)[segment])
    weights = interpolation_weights(network, segment, source.reach)
    flow = SensorFlow(model, weights, jnp.asarray(per_count, jnp.float32), slot_seconds, uneven=source.uneven)
    return flow, replace(flow, record=jnp.asarray(record)), tuple(names * streets)


def _on_several_streets(
    model: SensorModel, record: Float[np.ndarray, "week 168 sensor"], streets: int
) -> tuple[SensorModel, Float[np.ndarray, "week 168 counter"]]:
    """Sensors that stand on several streets have innovations and recorded weeks of their own on each of them."""
    every = np.tile(np.arange(record.shape[-1]), streets)
    factor = np.asarray(model.cholesky, np.float64)
    cholesky = jnp.asarray(block_diag(*[cholesky_factor(factor @ factor.T)] * streets), jnp.float32)
    several = (model.expected[:, every], model.weekly[every], model.sigma[:, every], model.phi[every], cholesky)
    weeks = [np.roll(record, -int(len(record) / streets * street), axis=0) for street in range(streets)]
    return SensorModel(*several), np.concatenate(weeks, axis=-1)


def _tabled(
    venue: Venue, noise: tuple[float, float], table: TableData, network: RoadNetwork, slot_seconds: float, law: Law
) -> TableFlow:
    """The crowds of a venue as its table has them.

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
