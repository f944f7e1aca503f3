"""Cost-to-go potentials: from every node, at every time, the least cost of getting to a goal through changing crowds.

One pass by decreasing order of time (Chabini 1998, doi:10.3141/1645-21) serves all origins and all departures. Cost is
known at the beginning of every slot and taken to be linear in between; crossings shorter than a slot lead back into it,
which a short iteration settles. Exact where speeds do not change.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sidestep.network.graph import RoadNetwork

UNREACHABLE = 1e9  # s; finite, so that it can be interpolated
SETTLED = 0.01  # s


def static_cost_to_go(
    network: RoadNetwork, cost: Float[Array, " segment"], goal: Bool[Array, " node"]
) -> Float[Array, " node"]:
    """Cost from every node to the nearest goal if those of crossing segments stay what they are (Bellman and Ford)."""
    onward = jnp.where(network.valid, cost[network.exit_segment], UNREACHABLE)
    start = jnp.where(goal, 0.0, UNREACHABLE)

    def improve(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        to_go, _ = carry
        better = jnp.minimum(to_go, jnp.min(onward + to_go[network.exit_node], axis=1))
        return better, (better < to_go).any()

    return jax.lax.while_loop(lambda carry: carry[1], improve, (start, jnp.bool_(True)))[0]


def cost_to_go(
    network: RoadNetwork,
    seconds: Float[Array, "slot segment"],
    cost: Float[Array, "slot segment"],
    slot_seconds: float,
    goal: Bool[Array, " node"],
    later: Float[Array, " node"],
) -> Float[Array, "slot node"]:
    """Cost from every node to the nearest goal, as each slot begins.

    Parameters
    ----------
    seconds, cost
        What it takes to cross each segment, entered as each slot begins.
    goal
        Which nodes are destinations; 0 there. Where there is no way, at least ``UNREACHABLE``.
    later
        Cost to go after the last of the slots.
    """
    slots = seconds.shape[0]
    head, valid = network.exit_node, network.valid
    start = jnp.broadcast_to(later, (slots + 1, network.nodes))

    def one_slot(table: Array, now: tuple[Array, Array, Array]) -> tuple[Array, None]:
        slot, seconds, cost = now
        seconds, cost = seconds[network.exit_segment], cost[network.exit_segment]
        ahead = seconds / slot_seconds
        whole = jnp.floor(ahead)
        part = ahead - whole
        before = slot + whole.astype(jnp.int32)
        beyond = jnp.minimum(before + 1, slots)
        # Within this slot: to-go at its beginning is what is sought, and only at its end is it known.
        within = before == slot
        known = jnp.where(within, 0.0, (1 - part) * table[jnp.minimum(before, slots), head])
        known = jnp.where(valid, cost + known + part * table[beyond, head], UNREACHABLE)
        weight = jnp.where(within, 1 - part, 0.0)

        def settle(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            to_go, _, times = carry
            found = jnp.where(goal, 0.0, jnp.min(known + weight * to_go[head], axis=1))
            found = jnp.minimum(found, UNREACHABLE)
            return found, jnp.max(jnp.abs(found - to_go)), times + 1

        # Rounding of very long times might never settle.
        start = (table[slot + 1], jnp.float32(jnp.inf), jnp.int32(0))
        to_go, _, _ = jax.lax.while_loop(
            lambda carry: (carry[1] > SETTLED) & (carry[2] <= network.nodes), settle, start
        )
        return table.at[slot].set(to_go), None

    table, _ = jax.lax.scan(one_slot, start, (jnp.arange(slots), seconds, cost), reverse=True)
    return table[:-1]


def at_clock(
    table: Float[Array, "*goal slot node"],
    slot_seconds: float,
    clock: Float[Array, " n"],
    node: Int[Array, " n"],
    goal: Int[Array, ""] | None = None,
) -> Float[Array, " n"]:
    """Cost to go from nodes at clocks, linear between the beginnings of slots; ``goal`` picks one of several tables.

    (It is part of the index, since picking a table first would copy it for every walker.)
    """
    which = () if goal is None else (goal,)
    last = table.shape[-2] - 1
    position = jnp.clip(clock / slot_seconds, 0.0, last)
    slot = jnp.floor(position).astype(jnp.int32)
    part = position - slot
    return (1 - part) * table[(*which, slot, node)] + part * table[(*which, jnp.minimum(slot + 1, last), node)]
