"""A dueling Q-network that scores segment by segment, for any number of segments, origins, destinations and maps."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from sidestep.agent.config import TrainConfig
from sidestep.agent.layers import Linear, combine, through, zero_ended_layers
from sidestep.environment.types import RECENT_NODES, Local, Observation
from sidestep.network.graph import RoadNetwork
from sidestep.scenarios.model import Scenario

BIN_SECONDS = 900.0
"""Time between two bins of what is learned of places, s."""
CLOCK_SECONDS = 4 * 3600.0
"""Unit of clocks, s."""
FAR = 10.0
"""Units of time at which differences are cut off, so that one blocked segment does not drown the others."""


class Places(eqx.Module):
    """What is learned of places on a map that is always the same: a few numbers for each node and time of day."""

    table: Float[Array, "bin node width"]
    seconds: float = eqx.field(static=True)
    """Time from one bin to the next, s; numbers are linear in between."""

    def __call__(self, node: Int[Array, "*n"], clock: Float[Array, "*n"]) -> Float[Array, "*n width"]:
        last = self.table.shape[0] - 1
        position = jnp.clip(clock / self.seconds, 0.0, last)
        before = jnp.floor(position).astype(jnp.int32)
        part = (position - before)[..., None]
        return (1 - part) * self.table[before, node] + part * self.table[jnp.minimum(before + 1, last), node]


class SegmentQNetwork(eqx.Module):
    """V from the walker's state, A from each segment that leaves, through one network for all segments.

    With ``potential``, Q is a correction to the level's own estimate of the cost to go, and the correction is zero
    before training: an untrained walker is its level's greedy planner.
    """

    metres: Float[Array, ""]
    """Unit of lengths, m; not trained."""
    seconds: Float[Array, ""]
    """Unit of times, s; not trained."""
    places: Places | None
    value: tuple[Linear, ...]
    advantage: tuple[Linear, ...]
    reward_seconds: float = eqx.field(static=True)
    """Seconds of cost in one unit of reward."""
    unit: float = eqx.field(static=True)
    """Units of reward in one unit of the heads."""
    dueling: bool = eqx.field(static=True)
    potential: bool = eqx.field(static=True)
    free_speed: float = eqx.field(static=True)
    """Of the walker in an empty street, m/s."""

    def __call__(self, observation: Observation) -> Float[Array, " exit"]:
        """Q-value of every exit; those of exits that do not exist mean nothing."""
        local, estimate = observation.local, observation.estimate
        if local is None or estimate is None:
            raise ValueError("segments can be scored from level local on")
        inputs = features(observation, local, estimate, self.metres, self.seconds, self.free_speed)
        state, segments = jax.lax.stop_gradient(inputs)
        toll_here, toll_onward = jnp.float32(0), jnp.zeros(segments.shape[0])
        if self.places is not None:
            here = self.places(observation.node, local.clock)
            onward = self.places(local.onto, local.clock + local.crossing)
            state, segments = jnp.concatenate([state, here]), jnp.concatenate([segments, onward], axis=1)
            # The first of a place's numbers counts directly: a table of corrections to the cost to go from there.
            toll_here, toll_onward = here[0], onward[:, 0]
        everywhere = jnp.broadcast_to(state, (segments.shape[0], state.shape[0]))
        advantage = toll_onward + through(self.advantage, jnp.concatenate([everywhere, segments], axis=1))[:, 0]
        if self.dueling:
            value = toll_here + through(self.value, state[None])[0, 0]
            advantage = combine(value, advantage, observation.valid)
        q = self.unit * advantage
        return q - estimate / self.reward_seconds if self.potential else q


def features(
    seen: Observation,
    local: Local,
    estimate: Float[Array, " exit"],
    metres: Float[Array, ""],
    seconds: Float[Array, ""],
    free_speed: float,
) -> tuple[Float[Array, " state"], Float[Array, "exit feature"]]:
    """Put what a walker sees from level ``local`` on into numbers of about unit size.

    Parameters
    ----------
    seen, local, estimate
        What the walker sees, with what it has from level ``local`` on.
    metres, seconds
        Units of lengths in m, and of times in s.
    free_speed
        Of the walker in an empty street, m/s.

    Returns
    -------
    state, segments
        Features of the state, and of each segment that leaves; those of exits that are not valid are 0.
    """

    def cut_off(late: Float[Array, " exit"]) -> Float[Array, " exit"]:
        return jnp.clip(late / seconds, -FAR, FAR) / 3

    least = jnp.min(jnp.where(seen.valid, estimate, jnp.inf))
    far = jnp.linalg.norm(local.ahead)
    onward = jnp.linalg.norm(local.onward, axis=1)
    exits = seen.valid.sum()
    state = [
        jnp.stack([local.clock / CLOCK_SECONDS, far / metres / 10, least / seconds / 10, exits / 4]),
        local.ahead / jnp.maximum(far, 1.0),
    ]
    segments = [
        jnp.log(local.cost / seconds),
        jnp.log(local.cost * free_speed / local.length),
        local.length / metres - 1,
        (far - onward) / local.length,
        onward / metres / 10,
        jnp.minimum((estimate - least) / seconds, FAR) / 3,
        (local.steps_since_visit == 1).astype(float),
        jnp.where(local.steps_since_visit <= RECENT_NODES, 1 - local.steps_since_visit / (1 + RECENT_NODES), 0.0),
    ]
    expected, live = seen.expected, seen.live
    if expected is not None:  # from level map on
        segments += [
            jnp.log(expected.cost / seconds),
            jnp.log(local.cost / expected.cost),
            cut_off(expected.to_go - least),
        ]
        if expected.log_density_ratio is not None and expected.cost_to_go_scaled is not None:
            ratio, scaled = expected.log_density_ratio, cut_off(expected.cost_to_go_scaled)
            least_scaled = jnp.min(jnp.where(seen.valid, scaled, jnp.inf))
            mean_ratio = jnp.sum(jnp.where(seen.valid, ratio, 0.0)) / exits
            state.append(mean_ratio[None])
            segments += [ratio, scaled, (scaled - least_scaled) * mean_ratio]
        if live is not None:
            ahead = live.snapshot - least, live.snapshot - estimate, local.cost + expected.to_go - estimate
            segments += map(cut_off, ahead)
    segments = [jnp.where(seen.valid, each, 0.0) for each in segments]
    return jnp.concatenate(state), jnp.stack(segments, axis=1)


STATE = 6
"""Features of the state; from level ``map`` on there is one more where crowds are interpolated."""
SEGMENT = {"local": 8, "map": 11, "live": 14}
"""Features of each segment by level; from level ``map`` on there are three more where crowds are interpolated."""


def segment_network(
    config: TrainConfig, scenario: Scenario, network: RoadNetwork, key: Key[Array, ""]
) -> SegmentQNetwork:
    """Initialise a segment network; its last layers are zero.

    Parameters
    ----------
    config
        Widths, and what is remembered of places.
    scenario
        How long its walks may take, its walker's speed, its unit of reward, and whether its crowds are interpolated.
    network
        The map's streets.
    key
        Random stream of the initial weights.

    Returns
    -------
    SegmentQNetwork
        Untrained, it walks as its level's greedy planner.
    """
    table_key, key = jax.random.split(key)
    places = None
    if config.places:
        bins = 1 + math.ceil(scenario.slots * scenario.slot_seconds / BIN_SECONDS)
        numbers = 0.3 * jax.random.normal(table_key, (bins, network.nodes, config.places))
        places = Places(numbers.at[..., 0].set(0.0), BIN_SECONDS)
    value_key, advantage_key = jax.random.split(key)
    more = scenario.place.interpolated and config.level != "local"
    state, segment = STATE + more, SEGMENT[config.level] + 3 * more
    metres = jnp.mean(network.length)
    return SegmentQNetwork(
        metres=metres,
        seconds=metres / scenario.walker.free_speed,
        places=places,
        value=zero_ended_layers((state + config.places, *config.hidden, 1), value_key),
        advantage=zero_ended_layers((state + segment + 2 * config.places, *config.hidden, 1), advantage_key),
        reward_seconds=scenario.reward.unit_seconds,
        unit=config.unit,
        dueling=config.dueling,
        potential=config.potential,
        free_speed=scenario.walker.free_speed,
    )
