"""Planners that plan nothing beforehand and decide anew at every crossing, by the estimates of their level."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int, Key

from sidestep.environment.types import EnvParams, Information, Instance, KnowledgeError, Level, Observation
from sidestep.planners.base import DecideByPlan, Plan


def follow_estimate(_shared: None, _own: Array, observation: Observation, _key: Key[Array, ""]) -> Int[Array, ""]:
    """Take the exit of least estimated cost to go."""
    if observation.estimate is None:
        said = "observations of level position hold no estimates; observe level local or higher"
        raise KnowledgeError(said, field="observes")
    return jnp.argmin(jnp.where(observation.valid, observation.estimate, jnp.inf))


def follow_snapshot(_shared: None, _own: Array, observation: Observation, _key: Key[Array, ""]) -> Int[Array, ""]:
    """Take the exit of least cost to go if all crowds stay as they are."""
    if observation.live is None:
        raise KnowledgeError("observations below level live hold no snapshots; observe level live", field="observes")
    return jnp.argmin(jnp.where(observation.valid, observation.live.snapshot, jnp.inf))


class _Reactive:
    """Take the exit of least estimated cost to go; nothing is planned beforehand."""

    decide: ClassVar[DecideByPlan] = staticmethod(follow_estimate)

    def plan(self, _params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, jax.device_put(np.zeros(instances.origin.shape[0], np.float32)))


class GreedyLocal(_Reactive):
    """Take the fastest exit by the crowds in sight and a straight line at free speed beyond."""

    name: ClassVar[str] = "greedy-local"
    level: ClassVar[Level] = "local"
    observes: ClassVar[Information] = "local"


class GreedyMap(_Reactive):
    """Take the fastest exit by the crowds in sight and the path of least expected time beyond."""

    name: ClassVar[str] = "greedy-map"
    level: ClassVar[Level] = "map"
    observes: ClassVar[Information] = "map"


class Snapshot(_Reactive):
    """Follow the path that is fastest if all crowds stay as they are counted now."""

    name: ClassVar[str] = "snapshot"
    level: ClassVar[Level] = "live"
    observes: ClassVar[Information] = "live"
    decide: ClassVar[DecideByPlan] = staticmethod(follow_snapshot)


class Forecast(_Reactive):
    """Follow the path that is fastest if crowds develop as forecast from the latest counts."""

    name: ClassVar[str] = "forecast"
    level: ClassVar[Level] = "live"
    observes: ClassVar[Information] = "live"
