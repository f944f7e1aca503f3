"""What a walker sees at each level of knowledge; each level sees what the one before it sees, and more."""

from dataclasses import replace
from functools import partial

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.environment.cost_to_go import at_clock, known_cost_to_go, known_live_cost_to_go
from sidestep.environment.crossing import static_crossing, static_crossing_in, with_mean_waits
from sidestep.environment.types import RECENT_NODES, EnvParams, EnvState, Expected, Live, Local, Observation
from sidestep.walking.crossing_time import slot_at
from sidestep.walking.expected_times import Speeds
from sidestep.walking.objective import Crossing

EMPTY = 0.02
"""Persons/m² that make no difference to :attr:`sidestep.environment.types.Expected.log_density_ratio`."""
Exits = Float[Array, " exit"]
"""A number for each street that leaves the crossing."""


def observe(params: EnvParams, state: EnvState) -> Observation:
    """See what the environment's level sees.

    Level ``position``, the paper's, sees where the walker is, and which exits may be taken.

    Parameters
    ----------
    params, state
        The environment, and the walker in it.

    Returns
    -------
    Observation
        From level ``local`` on with the level's own estimate.
    """
    network = params.network
    valid = network.exits_to(state.instance.destination, state.node)
    seen = Observation(state.node, network.position[state.node], valid, state.steps)
    if params.level == "position":
        return seen
    local, estimate = _local(params, state)
    seen = replace(seen, local=local, estimate=estimate)
    if params.level == "local":
        return seen
    expected, estimate = _expected(params, state, local)
    seen = replace(seen, expected=expected, estimate=estimate)
    if params.level == "map":
        return seen
    live = _live(params, state, local)
    return replace(seen, live=live, estimate=live.forecast)


def _local(params: EnvParams, state: EnvState) -> tuple[Local, Exits]:
    """Level ``local``: also the clock, where the destination lies, and crowds, gates and lights of streets from here.

    Returns
    -------
    local, estimate
        The estimate takes each street at the speed that is seen on it, then straight on at free speed.
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
    speed, nobody = jnp.full_like(metres, params.free_speed), partial(jnp.zeros_like, metres)
    empty = static_crossing(params, metres, speed, nobody)
    return local, local.cost + empty.cost + _turning_back(params, local)


def _expected(params: EnvParams, state: EnvState, local: Local) -> tuple[Expected, Exits]:
    """Level ``map``: also the map and what is expected on it.

    Returns
    -------
    expected, estimate
        The estimate takes each street at the speed that is seen on it, then the least expected cost; where crowds are
        interpolated, it is the least expected cost from here on.
    """
    known, future, speeds = known_cost_to_go(params), state.instance.future, params.futures.speeds
    destination, which = known.destination[state.instance.destination], params.expected_for(future)
    now = _crossing_now(params, state, params.expected, which)

    def to_go(table: Float[Array, "destination step node"], crossing: Exits) -> Exits:
        return at_clock(table, speeds.slot_seconds / known.steps, state.clock + crossing, local.onto, destination)

    if known.scaled is None:
        expected = Expected(now.cost, to_go(known.table, local.crossing))
        return expected, local.cost + expected.to_go + _turning_back(params, local)
    # What is seen here is seen on the streets beyond as well. Taken for this street's alone, it would send walkers
    # round the next corner, from where the way back is the fastest: then they would go to and fro.
    segment, slot = params.network.exit_segment[state.node], slot_at(state.clock, speeds.slot_seconds, speeds.slots)
    density, usual = speeds.density_at(future, segment, slot), params.expected.density_at(which, segment, slot)
    expected = Expected(
        now.cost,
        to_go(known.table, now.seconds),
        log_density_ratio=jnp.log((density + EMPTY) / (usual + EMPTY)),
        cost_to_go_scaled=to_go(known.scaled, now.seconds) - to_go(known.table, now.seconds),
    )
    # But walkers see whether it is too dense to enter.
    objective = params.objective
    penalty = objective.penalty * (objective.too_dense(lambda: density) - objective.too_dense(lambda: usual))
    return expected, now.cost + expected.to_go + penalty + _turning_back(params, local)


def _live(params: EnvParams, state: EnvState, local: Local) -> Live:
    """Level ``live``: also the counts of all streets as of now, and the forecasts from them.

    Returns
    -------
    Live
        The estimate of the level is its ``forecast``: the least cost over each street if crowds go on as forecast.
    """
    known, speeds, future = known_live_cost_to_go(params), params.futures.speeds, state.instance.future
    segment, slot = params.network.exit_segment[state.node], slot_at(state.clock, speeds.slot_seconds, speeds.slots)
    row = jnp.minimum(slot, known.snapshot.shape[1] - 1)  # the costs of one slot are for walkers in it
    snapshot = local.cost + known.snapshot[future, row, local.onto]
    if known.forecast is None:
        return Live(snapshot)
    part, steps = jnp.clip(state.clock / speeds.slot_seconds - slot, 0.0, 1.0), known.forecast.shape[2] - 1
    step: int | Int[Array, ""] = 0
    clock, gates = jnp.full(segment.shape, state.clock), params.gates_in(future)
    if params.waits.gates:
        step = jnp.minimum(jnp.floor(part * steps).astype(jnp.int32), steps - 1)
        part = part * steps - step
        edges = (jnp.full_like(clock, (slot + edge / steps) * speeds.slot_seconds) for edge in (step, step + 1))
        shut, begin, end = (gates(segment, at) for at in (clock, *edges))
        # Where a gate shuts or opens for good in between, only one of both is like now.
        for_good = (begin > params.horizon) != (end > params.horizon)
        part = jnp.where(for_good, (shut > params.horizon) == (end > params.horizon), part)
        shut -= (1 - part) * begin + part * end  # forecasts take gates to open and shut little by little
    begin, end = known.forecast[future, row, step, segment], known.forecast[future, row, step + 1, segment]
    forecast = (1 - part) * begin + part * end
    # Forecasts leave out penalties, and take lights at their mean wait: from here both are seen.
    density = partial(speeds.density_at, future, segment, slot)
    forecast += params.objective.penalty * params.objective.too_dense(density)
    mean, seen = (each.wait_in(future)(segment, clock) for each in (with_mean_waits(params), params))
    if params.waits.gates:
        mean -= shut
    forecast += params.objective.waiting(seen - mean, density)
    return Live(snapshot, forecast)


def _crossing_now(params: EnvParams, state: EnvState, speeds: Speeds, future: Int[Array, ""]) -> Crossing:
    """What the streets from here take and cost if crowds stay as they are in a future, gates and lights as seen."""
    segment, met = params.network.exit_segment[state.node], params.futures.speeds
    slot = slot_at(state.clock, met.slot_seconds, met.slots)
    wait = params.wait_in(state.instance.future)(segment, jnp.full(segment.shape, state.clock))
    return static_crossing_in(params, speeds, future, slot, segment, wait)


def _turning_back(params: EnvParams, local: Local) -> Exits | float:
    """Penalty for going back to nodes left lately, s: else the next estimate would lead back to a street too dense."""
    return params.objective.penalty * (local.steps_since_visit <= RECENT_NODES) if params.objective.jumps else 0.0
