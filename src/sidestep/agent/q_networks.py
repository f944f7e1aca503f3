"""The dueling Q-network of the paper (eqs. 19 and 20; Wang et al. 2016)."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key

from sidestep.environment.types import Observation
from sidestep.network.graph import RoadNetwork


class Linear(eqx.Module):
    """A fully connected layer."""

    weight: Float[Array, "out in"]
    bias: Float[Array, " out"]

    def __call__(self, features: Float[Array, " in"]) -> Float[Array, " out"]:
        return self.weight @ features + self.bias


class DuelingQNetwork(eqx.Module):
    """Position in, one value per exit out: fully connected ReLU layers, then a value and an advantage head."""

    offset: Float[Array, "2"]  # m; with `scale` it turns positions into inputs, and neither is trained
    scale: Float[Array, "2"]  # 1/m
    hidden: tuple[Linear, ...]
    value: Linear
    advantage: Linear
    crossings: int = eqx.field(static=True)  # width of the one-hot crossing beside x and y; 0 for none
    unit: float = eqx.field(static=True)  # rewards per unit of the heads' output
    dueling: bool = eqx.field(static=True, default=True)  # without, the advantages are the values

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
    """A Q-value for every crossing and exit (Watkins 1989)."""

    q: Float[Array, "node exit"]

    def __call__(self, observation: Observation) -> Float[Array, " exit"]:
        return self.q[observation.node]


def combine(
    value: Float[Array, ""], advantage: Float[Array, " exit"], valid: Bool[Array, " exit"]
) -> Float[Array, " exit"]:
    """Q = V + A - mean of A over the valid exits (eq. 20, where |A| counts valid actions)."""
    return value + advantage - jnp.sum(advantage, where=valid) / jnp.maximum(jnp.sum(valid), 1)


def dueling_network(
    network: RoadNetwork,
    key: Key[Array, ""],
    *,
    hidden: tuple[int, ...],
    one_hot: bool,
    unit: float,
    dueling: bool = True,
) -> DuelingQNetwork:
    """A freshly initialised network for one map.

    With ``one_hot`` the input is x and y in [-1, 1] and the crossing itself, one-hot; without it, the paper's
    coordinates in blocks, [0, N] (eq. 10).
    """
    low, high = network.position.min(axis=0), network.position.max(axis=0)
    extent = jnp.maximum(high - low, 1.0)
    if one_hot:
        offset, scale = (low + high) / 2, 2 / extent
    else:
        blocks = jnp.sqrt(network.nodes) - 1
        offset, scale = low, blocks / extent
    crossings = network.nodes if one_hot else 0
    widths = (2 + crossings, *hidden)
    heads = ((widths[-1], 1), (widths[-1], network.exits))
    shapes = (*itertools.pairwise(widths), *heads)
    # One draw for all layers: a compiled random draw per layer would take longer than all of the training.
    draw = jax.random.uniform(key, (sum((fan_in + 1) * fan_out for fan_in, fan_out in shapes),), minval=-1.0)
    layers = []
    for fan_in, fan_out in shapes:
        size = (fan_in + 1) * fan_out
        weight = draw[:size].reshape(fan_out, fan_in + 1) / jnp.sqrt(fan_in)
        layers.append(Linear(weight[:, 1:], weight[:, 0]))
        draw = draw[size:]
    *trunk, value, advantage = layers
    return DuelingQNetwork(offset, scale, tuple(trunk), value, advantage, crossings, unit, dueling)
