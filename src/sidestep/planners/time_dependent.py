"""Time-dependent search: the path of least time, or of least cost, through crowds that are known to change.

Under the integrated crossing rule nobody who enters a segment later leaves it earlier (FIFO), so earliest arrivals
obey Bellman's equation, and label correcting finds the exact optimum. The paper's ``entry`` rule breaks FIFO: the
search then finds the best of the walks that reach every crossing as early as possible, which is no bound.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.environment.cost_to_go import at_clock, field_cost_to_go
from sidestep.environment.crossing import cross_at_speeds, with_mean_waits
from sidestep.environment.types import EnvParams, Instance, Level
from sidestep.network.graph import RoadNetwork
from sidestep.planners.base import Plan, Planned, walk_plan
from sidestep.programs import program
from sidestep.walking.crossing_time import CrossingRule, leaving_clock
from sidestep.walking.expected_times import Speeds, SpeedsOrTimes
from sidestep.walking.waits import Wait

LEAST_GROUPS = 8
"""Least number of groups of nodes that one turn of the search expands a node of."""

LEAST_GROUP_SIZE = 4
"""Least number of nodes in a group."""

ROUNDING = 1e-6
"""Share by which times may differ that are the same but for rounding."""

Leave = Callable[[Int[Array, ""], Float[Array, ""]], Float[Array, ""]]
"""The clock at which a segment is left, given the segment and the clock at which its tail is reached."""


def leaving(network: RoadNetwork, speeds: Speeds, future: Int[Array, ""], rule: CrossingRule, wait: Wait) -> Leave:
    """Say when segments are left that are crossed in one of the futures, after the wait before them."""

    def leave(segment: Int[Array, ""], clock: Float[Array, ""]) -> Float[Array, ""]:
        entered = clock + wait(segment, clock)
        return leaving_clock(speeds, future, segment, network.length[segment], entered, rule)

    return leave


def earliest_arrivals(
    network: RoadNetwork,
    leave: Leave,
    origin: Int[Array, ""],
    departure: Float[Array, ""],
    destination: Int[Array, ""] | None = None,
) -> tuple[Float[Array, " node"], Int[Array, " node"]]:
    """Find the earliest clock at which every node can be reached.

    Label correcting: each turn expands a few of the nodes that are due, the earliest first. So hardly any node is
    expanded twice, and crossing times are computed only for segments that somebody reaches. Nodes that are no earlier
    than the destination are never expanded: all that they could improve is later still.

    The earliest node that is due is known for each group of nodes; to look through all nodes would take longer than
    the rest of the search.

    Parameters
    ----------
    network
        The streets.
    leave
        When each segment is left, such as :func:`leaving` says.
    origin, departure
        Where the walk begins, and at which clock.
    destination
        If there is one, clocks are found only of nodes that are reached before it on the way there.

    Returns
    -------
    arrival : Float[Array, " node"]
        Infinite at nodes that nobody can reach.
    via : Int[Array, " node"]
        The last segment of the path to each node; -1 at the origin and at nodes that nobody can reach.

    References
    ----------
    K. L. Cooke and E. Halsey, The shortest route through a network with time-dependent internodal transit times (1966).
    """
    size = max(LEAST_GROUP_SIZE, math.isqrt(network.nodes) // 4)
    groups = -(-network.nodes // size)
    several, none = min(max(LEAST_GROUPS, math.isqrt(network.nodes) // 3), groups), groups * size

    def limit(arrival: Float[Array, " node"]) -> Float[Array, ""]:
        return jnp.float32(jnp.inf) if destination is None else arrival[destination]

    def may_take(node: Int[Array, " n"]) -> Bool[Array, "n exit"]:
        return network.exits_from(origin, node) if destination is None else network.exits_to(destination, node)

    def improve(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        arrival, via, due, least = carry
        earliest, group = jax.lax.top_k(-least, several)
        clock, members = -earliest, due[group]
        first = jnp.argmin(members, axis=1)
        node, others = group * size + first, jnp.arange(size) != first[:, None]
        due = due.at[group, first].set(jnp.inf)
        least = least.at[group].set(jnp.min(members, axis=1, where=others, initial=jnp.inf))
        # Nobody enters at infinity, so nodes that are not expanded are computed at clock 0 and then ignored.
        goes = clock < limit(arrival)
        segment = network.exit_segment[node]
        there = jax.vmap(jax.vmap(leave, (0, None)))(segment, jnp.where(goes, clock, 0.0))
        there = jnp.where(may_take(node) & goes[:, None], there, jnp.inf).reshape(-1)
        segment, head = segment.reshape(-1), network.exit_node[node].reshape(-1)
        better = (there < arrival[head]) & (there < limit(arrival))
        arrival = arrival.at[jnp.where(better, head, none)].min(there, mode="drop")
        # Number `none` lies beyond the last node, so what is set there is dropped. XLA may compute a time once for each
        # use, and not always round it alike.
        soonest = arrival[head]
        reached = jnp.where(better & (there <= soonest * (1 + ROUNDING)), head, none)
        via = via.at[reached].set(segment, mode="drop")
        due = due.at[reached // size, reached % size].set(soonest, mode="drop")
        return arrival, via, due, least.at[reached // size].min(soonest, mode="drop")

    start = jnp.full(none, jnp.inf).at[origin].set(departure)
    due = start.reshape(groups, size)
    begin = (start, jnp.full(none, -1), due, jnp.min(due, axis=1))
    arrival, via, *_ = jax.lax.while_loop(lambda carry: (carry[3] < limit(carry[0])).any(), improve, begin)
    return arrival[: network.nodes], via[: network.nodes]


def fastest_exits(
    params: EnvParams, speeds: Speeds, number: Int[Array, ""], instance: Instance
) -> tuple[Bool[Array, "node exit"], Float[Array, ""]]:
    """Find the fastest path of one walk through one of the crowds.

    Parameters
    ----------
    params
        The environment.
    speeds, number
        Speeds or expected times, and which of them count.
    instance
        One walk.

    Returns
    -------
    exits : Bool[Array, "node exit"]
        Marks those along the path; none where no path leads there.
    arrival : Float[Array, ""]
        Clock in s at the destination; infinite where no path leads there.
    """
    network = params.network
    leave = leaving(network, speeds, number, params.rule, params.wait_in(instance.future))
    arrival, via = earliest_arrivals(network, leave, instance.origin, instance.departure, instance.destination)

    def back(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        node, chosen = carry
        return network.tail[via[node]], chosen.at[via[node]].set(True)

    start = (instance.destination, jnp.zeros(network.segments, bool))
    _, chosen = jax.lax.while_loop(lambda carry: via[carry[0]] >= 0, back, start)
    return chosen[network.exit_segment] & network.valid, arrival[instance.destination]


STEP = 60.0
"""Seconds between the clocks for which costs are tabulated."""

FINE_STEP = 15.0
"""The same where costs jump: at traffic lights, at gates, and where a street becomes too dense."""

LEAST_STEPS = 1_000
"""Least length of a plan: it may pay to walk to and fro for a while."""


def steps_in_slot(params: EnvParams, slot_seconds: float) -> int:
    """In how many steps of a slot costs are tabulated."""
    jumps = params.waits.jumps or params.objective.jumps
    return math.ceil(slot_seconds / (FINE_STEP if jumps else STEP))


def least_cost_path(params: EnvParams, field: SpeedsOrTimes, instance: Instance) -> Int[Array, " step"]:
    """Find the walk of least cost by the environment's objective.

    Earlier is not always better for costs, as it is for arrivals: it may pay to arrive later, and even to walk to and
    fro until a crowd is gone. So costs are computed backwards in time, for every ``STEP`` seconds. They are linear in
    between, which is the only error.

    Parameters
    ----------
    params
        The environment.
    field
        The future to walk through, or expected times.
    instance
        One walk.

    Returns
    -------
    Int[Array, " step"]
        The exits, one after the other.

    References
    ----------
    I. Chabini, Discrete dynamic shortest path problems in transportation applications (1998).
    """
    network, wait, destination = params.network, params.wait_in(instance.future), instance.destination
    every = steps_in_slot(params, field.slot_seconds)
    table = field_cost_to_go(params, field, wait, jnp.arange(network.nodes) == destination, every=every)
    longest = max(4 * network.nodes, LEAST_STEPS)

    def onward(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        node, clock, path, steps = carry
        onto, segment = network.exit_node[node], network.exit_segment[node]
        ahead = jax.vmap(lambda one: cross_at_speeds(params, field.row(one), wait, one, clock))(segment)
        to_go = at_clock(table, field.slot_seconds / every, clock + ahead.seconds, onto)
        valid = network.exits_to(destination, node)
        best = jnp.argmin(jnp.where(valid, ahead.cost + to_go, jnp.inf)).astype(jnp.int32)
        return onto[best], clock + ahead.seconds[best], path.at[steps].set(best), steps + 1

    start = (instance.origin, instance.departure, jnp.zeros(longest, jnp.int32), jnp.int32(0))
    *_, path, _ = jax.lax.while_loop(lambda carry: (carry[0] != destination) & (carry[3] < longest), onward, start)
    return path


@program("foreseen")
def _plan(
    params: EnvParams, instances: Instance, *, foreseen: bool
) -> tuple[Bool[Array, "walk node exit"] | Int[Array, "walk step"], Float[Array, ""]]:
    """Find the best walks through the futures themselves, if these are ``foreseen``, or by expected times.

    Returns
    -------
    walks
        Exits at nodes, or one after the other.
    until : Float[Array, ""]
        Clock in s from which on other times to cross would not have changed any of them.
    """
    if foreseen:
        speeds, which = params.futures.speeds, instances.future
    else:
        params = with_mean_waits(params)
        speeds, which = params.expected, params.expected_for(instances.future)
    if params.objective.needs_density:
        paths = jax.lax.map(lambda walk: least_cost_path(params, speeds.of(walk[0]), walk[1]), (which, instances))
        return paths, jnp.float32(jnp.inf)
    exits, arrival = jax.vmap(partial(fastest_exits, params, speeds))(which, instances)
    return exits, jnp.max(arrival)


class Expected(Planned):
    """Keep to the path of least expected time: the best plan that can be made beforehand.

    Each street takes the mean of the times in many futures, those of no other purpose, not the time in the mean crowd.
    With an objective it is the path of least cost by these times, and the crowd that is met is the mean one.
    """

    name: ClassVar[str] = "expected"
    level: ClassVar[Level] = "map"

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, _plan(params, instances, foreseen=False)[0])

    def plan_within(self, params: EnvParams, instances: Instance) -> Plan | None:
        """Plan with times that are known for so long as the walks take."""
        # Where they are unknown no segment is entered, and what is reached before is reached as early as ever.
        plan, until = _plan(params, instances, foreseen=False)
        known = params.expected.known_until
        return Plan(None, plan) if math.isinf(known) or float(until) < known else None


class Clairvoyant(Planned):
    """Walk the path that is fastest through the crowds that will come: the lower bound of every planner's time.

    With an objective it is the path of least cost, a bound up to the time steps of :func:`least_cost_path`.
    """

    name: ClassVar[str] = "clairvoyant"
    level: ClassVar[Level] = "hindsight"

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, _plan(params, instances, foreseen=True)[0])

    def plan_within(self, params: EnvParams, instances: Instance) -> Plan:
        """Expect nothing."""
        return self.plan(params, instances)


def least_minutes(params: EnvParams, instances: Instance) -> Float[np.ndarray, " walk"]:
    """Work out how long the clairvoyant takes, in minutes; of cost where the objective is not time alone."""
    planner, unused = Clairvoyant(), jax.random.key(0)  # nothing is random in its walks
    walked = walk_plan(planner, params, planner.plan(params, instances), instances, unused)
    return np.asarray(walked.cost) / 60
