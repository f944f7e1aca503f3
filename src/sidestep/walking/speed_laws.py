"""How fast people walk in a crowd."""

from dataclasses import replace
from typing import Literal, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

FREE_SPEED = 1.34  # m/s, the paper's x0 and Weidmann's mean


class SpeedLaw(eqx.Module):
    """Walking speed as a function of density."""

    free_speed: float = eqx.field(static=True, default=FREE_SPEED, kw_only=True)
    """Speed in an empty street, m/s."""

    def speed(self, density: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Speed in m/s at a density in persons/m²."""
        raise NotImplementedError

    def scaled(self, free_speed: float) -> Self:
        """The same law for somebody of another free speed: at all densities faster or slower by the same factor."""
        return replace(self, free_speed=free_speed)


class Aoki(SpeedLaw):
    """The paper's power law x = x0 ρ^-0.8 (eq. 3), of Aoki.

    It exceeds the free speed below one person per m²; ``capped`` holds it there, the paper does not.
    """

    exponent: float = eqx.field(static=True, default=0.8)
    capped: bool = eqx.field(static=True, default=True)

    def speed(self, density: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        factor = density**-self.exponent
        return self.free_speed * (jnp.minimum(factor, 1.0) if self.capped else factor)


class Weidmann(SpeedLaw):
    """Weidmann (1993) in Kladek's form, v = x0 (1 - exp[-1.913 (1/ρ - 1/5.4)]), never below ``floor``.

    The law itself reaches zero at the jam density of 5.4 persons/m²; the floor keeps travel times finite.
    """

    steepness: float = eqx.field(static=True, default=1.913)
    jam_density: float = eqx.field(static=True, default=5.4)
    floor: float = eqx.field(static=True, default=0.05)

    def speed(self, density: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        inverse = 1.0 / jnp.maximum(density, 1e-6)
        return jnp.maximum(-self.free_speed * jnp.expm1(-self.steepness * (inverse - 1 / self.jam_density)), self.floor)

    def scaled(self, free_speed: float) -> Self:
        return replace(self, free_speed=free_speed, floor=self.floor * (free_speed / self.free_speed))


class Sensitive(SpeedLaw):
    """A law for those whom crowds slow down as if they were ``crowd_factor`` times as dense."""

    law: SpeedLaw
    crowd_factor: float = eqx.field(static=True)

    def speed(self, density: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        return self.law.speed(self.crowd_factor * density)


DENSEST = 12.0  # persons/m²; nobody has counted more


def density_at_speed(law: SpeedLaw, speed: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """The lowest density in persons/m² at which people walk at a speed in m/s or slower, by bisection.

    It is 0 where the speed is that of an empty street or faster. Where the law knows no speed as low, it is the lowest
    density of the law's lowest speed up to ``DENSEST``: for Weidmann's law 4.88, where its floor begins.

    Parameters
    ----------
    law, speed
        The law, and speeds in m/s.

    Returns
    -------
    density
        Persons/m².
    """
    each, place = np.unique(np.asarray(speed, np.float32), return_inverse=True)
    wanted = jnp.maximum(jnp.asarray(each), law.speed(jnp.float32(DENSEST)))
    low, high = jnp.zeros_like(wanted), jnp.full_like(wanted, DENSEST)
    for _ in range(32):  # halvings of 0 to DENSEST: finer than single precision tells apart
        middle = (low + high) / 2
        faster = law.speed(middle) > wanted
        low, high = jnp.where(faster, middle, low), jnp.where(faster, high, middle)
    found = jnp.where(wanted >= law.speed(jnp.float32(0.0)), 0.0, high)
    return np.asarray(found)[place.reshape(np.shape(speed))]


Law = Literal["power", "power-capped", "weidmann"]
LAWS: dict[Law, SpeedLaw] = {"power": Aoki(capped=False), "power-capped": Aoki(capped=True), "weidmann": Weidmann()}
