"""Whole walks: a decision rule applied from origin to destination."""

from collections.abc import Callable
from dataclasses import fields

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.environment.dynamics import reset, step
from sidestep.environment.types import Crossing, EnvParams, EnvState, Instance, Observation
from sidestep.network.graph import ABSENT

Decide = Callable[[Observation, Key[Array, ""]], Int[Array, ""]]  # which exit to take


Carry = tuple[
    Bool[Array, ""],
    Bool[Array, ""],
    EnvState,
    Observation,
    Crossing | None,
    Int[Array, " trace"],
    Float[Array, " trace"],
]  # over, arrived, where the walker is, what it sees, what it cost, the trace


class Walk(eqx.Module):
    """How a walk went. Its trace is empty unless asked for."""

    seconds: Float[Array, ""]  # travel time; the horizon where the walk did not arrive by then
    arrived: Bool[Array, ""]
    steps: Int[Array, ""]
    totals: Crossing | None  # the sum of all crossings; None where time is all that counts
    cost: Float[Array, ""]  # by the objective; a walk that did not arrive costs the horizon more
    segments: Int[Array, " trace"]  # walked, one after the other; -1 after the last
    clocks: Float[Array, " trace"]  # s at which each of them was left; after the last, when that was left


def walk(params: EnvParams, decide: Decide, instance: Instance, key: Key[Array, ""], trace: int = 0) -> Walk:
    """Walk until arrival or the horizon, deciding at every crossing.

    ``trace`` is the number of segments to remember.
    """
    start, observation = reset(params, instance)
    segments = jnp.full(trace, ABSENT, jnp.int32)
    clocks = jnp.full(trace, instance.departure)
    arrived = instance.origin == instance.destination

    def onward(carry: Carry) -> Carry:
        _, _, state, observation, totals, segments, clocks = carry
        number, action = state.steps, decide(observation, jax.random.fold_in(key, state.steps))
        state, outcome = step(params, state, action)
        segments = jnp.where(jnp.arange(trace) == number, outcome.segment, segments)
        clocks = jnp.where(jnp.arange(trace) >= number, state.clock, clocks)
        done = outcome.terminated | outcome.truncated
        if totals is not None:
            totals = jax.tree.map(jnp.add, totals, outcome.crossed)
        return done, outcome.terminated, state, outcome.observation, totals, segments, clocks

    totals = None if params.objective is None else Crossing(*(jnp.float32(0) for _ in fields(Crossing)))
    _, arrived, end, _, totals, segments, clocks = jax.lax.while_loop(
        lambda carry: ~carry[0], onward, (arrived, arrived, start, observation, totals, segments, clocks)
    )
    # Nothing counts more than the horizon, or arriving late would be worse than never arriving.
    seconds = jnp.where(arrived, jnp.minimum(end.clock - instance.departure, params.horizon), params.horizon)
    cost = seconds if totals is None else totals.cost + jnp.where(arrived, 0.0, params.horizon)
    return Walk(seconds, arrived, end.steps, totals, cost, segments, clocks)
