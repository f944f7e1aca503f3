"""How long a segment takes to cross while the crowd on it changes, and how much of that crowd is met."""

from collections.abc import Callable
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sidestep.crowds.base import Index, Scalar
from sidestep.walking.expected_times import RowOrTimes, Speeds, SpeedsOrTimes
from sidestep.walking.speed_field import KnownSpeeds, Numbers, SensedSpeeds, SpeedRow

CrossingRule = Literal["integrated", "entry"]
"""``entry`` (the paper, eq. 4) keeps the speed at entry to the end; ``integrated`` walks through the slots that the
crossing spans, each at its own speed, so that nobody who enters later leaves earlier (FIFO)."""

BySegment = Float[Array, " segment"]
SlotBySlot = Float[Array, "slot segment"]

WINDOW = 8
"""Slots that are looked at together for the one in which a crossing ends; they lie together in memory."""


def slot_at(clock: Numbers, slot_seconds: float, slots: int) -> Int[Array, "*n"]:
    """The slots that clocks in s lie in; the last slot lasts for ever."""
    return jnp.clip(jnp.floor(clock / slot_seconds).astype(jnp.int32), 0, slots - 1)


def crossing_time(segment: RowOrTimes, length: Scalar, clock: Scalar, rule: CrossingRule = "integrated") -> Scalar:
    """Time to cross a segment.

    Parameters
    ----------
    segment
        Speeds on this segment alone, or its expected times, which hold for its length and rule.
    length
        Its length in m.
    clock
        When it is entered, in s since the scenario's start.
    rule
        How speeds that change during the crossing count.

    Returns
    -------
    seconds
        From entering to leaving.
    """
    if segment.expected:
        return segment.at(clock)
    slot_seconds = segment.slot_seconds
    now = slot_at(clock, slot_seconds, segment.slots)
    if rule == "entry":
        return length / segment.speed(now)
    end = segment.covered(now) + segment.speed(now) * (clock - now * slot_seconds) + length
    then = _slot_of_end(segment, now, end)
    return then * slot_seconds + (end - segment.covered(then)) / segment.speed(then) - clock


def _slot_of_end(segment: SpeedRow, now: Index, end: Scalar) -> Index:
    """The slot in which a walker who enters in slot ``now`` has covered as many metres as at the segment's end."""
    last = segment.slots - 1
    width = min(WINDOW, segment.slots)

    def further(carry: tuple[Index, Bool[Array, ""]]) -> tuple[Index, Bool[Array, ""]]:
        first = jnp.minimum(carry[0] + 1, segment.slots - width)
        reached = first - 1 + jnp.sum(segment.covered_from(first, width) <= end, dtype=jnp.int32)
        # Who covers all slots of a window may get beyond it. Rounding takes nobody back before the entry.
        return jnp.maximum(reached, now), (reached == first - 1 + width) & (reached < last)

    # One window nearly always, but those who walk side by side wait for the slowest.
    return jax.lax.while_loop(lambda carry: carry[1], further, (now, jnp.bool_(True)))[0]


def exposure(density: Float[Array, "*n slot"], slot_seconds: float, begin: Numbers, end: Numbers) -> Numbers:
    """Crowd met on segments from one clock to another: the integral of their density, in person·s/m²."""
    slot = jnp.arange(density.shape[-1])
    upto = jnp.where(slot < density.shape[-1] - 1, (slot + 1) * slot_seconds, jnp.inf)
    there = jnp.minimum(end[..., None], upto) - jnp.maximum(begin[..., None], slot * slot_seconds)
    return jnp.sum(density * jnp.maximum(there, 0.0), axis=-1)


_Slots = tuple[Index, Int[Array, " segment"], BySegment, BySegment]
"""A slot; up to it the latest that each segment is walked in, with its speed and the metres covered before it."""


