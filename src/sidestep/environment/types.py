"""What the environment is made of. One walker everywhere; ``jax.vmap`` makes many."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sidestep.flow.field import FlowField
from sidestep.network.graph import RoadNetwork
from sidestep.travel_time import CrossingRule, SpeedField, SpeedLaw, speed_field

Level = Literal["position", "local", "map", "live", "hindsight"]


class RewardWeights(eqx.Module):
    """Weights of eq. 13, as corrected: r = -c / unit + w_r (φ(t-1) - φ(t)) + bonus on arrival."""

    unit_seconds: float = eqx.field(static=True, default=60.0)  # one unit of reward; the paper's -67 are minutes
    progress: float = eqx.field(static=True, default=1e-3)  # w_r, per metre of straight-line distance
    bonus: float = eqx.field(static=True, default=1.0)


class EnvParams(eqx.Module):
    """Everything that stays while walkers walk: streets, crowds, rules."""

    network: RoadNetwork
    crowds: SpeedField  # [crowd, segment, slot]: the futures that an episode may meet
    expected: SpeedField  # [segment, slot]: the future that somebody who knows the usual crowds expects
    horizon: Float[Array, ""]  # s after departure at which a walk is cut off
    reward: RewardWeights = RewardWeights()
    rule: CrossingRule = eqx.field(static=True, default="integrated")


class Instance(eqx.Module):
    """One walk to be done."""

    origin: Int[Array, "*walk"]  # node
    destination: Int[Array, "*walk"]  # node
    departure: Float[Array, "*walk"]  # s, clock
    crowd: Int[Array, "*walk"]  # which of EnvParams.crowds it meets


class EnvState(eqx.Module):
    """Where a walker is, and when."""

    node: Int[Array, ""]
    clock: Float[Array, ""]  # s since the scenario's start
    instance: Instance


class Observation(eqx.Module):
    """What a walker sees at level ``position``: where it is, and which exits it has."""

    node: Int[Array, ""]
    position: Float[Array, "2"]  # x, y in metres
    valid: Bool[Array, " exit"]


class Outcome(eqx.Module):
    """What one step brought."""

    observation: Observation
    reward: Float[Array, ""]
    seconds: Float[Array, ""]  # crossing time
    terminated: Bool[Array, ""]  # arrived
    truncated: Bool[Array, ""]  # not arrived when the horizon was over


def walking_speeds(network: RoadNetwork, flow: FlowField, law: SpeedLaw) -> SpeedField:
    """Speeds on every segment from the volumes on it."""
    speed = law.speed(flow.density(network))
    return speed_field(jnp.swapaxes(speed, -1, -2), flow.slot_seconds)


def one_crowd(crowds: SpeedField, crowd: Int[Array, ""]) -> SpeedField:
    """Pick one of the alternative crowds."""
    return jax.tree.map(lambda leaf: leaf[crowd], crowds)
