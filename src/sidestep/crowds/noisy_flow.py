"""Crowds with noise that lasts from slot to slot around median volumes."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from sidestep.crowds.arima import stationary_ar1
from sidestep.crowds.base import Counts, FlowField, FlowModel, Hours, Index, Scalar, Slots
from sidestep.crowds.normals import standard_normal

FEWEST = 1e-6  # persons; fewer count as nobody where logarithms are taken

Volumes = Float[Array, "future slot segment"]


class NoisyFlow(FlowModel):
    """Volume = median · exp(noise); the noise of each segment is a stationary AR(1), independent of all others."""

    phi: float = eqx.field(static=True)
    """Coefficient of the noise from slot to slot, 0 to below 1."""
    sigma: float = eqx.field(static=True)
    """Standard deviation of the noise in every slot; at 0, crowds come exactly at their medians."""
    slot_seconds: float = eqx.field(static=True)
    """Length of a slot."""
    floor: ClassVar[float] = 0.0
    """Persons that are always there."""

    @property
    def certain(self) -> bool:
        return self.sigma == 0

    @abstractmethod
    def median(self, hour: Scalar, slot: Slots) -> Float[Array, "slots segment"]:
        """Median volumes in some slots after clock 0, at which it is this ``hour`` of the week."""

    def expected(self, hours: Hours, slots: int) -> FlowField:
        """Mean volumes, for each of the hours."""
        return self._field(self._medians(hours if self.timed else hours[:1], slots) * jnp.exp(self.sigma**2 / 2))

    def draw(self, key: Key[Array, ""], hours: Hours, slots: int) -> FlowField:
        """Possible futures; the noise is stationary from the first slot on."""
        return self.with_noise(key, self._medians(hours, slots))

    def with_noise(self, key: Key[Array, ""], median: Volumes) -> FlowField:
        """Add noise to median volumes."""
        return self._field(median * jnp.exp(self.noise(key, *median.shape)) if self.sigma else median)

    def noise(self, key: Key[Array, ""], futures: int, slots: int, segments: int) -> Volumes:
        """Noise for this many futures, slots and segments, in logarithms of the volume."""
        innovations = standard_normal(key, (slots, futures, segments)) * self.sigma
        return stationary_ar1(self.phi, innovations[0], innovations[1:])

    def ahead(self, now: Counts, hour: Scalar, slot: Index, slots: int) -> Float[Array, "slots counter"]:
        """Mean volumes in this and the next slots, given those in this one.

        Where nobody is expected now, the counts tell nothing about the noise.

        Parameters
        ----------
        now
            Persons in this slot.
        hour, slot, slots
            Hour of the week at clock 0, the number of this slot, and how many to forecast.

        Returns
        -------
        volume
            Persons.
        """
        median = self.median(hour, slot + jnp.arange(slots))
        log_density_ratio = jnp.log(jnp.maximum(now, FEWEST)) - jnp.log(jnp.maximum(median[0], FEWEST))
        fading = jnp.where(median[0] > FEWEST, self.phi ** jnp.arange(slots, dtype=float)[:, None], 0.0)
        half_variance = self.sigma**2 * (1 - fading**2) / 2
        return jnp.maximum(median * jnp.exp(fading * log_density_ratio + half_variance), self.floor)

    def _medians(self, hours: Hours, slots: int) -> Float[Array, "hour slots segment"]:
        return jax.vmap(self.median, (0, None))(hours, jnp.arange(slots))

    def _field(self, volume: Float[Array, "*future slot segment"]) -> FlowField:
        return FlowField(jnp.maximum(volume, self.floor), self.slot_seconds)
