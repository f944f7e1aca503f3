"""How walkers act while they train: ε-greedy steps, and the transitions that these make."""

from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.agent.config import TrainConfig
from sidestep.agent.policy import Policy
from sidestep.agent.problem import Problem
from sidestep.agent.td import mask
from sidestep.environment.dynamics import random_exit, reset, step
from sidestep.environment.observation import observe
from sidestep.environment.types import EnvState, Observation
from sidestep.programs import over_devices
from sidestep.scenarios.episodes import DRAWS

ACTING_DRAWS = 2 + DRAWS
"""Uniform numbers that one step of one walker takes."""


class Transition(eqx.Module):
    """One step of one walker, or several steps of one return, as the replay keeps them.

    Names are those of :mod:`sidestep.agent.td`.
    """

    observation_tm1: Observation
    a_tm1: Int[Array, "*n"]
    r_t: Float[Array, "*n"]
    discount_t: Float[Array, "*n"]
    observation_t: Observation


class Walkers(eqx.Module):
    """Walkers on their way, and those of their latest steps whose returns are not complete yet."""

    state: EnvState
    observation: Observation
    pending: Transition
    """Each leaf [n_step - 1, walker, ...], the oldest first."""
    open: Bool[Array, "pending walker"]
    """Whether the walk that the step belongs to still goes on."""


def place_walkers(
    config: TrainConfig, problem: Problem, draws: Float[Array | np.ndarray, "walker draw"]
) -> tuple[Walkers, Transition]:
    """Put walkers at their origins.

    Parameters
    ----------
    config
        How many walkers, and how many steps their returns have.
    problem
        The environment, and the walks that episodes are drawn from.
    draws
        Uniform numbers, ``DRAWS`` for each walker.

    Returns
    -------
    walkers
        With nothing pending.
    transition
        An empty one, for its shapes and types.
    """
    state, observation = jax.vmap(lambda draw: reset(problem.params, problem.sampler.sample(draw)))(draws)
    nothing = jnp.float32(0)
    one = jax.tree.map(lambda leaf: leaf[0], observation)
    item = Transition(one, jnp.int32(0), nothing, nothing, one)
    waiting = (config.n_step - 1, config.walkers)
    pending = jax.tree.map(lambda leaf: jnp.zeros((*waiting, *leaf.shape), leaf.dtype), item)
    return Walkers(state, observation, pending, jnp.zeros(waiting, bool)), item


def act(
    config: TrainConfig,
    problem: Problem,
    policy: Policy,
    walkers: Walkers,
    iteration: Int[Array, ""],
    draws: Float[Array, "walker draw"],
) -> tuple[Walkers, Transition]:
    """Take an ε-greedy step with each walker; those whose episode is over begin another.

    Parameters
    ----------
    config
        ε, the discount factor and the steps of a return.
    problem
        The environment, and the walks that episodes are drawn from.
    policy
        What walkers follow unless they step at random.
    walkers
        Where they are.
    iteration
        Steps that each of them has taken before.
    draws
        Uniform numbers, ``ACTING_DRAWS`` for each walker.

    Returns
    -------
    walkers
        After their step.
    transitions
        For each walker, the transition whose return is now complete.
    """
    params, chance = problem.params, epsilon(config, iteration)

    def one(
        state: EnvState, seen: Observation, draw: Float[Array, " draw"]
    ) -> tuple[EnvState, Observation, Transition, Bool[Array, ""]]:
        chosen = by_value(policy, config.temperature, seen, draw[1])
        action = jnp.where(draw[0] < chance, random_exit(seen.valid, draw[1]), chosen)
        after, outcome = step(params, state, action)
        over = outcome.terminated | outcome.truncated
        fresh, _ = reset(params, problem.sampler.sample(draw[2:]))
        state = jax.tree.map(partial(jnp.where, over), fresh, after)
        discount = config.gamma * (1.0 - outcome.terminated)
        latest = Transition(seen, action, outcome.reward, discount, outcome.observation)
        return state, observe(params, state), latest, over

    steps = over_devices(jax.vmap(one), config.walkers, in_axes=(0, 0, 0))
    state, observation, latest, over = steps(walkers.state, walkers.observation, draws)
    if config.n_step == 1:
        return replace(walkers, state=state, observation=observation), latest
    # Until the oldest place has been filled, steps are handed on as they come.
    filled = iteration >= config.n_step - 1
    returns = over_devices(partial(_returns, filled), config.walkers, in_axes=(1, 1, 0, 0), out_axes=(1, 1, 0))
    pending, still, complete = returns(walkers.pending, walkers.open, latest, over)
    return Walkers(state, observation, pending, still), complete


def _returns(
    filled: Bool[Array, ""],
    pending: Transition,
    going: Bool[Array, "pending walker"],
    latest: Transition,
    over: Bool[Array, " walker"],
) -> tuple[Transition, Bool[Array, "pending walker"], Transition]:
    """Add the latest steps to the returns that are not complete, of which the oldest then is."""
    # Steps that the walk goes on from have one more step in their return.
    grown = replace(
        pending,
        r_t=jnp.where(going, pending.r_t + pending.discount_t * latest.r_t, pending.r_t),
        discount_t=jnp.where(going, pending.discount_t * latest.discount_t, pending.discount_t),
        observation_t=jax.tree.map(partial(_where, going), latest.observation_t, pending.observation_t),
    )
    complete = jax.tree.map(lambda old, new: jnp.where(filled, old[0], new), grown, latest)
    pending = jax.tree.map(lambda old, new: jnp.concatenate([old[1:], new[None]]), grown, latest)
    return pending, jnp.concatenate([(going & ~over)[1:], ~over[None]]), complete


def by_value(policy: Policy, temperature: float, seen: Observation, uniform: Float[Array, ""]) -> Int[Array, ""]:
    """Take the best exit or, at a temperature, each in proportion to exp(Q / temperature).

    Noise hides which of two nearly equal paths is better until both have been walked often; ε-greedy steps hardly ever
    walk the one that looks worse.

    Parameters
    ----------
    policy
        Whose values are compared.
    temperature
        In units of reward; 0 takes the best.
    seen
        What the walker observes.
    uniform
        A number in [0, 1).

    Returns
    -------
    Int[Array, ""]
        A valid exit.
    """
    if not temperature:
        return policy(seen)
    up_to = jnp.cumsum(jax.nn.softmax(mask(policy.q_network(seen), seen.valid) / temperature))
    return jnp.argmax(up_to > uniform * up_to[-1])


def epsilon(config: TrainConfig, iteration: Int[Array, ""]) -> Float[Array, ""]:
    """Share of random steps in an iteration."""
    progress = iteration / (config.rounds * config.iterations)
    fallen = jnp.minimum(progress / config.epsilon_share, 1.0)
    return config.epsilon + fallen * (config.epsilon_end - config.epsilon)


def _where(condition: Bool[Array, "pending walker"], one: Array, other: Array) -> Array:
    return jnp.where(condition.reshape(condition.shape + (1,) * (other.ndim - condition.ndim)), one, other)
