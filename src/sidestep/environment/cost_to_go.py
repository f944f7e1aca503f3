"""Costs to go: from every node, at every time, the least cost of getting to a destination through changing crowds.

One pass by decreasing order of time (Chabini 1998, doi:10.3141/1645-21) serves all origins and all departures. Cost is
known at the beginning of every slot and taken to be linear in between; crossings shorter than a slot lead back into it,
which a short iteration settles. Exact where speeds do not change.

The levels ``map`` and ``live`` look such costs up; they are worked out before walkers set out.
"""

import math
from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.environment.crossing import CrossStep, crossing_steps, static_crossing_in, with_mean_waits
from sidestep.environment.types import EnvParams, ExpectedCostToGo, Information, Instance, KnowledgeError, LiveCostToGo
from sidestep.network.graph import ABSENT, RoadNetwork
from sidestep.walking.expected_times import Speeds, SpeedsOrTimes
from sidestep.walking.speed_field import SpeedField
from sidestep.walking.waits import Wait

UNREACHABLE = 1e9
"""Cost in s where no path leads to the destination; finite, so that it can be interpolated."""
SETTLED = 0.01
"""Change in s below which the iteration within a slot ends."""
BEYOND = 1e5
"""Cost in s above which it ends below a share of the cost, 1 s for as many seconds."""
WINDOW = 24
"""Slots that a forecast looks ahead; beyond, crowds are taken to be as expected."""
GATE_STEP = 60.0
"""Seconds between the clocks for which costs are tabulated where they jump as gates shut."""
_TOO_LOW = "the environment was made for a level below"
Destination = Bool[Array, " node"]
"""Nodes of the destination; the nearest one counts."""
Ahead = Callable[[Float[Array, " counter"], Float[Array, ""], Int[Array, ""]], SpeedField]
"""Speeds in a slot and the next ones, from its counts, the hour of the week at clock 0 and its number."""


def static_cost_to_go(
    network: RoadNetwork, cost: Float[Array, " segment"], destination: Destination
) -> Float[Array, " node"]:
    """Cost from every node if those of crossing segments stay as they are (Bellman and Ford).

    Parameters
    ----------
    network, cost
        Streets, and the cost in s of crossing each segment.
    destination
        Nodes of the destination; the nearest one counts.

    Returns
    -------
    Float[Array, " node"]
        Cost in s; ``UNREACHABLE`` or more where no path leads.
    """
    onward = jnp.where(network.exits_to(destination), cost[network.exit_segment], UNREACHABLE)
    return _improved(onward, network.exit_node, jnp.where(destination, 0.0, UNREACHABLE))


def static_cost_from(
    network: RoadNetwork, cost: Float[Array, " segment"], destination: Destination, exits: Int[Array, " node"]
) -> tuple[Float[Array, " node"], Int[Array, " node"]]:
    """:func:`static_cost_to_go`, sooner where good paths are known, such as the best ones at other costs.

    Parameters
    ----------
    network, cost, destination
        As there.
    exits
        The exit of each node along these paths.

    Returns
    -------
    to_go : Float[Array, " node"]
        The same costs.
    exits : Int[Array, " node"]
        The best exit of each node.
    """
    onward = jnp.where(network.exits_to(destination), cost[network.exit_segment], UNREACHABLE)
    # Both searches add up the same numbers: else paths known before might seem to cost less than they do.
    onward = jax.lax.optimization_barrier(onward)  # type: ignore[no-untyped-call]
    chosen = exits[:, None]
    known, onto = (jnp.take_along_axis(each, chosen, axis=1) for each in (onward, network.exit_node))
    to_go = _improved(known, onto, jnp.where(destination, 0.0, UNREACHABLE))
    to_go = _improved(onward, network.exit_node, to_go)
    return to_go, jnp.argmin(onward + to_go[network.exit_node], axis=1).astype(jnp.int32)


