"""Venues: streets of a real place, with the crowds that its sensors count."""

import difflib
import reprlib
from dataclasses import replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from sidestep.flow.counts import CountTable, load_auckland, read_counts
from sidestep.flow.profile import hour_of_week
from sidestep.flow.sensors import Known, SensorFlow, fit_sensors, recorded_weeks
from sidestep.network.graph import RoadNetwork
from sidestep.network.io import load_helsinki, load_town
from sidestep.network.snap import Snapper
from sidestep.network.spread import spread_along
from sidestep.network.town import Town, TownError
from sidestep.scenarios.catalogue import ScenarioError, Sensor, Venue
from sidestep.travel_time import FREE_SPEED

HOUR = 3600.0
APART = 150.0  # m between sensors that are paired with streets, as far as there is room
STEPS = "steps"


class TownCrowds(eqx.Module):
    """Streets, simulated crowds on them, and those that were counted in the weeks to test on."""

    network: RoadNetwork
    flow: SensorFlow
    recorded: SensorFlow


@lru_cache(maxsize=4)
def town_of(streets: str) -> Town:
    """The streets of a venue."""
    return load_helsinki() if streets == "helsinki" else load_town(Path(streets))


@lru_cache(maxsize=4)
def counts_of(counts: str) -> CountTable:
    """The counts of a venue."""
    return load_auckland() if counts == "auckland" else read_counts(counts)


@lru_cache(maxsize=4)
def town_crowds(venue: Venue, slot_seconds: float) -> TownCrowds:
    """Streets and crowds of a venue.

    Raises
    ------
    SidestepError
        Files that cannot be read, sensors that are not in the counts or stand nowhere near, too few counts.
    """
    town, table = town_of(venue.streets), counts_of(venue.counts)
    network = town.network()
    sensors = venue.sensors or tuple(map(Sensor, table.sensors))
    names = sensor_names(venue)
    model = fit_sensors(table.between(*venue.fitted), names)
    segment = stations(town, network, sensors, venue.pairing)
    width = np.asarray(network.width)[segment]
    # Whoever passes in an hour is in sight of a metre of street for 1 / FREE_SPEED seconds.
    per_count = venue.crowding / (HOUR * FREE_SPEED * width)
    spread = spread_along(network, segment, venue.reach)
    start = jnp.asarray(venue.starts(1), jnp.float32)
    flow = SensorFlow(model, spread, jnp.asarray(per_count, jnp.float32), start, slot_seconds)
    record = recorded_weeks(model, table.between(*venue.tested), names)
    return TownCrowds(network, flow, eqx.tree_at(lambda f: f.record, flow, jnp.asarray(record), is_leaf=_none))


def sensor_names(venue: Venue) -> tuple[str, ...]:
    """The sensors of a venue, in the order in which its crowds have them."""
    return tuple(sensor.name for sensor in venue.sensors) or counts_of(venue.counts).sensors


def with_live_counts(venue: Venue, flow: SensorFlow, table: CountTable, departure: datetime) -> tuple[SensorFlow, int]:
    """Crowds that go on from current counts, and how many sensors these are of.

    Counts are as the sensors count them: ``Venue.crowding`` is multiplied onto them as onto those that crowds are
    fitted to. Of ``table`` the last hour matters; sensors without a count in it are not known.

    Raises
    ------
    ScenarioError
        Sensors that the venue does not have, counts of another hour than that of the departure or the one before it,
        no count at all.
    """
    names = sensor_names(venue)
    for name in table.sensors:
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(map(repr, names))}"
            raise ScenarioError(f"{table.source}: no sensor {reprlib.repr(name)} in this place; {hint}")
    counted, leaves = table.times[-1], np.datetime64(departure, "h")
    if counted not in (leaves, leaves - 1):
        raise ScenarioError(
            f"{table.source}: the last counts are of the hour from {counted}:00, but the departure is "
            f"{departure.isoformat(timespec='minutes')}; they must be of the hour of the departure or the one before"
        )
    last = [table.series(name)[-1] if name in table.sensors else np.nan for name in names]
    known = int(np.isfinite(last).sum())
    if not known:
        raise ScenarioError(f"{table.source}: nothing was counted in the last hour, from {counted}:00")
    usual = np.asarray(flow.model.usual)[hour_of_week(table.times[-1:])[0]]
    since = (np.datetime64(departure, "s") - counted.astype("datetime64[s]")).astype(float) / HOUR - 0.5
    residual = np.log1p(np.array(last)) - usual
    counts = Known(jnp.asarray(residual, jnp.float32), jnp.asarray(since, jnp.float32))
    return replace(flow, known=counts, record=None), known


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
