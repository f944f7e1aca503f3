"""Maps of a scenario: streets, crowds and waits, drawn from a seed or read from the files that a venue names."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from typing import Any, Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, UInt32

from sidestep.arguments import INDEX, SEED, checked, instance
from sidestep.compilation import keep_compiled
from sidestep.crowds.base import FlowModel
from sidestep.crowds.counts import CountTable, LatestCounts, latest_counts
from sidestep.errors import SidestepError
from sidestep.files import cached_by_files
from sidestep.network.graph import RoadNetwork
from sidestep.network.parts import TownPart
from sidestep.network.snapping import Snapper, SplitStreets
from sidestep.programs import on_device, program
from sidestep.scenarios.crowd_sources import HOUR, check_crowds, crowds_of
from sidestep.scenarios.grids import on_grids
from sidestep.scenarios.model import A_SCENARIO, Scenario
from sidestep.scenarios.places import Grid, Traffic, Venue
from sidestep.scenarios.spec import Fault, ScenarioError
from sidestep.scenarios.stations import check_ways, nearest
from sidestep.scenarios.streets import ENDS, ends_of, town_of, walked_streets
from sidestep.scenarios.walkers import Walker
from sidestep.walking.opening import AnyWaits, with_opening_times
from sidestep.walking.speed_laws import Law
from sidestep.walking.waits import NoWaits, Waits

MOST_UNSIGNALISED = 8  # crossings without lights on one street; with more, waits might change faster than time goes by
# Of the busiest hour's traffic, by hour of the day: a working day in a city, as an assumption.
DAY_OF_TRAFFIC = (
    0.10, 0.06, 0.05, 0.05, 0.08, 0.20, 0.45, 0.80, 0.95, 0.75, 0.70, 0.75,
    0.80, 0.80, 0.80, 0.85, 0.95, 1.00, 0.85, 0.65, 0.50, 0.40, 0.30, 0.18,
)  # fmt: skip
Purpose = Literal["learn", "explore", "test", "expect"]
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
    connected: bool = eqx.field(static=True, default=False)
    """Whether paths are known to lead from every node to all others of its part, as on grids."""

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
        parent, fraction = on_device(streets.parent, np.int32), on_device(streets.fraction)
        flow, waits, pace = _pieces(
            self.flow, self.waits, self.network.pace, parent, fraction, on_device(streets.begins_at_crossing, np.bool_)
        )
        network = replace(streets.network, pace=pace)
        return ScenarioMap(network, flow, flow, self.key, (network.nodes,), self.sensors, waits=waits)

    @property
    def fingerprint(self) -> str:
        """The same for the same streets with the same expected crowds, whatever the speeds, and for no others."""
        told = (replace(self.network, pace=None), self.flow, self.waits)
        network, flow, waits = (str(jax.tree.structure(each)).removeprefix("PyTreeDef(")[:-1] for each in told)
        # What streets and waits have none of is left out: older models, which know of no such thing, keep their maps.
        structure = ", ".join([network.replace(", None", ""), flow, waits.replace(", None", "")])
        digest = hashlib.sha256(f"PyTreeDef(({structure}))".encode())
        for leaf in jax.tree.leaves(told):
            digest.update(f"{leaf.shape}".encode() + np.asarray(leaf).tobytes())
        return digest.hexdigest()[:16]


A_MAP = instance(ScenarioMap, "a map, such as sidestep.draw_map(scenario, seed=0)")
"""What public functions take as a scenario's map."""


