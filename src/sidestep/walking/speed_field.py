"""Walking speeds on every segment in every slot."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.crowds.interpolation import Spread
from sidestep.walking.speed_laws import SpeedLaw


class SpeedField(eqx.Module):
    """Walking speed on every segment in every slot, and how far one gets in them.

    Leading axes, if any, count alternative crowds. The last slot's speed holds for ever after.
    """

    speed: Float[Array, "*crowd segment slot"]  # m/s
    covered: Float[Array, "*crowd segment slot"]  # m walked on the segment from clock 0 to the slot's beginning
    slot_seconds: float = eqx.field(static=True)
    density: Float[Array, "*crowd segment slot"] | None = None  # persons/m², where it is asked for

    @property
    def slots(self) -> int:
        """Number of slots."""
        return self.speed.shape[-1]

    @property
    def count(self) -> int:
        """Number of alternative crowds, where there is a leading axis."""
        return self.speed.shape[0]

    def of(self, crowd: Int[Array, ""]) -> "SpeedField":
        """One of the alternative crowds."""
        density = None if self.density is None else self.density[crowd]
        return SpeedField(self.speed[crowd], self.covered[crowd], self.slot_seconds, density)

    def first(self, crowds: int | None = None, slots: int | None = None) -> "SpeedField":
        """The first of the alternative crowds in the first slots; None: all of them."""
        part = (slice(crowds), slice(None), slice(slots))
        density = None if self.density is None else self.density[part]
        return SpeedField(self.speed[part], self.covered[part], self.slot_seconds, density)

    def at(self, crowd: Int[Array, ""], segment: Int[Array, "*n"], slot: Int[Array, ""]) -> Float[Array, "*n"]:
        """Speeds in m/s on segments in a slot of one of the crowds."""
        return self.speed[crowd, segment, slot]

    def density_at(self, crowd: Int[Array, ""], segment: Int[Array, "*n"], slot: Int[Array, ""]) -> Float[Array, "*n"]:
        """Densities in persons/m² on segments in a slot of one of the crowds."""
        return self.known_density[crowd, segment, slot]

    def densities(self, crowd: Int[Array, ""], segment: Int[Array, ""]) -> Float[Array, " slot"]:
        """One segment's densities in persons/m² in one of the crowds."""
        return self.known_density[crowd, segment]

    @property
    def known_density(self) -> Float[Array, "*crowd segment slot"]:
        """Densities in persons/m².

        Raises
        ------
        ValueError
            Speeds that were made without them.
        """
        if self.density is None:
            raise ValueError("these speeds were made without their densities")
        return self.density

    def through(
        self, crowd: Int[Array, ""], segment: Int[Array, ""]
    ) -> tuple[Float[Array, " slot"], Float[Array, " slot"]]:
        """One segment's speeds in one of the crowds, and how far one gets in them."""
        return self.speed[crowd, segment], self.covered[crowd, segment]


class SensedSpeeds(eqx.Module):
    """Walking speeds that follow from what sensors count, worked out where they are needed.

    The same as a :class:`SpeedField` with a leading axis of crowds, but memory grows with sensors, not with segments.
    """

    density: Float[Array, "crowd slot sensor"]  # persons/m² at the sensors
    spread: Spread
    law: SpeedLaw
    slot_seconds: float = eqx.field(static=True)

    @property
    def slots(self) -> int:
        """Number of slots."""
        return self.density.shape[1]

    @property
    def count(self) -> int:
        """Number of alternative crowds."""
        return self.density.shape[0]

    def of(self, crowd: Int[Array, ""]) -> SpeedField:
        """One of the alternative crowds, worked out on all segments."""
        density = self.spread.everywhere(self.density[crowd])
        return speed_field(self.law.speed(density).T, self.slot_seconds, density.T)

    def first(self, crowds: int | None = None, slots: int | None = None) -> "SensedSpeeds":
        """The first of the alternative crowds in the first slots; None: all of them."""
        return replace(self, density=self.density[:crowds, :slots])

    def at(self, crowd: Int[Array, ""], segment: Int[Array, "*n"], slot: Int[Array, ""]) -> Float[Array, "*n"]:
        """Speeds in m/s on segments in a slot of one of the crowds."""
        return self.law.speed(self.density_at(crowd, segment, slot))

    def density_at(self, crowd: Int[Array, ""], segment: Int[Array, "*n"], slot: Int[Array, ""]) -> Float[Array, "*n"]:
        """Densities in persons/m² on segments in a slot of one of the crowds."""
        near, weight = self.spread.sensor[segment], self.spread.weight[segment]
        return jnp.sum(weight * self.density[crowd, slot, near], axis=-1)

    def through(
        self, crowd: Int[Array, ""], segment: Int[Array, ""]
    ) -> tuple[Float[Array, " slot"], Float[Array, " slot"]]:
        """One segment's speeds in one of the crowds, and how far one gets in them."""
        speed = self.law.speed(self.densities(crowd, segment))
        return speed, covered_metres(speed, self.slot_seconds)

    def densities(self, crowd: Int[Array, ""], segment: Int[Array, ""]) -> Float[Array, " slot"]:
        """One segment's densities in persons/m² in one of the crowds."""
        near, weight = self.spread.sensor[segment], self.spread.weight[segment]
        return weight @ self.density[crowd, :, near]


Speeds = SpeedField | SensedSpeeds


def speed_field(
    speed: Float[Array, "*crowd segment slot"],
    slot_seconds: float,
    density: Float[Array, "*crowd segment slot"] | None = None,
) -> SpeedField:
    """Prepare speeds (m/s, positive) for crossing times; ``slot_seconds`` is the length of a slot."""
    return SpeedField(speed, covered_metres(speed, slot_seconds), slot_seconds, density)


def covered_metres(speed: Float[Array, "*lead slot"], slot_seconds: float) -> Float[Array, "*lead slot"]:
    """Metres walked from clock 0 to the beginning of each slot."""
    after = jnp.cumsum(speed * slot_seconds, axis=-1)
    return jnp.concatenate([jnp.zeros_like(after[..., :1]), after[..., :-1]], axis=-1)
