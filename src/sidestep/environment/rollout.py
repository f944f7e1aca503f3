"""Whole walks: a decision rule applied from origin to destination."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.environment.dynamics import reset, step
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


class _Totals(eqx.Module):
    cost: Float[Array, ""]
    measures: dict[str, Float[Array, ""]]


class _Carry(eqx.Module):
    over: Bool[Array, ""]
    arrived: Bool[Array, ""]
    state: EnvState
    observation: Observation
    totals: _Totals
    segments: Int[Array, " trace"]
    clocks: Float[Array, " trace"]


def walk(params: EnvParams, decide: Decide, instance: Instance, key: Key[Array, ""], trace: int = 0) -> Walk:
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
    """
    start, observation = reset(params, instance)
    there, nothing = instance.origin == instance.destination, jnp.float32(0)
    totals = _Totals(nothing, dict.fromkeys(params.objective.measures, nothing))
    segments, clocks = jnp.full(trace, ABSENT, jnp.int32), jnp.full(trace, instance.departure)

    def onward(carry: _Carry) -> _Carry:
        number = carry.state.steps
        state, outcome = step(params, carry.state, decide(carry.observation, jax.random.fold_in(key, number)))
        crossed = _Totals(outcome.crossed.cost, outcome.crossed.measures)
        return _Carry(
            outcome.terminated | outcome.truncated,
            outcome.terminated,
            state,
            outcome.observation,
            jax.tree.map(jnp.add, carry.totals, crossed),
            jnp.where(jnp.arange(trace) == number, outcome.segment, carry.segments),
            jnp.where(jnp.arange(trace) >= number, state.clock, carry.clocks),
        )

    end = jax.lax.while_loop(
        lambda carry: ~carry.over, onward, _Carry(there, there, start, observation, totals, segments, clocks)
    )
    # Nothing counts more than the horizon, or arriving late would be worse than never arriving.
    elapsed = jnp.minimum(end.state.clock - instance.departure, params.horizon)
    seconds = jnp.where(end.arrived, elapsed, params.horizon)
    cost = params.objective.walk_cost(end.totals.cost, seconds, end.arrived, params.horizon)
    return Walk(seconds, end.arrived, end.state.steps, cost, end.totals.measures, end.segments, end.clocks)
