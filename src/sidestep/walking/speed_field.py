"""Walking speeds on every segment in every slot."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.walking.speed_laws import SpeedLaw


class SpeedField(eqx.Module):
    """Walking speed on every segment in every slot, and how far one gets in them.

    Leading axes, if any, count alternative crowds. The last slot's speed holds for ever after.
    """

    speed: Float[Array, "*future segment slot"]  # m/s
    covered: Float[Array, "*future segment slot"]  # m walked on the segment from clock 0 to the slot's beginning
    slot_seconds: float = eqx.field(static=True)
    density: Float[Array, "*future segment slot"] | None = None  # persons/m², where it is asked for

    @property
    def slots(self) -> int:
        """Number of slots."""
        return self.speed.shape[-1]

    @property
    def count(self) -> int:
        """Number of alternative crowds, where there is a leading axis."""
        return self.speed.shape[0]

    def of(self, future: Int[Array, ""]) -> "SpeedField":
        """One of the alternative crowds."""
        density = None if self.density is None else self.density[future]
        return SpeedField(self.speed[future], self.covered[future], self.slot_seconds, density)

    def first(self, futures: int | None = None, slots: int | None = None) -> "SpeedField":
        """The first of the alternative crowds in the first slots; None: all of them."""
        part = (slice(futures), slice(None), slice(slots))
        density = None if self.density is None else self.density[part]
        return SpeedField(self.speed[part], self.covered[part], self.slot_seconds, density)

    def at(self, future: Int[Array, ""], segment: Int[Array, "*n"], slot: Int[Array, ""]) -> Float[Array, "*n"]:
        """Speeds in m/s on segments in a slot of one of the crowds."""
        return self.speed[future, segment, slot]

    def density_at(self, future: Int[Array, ""], segment: Int[Array, "*n"], slot: Int[Array, ""]) -> Float[Array, "*n"]:
        """Densities in persons/m² on segments in a slot of one of the crowds."""
        return self.known_density[future, segment, slot]

    def densities(self, future: Int[Array, ""], segment: Int[Array, ""]) -> Float[Array, " slot"]:
        """One segment's densities in persons/m² in one of the crowds."""
        return self.known_density[future, segment]

    @property
    def known_density(self) -> Float[Array, "*future segment slot"]:
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
        self, future: Int[Array, ""], segment: Int[Array, ""]
    ) -> tuple[Float[Array, " slot"], Float[Array, " slot"]]:
        """One segment's speeds in one of the crowds, and how far one gets in them."""
        return self.speed[future, segment], self.covered[future, segment]


class SensedSpeeds(eqx.Module):
    """Walking speeds that follow from what sensors count, worked out where they are needed.

    The same as a :class:`SpeedField` with a leading axis of crowds, but memory grows with sensors, not with segments.
    """

    density: Float[Array, "future slot sensor"]  # persons/m² at the sensors
    weights: InterpolationWeights
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

    def of(self, future: Int[Array, ""]) -> SpeedField:
        """One of the alternative crowds, worked out on all segments."""
        density = self.weights.everywhere(self.density[future])
        return speed_field(self.law.speed(density).T, self.slot_seconds, density.T)

    def first(self, futures: int | None = None, slots: int | None = None) -> "SensedSpeeds":
        """The first of the alternative crowds in the first slots; None: all of them."""
        return replace(self, density=self.density[:futures, :slots])

    def at(self, future: Int[Array, ""], segment: Int[Array, "*n"], slot: Int[Array, ""]) -> Float[Array, "*n"]:
        """Speeds in m/s on segments in a slot of one of the crowds."""
        return self.law.speed(self.density_at(future, segment, slot))

    def density_at(self, future: Int[Array, ""], segment: Int[Array, "*n"], slot: Int[Array, ""]) -> Float[Array, "*n"]:
        """Densities in persons/m² on segments in a slot of one of the crowds."""
        near, weight = self.weights.sensor[segment], self.weights.weight[segment]
        return jnp.sum(weight * self.density[future, slot, near], axis=-1)

    def through(
        self, future: Int[Array, ""], segment: Int[Array, ""]
    ) -> tuple[Float[Array, " slot"], Float[Array, " slot"]]:
        """One segment's speeds in one of the crowds, and how far one gets in them."""
        speed = self.law.speed(self.densities(future, segment))
        return speed, covered_metres(speed, self.slot_seconds)

    def densities(self, future: Int[Array, ""], segment: Int[Array, ""]) -> Float[Array, " slot"]:
        """One segment's densities in persons/m² in one of the crowds."""
        near, weight = self.weights.sensor[segment], self.weights.weight[segment]
        return weight @ self.density[future, :, near]


Speeds = SpeedField | SensedSpeeds


def speed_field(
    speed: Float[Array, "*future segment slot"],
    slot_seconds: float,
    density: Float[Array, "*future segment slot"] | None = None,
) -> SpeedField:
    """Prepare speeds (m/s, positive) for crossing times; ``slot_seconds`` is the length of a slot."""
    return SpeedField(speed, covered_metres(speed, slot_seconds), slot_seconds, density)


def covered_metres(speed: Float[Array, "*lead slot"], slot_seconds: float) -> Float[Array, "*lead slot"]:
    """Metres walked from clock 0 to the beginning of each slot."""
    after = jnp.cumsum(speed * slot_seconds, axis=-1)
    return jnp.concatenate([jnp.zeros_like(after[..., :1]), after[..., :-1]], axis=-1)
