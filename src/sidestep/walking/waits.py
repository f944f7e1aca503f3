"""Waiting before streets that cross traffic: at lights, and for gaps between vehicles.

Nobody who comes later leaves earlier (FIFO): at a light everybody who waits leaves as it turns green, and the wait for
a gap changes by less than a second from one second to the next.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

HOUR, DAY_HOURS = 3600.0, 24
GOLDEN = (math.sqrt(5) - 1) / 2
"""Multiples of it, less their whole part, spread evenly over 0 to 1."""

Scalar = Float[Array, ""]
Segments = Int[Array, "*n"]
Clocks = Float[Array, "*n"]
Wait = Callable[[Segments, Clocks], Clocks]
"""Seconds that walkers wait before segments, by the clocks at which they come there."""


def gap_delay(vehicles: Float[Array, "*n"], critical_gap: float) -> Float[Array, "*n"]:
    """Mean wait for a gap between vehicles that come at random.

    Parameters
    ----------
    vehicles
        Vehicles a second.
    critical_gap
        The gap that walkers need, in s.

    Returns
    -------
    seconds
        The mean wait.

    References
    ----------
    Adams (1936), Road traffic considered as a random series.
    """
    rate = jnp.maximum(vehicles, 1e-6)  # fewer are none
    return (jnp.expm1(rate * critical_gap) - rate * critical_gap) / rate


def light_phases(futures: int) -> Float[Array, " future"]:
    """Seconds by which all lights turn green later in each future, spread evenly over an hour."""
    return jnp.mod(jnp.arange(futures) * GOLDEN, 1.0) * HOUR


class NoWaits(eqx.Module):
    """Streets without traffic, the neutral element: nobody waits."""

    gates: ClassVar[bool] = False
    """Whether streets are shut at times (:class:`sidestep.walking.opening.OpeningTimes`)."""
    jumps: ClassVar[bool] = False
    """Whether waits jump from one moment to the next, known beforehand to those who plan with them."""

    def until_open(self, _hour: Scalar, _segment: Segments, clock: Clocks) -> Clocks:
        """Nothing is ever shut."""
        return jnp.zeros_like(clock)

    def seconds(self, _hour: Scalar, _phase: Scalar, _segment: Segments, clock: Clocks) -> Clocks:
        """No wait."""
        return jnp.zeros_like(clock)

    def averaged(self) -> "NoWaits":
        """The same."""
        return self

    def on_pieces(self, _parent: Int[Array, " piece"], _first: Bool[Array, " piece"]) -> "NoWaits":
        """The same."""
        return self

    def begun_on(self, _segments: Bool[np.ndarray, " segment"]) -> "NoWaits":
        """The same."""
        return self

    def with_fixed(self, seconds: Float[Array, " segment"]) -> "Waits":
        """Waits of so many seconds before segments, always."""
        shape, day = np.shape(seconds), np.zeros(DAY_HOURS, np.float32)
        none, ever, day = jax.device_put((np.zeros(shape, np.float32), np.ones(shape, np.float32), day))
        return Waits(none, none, ever, ever, none, day, 0.0, phases=False, fixed=seconds)


class Waits(eqx.Module):
    """What keeps walkers waiting where a segment begins.

    Walkers who stand before a segment see the phase of its first light. All lights keep in step with one another, but
    nobody knows beforehand where in their cycles they are: that differs from future to future. Further lights on the
    same segment take their mean wait, since their places on it are unknown, and so do crossings without lights: the
    delay of gap acceptance, which grows with the traffic of the hour.
    """

    gates: ClassVar[bool] = False

    lights: Float[Array, " segment"]
    """Crossings with lights on each segment."""
    unsignalised: Float[Array, " segment"]
    """Crossings of traffic without lights."""
    cycle: Float[Array, " segment"]
    """From green to green, of the first light, in s."""
    green: Float[Array, " segment"]
    """Green of each cycle, in s."""
    offset: Float[Array, " segment"]
    """Clock in s at which the first light turns green, and every cycle later; the future's phase is added."""
    vehicles: Float[Array, "24"]
    """Vehicles/s on each street that is crossed without lights, by hour of the day."""
    critical_gap: float = eqx.field(static=True)
    """Gap between vehicles that walkers need, in s."""
    phases: bool = eqx.field(static=True, default=True)
    """Whether lights have phases; else all take their mean wait."""
    fixed: Float[Array, " segment"] | None = None
    """Seconds that everybody waits besides, such as for a lift; None where nobody does."""

    @property
    def jumps(self) -> bool:
        return self.phases

    def until_open(self, _hour: Scalar, _segment: Segments, clock: Clocks) -> Clocks:
        """Nothing is ever shut."""
        return jnp.zeros_like(clock)

    def seconds(self, hour: Scalar, phase: Scalar, segment: Segments, clock: Clocks) -> Clocks:
        """Wait before segments.

        Parameters
        ----------
        hour
            Hour of the week at clock 0.
        phase
            Seconds by which lights turn green later in this future.
        segment, clock
            Where and when walkers come.

        Returns
        -------
        seconds
            The wait of each.
        """
        lights, cycle, green = self.lights[segment], self.cycle[segment], self.green[segment]
        mean_red = (cycle - green) ** 2 / (2 * cycle)
        at_lights = lights * mean_red
        if self.phases:
            since_green = jnp.mod(clock - phase - self.offset[segment], cycle)
            red = jnp.where(since_green < green, 0.0, cycle - since_green)
            first = jnp.minimum(lights, 1.0)
            at_lights = first * red + (lights - first) * mean_red
        # Gaps come after the lights, or of those who leave a light together the last to come would be the first to go.
        waited = at_lights + self.unsignalised[segment] * self._delay(hour, clock + at_lights)
        return waited if self.fixed is None else waited + self.fixed[segment]

    def averaged(self) -> "Waits":
        """The same with all lights at their mean wait, as they are to walkers who do not know their phases."""
        return replace(self, phases=False)

    def on_pieces(self, parent: Int[Array, " piece"], first: Bool[Array, " piece"]) -> "Waits":
        """The same on pieces of the segments; only the first piece of each has something to wait for."""
        lights, unsignalised = self.lights[parent] * first, self.unsignalised[parent] * first
        timing = (self.cycle[parent], self.green[parent], self.offset[parent])
        fixed = None if self.fixed is None else self.fixed[parent] * first
        return Waits(lights, unsignalised, *timing, self.vehicles, self.critical_gap, self.phases, fixed)

    def begun_on(self, _segments: Bool[np.ndarray, " segment"]) -> "Waits":
        """The same: lights and traffic are where streets begin."""
        return self

    def with_fixed(self, seconds: Float[Array, " segment"]) -> "Waits":
        """The same with so many seconds more before segments, always."""
        return replace(self, fixed=seconds)

    def _delay(self, hour: Scalar, clock: Clocks) -> Clocks:
        # Straight from the middle of one hour to the middle of the next.
        middle = hour + clock / HOUR - 0.5
        before = jnp.floor(middle)
        part, before = middle - before, before.astype(jnp.int32)
        rate = (1 - part) * self.vehicles[before % DAY_HOURS] + part * self.vehicles[(before + 1) % DAY_HOURS]
        return gap_delay(rate, self.critical_gap)
