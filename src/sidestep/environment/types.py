"""What the environment is made of. One walker everywhere; ``jax.vmap`` makes many."""

from typing import Literal, get_args

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sidestep.crowds.base import Field, FlowField, SensedField
from sidestep.network.graph import RoadNetwork
from sidestep.walking.crossing_time import CrossingRule
from sidestep.walking.objective import Objective
from sidestep.walking.speed_field import SensedSpeeds, SpeedField, Speeds, speed_field
from sidestep.walking.speed_laws import SpeedLaw
from sidestep.walking.waits import Waits

Level = Literal["position", "local", "map", "live", "hindsight"]
Information = Literal["position", "local", "map", "live"]  # levels at which a walker can stand at a crossing
LEVELS: tuple[Information, ...] = get_args(Information)


class RewardWeights(eqx.Module):
    """Weights of eq. 13, as corrected: r = -c / unit + w_r (φ(t-1) - φ(t)) + bonus on arrival, c the cost of a step."""

    unit_seconds: float = eqx.field(static=True, default=60.0)  # one unit of reward; the paper's -67 are minutes
    progress: float = eqx.field(static=True, default=1e-3)  # w_r, per metre of straight-line distance
    bonus: float = eqx.field(static=True, default=1.0)


DENSITY_SCALE = 1.5
RECENT_NODES = 8  # crossings that a walker remembers having left


class ExpectedCostToGo(eqx.Module):
    """What somebody knows who knows the map and its usual crowds: expected costs of getting to some destinations."""

    table: Float[Array, "goal slot node"]  # to the destination, as each slot begins
    goal: Int[Array, " node"]  # which of the tables leads to a node; -1 where none does
    cost_to_go_scaled: Float[Array, "goal slot node"] | None = (
        None  # the same if all crowds were HEAVIER times as dense
    )


class LiveCostToGo(eqx.Module):
    """What can be worked out from all counts of a slot; each crowd's is for one destination.

    ``forecast`` is known for the beginning and the end of the slot: in between, costs are linear.
    """

    forecast: Float[
        Array, "future slot 2 segment"
    ]  # cost to the destination over each segment, if crowds go on as forecast
    snapshot: Float[Array, "future slot node"]  # cost to the destination, if crowds stay as they are


class EnvParams(eqx.Module):
    """Everything that stays while walkers walk: streets, crowds, rules, and what walkers know of them."""

    network: RoadNetwork
    futures: Speeds  # the futures that an episode may meet
    expected: Speeds  # what somebody expects who knows the usual crowds: number c modulo their count instead of crowd c
    horizon: Float[Array, ""]  # s after departure at which a walk is cut off
    reward: RewardWeights = RewardWeights()
    rule: CrossingRule = eqx.field(static=True, default="integrated")
    level: Information = eqx.field(static=True, default="position")  # what walkers see
    usual: ExpectedCostToGo | None = None  # levels map and live need it
    live: LiveCostToGo | None = None  # level live needs it
    objective: Objective | None = None  # None: time alone
    waits: Waits | None = None  # at lights and for gaps; None: nowhere


class Instance(eqx.Module):
    """One walk to be done."""

    origin: Int[Array, "*walk"]  # node
    destination: Int[Array, "*walk"]  # node
    departure: Float[Array, "*walk"]  # s, clock
    future: Int[Array, "*walk"]  # which of EnvParams.crowds it meets


class EnvState(eqx.Module):
    """Where a walker is, and when."""

    node: Int[Array, ""]
    clock: Float[Array, ""]  # s since the scenario's start
    instance: Instance
    recent_nodes: Int[Array, " recent_nodes"]  # nodes that were left before, the latest first; -1 before the origin
    steps: Int[Array, ""]  # crossings left so far


