"""Walking speeds on every segment in every slot: as a table, or worked out from counters where they are needed."""

import math
from dataclasses import replace
from typing import Any, ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.crowds.base import Field, FlowField, Index, SensedField
from sidestep.network.graph import RoadNetwork
from sidestep.walking.sightings import Sightings
from sidestep.walking.speed_laws import SpeedLaw

Segments = Int[Array, "*n"]
Numbers = Float[Array, "*n"]
Table = Float[Array, "*future_segment slot"]


class SpeedField(eqx.Module):
    """Walking speed on every segment in every slot, and how far one gets in them. The last slot lasts for ever.

    Leading axes, if any, count futures; the speeds of a single segment (:class:`SpeedRow`) may have none.
    """

    interpolated: ClassVar[Literal[False]] = False
    """Whether speeds follow from the densities at a few counters."""
    expected: ClassVar[Literal[False]] = False
    """Whether these are expected times (:class:`sidestep.walking.expected_times.ExpectedTimes`)."""
    known_until: ClassVar[float] = math.inf
    """Clock in s before which speeds are known."""
    sightings: ClassVar[None] = None
    """Crowds that were seen but are not counted. Those of a table are counted: counters are everywhere."""

    speed: Table
    """Walking speed in m/s."""
    covered: Table
    """Metres walked on the segment from clock 0 to the slot's beginning."""
    slot_seconds: float = eqx.field(static=True)
    """Length of a slot in s."""
    density: Table | None = None
    """Persons/m²; None where they were not kept."""

    @property
    def keeps_density(self) -> bool:
        """Whether densities are known."""
        return self.density is not None

    @property
    def slots(self) -> int:
        """Number of slots."""
        return self.speed.shape[-1]

    @property
    def count(self) -> int:
        """Number of futures."""
        return self.speed.shape[0]

    @property
    def known_density(self) -> Table:
        """Densities.

        Returns
        -------
        density
            Persons/m².

        Raises
        ------
        ValueError
            Speeds that were made without them.
        """
        if self.density is None:
            raise ValueError("these speeds were made without their densities")
        return self.density

    def of(self, future: Index) -> "SpeedField":
        """Speeds on all segments in one of the futures."""
        return jax.tree.map(lambda leaf: leaf[future], self)

    def row(self, *where: Index) -> "SpeedRow":
        """Speeds on one segment in one of the futures; ``where`` are the numbers of those axes that there are."""
        return SpeedRow(self, where)

    def at(self, future: Index, segment: Segments, slot: Index) -> Numbers:
        """Speeds in m/s on segments in a slot of one of the futures."""
        return self.speed[future, segment, slot]

    def density_at(self, future: Index, segment: Segments, slot: Index) -> Numbers:
        """Densities in persons/m² on segments in a slot of one of the futures."""
        return self.known_density[future, segment, slot]

    def first(self, slots: int) -> "SpeedField":
        """The same in the first slots."""
        return jax.tree.map(lambda leaf: leaf[..., :slots], self)

    def taken(self, index: Int[Array, " taken"]) -> "SpeedField":
        """The futures of these numbers, in this order."""
        return jax.tree.map(lambda leaf: leaf[index], self)

    def replaced(self, speeds: Any, index: Int[Array, " new"]) -> "SpeedField":
        """The same with the futures of these numbers replaced by those of other, similar ``speeds``."""
        return jax.tree.map(lambda old, new: old.at[index].set(new), self, speeds)

    def seeing(self, sightings: Sightings, law: SpeedLaw, pace: Float[Array, " segment"] | None) -> "SpeedField":
        """The same where some crowds were seen.

        Parameters
        ----------
        sightings
            What was seen.
        law, pace
            Speed by density, and that on each segment over that on level ground.

        Returns
        -------
        SpeedField
            With densities.
        """
        density = sightings.among(self.known_density)
        seen = _paced(law.speed(density), None if pace is None else pace[:, None])
        speed = jnp.where(sightings.share[:, : self.slots] > 0, seen, self.speed)
        return speed_field(speed, self.slot_seconds, density)

    def field(self, network: RoadNetwork) -> FlowField:
        """The crowds that :func:`walking_speeds` made these speeds from."""
        volume = jnp.swapaxes(self.known_density, -1, -2) * network.length * network.width
        return FlowField(volume, self.slot_seconds)


class SpeedRow(eqx.Module):
    """Walking speed on one segment in every slot.

    Numbers are looked up where they are needed: to copy the whole row for every walker takes longer than all the rest
    of a step.
    """

    expected: ClassVar[Literal[False]] = False

    field: SpeedField
    where: tuple[Index, ...]
    """The future and the segment, as far as ``field`` has these axes."""

    @property
    def slots(self) -> int:
        return self.field.slots

    @property
    def slot_seconds(self) -> float:
        return self.field.slot_seconds

    @property
    def known_density(self) -> Float[Array, " slot"]:
        return self.field.known_density[self.where]

    def speed(self, slot: Int[Array, "*n"]) -> Numbers:
        """Speeds in m/s in slots."""
        return self.field.speed[(*self.where, slot)]

    def covered(self, slot: Int[Array, "*n"]) -> Numbers:
        """Metres walked from clock 0 to the beginnings of slots."""
        return self.field.covered[(*self.where, slot)]

    def covered_from(self, slot: Index, slots: int) -> Float[Array, " slot"]:
        """The same for so many slots, from one on."""
        size = (*(1 for _ in self.where), slots)
        return jax.lax.dynamic_slice(self.field.covered, (*self.where, slot), size).reshape(slots)


