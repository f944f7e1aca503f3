"""What the levels ``map`` and ``live`` know, worked out before walkers set out."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.environment.cost_to_go import at_clock, cost_to_go, static_cost_to_go
from sidestep.environment.costs import crossings, standing, waiting, with_mean_waits
from sidestep.environment.types import DENSITY_SCALE, EnvParams, ExpectedCostToGo, Instance, LiveCostToGo
from sidestep.network.graph import ABSENT
from sidestep.walking.speed_field import SensedSpeeds, SpeedField, Speeds

WINDOW = 24  # slots that a forecast looks ahead; beyond, crowds are taken to be as usual
Ahead = Callable[
    [Float[Array, " counter"], Int[Array, ""], Int[Array, ""]], SpeedField
]  # speeds in a slot and the next ones from its counts, its number and the crowd's


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
    if of_goals and (goal != np.asarray(instances.future) % params.usual.table.shape[0]).any():
        raise ValueError("at level live, and where hours differ, crowd number c is for goal number c modulo goals")


def field_cost_to_go(
    params: EnvParams,
    field: SpeedField,
    future: Int[Array, ""],
    goal: Bool[Array, " node"],
    *,
    every: int = 1,
) -> Float[Array, "step node"]:
    """Cost from every node to the nearest goal through a whole field, whose last slot lasts for ever.

    Parameters
    ----------
    field
        Speeds without alternatives.
    future
        Whose hour of the week decides how much traffic there is.
    goal
        Which nodes are destinations.
    every
        Steps in each slot, at whose beginnings costs are worked out.
    """
    crossed = crossings(params, field, future, every=every)
    density = None if params.objective is None else field.known_density[:, -1]
    last = static_cost_to_go_from(
        params, field.speed[:, -1], density, future, (field.slots - 1) * field.slot_seconds, goal
    )
    return cost_to_go(params.network, crossed.seconds, crossed.cost, field.slot_seconds / every, goal, last)


def static_cost_to_go_from(
    params: EnvParams,
    speed: Float[Array, " segment"],
    density: Float[Array, " segment"] | None,
    future: Int[Array, ""],
    clock: Float[Array, ""] | float,
    goal: Bool[Array, " node"],
) -> Float[Array, " node"]:
    """Cost from every node to the nearest goal if crowds stayed for ever as they are at a clock."""
    network = params.network
    wait = waiting(params, future, jnp.arange(network.segments), jnp.full(network.segments, clock))
    return static_cost_to_go(network, standing(params, network.length, speed, density, wait).cost, goal)


def expected_cost_to_go(params: EnvParams, goals: Bool[Array, "goal node"]) -> ExpectedCostToGo:
    """Expected costs of getting to some destinations; no node may belong to two goals."""
    params = with_mean_waits(params)

    def tables(expected: Speeds) -> Float[Array, "goal slot node"]:
        def one(number: Int[Array, ""]) -> Float[Array, "slot node"]:
            return field_cost_to_go(params, expected.of(number % expected.count), number, goals[number])

        return jax.lax.map(one, jnp.arange(len(goals)))

    expected, cost_to_go_scaled = params.expected, None
    if isinstance(expected, SensedSpeeds):
        cost_to_go_scaled = tables(replace(expected, density=DENSITY_SCALE * expected.density))
    return ExpectedCostToGo(
        tables(expected),
        jnp.where(goals.any(axis=0), jnp.argmax(goals, axis=0), ABSENT).astype(jnp.int32),
        cost_to_go_scaled,
    )


def live_cost_to_go(params: EnvParams, counted: Float[Array, "future slot counter"], ahead: Ahead) -> LiveCostToGo:
    """Costs from all counts of every slot of every crowd, for crowd number c to goal number c modulo goals.

    ``counted`` is what is known of each slot as it begins: the people on each segment, or at each sensor. ``ahead``
    turns it into the speeds that are forecast from it; what comes after its window is as usual.
    """
    params = with_mean_waits(params)
    futures, usual = params.futures, params.usual
    if usual is None:
        raise ValueError("level live needs EnvParams.usual")
    count, slots = futures.count, futures.slots
    goals = usual.goal == jnp.arange(usual.table.shape[0])[:, None]
    which = jnp.arange(count) % goals.shape[0]
    every = jnp.arange(params.network.segments)

    def one(number: Int[Array, ""]) -> tuple[Array, Array]:
        future, slot = number // slots, number % slots
        goal, after = goals[which[future]], usual.table[which[future]]
        forecast = _forecast(params, ahead(counted[future, slot], slot, future), future, slot, goal, after)
        density = None if params.objective is None else futures.density_at(future, every, slot)
        clock = slot * futures.slot_seconds
        return forecast, static_cost_to_go_from(params, futures.at(future, every, slot), density, future, clock, goal)

    forecast, snapshot = jax.lax.map(one, jnp.arange(count * slots))
    return LiveCostToGo(forecast.reshape(count, slots, 2, -1), snapshot.reshape(count, slots, -1))


def _forecast(
    params: EnvParams,
    field: SpeedField,
    future: Int[Array, ""],
    slot: Int[Array, ""],
    goal: Bool[Array, " node"],
    usual: Float[Array, "slot node"],
) -> Float[Array, "2 segment"]:
    """Cost to the goal over each segment, entered as the slot begins and as it ends.

    What it costs to enter a segment that is too dense is left out: that is seen there, and no matter of interpolation.
    """
    network, slot_seconds = params.network, field.slot_seconds
    crossed = crossings(params, field, future, begins=slot * slot_seconds)
    later = usual[jnp.minimum(slot + field.slots, usual.shape[0] - 1)]
    table = cost_to_go(network, crossed.seconds, crossed.cost, slot_seconds, goal, later)
    table = jnp.concatenate([table, later[None]])
    over = jax.vmap(partial(at_clock, table, slot_seconds, node=network.head))
    first = crossed.cost[:2]
    if params.objective is not None and crossed.too_dense is not None:
        first -= params.objective.penalty * crossed.too_dense[:2]
    return first + over(clock=jnp.arange(2.0)[:, None] * slot_seconds + crossed.seconds[:2])
