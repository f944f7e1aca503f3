"""Whole walks: a decision rule applied from origin to destination."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.environment.dynamics import reset, step
from sidestep.environment.observation import observe
from sidestep.environment.types import EnvParams, EnvState, Instance, Observation
from sidestep.network.graph import ABSENT
from sidestep.walking.crossing_time import slot_at

Decide = Callable[[Observation, Key[Array, ""]], Int[Array, ""]]
"""Which exit to take."""

Remember = Callable[[Observation], Float[Array, ""]]
"""What to remember of the node that is about to be left."""


class Past(NamedTuple):
    """What walkers bring along whose walks go on from others."""

    recent_nodes: Int[Array, " recent_node"]
    """As in :class:`~sidestep.environment.types.EnvState`."""
    remembered: Float[Array, " node"]
    """As in :class:`~sidestep.environment.types.Observation`."""


class Walk(eqx.Module):
    """How a walk went. Its trace is empty unless asked for."""

    seconds: Float[Array, ""]
    """Travel time in s; the horizon where the walk did not arrive by then."""
    arrived: Bool[Array, ""]
    steps: Int[Array, ""]
    """Segments walked."""
    cost: Float[Array, ""]
    """By the objective, in s; of a walk that did not arrive, the horizon more where the objective is not time alone."""
    measures: dict[str, Float[Array, ""]]
    """Totals of what the objective counts beside the cost (:attr:`sidestep.walking.objective.TravelTime.measures`)."""
    segments: Int[Array, " trace"]
    """Walked, one after the other; -1 after the last."""
    clocks: Float[Array, " trace"]
    """Clock in s at which each of them was left; after the last, when that was left."""
    remembered: Float[Array, " kept"]
    """What is remembered of the node where each of them begins; empty where nothing is."""


class UnderWay(NamedTuple):
    """A walk as far as it went, from which it goes on."""

    state: EnvState
    over: Bool[Array, ""]
    """Whether it arrived, or was cut off at the horizon."""
    walk: Walk
    """How it went so far."""
    remembered: Float[Array, " node"]
    """As in :class:`~sidestep.environment.types.Observation`; empty where nothing is remembered."""


def walk(
    params: EnvParams,
    decide: Decide,
    instance: Instance,
    key: Key[Array, ""],
    trace: int = 0,
    past: Past | None = None,
    remember: Remember | None = None,
    *,
    by_node: bool = False,
) -> Walk:
    """Walk until arrival or the horizon, deciding at every crossing.

    Parameters
    ----------
    params, instance
        The environment, and the walk to be done in it.
    decide
        Which exit to take; given the observation and a key of its own for every step.
    key
        Random key of the walk.
    trace
        Number of segments to remember.
    past
        What the walker brings along where the walk goes on from another.
    remember
        What to remember of every node, for walkers who decide by it.
    by_node
        Whether decisions depend on the node alone. A walk that comes back to a node then goes round for ever and, where
        time is all that counts, is not walked to the horizon.

    Returns
    -------
    Walk
        How it went.
    """
    begun = depart(params, instance, trace, past, remembers=remember is not None)
    most = params.network.nodes if by_node and not params.objective.needs_density else None
    return ended(params, walk_on(params, decide, begun, key, remember, most=most))


def depart(
    params: EnvParams, instance: Instance, trace: int = 0, past: Past | None = None, *, remembers: bool = False
) -> UnderWay:
    """A walk that has not begun yet; the parameters are those of :func:`walk`."""
    start, _ = reset(params, instance)
    if past is not None:
        start = replace(start, recent_nodes=past.recent_nodes)
    there, nothing = instance.origin == instance.destination, jnp.float32(0)
    measures = dict.fromkeys(params.objective.measures, nothing)
    segments, clocks = jnp.full(trace, ABSENT, jnp.int32), jnp.full(trace, instance.departure)
    nodes, kept = (params.network.nodes, trace) if remembers else (0, 0)
    remembered = jnp.zeros(nodes) if past is None else past.remembered[:nodes]
    begun = Walk(nothing, there, start.steps, nothing, measures, segments, clocks, jnp.zeros(kept))
    return UnderWay(start, there, begun, remembered)


def walk_on(
    params: EnvParams,
    decide: Decide,
    under_way: UnderWay,
    key: Key[Array, ""],
    remember: Remember | None = None,
    slot: Int[Array, ""] | None = None,
    most: int | None = None,
) -> UnderWay:
    """Go on with a walk until it is over.

    Parameters
    ----------
    params, decide, key, remember
        As for :func:`walk`; the key is that of the whole walk.
    under_way
        The walk.
    slot
        Decide only at crossings that are reached in this slot, or in an earlier one.
    most
        Segments after which a walk that is not over does not go on.

    Returns
    -------
    UnderWay
        The walk, over, in a later slot, or of so many segments.
    """
    speeds, trace = params.futures.speeds, len(under_way.walk.segments)

    def goes_on(carry: UnderWay) -> Bool[Array, ""]:
        goes = ~carry.over
        if slot is not None:
            goes &= slot_at(carry.state.clock, speeds.slot_seconds, speeds.slots) <= slot
        return goes if most is None else goes & (carry.state.steps < most)

    def onward(carry: UnderWay) -> UnderWay:
        before, so_far = carry.state, carry.walk
        remembered, kept = carry.remembered, so_far.remembered
        # Observed here, not carried from the step before: so there is one observation to compile instead of two.
        seen = observe(params, before)
        if remember is not None:
            seen = replace(seen, remembered=remembered)
            number = remember(seen)
            remembered = remembered.at[before.node].set(number)
            kept = jnp.where(jnp.arange(trace) == before.steps, number, kept)
        action = decide(seen, jax.random.fold_in(key, before.steps))
        state, outcome = step(params, before, action)
        walked = Walk(
            seconds=state.clock - before.instance.departure,
            arrived=outcome.terminated,
            steps=state.steps,
            cost=so_far.cost + outcome.crossed.cost,
            measures=jax.tree.map(jnp.add, so_far.measures, outcome.crossed.measures),
            segments=jnp.where(jnp.arange(trace) == before.steps, outcome.segment, so_far.segments),
            clocks=jnp.where(jnp.arange(trace) >= before.steps, state.clock, so_far.clocks),
            remembered=kept,
        )
        return UnderWay(state, outcome.terminated | outcome.truncated, walked, remembered)

    return jax.lax.while_loop(goes_on, onward, under_way)


def ended(params: EnvParams, under_way: UnderWay) -> Walk:
    """How a walk went that is over."""
    # Nothing counts more than the horizon, or arriving late would be worse than never arriving.
    walk = under_way.walk
    seconds = jnp.where(walk.arrived, jnp.minimum(walk.seconds, params.horizon), params.horizon)
    cost = params.objective.walk_cost(walk.cost, seconds, walk.arrived, params.horizon)
    return replace(walk, seconds=seconds, cost=cost)
