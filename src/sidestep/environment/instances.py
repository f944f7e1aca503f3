"""Samplers: which walk an episode is."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.environment.types import Instance

DRAWS = 4  # uniform numbers that one instance takes


class InstanceSampler(eqx.Module):
    """Independent uniform draws of a goal, then an origin (and with it the destination), departure and crowd.

    Crowd number c is for goal number c modulo goals, since what level ``live`` knows of a crowd is for one destination.
    """

    origins: Int[Array, "goal origin"]  # nodes
    destinations: Int[Array, "goal origin"]  # nodes: where a walk for this goal from each origin ends
    departures: Float[Array, "2"]  # s, earliest and latest clock
    futures: Int[Array, ""]  # number of crowds to draw from; a goal without a crowd is not walked to

    def sample(self, uniform: Float[Array, "4"]) -> Instance:
        """Turn four uniform numbers in [0, 1) into an instance.

        Numbers, not a key, because drawing them for a whole chunk of training at once is many times cheaper.
        """
        goals, origins = self.origins.shape
        goal = _pick(jnp.minimum(goals, self.futures), uniform[1])
        origin = _pick(origins, uniform[0])
        earliest, latest = self.departures
        return Instance(
            origin=self.origins[goal, origin],
            destination=self.destinations[goal, origin],
            departure=earliest + (latest - earliest) * uniform[2],
            future=goal + goals * _pick((self.futures - goal + goals - 1) // goals, uniform[3]),
        )


def _pick(count: Int[Array, ""] | int, uniform: Float[Array, ""]) -> Int[Array, ""]:
    """A number below a count."""
    return jnp.minimum((uniform * count).astype(jnp.int32), count - 1)
