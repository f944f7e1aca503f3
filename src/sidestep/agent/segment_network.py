"""A dueling Q-network that scores segment by segment, for any number of segments, origins, destinations and maps."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from sidestep.agent.layers import Linear, combine, through, zero_ended_layers
from sidestep.environment.types import RECENT_NODES, Expected, Live, Local, Observation
from sidestep.network.graph import RoadNetwork
from sidestep.walking.speed_laws import FREE_SPEED

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

    def __call__(self, observation: Observation) -> Float[Array, " exit"]:
        """Q-value of every exit; those of exits that do not exist mean nothing."""
        local, estimate = observation.local, observation.estimate
        if local is None or estimate is None:
            raise ValueError("segments can be scored from level local on")
        state, segments = jax.lax.stop_gradient(self._features(observation, local, estimate))
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

    def _features(
        self, seen: Observation, local: Local, estimate: Float[Array, " exit"]
    ) -> tuple[Float[Array, " state"], Float[Array, "exit feature"]]:
        """Inputs of about unit size: those of the state, and those of each segment that leaves."""
        least = jnp.min(jnp.where(seen.valid, estimate, jnp.inf))
        state, segments = self._local(seen, local, estimate, least)
        if seen.expected is not None:
            more_state, more = self._map(seen, local, seen.expected, least)
            state, segments = state + more_state, segments + more
        if seen.live is not None:
            segments += self._live(local, seen.expected, seen.live, estimate, least)
        segments = [jnp.where(seen.valid, each, 0.0) for each in segments]
        return jnp.concatenate(state), jnp.stack(segments, axis=1)

    def _local(
        self, seen: Observation, local: Local, estimate: Float[Array, " exit"], least: Float[Array, ""]
    ) -> tuple[list[Array], list[Array]]:
        """What level ``local`` observes."""
        far = jnp.linalg.norm(local.ahead)
        onward = jnp.linalg.norm(local.onward, axis=1)
        state = [
            jnp.stack(
                [local.clock / CLOCK_SECONDS, far / self.metres / 10, least / self.seconds / 10, seen.valid.sum() / 4]
            ),
            local.ahead / jnp.maximum(far, 1.0),
        ]
        return state, [
            jnp.log(local.cost / self.seconds),
            jnp.log(local.cost * FREE_SPEED / local.length),
            local.length / self.metres - 1,
            (far - onward) / local.length,
            onward / self.metres / 10,
            jnp.minimum((estimate - least) / self.seconds, FAR) / 3,
            (local.steps_since_visit == 1).astype(float),
            jnp.where(local.steps_since_visit <= RECENT_NODES, 1 - local.steps_since_visit / (1 + RECENT_NODES), 0.0),
        ]

    def _map(
        self, seen: Observation, local: Local, expected: Expected, least: Float[Array, ""]
    ) -> tuple[list[Array], list[Array]]:
        """What level ``map`` observes beside level ``local``."""
        segments = [
            jnp.log(expected.cost / self.seconds),
            jnp.log(local.cost / expected.cost),
            self._cut_off(expected.to_go - least),
        ]
        if expected.log_density_ratio is None or expected.cost_to_go_scaled is None:
            return [], segments
        scaled = jnp.clip(expected.cost_to_go_scaled / self.seconds, -FAR, FAR) / 3
        least_scaled = jnp.min(jnp.where(seen.valid, scaled, jnp.inf))
        mean_ratio = jnp.sum(jnp.where(seen.valid, expected.log_density_ratio, 0.0)) / seen.valid.sum()
        return [mean_ratio[None]], [*segments, expected.log_density_ratio, scaled, (scaled - least_scaled) * mean_ratio]

    def _live(
        self,
        local: Local,
        expected: Expected | None,
        live: Live,
        estimate: Float[Array, " exit"],
        least: Float[Array, ""],
    ) -> list[Array]:
        """What level ``live`` observes beside level ``map``."""
        segments = [self._cut_off(live.snapshot - least), self._cut_off(live.snapshot - estimate)]
        if expected is not None:
            segments.append(self._cut_off(local.cost + expected.to_go - estimate))
        return segments

    def _cut_off(self, seconds: Float[Array, " exit"]) -> Float[Array, " exit"]:
        return jnp.clip(seconds / self.seconds, -FAR, FAR) / 3


STATE = 6
SEGMENT = {"local": 8, "map": 11, "live": 14}
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
    """Initialise a segment network; its last layers are zero."""
    metres = jnp.mean(network.length)
    table_key, key = jax.random.split(key)
    table = None
    if places:
        numbers = 0.3 * jax.random.normal(table_key, (bins, network.nodes, places))
        table = Places(numbers.at[..., 0].set(0.0), bin_seconds)
    value_key, advantage_key = jax.random.split(key)
    more_state, more_segment = SENSED[level] if sensed else (0, 0)
    state, segment = STATE + more_state, SEGMENT[level] + more_segment
    return SegmentQNetwork(
        metres=metres,
        seconds=metres / FREE_SPEED,
        places=table,
        value=zero_ended_layers((state + places, *hidden, 1), value_key),
        advantage=zero_ended_layers((state + segment + 2 * places, *hidden, 1), advantage_key),
        reward_seconds=reward_seconds,
        unit=unit,
        dueling=dueling,
        potential=potential,
    )
