"""What the levels ``map`` and ``live`` know, worked out before walkers set out."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.environment.potentials import at_clock, crossing_times, field_to_go, time_to_go, unchanging_to_go
from sidestep.environment.types import HEAVIER, EnvParams, Instance, LiveToGo, UsualToGo
from sidestep.network.graph import ABSENT, RoadNetwork
from sidestep.travel_time import CrossingRule, SensedSpeeds, Speeds, speed_field

WINDOW = 24  # slots that a forecast looks ahead; beyond, crowds are taken to be as usual
Ahead = Callable[
    [Float[Array, " counter"], Int[Array, ""], Int[Array, ""]], Float[Array, "segment window"]
]  # speeds of a slot and the next ones from its counts, its number and the crowd's


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
    of_goals = params.level == "live" or params.expected.count > 1
    if of_goals and (goal != np.asarray(instances.crowd) % params.usual.table.shape[0]).any():
        raise ValueError("at level live, and where hours differ, crowd number c is for goal number c modulo goals")


def usual_to_go(
    network: RoadNetwork, expected: Speeds, goals: Bool[Array, "goal node"], rule: CrossingRule
) -> UsualToGo:
    """Expected times to some destinations; no node may belong to two goals."""

    def tables(field: Speeds) -> Float[Array, "goal slot node"]:
        def one(number: Int[Array, ""]) -> Float[Array, "slot node"]:
            return field_to_go(network, field.of(number % field.count), goals[number], rule)

        return jax.lax.map(one, jnp.arange(len(goals)))

    heavier = None
    if isinstance(expected, SensedSpeeds):
        heavier = tables(replace(expected, density=HEAVIER * expected.density))
    return UsualToGo(
        tables(expected), jnp.where(goals.any(axis=0), jnp.argmax(goals, axis=0), ABSENT).astype(jnp.int32), heavier
    )


def live_to_go(
    network: RoadNetwork,
    crowds: Speeds,
    counted: Float[Array, "crowd slot counter"],
    ahead: Ahead,
    usual: UsualToGo,
    rule: CrossingRule,
) -> LiveToGo:
    """Times from all counts of every slot of every crowd, for crowd number c to goal number c modulo goals.

    ``counted`` is what is known of each slot as it begins: the people on each segment, or at each sensor. ``ahead``
    turns it into the speeds that are forecast from it; ``usual`` is what comes after its window.
    """
    count, slots = crowds.count, crowds.slots
    goals = usual.goal == jnp.arange(usual.table.shape[0])[:, None]
    which = jnp.arange(count) % goals.shape[0]

    def one(number: Int[Array, ""]) -> tuple[Array, Array]:
        crowd, slot = number // slots, number % slots
        goal, after = goals[which[crowd]], usual.table[which[crowd]]
        foreseen = ahead(counted[crowd, slot], slot, crowd)
        forecast = _forecast(network, foreseen, slot, goal, after, crowds.slot_seconds, rule)
        now = crowds.at(crowd, jnp.arange(network.segments), slot)
        snapshot = unchanging_to_go(network, network.length / now, goal)
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
