"""Reset, step, reward and end of an episode, for one walker."""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sidestep.environment.crossing import cross
from sidestep.environment.observation import observe
from sidestep.environment.types import RECENT_NODES, EnvParams, EnvState, Instance, Observation, Outcome
from sidestep.network.graph import ABSENT


def reset(params: EnvParams, instance: Instance) -> tuple[EnvState, Observation]:
    """Put a walker at its origin at its departure."""
    never = jnp.full(RECENT_NODES, ABSENT, jnp.int32)
    state = EnvState(instance.origin, instance.departure, instance, never, jnp.int32(0))
    return state, observe(params, state)


def step(params: EnvParams, state: EnvState, action: Int[Array, ""]) -> tuple[EnvState, Outcome]:
    """Walk to the next crossing.

    An exit that does not exist or may not be taken is replaced by the next one that may, counting upwards and round
    (the paper lets the agent "select another"); a node without any is no place for a walker. The episode terminates on
    arrival; it is truncated, not terminated, at the horizon. A walker who then still waits until a street opens has
    not walked it.

    Parameters
    ----------
    params, state
        The environment, and the walker in it.
    action
        Number of the exit to take.

    Returns
    -------
    state, outcome
        Where the walker is then, and what the step brought.
    """
    network, instance = params.network, state.instance
    taken = existing_exit(network.exits_to(instance.destination, state.node), action)
    segment, node = network.exit_segment[state.node, taken], network.exit_node[state.node, taken]
    shut, latest = jnp.bool_(False), None
    if params.waits.gates:
        latest = instance.departure + params.horizon
        shut = state.clock + params.wait_in(instance.future)(segment, state.clock) >= latest
        node = jnp.where(shut, state.node, node)
    crossed = cross(params, instance.future, segment, state.clock, latest)
    recent_nodes = jnp.concatenate([state.node[None], state.recent_nodes[:-1]])
    after = EnvState(node, state.clock + crossed.seconds, instance, recent_nodes, state.steps + 1)
    crossed = replace(crossed, cost=params.objective.step_cost(crossed, after.clock - state.clock))
    arrived = node == instance.destination
    outcome = Outcome(
        observation=observe(params, after),
        reward=reward(params, state, after, crossed.cost),
        segment=segment,
        crossed=crossed,
        terminated=arrived,
        truncated=~arrived & (shut | (after.clock - instance.departure >= params.horizon)),
    )
    return after, outcome


def reward(params: EnvParams, before: EnvState, after: EnvState, cost: Float[Array, ""]) -> Float[Array, ""]:
    """Reward of eq. 13 as corrected: minus the cost of the step, plus the progress, plus the bonus of arriving.

    Parameters
    ----------
    params
        The environment, with the weights.
    before, after
        The walker's states around the step.
    cost
        What the step cost, in s.

    Returns
    -------
    Float[Array, ""]
        In units of ``params.reward.unit_seconds``.

    References
    ----------
    The paper, eq. 13; for potential-based progress Ng, Harada, Russell (1999).
    """
    weights, destination = params.reward, before.instance.destination
    here, there = (params.network.straight_line(state.node, destination) for state in (before, after))
    arrived = after.node == destination
    return -cost / weights.unit_seconds + weights.progress * (here - there) + weights.bonus * arrived


def existing_exit(valid: Bool[Array, " exit"], action: Int[Array, ""]) -> Int[Array, ""]:
    """The exit ``action``, or the next valid one round."""
    exits = valid.shape[0]
    distance = jnp.mod(jnp.arange(exits) - action, exits)
    return jnp.argmin(jnp.where(valid, distance, exits))


def random_exit(valid: Bool[Array, " exit"], uniform: Float[Array, ""]) -> Int[Array, ""]:
    """A uniformly random valid exit from a uniform number in [0, 1)."""
    count = jnp.sum(valid)
    nth = jnp.minimum((uniform * count).astype(jnp.int32), count - 1)
    return jnp.argmax(jnp.cumsum(valid) > nth)
