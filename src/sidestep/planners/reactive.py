"""Planners that plan nothing beforehand and decide anew at every crossing, by the estimates of their level."""

from collections.abc import Callable
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.environment.types import EnvParams, Information, Instance, Level, Observation
from sidestep.planners.base import DecideByPlan, Plan

CostToGo = Callable[[Observation], Float[Array, " exit"]]
"""Cost to the destination over each exit."""


def take_least(cost_to_go: CostToGo) -> DecideByPlan:
    """Make the decision that takes the exit of least cost to go."""

    def decide(_shared: None, _own: Array, observation: Observation, _key: Key[Array, ""]) -> Int[Array, ""]:
        return jnp.argmin(jnp.where(observation.valid, cost_to_go(observation), jnp.inf))

    return decide


def _estimate(observed: Observation) -> Float[Array, " exit"]:
    if observed.estimate is None:
        raise ValueError("observations of level position hold no estimates; observe level local or higher")
    return observed.estimate


def _snapshot(observed: Observation) -> Float[Array, " exit"]:
    if observed.live is None:
        raise ValueError("observations below level live hold no snapshots; observe level live")
    return observed.live.snapshot


class _Reactive:
    """Take the exit of least estimated cost to go; nothing is planned beforehand."""

    decide: ClassVar[DecideByPlan] = staticmethod(take_least(_estimate))

    def plan(self, _params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, jnp.asarray(np.zeros(instances.origin.shape[0])))


class GreedyLocal(_Reactive):
    """Take the fastest exit by the crowds in sight and a straight line at free speed beyond."""

    name: ClassVar[str] = "greedy-local"
    level: ClassVar[Level] = "local"
    observes: ClassVar[Information] = "local"


class GreedyMap(_Reactive):
    """Take the fastest exit by the crowds in sight and the fastest path through the expected crowds beyond."""

    name: ClassVar[str] = "greedy-map"
    level: ClassVar[Level] = "map"
    observes: ClassVar[Information] = "map"


class Snapshot(_Reactive):
    """Follow the path that is fastest if all crowds stay as they are counted now."""

    name: ClassVar[str] = "snapshot"
    level: ClassVar[Level] = "live"
    observes: ClassVar[Information] = "live"
    decide: ClassVar[DecideByPlan] = staticmethod(take_least(_snapshot))


class Forecast(_Reactive):
    """Follow the path that is fastest if crowds develop as forecast from the latest counts."""

    name: ClassVar[str] = "forecast"
    level: ClassVar[Level] = "live"
    observes: ClassVar[Information] = "live"
