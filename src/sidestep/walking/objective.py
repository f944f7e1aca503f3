"""What walkers minimise: a weighted sum of time, distance and exposure to crowds."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from sidestep.walking.speed_laws import FREE_SPEED

FORBIDDEN = 3600.0  # s; entering where nobody should costs as much as that long a walk; walkers without other ways do


class Objective(eqx.Module):
    """What walkers keep low: a weighted sum of time, distance and the crowd that they meet.

    Its unit is a second. Entering a segment whose density is above the maximum costs as much more as walking for
    ``FORBIDDEN`` seconds in a crowd of that density.
    """

    time: float | Float[Array, ""] = 1.0  # for each second
    distance: float | Float[Array, ""] = 0.0  # s for each metre
    exposure: float | Float[Array, ""] = 0.0  # s for each person·s/m² met: the density, integrated over the walk
    max_density: float | Float[Array, ""] | None = None  # persons/m² above which nobody should enter a street

    def cost(
        self,
        seconds: Float[Array, "*n"],
        metres: Float[Array, "*n"],
        exposure: Float[Array, "*n"],
        density: Float[Array, "*n"],
    ) -> Float[Array, "*n"]:
        """Cost of segments that are entered at a density."""
        cost = self.time * seconds + self.distance * metres + self.exposure * exposure
        return cost + self.penalty * self.too_dense(density)

    @property
    def penalty(self) -> float | Float[Array, ""]:
        """Cost of entering where it is too dense."""
        dense = 0.0 if self.max_density is None else self.max_density
        return FORBIDDEN * (self.time + self.distance * FREE_SPEED + self.exposure * dense)

    def too_dense(self, density: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """1 where nobody should enter, elsewhere 0."""
        return jnp.zeros_like(density) if self.max_density is None else (density > self.max_density).astype(float)
