"""The planner protocol, and the one way in which all planners walk."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int, Key, PyTree

from sidestep.environment.cost_to_go import check_known
from sidestep.environment.dynamics import random_exit
from sidestep.environment.observation import at_level
from sidestep.environment.rollout import Walk, walk
from sidestep.environment.types import EnvParams, Information, Instance, Level, Observation


class Plan(eqx.Module):
    """What a planner worked out before walks begin."""

    shared: PyTree  # the same for all walks
    own: PyTree  # each leaf [walk, ...]


DecideByPlan = Callable[[Any, Any, Observation, Key[Array, ""]], Int[Array, ""]]


@runtime_checkable
class Planner(Protocol):
    """Decides at every crossing which exit to take.

    ``level`` says what the planner may know, ``observes`` what it looks at on the way. Whatever it knows of map and
    crowds beforehand enters through :meth:`plan`; on the way ``decide`` sees the observation alone, as a pure function
    of one walker (``jax.vmap`` makes many). It is static: planners which decide alike share one compiled program.
    """

    name: ClassVar[str]
    decide: ClassVar[DecideByPlan]  # (plan.shared, plan.own of this walk, observation, key) -> exit

    @property
    def level(self) -> Level: ...

    @property
    def observes(self) -> Information: ...

    def plan(self, params: EnvParams, instances: Instance, /) -> Plan:
        """Prepare walks; ``instances`` has a leading axis of walks."""
        ...


@dataclass(frozen=True)
class Route:
    """A whole walk, for people."""

    segments: tuple[int, ...]
    nodes: tuple[int, ...]  # the origin, and where each segment ends
    clocks: tuple[float, ...]  # s at which each node is reached
    seconds: float
    arrived: bool


def choose_allowed(
    _shared: None, allowed: Bool[Array, "node exit"], observation: Observation, key: Key[Array, ""]
) -> Int[Array, ""]:
    """Take one of the exits that a table allows here, at random if there are several."""
    here = allowed[observation.node]
    return random_exit(jnp.where(here.any(), here, observation.valid), jax.random.uniform(key))


@partial(jax.jit, static_argnames=("decide", "trace"))
def _walks(
    decide: DecideByPlan, params: EnvParams, plan: Plan, instances: Instance, keys: Key[Array, " walk"], trace: int
) -> Walk:
    def one(own: PyTree, instance: Instance, key: Key[Array, ""]) -> Walk:
        return walk(params, partial(decide, plan.shared, own), instance, key, trace)

    return jax.vmap(one)(plan.own, instances, keys)


def walk_plan(
    planner: Planner, params: EnvParams, plan: Plan, instances: Instance, key: Key[Array, ""], trace: int = 0
) -> Walk:
    """Walk all instances as planned; the same key gives every planner the same random numbers."""
    keys = jax.random.split(key, instances.origin.shape[0])
    params = at_level(params, planner.observes)
    check_known(params, instances)
    return _walks(planner.decide, params, plan, instances, keys, trace)


def routes(planner: Planner, params: EnvParams, instances: Instance, key: Key[Array, ""], trace: int) -> list[Route]:
    """Whole routes of at most ``trace`` segments."""
    walked = walk_plan(planner, params, planner.plan(params, instances), instances, key, trace)
    head = np.asarray(params.network.head)
    found = []
    for origin, departure, segments, clocks, steps, seconds, arrived in zip(
        *map(np.asarray, (instances.origin, instances.departure)),
        *map(np.asarray, (walked.segments, walked.clocks, walked.steps, walked.seconds, walked.arrived)),
        strict=True,
    ):
        size = min(int(steps), trace)
        nodes = (int(origin), *head[segments[:size]].tolist())
        at = (float(departure), *clocks[:size].tolist())
        found.append(Route(tuple(segments[:size].tolist()), nodes, at, float(seconds), bool(arrived)))
    return found
