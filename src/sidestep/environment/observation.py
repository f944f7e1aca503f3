"""What a walker sees at each level of knowledge; each level sees what the one before it sees, and more."""

from dataclasses import replace
from functools import partial
from typing import cast

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.environment.cost_to_go import at_clock, known_cost_to_go, known_live_cost_to_go
from sidestep.environment.crossing import static_crossing, static_crossing_in, with_mean_waits
from sidestep.environment.types import (
    RECENT_NODES,
    EnvParams,
    EnvState,
    Expected,
    Information,
    Live,
    Local,
    Observation,
)
from sidestep.walking.objective import Crossing
from sidestep.walking.speed_field import Speeds
from sidestep.walking.speed_laws import FREE_SPEED

EMPTY = 0.02
"""Persons/m² that make no difference to :attr:`sidestep.environment.types.Expected.log_density_ratio`."""


def observe(params: EnvParams, state: EnvState) -> Observation:
    """See what the environment's level sees."""
    return _OBSERVE[params.level](params, state)


def observe_position(params: EnvParams, state: EnvState) -> Observation:
    """Level ``position``, the paper's: where the walker is, and which exits there are."""
    network = params.network
    return Observation(state.node, network.position[state.node], network.exit_node[state.node] >= 0, state.steps)


def observe_local(params: EnvParams, state: EnvState) -> Observation:
    """Level ``local``: also the clock, where the destination lies, and the crowds and lights of the streets from here.

    Its estimate: each street at the speed that is seen on it, then straight on at free speed.
    """
    network = params.network
    onto, segment = network.exit_node[state.node], network.exit_segment[state.node]
    destination = network.position[state.instance.destination]
    remembered = state.recent_nodes == onto[:, None]
    now = _crossing_now(params, state, params.futures.speeds, state.instance.future)
    local = Local(
        clock=state.clock,
        ahead=destination - network.position[state.node],
        onto=onto,
        onward=destination - network.position[onto],
        length=network.length[segment],
        crossing=now.seconds,
        cost=now.cost,
        revisiting=(state.recent_nodes == state.node).any(),
        steps_since_visit=jnp.where(remembered.any(axis=1), 1 + jnp.argmax(remembered, axis=1), 1 + RECENT_NODES),
    )
    metres = jnp.linalg.norm(local.onward, axis=1)
    # Nobody is met on streets that are not seen.
    empty = static_crossing(
        params.objective, metres, jnp.full_like(metres, FREE_SPEED), partial(jnp.zeros_like, metres)
    )
    return replace(
        observe_position(params, state), local=local, estimate=local.cost + empty.cost + _turning_back(params, local)
    )


def observe_map(params: EnvParams, state: EnvState) -> Observation:
    """Level ``map``: also the map and its expected crowds.

    Its estimate: each street at the speed that is seen on it, then the least cost through the expected crowds; where
    crowds are interpolated, the least cost through the expected crowds from here on.
    """
    known, seen = known_cost_to_go(params), observe_local(params, state)
    local = cast("Local", seen.local)
    destination = known.destination[state.instance.destination]
    which = params.expected_for(state.instance.future)
    now = _crossing_now(params, state, params.expected, which)

    def to_go(table: Float[Array, "destination slot node"], crossing: Float[Array, " exit"]) -> Float[Array, " exit"]:
        return at_clock(table, params.futures.speeds.slot_seconds, state.clock + crossing, local.onto, destination)

    if known.scaled is None:
        expected = Expected(now.cost, to_go(known.table, local.crossing))
        estimate = local.cost + expected.to_go + _turning_back(params, local)
        return replace(seen, expected=expected, estimate=estimate)
    # What is seen here is seen on the streets beyond as well. Taken for this street's alone, it would send walkers
    # round the next corner, from where the way back is the fastest: then they would go to and fro.
    segment, slot = params.network.exit_segment[state.node], _slot(params, state)
    density = params.futures.speeds.density_at(state.instance.future, segment, slot)
    usual = params.expected.density_at(which, segment, slot)
    expected = Expected(
        now.cost,
        to_go(known.table, now.seconds),
        log_density_ratio=jnp.log((density + EMPTY) / (usual + EMPTY)),
        cost_to_go_scaled=to_go(known.scaled, now.seconds) - to_go(known.table, now.seconds),
    )
    # But walkers see whether it is too dense to enter.
    objective = params.objective
    penalty = objective.penalty * (objective.too_dense(lambda: density) - objective.too_dense(lambda: usual))
    estimate = now.cost + expected.to_go + penalty + _turning_back(params, local)
    return replace(seen, expected=expected, estimate=estimate)


def observe_live(params: EnvParams, state: EnvState) -> Observation:
    """Level ``live``: also the counts of all streets as of now, and the forecasts from them.

    Its estimate: the least cost over each street if crowds go on as forecast.
    """
    seen, known, speeds = observe_map(params, state), known_live_cost_to_go(params), params.futures.speeds
    local, slot, future = cast("Local", seen.local), _slot(params, state), state.instance.future
    segment = params.network.exit_segment[state.node]
    part = jnp.clip(state.clock / speeds.slot_seconds - slot, 0.0, 1.0)
    begin, end = known.forecast[future, slot, 0, segment], known.forecast[future, slot, 1, segment]
    forecast = (1 - part) * begin + part * end
    # Forecasts leave out penalties, and take lights at their mean wait: from here both are seen.
    density, clock = partial(speeds.density_at, future, segment, slot), jnp.full(segment.shape, state.clock)
    forecast += params.objective.penalty * params.objective.too_dense(density)
    mean, seen_now = (each.wait_in(future)(segment, clock) for each in (with_mean_waits(params), params))
    forecast += params.objective.waiting(seen_now - mean, density)
    live = Live(snapshot=local.cost + known.snapshot[future, slot, local.onto], forecast=forecast)
    return replace(seen, live=live, estimate=forecast)


_OBSERVE = {"position": observe_position, "local": observe_local, "map": observe_map, "live": observe_live}


def at_level(params: EnvParams, level: Information) -> EnvParams:
    """The same environment for walkers of another level."""
    return replace(params, level=level)


def _crossing_now(params: EnvParams, state: EnvState, speeds: Speeds, future: Int[Array, ""]) -> Crossing:
    """What the streets from here take and cost if crowds stay as they are in a future, with the lights as seen."""
    segment, slot = params.network.exit_segment[state.node], _slot(params, state)
    wait = params.wait_in(state.instance.future)(segment, jnp.full(segment.shape, state.clock))
    return static_crossing_in(params, speeds, future, slot, segment, wait)


def _turning_back(params: EnvParams, local: Local) -> Float[Array, " exit"] | float:
    if not params.objective.jumps:
        return 0.0
    # A walker who turns away from a street that is too dense would else be led back to it by the next estimate.
    return params.objective.penalty * (local.steps_since_visit <= RECENT_NODES)


def _slot(params: EnvParams, state: EnvState) -> Int[Array, ""]:
    slot = jnp.floor(state.clock / params.futures.speeds.slot_seconds).astype(jnp.int32)
    return jnp.clip(slot, 0, params.futures.speeds.slots - 1)
