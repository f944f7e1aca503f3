"""How walkers act while they train: ε-greedy steps, and the transitions that these make."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sidestep.agent.config import TrainConfig
from sidestep.agent.policy import Policy
from sidestep.environment.dynamics import random_exit, reset, step
from sidestep.environment.observation import observe
from sidestep.environment.types import EnvParams, EnvState, Observation
from sidestep.scenarios.episodes import DRAWS, InstanceSampler

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
    config: TrainConfig, params: EnvParams, sampler: InstanceSampler, draws: Float[Array, "walker draw"]
) -> tuple[Walkers, Transition]:
    """Put walkers at their origins; also returns an empty transition, for its shapes and types."""
    state, observation = jax.vmap(lambda draw: reset(params, sampler.sample(draw)))(draws)
    nothing = jnp.float32(0)
    one = jax.tree.map(lambda leaf: leaf[0], observation)
    item = Transition(one, jnp.int32(0), nothing, nothing, one)
    waiting = (config.n_step - 1, config.walkers)
    pending = jax.tree.map(lambda leaf: jnp.zeros((*waiting, *leaf.shape), leaf.dtype), item)
    return Walkers(state, observation, pending, jnp.zeros(waiting, bool)), item


def act(
    config: TrainConfig,
    params: EnvParams,
    sampler: InstanceSampler,
    policy: Policy,
    walkers: Walkers,
    iteration: Int[Array, ""],
    draws: Float[Array, "walker draw"],
) -> tuple[Walkers, Transition]:
    """Each walker takes an ε-greedy step; those whose episode is over begin another.

    Returns the walkers and, for each, the transition whose return is now complete.
    """
    chance = epsilon(config, iteration)

    def one(
        state: EnvState, seen: Observation, draw: Float[Array, " draw"]
    ) -> tuple[EnvState, Observation, Transition, Bool[Array, ""]]:
        action = jnp.where(draw[0] < chance, random_exit(seen.valid, draw[1]), policy(seen))
        after, outcome = step(params, state, action)
        over = outcome.terminated | outcome.truncated
        fresh, _ = reset(params, sampler.sample(draw[2:]))
        state = jax.tree.map(partial(jnp.where, over), fresh, after)
        discount = config.gamma * (1.0 - outcome.terminated)
        latest = Transition(seen, action, outcome.reward, discount, outcome.observation)
        return state, observe(params, state), latest, over

    state, observation, latest, over = jax.vmap(one)(walkers.state, walkers.observation, draws)
    if config.n_step == 1:
        return Walkers(state, observation, walkers.pending, walkers.open), latest
    going = walkers.open
    grown = jax.tree.map(
        partial(_where, going), jax.vmap(lambda old: _lengthened(old, latest))(walkers.pending), walkers.pending
    )
    # Until the oldest place has been filled, steps are handed on as they come.
    filled = iteration >= config.n_step - 1
    complete = jax.tree.map(lambda old, new: jnp.where(filled, old[0], new), grown, latest)
    pending = jax.tree.map(lambda old, new: jnp.concatenate([old[1:], new[None]]), grown, latest)
    still = jnp.concatenate([(going & ~over)[1:], ~over[None]])
    return Walkers(state, observation, pending, still), complete


def epsilon(config: TrainConfig, iteration: Int[Array, ""]) -> Float[Array, ""]:
    """Share of random steps in an iteration."""
    progress = iteration / (config.rounds * config.iterations)
    fallen = jnp.minimum(progress / config.epsilon_share, 1.0)
    return config.epsilon + fallen * (config.epsilon_end - config.epsilon)


def _lengthened(old: Transition, new: Transition) -> Transition:
    """A transition with the step that followed on it."""
    reward = old.r_t + old.discount_t * new.r_t
    return Transition(old.observation_tm1, old.a_tm1, reward, old.discount_t * new.discount_t, new.observation_t)


def _where(condition: Bool[Array, "pending walker"], one: Array, other: Array) -> Array:
    return jnp.where(condition.reshape(condition.shape + (1,) * (one.ndim - condition.ndim)), one, other)
