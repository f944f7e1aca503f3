"""Planners that decide anew at every crossing by what their level reckons there."""

from collections.abc import Callable
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.environment.types import EnvParams, Information, Instance, Level, Observation
from sidestep.planners.base import DecideByPlan, Plan

Seconds = Callable[[Observation], Float[Array, " exit"]]  # to the destination over each exit


def least(seconds: Seconds) -> DecideByPlan:
    """Decide for the exit of the least time."""

    def decide(_shared: None, _own: Array, observation: Observation, _key: Key[Array, ""]) -> Int[Array, ""]:
        return jnp.argmin(jnp.where(observation.valid, seconds(observation), jnp.inf))

    return decide


def _reckoned(seen: Observation) -> Float[Array, " exit"]:
    if seen.estimate is None:
        raise ValueError("level position reckons no times")
    return seen.estimate


def _as_it_stands(seen: Observation) -> Float[Array, " exit"]:
    if seen.live is None:
        raise ValueError("only level live sees all counts")
    return seen.live.snapshot


class _Replanning:
    """Nothing is planned beforehand; at every crossing the exit of the least time, as the level reckons, is taken."""

    decide: ClassVar[DecideByPlan] = staticmethod(least(_reckoned))

    def plan(self, _params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, jnp.asarray(np.zeros(instances.origin.shape[0])))


class GreedyLocal(_Replanning):
    """Each street as crowded as it is seen to be, then straight on at free speed."""

    name: ClassVar[str] = "greedy-local"
    level: ClassVar[Level] = "local"
    observes: ClassVar[Information] = "local"


class GreedyMap(_Replanning):
    """Each street as crowded as it is seen to be, then the fastest way through the expected crowds."""

    name: ClassVar[str] = "greedy-map"
    level: ClassVar[Level] = "map"
    observes: ClassVar[Information] = "map"


class Snapshot(_Replanning):
    """The fastest way if all crowds stayed as they are counted now."""

    name: ClassVar[str] = "snapshot"
    level: ClassVar[Level] = "live"
    observes: ClassVar[Information] = "live"
    decide: ClassVar[DecideByPlan] = staticmethod(least(_as_it_stands))


class Forecast(_Replanning):
    """The fastest way if crowds go on as forecast from the counts of now, street by street when it is reached."""

    name: ClassVar[str] = "forecast"
    level: ClassVar[Level] = "live"
    observes: ClassVar[Information] = "live"
