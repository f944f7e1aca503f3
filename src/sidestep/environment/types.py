"""What the environment is made of. One walker everywhere; ``jax.vmap`` makes many."""

from typing import Literal, get_args

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sidestep.flow.field import Field, SensedField
from sidestep.network.graph import RoadNetwork
from sidestep.travel_time import CrossingRule, SensedSpeeds, SpeedLaw, Speeds, speed_field

Level = Literal["position", "local", "map", "live", "hindsight"]
Seen = Literal["position", "local", "map", "live"]  # levels at which a walker can stand at a crossing
LEVELS: tuple[Seen, ...] = get_args(Seen)


class RewardWeights(eqx.Module):
    """Weights of eq. 13, as corrected: r = -c / unit + w_r (φ(t-1) - φ(t)) + bonus on arrival."""

    unit_seconds: float = eqx.field(static=True, default=60.0)  # one unit of reward; the paper's -67 are minutes
    progress: float = eqx.field(static=True, default=1e-3)  # w_r, per metre of straight-line distance
    bonus: float = eqx.field(static=True, default=1.0)


HEAVIER = 1.5
TRAIL = 8  # crossings that a walker remembers having left


class UsualToGo(eqx.Module):
    """What somebody knows who knows the map and its usual crowds: expected times to some destinations."""

    table: Float[Array, "goal slot node"]  # s to the destination, as each slot begins
    goal: Int[Array, " node"]  # which of the tables leads to a node; -1 where none does
    heavier: Float[Array, "goal slot node"] | None = None  # the same if all crowds were HEAVIER times as dense


class LiveToGo(eqx.Module):
    """What can be worked out from all counts of a slot; each crowd's is for one destination.

    ``forecast`` is known for the beginning and the end of the slot: in between, time is linear.
    """

    forecast: Float[
        Array, "crowd slot 2 segment"
    ]  # s to the destination over each segment, if crowds go on as forecast
    snapshot: Float[Array, "crowd slot node"]  # s to the destination, if crowds stay as they are


class EnvParams(eqx.Module):
    """Everything that stays while walkers walk: streets, crowds, rules, and what walkers know of them."""

    network: RoadNetwork
    crowds: Speeds  # the futures that an episode may meet
    expected: Speeds  # what somebody expects who knows the usual crowds: number c modulo their count instead of crowd c
    horizon: Float[Array, ""]  # s after departure at which a walk is cut off
    reward: RewardWeights = RewardWeights()
    rule: CrossingRule = eqx.field(static=True, default="integrated")
    level: Seen = eqx.field(static=True, default="position")  # what walkers see
    usual: UsualToGo | None = None  # levels map and live need it
    live: LiveToGo | None = None  # level live needs it


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
    trail: Int[Array, " trail"]  # nodes that were left before, the latest first; -1 before the origin


class Local(eqx.Module):
    """What level ``local`` sees beside level ``position``."""

    clock: Float[Array, ""]  # s since the scenario's start
    ahead: Float[Array, "2"]  # m, from here to the destination
    onto: Int[Array, " exit"]  # next node
    onward: Float[Array, "exit 2"]  # m, from each next node to the destination
    length: Float[Array, " exit"]  # m
    crossing: Float[Array, " exit"]  # s to cross each exit at the speed that is seen on it now
    again: Bool[Array, ""]  # whether this crossing is remembered, having been left before
    left: Int[Array, " exit"]  # crossings since each next node was left; TRAIL + 1 where it is not remembered


class Usual(eqx.Module):
    """What level ``map`` knows beside level ``local``."""

    crossing: Float[Array, " exit"]  # s to cross each exit with the crowd that is usual now
    to_go: Float[Array, " exit"]  # s from each next node to the destination, usually, from when it is reached
    # where crowds are known from sensors:
    surprise: Float[Array, " exit"] | None = None  # logarithm of the density that is seen over the usual one
    heavier: Float[Array, " exit"] | None = None  # s more to the destination if all crowds were HEAVIER times as dense


class Live(eqx.Module):
    """What level ``live`` knows beside level ``map``."""

    snapshot: Float[Array, " exit"]  # s to the destination over each exit, if crowds stay as they are
    forecast: Float[Array, " exit"]  # s to the destination over each exit, if crowds go on as forecast


class Observation(eqx.Module):
    """What a walker sees at a crossing; what its level does not see is None.

    Entries of exits that do not exist mean nothing.
    """

    # level position
    node: Int[Array, ""]
    position: Float[Array, "2"]  # x, y in metres
    valid: Bool[Array, " exit"]  # which exits exist
    # level local
    local: Local | None = None
    # level map
    usual: Usual | None = None
    # level live
    live: Live | None = None
    # every level beyond position
    estimate: Float[Array, " exit"] | None = None  # s to the destination over each exit, as the level reckons


class Outcome(eqx.Module):
    """What one step brought."""

    observation: Observation
    reward: Float[Array, ""]
    seconds: Float[Array, ""]  # crossing time
    terminated: Bool[Array, ""]  # arrived
    truncated: Bool[Array, ""]  # not arrived when the horizon was over


def walking_speeds(network: RoadNetwork, flow: Field, law: SpeedLaw) -> Speeds:
    """Speeds on every segment from the people on it."""
    if isinstance(flow, SensedField):
        return SensedSpeeds(flow.sensed, flow.spread, law, flow.slot_seconds)
    speed = law.speed(flow.density(network))
    return speed_field(jnp.swapaxes(speed, -1, -2), flow.slot_seconds)