class SensedSpeeds(eqx.Module):
    """Walking speeds that follow from the densities at counters, worked out where they are needed.

    The same as a :class:`SpeedField` with a leading axis of futures, but memory grows with counters, not with segments.
    """

    interpolated: ClassVar[Literal[True]] = True
    expected: ClassVar[Literal[False]] = False
    known_until: ClassVar[float] = math.inf
    keeps_density: ClassVar[bool] = True

    crowds: SensedField
    """Densities at the counters, with a leading axis of futures."""
    law: SpeedLaw
    """Speed by density."""
    pace: Float[Array, " segment"] | None = None
    """As in :class:`sidestep.network.graph.RoadNetwork`."""
    sightings: Sightings | None = None
    """Crowds that were seen, whatever counters say; None where there were none."""

    @property
    def slot_seconds(self) -> float:
        return self.crowds.slot_seconds

    @property
    def slots(self) -> int:
        return self.crowds.counted.shape[1]

    @property
    def count(self) -> int:
        return self.crowds.counted.shape[0]

    def of(self, future: Index) -> SpeedField:
        density = self.crowds.weights.everywhere(self.crowds.counted[future])
        if self.sightings is not None:
            density = self.sightings.among(density.T).T
        return speed_field(_paced(self.law.speed(density), self.pace).T, self.slot_seconds, density.T)

    def row(self, future: Index, segment: Index) -> SpeedRow:
        density = self.crowds.densities(future, segment)
        if self.sightings is not None:
            density = self.sightings.of(segment).among(density)
        return speed_field(self.on(segment, density), self.slot_seconds, density).row()

    def at(self, future: Index, segment: Segments, slot: Index) -> Numbers:
        return self.on(segment, self.density_at(future, segment, slot))

    def density_at(self, future: Index, segment: Segments, slot: Index) -> Numbers:
        density = self.crowds.density_at(future, segment, slot)
        return density if self.sightings is None else self.sightings.at(segment, slot, density)

    def first(self, slots: int) -> "SensedSpeeds":
        return self._of(self.crowds.counted[:, :slots])

    def taken(self, index: Int[Array, " taken"]) -> "SensedSpeeds":
        return self._of(self.crowds.counted[index])

    def replaced(self, speeds: Any, index: Int[Array, " new"]) -> "SensedSpeeds":
        return self._of(self.crowds.counted.at[index].set(speeds.crowds.counted))

    def scaled(self, factor: float) -> "SensedSpeeds":
        """Speeds in crowds ``factor`` times as dense."""
        return self._of(factor * self.crowds.counted)

    def seeing(self, sightings: Sightings, _law: SpeedLaw, _pace: Float[Array, " segment"] | None) -> "SensedSpeeds":
        """The same where some crowds were seen; counters know nothing of these."""
        return replace(self, sightings=sightings)

    def field(self, _network: RoadNetwork) -> SensedField:
        return self.crowds

    def _of(self, counted: Float[Array, "future slot sensor"]) -> "SensedSpeeds":
        return replace(self, crowds=replace(self.crowds, counted=counted))

    def on(self, segment: Int[Array, "*m"], density: Float[Array, "*n"]) -> Numbers:
        """Speeds in m/s on segments at densities in persons/m²."""
        return _paced(self.law.speed(density), None if self.pace is None else self.pace[segment])


KnownSpeeds = SpeedField | SensedSpeeds
"""Type checkers tell the two apart by ``interpolated``; both have the methods of :class:`SpeedField`."""


def walking_speeds(network: RoadNetwork, crowds: Field, law: SpeedLaw, *, densities: bool = False) -> KnownSpeeds:
    """Speeds on every segment in crowds with a leading axis of futures.

    Parameters
    ----------
    network, crowds
        Streets, and the people on them.
    law
        Speed by density.
    densities
        Whether densities are kept beside speeds; where crowds are interpolated they always are.

    Returns
    -------
    speeds
        A table, or speeds computed from the counters on demand.
    """
    if crowds.interpolated:
        return SensedSpeeds(crowds, law, network.pace)
    return dense_speeds(network, crowds, law, densities=densities)


def dense_speeds(network: RoadNetwork, crowds: Field, law: SpeedLaw, *, densities: bool = False) -> SpeedField:
    """The same, worked out on all segments; crowds may have any leading axes, or none."""
    density = crowds.density(network)
    speed = jnp.swapaxes(_paced(law.speed(density), network.pace), -1, -2)
    return speed_field(speed, crowds.slot_seconds, jnp.swapaxes(density, -1, -2) if densities else None)


def _paced(speed: Float[Array, "*n"], pace: Float[Array, "*m"] | None) -> Float[Array, "*n"]:
    """Speeds in m/s at some pace; not multiplied by 1, so that level streets compile as if there were no paces."""
    return speed if pace is None else speed * pace


def speed_field(speed: Table, slot_seconds: float, density: Table | None = None) -> SpeedField:
    """Prepare speeds (m/s, positive) for crossing times; ``slot_seconds`` is the length of a slot."""
    after = jnp.cumsum(speed * slot_seconds, axis=-1)
    covered = jnp.concatenate([jnp.zeros_like(after[..., :1]), after[..., :-1]], axis=-1)
    return SpeedField(speed, covered, slot_seconds, density)
