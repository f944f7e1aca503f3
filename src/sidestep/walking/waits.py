"""Waiting before streets that cross traffic: at lights, and for gaps between vehicles.

Whoever comes later never leaves earlier (FIFO): at a light everybody who waits leaves as it turns green, and the wait
for a gap changes by less than a second from one second to the next.
"""

import math
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

HOUR, DAY_HOURS = 3600.0, 24
GOLDEN = (math.sqrt(5) - 1) / 2  # multiples of it, less their whole part, spread evenly
_CALM = 1e-6  # vehicles/s, fewer are none


def gap_delay(vehicles: Float[Array, "*n"], critical_gap: float) -> Float[Array, "*n"]:
    """Mean wait in s for a gap of so many s between vehicles that come at random, so many a second (Adams 1936)."""
    rate = jnp.maximum(vehicles, _CALM)
    return (jnp.expm1(rate * critical_gap) - rate * critical_gap) / rate


class Waits(eqx.Module):
    """What keeps walkers waiting where a segment begins.

    The phase of a segment's first light is seen by those who stand before it. All lights keep in step with one another,
    but nobody knows beforehand where in their cycles they are: every crowd's begin at another time. Further lights on
    the same segment take their mean wait, as nobody can say where on it they are, and so do crossings without lights:
    the delay of gap acceptance, which grows with the traffic of the hour.
    """

    lights: Float[Array, " segment"]  # crossings with lights on each segment
    unsignalised: Float[Array, " segment"]  # crossings of traffic without lights
    cycle: Float[Array, " segment"]  # s from green to green, of the first light
    green: Float[Array, " segment"]  # s of each cycle
    offset: Float[Array, " segment"]  # s: for crowd 0 the first light turns green at this clock and every cycle later
    vehicles: Float[Array, "24"]  # vehicles/s on each street that is crossed without lights, by hour of the day
    start: Float[Array, " world"]  # hour of the week at clock 0; crowd number c has number c modulo their count
    critical_gap: float = eqx.field(static=True)  # s between vehicles that walkers need
    phases: bool = eqx.field(static=True, default=True)  # whether lights have any; else all wait as long as in the mean

    def seconds(
        self, future: Int[Array, ""], segment: Int[Array, "*n"], clock: Float[Array, "*n"]
    ) -> Float[Array, "*n"]:
        """Wait in s of those who come to segments at clocks, in one of the crowds."""
        if not self.phases:
            return self.mean(future, segment, clock)
        cycle, later = self.cycle[segment], jnp.mod(future * GOLDEN, 1.0) * HOUR
        phase = jnp.mod(clock - later - self.offset[segment], cycle)
        red = jnp.where(phase < self.green[segment], 0.0, cycle - phase)
        lights = self.lights[segment]
        first = jnp.minimum(lights, 1.0)
        return self._and_gaps(future, segment, clock, first * red + (lights - first) * self.mean_red(segment))

    def mean(self, future: Int[Array, ""], segment: Int[Array, "*n"], clock: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The same for those who do not know the phases of lights."""
        return self._and_gaps(future, segment, clock, self.lights[segment] * self.mean_red(segment))

    def on(self, parent: Int[Array, " piece"], first: Bool[Array, " piece"]) -> "Waits":
        """The same on pieces of the segments; only the first piece of each has something to wait for."""
        return replace(
            self,
            lights=self.lights[parent] * first,
            unsignalised=self.unsignalised[parent] * first,
            cycle=self.cycle[parent],
            green=self.green[parent],
            offset=self.offset[parent],
        )

    def mean_red(self, segment: Int[Array, "*n"]) -> Float[Array, "*n"]:
        """Mean wait at a light in s, of those who come at any time."""
        cycle = self.cycle[segment]
        return (cycle - self.green[segment]) ** 2 / (2 * cycle)

    def _and_gaps(
        self,
        future: Int[Array, ""],
        segment: Int[Array, "*n"],
        clock: Float[Array, "*n"],
        at_lights: Float[Array, "*n"],
    ) -> Float[Array, "*n"]:
        # Gaps come after the lights, or of those who leave a light together the last to come would be the first to go.
        return at_lights + self.unsignalised[segment] * self._delay(future, clock + at_lights)

    def _delay(self, future: Int[Array, ""], clock: Float[Array, "*n"]) -> Float[Array, "*n"]:
        # Straight from the middle of one hour to the middle of the next.
        hour = self.start[future % self.start.shape[0]] + clock / HOUR - 0.5
        before = jnp.floor(hour)
        part, before = hour - before, before.astype(jnp.int32)
        rate = (1 - part) * self.vehicles[before % DAY_HOURS] + part * self.vehicles[(before + 1) % DAY_HOURS]
        return gap_delay(rate, self.critical_gap)
