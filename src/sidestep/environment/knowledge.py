"""What the levels ``map`` and ``live`` know, worked out before walkers set out."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.environment.potentials import at_clock, crossing_times, field_to_go, time_to_go, unchanging_to_go
from sidestep.environment.types import EnvParams, Instance, LiveToGo, UsualToGo
from sidestep.network.graph import ABSENT, RoadNetwork
from sidestep.travel_time import CrossingRule, SpeedField, speed_field

WINDOW = 24  # slots that a forecast looks ahead; beyond, crowds are taken to be as usual
Ahead = Callable[
    [Float[Array, " segment"], Int[Array, ""]], Float[Array, "segment window"]
]  # speeds of this and the next slots from those counts


def check_known(params: EnvParams, instances: Instance) -> None:
    """Refuse walks that the levels ``map`` and ``live`` know nothing about; compiled programs could not.

    Raises
    ------
    ValueError
        A destination that the environment was not made for, or, at level ``live``, a crowd that is for another.
    """
    if params.level not in ("map", "live"):
        return
    if params.usual is None or (params.level == "live" and params.live is None):
        raise ValueError(f"the environment was not made for level {params.level}")
    goal = np.asarray(params.usual.goal)[np.asarray(instances.destination)]
    if (goal < 0).any():
        unknown = np.asarray(instances.destination).reshape(-1)[np.argmin(goal)]
        raise ValueError(f"no ways to node {unknown} are known; make_environment takes the destinations as goals")
    if params.level == "live" and (goal != np.asarray(instances.crowd) % params.usual.table.shape[0]).any():
        raise ValueError("at level live, crowd number c is for goal number c modulo goals")


def usual_to_go(
    network: RoadNetwork, expected: SpeedField, goals: Bool[Array, "goal node"], rule: CrossingRule
) -> UsualToGo:
    """Expected times to some destinations; no node may belong to two goals."""
    table = jax.lax.map(lambda goal: field_to_go(network, expected, goal, rule), goals)
    return UsualToGo(table, jnp.where(goals.any(axis=0), jnp.argmax(goals, axis=0), ABSENT).astype(jnp.int32))


def live_to_go(
    network: RoadNetwork,
    crowds: SpeedField,
    volume: Float[Array, "crowd slot segment"],
    ahead: Ahead,
    usual: UsualToGo,
    rule: CrossingRule,
) -> LiveToGo:
    """Times from all counts of every slot of every crowd, for crowd number c to goal number c modulo goals.

    ``ahead`` turns the counts of a slot into the speeds that are forecast from them; ``usual`` is what comes after its
    window.
    """
    count, slots = crowds.count, crowds.slots
    goals = usual.goal == jnp.arange(usual.table.shape[0])[:, None]
    which = jnp.arange(count) % goals.shape[0]

    def one(number: Int[Array, ""]) -> tuple[Array, Array]:
        crowd, slot = number // slots, number % slots
        goal, after = goals[which[crowd]], usual.table[which[crowd]]
        forecast = _forecast(network, ahead(volume[crowd, slot], slot), slot, goal, after, crowds.slot_seconds, rule)
        snapshot = unchanging_to_go(network, network.length / crowds.speed[crowd, :, slot], goal)
        return forecast, snapshot

    forecast, snapshot = jax.lax.map(one, jnp.arange(count * slots))
    return LiveToGo(forecast.reshape(count, slots, 2, -1), snapshot.reshape(count, slots, -1))


def _forecast(
    network: RoadNetwork,
    speed: Float[Array, "segment window"],
    slot: Int[Array, ""],
    goal: Bool[Array, " node"],
    usual: Float[Array, "slot node"],
    slot_seconds: float,
    rule: CrossingRule,
) -> Float[Array, "2 segment"]:
    """Seconds to the goal over each segment, entered as the slot begins and as it ends."""
    field = speed_field(speed, slot_seconds)
    crossing = crossing_times(field, network.length, rule)
    later = usual[jnp.minimum(slot + field.slots, usual.shape[0] - 1)]
    table = time_to_go(network, crossing, slot_seconds, goal, later)
    table = jnp.concatenate([table, later[None]])
    over = jax.vmap(partial(at_clock, table, slot_seconds, node=network.head))
    return crossing[:2] + over(clock=jnp.arange(2.0)[:, None] * slot_seconds + crossing[:2])
