"""The types of the environment. All are of one walker; ``jax.vmap`` makes many."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.errors import SidestepError
from sidestep.network.graph import RoadNetwork
from sidestep.walking.crossing_time import CrossingRule
from sidestep.walking.expected_times import Speeds
from sidestep.walking.objective import Crossing, Objective, TravelTime
from sidestep.walking.opening import AnyWaits
from sidestep.walking.speed_laws import FREE_SPEED
from sidestep.walking.waits import NoWaits, Wait, light_phases

Level = Literal["position", "local", "map", "live", "hindsight"]
"""Levels of knowledge."""
Information = Literal["position", "local", "map", "live"]
"""Levels at which a walker can stand at a crossing; hindsight is for planning alone."""
LEVELS: tuple[Information, ...] = get_args(Information)

DENSITY_SCALE = 1.5
"""Factor of the densities in :attr:`ExpectedCostToGo.scaled`."""
RECENT_NODES = 8
"""Nodes that a walker remembers having left."""


class KnowledgeError(SidestepError):
    """Walks, or decisions, that need to know more than an environment was made for."""


class RewardWeights(eqx.Module):
    """Weights of eq. 13, as corrected: r = -c / unit + w_r (φ(t-1) - φ(t)) + bonus on arrival, c the cost of a step."""

    unit_seconds: float = eqx.field(static=True, default=60.0)
    """Seconds in one unit of reward; the paper's -67 are minutes."""
    progress: float = eqx.field(static=True, default=1e-3)
    """w_r, per metre of straight-line distance."""
    bonus: float = eqx.field(static=True, default=1.0)
    """For arriving."""


class ExpectedCostToGo(eqx.Module):
    """Expected costs of getting to some destinations: level ``map`` knows them."""

    table: Float[Array, "destination step node"]
    """Cost from each node to the destination, as each step begins."""
    destination: Int[Array, " node"]
    """Which destination's table leads to a node; -1 where none does."""
    scaled: Float[Array, "destination step node"] | None = None
    """The same in crowds ``DENSITY_SCALE`` times as dense; None where crowds are not interpolated."""
    steps: int = eqx.field(static=True, default=1)
    """In each slot; several where gates shut."""


class LiveCostToGo(eqx.Module):
    """Costs of getting to each future's destination, from all counts of a slot: level ``live`` knows them.

    They are of all slots or, for walkers who are in the same one, of that alone.
    """

    snapshot: Float[Array, "future slot node"]
    """Cost from each node, if crowds stay as they are."""
    forecast: Float[Array, "future slot step segment"] | None = None
    """Cost over each segment, if crowds go on as forecast, entered as each step of the slot begins, and as the last one
    ends. There is one step, or several where gates shut. None for walkers who do not look at it."""


class Futures(eqx.Module):
    """Possible futures of the crowds, with the walks that each of them is for."""

    speeds: Speeds
    destination: Int[Array, " future"]
    """Number of the destination that walks in this future go to, among those that the environment was made for."""
    hour: Float[Array, " future"]
    """Hour of the week at clock 0; 0 is Monday 0:00."""
    phase: Float[Array, " future"]
    """Seconds by which lights turn green later than :attr:`sidestep.walking.waits.Waits.offset` says."""
    cost_to_go: LiveCostToGo | None = None
    """None below level ``live``."""

    @property
    def count(self) -> int:
        """Number of futures."""
        return self.speeds.count

    def taken(self, index: Int[Array, " taken"]) -> "Futures":
        """The futures of these numbers, in this order."""
        destination, hour, phase = self.destination[index], self.hour[index], self.phase[index]
        costs = jax.tree.map(lambda leaf: leaf[index], self.cost_to_go)
        return Futures(self.speeds.taken(index), destination, hour, phase, costs)

    def replaced(self, futures: "Futures", index: Int[Array, " new"]) -> "Futures":
        """The same with the futures of these numbers replaced by others."""
        old, new = ((each.destination, each.hour, each.phase, each.cost_to_go) for each in (self, futures))
        rest = jax.tree.map(lambda before, after: before.at[index].set(after), old, new)
        return Futures(self.speeds.replaced(futures.speeds, index), *rest)


Meant = tuple[Int[Array, " future"], Float[Array, " future"], Float[Array, " future"]]
"""Destination, hour and phase of futures, as in :class:`Futures`."""


def destinations_in_turn(futures: int, hours: Float[Array, " destination"]) -> Meant:
    """Destination, hour and phase of futures that are for each of some destinations in turn.

    Parameters
    ----------
    futures
        How many.
    hours
        Hour of the week at which walks to each destination set out.

    Returns
    -------
    Meant
        Destination, hour and phase of each future.
    """
    destination = jnp.arange(futures) % hours.shape[0]
    return destination, hours[destination], light_phases(futures)


def futures_in_turn(speeds: Speeds, hours: Float[Array, " destination"]) -> Futures:
    """Futures with such ``speeds``, for each of some destinations in turn: see :func:`destinations_in_turn`."""
    return Futures(speeds, *destinations_in_turn(speeds.count, hours))


