"""How the Q-network learns: temporal-difference errors of a batch, their loss, the optimiser, the target network.

Optax is imported where it is traced: programs that are read, not compiled, do without it.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.agent.acting import Transition
from sidestep.agent.config import TrainConfig
from sidestep.agent.q_networks import QNetwork
from sidestep.agent.replay import Replay, reprioritise, sample
from sidestep.agent.td import q_learning


class Learner(eqx.Module):
    """What is learned, and what it takes to go on learning."""

    q_network: QNetwork
    """The online network: it acts and learns."""
    target: QNetwork
    """The target network: it values next states, and follows the online network slowly."""
    optimiser: tuple[Array, ...]
    """Leaves of the optimiser's state."""


class BatchReport(eqx.Module):
    """How the gradient step on a batch went; of several batches, the means."""

    loss: Float[Array, ""]
    """Weighted mean over the batch, reward²."""
    td_error: Float[Array, ""]
    """Mean size of the temporal-difference errors, in units of reward."""
    q: Float[Array, ""]
    """Mean value of the exits that were taken, in units of reward."""


Optimiser = tuple[Callable[..., Any], Callable[..., Any]]
"""How a state begins, and how gradients become changes: an ``optax.GradientTransformation``."""


def start_learner(config: TrainConfig, q_network: QNetwork) -> Learner:
    """Begin with an untrained network."""
    begin, _ = optimiser(config)
    return Learner(q_network, q_network, tuple(jax.tree.leaves(begin(q_network))))


def optimiser(config: TrainConfig) -> Optimiser:
    """Make the optimiser of a configuration, with its falling learning rate.

    Parameters
    ----------
    config
        Rule, learning rates, and the number of gradient steps in all.

    Returns
    -------
    Optimiser
        It works on one vector of all parameters instead of a dozen arrays: a third less to compile.

    References
    ----------
    Eqs. 22 and 23 of the paper for RMSProp, which here divides by √g + σ.
    """
    import optax

    rules = {
        "rmsprop": partial(optax.rmsprop, decay=config.decay, eps=config.damping, eps_in_sqrt=False),
        "adam": optax.adam,
        "sgd": optax.sgd,
    }
    rate = optax.linear_schedule(config.learning_rate, config.learning_rate_end, config.rounds * config.iterations)
    made: Optimiser = optax.flatten(rules[config.optimiser](rate))
    return made


def learn(
    config: TrainConfig,
    learner: Learner,
    target: QNetwork,
    replay: Replay[Transition],
    draws: Float[Array, " batch"],
    evaluated: Callable[[QNetwork], QNetwork] = lambda q_network: q_network,
) -> tuple[Learner, Replay[Transition], BatchReport]:
    """Take one gradient step on a batch of the replay.

    Parameters
    ----------
    config
        How to learn.
    learner
        What has been learned.
    target
        Its target network, or the same function evaluated.
    replay
        What it is learned from.
    draws
        Uniform numbers that choose the batch.
    evaluated
        Makes the same function of a network, quicker to call many times.

    Returns
    -------
    learner
        After the step, with the same target network.
    replay
        With new priorities.
    report
        How the step went.

    References
    ----------
    Eqs. 17 and 18 of the paper; Schaul et al. 2016, "Prioritized experience replay", for the weights.
    """
    import optax

    index, batch, weight = sample(replay, draws, config.beta)

    def loss(q_network: QNetwork) -> tuple[Float[Array, ""], tuple[Float[Array, " batch"], Float[Array, " batch"]]]:
        error, value = jax.vmap(partial(td_error, config, evaluated(q_network), target))(batch)
        # Twice the Huber loss is the square, as far as it goes.
        losses = 2 * optax.huber_loss(error, delta=config.huber) if config.huber else error**2
        return jnp.mean(weight * losses), (error, value)

    (mean_loss, (error, value)), gradient = jax.value_and_grad(loss, has_aux=True)(learner.q_network)
    replay = reprioritise(replay, index, error, config.alpha, config.priority_floor)
    begin, update = optimiser(config)
    structure = jax.tree.structure(jax.eval_shape(begin, learner.q_network))
    change, state = update(gradient, jax.tree.unflatten(structure, learner.optimiser))
    q_network = optax.apply_updates(learner.q_network, change)
    report = BatchReport(mean_loss, jnp.mean(jnp.abs(error)), jnp.mean(value))
    return Learner(q_network, learner.target, tuple(jax.tree.leaves(state))), replay, report


def move_target(config: TrainConfig, learner: Learner, iteration: Int[Array, ""]) -> Learner:
    """Move the target network to the online network, if its time has come.

    Parameters
    ----------
    config
        When, and how far.
    learner
        What has been learned.
    iteration
        Gradient steps that have been taken so far.

    Returns
    -------
    Learner
        With the target network of the next gradient step.
    """
    import optax

    rate = jnp.where(iteration % config.target_period == 0, config.target_rate, 0.0)
    return replace(learner, target=optax.incremental_update(learner.q_network, learner.target, rate))


def td_error(
    config: TrainConfig, q_network: QNetwork, target: QNetwork, item: Transition
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Temporal-difference error of one transition, and the value of the exit that was taken, in units of reward."""
    q_tm1, q_t = q_network(item.observation_tm1), target(item.observation_t)
    selector_t = jax.lax.stop_gradient(q_network(item.observation_t)) if config.double else q_t
    error = q_learning(q_tm1, item.a_tm1, item.r_t, item.discount_t, q_t, selector_t, item.observation_t.valid)
    return error, q_tm1[item.a_tm1]
