"""Prioritised experience replay (Schaul et al. 2016) on a sum tree.

The tree is wide instead of binary, and only its leaves are kept: their sums are worked out anew for every batch. That
is a pass over numbers that lie together in memory, and takes less time than to change sums on the way to each leaf.

Items are kept as rows of 32-bit words in one array, whatever they consist of: a step then adds with one small copy and
draws with one gather, and the compiler updates the array in place. (Arrays of their own for a dozen numbers it copies
whole at every step.)
"""

from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

FANOUT = 32
"""Numbers that each inner number is the sum of; the root has up to twice as many children."""
Item = TypeVar("Item")  # a PyTree


class SumTree(eqx.Module):
    """Non-negative numbers that can be drawn in proportion."""

    leaves: Float[Array, "block fanout"]
    """In blocks of ``FANOUT``."""

    def set(self, leaf: Int[Array, " n"], value: Float[Array, " n"]) -> "SumTree":
        """Give leaves new values; where one is named twice, one of its values is kept."""
        return SumTree(self.leaves.at[leaf // FANOUT, leaf % FANOUT].set(value))

    @property
    def total(self) -> Float[Array, ""]:
        """Sum of all leaves."""
        return self._sums()[1][-1]

    def find(self, mass: Float[Array, " n"]) -> tuple[Int[Array, " n"], Float[Array, " n"]]:
        """Find leaves at cumulative masses in [0, total): leaf i holds [sum of those before, plus its own).

        Returns
        -------
        leaf, value
            The leaf under each mass, and what it holds.
        """
        levels, up_to = self._sums()
        cumulative = jnp.triu(jnp.ones((FANOUT, FANOUT)))
        block, mass = _child(jnp.broadcast_to(up_to, (*mass.shape, len(up_to))), mass)
        for level in levels[:-1]:
            few = len(level) < len(mass)
            child, mass = _child((level @ cumulative)[block] if few else level[block] @ cumulative, mass)
            block = block * FANOUT + child
        # The compiler must see that all are read before some are set: then it copies none.
        values = self.leaves[block]
        child, _ = _child(values @ cumulative, mass)
        return block * FANOUT + child, jnp.take_along_axis(values, child[:, None], 1)[:, 0]

    def _sums(self) -> tuple[list[Float[Array, "_ fanout"]], Float[Array, " child"]]:
        """Levels of the tree from below the root's children down to the leaves, and the cumulative sums of those."""
        levels = [self.leaves]
        while len(sums := levels[0] @ jnp.ones(FANOUT)) > 2 * FANOUT:
            levels.insert(0, jnp.pad(sums, (0, -len(sums) % FANOUT)).reshape(-1, FANOUT))
        # Sums with zeros, not jnp.cumsum: all add up in the same order, and none exceeds the one before by rounding.
        return levels, jnp.sum(jnp.where(jnp.tri(len(sums), dtype=bool), sums, 0.0), axis=1)


def _child(up_to: Float[Array, "n child"], mass: Float[Array, " n"]) -> tuple[Int[Array, " n"], Float[Array, " n"]]:
    """The child that holds a mass, by the cumulative sums of all, and how far into it the mass lies."""
    # Rounding may put the mass a hair above what is there; a leaf of value zero must not be drawn.
    mass = jnp.minimum(mass, up_to[:, -1] * (1 - 1e-6))
    before = up_to <= mass[:, None]
    child = jnp.sum(before, axis=1, dtype=jnp.int32)
    return child, mass - jnp.max(up_to, axis=1, where=before, initial=0.0)


def sum_tree(leaves: int) -> SumTree:
    """A tree of zeros, of at least so many leaves."""
    return SumTree(jnp.zeros((-(-leaves // FANOUT), FANOUT)))


@dataclass(frozen=True)
class Layout(Generic[Item]):
    """How items become rows of 32-bit words, to the bit, and rows items."""

    structure: jax.tree_util.PyTreeDef
    leaves: tuple[jax.ShapeDtypeStruct, ...]

    def __reduce__(self) -> tuple[Any, ...]:
        # Trees of classes are others once they are read from a file; those of an item are not.
        return layout_of, (jax.tree.unflatten(self.structure, self.leaves),)

    def pack(self, items: Item) -> Int[Array, "n word"]:
        """Turn items into rows."""

        def words(leaf: Array) -> Int[Array, "n word"]:
            flat = leaf.reshape(leaf.shape[0], -1)
            return flat.astype(jnp.int32) if leaf.dtype == bool else jax.lax.bitcast_convert_type(flat, jnp.int32)

        return jnp.concatenate([words(leaf) for leaf in jax.tree.leaves(items)], axis=1)

    def unpack(self, rows: Int[Array, "n word"]) -> Item:
        """Turn rows into items."""
        items, first = [], 0
        for leaf in self.leaves:
            part = rows[:, first : first + leaf.size]
            first += leaf.size
            part = part != 0 if leaf.dtype == bool else jax.lax.bitcast_convert_type(part, leaf.dtype)
            items.append(part.reshape(-1, *leaf.shape))
        return jax.tree.unflatten(self.structure, items)


def layout_of(item: Item) -> Layout[Item]:
    """How items of these shapes and types are packed."""
    leaves, structure = jax.tree.flatten(item)
    return Layout(structure, tuple(leaves))


class Replay(eqx.Module, Generic[Item]):
    """A ring of the latest items with a priority each."""

    rows: Int[Array, "capacity word"]
    """The items, as ``layout`` packs them."""
    priorities: SumTree
    added: Int[Array, ""]
    """Items ever added."""
    highest: Float[Array, ""]
    """Highest priority so far; new items get it."""
    layout: Layout[Item] = eqx.field(static=True)

    @property
    def capacity(self) -> int:
        """Items that it holds at most."""
        return self.rows.shape[0]

    @property
    def items(self) -> Item:
        """All items, also those that were never added: each leaf [capacity, ...]."""
        return self.layout.unpack(self.rows)


def empty_replay(item: Item, capacity: int) -> Replay[Item]:
    """A replay for items like ``item``, which only gives shapes and types."""
    layout = layout_of(jax.eval_shape(lambda: item))
    rows = jnp.zeros((capacity, sum(leaf.size for leaf in layout.leaves)), jnp.int32)
    return Replay(rows, sum_tree(capacity), jnp.int32(0), jnp.float32(1.0), layout)


def add(replay: Replay[Item], batch: Item, count: int) -> Replay[Item]:
    """Add items after the latest ones, in the place of the oldest.

    Parameters
    ----------
    replay
        Where they are added.
    batch
        The items, with a leading axis.
    count
        How many; it must divide the capacity, so that none wraps round.

    Returns
    -------
    Replay
        With the items at the highest priority so far.

    Raises
    ------
    ValueError
        The capacity is no multiple of ``count``.
    """
    if replay.capacity % count:
        raise ValueError(f"a replay of {replay.capacity} items cannot be filled {count} at a time")
    start = replay.added % replay.capacity
    rows = jax.lax.dynamic_update_slice_in_dim(replay.rows, replay.layout.pack(batch), start, 0)
    priorities = replay.priorities.set(start + jnp.arange(count), jnp.broadcast_to(replay.highest, count))
    return replace(replay, rows=rows, priorities=priorities, added=replay.added + count)


def sample(
    replay: Replay[Item], uniform: Float[Array, " n"], beta: Float[Array, ""] | float
) -> tuple[Int[Array, " n"], Item, Float[Array, " n"]]:
    """Draw items in proportion to their priorities, one from each of n equal strata of the total.

    Parameters
    ----------
    replay
        Where they are.
    uniform
        A number in [0, 1) for each item.
    beta
        Exponent of the importance weights.

    Returns
    -------
    place
        Where each item is in the ring.
    items
        The batch.
    weight
        Importance weights (N P(i))^-β over the largest in the batch.
    """
    count = uniform.shape[0]
    total = replay.priorities.total
    place, priority = replay.priorities.find((jnp.arange(count) + uniform) / count * total)
    size = jnp.minimum(replay.added, replay.capacity)
    return place, replay.layout.unpack(replay.rows[place]), importance(priority / total, size, beta)


def importance(
    probability: Float[Array, " n"], size: Int[Array, ""], beta: Float[Array, ""] | float
) -> Float[Array, " n"]:
    """Importance weights (N P(i))^-β, scaled so that the largest is 1."""
    weight = (size * probability) ** -beta
    return weight / jnp.max(weight)


def reprioritise(
    replay: Replay[Item], place: Int[Array, " n"], td_error: Float[Array, " n"], alpha: float, floor: float
) -> Replay[Item]:
    """Give items the priority (abs(δ) + floor)^α; with α = 0 every item keeps 1, which is uniform replay."""
    priority = (jnp.abs(td_error) + floor) ** alpha
    highest = jnp.maximum(replay.highest, jnp.max(priority))
    return replace(replay, priorities=replay.priorities.set(place, priority), highest=highest)