def crossing_times(
    speed: SlotBySlot, covered: SlotBySlot, slot_seconds: float, length: BySegment, clock: BySegment, rule: CrossingRule
) -> BySegment:
    """:func:`crossing_time` of all segments at once, each entered at its own clock; slots come first.

    The same to the bit, but slot by slot for all segments instead of through the whole row of each: few slots are
    spanned, and the numbers of a slot lie together in memory.

    Parameters
    ----------
    speed, covered, slot_seconds
        As in a :class:`SpeedField`.
    length, clock
        Length in m of each segment, and when it is entered, in s since the scenario's start.
    rule
        How speeds that change during the crossing count.

    Returns
    -------
    seconds
        From entering to leaving each.
    """
    now, last = slot_at(clock, slot_seconds, len(speed)), len(speed) - 1
    first = jnp.min(now)

    def further(start: _Slots, goes: Callable[[Index], Bool[Array, " segment"]]) -> _Slots:
        """Go on from slot to slot as long as any segment ``goes``; those that do not keep what they have."""

        def onward(carry: _Slots) -> _Slots:
            slot, *old = carry
            new = (jnp.full_like(now, slot + 1), speed[slot + 1], covered[slot + 1])
            kept = (jnp.where(goes(slot), *each) for each in zip(new, old, strict=True))
            return slot + 1, *kept  # type: ignore[return-value]

        return jax.lax.while_loop(lambda carry: (carry[0] < last) & goes(carry[0]).any(), onward, start)

    # To the slot in which each segment is entered, nearly always the first one, and on to that in which it is left.
    entered = further((first, jnp.full_like(now, first), speed[first], covered[first]), lambda slot: slot < now)
    if rule == "entry":
        return length / entered[2]
    end = entered[3] + entered[2] * (clock - now * slot_seconds) + length
    _, then, at, before = further((first, *entered[1:]), lambda slot: covered[jnp.minimum(slot + 1, last)] <= end)
    return then * slot_seconds + (end - before) / at - clock