class EnvParams(eqx.Module):
    """Everything that stays while walkers walk: streets, crowds, rules, and what walkers know of them."""

    network: RoadNetwork
    futures: Futures
    """Those that an episode may meet."""
    expected: Speeds
    """What is expected of speeds and crowds at each destination's hour, or at any where hours do not matter."""
    horizon: Float[Array, ""]
    """Seconds after departure at which a walk is cut off."""
    reward: RewardWeights = RewardWeights()
    rule: CrossingRule = eqx.field(static=True, default="integrated")
    """How speeds that change during a crossing count."""
    level: Information = eqx.field(static=True, default="position")
    """What walkers see."""
    objective: Objective = TravelTime()
    """What walkers keep low."""
    waits: AnyWaits = NoWaits()
    """At gates, at lights and for gaps in the traffic."""
    cost_to_go: ExpectedCostToGo | None = None
    """None below level ``map``."""
    free_speed: float = eqx.field(static=True, default=FREE_SPEED)
    """Speed of walkers in an empty street, m/s."""

    def wait_in(self, future: Int[Array, ""]) -> Wait:
        """How long walkers wait before segments in one of the futures."""
        return partial(self.waits.seconds, self.futures.hour[future], self.futures.phase[future])

    def gates_in(self, future: Int[Array, ""]) -> Wait:
        """How much of that they wait until segments open."""
        return partial(self.waits.until_open, self.futures.hour[future])

    def begun_at(self, node: int) -> "EnvParams":
        """The same for walks that begin at a node, which may be in the middle of a street."""
        waits = self.waits.begun_on(np.asarray(self.network.tail) == node)
        return self if waits is self.waits else replace(self, waits=waits)

    def expected_for(self, future: Int[Array, "*n"]) -> Int[Array, "*n"]:
        """Which of the hours in ``expected`` belongs to one of the futures."""
        return self.futures.destination[future] if self.expected.count > 1 else jnp.zeros_like(future)


SeeSlot = Callable[[int, Bool[np.ndarray, " future"]], EnvParams]
"""The environment for walkers who are in one slot, given its number, and the futures in which any of them is."""


class Instance(eqx.Module):
    """One walk to be done, or several."""

    origin: Int[Array, "*walk"]
    """Node where it begins."""
    destination: Int[Array, "*walk"]
    """Node where it ends."""
    departure: Float[Array, "*walk"]
    """Clock, in s since the scenario's start."""
    future: Int[Array, "*walk"]
    """Which of :attr:`EnvParams.futures` it meets."""


class EnvState(eqx.Module):
    """Where a walker is, and when."""

    node: Int[Array, ""]
    clock: Float[Array, ""]
    """Seconds since the scenario's start."""
    instance: Instance
    recent_nodes: Int[Array, " recent_node"]
    """Nodes that were left before, the latest first; -1 before the origin."""
    steps: Int[Array, ""]
    """Segments walked so far."""


class Local(eqx.Module):
    """What level ``local`` sees beside level ``position``."""

    clock: Float[Array, ""]
    """Seconds since the scenario's start."""
    ahead: Float[Array, "2"]
    """From here to the destination, in m."""
    onto: Int[Array, " exit"]
    """Next node."""
    onward: Float[Array, "exit 2"]
    """From each next node to the destination, in m."""
    length: Float[Array, " exit"]
    """Length of the segment, in m."""
    crossing: Float[Array, " exit"]
    """Time to cross it in the crowd and with the gates and lights that are seen now, in s."""
    cost: Float[Array, " exit"]
    """Cost of crossing it."""
    revisiting: Bool[Array, ""]
    """Whether this node is among those remembered as left."""
    steps_since_visit: Int[Array, " exit"]
    """Steps since each next node was left; ``RECENT_NODES`` + 1 where it is not remembered."""


class Expected(eqx.Module):
    """What level ``map`` knows beside level ``local``."""

    cost: Float[Array, " exit"]
    """Expected cost of crossing each segment, entered now."""
    to_go: Float[Array, " exit"]
    """Expected cost from each next node to the destination, from when it is reached."""
    log_density_ratio: Float[Array, " exit"] | None = None
    """Logarithm of the density that is seen over the expected one; None where crowds are not interpolated."""
    cost_to_go_scaled: Float[Array, " exit"] | None = None
    """How much more ``to_go`` would be in crowds ``DENSITY_SCALE`` times as dense; None where it is not known."""


class Live(eqx.Module):
    """What level ``live`` knows beside level ``map``."""

    snapshot: Float[Array, " exit"]
    """Cost to the destination over each segment, if crowds stay as they are."""
    forecast: Float[Array, " exit"] | None = None
    """Cost to the destination over each segment, if crowds go on as forecast; None where no forecasts are known."""


class Observation(eqx.Module):
    """What a walker sees at a crossing; what its level does not see is None.

    Entries of exits that are not valid mean nothing.
    """

    node: Int[Array, ""]
    position: Float[Array, "2"]
    """x, y in m."""
    valid: Bool[Array, " exit"]
    """Which exits exist, and may be taken: see :meth:`sidestep.network.graph.RoadNetwork.exits_to`."""
    steps: Int[Array, ""]
    """Segments walked so far."""
    remembered: Float[Array, " node"] | None = None
    """What the walker remembers of each node, 0 where it was not there yet; None where it remembers nothing so."""
    local: Local | None = None
    """From level ``local`` on."""
    expected: Expected | None = None
    """From level ``map`` on."""
    live: Live | None = None
    """At level ``live``."""
    estimate: Float[Array, " exit"] | None = None
    """The level's own estimate of the cost to the destination over each exit, from level ``local`` on."""


class Outcome(eqx.Module):
    """What one step brought."""

    observation: Observation
    reward: Float[Array, ""]
    segment: Int[Array, ""]
    """The segment that was walked."""
    crossed: Crossing
    """What that took and cost."""
    terminated: Bool[Array, ""]
    """Arrived."""
    truncated: Bool[Array, ""]
    """Not arrived when the horizon was over."""