@checked(ScenarioError, scenario=A_SCENARIO, seed=SEED, index=INDEX)
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
    ScenarioError
        Anything but a scenario (field ``scenario``), or numbers of 0 or more (``seed`` and ``index``).
    SidestepError
        Files of a venue that cannot be read or do not fit.

    Examples
    --------
    >>> from sidestep.scenarios.builtin import scenario
    >>> from sidestep.scenarios.maps import draw_map
    >>> drawn = draw_map(scenario("paper-congested", side=3, crowded_nodes=2), seed=0)
    >>> drawn.network.nodes, drawn.network.segments
    (9, 24)
    """
    keep_compiled()  # programs are compiled for the map next
    key = _key(seed, index)
    match scenario.place:
        case Grid() as grid:
            side = grid.sides[index % len(grid.sides)]
            return _grid_map(key, *on_grids(grid, side, [(seed, index)], scenario.slot_seconds))
        case Venue() as venue:
            return replace(_venue_map(venue, scenario.walker, scenario.slot_seconds, scenario.law), key=key)


@checked(ScenarioError, scenario=A_SCENARIO, seed=SEED, index=INDEX)
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
    keep_compiled()
    match scenario.place:
        case Grid(training_maps=number) as grid if number:
            seeds = [(seed, another, _LEARN) for another in range(number)]
            return _grid_map(_key(seed, index), *on_grids(grid, grid.side, seeds, scenario.slot_seconds))
        case _:
            return draw_map(scenario, seed, index)


_LEARN = 1  # a third number makes another stream: no map that is compared on has one


def _key(seed: int, index: int) -> Key[Array, ""]:
    """The random stream of a map, different for every seed and map number."""
    # A key made of plain numbers needs no compiled program.
    return jax.random.wrap_key_data(on_device(np.random.SeedSequence([seed, index]).generate_state(2), np.uint32))


def _grid_map(key: Key[Array, ""], network: RoadNetwork, flow: FlowModel, parts: tuple[int, ...]) -> ScenarioMap:
    return ScenarioMap(network, flow, flow, key, parts, connected=True)


@cached_by_files(lambda venue, *_: venue.files)
def _venue_map(venue: Venue, walker: Walker, slot_seconds: float, law: Law) -> ScenarioMap:
    """The first map of seed 0 of a venue as its walker has it, made once as long as its files stay as they are.

    Crowds, lights and traffic are those of all streets, for every walker.

    Returns
    -------
    ScenarioMap
        The streets that the walker takes, at its paces.
    """
    whole, part = _crowded_streets(venue, slot_seconds, law), walked_streets(venue.streets, walker)
    if part.left_out:
        whole = _on_part(whole, part)
    if (pace := walker.paces(part.town)) is not None:
        whole = replace(whole, network=replace(whole.network, pace=on_device(pace)))
    if (lifts := walker.lift_waits(part.town)) is not None:
        whole = replace(whole, waits=whole.waits.with_fixed(on_device(lifts)))
    origins, destinations = (ends_of(venue, walker, name) for name in ENDS)
    return replace(whole, origins=origins, destinations=destinations)


@cached_by_files(lambda venue, *_: venue.files)
def _crowded_streets(venue: Venue, slot_seconds: float, law: Law) -> ScenarioMap:
    """All streets of a venue, with their crowds and waits."""
    snapper = Snapper(town_of(venue.streets))
    network = snapper.town.network()
    flow, test_flow, sensors = crowds_of(venue, snapper, network, slot_seconds, law)
    waits = waits_of(snapper, venue.traffic)
    return ScenarioMap(network, flow, test_flow, _key(0, 0), (network.nodes,), sensors, waits=waits)


def _on_part(whole: ScenarioMap, part: TownPart) -> ScenarioMap:
    """Crowds and waits on the streets that are left."""
    segments = jnp.asarray(part.segments())
    flow, test_flow = (each.on_pieces(segments, jnp.ones(segments.shape)) for each in (whole.flow, whole.test_flow))
    waits = whole.waits.on_pieces(segments, jnp.ones(segments.shape, bool))
    return replace(whole, network=part.town.network(), flow=flow, test_flow=test_flow, waits=waits)


@program()  # of all arrays at once: one by one, each costs a millisecond
def _pieces(
    flow: FlowModel,
    waits: AnyWaits,
    pace: Array | None,
    parent: Int[Array, " piece"],
    fraction: Float[Array, " piece"],
    first: Bool[Array, " piece"],
) -> tuple[FlowModel, AnyWaits, Array | None]:
    """Crowds, waits and paces on pieces of segments."""
    return flow.on_pieces(parent, fraction), waits.on_pieces(parent, first), None if pace is None else pace[parent]


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


def mistakes(venue: Venue, walker: Walker) -> list[Fault]:
    """Find what is wrong with the files that a venue names, and with what is looked for in them.

    Parameters
    ----------
    venue
        The place; its files may be missing or damaged.
    walker
        Who walks there.

    Returns
    -------
    list[Fault]
        The mistakes, with their fields from the scenario inwards. After a file that cannot be read there is no other.
    """
    found: list[Fault] = []

    def attempt(
        keys: tuple[str, ...], function: Callable[..., Any], *arguments: Any, within: tuple[str, ...] = ("place",)
    ) -> Any:
        path = (*within, *keys)
        try:
            return function(*arguments)
        except SidestepError as error:
            found.append(Fault(path, str(error) if error.field else f"{'.'.join(path)}: {error}"))

    snapper = attempt(("streets",), lambda: Snapper(town_of(venue.streets)))
    if snapper is not None and check_crowds(venue, snapper, attempt):
        for light in venue.traffic.lights if venue.traffic else ():
            attempt(("traffic", "lights", light.name), nearest, snapper, light.place, "lights", light.name)
        part = attempt(("walker",), walked_streets, venue.streets, walker, within=())
        if part is not None:
            origins, destinations = (attempt((name,), ends_of, venue, walker, name) for name in ENDS)
            # Walks from anywhere to anywhere are checked where they are drawn: a route needs only its own path.
            if None not in (origins, destinations) and (origins or destinations):
                attempt(("destinations",), check_ways, part.town.network(), origins, destinations)
    return found


def purpose_key(scenario_map: ScenarioMap, purpose: Purpose, part: int = 0) -> Key[Array, ""]:
    """The random stream of one purpose on one map; ``part`` numbers independent streams within it."""
    numbers = (PURPOSES.index(purpose), part) if part else (PURPOSES.index(purpose),)
    return _folded(scenario_map.key, on_device(np.array(numbers), np.uint32))


@program()
def _folded(key: Key[Array, ""], numbers: UInt32[Array, " n"]) -> Key[Array, ""]:
    """A key with some numbers folded into it, one after the other."""
    for number in numbers:
        key = jax.random.fold_in(key, number)
    return key


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
    latest = latest_counts(table, sensor_names(scenario_map), departure)
    return with_latest_counts(scenario_map, latest), latest.known


def sensor_names(scenario_map: ScenarioMap) -> list[str]:
    """The names of a map's sensors, each once: one may stand in several places."""
    return list(dict.fromkeys(scenario_map.sensors))


def with_latest_counts(scenario_map: ScenarioMap, latest: LatestCounts) -> ScenarioMap:
    """A map whose crowds go on from the latest counts.

    Parameters
    ----------
    scenario_map
        The map.
    latest
        Of the sensors in the order of :func:`sensor_names`.

    Returns
    -------
    ScenarioMap
        The same map with other crowds.

    Raises
    ------
    CountsError
        Crowds that are not known from sensors.
    """
    names = sensor_names(scenario_map)
    flow = scenario_map.flow.going_on_from(latest.of([names.index(name) for name in scenario_map.sensors]))
    return replace(scenario_map, flow=flow, test_flow=flow)
