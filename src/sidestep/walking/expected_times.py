"""Times to cross segments that may be expected beforehand: means over many futures.

The time in the mean crowd is not the mean time: streets that jam in some of the futures take longer than it says.
"""

import math
from dataclasses import replace
from typing import Any, ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sidestep.crowds.base import Field, Index
from sidestep.network.graph import RoadNetwork
from sidestep.walking.sightings import Sightings
from sidestep.walking.speed_field import KnownSpeeds, Numbers, Segments, SpeedField, SpeedRow, Table
from sidestep.walking.speed_laws import SpeedLaw


class CrossingTimes(eqx.Module):
    """Expected times to cross all segments, or a single one.

    Times are known for entering as steps begin, linear in between, and constant from the last step on. So nobody who
    enters later leaves earlier (FIFO) where that is true of each of the futures.
    """

    expected: ClassVar[Literal[True]] = True

    seconds: Float[Array, "*segment step"]
    """Time to cross, in s."""
    step_seconds: float = eqx.field(static=True)
    """Length of a step in s."""
    mean: SpeedField
    """In the mean crowd, whose densities count."""
    where: tuple[Index, ...] = ()
    """Which segment a single one is, as in :class:`sidestep.walking.speed_field.SpeedRow`."""

    @property
    def slot_seconds(self) -> float:
        return self.mean.slot_seconds

    @property
    def slots(self) -> int:
        return self.mean.slots

    @property
    def known_density(self) -> Table:
        return self.mean.known_density[self.where]

    def row(self, segment: Index) -> "CrossingTimes":
        """Times to cross one of the segments."""
        return CrossingTimes(self.seconds[segment], self.step_seconds, self.mean, (segment,))

    def at(self, clock: Numbers) -> Numbers:
        """Seconds to cross each segment, entered at its own clock in s, or at the same."""
        every = () if self.seconds.ndim == 1 else (jnp.arange(len(self.seconds)),)
        return _linear(self.seconds, every, clock / self.step_seconds)


