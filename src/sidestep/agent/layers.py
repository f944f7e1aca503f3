"""Fully connected layers, and how value and advantage make Q."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key


class Linear(eqx.Module):
    """A fully connected layer."""

    weight: Float[Array, "out in"]
    bias: Float[Array, " out"]

    def __call__(self, features: Float[Array, " in"]) -> Float[Array, " out"]:
        return self.weight @ features + self.bias


def combine(
    value: Float[Array, ""], advantage: Float[Array, " exit"], valid: Bool[Array, " exit"]
) -> Float[Array, " exit"]:
    """Combine value and advantages to Q-values: V + A - mean of A over the valid exits.

    Parameters
    ----------
    value, advantage
        Of the state, and of each exit.
    valid
        Which exits exist; entries of others mean nothing.

    Returns
    -------
    Float[Array, " exit"]
        Their mean over the valid exits is the value.

    References
    ----------
    Eq. 20 of the paper, where the mean is over valid actions; Wang et al. 2016, "Dueling network architectures for deep
    reinforcement learning", eq. 9.
    """
    return value + advantage - jnp.sum(advantage, where=valid) / jnp.maximum(jnp.sum(valid), 1)


def uniform_layers(shapes: list[tuple[int, int]], key: Key[Array, ""]) -> list[Linear]:
    """Draw layers of these inputs and outputs, weights and biases uniform in ±1/√inputs."""
    # One draw for all layers: a compiled random draw per layer would take longer than all of the training.
    draw = jax.random.uniform(key, (sum((fan_in + 1) * fan_out for fan_in, fan_out in shapes),), minval=-1.0)
    layers = []
    for fan_in, fan_out in shapes:
        size = (fan_in + 1) * fan_out
        weight = draw[:size].reshape(fan_out, fan_in + 1) / jnp.sqrt(fan_in)
        layers.append(Linear(weight[:, 1:], weight[:, 0]))
        draw = draw[size:]
    return layers


def zero_ended_layers(widths: tuple[int, ...], key: Key[Array, ""]) -> tuple[Linear, ...]:
    """Draw layers of these widths, one after the other; the last is zero, and so are all biases."""
    layers = []
    for fan_in, fan_out, one in zip(widths[:-1], widths[1:], jax.random.split(key, len(widths) - 1), strict=True):
        weight = jax.random.uniform(one, (fan_out, fan_in), minval=-1.0) / jnp.sqrt(fan_in)
        layers.append(Linear(weight, jnp.zeros(fan_out)))
    return (*layers[:-1], Linear(jnp.zeros_like(layers[-1].weight), layers[-1].bias))


def through(layers: tuple[Linear, ...], inputs: Float[Array, "n in"]) -> Float[Array, "n out"]:
    """Pass rows of inputs through layers with ReLU between them."""
    *hidden, last = layers
    for layer in hidden:
        inputs = jax.nn.relu(inputs @ layer.weight.T + layer.bias)
    return inputs @ last.weight.T + last.bias
