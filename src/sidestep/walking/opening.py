"""Waiting before streets that are shut at times, such as parks at night, until they open.

The clock at entry decides: who comes in time walks to the end. Who begins a walk in the middle of a street waits there:
nobody knows where along it the gate is. Nobody who comes later leaves earlier (FIFO), since everybody who waits leaves
as the street opens. Waits are exact to the second: opening times are known by the minute.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int16

from sidestep.network.opening_hours import WEEK, OpenMinutes, open_minutes
from sidestep.walking.waits import HOUR, Clocks, NoWaits, Scalar, Segments, Waits

MINUTE = 60
ALWAYS = 0
"""The timetable of what is always open."""


@dataclass(frozen=True)
class Timetables:
    """Gates for searches on the host: :meth:`OpeningTimes.until_open` of one segment at a time."""

    opens_in: list[list[int]]
    """Of each timetable, minutes from each minute of the week to the next one that is open."""
    of_segment: dict[int, int]
    """Which of these each segment has that is shut at times; others are always open."""

    def until_open(self, hour: float, segment: int, clock: float) -> float:
        """Time until a segment opens.

        Parameters
        ----------
        hour
            Hour of the week at clock 0, to the second.
        segment, clock
            Where and when a walker comes.

        Returns
        -------
        float
            Seconds, 0 where the segment is open.
        """
        timetable = self.of_segment.get(segment)
        if timetable is None:
            return 0.0
        second, part = divmod(round(hour * HOUR) + clock, 1.0)
        minutes = self.opens_in[timetable][int(second) // MINUTE % WEEK]
        return minutes * MINUTE - second % MINUTE - part if minutes > 0 else 0.0


class OpeningTimes(eqx.Module):
    """What keeps walkers waiting before streets that are not always open: first the gate, and then the traffic."""

    gates: ClassVar[bool] = True
    jumps: ClassVar[bool] = True

    opens_in: Int16[Array, "timetable 10080"]
    """Minutes from each minute of the week, from Monday 0:00, to the next one that is open; 0 in those that are."""
    timetable: Int[Array, " segment"]
    """Which of these each segment has."""
    traffic: Waits | NoWaits
    """What walkers wait for where the street is open."""
    inside: Int[Array, " segment"] | None = None
    """Those of the street of each piece; None where no streets are split."""

    def until_open(self, hour: Scalar, segment: Segments, clock: Clocks) -> Clocks:
        """Time until segments open.

        Parameters
        ----------
        hour
            Hour of the week at clock 0, to the second.
        segment, clock
            Where and when walkers come.

        Returns
        -------
        seconds
            0 where the segment is open.
        """
        whole = jnp.floor(clock)  # in whole numbers, since single precision has no week to the second
        second = jnp.round(hour * HOUR).astype(jnp.int32) + whole.astype(jnp.int32)
        minutes = self.opens_in[self.timetable[segment], second // MINUTE % WEEK].astype(jnp.int32)
        seconds = (minutes * MINUTE - second % MINUTE).astype(float) - (clock - whole)
        return jnp.where(minutes > 0, seconds, 0.0)

    def timetables(self) -> "Timetables":
        """The same for plain numbers, one at a time."""
        opens_in, timetable = np.asarray(self.opens_in), np.asarray(self.timetable)
        sometimes = np.flatnonzero(opens_in.any(axis=1))
        gated = np.flatnonzero(np.isin(timetable, sometimes)).tolist()
        return Timetables([row.tolist() for row in opens_in], {segment: int(timetable[segment]) for segment in gated})

    def seconds(self, hour: Scalar, phase: Scalar, segment: Segments, clock: Clocks) -> Clocks:
        """Wait before segments: see :meth:`sidestep.walking.waits.Waits.seconds`."""
        shut = self.until_open(hour, segment, clock)
        return shut + self.traffic.seconds(hour, phase, segment, clock + shut)

    def averaged(self) -> "OpeningTimes":
        """The same with all lights at their mean wait."""
        return replace(self, traffic=self.traffic.averaged())

    def on_pieces(self, parent: Int[Array, " piece"], first: Bool[Array, " piece"]) -> "OpeningTimes":
        """The same on pieces of the segments; only the first piece of each has a gate, or walks would wait twice."""
        inside = self.timetable[parent]
        timetable, traffic = jnp.where(first, inside, ALWAYS), self.traffic.on_pieces(parent, first)
        return replace(self, timetable=timetable, inside=inside, traffic=traffic)

    def begun_on(self, segments: Bool[np.ndarray, " segment"]) -> "OpeningTimes":
        """The same for walks that begin where these segments do: each of them has a gate."""
        if self.inside is None:
            return self
        return replace(self, timetable=jnp.where(segments, self.inside, self.timetable))

    def with_fixed(self, seconds: Float[Array, " segment"]) -> "OpeningTimes":
        """The same with so many seconds more before segments, always."""
        return replace(self, traffic=self.traffic.with_fixed(seconds))


AnyWaits = OpeningTimes | Waits | NoWaits
"""All have the methods of :class:`sidestep.walking.waits.NoWaits`."""


def with_opening_times(traffic: Waits | NoWaits, opening: Sequence[str]) -> AnyWaits:
    """Add gates to what walkers wait for.

    Parameters
    ----------
    traffic
        The waits on streets that are open.
    opening
        When each segment is open, as in a `sidestep.network.town.Town`.

    Returns
    -------
    AnyWaits
        ``traffic`` itself where everything is always open.
    """
    timetables = {text: number for number, text in enumerate(dict.fromkeys(["", *opening]))}
    if len(timetables) == 1:
        return traffic
    opens_in = np.stack([_minutes_to_open(np.asarray(open_minutes(text))) for text in timetables])
    return OpeningTimes(jnp.asarray(opens_in), jnp.asarray([timetables[text] for text in opening]), traffic)


def _minutes_to_open(opened: OpenMinutes) -> Int16[np.ndarray, "10080"]:
    """Minutes to the next open one; a whole week where there is none."""
    every = np.arange(WEEK)
    begins = np.flatnonzero(opened)
    if not len(begins):
        return np.full(WEEK, WEEK, np.int16)
    following = np.append(begins, begins[0] + WEEK)
    return (following[np.searchsorted(begins, every)] - every).astype(np.int16)
