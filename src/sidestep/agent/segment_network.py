"""A dueling Q-network that scores street by street, for any number of streets, origins, destinations and maps."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from sidestep.agent.q_networks import Linear, combine
from sidestep.environment.types import RECENT_NODES, Local, Observation
from sidestep.network.graph import RoadNetwork
from sidestep.walking.speed_laws import FREE_SPEED

CLOCK_SECONDS = 4 * 3600.0  # unit of clocks
FAR = 10.0  # units of time at which differences are cut off, lest one blocked street drown the rest


class Places(eqx.Module):
    """What is learned of places on a map that is always the same: a few numbers for each node and time of day."""

    table: Float[Array, "bin node width"]
    seconds: float = eqx.field(static=True)  # from one bin to the next; linear in between

    def __call__(self, node: Int[Array, "*n"], clock: Float[Array, "*n"]) -> Float[Array, "*n width"]:
        last = self.table.shape[0] - 1
        position = jnp.clip(clock / self.seconds, 0.0, last)
        before = jnp.floor(position).astype(jnp.int32)
        part = (position - before)[..., None]
        return (1 - part) * self.table[before, node] + part * self.table[jnp.minimum(before + 1, last), node]


class SegmentQNetwork(eqx.Module):
    """V from the walker's state, A from each street that leaves, through one network for all streets.

    With ``potential``, Q is a correction to the level's own estimate of the time to go, and zero before training: an
    untrained walker is its level's greedy planner.
    """

    metres: Float[Array, ""]  # unit of lengths, not trained
    seconds: Float[Array, ""]  # unit of times, not trained
    places: Places | None
    value: tuple[Linear, ...]
    advantage: tuple[Linear, ...]
    reward_seconds: float = eqx.field(static=True)  # of time in one unit of reward
    unit: float = eqx.field(static=True)  # rewards per unit of the heads' output
    dueling: bool = eqx.field(static=True)
    potential: bool = eqx.field(static=True)

    def __call__(self, observation: Observation) -> Float[Array, " exit"]:
        """Q-value of every exit; those of exits that do not exist mean nothing."""
        local, estimate = observation.local, observation.estimate
        if local is None or estimate is None:
            raise ValueError("streets can be scored from level local on")
        state, streets = jax.lax.stop_gradient(self._features(observation, local, estimate))
        toll_here, toll_onward = jnp.float32(0), jnp.zeros(streets.shape[0])
        if self.places is not None:
            here = self.places(observation.node, local.clock)
            onward = self.places(local.onto, local.clock + local.crossing)
            state, streets = jnp.concatenate([state, here]), jnp.concatenate([streets, onward], axis=1)
            # The first of a place's numbers counts directly: a table of corrections to the time to go from there.
            toll_here, toll_onward = here[0], onward[:, 0]
        everywhere = jnp.broadcast_to(state, (streets.shape[0], state.shape[0]))
        advantage = toll_onward + _through(self.advantage, jnp.concatenate([everywhere, streets], axis=1))[:, 0]
        if self.dueling:
            value = toll_here + _through(self.value, state[None])[0, 0]
            advantage = combine(value, advantage, observation.valid)
        q = self.unit * advantage
        return q - estimate / self.reward_seconds if self.potential else q

    def _features(
        self, seen: Observation, local: Local, estimate: Float[Array, " exit"]
    ) -> tuple[Float[Array, " state"], Float[Array, "exit street"]]:
        """Inputs of about unit size."""
        least = jnp.min(jnp.where(seen.valid, estimate, jnp.inf))
        far = jnp.linalg.norm(local.ahead)
        onward = jnp.linalg.norm(local.onward, axis=1)
        state = [
            jnp.stack(
                [local.clock / CLOCK_SECONDS, far / self.metres / 10, least / self.seconds / 10, seen.valid.sum() / 4]
            ),
            local.ahead / jnp.maximum(far, 1.0),
        ]
        streets = [
            jnp.log(local.cost / self.seconds),
            jnp.log(local.cost * FREE_SPEED / local.length),
            local.length / self.metres - 1,
            (far - onward) / local.length,
            onward / self.metres / 10,
            jnp.minimum((estimate - least) / self.seconds, FAR) / 3,
            (local.steps_since_visit == 1).astype(float),
            jnp.where(local.steps_since_visit <= RECENT_NODES, 1 - local.steps_since_visit / (1 + RECENT_NODES), 0.0),
        ]
        if seen.expected is not None:
            streets += [
                jnp.log(seen.expected.cost / self.seconds),
                jnp.log(local.cost / seen.expected.cost),
                jnp.clip((seen.expected.to_go - least) / self.seconds, -FAR, FAR) / 3,
            ]
            if seen.expected.log_density_ratio is not None and seen.expected.cost_to_go_scaled is not None:
                cost_to_go_scaled = jnp.clip(seen.expected.cost_to_go_scaled / self.seconds, -FAR, FAR) / 3
                least_heavier = jnp.min(jnp.where(seen.valid, cost_to_go_scaled, jnp.inf))
                log_density_ratio = (
                    jnp.sum(jnp.where(seen.valid, seen.expected.log_density_ratio, 0.0)) / seen.valid.sum()
                )
                state.append(log_density_ratio[None])
                streets += [
                    seen.expected.log_density_ratio,
                    cost_to_go_scaled,
                    (cost_to_go_scaled - least_heavier) * log_density_ratio,
                ]
        if seen.live is not None:
            streets += [
                jnp.clip((seen.live.snapshot - least) / self.seconds, -FAR, FAR) / 3,
                jnp.clip((seen.live.snapshot - estimate) / self.seconds, -FAR, FAR) / 3,
            ]
            if seen.expected is not None:
                usually = local.cost + seen.expected.to_go
                streets.append(jnp.clip((usually - estimate) / self.seconds, -FAR, FAR) / 3)
        streets = [jnp.where(seen.valid, each, 0.0) for each in streets]
        return jnp.concatenate(state), jnp.stack(streets, axis=1)


STATE = 6
STREET = {"local": 8, "map": 11, "live": 14}
SENSED = {"local": (0, 0), "map": (1, 3), "live": (1, 3)}  # more of both where crowds are known from sensors


def segment_network(
    network: RoadNetwork,
    key: Key[Array, ""],
    *,
    level: str,
    sensed: bool = False,
    hidden: tuple[int, ...],
    places: int,
    bins: int,
    bin_seconds: float,
    dueling: bool,
    potential: bool,
    reward_seconds: float,
    unit: float,
) -> SegmentQNetwork:
    """A freshly initialised network; its last layers are zero."""
    metres = jnp.mean(network.length)
    table_key, key = jax.random.split(key)
    table = None
    if places:
        numbers = 0.3 * jax.random.normal(table_key, (bins, network.nodes, places))
        table = Places(numbers.at[..., 0].set(0.0), bin_seconds)
    value_key, advantage_key = jax.random.split(key)
    more_state, more_street = SENSED[level] if sensed else (0, 0)
    state, street = STATE + more_state, STREET[level] + more_street
    return SegmentQNetwork(
        metres=metres,
        seconds=metres / FREE_SPEED,
        places=table,
        value=_layers((state + places, *hidden, 1), value_key),
        advantage=_layers((state + street + 2 * places, *hidden, 1), advantage_key),
        reward_seconds=reward_seconds,
        unit=unit,
        dueling=dueling,
        potential=potential,
    )


def _layers(widths: tuple[int, ...], key: Key[Array, ""]) -> tuple[Linear, ...]:
    """Fully connected layers; the last is zero."""
    shapes = list(itertools.pairwise(widths))
    layers = []
    for (fan_in, fan_out), one in zip(shapes, jax.random.split(key, len(shapes)), strict=True):
        weight = jax.random.uniform(one, (fan_out, fan_in), minval=-1.0) / jnp.sqrt(fan_in)
        layers.append(Linear(weight, jnp.zeros(fan_out)))
    return (*layers[:-1], Linear(jnp.zeros_like(layers[-1].weight), layers[-1].bias))


def _through(layers: tuple[Linear, ...], inputs: Float[Array, "n in"]) -> Float[Array, "n out"]:
    """Fully connected layers with ReLU between them."""
    *hidden, last = layers
    for layer in hidden:
        inputs = jax.nn.relu(inputs @ layer.weight.T + layer.bias)
    return inputs @ last.weight.T + last.bias
