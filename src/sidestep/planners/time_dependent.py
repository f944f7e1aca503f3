"""Time-dependent search: the fastest way, or the cheapest, through crowds that are known to change.

Under the integrated crossing rule nobody who enters a segment later leaves it earlier (FIFO), so earliest arrivals
obey Bellman's equation and label-correcting finds the exact optimum. Under the paper's ``entry`` rule they do not:
what is found then is the best of the walks that reach every crossing as early as possible, and no bound.
"""

import math
from collections.abc import Callable
from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.environment.cost_to_go import at_clock, field_cost_to_go
from sidestep.environment.crossing import cross_at_speeds, with_mean_waits
from sidestep.environment.types import EnvParams, Information, Instance, Level, Observation
from sidestep.network.graph import RoadNetwork
from sidestep.planners.base import DecideByPlan, Plan, choose_allowed
from sidestep.walking.crossing_time import CrossingRule, leaving_clock
from sidestep.walking.speed_field import SpeedField, Speeds
from sidestep.walking.waits import Wait

FEWEST, SMALLEST = 8, 4  # nodes that are gone on from at a time, and in a group
Leave = Callable[[Int[Array, ""], Float[Array, ""]], Float[Array, ""]]  # segment, clock at its beginning -> at its end


def earliest_arrivals(
    network: RoadNetwork,
    field: SpeedField,
    origin: Int[Array, ""],
    departure: Float[Array, ""],
    rule: CrossingRule = "integrated",
) -> tuple[Float[Array, " node"], Int[Array, " node"]]:
    """Earliest clock at which every node can be reached, and the segment over which it is.

    Unreachable nodes get infinity and segment -1.
    """
    only = SpeedField(field.speed[None], field.covered[None], field.slot_seconds)
    leave = _through(network, only, jnp.int32(0), rule, lambda _segment, clock: jnp.zeros_like(clock))
    return _arrivals(network, leave, origin, departure)


def _through(network: RoadNetwork, speeds: Speeds, future: Int[Array, ""], rule: CrossingRule, wait: Wait) -> Leave:
    def leave(segment: Int[Array, ""], clock: Float[Array, ""]) -> Float[Array, ""]:
        entered = clock + wait(segment, clock)
        return leaving_clock(speeds, future, segment, network.length[segment], entered, rule)

    return leave


