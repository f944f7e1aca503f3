"""Maps of a scenario: streets, crowds and waits, drawn from a seed or read from the files that a venue names."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Key

from sidestep.crowds.arima import ArimaFlow, change_step, load_fitted
from sidestep.crowds.base import FlowModel
from sidestep.crowds.counts import CountTable, latest_counts
from sidestep.crowds.rush import RushFlow, ShiftingFlow
from sidestep.errors import SidestepError
from sidestep.files import cached_by_files
from sidestep.network.formats import load_helsinki, load_town
from sidestep.network.graph import RoadNetwork, disjoint_union
from sidestep.network.grid import grid_network
from sidestep.network.snapping import Snapper, SplitStreets
from sidestep.network.town import Town
from sidestep.scenarios.crowd_sources import HOUR, check_crowds, crowds_of
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import Grid, Place, Traffic, Venue
from sidestep.scenarios.spec import Fault, ScenarioError
from sidestep.scenarios.stations import check_ways, crossings, nearest
from sidestep.walking.opening import AnyWaits, with_opening_times
from sidestep.walking.speed_laws import Law
from sidestep.walking.waits import NoWaits, Waits

MOST_UNSIGNALISED = 8  # crossings without lights on one street; with more, waits might change faster than time goes by
# Of the busiest hour's traffic, by hour of the day: a working day in a city, as an assumption.
DAY_OF_TRAFFIC = (
    0.10, 0.06, 0.05, 0.05, 0.08, 0.20, 0.45, 0.80, 0.95, 0.75, 0.70, 0.75,
    0.80, 0.80, 0.80, 0.85, 0.95, 1.00, 0.85, 0.65, 0.50, 0.40, 0.30, 0.18,
)  # fmt: skip
Purpose = Literal["learn", "explore", "test"]
PURPOSES: tuple[Purpose, ...] = get_args(Purpose)


class ScenarioMap(eqx.Module):
    """Streets, the crowds on them with the model that moves them, and what walkers wait for.

    Several maps side by side, with no street between them, are one: ``parts`` has the number of nodes of each.
    """

    network: RoadNetwork
    flow: FlowModel
    test_flow: FlowModel
    """What walks are tested on: recorded crowds where there are any, else ``flow``."""
    key: Key[Array, ""]
    """Random stream of this map; futures and training fold their purpose into it."""
    parts: tuple[int, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True, default=())
    """The sensor behind each counter of the flow, where crowds are known from sensors."""
    origins: tuple[int, ...] = eqx.field(static=True, default=())
    """Nodes where walks begin; none: anywhere."""
    destinations: tuple[int, ...] = eqx.field(static=True, default=())
    """Nodes where walks end; none: anywhere."""
    waits: AnyWaits = NoWaits()
    """At gates, at lights and for gaps in the traffic."""

    def flow_for(self, purpose: Purpose) -> FlowModel:
        """The crowds that walks of one purpose meet."""
        return self.test_flow if purpose == "test" else self.flow

    def on_pieces(self, streets: SplitStreets) -> "ScenarioMap":
        """The same map with some streets split and crowds as dense on all their pieces, for walks from anywhere.

        Futures for tests are simulated: there are only as many recorded weeks as were counted, and none goes on from
        now.

        Returns
        -------
        ScenarioMap
            Its nodes and segments have the numbers of ``streets``.
        """
        network, parent = streets.network, jnp.asarray(streets.parent)
        flow = self.flow.on_pieces(parent, jnp.asarray(streets.fraction, jnp.float32))
        waits = self.waits.on_pieces(parent, jnp.asarray(streets.begins_at_crossing))
        return ScenarioMap(network, flow, flow, self.key, (network.nodes,), self.sensors, waits=waits)

    @property
    def fingerprint(self) -> str:
        """The same for the same streets with the same expected crowds, whatever the speed law, and for no others."""
        told = (self.network, self.flow, self.waits)
        network, *others = (str(jax.tree.structure(each)).removeprefix("PyTreeDef(")[:-1] for each in told)
        # What a network has none of is left out: older models, which know of no such thing, keep their maps.
        structure = ", ".join([network.replace(", None", ""), *others])
        digest = hashlib.sha256(f"PyTreeDef(({structure}))".encode())
        for leaf in jax.tree.leaves(told):
            digest.update(f"{leaf.shape}".encode() + np.asarray(leaf).tobytes())
        return digest.hexdigest()[:16]


def draw_map(scenario: Scenario, seed: int, index: int = 0) -> ScenarioMap:
    """Map number ``index`` of a seed; the same for every planner and for every kind of flow.

    Venues have the same streets and expected crowds on all maps; only the futures differ.

    Parameters
    ----------
    scenario
        The problem.
    seed, index
        Of 0 or more. Grids of several sides take them in turn by ``index``.

    Returns
    -------
    ScenarioMap
        Streets, crowds and waits, in one part.

    Raises
    ------
    SidestepError
        Negative numbers, files of a venue that cannot be read or do not fit.

    Examples
    --------
    >>> from sidestep.scenarios.builtin import scenario
    >>> from sidestep.scenarios.maps import draw_map
    >>> drawn = draw_map(scenario("paper-congested", side=3, crowded_nodes=2), seed=0)
    >>> drawn.network.nodes, drawn.network.segments
    (9, 24)
    """
    key = _key(seed, index)
    match scenario.place:
        case Grid() as grid:
            side = grid.sides[index % len(grid.sides)]
            return _on_grids(grid, side, [(seed, index)], scenario.slot_seconds, key)
        case Venue() as venue:
            return replace(_venue_map(venue, scenario.slot_seconds, scenario.law), key=key)


def draw_training_map(scenario: Scenario, seed: int, index: int = 0) -> ScenarioMap:
    """What an agent learns on that will walk map number ``index``: that map, or others, as the scenario says.

    The others are drawn from another stream than all maps that agents are compared on.

    Parameters
    ----------
    scenario, seed, index
        As for :func:`draw_map`.

    Returns
    -------
    ScenarioMap
        One part for each map to learn on.

    Raises
    ------
    SidestepError
        As :func:`draw_map`.

    Examples
    --------
    >>> from sidestep.scenarios.builtin import scenario
    >>> from sidestep.scenarios.maps import draw_training_map
    >>> draw_training_map(scenario("unseen-maps", side=3, crowded_nodes=1, training_maps=2), seed=0).parts
    (9, 9)
    """
    match scenario.place:
        case Grid(training_maps=number) as grid if number:
            seeds = [(seed, another, _LEARN) for another in range(number)]
            return _on_grids(grid, grid.side, seeds, scenario.slot_seconds, _key(seed, index))
        case _:
            return draw_map(scenario, seed, index)


_LEARN = 1  # a third number makes another stream: no map that is compared on has one


def _key(seed: int, index: int) -> Key[Array, ""]:
    """The random stream of a map.

    Returns
    -------
    Key[Array, ""]
        Different for every seed and map number.

    Raises
    ------
    ScenarioError
        Negative numbers.
    """
    if min(seed, index) < 0:
        raise ScenarioError(f"seed and number of a map must not be negative, not {seed} and {index}")
    # A key made of plain numbers needs no compiled program.
    return jax.random.wrap_key_data(jnp.asarray(np.random.SeedSequence([seed, index]).generate_state(2)))


def _draw_grid(grid: Grid, side: int, seed: tuple[int, ...]) -> tuple[RoadNetwork, np.ndarray, np.ndarray, np.ndarray]:
    """Draw streets and crowds (section V-A of the paper).

    Returns
    -------
    network
        The streets.
    volume, amplitude, phase
        Of each segment the persons without waves and noise, and its wave in rush hours: the amplitude in the logarithm
        of volume, the phase in radians.
    """
    rng = np.random.default_rng(seed)
    network = grid_network(side, rng, grid.lengths)
    tail, head = np.asarray(network.tail), np.asarray(network.head)
    volume = rng.uniform(*grid.volumes, network.segments)
    crowded = rng.choice(np.arange(1, network.nodes - 1), _crowded_nodes(grid, network.nodes), replace=False)
    if grid.rush is None or not grid.rush.shifting:
        at_crowded = np.isin(tail, crowded) | np.isin(head, crowded)
        drawn = np.maximum(rng.normal(*grid.crowded_volume, network.segments), 1.0)
        volume = np.where(at_crowded, drawn, volume)
    if grid.rush is None:
        return network, volume, np.zeros(network.segments), np.zeros(network.segments)
    # Both directions of a street have one wave.
    street = np.unique(np.sort([tail, head], axis=0), axis=1, return_inverse=True)[1].reshape(-1)
    amplitude = rng.uniform(*grid.rush.amplitude, network.segments)
    return network, volume, amplitude[street], rng.uniform(0, 2 * np.pi, network.segments)[street]


def _crowded_nodes(grid: Grid, nodes: int) -> int:
    """As large a share of the nodes as on the first map."""
    return round(grid.crowded_nodes * nodes / grid.nodes)


def _on_grids(
    grid: Grid, side: int, seeds: Sequence[tuple[int, ...]], slot_seconds: float, key: Key[Array, ""]
) -> ScenarioMap:
    """A grid drawn from each seed, as one map without streets between them, and the crowds on it."""
    networks, *columns = zip(*(_draw_grid(grid, side, seed) for seed in seeds), strict=True)
    network, parts = disjoint_union(networks), tuple(each.nodes for each in networks)
    volume, amplitude, phase = (jnp.asarray(np.concatenate(each), jnp.float32) for each in columns)
    flow: FlowModel
    if (rush := grid.rush) is None:
        flow = ArimaFlow(volume, change_step(load_fitted(), slot_seconds))
    else:
        flow = RushFlow(rush.phi, rush.sigma, slot_seconds, volume, amplitude, phase, rush.period)
        if rush.shifting:
            first = np.cumsum((0, *parts))
            spared = np.isin(np.arange(network.nodes), (first[:-1], first[1:] - 1))
            ends = jnp.stack([network.tail, network.head], axis=1)
            crowded_nodes = sum(_crowded_nodes(grid, nodes) for nodes in parts)
            flow = ShiftingFlow(flow, ends, jnp.asarray(spared), crowded_nodes, *grid.crowded_volume)
    return ScenarioMap(network, flow, flow, key, parts)


@cached_by_files(lambda venue, *_: venue.files)
def _venue_map(venue: Venue, slot_seconds: float, law: Law) -> ScenarioMap:
    """The first map of seed 0 of a venue, made once as long as its files stay as they are."""
    snapper = Snapper(town_of(venue.streets))
    network = snapper.town.network()
    flow, test_flow, sensors = crowds_of(venue, snapper, network, slot_seconds, law)
    origins = crossings(snapper, "origins", venue.origins)
    destinations = crossings(snapper, "destinations", venue.destinations)
    key, waits = _key(0, 0), waits_of(snapper, venue.traffic)
    return ScenarioMap(network, flow, test_flow, key, (network.nodes,), sensors, origins, destinations, waits)


@cached_by_files(lambda streets: (streets,))
def town_of(streets: str) -> Town:
    """The streets of a venue, read once as long as their file stays as it is.

    Parameters
    ----------
    streets
        Name of a file, or ``helsinki``.

    Returns
    -------
    Town
        Its crossings and streets.

    Raises
    ------
    SidestepError
        A file that cannot be read.
    """
    return load_helsinki() if streets == "helsinki" else load_town(Path(streets))


def attribution_of(place: Place) -> str:
    """Whose streets a place has; "" where they are drawn."""
    return town_of(place.streets).attribution if place.streets else ""


def waits_of(snapper: Snapper, traffic: Traffic | None) -> AnyWaits:
    """What walkers in a venue wait for: gates, lights and crossings that its streets have, both ways alike.

    Parameters
    ----------
    snapper
        The streets.
    traffic
        The vehicles; without them nobody waits where streets are open.

    Returns
    -------
    AnyWaits
        The waits before each segment.

    Raises
    ------
    ScenarioError
        A light outside the town.
    """
    town, (street, _) = snapper.town, snapper.town.street_of_segment()
    opening = [town.opening[number] for number in street.tolist()]
    if traffic is None:
        return with_opening_times(NoWaits(), opening)
    drawn = np.random.default_rng([traffic.seed, town.streets]).uniform(0, traffic.cycle, town.streets)
    timing = np.broadcast_arrays(traffic.cycle, traffic.green, drawn)
    # One row a street: its lights and its other crossings; cycle, green and offset of the first light.
    rows = np.stack([town.signals, np.minimum(town.crossings, MOST_UNSIGNALISED), *timing], axis=1)
    for light in traffic.lights:
        row = rows[nearest(snapper, light.place, "lights", light.name).street]
        row[:] = max(row[0], 1), row[1], light.cycle, light.green, light.offset
    lights, others, cycle, green, offset = (jnp.asarray(column[street], jnp.float32) for column in rows.T)
    vehicles = jnp.asarray(DAY_OF_TRAFFIC, jnp.float32) * traffic.vehicles / HOUR
    waits = Waits(lights, others, cycle, green, offset, vehicles, traffic.critical_gap)
    return with_opening_times(waits, opening)


def mistakes(venue: Venue) -> list[Fault]:
    """Find what is wrong with the files that a venue names, and with what is looked for in them.

    Parameters
    ----------
    venue
        The place; its files may be missing or damaged.

    Returns
    -------
    list[Fault]
        The mistakes, with their fields from the scenario inwards. After a file that cannot be read there is no other.
    """
    found: list[Fault] = []

    def attempt(keys: tuple[str, ...], function: Callable[..., Any], *arguments: Any) -> Any:
        path = ("place", *keys)
        try:
            return function(*arguments)
        except SidestepError as error:
            found.append(Fault(path, str(error) if error.field else f"{'.'.join(path)}: {error}"))

    snapper = attempt(("streets",), lambda: Snapper(town_of(venue.streets)))
    if snapper is not None and check_crowds(venue, snapper, attempt):
        for light in venue.traffic.lights if venue.traffic else ():
            attempt(("traffic", "lights", light.name), nearest, snapper, light.place, "lights", light.name)
        origins = attempt(("origins",), crossings, snapper, "origins", venue.origins)
        destinations = attempt(("destinations",), crossings, snapper, "destinations", venue.destinations)
        if None not in (origins, destinations):
            attempt(("destinations",), check_ways, snapper.town.network(), origins, destinations)
    return found


def purpose_key(scenario_map: ScenarioMap, purpose: Purpose, part: int = 0) -> Key[Array, ""]:
    """The random stream of one purpose on one map; ``part`` numbers independent streams within it."""
    key = jax.random.fold_in(scenario_map.key, PURPOSES.index(purpose))
    return jax.random.fold_in(key, part) if part else key


def with_live_counts(scenario_map: ScenarioMap, table: CountTable, departure: datetime) -> tuple[ScenarioMap, int]:
    """A map whose crowds go on from current counts.

    Parameters
    ----------
    scenario_map
        The map.
    table
        Counts as the sensors count them; the crowding of the place is multiplied onto them. Its last hour matters, and
        sensors without a count in it are not known.
    departure
        Local wall time of clock 0.

    Returns
    -------
    scenario_map, known
        The map, and the number of sensors with a count.

    Raises
    ------
    CountsError
        Crowds that are not known from sensors; sensors that the place does not have, counts of another hour than that
        of the departure or the one before it, no count at all.
    """
    names = list(dict.fromkeys(scenario_map.sensors))
    latest = latest_counts(table, names, departure)
    counts = latest.counts[[names.index(name) for name in scenario_map.sensors]]
    flow = scenario_map.flow.going_on_from(replace(latest, counts=counts))
    return replace(scenario_map, flow=flow, test_flow=flow), latest.known