def leaving_clock(
    speeds: Speeds, future: Index, segment: Index, length: Scalar, clock: Scalar, rule: CrossingRule = "integrated"
) -> Scalar:
    """Clock at the end of a segment that is entered at ``clock``, in one of several futures.

    The same as :func:`crossing_time` later, but it looks only at the slots that the crossing spans, nearly always one
    or two of them.

    Parameters
    ----------
    speeds, future, segment
        Speeds, and which of them count.
    length, clock
        Length of the segment in m, and when it is entered, in s since the scenario's start.
    rule
        How speeds that change during the crossing count.

    Returns
    -------
    clock
        In s since the scenario's start.
    """
    if speeds.expected:
        return speeds.leaving(future, segment, clock)
    last, slot_seconds = speeds.slots - 1, speeds.slot_seconds
    slot = slot_at(clock, slot_seconds, speeds.slots)
    if rule == "entry":
        return clock + length / speeds.at(future, segment, slot)

    def walk(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        slot, now, left, _ = carry
        speed = speeds.at(future, segment, slot)
        ends = jnp.where(slot == last, jnp.inf, (slot + 1) * slot_seconds)
        ahead = speed * (ends - now)
        over = left <= ahead
        return slot + 1, jnp.where(over, now + left / speed, ends), left - ahead, over

    start = (slot, clock, length, jnp.bool_(False))
    return jax.lax.while_loop(lambda carry: ~carry[3], walk, start)[1]


Crosser = Callable[[BySegment], BySegment]
"""Seconds to cross all segments, each entered at its own clock in s."""


def crosser(times: SpeedsOrTimes, length: BySegment, rule: CrossingRule) -> Crosser:
    """Prepare for crossing all segments at many clocks: :func:`crossing_times`, or the expected ones."""
    if times.expected:
        return times.at
    speed, covered = times.speed.T, times.covered.T  # not at every clock anew
    return lambda clock: crossing_times(speed, covered, times.slot_seconds, length, clock, rule)


def mean_crossing_times(
    speeds: KnownSpeeds, length: BySegment, rule: CrossingRule, every: int, steps: int | None = None
) -> Float[Array, "segment step"]:
    """Mean times to cross segments in several futures.

    Parameters
    ----------
    speeds
        In the futures.
    length, rule
        As in :func:`crossing_times`.
    every
        Slots in a step.
    steps
        How many there are, if more slots follow than those of the speeds, which are no longer taken to last for ever
        in the last one.

    Returns
    -------
    Float[Array, "segment step"]
        Seconds, entered as each step begins; NaN where speeds of slots that follow may matter. Crowds between counters
        change slowly: there, segments are taken at the speeds as they are entered.
    """
    if speeds.interpolated:
        return _mean_between_counters(speeds, length, jnp.arange(0, speeds.slots, every))

    def of_segment(segment: Index) -> Float[Array, " step"]:
        speed, covered = speeds.speed[:, segment], speeds.covered[:, segment]
        times = _times_from(speeds.slot_seconds, length[segment], rule, every, speed, covered)
        if steps is not None:
            left = jnp.arange(times.shape[1]) * (every * speeds.slot_seconds) + times
            times = jnp.where(left < (speeds.slots - 1) * speeds.slot_seconds, times, jnp.nan)
            # As wide as with all slots: XLA would add up the futures of fewer steps in another order.
            times = jnp.pad(times, ((0, 0), (0, steps - times.shape[1])), constant_values=jnp.nan)
        return jnp.mean(times, axis=0)

    return jax.lax.map(of_segment, jnp.arange(len(length)))


def _mean_between_counters(
    speeds: SensedSpeeds, length: BySegment, steps: Int[Array, " step"]
) -> Float[Array, "segment step"]:
    weights, segment = speeds.crowds.weights, jnp.arange(len(length))

    def entered(slot: Index) -> BySegment:
        counted = speeds.crowds.counted[:, slot].T  # futures last: those of one counter lie together in memory
        density: Array = jnp.zeros((len(length), speeds.count))
        for near in range(weights.sensor.shape[1]):
            density += weights.weight[:, near, None] * counted[weights.sensor[:, near]]
        return length * jnp.mean(1 / speeds.on(segment[:, None], density), axis=1)

    return jax.lax.map(entered, steps).T


def _times_from(
    slot_seconds: float,
    length: Scalar,
    rule: CrossingRule,
    every: int,
    speed: Float[Array, "future slot"],
    covered: Float[Array, "future slot"],
) -> Float[Array, "future step"]:
    """:func:`crossing_time` of one segment in several futures, entered as each step of so many slots begins."""
    # Few slots are spanned: to look at one after the other for all steps takes a third of searching each step's own.
    slots = speed.shape[1]
    if rule == "entry":
        return length / speed[:, jnp.arange(0, slots, every)]
    end = covered[:, ::every] + length
    # The last slot lasts for ever: nobody reaches another.
    speed_after, covered_after = (
        jnp.concatenate([each, jnp.full_like(each, jnp.inf)], axis=1) for each in (speed, covered)
    )

    def later(each: Float[Array, "future slots"], by: Index) -> Float[Array, "future step"]:
        return jax.lax.dynamic_slice_in_dim(each, by, slots, axis=1)[:, ::every]

    def further(carry: tuple[Index, Bool[Array, ""], Array, Array, Array]) -> tuple[Index, Array, Array, Array, Array]:
        by, _, spanned, at, before = carry
        reached = later(covered_after, by) <= end
        at = jnp.where(reached, later(speed_after, by), at)
        before = jnp.where(reached, later(covered_after, by), before)
        return by + 1, reached.any(), spanned + reached, at, before

    start = (jnp.int32(1), jnp.bool_(True), jnp.zeros(end.shape, jnp.int32), speed[:, ::every], covered[:, ::every])
    _, _, spanned, at, before = jax.lax.while_loop(lambda carry: carry[1] & (carry[0] < slots), further, start)
    return spanned * slot_seconds + (end - before) / at
