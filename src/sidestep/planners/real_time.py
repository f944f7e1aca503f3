"""Real-time search: planners that find their way without a map, by what they remember of the walk."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.environment.crossing import static_crossing
from sidestep.environment.types import EnvParams, Information, Instance, KnowledgeError, Level, Observation
from sidestep.planners.base import DecideByPlan, Plan, RememberByPlan

WEIGHT = 2.0
"""Estimates begin as the cost of a straight line at free speed, times this.

With 1 they are never too high, and walkers turn back sooner; with 2 most walks are shorter.
"""

_Scalar = Float[Array, ""]


def _costs_to_go(metre: _Scalar, observation: Observation) -> tuple[_Scalar, Float[Array, " exit"]]:
    """The cost from here by what was known before, and over each exit; infinite over those that may not be taken."""
    local, remembered = observation.local, observation.remembered
    if local is None or remembered is None:
        said = "observations of level position show no crowds; observe level local"
        raise KnowledgeError(said, field="observes")
    here = jnp.maximum(remembered[observation.node], WEIGHT * metre * jnp.linalg.norm(local.ahead))
    beyond = jnp.maximum(remembered[local.onto], WEIGHT * metre * jnp.linalg.norm(local.onward, axis=1))
    return here, jnp.where(observation.valid, local.cost + beyond, jnp.inf)


def follow_learned(metre: _Scalar, _own: Array, observation: Observation, _key: Key[Array, ""]) -> Int[Array, ""]:
    """Take the exit over which the estimate is least."""
    _, over = _costs_to_go(metre, observation)
    return jnp.argmin(over)


def raise_estimate(metre: _Scalar, _own: Array, observation: Observation) -> _Scalar:
    """Remember the least estimate over an exit, if it is more than the one before."""
    here, over = _costs_to_go(metre, observation)
    return jnp.maximum(here, jnp.min(over))


class LrtaStar:
    """Take the fastest exit by the crowds in sight and what was learned on this walk beyond.

    Learning real-time A*. The walker remembers of every crossing that it leaves how far the destination is from there
    at least, as it looked then. So it learns to leave dead ends, in which ``greedy-local`` goes to and fro, and arrives
    in the end, if crowds stay as they are and some way leads there from everywhere.

    References
    ----------
    Korf (1990), doi:10.1016/0004-3702(90)90054-4; for the weight Shimbo, Ishida (2003),
    doi:10.1016/S0004-3702(02)00394-6.
    """

    name: ClassVar[str] = "lrta-star"
    level: ClassVar[Level] = "local"
    observes: ClassVar[Information] = "local"
    decide: ClassVar[DecideByPlan] = staticmethod(follow_learned)
    remember: ClassVar[RememberByPlan] = staticmethod(raise_estimate)

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        one, nobody = jnp.float32(1.0), jnp.float32(0.0)
        metre = static_crossing(params, one, jnp.float32(params.free_speed), lambda: nobody).cost
        return Plan(metre, jax.device_put(np.zeros(instances.origin.shape[0], np.float32)))
