"""Samplers: which walk an episode is."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.environment.types import Instance

DRAWS = 4  # uniform numbers that one instance takes


class InstanceSampler(eqx.Module):
    """Independent uniform draws of origin, destination, departure and crowd."""

    origins: Int[Array, " origin"]  # nodes
    destinations: Int[Array, " destination"]  # nodes
    departures: Float[Array, "2"]  # s, earliest and latest clock
    crowds: Int[Array, ""]  # number of crowds to draw from

    def sample(self, uniform: Float[Array, "4"]) -> Instance:
        """Turn four uniform numbers in [0, 1) into an instance.

        Numbers, not a key, because drawing them for a whole chunk of training at once is many times cheaper.
        """
        earliest, latest = self.departures
        return Instance(
            origin=_pick(self.origins, uniform[0]),
            destination=_pick(self.destinations, uniform[1]),
            departure=earliest + (latest - earliest) * uniform[2],
            crowd=jnp.minimum((uniform[3] * self.crowds).astype(jnp.int32), self.crowds - 1),
        )


def _pick(candidates: Int[Array, " candidate"], uniform: Float[Array, ""]) -> Int[Array, ""]:
    count = candidates.shape[0]
    return candidates[jnp.minimum((uniform * count).astype(jnp.int32), count - 1)]
