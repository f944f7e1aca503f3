"""Venues: streets of a real place, with the crowds that its sensors count."""

from functools import lru_cache
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import block_diag

from sidestep.flow.counts import CountTable, load_auckland, read_counts
from sidestep.flow.sensors import SensorFlow, SensorModel, fit_sensors, recorded_weeks
from sidestep.flow.table import load_crowd_table
from sidestep.flow.tabled import TableFlow
from sidestep.network.graph import RoadNetwork
from sidestep.network.io import load_helsinki, load_town
from sidestep.network.snap import Snapper
from sidestep.network.spread import spread_along
from sidestep.network.town import Town, TownError
from sidestep.scenarios.catalogue import Law, ScenarioError, Sensor, Venue
from sidestep.scenarios.tables import table_flow
from sidestep.travel_time import FREE_SPEED

HOUR = 3600.0
APART = 150.0  # m between sensors that are paired with streets, as far as there is room
STEPS = "steps"


class TownCrowds(eqx.Module):
    """Streets, simulated crowds on them, and those that were counted in the weeks to test on, if they were counted."""

    network: RoadNetwork
    flow: SensorFlow | TableFlow
    recorded: SensorFlow | None


@lru_cache(maxsize=4)
def town_of(streets: str) -> Town:
    """The streets of a venue."""
    return load_helsinki() if streets == "helsinki" else load_town(Path(streets))


@lru_cache(maxsize=4)
def counts_of(counts: str) -> CountTable:
    """The counts of a venue."""
    return load_auckland() if counts == "auckland" else read_counts(counts)


@lru_cache(maxsize=4)
def town_crowds(venue: Venue, slot_seconds: float, law: Law = "weidmann") -> TownCrowds:
    """Streets and crowds of a venue; ``law`` turns speeds into densities, where a table has speeds.

    Raises
    ------
    SidestepError
        Files that cannot be read, sensors that are not in the counts or stand nowhere near, too few counts, a table
        that does not fit.
    """
    town = town_of(venue.streets)
    network = town.network()
    if venue.tabled:
        crowds = load_crowd_table(venue.counts)
        return TownCrowds(network, table_flow(venue, crowds, town, network, slot_seconds=slot_seconds, law=law), None)
    table = counts_of(venue.counts)
    sensors = venue.sensors or tuple(map(Sensor, table.sensors))
    names = [sensor.name for sensor in sensors]
    model = fit_sensors(table.between(*venue.fitted), names)
    record = recorded_weeks(model, table.between(*venue.tested), names)
    model, record, sensors = in_several_places(model, record, sensors, venue.places)
    segment = stations(town, network, sensors, venue.pairing)
    width = np.asarray(network.width)[segment]
    # Whoever passes in an hour is in sight of a metre of street for 1 / FREE_SPEED seconds.
    per_count = venue.crowding / (HOUR * FREE_SPEED * width)
    spread = spread_along(network, segment, venue.reach)
    start = jnp.asarray(venue.starts(1), jnp.float32)
    flow = SensorFlow(model, spread, jnp.asarray(per_count, jnp.float32), start, slot_seconds, None, venue.uneven)
    return TownCrowds(network, flow, eqx.tree_at(lambda f: f.record, flow, jnp.asarray(record), is_leaf=_none))


def in_several_places(
    model: SensorModel, record: Float[np.ndarray, "week 168 sensor"], sensors: tuple[Sensor, ...], places: int
) -> tuple[SensorModel, Float[np.ndarray, "week 168 stand"], tuple[Sensor, ...]]:
    """Sensors without a place stand in several, with innovations and recorded weeks of their own in each of them."""
    once = np.arange(len(sensors))
    without = np.array([number for number in once if sensors[number].place is None], int)
    copies = [once, *[without] * (places - 1)] if len(without) else [once]
    correlation = np.asarray(model.together @ model.together.T)
    together = block_diag(*(np.linalg.cholesky(correlation[np.ix_(stands, stands)]) for stands in copies))
    every = np.concatenate(copies)
    several = SensorModel(
        model.usual[:, every],
        model.weekly[every],
        model.deviation[:, every],
        model.memory[every],
        jnp.asarray(together, jnp.float32),
    )
    weeks = [
        np.roll(record[..., stands], -(copy * len(record) // places), axis=0) for copy, stands in enumerate(copies)
    ]
    return several, np.concatenate(weeks, axis=-1), tuple(sensors[number] for number in every)


def _none(leaf: object) -> bool:
    return leaf is None


def stations(town: Town, network: RoadNetwork, sensors: tuple[Sensor, ...], pairing: int) -> Int[np.ndarray, " sensor"]:
    """The segment that each sensor stands on: the street nearest to its place, or, without one, a street drawn for it.

    Streets are drawn in proportion to their length, at least ``APART`` from one another as long as there are such.

    Raises
    ------
    ScenarioError
        More sensors than streets.
    """
    if len(sensors) > town.streets:
        raise ScenarioError(f"there are {len(sensors)} sensors, but {town.streets} streets")
    middle = (np.asarray(network.position)[town.tail] + np.asarray(network.position)[town.head]) / 2
    snap = Snapper(town)
    found = [None if sensor.place is None else _nearest(snap, sensor) for sensor in sensors]
    taken = [street for street in found if street is not None]
    rng = np.random.default_rng([pairing, len(sensors)])
    weight = np.where(np.array(town.kind) == STEPS, 0.0, town.length) + 1e-9
    drawn = rng.choice(town.streets, town.streets, replace=False, p=weight / weight.sum()).tolist()
    free: list[int] = []
    missing = found.count(None)
    room = APART
    while len(free) < missing:
        for street in drawn:
            away = middle[[*taken, *free]] - middle[street]
            if len(free) < missing and (np.linalg.norm(away, axis=1) >= room).all() and street not in (*taken, *free):
                free.append(street)
        room = room / 2 if room > 1 else 0.0
    rest = iter(free)
    return np.array([next(rest) if street is None else street for street in found], np.int64)


def _nearest(snap: Snapper, sensor: Sensor) -> int:
    try:
        return snap.nearest(*sensor.place).street if sensor.place else -1
    except TownError as error:
        raise ScenarioError(f"sensor {sensor.name!r}: {error}") from error