def _arrivals(
    network: RoadNetwork,
    leave: Leave,
    origin: Int[Array, ""],
    departure: Float[Array, ""],
    destination: Int[Array, ""] | None = None,
) -> tuple[Float[Array, " node"], Int[Array, " node"]]:
    """Earliest clocks and the segments that lead there; with a ``destination``, of all that is reached before it.

    Label-correcting: again and again from a few nodes that were reached earliest and not gone on from since. Hardly
    any has to be gone on from twice, only segments that somebody comes to are worked out, and nobody goes on who is no
    earlier than the destination is reached already: whatever they improved would be later still.

    Nodes stand in groups, of which the earliest is known: looking through all of them would take longer than the rest.
    """
    size = max(SMALLEST, math.isqrt(network.nodes) // 4)
    groups = -(-network.nodes // size)
    several, none = min(max(FEWEST, math.isqrt(network.nodes) // 3), groups), groups * size

    def limit(arrival: Float[Array, " node"]) -> Float[Array, ""]:
        return jnp.float32(jnp.inf) if destination is None else arrival[destination]

    def improve(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        arrival, via, due, least = carry
        earliest, group = jax.lax.top_k(-least, several)
        clock, members = -earliest, due[group]
        first = jnp.argmin(members, axis=1)
        node, others = group * size + first, jnp.arange(size) != first[:, None]
        due = due.at[group, first].set(jnp.inf)
        least = least.at[group].set(jnp.min(members, axis=1, where=others, initial=jnp.inf))
        # Nobody can enter at infinity, so those who are not to go on are asked about clock 0 and then put back.
        goes = clock < limit(arrival)
        segment = network.exit_segment[node]
        there = jax.vmap(jax.vmap(leave, (0, None)))(segment, jnp.where(goes, clock, 0.0))
        there = jnp.where((segment >= 0) & goes[:, None], there, jnp.inf).reshape(-1)
        segment, head = segment.reshape(-1), network.exit_node[node].reshape(-1)
        better = (there < arrival[head]) & (there < limit(arrival))
        arrival = arrival.at[jnp.where(better, head, none)].min(there, mode="drop")
        # What is set at number `none`, which is beyond the last, is dropped.
        reached = jnp.where(better & (there == arrival[head]), head, none)
        via = via.at[reached].set(segment, mode="drop")
        due = due.at[reached // size, reached % size].set(there, mode="drop")
        return arrival, via, due, least.at[reached // size].min(there, mode="drop")

    start = jnp.full(none, jnp.inf).at[origin].set(departure)
    due = start.reshape(groups, size)
    arrival, via, _, _ = jax.lax.while_loop(
        lambda carry: (carry[3] < limit(carry[0])).any(),
        improve,
        (start, jnp.full(none, -1), due, jnp.min(due, axis=1)),
    )
    return arrival[: network.nodes], via[: network.nodes]


def fastest_exits(network: RoadNetwork, leave: Leave, instance: Instance) -> Bool[Array, "node exit"]:
    """The exits along the fastest way of one walk."""
    _, via = _arrivals(network, leave, instance.origin, instance.departure, instance.destination)

    def back(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        node, chosen = carry
        return network.tail[via[node]], chosen.at[via[node]].set(True)

    start = (instance.destination, jnp.zeros(network.segments, bool))
    _, chosen = jax.lax.while_loop(lambda carry: via[carry[0]] >= 0, back, start)
    return chosen[network.exit_segment] & network.valid


STEP, FINE_STEP = 60.0, 15.0  # s; the latter where costs jump: at lights, and where a street becomes too dense
LEAST_STEPS = 1_000  # of a plan, which may walk to and fro for a while


def least_cost_path(params: EnvParams, field: SpeedField, instance: Instance) -> Int[Array, " step"]:
    """The exits, one after the other, of the walk that costs least by the environment's objective.

    Costs, unlike arrivals, obey no principle of the earliest: it may pay to arrive later, and even to walk to and fro
    until a crowd is gone. So they are worked out backwards, for every ``STEP`` seconds, and taken to be linear in
    between: exact but for that.
    """
    network, wait = params.network, params.wait_in(instance.future)
    destination = jnp.arange(network.nodes) == instance.destination
    jumps = params.waits.phases or params.objective.jumps
    every = math.ceil(field.slot_seconds / (FINE_STEP if jumps else STEP))
    table = field_cost_to_go(params, field, wait, destination, every=every)
    longest = max(4 * network.nodes, LEAST_STEPS)

    def onward(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        node, clock, way, steps = carry
        onto, segment = network.exit_node[node], network.exit_segment[node]
        ahead = jax.vmap(lambda one: cross_at_speeds(params, field.segment(one), wait, one, clock))(segment)
        to_go = at_clock(table, field.slot_seconds / every, clock + ahead.seconds, onto)
        best = jnp.argmin(jnp.where(network.valid[node], ahead.cost + to_go, jnp.inf)).astype(jnp.int32)
        return onto[best], clock + ahead.seconds[best], way.at[steps].set(best), steps + 1

    start = (instance.origin, instance.departure, jnp.zeros(longest, jnp.int32), jnp.int32(0))
    *_, way, _ = jax.lax.while_loop(
        lambda carry: (carry[0] != instance.destination) & (carry[3] < longest), onward, start
    )
    return way


@jax.jit
def _plan(
    params: EnvParams, speeds: Speeds, which: Int[Array, " walk"], instances: Instance
) -> Bool[Array, "walk node exit"] | Int[Array, "walk step"]:
    def fastest(number: Int[Array, ""], instance: Instance) -> Bool[Array, "node exit"]:
        wait = params.wait_in(instance.future)
        return fastest_exits(params.network, _through(params.network, speeds, number, params.rule, wait), instance)

    def cheapest(walk: tuple[Int[Array, ""], Instance]) -> Int[Array, " step"]:
        return least_cost_path(params, speeds.of(walk[0]), walk[1])

    if params.objective.earliest_is_best:
        return jax.vmap(fastest)(which, instances)
    return jax.lax.map(cheapest, (which, instances))


def keep_to_plan(
    shared: None, own: Bool[Array, "node exit"] | Int[Array, " step"], observation: Observation, key: Key[Array, ""]
) -> Int[Array, ""]:
    """Take the exit that was planned for this crossing; where time is not all that counts, for this step."""
    if own.ndim == 1:
        return own[jnp.minimum(observation.steps, own.shape[0] - 1)]
    return choose_allowed(shared, own, observation, key)


class Expected:
    """The fastest way, or the cheapest, if crowds were as expected: the best plan that is made beforehand and kept."""

    name: ClassVar[str] = "expected"
    level: ClassVar[Level] = "map"
    observes: ClassVar[Information] = "position"
    decide: ClassVar[DecideByPlan] = staticmethod(keep_to_plan)

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        return Plan(
            None, _plan(with_mean_waits(params), params.expected, params.expected_for(instances.future), instances)
        )


class Clairvoyant:
    """The fastest way, or the cheapest, through the crowds as they will be: the lower bound of everyone's time or cost.

    Of costs it is a bound up to the steps of :func:`cheapest_way`.
    """

    name: ClassVar[str] = "clairvoyant"
    level: ClassVar[Level] = "hindsight"
    observes: ClassVar[Information] = "position"
    decide: ClassVar[DecideByPlan] = staticmethod(keep_to_plan)

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, _plan(params, params.futures.speeds, instances.future, instances))
