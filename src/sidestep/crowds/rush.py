"""Synthetic crowds that come and go within hours: every street has its own rush hours, and noise that lasts."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.crowds.arima import stationary_ar1
from sidestep.crowds.base import FlowField, FlowModel


class RushFlow(FlowModel):
    """Volume = base · exp(amplitude · sin(2πt/period + phase)) · exp(noise).

    The noise of each segment is a stationary AR(1), independent of all others.
    """

    base: Float[Array, " segment"]
    """Persons, without waves or noise."""
    amplitude: Float[Array, " segment"]
    """Of the wave, in logarithms of the volume."""
    phase: Float[Array, " segment"]
    """Of the wave at clock 0, radians."""
    period: float = eqx.field(static=True)
    """Of the wave, seconds."""
    phi: float = eqx.field(static=True)
    """Coefficient of the noise from slot to slot, 0 to below 1."""
    sigma: float = eqx.field(static=True)
    """Standard deviation of the noise in every slot."""
    slot_seconds: float = eqx.field(static=True)
    """Length of a slot."""
    floor: float = eqx.field(static=True, default=1.0)
    """Persons that are always there: the power law gives zero time to a segment without people."""

    def expected(self, _hours: Float[Array, " hour"], slots: int) -> FlowField:
        """Mean volumes."""
        return self._field((self.median(jnp.arange(slots)) * jnp.exp(self.sigma**2 / 2))[None])

    def draw(self, key: Key[Array, ""], hours: Float[Array, " future"], slots: int) -> FlowField:
        """Possible futures; the noise is stationary from the first slot on."""
        return self._field(self.median(jnp.arange(slots)) * jnp.exp(self.noise(key, hours.shape[0], slots)))

    def ahead(
        self, now: Float[Array, " segment"], _hour: Float[Array, ""], slot: Int[Array, ""], slots: int
    ) -> Float[Array, "slots segment"]:
        """Mean volumes in this and the next slots, given those in this one."""
        after = slot + jnp.arange(slots)
        log_density_ratio = jnp.log(now) - jnp.log(self.median(slot[None])[0])
        fading = self.phi ** jnp.arange(slots, dtype=float)[:, None]
        half_variance = self.sigma**2 * (1 - fading**2) / 2
        return jnp.maximum(self.median(after) * jnp.exp(fading * log_density_ratio + half_variance), self.floor)

    def median(self, slot: Int[Array, " slots"]) -> Float[Array, "slots segment"]:
        """Median volumes in some slots."""
        turn = 2 * jnp.pi * slot[:, None] * self.slot_seconds / self.period
        return self.base * jnp.exp(self.amplitude * jnp.sin(turn + self.phase))

    def noise(self, key: Key[Array, ""], futures: int, slots: int) -> Float[Array, "future slot segment"]:
        """The noise of some futures."""
        return lasting_noise(key, (futures, slots, self.base.shape[0]), self.phi, self.sigma)

    def _field(self, volume: Float[Array, "*future slot segment"]) -> FlowField:
        return FlowField(jnp.maximum(volume, self.floor), self.slot_seconds)


def lasting_noise(
    key: Key[Array, ""], shape: tuple[int, int, int], phi: float, sigma: float
) -> Float[Array, "future slot segment"]:
    """Draw a stationary AR(1) over the slots for every future and segment, independent of all others.

    Parameters
    ----------
    key
        Of the random numbers.
    shape
        Numbers of futures, slots and segments.
    phi
        Coefficient from slot to slot, 0 to below 1.
    sigma
        Standard deviation in every slot.

    Returns
    -------
    noise
        In logarithms of the volume.
    """
    futures, slots, segments = shape
    innovations = jax.random.normal(key, (slots, futures, segments)) * sigma
    return stationary_ar1(phi, innovations[0], innovations[1:])


class ShiftingFlow(FlowModel):
    """Rush hours whose crowded nodes are elsewhere in every future: nobody knows beforehand where."""

    ordinary: RushFlow
    """The crowds without crowded nodes."""
    ends: Int[Array, "segment 2"]
    """Tail and head of each segment."""
    spared: Bool[Array, " node"]
    """Which nodes are never crowded."""
    crowded_nodes: int = eqx.field(static=True)
    """Number of crowded nodes in a future."""
    mean: float = eqx.field(static=True)
    """Mean base of the segments at crowded nodes, persons."""
    spread: float = eqx.field(static=True)
    """Standard deviation of that base, persons."""

    def expected(self, hours: Float[Array, " hour"], slots: int) -> FlowField:
        """Mean volumes over all places where the crowded nodes may be."""
        # Nodes are drawn without replacement: if one end of a segment is not crowded, the other end is likelier to be.
        candidates = jnp.sum(~self.spared)
        open_ends = jnp.sum(~self.spared[self.ends], axis=1)
        missed = jnp.where(open_ends >= 1, 1 - self.crowded_nodes / candidates, 1.0)
        missed *= jnp.where(open_ends == 2, 1 - self.crowded_nodes / jnp.maximum(candidates - 1, 1), 1.0)
        crowded = 1 - missed
        return self._based(self.ordinary.base * (1 - crowded) + self.mean * crowded).expected(hours, slots)

    def draw(self, key: Key[Array, ""], hours: Float[Array, " future"], slots: int) -> FlowField:
        """Possible futures, each with crowded nodes of its own."""
        futures = hours.shape[0]
        for_nodes, for_volumes, for_noise = jax.random.split(key, 3)
        lot = jnp.where(self.spared, jnp.inf, jax.random.uniform(for_nodes, (futures, self.spared.shape[0])))
        crowded = jnp.argsort(jnp.argsort(lot, axis=1), axis=1) < self.crowded_nodes
        volume = self.mean + self.spread * jax.random.normal(for_volumes, (futures, self.ends.shape[0]))
        base = jnp.where(crowded[:, self.ends].any(axis=-1), jnp.maximum(volume, 1.0), self.ordinary.base)
        median = jax.vmap(lambda one: self._based(one).median(jnp.arange(slots)))(base)
        field = median * jnp.exp(self.ordinary.noise(for_noise, futures, slots))
        return FlowField(jnp.maximum(field, self.ordinary.floor), self.ordinary.slot_seconds)

    def ahead(
        self, now: Float[Array, " segment"], hour: Float[Array, ""], slot: Int[Array, ""], slots: int
    ) -> Float[Array, "slots segment"]:
        """Mean volumes from this slot on; a segment counts as crowded if its volume is nearer to the crowded one."""
        wave = self.ordinary.median(slot[None])[0] / self.ordinary.base
        level = jnp.log(now / wave)
        nearer = jnp.abs(level - jnp.log(self.mean)) < jnp.abs(level - jnp.log(self.ordinary.base))
        return self._based(jnp.where(nearer, self.mean, self.ordinary.base)).ahead(now, hour, slot, slots)

    def _based(self, base: Float[Array, " segment"]) -> RushFlow:
        return eqx.tree_at(lambda flow: flow.base, self.ordinary, base)
