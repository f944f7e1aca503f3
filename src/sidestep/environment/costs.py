"""What walking a segment takes and costs: seconds, metres, and the crowd that is met."""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.environment.types import Crossing, EnvParams
from sidestep.walking.crossing_time import crossing_time_in, crossing_times_at, exposure_in
from sidestep.walking.objective import Objective
from sidestep.walking.speed_field import SpeedField


def with_mean_waits(params: EnvParams) -> EnvParams:
    """The same with lights at their mean wait, as somebody reckons with them who does not know their phases."""
    return params if params.waits is None else replace(params, waits=replace(params.waits, phases=False))


def cross(params: EnvParams, future: Int[Array, ""], segment: Int[Array, ""], clock: Float[Array, ""]) -> Crossing:
    """Walk a segment to which somebody comes at ``clock``, in one of the crowds."""
    speed, covered = params.futures.through(future, segment)
    density = None if params.objective is None else params.futures.densities(future, segment)
    wait = waiting(params, future, segment, clock)
    return _crossing(
        params, clock, wait, speed, covered, density, params.network.length[segment], params.futures.slot_seconds
    )


def cross_in(
    params: EnvParams,
    field: SpeedField,
    future: Int[Array, ""],
    segment: Int[Array, ""],
    clock: Float[Array, ""],
) -> Crossing:
    """The same in a field without alternatives."""
    density = None if params.objective is None else field.known_density[segment]
    wait = waiting(params, future, segment, clock)
    length = params.network.length[segment]
    return _crossing(
        params, clock, wait, field.speed[segment], field.covered[segment], density, length, field.slot_seconds
    )


def crossings(
    params: EnvParams,
    field: SpeedField,
    future: Int[Array, ""],
    *,
    begins: Float[Array, ""] | float = 0.0,
    every: int = 1,
) -> Crossing:
    """All segments of a field without alternatives, entered as its slots begin: arrays [step, segment].

    Parameters
    ----------
    future
        Whose hour of the week decides how much traffic there is.
    begins
        Clock at which the field begins.
    every
        Steps in each slot.
    """
    length, segments = params.network.length, jnp.arange(params.network.segments)
    steps = jnp.arange(field.slots * every) * (field.slot_seconds / every)
    speed, covered = field.speed.T, field.covered.T
    density = None if params.objective is None else field.known_density

    def at(clock: Float[Array, ""]) -> Crossing:
        come = jnp.full(segments.shape, clock)
        wait = waiting(params, future, segments, begins + come)
        entered = come if wait is None else come + wait
        walked = crossing_times_at(speed, covered, field.slot_seconds, length, entered, params.rule)
        return _met(params, density, field.slot_seconds, length, come, walked if wait is None else wait + walked)

    return jax.lax.map(at, steps)


def waiting(
    params: EnvParams, future: Int[Array, ""], segment: Int[Array, "*n"], clock: Float[Array, "*n"]
) -> Float[Array, "*n"] | None:
    """Wait in s before segments, if there is anything to wait for."""
    return None if params.waits is None else params.waits.seconds(future, segment, clock)


def standing(
    params: EnvParams,
    length: Float[Array, "*n"],
    speed: Float[Array, "*n"],
    density: Float[Array, "*n"] | None,
    wait: Float[Array, "*n"] | None,
) -> Crossing:
    """Segments walked if their crowds stayed as they are."""
    seconds = length / speed
    seconds = seconds if wait is None else wait + seconds
    if params.objective is None or density is None:  # which are both or neither
        return Crossing(seconds, length, seconds)
    return _weighed(params.objective, seconds, length, density * seconds, density)


def _crossing(
    params: EnvParams,
    clock: Float[Array, ""],
    wait: Float[Array, ""] | None,
    speed: Float[Array, " slot"],
    covered: Float[Array, " slot"],
    density: Float[Array, " slot"] | None,
    length: Float[Array, ""],
    slot_seconds: float,
) -> Crossing:
    entered = clock if wait is None else clock + wait
    seconds = crossing_time_in(speed, covered, slot_seconds, length, entered, params.rule)
    return _met(params, density, slot_seconds, length, clock, seconds if wait is None else wait + seconds)


def _met(
    params: EnvParams,
    density: Float[Array, "*n slot"] | None,
    slot_seconds: float,
    length: Float[Array, "*n"],
    clock: Float[Array, "*n"],
    seconds: Float[Array, "*n"],
) -> Crossing:
    """What it costs to come to segments at clocks and to leave them so many seconds later."""
    if params.objective is None or density is None:  # which are both or neither
        return Crossing(seconds, length, seconds)
    # Those who wait stand in the crowd of the street that they are about to walk.
    exposure = exposure_in(density, slot_seconds, clock, clock + seconds)
    slot = jnp.clip(jnp.floor(clock / slot_seconds).astype(jnp.int32), 0, density.shape[-1] - 1)
    entered = jnp.take_along_axis(density, slot[..., None], axis=-1)[..., 0]
    return _weighed(params.objective, seconds, length, exposure, entered)


def _weighed(
    objective: Objective,
    seconds: Float[Array, "*n"],
    metres: Float[Array, "*n"],
    exposure: Float[Array, "*n"],
    density: Float[Array, "*n"],
) -> Crossing:
    cost = objective.cost(seconds, metres, exposure, density)
    return Crossing(seconds, metres, cost, exposure, objective.too_dense(density))