def _improved(
    onward: Float[Array, "node exit"], onto: Int[Array, "node exit"], to_go: Float[Array, " node"]
) -> Float[Array, " node"]:
    """Lower costs, as long as a better path leads over some exit."""

    def improve(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        to_go, _ = carry
        better = jnp.minimum(to_go, jnp.min(onward + to_go[onto], axis=1))
        return better, (better < to_go).any()

    return jax.lax.while_loop(lambda carry: carry[1], improve, (to_go, jnp.bool_(True)))[0]


def cost_to_go(
    network: RoadNetwork,
    cross: CrossStep,
    slots: int,
    slot_seconds: float,
    destination: Destination,
    later: Float[Array, " node"],
) -> Float[Array, "slot node"]:
    """Cost from every node, as each slot begins.

    Parameters
    ----------
    network
        Streets.
    cross
        Walks each segment, entered as a slot begins.
    slots, slot_seconds
        How many, and their length in s.
    destination
        Nodes of the destination; the nearest one counts.
    later
        Cost to go after the last of the slots.

    Returns
    -------
    Float[Array, "slot node"]
        Cost in s; ``UNREACHABLE`` or more where no path leads.

    References
    ----------
    Chabini (1998), doi:10.3141/1645-21.
    """
    head, valid = network.exit_node, network.exits_to(destination)
    start = jnp.broadcast_to(later, (slots + 1, network.nodes))

    def one_slot(table: Array, slot: Int[Array, ""]) -> tuple[Array, None]:
        crossed = cross(slot)
        seconds, cost = crossed.seconds, crossed.cost
        ahead = seconds[network.exit_segment] / slot_seconds
        whole = jnp.floor(ahead)
        part = ahead - whole
        before = slot + whole.astype(jnp.int32)
        # Within this slot: the cost at its beginning is sought, and only that at its end is known.
        within = before == slot
        known = jnp.where(within, 0.0, (1 - part) * table[jnp.minimum(before, slots), head])
        known = cost[network.exit_segment] + known + part * table[jnp.minimum(before + 1, slots), head]
        known = jnp.where(valid, known, UNREACHABLE)
        weight = jnp.where(within, 1 - part, 0.0)

        def settle(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            to_go, _, times = carry
            found = jnp.where(destination, 0.0, jnp.min(known + weight * to_go[head], axis=1))
            found = jnp.minimum(found, UNREACHABLE)
            # Costs beyond all walks, between a slot with a path and one without, are too large to settle to the second.
            change = jnp.abs(found - to_go) - jnp.where(found > BEYOND, found / BEYOND, 0.0)
            return found, jnp.max(change), times + 1

        # Rounding of very long times might never settle.
        start = (table[slot + 1], jnp.float32(jnp.inf), jnp.int32(0))
        to_go, *_ = jax.lax.while_loop(lambda carry: (carry[1] > SETTLED) & (carry[2] <= network.nodes), settle, start)
        return table.at[slot].set(to_go), None

    table, _ = jax.lax.scan(one_slot, start, jnp.arange(slots), reverse=True)
    return table[:-1]


def at_clock(
    table: Float[Array, "*destination slot node"],
    slot_seconds: float,
    clock: Float[Array, " n"],
    node: Int[Array, " n"],
    destination: Int[Array, ""] | None = None,
) -> Float[Array, " n"]:
    """Cost to go from nodes at clocks, linear between the beginnings of slots.

    Parameters
    ----------
    table, slot_seconds
        Cost as each slot begins, and the length of a slot in s.
    clock, node
        When and from where.
    destination
        Picks one of several tables. (It is part of the index, since picking a table first would copy it for every
        walker.)

    Returns
    -------
    Float[Array, " n"]
        Cost in s.
    """
    which = () if destination is None else (destination,)
    last = table.shape[-2] - 1
    position = jnp.clip(clock / slot_seconds, 0.0, last)
    slot = jnp.floor(position).astype(jnp.int32)
    part = position - slot
    return (1 - part) * table[(*which, slot, node)] + part * table[(*which, jnp.minimum(slot + 1, last), node)]


def gate_steps(params: EnvParams, slot_seconds: float, step: float = GATE_STEP) -> int:
    """In how many steps of a slot costs to go are tabulated: in one where there are no gates."""
    return math.ceil(slot_seconds / step) if params.waits.gates else 1


def field_cost_to_go(
    params: EnvParams, speeds: SpeedsOrTimes, wait: Wait, destination: Destination, *, every: int = 1
) -> Float[Array, "step node"]:
    """Cost from every node through one future, or as expected; the last slot lasts for ever.

    Parameters
    ----------
    params
        The environment.
    speeds, wait
        Walking speeds, or expected times to cross, and seconds to wait before segments.
    destination
        Nodes of the destination; the nearest one counts.
    every
        Steps in each slot, at whose beginnings costs are worked out.

    Returns
    -------
    Float[Array, "step node"]
        Cost in s as each step begins.
    """
    network, cross = params.network, crossing_steps(params, speeds, wait, every=every)
    steps = speeds.slots * every
    later = static_cost_to_go(network, cross(jnp.int32(steps - every)).cost, destination)  # as the last slot begins
    return cost_to_go(network, cross, steps, speeds.slot_seconds / every, destination, later)


def expected_cost_to_go(
    params: EnvParams,
    destinations: Bool[Array, "destination node"],
    hours: Float[Array, " destination"],
    scaled: Speeds | None = None,
) -> ExpectedCostToGo:
    """Expected costs of getting to some destinations.

    Parameters
    ----------
    params
        The environment, with what is expected.
    destinations
        Nodes of each destination; no node may belong to two.
    hours
        Hour of the week at which walks to each of them set out.
    scaled
        What is expected in crowds ``DENSITY_SCALE`` times as dense, if that is known.

    Returns
    -------
    ExpectedCostToGo
        A table for each destination.
    """
    every = gate_steps(params, params.expected.slot_seconds)

    def tables(expected: Speeds) -> Float[Array, "destination step node"]:
        def one(number: Int[Array, ""]) -> Float[Array, "step node"]:
            wait = partial(params.waits.averaged().seconds, hours[number], jnp.float32(0))
            field = expected.of(number % expected.count)
            return field_cost_to_go(params, field, wait, destinations[number], every=every)

        return jax.lax.map(one, jnp.arange(len(destinations)))

    of_scaled = None if scaled is None else tables(scaled)
    return ExpectedCostToGo(tables(params.expected), _numbers(destinations), of_scaled, every)


def unknown_cost_to_go(destinations: Bool[Array, "destination node"]) -> ExpectedCostToGo:
    """The same without costs, which are all 0: for walkers who look at snapshots only."""
    return ExpectedCostToGo(jnp.zeros((len(destinations), 1, destinations.shape[1])), _numbers(destinations))


def _numbers(destinations: Bool[Array, "destination node"]) -> Int[Array, " node"]:
    """Number of the destination that each node belongs to; -1 where it belongs to none."""
    # Keeps XLA from folding this where destinations are constants, which takes far longer than to run it.
    destinations = jax.lax.optimization_barrier(destinations)  # type: ignore[no-untyped-call]
    number = jnp.where(destinations.any(axis=0), jnp.argmax(destinations, axis=0), ABSENT)
    return number.astype(jnp.int32)


def live_cost_to_go(
    params: EnvParams,
    counted: Float[Array, "future slot counter"],
    ahead: Ahead,
    slot: Int[Array, ""] | None = None,
    wanted: Bool[Array, " future"] | None = None,
    *,
    forecasts: bool = True,
) -> LiveCostToGo:
    """Costs from all counts of every slot of every future, or of one slot, to that future's destination.

    Parameters
    ----------
    params
        The environment, of level ``map`` at least.
    counted
        What is known of each slot as it begins: the people on each segment, or the densities at counters.
    ahead
        Turns that into the speeds that are forecast from it; after its window crowds are as expected.
    slot
        The only slot whose costs are worked out; by default those of all are.
    wanted
        In which futures; by default in all. Costs in others mean nothing.
    forecasts
        Whether costs are forecast.

    Returns
    -------
    LiveCostToGo
        With lights at their mean wait.
    """
    params, expected = with_mean_waits(params), known_cost_to_go(params)
    futures, speeds, every = params.futures, params.futures.speeds, jnp.arange(params.network.segments)
    first, slots = (0, speeds.slots) if slot is None else (slot, 1)
    which = jnp.arange(speeds.count) if wanted is None else jnp.argsort(~wanted)
    number = speeds.count if wanted is None else jnp.sum(wanted, dtype=jnp.int32)

    def one(future: Array, slot: Array, exits: Array) -> tuple[tuple[Array, ...], Array]:
        """Costs of one slot of one future, and the best exits there if crowds stay as they are."""
        waited = params.wait_in(future)(every, jnp.full(every.shape, slot * speeds.slot_seconds))
        stays = static_crossing_in(params, speeds, future, slot, every, waited)
        destination = expected.destination == futures.destination[future]
        snapshot, exits = static_cost_from(params.network, stays.cost, destination, exits)
        if not forecasts:
            return (snapshot,), exits
        field = ahead(counted[future, slot], futures.hour[future], slot)
        return (snapshot, _forecast(params, field, future, slot)), exits

    def write(turn: Array, carry: tuple[tuple[Array, ...], Array]) -> tuple[tuple[Array, ...], Array]:
        tables, exits = carry
        future, row = which[turn // slots], turn % slots
        found, exits = one(future, first + row, exits)
        return tuple(table.at[future, row].set(each) for table, each in zip(tables, found, strict=True)), exits

    none = jnp.zeros(params.network.nodes, jnp.int32)  # no path is known beforehand
    shapes, _ = jax.eval_shape(one, jnp.int32(0), jnp.int32(0), none)
    empty = tuple(jnp.zeros((speeds.count, slots, *row.shape), row.dtype) for row in shapes)
    tables, _ = jax.lax.fori_loop(0, number * slots, write, (empty, none))
    return LiveCostToGo(*tables)


def _forecast(
    params: EnvParams, speeds: SpeedField, future: Int[Array, ""], slot: Int[Array, ""]
) -> Float[Array, "step segment"]:
    """Cost to a future's destination over each segment, entered as each step of the slot begins, and as it ends.

    Returns
    -------
    Float[Array, "step segment"]
        Without penalties for entering a segment that is too dense: walkers see there whether they have to pay them.
    """
    network, slot_seconds = params.network, speeds.slot_seconds
    every = gate_steps(params, slot_seconds)
    step_seconds = slot_seconds / every
    expected, number = known_cost_to_go(params), params.futures.destination[future]
    cross = crossing_steps(params, speeds, params.wait_in(future), begins=slot * slot_seconds, every=every)
    then = slot + speeds.slots if expected.steps == 1 else (slot + speeds.slots) * expected.steps
    later = expected.table[number, jnp.minimum(then, expected.table.shape[1] - 1)]
    steps = speeds.slots * every
    before = cost_to_go(network, cross, steps, step_seconds, expected.destination == number, later)
    table = jnp.concatenate([before, later[None]])
    over = jax.vmap(partial(at_clock, table, step_seconds, node=network.head))
    first = jax.lax.map(cross, jnp.arange(min(every + 1, steps)))
    cost = first.cost - params.objective.penalty * first.measures.get("too_dense", 0.0)
    return cost + over(clock=jnp.arange(every + 1.0)[:, None] * step_seconds + first.seconds)


def known_cost_to_go(params: EnvParams) -> ExpectedCostToGo:
    """The environment's expected costs.

    Returns
    -------
    ExpectedCostToGo
        The tables of all destinations.

    Raises
    ------
    KnowledgeError
        An environment that was made for a lower level.
    """
    if params.cost_to_go is None:
        raise KnowledgeError(f"{_TOO_LOW} map: no expected costs are known", field="level")
    return params.cost_to_go


def known_live_cost_to_go(params: EnvParams) -> LiveCostToGo:
    """The environment's costs from all counts.

    Returns
    -------
    LiveCostToGo
        The tables of all futures.

    Raises
    ------
    KnowledgeError
        An environment that was made for a lower level.
    """
    if params.futures.cost_to_go is None:
        raise KnowledgeError(f"{_TOO_LOW} live: no forecasts are known", field="level")
    return params.futures.cost_to_go


def check_known(params: EnvParams, instances: Instance, level: Information | None = None) -> None:
    """Refuse walks that the levels ``map`` and ``live`` know nothing about; compiled programs could not.

    Parameters
    ----------
    params, instances
        The environment, and the walks.
    level
        What walkers see; by default the environment's level.

    Raises
    ------
    KnowledgeError
        An environment that was made for a lower level; a destination that it was not made for; at level ``live``, or
        where hours differ, a future that is for another destination.
    """
    level = level or params.level
    if level not in ("map", "live"):
        return
    destination, future = np.atleast_1d(instances.destination), np.atleast_1d(instances.future)
    number = np.asarray(known_cost_to_go(params).destination)[destination]
    if (number < 0).any():
        unknown = destination[number < 0][0]
        said = f"no costs of getting to node {unknown} are known"
        raise KnowledgeError(f"{said}; give it to make_environment among the destinations", field="destinations")
    if level == "live":
        known_live_cost_to_go(params)
    elif known_cost_to_go(params).table.shape[-2] < params.expected.slots:
        raise KnowledgeError(f"{_TOO_LOW} map: costs were not worked out; leave out costs=False", field="level")
    if level == "map" and params.expected.count == 1 and not params.waits.gates:
        return
    wrong = np.flatnonzero(number != np.asarray(params.futures.destination)[future])
    if len(wrong):
        said = f"walk {wrong[0]} meets future {future[wrong[0]]}, which is for another destination"
        raise KnowledgeError(f"{said}; take the walks of sidestep.instances", field="instances")
