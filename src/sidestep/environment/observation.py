"""What a walker sees at each level of knowledge; each level sees what the one before it sees, and more."""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.environment.cost_to_go import at_clock
from sidestep.environment.costs import standing, waiting
from sidestep.environment.types import (
    RECENT_NODES,
    Crossing,
    EnvParams,
    EnvState,
    Information,
    Live,
    Local,
    Observation,
    Usual,
)
from sidestep.walking.speed_field import SensedSpeeds, Speeds
from sidestep.walking.speed_laws import FREE_SPEED

EMPTY = 0.02  # persons/m² that make no difference


def observe(params: EnvParams, state: EnvState) -> Observation:
    """See what the environment's level sees."""
    return _OBSERVE[params.level](params, state)


def observe_position(params: EnvParams, state: EnvState) -> Observation:
    """Level ``position``, the paper's: where the walker is, and which exits there are."""
    network = params.network
    return Observation(state.node, network.position[state.node], network.exit_node[state.node] >= 0, state.steps)


def observe_local(params: EnvParams, state: EnvState) -> Observation:
    """Level ``local``: also the clock, where the destination lies, and the streets that leave from here.

    Their crowds and the phases of their lights are seen.

    Its estimate: each street at the speed that is seen on it, then straight on at free speed.
    """
    network = params.network
    onto, segment = network.exit_node[state.node], network.exit_segment[state.node]
    length = network.length[segment]
    goal = network.position[state.instance.destination]
    remembered = state.recent_nodes == onto[:, None]
    now = _seen_now(params, state, params.futures, state.instance.future)
    local = Local(
        clock=state.clock,
        ahead=goal - network.position[state.node],
        onto=onto,
        onward=goal - network.position[onto],
        length=length,
        crossing=now.seconds,
        cost=now.cost,
        again=(state.recent_nodes == state.node).any(),
        left=jnp.where(remembered.any(axis=1), 1 + jnp.argmax(remembered, axis=1), 1 + RECENT_NODES),
    )
    metres = jnp.linalg.norm(local.onward, axis=1)
    # Nobody is met on streets that are not seen.
    empty = standing(params, metres, jnp.full_like(metres, FREE_SPEED), jnp.zeros_like(metres), None)
    return replace(
        observe_position(params, state), local=local, estimate=local.cost + empty.cost + _turning_back(params, local)
    )


def observe_map(params: EnvParams, state: EnvState) -> Observation:
    """Level ``map``: also the map and its usual crowds.

    Its estimate: each street at the speed that is seen on it, then the fastest way through the expected crowds; where
    crowds spread from sensors, the fastest way through the expected crowds from here on.
    """
    seen = observe_local(params, state)
    local, known = seen.local, params.usual
    if local is None or known is None:
        raise ValueError("level map needs EnvParams.usual")
    goal = known.goal[state.instance.destination]
    segment, slot = params.network.exit_segment[state.node], _slot(params, state)
    which = state.instance.future % params.expected.count
    usually_now = _seen_now(params, state, params.expected, which)

    def to_go(table: Float[Array, "goal slot node"], enough: Float[Array, " exit"]) -> Float[Array, " exit"]:
        return at_clock(table, params.futures.slot_seconds, state.clock + enough, local.onto, goal)

    futures, expected = params.futures, params.expected
    if (
        not (isinstance(futures, SensedSpeeds) and isinstance(expected, SensedSpeeds))
        or known.cost_to_go_scaled is None
    ):
        usual = Usual(usually_now.cost, to_go(known.table, local.crossing))
        return replace(seen, usual=usual, estimate=local.cost + usual.to_go + _turning_back(params, local))
    # What is seen here is seen on the streets beyond as well. Taken for this street's alone, it would send walkers
    # round the next corner, from where the way back is the fastest: then they would go to and fro.
    density = futures.density_at(state.instance.future, segment, slot)
    usually = expected.density_at(which, segment, slot)
    crossing = usually_now.seconds
    usual = Usual(
        usually_now.cost,
        to_go(known.table, crossing),
        log_density_ratio=jnp.log((density + EMPTY) / (usually + EMPTY)),
        cost_to_go_scaled=to_go(known.cost_to_go_scaled, crossing) - to_go(known.table, crossing),
    )
    estimate = usually_now.cost + usual.to_go
    if params.objective is not None:  # but whether it is too dense to enter is seen
        seen_to_be = params.objective.too_dense(density) - params.objective.too_dense(usually)
        estimate += params.objective.penalty * seen_to_be
    return replace(seen, usual=usual, estimate=estimate + _turning_back(params, local))


def observe_live(params: EnvParams, state: EnvState) -> Observation:
    """Level ``live``: also the counts of all streets as of now, and what is forecast from them.

    Its estimate: the fastest way over each street if crowds go on as forecast.
    """
    seen = observe_map(params, state)
    local, known = seen.local, params.live
    if local is None or known is None:
        raise ValueError("level live needs EnvParams.live")
    slot, future = _slot(params, state), state.instance.future
    part = jnp.clip(state.clock / params.futures.slot_seconds - slot, 0.0, 1.0)
    segment = params.network.exit_segment[state.node]
    begin, end = known.forecast[future, slot, 0, segment], known.forecast[future, slot, 1, segment]
    forecast = (1 - part) * begin + part * end
    density, objective = None, params.objective
    if objective is not None:  # whether it is too dense to enter is seen as well
        density = params.futures.density_at(future, segment, slot)
        forecast += objective.penalty * objective.too_dense(density)
    if params.waits is not None:
        # The forecast is worked out for lights at their mean wait; from here they are seen.
        clock = jnp.full(segment.shape, state.clock)
        more = params.waits.seconds(future, segment, clock) - params.waits.mean(future, segment, clock)
        if objective is not None and density is not None:
            more *= objective.time + objective.exposure * density
        forecast += more
    live = Live(snapshot=local.cost + known.snapshot[future, slot, local.onto], forecast=forecast)
    return replace(seen, live=live, estimate=live.forecast)


def _seen_now(params: EnvParams, state: EnvState, futures: Speeds, future: Int[Array, ""]) -> Crossing:
    """What the streets that leave from here take and cost if their crowds stay as they are, with the lights as seen."""
    segment, slot = params.network.exit_segment[state.node], _slot(params, state)
    density = None if params.objective is None else futures.density_at(future, segment, slot)
    clock = jnp.full(segment.shape, state.clock)
    wait = waiting(params, state.instance.future, segment, clock)
    return standing(params, params.network.length[segment], futures.at(future, segment, slot), density, wait)


def _turning_back(params: EnvParams, local: Local) -> Float[Array, " exit"] | float:
    """Cost of going back to a crossing that is remembered, where there is a density that nobody should enter.

    Whoever turns away from a street that is seen to be too dense would else be led back to it by the next estimate.
    """
    if params.objective is None or params.objective.max_density is None:
        return 0.0
    return params.objective.penalty * (local.left <= RECENT_NODES)


_OBSERVE = {"position": observe_position, "local": observe_local, "map": observe_map, "live": observe_live}


def at_level(params: EnvParams, level: Information) -> EnvParams:
    """The same environment for walkers of another level."""
    return replace(params, level=level)


def _slot(params: EnvParams, state: EnvState) -> Int[Array, ""]:
    slot = jnp.floor(state.clock / params.futures.slot_seconds).astype(jnp.int32)
    return jnp.clip(slot, 0, params.futures.slots - 1)
