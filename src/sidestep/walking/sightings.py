"""Crowds that walkers saw themselves: on their streets they count instead of others, and ever less as they grow old."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

COUNTS_FOR = 600.0
"""Seconds for which a crowd that was seen counts as it was."""
FORGOTTEN = 1800.0
"""Seconds after which it no longer counts at all; from ``COUNTS_FOR`` on it counts ever less."""


class Sightings(eqx.Module):
    """Densities that were seen on some segments, or on a single one."""

    density: Float[Array, "*segment"]
    """Persons/m²; any number where nothing was seen."""
    share: Float[Array, "*segment slot"]
    """How much that counts in each slot, from 0 to 1; 0 where nothing was seen."""

    def of(self, segment: Int[Array, ""]) -> "Sightings":
        """Those on one of the segments."""
        return Sightings(self.density[segment], self.share[segment])

    def later(self, slot: Int[Array, ""], slots: int) -> "Sightings":
        """Those in some slots from one on, given on all segments; after the last slot nothing counts."""
        share = jnp.pad(self.share, ((0, 0), (0, slots)))
        return Sightings(self.density, jax.lax.dynamic_slice_in_dim(share, slot, slots, axis=1))

    def among(self, density: Float[Array, "*lead slot"]) -> Float[Array, "*lead slot"]:
        """Densities on all segments, or on the single one, given those that there are otherwise."""
        share = self.share[..., : density.shape[-1]]
        return (1 - share) * density + share * self.density[..., None]

    def at(self, segment: Int[Array, "*n"], slot: Int[Array, ""], density: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Densities on some segments in one slot, given those that there are otherwise."""
        share = self.share[segment, slot]
        return (1 - share) * density + share * self.density[segment]