class Local(eqx.Module):
    """What level ``local`` sees beside level ``position``."""

    clock: Float[Array, ""]  # s since the scenario's start
    ahead: Float[Array, "2"]  # m, from here to the destination
    onto: Int[Array, " exit"]  # next node
    onward: Float[Array, "exit 2"]  # m, from each next node to the destination
    length: Float[Array, " exit"]  # m
    crossing: Float[Array, " exit"]  # s to cross each exit at the speed and with the lights that are seen now
    cost: Float[Array, " exit"]  # of crossing it; the same where time is all that counts
    again: Bool[Array, ""]  # whether this crossing is remembered, having been left before
    left: Int[Array, " exit"]  # crossings since each next node was left; TRAIL + 1 where it is not remembered


class Usual(eqx.Module):
    """What level ``map`` knows beside level ``local``."""

    cost: Float[Array, " exit"]  # of crossing each exit with the crowd that is usual now
    to_go: Float[Array, " exit"]  # cost from each next node to the destination, usually, from when it is reached
    # where crowds are known from sensors:
    log_density_ratio: Float[Array, " exit"] | None = None  # logarithm of the density that is seen over the usual one
    cost_to_go_scaled: Float[Array, " exit"] | None = (
        None  # how much more that costs if all crowds were HEAVIER times as dense
    )


class Live(eqx.Module):
    """What level ``live`` knows beside level ``map``."""

    snapshot: Float[Array, " exit"]  # cost to the destination over each exit, if crowds stay as they are
    forecast: Float[Array, " exit"]  # cost to the destination over each exit, if crowds go on as forecast


class Observation(eqx.Module):
    """What a walker sees at a crossing; what its level does not see is None.

    Entries of exits that do not exist mean nothing.
    """

    # level position
    node: Int[Array, ""]
    position: Float[Array, "2"]  # x, y in metres
    valid: Bool[Array, " exit"]  # which exits exist
    steps: Int[Array, ""]  # crossings left so far
    # level local
    local: Local | None = None
    # level map
    usual: Usual | None = None
    # level live
    live: Live | None = None
    # every level beyond position
    estimate: Float[Array, " exit"] | None = None  # cost to the destination over each exit, as the level reckons


class Crossing(eqx.Module):
    """One segment walked, or each of many."""

    seconds: Float[Array, "*n"]  # with the wait before it
    metres: Float[Array, "*n"]
    cost: Float[Array, "*n"]  # s, or what counts as much
    # None where time is all that counts:
    exposure: Float[Array, "*n"] | None = None  # crowd met, person·s/m²
    too_dense: Float[Array, "*n"] | None = None  # 1 where nobody should have entered


class Outcome(eqx.Module):
    """What one step brought."""

    observation: Observation
    reward: Float[Array, ""]
    segment: Int[Array, ""]  # that was walked
    crossed: Crossing
    terminated: Bool[Array, ""]  # arrived
    truncated: Bool[Array, ""]  # not arrived when the horizon was over


def walking_speeds(network: RoadNetwork, flow: Field, law: SpeedLaw, *, densities: bool = False) -> Speeds:
    """Speeds on every segment from the people on it; ``densities`` are kept only where they are asked for."""
    if flow.interpolated:
        return SensedSpeeds(flow.sensed, flow.weights, law, flow.slot_seconds)
    return dense_speeds(network, flow, law, densities=densities)


def dense_speeds(network: RoadNetwork, flow: Field, law: SpeedLaw, *, densities: bool = False) -> SpeedField:
    """The same, worked out on all segments."""
    density = flow.density(network)
    speed = jnp.swapaxes(law.speed(density), -1, -2)
    return speed_field(speed, flow.slot_seconds, jnp.swapaxes(density, -1, -2) if densities else None)


def field_of(network: RoadNetwork, speeds: Speeds) -> Field:
    """The people from whom :func:`walking_speeds` made these speeds, if it kept their densities."""
    if isinstance(speeds, SensedSpeeds):
        return SensedField(speeds.density, speeds.weights, speeds.slot_seconds)
    volume = jnp.swapaxes(speeds.known_density, -1, -2) * network.length * network.width
    return FlowField(volume, speeds.slot_seconds)
