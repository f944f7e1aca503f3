"""How fast people walk in a crowd, and how long a segment takes to cross while the crowd changes."""

from dataclasses import replace
from typing import Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.network.spread import Spread

FREE_SPEED = 1.34  # m/s, the paper's x0 and Weidmann's mean
CrossingRule = Literal["integrated", "entry"]
CROSSING_RULES: tuple[str, ...] = get_args(CrossingRule)


class SpeedLaw(eqx.Module):
    """Walking speed as a function of density."""

    def speed(self, density: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Speed in m/s at a density in persons/m²."""
        raise NotImplementedError


class Aoki(SpeedLaw):
    """The paper's power law x = x0 ρ^-0.8 (eq. 3), of Aoki.

    It exceeds the free speed below one person per m²; ``capped`` holds it there, the paper does not.
    """

    free_speed: float = eqx.field(static=True, default=FREE_SPEED)
    exponent: float = eqx.field(static=True, default=0.8)
    capped: bool = eqx.field(static=True, default=True)

    def speed(self, density: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        factor = density**-self.exponent
        return self.free_speed * (jnp.minimum(factor, 1.0) if self.capped else factor)


class Weidmann(SpeedLaw):
    """Weidmann (1993) in Kladek's form, v = x0 (1 - exp[-1.913 (1/ρ - 1/5.4)]), never below ``floor``.

    The law itself reaches zero at the jam density of 5.4 persons/m²; the floor keeps travel times finite.
    """

    free_speed: float = eqx.field(static=True, default=FREE_SPEED)
    steepness: float = eqx.field(static=True, default=1.913)
    jam_density: float = eqx.field(static=True, default=5.4)
    floor: float = eqx.field(static=True, default=0.05)

    def speed(self, density: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        inverse = 1.0 / jnp.maximum(density, 1e-6)
        return jnp.maximum(-self.free_speed * jnp.expm1(-self.steepness * (inverse - 1 / self.jam_density)), self.floor)


DENSEST = 12.0  # persons/m²; nobody has counted more
_HALVINGS = 32  # of 0 to DENSEST: finer than single precision tells apart


def density_at_speed(law: SpeedLaw, speed: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """The lowest density in persons/m² at which people walk at a speed in m/s or slower, by bisection.

    It is 0 where the speed is that of an empty street or faster. Where the law knows no speed as low, it is the lowest
    density of the law's lowest speed up to ``DENSEST``: for Weidmann's law 4.88, where its floor begins.
    """
    each, place = np.unique(np.asarray(speed, np.float32), return_inverse=True)
    wanted = jnp.maximum(jnp.asarray(each), law.speed(jnp.float32(DENSEST)))
    low, high = jnp.zeros_like(wanted), jnp.full_like(wanted, DENSEST)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        faster = law.speed(middle) > wanted
        low, high = jnp.where(faster, middle, low), jnp.where(faster, high, middle)
    found = jnp.where(wanted >= law.speed(jnp.float32(0.0)), 0.0, high)
    return np.asarray(found)[place.reshape(np.shape(speed))]


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
        return speed, _covered(speed, self.slot_seconds)

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
    return SpeedField(speed, _covered(speed, slot_seconds), slot_seconds, density)


def _covered(speed: Float[Array, "*lead slot"], slot_seconds: float) -> Float[Array, "*lead slot"]:
    """Metres walked from clock 0 to the beginning of each slot."""
    after = jnp.cumsum(speed * slot_seconds, axis=-1)
    return jnp.concatenate([jnp.zeros_like(after[..., :1]), after[..., :-1]], axis=-1)


def crossing_time(
    field: SpeedField,
    segment: Int[Array, ""],
    length: Float[Array, ""],
    clock: Float[Array, ""],
    rule: CrossingRule = "integrated",
) -> Float[Array, ""]:
    """Seconds to cross a segment entered at ``clock``.

    ``entry`` (the paper, eq. 4) keeps the speed of the moment of entry to the end. ``integrated`` walks through the
    slots that the crossing spans, each at its own speed: whoever enters later never leaves earlier (FIFO).

    Parameters
    ----------
    field
        Speeds of one crowd (no leading axis).
    segment, length
        The segment and its length in metres.
    clock
        Seconds since the scenario's start.
    """
    return crossing_time_in(field.speed[segment], field.covered[segment], field.slot_seconds, length, clock, rule)


def crossing_time_in(
    speed: Float[Array, " slot"],
    covered: Float[Array, " slot"],
    slot_seconds: float,
    length: Float[Array, ""],
    clock: Float[Array, ""],
    rule: CrossingRule = "integrated",
) -> Float[Array, ""]:
    """:func:`crossing_time` from one segment's own row of speeds and covered distances."""
    last = speed.shape[-1] - 1
    now = jnp.clip(jnp.floor(clock / slot_seconds).astype(jnp.int32), 0, last)
    if rule == "entry":
        return length / speed[now]
    goal = covered[now] + speed[now] * (clock - now * slot_seconds) + length
    # The slot in which the goal is reached. Counting beats a binary search: it is one pass over a short row.
    then = jnp.clip(jnp.sum(covered <= goal) - 1, now, last)
    return then * slot_seconds + (goal - covered[then]) / speed[then] - clock


def exposure_in(
    density: Float[Array, "*n slot"], slot_seconds: float, begin: Float[Array, "*n"], end: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Crowd met on segments from one clock to another: the integral of their density, in person·s/m²."""
    slot = jnp.arange(density.shape[-1])
    upto = jnp.where(slot < density.shape[-1] - 1, (slot + 1) * slot_seconds, jnp.inf)
    there = jnp.minimum(end[..., None], upto) - jnp.maximum(begin[..., None], slot * slot_seconds)
    return jnp.sum(density * jnp.maximum(there, 0.0), axis=-1)


_Slots = tuple[
    Int[Array, ""], Int[Array, " segment"], Float[Array, " segment"], Float[Array, " segment"]
]  # a slot; up to it the latest that each segment is walked in, with its speed and what is covered before it


def crossing_times_at(
    speed: Float[Array, "slot segment"],
    covered: Float[Array, "slot segment"],
    slot_seconds: float,
    length: Float[Array, " segment"],
    clock: Float[Array, " segment"],
    rule: CrossingRule = "integrated",
) -> Float[Array, " segment"]:
    """:func:`crossing_time_in` of all segments at once, each entered at its own clock; slots come first.

    The same to the bit, but slot by slot for all segments instead of through the whole row of each: few slots are
    spanned, and what is known of a slot lies together in memory.
    """
    last = len(speed) - 1
    now = jnp.clip(jnp.floor(clock / slot_seconds).astype(jnp.int32), 0, last)
    first = jnp.min(now)

    def onward(carry: _Slots, goes: Bool[Array, " segment"]) -> _Slots:
        slot, *old = carry
        new = (jnp.full_like(now, slot + 1), speed[slot + 1], covered[slot + 1])
        return slot + 1, *(jnp.where(goes, *each) for each in zip(new, old, strict=True))  # type: ignore[return-value]

    # To the slot in which each segment is entered, nearly always the first one, and on to that in which it is left.
    entered = jax.lax.while_loop(
        lambda carry: carry[0] < jnp.max(now),
        lambda carry: onward(carry, carry[0] < now),
        (first, jnp.full_like(now, first), speed[first], covered[first]),
    )
    if rule == "entry":
        return length / entered[2]
    goal = entered[3] + entered[2] * (clock - now * slot_seconds) + length

    def further(slot: Int[Array, ""]) -> Bool[Array, " segment"]:
        return covered[jnp.minimum(slot + 1, last)] <= goal

    _, then, at, before = jax.lax.while_loop(
        lambda carry: (carry[0] < last) & further(carry[0]).any(),
        lambda carry: onward(carry, further(carry[0])),
        (first, *entered[1:]),
    )
    return then * slot_seconds + (goal - before) / at - clock


def leaving_clock(
    speeds: Speeds,
    crowd: Int[Array, ""],
    segment: Int[Array, ""],
    length: Float[Array, ""],
    clock: Float[Array, ""],
    rule: CrossingRule = "integrated",
) -> Float[Array, ""]:
    """Clock at the end of a segment that is entered at ``clock``, through one of several crowds.

    The same as :func:`crossing_time` later, but only those slots are looked at that the crossing spans: nearly always
    one or two of them.
    """
    last, slot_seconds = speeds.slots - 1, speeds.slot_seconds
    slot = jnp.clip(jnp.floor(clock / slot_seconds).astype(jnp.int32), 0, last)
    if rule == "entry":
        return clock + length / speeds.at(crowd, segment, slot)

    def walk(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        slot, now, left, _ = carry
        speed = speeds.at(crowd, segment, slot)
        ends = jnp.where(slot == last, jnp.inf, (slot + 1) * slot_seconds)
        ahead = speed * (ends - now)
        over = left <= ahead
        return slot + 1, jnp.where(over, now + left / speed, ends), left - ahead, over

    start = (slot, clock, length, jnp.bool_(False))
    _, left_at, _, _ = jax.lax.while_loop(lambda carry: ~carry[3], walk, start)
    return left_at
