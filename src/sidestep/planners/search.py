"""Time-dependent search: the fastest way through crowds that are known to change.

Under the integrated crossing rule nobody who enters a segment later leaves it earlier (FIFO), so earliest arrivals
obey Bellman's equation and label-correcting finds the exact optimum. Under the paper's ``entry`` rule they do not:
what is found then is the best of the walks that reach every crossing as early as possible, and no bound.
"""

from functools import partial
from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sidestep.environment.types import EnvParams, Instance, Level, Seen
from sidestep.network.graph import RoadNetwork
from sidestep.planners.base import DecideByPlan, Plan, choose_allowed
from sidestep.travel_time import CrossingRule, SpeedField, Speeds, crossing_time


def earliest_arrivals(
    network: RoadNetwork,
    field: SpeedField,
    origin: Int[Array, ""],
    departure: Float[Array, ""],
    rule: CrossingRule = "integrated",
) -> tuple[Float[Array, " node"], Int[Array, " node"]]:
    """Earliest clock at which every node can be reached, and the segment over which it is.

    Label-correcting: all segments at once, again until nothing improves, which takes about as many rounds as the
    longest fastest way has segments. Unreachable nodes get infinity and segment -1.
    """
    segments = jnp.arange(network.segments)
    enter = jax.vmap(partial(crossing_time, field, rule=rule))

    def improve(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        arrival, via, _ = carry
        at = arrival[network.tail]
        # A crossing entered at infinity is not a number, so unreached tails are asked about clock 0 and then put back.
        reached = jnp.isfinite(at)
        there = jnp.where(reached, at + enter(segments, network.length, jnp.where(reached, at, 0.0)), jnp.inf)
        earliest = jax.ops.segment_min(there, network.head, network.nodes)
        winner = jnp.where(there == earliest[network.head], segments, network.segments)
        by = jax.ops.segment_min(winner, network.head, network.nodes)
        better = earliest < arrival
        return jnp.where(better, earliest, arrival), jnp.where(better, by, via), better.any()

    arrival = jnp.full(network.nodes, jnp.inf).at[origin].set(departure)
    via = jnp.full(network.nodes, -1)
    arrival, via, _ = jax.lax.while_loop(lambda carry: carry[2], improve, (arrival, via, jnp.bool_(True)))
    return arrival, via


def fastest_exits(
    network: RoadNetwork, field: SpeedField, instance: Instance, rule: CrossingRule
) -> Bool[Array, "node exit"]:
    """The exits along the fastest way of one walk."""
    _, via = earliest_arrivals(network, field, instance.origin, instance.departure, rule)

    def back(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        node, chosen = carry
        return network.tail[via[node]], chosen.at[via[node]].set(True)

    start = (instance.destination, jnp.zeros(network.segments, bool))
    _, chosen = jax.lax.while_loop(lambda carry: via[carry[0]] >= 0, back, start)
    return chosen[network.exit_segment] & network.valid


@jax.jit
def _plan(params: EnvParams, fields: Speeds, instances: Instance) -> Bool[Array, "walk node exit"]:
    def one(instance: Instance) -> Bool[Array, "node exit"]:
        # The only field there is is not copied for every walk.
        field = fields.of(jnp.int32(0) if fields.count == 1 else instance.crowd % fields.count)
        return fastest_exits(params.network, field, instance, params.rule)

    return jax.vmap(one)(instances)


class Expected:
    """The fastest way if the crowds were as expected: the best plan that is made beforehand and kept."""

    name: ClassVar[str] = "expected"
    level: ClassVar[Level] = "map"
    sees: ClassVar[Seen] = "position"
    decide: ClassVar[DecideByPlan] = staticmethod(choose_allowed)

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, _plan(params, params.expected, instances))


class Clairvoyant:
    """The fastest way through the crowds as they will be: the lower bound of everyone's travel time."""

    name: ClassVar[str] = "clairvoyant"
    level: ClassVar[Level] = "hindsight"
    sees: ClassVar[Seen] = "position"
    decide: ClassVar[DecideByPlan] = staticmethod(choose_allowed)

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, _plan(params, params.crowds, instances))
