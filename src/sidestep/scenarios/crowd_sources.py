"""Crowds of a venue from its counters or its table: the one place that tells the two apart."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import block_diag

from sidestep.crowds.base import FlowModel
from sidestep.crowds.counts import CountTable, load_auckland, read_counts
from sidestep.crowds.crowd_table import CrowdTable as TableData
from sidestep.crowds.crowd_table import load_crowd_table
from sidestep.crowds.interpolation import interpolation_weights
from sidestep.crowds.sensor_model import SensorModel, cholesky_factor, fit_sensors, recorded_weeks
from sidestep.crowds.sensors import SensorFlow
from sidestep.files import cached_by_files
from sidestep.network.graph import RoadNetwork
from sidestep.network.snapping import Snapper
from sidestep.network.town import Town
from sidestep.scenarios.places import Counters, CrowdTable, Sensor, Venue
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.stations import nearest_street, stations
from sidestep.scenarios.tables import table_flow
from sidestep.walking.speed_laws import FREE_SPEED, Law

HOUR = 3600.0
Check = tuple[tuple[str, ...], Callable[[], object]]
"""The field that something is asked of, and a call that raises where the answer is a mistake."""
Stands = list[Int[np.ndarray, " stand"]]
"""Numbers of the sensors that stand somewhere: all of them, then again those that are paired with several streets."""


class Crowds(NamedTuple):
    """The crowds on the streets of a venue."""

    flow: FlowModel
    test_flow: FlowModel
    """What walks are tested on: recorded crowds where there are any."""
    sensors: tuple[str, ...]
    """The sensor behind each counter of the flow: as often as it stands on a street."""


@cached_by_files(lambda counts: (counts,))
def counts_of(counts: str) -> CountTable:
    """The counts in a file, or Auckland's."""
    return load_auckland() if counts == "auckland" else read_counts(counts)


@dataclass(frozen=True)
class CountedCrowds:
    """Crowds known from counters."""

    venue: Venue
    source: Counters

    def checks(self, town: Town) -> Iterator[Check]:
        """Find mistakes in what the file of counts has for the venue."""
        yield ("file",), partial(counts_of, self.source.file)
        table = counts_of(self.source.file)
        for name in ("fitted", "tested"):
            yield (name,), partial(table.between, *getattr(self.source, name))
        snapper = Snapper(town)
        for sensor in self.source.sensors:
            yield ("sensors", sensor.name), partial(table.series, sensor.name)
            yield ("sensors", sensor.name), partial(nearest_street, snapper, sensor)

    def build(self, town: Town, network: RoadNetwork, slot_seconds: float, _law: Law) -> Crowds:
        """Simulated crowds, and those that were recorded in the weeks to test on.

        Parameters
        ----------
        town, network
            The streets.
        slot_seconds
            Seconds in which crowds do not change.

        Raises
        ------
        SidestepError
            Files that cannot be read, sensors that are unknown or outside the town, too few counts.
        """
        source, table = self.source, counts_of(self.source.file)
        sensors = source.sensors or tuple(Sensor(name=name) for name in table.sensors)
        names = [sensor.name for sensor in sensors]
        model = fit_sensors(table.between(*source.fitted), names)
        record = recorded_weeks(model, table.between(*source.tested), names)
        if source.streets_per_sensor > len(record):
            raise ScenarioError(
                f"streets_per_sensor must be at most {len(record)}, the recorded weeks from {source.tested[0]} to "
                f"{source.tested[1]}, one for each street, not {source.streets_per_sensor}",
                field="place.crowd_source.streets_per_sensor",
            )
        stands = _stands(sensors, source.streets_per_sensor)
        every = np.concatenate(stands)
        model, record = _on_several_streets(model, record, stands)
        segment = stations(town, network, tuple(sensors[number] for number in every), source.pairing)
        # Each person who passes in an hour is on a given metre of street for 1 / FREE_SPEED seconds.
        per_count = self.venue.crowding / (HOUR * FREE_SPEED * np.asarray(network.width)[segment])
        weights = interpolation_weights(network, segment, source.reach)
        flow = SensorFlow(model, weights, jnp.asarray(per_count, jnp.float32), slot_seconds, uneven=source.uneven)
        return Crowds(flow, replace(flow, record=jnp.asarray(record)), tuple(names[number] for number in every))


def _stands(sensors: tuple[Sensor, ...], streets: int) -> Stands:
    unplaced = np.array([number for number, sensor in enumerate(sensors) if sensor.place is None], int)
    return [np.arange(len(sensors)), *([unplaced] * (streets - 1) if len(unplaced) else [])]


def _on_several_streets(
    model: SensorModel, record: Float[np.ndarray, "week 168 sensor"], stands: Stands
) -> tuple[SensorModel, Float[np.ndarray, "week 168 counter"]]:
    """Sensors that stand on several streets have innovations and recorded weeks of their own on each of them."""
    factor = np.asarray(model.cholesky, np.float64)
    correlation = factor @ factor.T
    cholesky = block_diag(*(cholesky_factor(correlation[np.ix_(some, some)]) for some in stands))
    every = np.concatenate(stands)
    several = SensorModel(
        model.expected[:, every],
        model.weekly[every],
        model.sigma[:, every],
        model.phi[every],
        jnp.asarray(cholesky, jnp.float32),
    )
    later = len(record) / len(stands)
    weeks = [np.roll(record[..., some], -int(later * copy), axis=0) for copy, some in enumerate(stands)]
    return several, np.concatenate(weeks, axis=-1)


@dataclass(frozen=True)
class TabledCrowds:
    """Crowds known from a table of all segments."""

    venue: Venue
    source: CrowdTable

    def checks(self, town: Town) -> Iterator[Check]:
        """Find mistakes in the table."""
        yield ("file",), partial(self._table, town)

    def build(self, town: Town, network: RoadNetwork, slot_seconds: float, law: Law) -> Crowds:
        """Simulated crowds, which are those to test on as well.

        Parameters
        ----------
        town, network
            The streets.
        slot_seconds
            Seconds in which crowds do not change.
        law
            Turns speeds into densities, where the table has speeds.

        Raises
        ------
        SidestepError
            A table that cannot be read or does not fit.
        """
        flow = table_flow(self.venue, self.source.noise, self._table(town), network, slot_seconds, law)
        return Crowds(flow, flow, ())

    def _table(self, town: Town) -> TableData:
        table = load_crowd_table(self.source.file)
        table.check_town(town)
        return table


def crowds_of(venue: Venue) -> CountedCrowds | TabledCrowds:
    """What makes the crowds of a venue."""
    match venue.crowd_source:
        case Counters() as counters:
            return CountedCrowds(venue, counters)
        case CrowdTable() as table:
            return TabledCrowds(venue, table)
