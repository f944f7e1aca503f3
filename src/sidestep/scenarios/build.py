"""Venues: streets of a real place, with the crowds that its sensors count."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import block_diag
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from sidestep.crowds.counts import CountTable, load_auckland, read_counts
from sidestep.crowds.crowd_table import CrowdTable, load_crowd_table
from sidestep.crowds.interpolation import interpolation_weights
from sidestep.crowds.live import latest_counts
from sidestep.crowds.sensor_model import SensorModel, cholesky_factor, fit_sensors, recorded_weeks
from sidestep.crowds.sensors import SensorFlow
from sidestep.crowds.table_flow import TableFlow
from sidestep.files import cached_by_files
from sidestep.network.formats import load_helsinki, load_town
from sidestep.network.graph import RoadNetwork
from sidestep.network.snap import Snapped, Snapper
from sidestep.network.town import Town, TownError
from sidestep.scenarios.model import Law, Place, ScenarioError, Sensor, Venue
from sidestep.scenarios.tables import table_flow
from sidestep.walking.speed_laws import FREE_SPEED
from sidestep.walking.waits import Waits

HOUR = 3600.0
APART = 150.0  # m between sensors that are paired with streets, as far as there is room
STEPS = "steps"


class TownCrowds(eqx.Module):
    """Streets, simulated crowds on them, those that were counted in the weeks to test on, and where people walk."""

    network: RoadNetwork
    flow: SensorFlow | TableFlow
    recorded: SensorFlow | None
    origins: tuple[int, ...] = eqx.field(static=True, default=())  # nodes; none: anywhere
    destinations: tuple[int, ...] = eqx.field(static=True, default=())
    waits: Waits | None = None


@cached_by_files(lambda streets: (streets,))
def town_of(streets: str) -> Town:
    """The streets of a venue."""
    return load_helsinki() if streets == "helsinki" else load_town(Path(streets))


@cached_by_files(lambda counts: (counts,))
def counts_of(counts: str) -> CountTable:
    """The counts of a venue."""
    return load_auckland() if counts == "auckland" else read_counts(counts)


def table_of(venue: Venue, town: Town) -> CrowdTable:
    """The table of crowds of a venue.

    Raises
    ------
    TableError
        A file that cannot be read, or is for other streets.
    """
    table = load_crowd_table(venue.counts)
    table.check_town(town)
    return table


@cached_by_files(lambda venue, *_: venue.files)
def town_crowds(venue: Venue, slot_seconds: float, law: Law = "weidmann") -> TownCrowds:
    """Streets and crowds of a venue; ``law`` turns speeds into densities, where a table has speeds.

    Raises
    ------
    SidestepError
        Files that cannot be read, sensors that are not in the counts or stand nowhere near, too few counts, a table
        that does not fit, origins and destinations that are not in the town or between which there is no way.
    """
    town = town_of(venue.streets)
    network = town.network()
    origins, ends = (crossings(town, name, getattr(venue, name)) for name in ("origins", "destinations"))
    if venue.tabled:
        crowds = table_of(venue, town)
        flow = table_flow(venue, crowds, network, slot_seconds=slot_seconds, law=law)
        return TownCrowds(network, flow, None, origins, ends, waits_of(town, venue))
    sensed, recorded = _sensed(venue, town, network, slot_seconds)
    return TownCrowds(network, sensed, recorded, origins, ends, waits_of(town, venue))


def _sensed(venue: Venue, town: Town, network: RoadNetwork, slot_seconds: float) -> tuple[SensorFlow, SensorFlow]:
    """Simulated and recorded crowds of a venue with sensors."""
    table = counts_of(venue.counts)
    sensors = sensors_of(venue)
    names = [sensor.name for sensor in sensors]
    model = fit_sensors(table.between(*venue.fitted), names)
    record = recorded_weeks(model, table.between(*venue.tested), names)
    if venue.places > len(record):
        raise ScenarioError(
            f"sensors cannot stand in {venue.places} places with recorded weeks of their own in each: there are "
            f"{len(record)} weeks from {venue.tested[0]} to {venue.tested[1]}"
        )
    stands = places_of(sensors, venue.places)
    model, record = in_several_places(model, record, stands)
    segment = stations(town, network, tuple(sensors[number] for number in np.concatenate(stands)), venue.pairing)
    width = np.asarray(network.width)[segment]
    # Whoever passes in an hour is in sight of a metre of street for 1 / FREE_SPEED seconds.
    per_count = venue.crowding / (HOUR * FREE_SPEED * width)
    spread = interpolation_weights(network, segment, venue.reach)
    flow = SensorFlow(model, spread, jnp.asarray(per_count, jnp.float32), slot_seconds, None, venue.uneven)
    return flow, eqx.tree_at(lambda f: f.record, flow, jnp.asarray(record), is_leaf=_none)


MOST_CROSSINGS = 8  # without lights on one street; with more, waits might change faster than time goes by
# Of the busiest hour's traffic, by hour of the day: a working day in a city, as an assumption.
DAY_OF_TRAFFIC = (
    0.10, 0.06, 0.05, 0.05, 0.08, 0.20, 0.45, 0.80, 0.95, 0.75, 0.70, 0.75,
    0.80, 0.80, 0.80, 0.85, 0.95, 1.00, 0.85, 0.65, 0.50, 0.40, 0.30, 0.18,
)  # fmt: skip


def waits_of(town: Town, venue: Venue) -> Waits | None:
    """What walkers in a venue wait for: the lights and crossings that its streets have, both ways alike.

    Raises
    ------
    ScenarioError
        A light outside the town.
    """
    traffic = venue.traffic
    if traffic is None:
        return None
    street, _ = town.street_of_segment()
    signals, every = town.signals.copy(), np.ones(town.streets)
    drawn = np.random.default_rng([traffic.seed, town.streets]).uniform(0, traffic.cycle, town.streets)
    timing = np.stack([traffic.cycle * every, traffic.green * every, drawn])
    if traffic.lights:
        snap = Snapper(town)
        for light in traffic.lights:
            on = _nearest(snap, f"light {light.name!r}", light.place).street
            signals[on] = max(signals[on], 1)
            timing[:, on] = light.cycle, light.green, light.offset
    unsignalised = np.minimum(town.crossings, MOST_CROSSINGS)
    lights, others, cycle, green, offset = (
        jnp.asarray(each[street], jnp.float32) for each in (signals, unsignalised, *timing)
    )
    vehicles = jnp.asarray(DAY_OF_TRAFFIC, jnp.float32) * traffic.vehicles / HOUR
    start = jnp.asarray(venue.starts(1), jnp.float32)
    return Waits(lights, others, cycle, green, offset, vehicles, start, traffic.critical_gap)


def sensors_of(venue: Venue) -> tuple[Sensor, ...]:
    """The sensors of a venue: those that it names, or all that were counted."""
    return venue.sensors or tuple(map(Sensor, counts_of(venue.counts).sensors))


def places_of(sensors: tuple[Sensor, ...], places: int) -> list[Int[np.ndarray, " stand"]]:
    """Numbers of the sensors that stand somewhere: all of them once, and those without a place as often as is asked."""
    without = np.array([number for number, sensor in enumerate(sensors) if sensor.place is None], int)
    return [np.arange(len(sensors)), *([without] * (places - 1) if len(without) else [])]


def in_several_places(
    model: SensorModel, record: Float[np.ndarray, "week 168 sensor"], stands: list[Int[np.ndarray, " stand"]]
) -> tuple[SensorModel, Float[np.ndarray, "week 168 every"]]:
    """Sensors that stand in several places have innovations and recorded weeks of their own in each of them."""
    factor = np.asarray(model.cholesky, np.float64)
    correlation = factor @ factor.T
    together = block_diag(*(cholesky_factor(correlation[np.ix_(some, some)]) for some in stands))
    every = np.concatenate(stands)
    several = SensorModel(
        model.expected[:, every],
        model.weekly[every],
        model.sigma[:, every],
        model.phi[every],
        jnp.asarray(together, jnp.float32),
    )
    later = len(record) / len(stands)
    weeks = [np.roll(record[..., some], -int(later * copy), axis=0) for copy, some in enumerate(stands)]
    return several, np.concatenate(weeks, axis=-1)


def with_live_counts(venue: Venue, flow: SensorFlow, table: CountTable, departure: datetime) -> tuple[SensorFlow, int]:
    """Crowds that go on from current counts, and how many sensors these are of.

    Counts are as the sensors count them: ``Venue.crowding`` is multiplied onto them as onto those that crowds are
    fitted to. Of ``table`` the last hour matters; sensors without a count in it are not known.

    Raises
    ------
    CountsError
        Sensors that the venue does not have, counts of another hour than that of the departure or the one before it,
        no count at all.
    """
    sensors = sensors_of(venue)
    latest = latest_counts(table, [sensor.name for sensor in sensors], departure)
    every = latest.counts[np.concatenate(places_of(sensors, venue.places))]
    return flow.going_on_from(replace(latest, counts=every)), latest.known


def _none(leaf: object) -> bool:
    return leaf is None


def crossings(town: Town, name: str, places: tuple[Place, ...]) -> tuple[int, ...]:
    """The crossings that the origins or destinations of a venue are, by number.

    A place is taken to the nearest street, and there to the nearer end.

    Raises
    ------
    ScenarioError
        Crossings that there are not, places outside the town, and two places that are one crossing.
    """
    snap, found = Snapper(town), dict[int, Place]()
    for place in places:
        node = _crossing(town, snap, name, place)
        if node in found:
            raise ScenarioError(f"{name} must all be different, but {found[node]} and {place} are both crossing {node}")
        found[node] = place
    return tuple(found)


def _crossing(town: Town, snap: Snapper, name: str, place: Place) -> int:
    if isinstance(place, int):
        if place >= town.nodes:
            raise ScenarioError(f"{name}: there is no crossing {place}; they are numbered 0 to {town.nodes - 1}")
        return place
    on = _nearest(snap, name, place)
    return int(town.tail[on.street] if on.part < 0.5 else town.head[on.street])


def check_ways(network: RoadNetwork, origins: tuple[int, ...], ends: tuple[int, ...]) -> None:
    """Make sure that whoever sets out, and wherever they stray, there is a way to each destination.

    Towns that were imported are in one part. Those of other programs need not be, and a walker must not come to a
    crossing that has no way on.

    Raises
    ------
    ScenarioError
        A crossing from which there is no way to a destination, or a destination where all walks would begin.
    """
    for end in ends:
        if origins == (end,):
            raise ScenarioError(f"destinations: crossing {end} is the only origin, so that nobody walks there")
    tail, head = np.asarray(network.tail), np.asarray(network.head)
    ways = coo_array((np.ones(len(tail)), (tail, head)), shape=(network.nodes,) * 2).tocsr()
    if connected_components(ways, connection="strong")[0] == 1:
        return
    back = ways.T.tocsr()
    met = [breadth_first_order(ways, node, return_predecessors=False) for node in origins]
    strays = np.unique(np.concatenate(met)) if met else np.arange(network.nodes)
    # To whom everybody comes, and who comes to everybody, all come to all.
    for end in ends or (int(strays[0]),):
        lost = np.setdiff1d(strays, breadth_first_order(back, end, return_predecessors=False))
        if len(lost):
            raise _no_way(int(lost[0]), end)
    if not ends:
        first = int(strays[0])
        missed = np.setdiff1d(np.arange(network.nodes), breadth_first_order(ways, first, return_predecessors=False))
        if len(missed):
            raise _no_way(first, int(missed[0]))


def _no_way(start: int, end: int) -> ScenarioError:
    return ScenarioError(
        f"there is no way from crossing {start} to crossing {end}; choose origins and destinations in the part of the "
        "town in which everybody gets everywhere, or import the streets by sidestep import-osm, which keeps that part"
    )


def stations(town: Town, network: RoadNetwork, sensors: tuple[Sensor, ...], pairing: int) -> Int[np.ndarray, " sensor"]:
    """The segment that each sensor stands on: the street nearest to its place, or, without one, a street drawn for it.

    Streets are drawn in proportion to their length, at least ``APART`` from one another as long as there are such.

    Raises
    ------
    ScenarioError
        More sensors, or places of them, than streets.
    """
    if len(sensors) > town.streets:
        every = len({sensor.name for sensor in sensors})
        places = f" in {len(sensors)} places" if every < len(sensors) else ""
        raise ScenarioError(f"there are {every} sensors{places}, but {town.streets} streets")
    middle = (np.asarray(network.position)[town.tail] + np.asarray(network.position)[town.head]) / 2
    snap = Snapper(town)
    found = [nearest_street(snap, sensor) for sensor in sensors]
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
            if (np.linalg.norm(away, axis=1) >= room).all() and street not in (*taken, *free):
                free.append(street)
            if len(free) == missing:
                break
        room = room / 2 if room > 1 else 0.0
    rest = iter(free)
    return np.array([next(rest) if street is None else street for street in found], np.int64)


def nearest_street(snap: Snapper, sensor: Sensor) -> int | None:
    """The street that a sensor stands on, where it has a place.

    Raises
    ------
    ScenarioError
        A place outside the town.
    """
    return _nearest(snap, f"sensor {sensor.name!r}", sensor.place).street if sensor.place else None


def _nearest(snap: Snapper, what: str, place: tuple[float, float]) -> Snapped:
    """The nearest place on a street, or a refusal that says of what."""
    try:
        return snap.nearest(*place)
    except TownError as error:
        raise ScenarioError(f"{what}: {error}") from error