class ExpectedTimes(eqx.Module):
    """Expected times to cross every segment at each hour at which people set out.

    The same methods as of :class:`sidestep.walking.speed_field.SpeedField`, with hours for futures: crowds are the mean
    ones, and speeds those of the expected times.
    """

    expected: ClassVar[Literal[True]] = True

    mean: KnownSpeeds
    """In the mean crowds."""
    seconds: Float[Array, "hour segment step"]
    """Time to cross in s, as in :class:`CrossingTimes`; NaN where it was not worked out."""
    length: Float[Array, " segment"]
    """Length of the segments in m."""
    step_seconds: float = eqx.field(static=True)
    """Length of a step in s."""

    @property
    def interpolated(self) -> bool:
        return self.mean.interpolated

    @property
    def keeps_density(self) -> bool:
        return self.mean.keeps_density

    @property
    def slot_seconds(self) -> float:
        return self.mean.slot_seconds

    @property
    def slots(self) -> int:
        return self.mean.slots

    @property
    def sightings(self) -> Sightings | None:
        return self.mean.sightings

    @property
    def count(self) -> int:
        """Number of hours."""
        return self.seconds.shape[0]

    @property
    def known_until(self) -> float:
        """Clock in s before which all times are known; infinite where all are."""
        unknown = np.isnan(self.seconds).any(axis=(0, 1))
        return (int(unknown.argmax()) - 1) * self.step_seconds if unknown.any() else math.inf

    def of(self, hour: Index) -> CrossingTimes:
        """Times to cross all segments."""
        return CrossingTimes(self.seconds[hour], self.step_seconds, self.mean.of(hour))

    def row(self, hour: Index, segment: Index) -> CrossingTimes:
        """Times to cross one segment."""
        mean = self.mean.row(hour, segment)
        return CrossingTimes(self.seconds[hour, segment], self.step_seconds, mean.field, mean.where)

    def leaving(self, hour: Index, segment: Index, clock: Float[Array, ""]) -> Float[Array, ""]:
        """Clock at which a segment is left that is entered at a clock, in s."""
        return clock + _linear(self.seconds, (hour, segment), clock / self.step_seconds)

    def at(self, hour: Index, segment: Segments, slot: Index) -> Numbers:
        """Speeds in m/s of the expected times."""
        return self.length[segment] / _linear(
            self.seconds, (hour, segment), slot * (self.slot_seconds / self.step_seconds)
        )

    def density_at(self, hour: Index, segment: Segments, slot: Index) -> Numbers:
        return self.mean.density_at(hour, segment, slot)

    def seeing(self, sightings: Sightings, law: SpeedLaw, pace: Float[Array, " segment"] | None) -> "ExpectedTimes":
        """The same where some crowds were seen.

        Parameters
        ----------
        sightings
            What was seen.
        law, pace
            Speed by density, and that on each segment over that on level ground.

        Returns
        -------
        ExpectedTimes
            Times for entering as slots begin. Where a crowd was seen, nobody who enters later leaves earlier, while it
            is forgotten as well.
        """
        slot_seconds, share = self.slot_seconds, sightings.share
        position = jnp.arange(self.slots) * (slot_seconds / self.step_seconds)
        seen = law.speed(sightings.density) * (1.0 if pace is None else pace)

        def of_segment(times: Float[Array, " step"], length: Array, seen: Array, share: Float[Array, " slot"]) -> Array:
            usual = _linear(times, (), position)
            # Seconds for each metre are mixed, as expected times are means. Then walkers go through slot after slot.
            speed = 1 / ((1 - share) * usual / length + share / seen)
            covered = jnp.append(0.0, jnp.cumsum(slot_seconds * speed[:-1]))
            end = covered + length
            then = jnp.searchsorted(covered, end, side="right") - 1
            leaves = then * slot_seconds + (end - covered[then]) / speed[then]
            return jnp.where(share.any(), leaves - jnp.arange(self.slots) * slot_seconds, usual)

        def of_hour(seconds: Float[Array, "segment step"]) -> Float[Array, "segment slot"]:
            return jax.vmap(of_segment)(seconds, self.length, seen, share)

        mean = self.mean.seeing(sightings, law, pace)
        return ExpectedTimes(mean, jax.vmap(of_hour)(self.seconds), self.length, slot_seconds)

    def first(self, slots: int) -> "ExpectedTimes":
        """The same with densities in the first slots only."""
        return replace(self, mean=self.mean.first(slots))

    def taken(self, index: Int[Array, " taken"]) -> "ExpectedTimes":
        """The hours of these numbers, in this order."""
        return ExpectedTimes(self.mean.taken(index), self.seconds[index], self.length, self.step_seconds)

    def replaced(self, times: Any, index: Int[Array, " new"]) -> "ExpectedTimes":
        """The same with the hours of these numbers replaced by those of other ``times``."""
        seconds = self.seconds.at[index].set(times.seconds)
        return ExpectedTimes(self.mean.replaced(times.mean, index), seconds, self.length, self.step_seconds)

    def field(self, network: RoadNetwork) -> Field:
        return self.mean.field(network)


Speeds = KnownSpeeds | ExpectedTimes
"""Speeds in futures, or expected times; type checkers tell them apart by ``expected``."""

SpeedsOrTimes = SpeedField | CrossingTimes
"""The same of one future, or at one hour."""

RowOrTimes = SpeedRow | CrossingTimes
"""The same on one segment."""


def _linear(table: Float[Array, "*lead step"], where: tuple[Array, ...], position: Float[Array, "*m"]) -> Numbers:
    """Numbers of a table at positions between its steps; before the first and after the last they stay as they are."""
    last = table.shape[-1] - 1
    position = jnp.clip(position, 0.0, last)
    step = jnp.floor(position).astype(jnp.int32)
    part = position - step
    return (1 - part) * table[(*where, step)] + part * table[(*where, jnp.minimum(step + 1, last))]
