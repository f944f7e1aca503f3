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

Decide = Callable[[Observation, Key[Array, ""]], Int[Array, ""]]
"""Which exit to take."""


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


class _Carry(NamedTuple):
    state: EnvState
    over: Bool[Array, ""]
    walk: Walk


def walk(
    params: EnvParams,
    decide: Decide,
    instance: Instance,
    key: Key[Array, ""],
    trace: int = 0,
    recent_nodes: Int[Array, " recent_node"] | None = None,
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
    recent_nodes
        Nodes that were left before, the latest first, where the walk goes on from another; by default none.

    Returns
    -------
    Walk
        How it went.
    """
    start, _ = reset(params, instance)
    if recent_nodes is not None:
        start = replace(start, recent_nodes=recent_nodes)
    there, nothing = instance.origin == instance.destination, jnp.float32(0)
    measures = dict.fromkeys(params.objective.measures, nothing)
    segments, clocks = jnp.full(trace, ABSENT, jnp.int32), jnp.full(trace, instance.departure)

    def onward(carry: _Carry) -> _Carry:
        before, so_far = carry.state, carry.walk
        # Observed here, not carried from the step before: so there is one observation to compile instead of two.
        action = decide(observe(params, before), jax.random.fold_in(key, before.steps))
        state, outcome = step(params, before, action)
        walked = Walk(
            seconds=state.clock - instance.departure,
            arrived=outcome.terminated,
            steps=state.steps,
            cost=so_far.cost + outcome.crossed.cost,
            measures=jax.tree.map(jnp.add, so_far.measures, outcome.crossed.measures),
            segments=jnp.where(jnp.arange(trace) == before.steps, outcome.segment, so_far.segments),
            clocks=jnp.where(jnp.arange(trace) >= before.steps, state.clock, so_far.clocks),
        )
        return _Carry(state, outcome.terminated | outcome.truncated, walked)

    begun = Walk(nothing, there, start.steps, nothing, measures, segments, clocks)
    end = jax.lax.while_loop(lambda carry: ~carry.over, onward, _Carry(start, there, begun)).walk
    # Nothing counts more than the horizon, or arriving late would be worse than never arriving.
    seconds = jnp.where(end.arrived, jnp.minimum(end.seconds, params.horizon), params.horizon)
    cost = params.objective.walk_cost(end.cost, seconds, end.arrived, params.horizon)
    return replace(end, seconds=seconds, cost=cost)
