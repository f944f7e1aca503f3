"""What a walker sees at each level of knowledge; each level sees what the one before it sees, and more."""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.environment.potentials import at_clock
from sidestep.environment.types import TRAIL, EnvParams, EnvState, Live, Local, Observation, Seen, Usual
from sidestep.travel_time import FREE_SPEED, SensedSpeeds

EMPTY = 0.02  # persons/m² that make no difference


def observe(params: EnvParams, state: EnvState) -> Observation:
    """See what the environment's level sees."""
    return _OBSERVE[params.level](params, state)


def observe_position(params: EnvParams, state: EnvState) -> Observation:
    """Level ``position``, the paper's: where the walker is, and which exits there are."""
    network = params.network
    return Observation(state.node, network.position[state.node], network.exit_node[state.node] >= 0)


def observe_local(params: EnvParams, state: EnvState) -> Observation:
    """Level ``local``: also the clock, where the destination lies, and the streets that leave from here, with crowds.

    Its estimate: each street at the speed that is seen on it, then straight on at free speed.
    """
    network = params.network
    onto, segment = network.exit_node[state.node], network.exit_segment[state.node]
    length = network.length[segment]
    goal = network.position[state.instance.destination]
    remembered = state.trail == onto[:, None]
    local = Local(
        clock=state.clock,
        ahead=goal - network.position[state.node],
        onto=onto,
        onward=goal - network.position[onto],
        length=length,
        crossing=length / params.crowds.at(state.instance.crowd, segment, _slot(params, state)),
        again=(state.trail == state.node).any(),
        left=jnp.where(remembered.any(axis=1), 1 + jnp.argmax(remembered, axis=1), 1 + TRAIL),
    )
    straight = jnp.linalg.norm(local.onward, axis=1) / FREE_SPEED
    return replace(observe_position(params, state), local=local, estimate=local.crossing + straight)


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
    which = state.instance.crowd % params.expected.count
    crossing = local.length / params.expected.at(which, segment, slot)

    def to_go(table: Float[Array, "goal slot node"], enough: Float[Array, " exit"]) -> Float[Array, " exit"]:
        return at_clock(table, params.crowds.slot_seconds, state.clock + enough, local.onto, goal)

    crowds, expected = params.crowds, params.expected
    if not (isinstance(crowds, SensedSpeeds) and isinstance(expected, SensedSpeeds)) or known.heavier is None:
        usual = Usual(crossing, to_go(known.table, local.crossing))
        return replace(seen, usual=usual, estimate=local.crossing + usual.to_go)
    # What is seen here is seen on the streets beyond as well. Taken for this street's alone, it would send walkers
    # round the next corner, from where the way back is the fastest: then they would go to and fro.
    density = crowds.density_at(state.instance.crowd, segment, slot)
    usually = expected.density_at(which, segment, slot)
    usual = Usual(
        crossing,
        to_go(known.table, crossing),
        surprise=jnp.log((density + EMPTY) / (usually + EMPTY)),
        heavier=to_go(known.heavier, crossing) - to_go(known.table, crossing),
    )
    return replace(seen, usual=usual, estimate=crossing + usual.to_go)


def observe_live(params: EnvParams, state: EnvState) -> Observation:
    """Level ``live``: also the counts of all streets as of now, and what is forecast from them.

    Its estimate: the fastest way over each street if crowds go on as forecast.
    """
    seen = observe_map(params, state)
    local, known = seen.local, params.live
    if local is None or known is None:
        raise ValueError("level live needs EnvParams.live")
    slot, crowd = _slot(params, state), state.instance.crowd
    part = jnp.clip(state.clock / params.crowds.slot_seconds - slot, 0.0, 1.0)
    segment = params.network.exit_segment[state.node]
    begin, end = known.forecast[crowd, slot, 0, segment], known.forecast[crowd, slot, 1, segment]
    live = Live(
        snapshot=local.crossing + known.snapshot[crowd, slot, local.onto],
        forecast=(1 - part) * begin + part * end,
    )
    return replace(seen, live=live, estimate=live.forecast)


_OBSERVE = {"position": observe_position, "local": observe_local, "map": observe_map, "live": observe_live}


def at_level(params: EnvParams, level: Seen) -> EnvParams:
    """The same environment for walkers of another level."""
    return replace(params, level=level)


def _slot(params: EnvParams, state: EnvState) -> Int[Array, ""]:
    slot = jnp.floor(state.clock / params.crowds.slot_seconds).astype(jnp.int32)
    return jnp.clip(slot, 0, params.crowds.slots - 1)
