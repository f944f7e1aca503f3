"""Synthetic crowds that come and go within hours: every street has its own rush hours, and noise that lasts."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.crowds.base import Counts, FlowField, FlowModel, Hours, Index, Scalar, Slots
from sidestep.crowds.noisy_flow import NoisyFlow


class RushFlow(NoisyFlow):
    """Median volume = base · exp(amplitude · sin(2πt/period + phase))."""

    base: Float[Array, " segment"]
    """Persons, without waves or noise."""
    amplitude: Float[Array, " segment"]
    """Of the wave, in logarithms of the volume."""
    phase: Float[Array, " segment"]
    """Of the wave at clock 0, radians."""
    period: float = eqx.field(static=True)
    """Of the wave, seconds."""
    floor: ClassVar[float] = 1.0
    """Persons that are always there: the power law gives zero time to a segment without people."""

    def median(self, _hour: Scalar, slot: Slots) -> Float[Array, "slots segment"]:
        turn = 2 * jnp.pi * slot[:, None] * self.slot_seconds / self.period
        return self.base * jnp.exp(self.amplitude * jnp.sin(turn + self.phase))


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

    def expected(self, hours: Hours, slots: int) -> FlowField:
        """Mean volumes over all places where the crowded nodes may be."""
        # Nodes are drawn without replacement: if one end of a segment is not crowded, the other end is likelier to be.
        candidates = jnp.sum(~self.spared)
        open_ends = jnp.sum(~self.spared[self.ends], axis=1)
        missed = jnp.where(open_ends >= 1, 1 - self.crowded_nodes / candidates, 1.0)
        missed *= jnp.where(open_ends == 2, 1 - self.crowded_nodes / jnp.maximum(candidates - 1, 1), 1.0)
        crowded = 1 - missed
        return self._based(self.ordinary.base * (1 - crowded) + self.mean * crowded).expected(hours, slots)

    def draw(self, key: Key[Array, ""], hours: Hours, slots: int) -> FlowField:
        """Possible futures, each with crowded nodes of its own."""
        futures = hours.shape[0]
        for_nodes, for_volumes, for_noise = jax.random.split(key, 3)
        lot = jnp.where(self.spared, jnp.inf, jax.random.uniform(for_nodes, (futures, self.spared.shape[0])))
        crowded = jnp.argsort(jnp.argsort(lot, axis=1), axis=1) < self.crowded_nodes
        volume = self.mean + self.spread * jax.random.normal(for_volumes, (futures, self.ends.shape[0]))
        base = jnp.where(crowded[:, self.ends].any(axis=-1), jnp.maximum(volume, 1.0), self.ordinary.base)
        median = jax.vmap(lambda one, hour: self._based(one).median(hour, jnp.arange(slots)))(base, hours)
        return self.ordinary.with_noise(for_noise, median)

    def ahead(self, now: Counts, hour: Scalar, slot: Index, slots: int) -> Float[Array, "slots counter"]:
        """Mean volumes from this slot on; a segment counts as crowded if its volume is nearer to the crowded one."""
        wave = self.ordinary.median(hour, slot[None])[0] / self.ordinary.base
        level = jnp.log(now / wave)
        nearer = jnp.abs(level - jnp.log(self.mean)) < jnp.abs(level - jnp.log(self.ordinary.base))
        return self._based(jnp.where(nearer, self.mean, self.ordinary.base)).ahead(now, hour, slot, slots)

    def _based(self, base: Float[Array, " segment"]) -> RushFlow:
        return eqx.tree_at(lambda flow: flow.base, self.ordinary, base)
