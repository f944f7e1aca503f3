"""What learns Q-values of exits: the paper's dueling network, a table, or a network that scores segments."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from sidestep.agent.config import TrainConfig
from sidestep.agent.layers import Linear, combine, uniform_layers
from sidestep.agent.segment_network import SegmentQNetwork, segment_network
from sidestep.environment.types import Observation
from sidestep.network.graph import RoadNetwork
from sidestep.scenarios.model import Scenario


class DuelingQNetwork(eqx.Module):
    """Position in, one value per exit out: fully connected ReLU layers, then a value and an advantage head.

    References
    ----------
    Eqs. 19 and 20 of the paper; Wang et al. 2016, "Dueling network architectures for deep reinforcement learning".
    """

    offset: Float[Array, "2"]
    """Position that becomes 0, m. With ``scale`` it turns positions into inputs; neither is trained."""
    scale: Float[Array, "2"]
    """Inputs per metre."""
    hidden: tuple[Linear, ...]
    value: Linear
    advantage: Linear
    crossings: int = eqx.field(static=True)
    """Width of the one-hot crossing beside x and y; 0 for none."""
    unit: float = eqx.field(static=True)
    """Units of reward in one unit of the heads."""
    dueling: bool = eqx.field(static=True, default=True)
    """Without, the advantages are the values."""

    def __call__(self, observation: Observation) -> Float[Array, " exit"]:
        """Q-value of every exit; those of exits that do not exist mean nothing."""
        features = jax.lax.stop_gradient((observation.position - self.offset) * self.scale)
        if self.crossings:
            features = jnp.concatenate([features, jax.nn.one_hot(observation.node, self.crossings)])
        for layer in self.hidden:
            features = jax.nn.relu(layer(features))
        advantage = self.advantage(features)
        if not self.dueling:
            return self.unit * advantage
        return self.unit * combine(self.value(features)[0], advantage, observation.valid)


class QTable(eqx.Module):
    """A Q-value for every crossing and exit.

    References
    ----------
    Watkins 1989, "Learning from delayed rewards".
    """

    q: Float[Array, "node exit"]

    def __call__(self, observation: Observation) -> Float[Array, " exit"]:
        return self.q[observation.node]


QNetwork = DuelingQNetwork | QTable | SegmentQNetwork
"""All of them are functions of an observation that give one value per exit."""


def dueling_network(config: TrainConfig, network: RoadNetwork, key: Key[Array, ""]) -> DuelingQNetwork:
    """Initialise a dueling network for one map.

    With ``one_hot`` the input is x and y in [-1, 1] and the crossing itself, one-hot; without it, the paper's
    coordinates in blocks, [0, N] (eq. 10).

    Parameters
    ----------
    config
        Widths and inputs.
    network
        The map's streets.
    key
        Random stream of the initial weights.

    Returns
    -------
    DuelingQNetwork
        With weights and biases uniform in ±1/√inputs.
    """
    low, high = network.position.min(axis=0), network.position.max(axis=0)
    extent = jnp.maximum(high - low, 1.0)
    if config.one_hot:
        offset, scale, crossings = (low + high) / 2, 2 / extent, network.nodes
    else:
        blocks = jnp.sqrt(network.nodes) - 1
        offset, scale, crossings = low, blocks / extent, 0
    widths = (2 + crossings, *config.hidden)
    shapes = [*itertools.pairwise(widths), (widths[-1], 1), (widths[-1], network.exits)]
    *trunk, value, advantage = uniform_layers(shapes, key)
    return DuelingQNetwork(offset, scale, tuple(trunk), value, advantage, crossings, config.unit, config.dueling)


def tabulated(q_network: QNetwork, network: RoadNetwork, destination: Int[Array, ""]) -> QTable:
    """Evaluate a network at every node, for walkers who observe nothing else (level ``position``).

    Parameters
    ----------
    q_network
        A function of the position alone.
    network, destination
        The streets, and where walks end.

    Returns
    -------
    QTable
        The same function, with the same gradient.
    """
    nodes = jnp.arange(network.nodes)
    everywhere = jax.vmap(Observation)(nodes, network.position, network.exits_to(destination), jnp.zeros_like(nodes))
    return QTable(jax.vmap(q_network)(everywhere))


def untrained(config: TrainConfig, scenario: Scenario, network: RoadNetwork, key: Key[Array, ""]) -> QNetwork:
    """Initialise what a configuration learns on one map.

    Parameters
    ----------
    config, scenario
        How it learns, and what.
    network
        The map's streets.
    key
        Random stream of the initial weights.

    Returns
    -------
    QNetwork
        A table, or a network for the configuration's level.
    """
    if config.table:
        return QTable(jnp.zeros((network.nodes, network.exits)))
    if config.level == "position":
        return dueling_network(config, network, key)
    return segment_network(config, scenario, network, key)
