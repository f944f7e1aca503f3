"""Crossing segments: the seconds that it takes, and what the objective makes of them."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.environment.types import EnvParams, Futures, Meant
from sidestep.programs import program
from sidestep.walking.crossing_time import crosser, crossing_time, exposure, slot_at
from sidestep.walking.expected_times import RowOrTimes, Speeds, SpeedsOrTimes
from sidestep.walking.objective import Crossing, Deferred, Numbers, Objective
from sidestep.walking.waits import Segments, Wait

LOST = 1e9
"""Cost in s of waiting until a street opens for longer than a walk may take: as much as where no path leads."""


def with_mean_waits(params: EnvParams) -> EnvParams:
    """The same with lights at their mean wait, for plans by somebody who does not know their phases."""
    return replace(params, waits=params.waits.averaged())


def as_expected(params: EnvParams) -> EnvParams:
    """The same where streets take their expected times, and lights their mean wait."""
    old = params.futures
    futures = Futures(params.expected, *_first((old.destination, old.hour, old.phase), count=params.expected.count))
    return replace(params, futures=futures, waits=params.waits.averaged())


@program("count")
def _first(meant: Meant, count: int) -> tuple[Array, Array, Array]:
    """Of the first futures; in one program."""
    destination, hour, phase = meant
    return destination[:count], hour[:count], phase[:count]


def cross(
    params: EnvParams,
    future: Int[Array, ""],
    segment: Int[Array, ""],
    clock: Float[Array, ""],
    latest: Float[Array, ""] | None = None,
) -> Crossing:
    """Walk a segment in one of the futures.

    Parameters
    ----------
    params
        The environment.
    future, segment, clock
        In which future, which segment, and the clock in s at which the walker comes to it.
    latest
        Clock at which a walker who still waits before the segment gives up, if there is one.

    Returns
    -------
    Crossing
        Time and cost, with the wait before the segment.
    """
    speeds, wait = params.futures.speeds.row(future, segment), params.wait_in(future)
    return cross_at_speeds(params, speeds, wait, segment, clock, latest)


def cross_at_speeds(
    params: EnvParams,
    speeds: RowOrTimes,
    wait: Wait,
    segment: Int[Array, ""],
    clock: Float[Array, ""],
    latest: Float[Array, ""] | None = None,
) -> Crossing:
    """:func:`cross` at given ``speeds`` on this segment, after waits as given."""
    length, waited = params.network.length[segment], wait(segment, clock)
    seconds = waited + crossing_time(speeds, length, clock + waited, params.rule)
    if latest is None:
        return _lost(params, _crossing(params.objective, speeds, clock, seconds, length), waited)
    shut = clock + waited >= latest
    seconds, metres = jnp.where(shut, latest - clock, seconds), jnp.where(shut, 0.0, length)
    return _crossing(params.objective, speeds, clock, seconds, metres)


CrossStep = Callable[[Int[Array, ""]], Crossing]
"""What it takes to walk each segment, entered as a step begins, given its number."""


def crossing_steps(
    params: EnvParams, speeds: SpeedsOrTimes, wait: Wait, *, begins: Float[Array, ""] | float = 0.0, every: int = 1
) -> CrossStep:
    """Prepare to walk all segments, entered as slots begin: those of all steps together take gigabytes in large towns.

    Parameters
    ----------
    params
        The environment.
    speeds
        In one future, or expected times.
    wait
        Seconds to wait before segments.
    begins
        Clock in s at which the speeds begin.
    every
        Steps in each slot.

    Returns
    -------
    CrossStep
        Arrays [segment].
    """
    length, segments = params.network.length, jnp.arange(params.network.segments)
    seconds_to_cross = crosser(speeds, length, params.rule)

    def at(step: Int[Array, ""]) -> Crossing:
        come = jnp.full(segments.shape, step * (speeds.slot_seconds / every))
        waited = wait(segments, begins + come)
        seconds = waited + seconds_to_cross(come + waited)
        return _lost(params, _crossing(params.objective, speeds, come, seconds, length), waited)

    return at


def crossings(params: EnvParams, speeds: SpeedsOrTimes, wait: Wait, *, every: int = 1) -> Crossing:
    """:func:`crossing_steps` of all steps: arrays [step, segment]."""
    return jax.lax.map(crossing_steps(params, speeds, wait, every=every), jnp.arange(speeds.slots * every))


def static_crossing(
    params: EnvParams, metres: Numbers, speed: Numbers, density: Deferred, wait: Numbers | float = 0.0
) -> Crossing:
    """Walk segments if their crowds stayed as they are.

    Parameters
    ----------
    params
        The environment, with what it costs.
    metres, speed, density
        Length in m, speed in m/s and density in persons/m² of each.
    wait
        Seconds to wait before each.

    Returns
    -------
    Crossing
        Time and cost of each.
    """
    seconds = wait + metres / speed
    crossed = params.objective.crossing(seconds, metres, lambda: density() * seconds, density)
    return _lost(params, crossed, wait)


def static_crossing_in(
    params: EnvParams, speeds: Speeds, future: Int[Array, ""], slot: Int[Array, ""], segment: Segments, wait: Numbers
) -> Crossing:
    """Walk segments, after some wait before each, if the crowds of a future stayed as they are in a slot."""
    speed, density = speeds.at(future, segment, slot), partial(speeds.density_at, future, segment, slot)
    return static_crossing(params, params.network.length[segment], speed, density, wait)


def _lost(params: EnvParams, crossed: Crossing, waited: Numbers | float) -> Crossing:
    """Crossings that cost too much for any walk where the wait before them is longer than a walk may take."""
    if not params.waits.gates:
        return crossed
    return replace(crossed, cost=crossed.cost + LOST * (waited > params.horizon))


def _crossing(
    objective: Objective, speeds: SpeedsOrTimes | RowOrTimes, clock: Numbers, seconds: Numbers, length: Numbers
) -> Crossing:
    """What it costs to come to segments at clocks and to leave them so many seconds later."""

    # Walkers who wait stand in the crowd of the street that they are about to walk.
    def met() -> Numbers:
        return exposure(speeds.known_density, speeds.slot_seconds, clock, clock + seconds)

    def density() -> Numbers:
        slot = slot_at(clock, speeds.slot_seconds, speeds.slots)
        return jnp.take_along_axis(speeds.known_density, slot[..., None], axis=-1)[..., 0]

    return objective.crossing(seconds, length, met, density)
