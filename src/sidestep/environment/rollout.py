"""Whole walks: a decision rule applied from origin to destination."""

from collections.abc import Callable
from dataclasses import fields

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.environment.dynamics import reset, step
from sidestep.environment.types import Crossing, EnvParams, EnvState, Instance, Observation

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
    """How a walk went. The trace is padded with the last node and clock; it is empty unless asked for."""

    seconds: Float[Array, ""]  # travel time; the horizon where the walk did not arrive by then
    arrived: Bool[Array, ""]
    steps: Int[Array, ""]
    tally: Crossing | None  # the sum of all crossings; None where time is all that counts
    cost: Float[Array, ""]  # by the objective; a walk that did not arrive costs the horizon more
    nodes: Int[Array, " trace"]
    clocks: Float[Array, " trace"]


def walk(params: EnvParams, decide: Decide, instance: Instance, key: Key[Array, ""], trace: int = 0) -> Walk:
    """Walk until arrival or the horizon, deciding at every crossing.

    ``trace`` is the number of nodes to remember, the origin included.
    """
    start, observation = reset(params, instance)
    nodes = jnp.full(trace, instance.origin, jnp.int32)
    clocks = jnp.full(trace, instance.departure)
    arrived = instance.origin == instance.destination

    def onward(carry: Carry) -> Carry:
        _, _, state, observation, tally, nodes, clocks = carry
        action = decide(observation, jax.random.fold_in(key, state.steps))
        state, outcome = step(params, state, action)
        later = jnp.arange(trace) >= state.steps
        nodes, clocks = jnp.where(later, state.node, nodes), jnp.where(later, state.clock, clocks)
        done = outcome.terminated | outcome.truncated
        if tally is not None:
            tally = jax.tree.map(jnp.add, tally, outcome.crossed)
        return done, outcome.terminated, state, outcome.observation, tally, nodes, clocks

    tally = None if params.objective is None else Crossing(*(jnp.float32(0) for _ in fields(Crossing)))
    _, arrived, end, _, tally, nodes, clocks = jax.lax.while_loop(
        lambda carry: ~carry[0], onward, (arrived, arrived, start, observation, tally, nodes, clocks)
    )
    # Nothing counts more than the horizon, or arriving late would be worse than never arriving.
    seconds = jnp.where(arrived, jnp.minimum(end.clock - instance.departure, params.horizon), params.horizon)
    cost = seconds if tally is None else tally.cost + jnp.where(arrived, 0.0, params.horizon)
    return Walk(seconds, arrived, end.steps, tally, cost, nodes, clocks)
