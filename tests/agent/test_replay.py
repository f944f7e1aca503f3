"""The sum tree and the prioritised replay on it: by hand, beside a plain array, and in their statistics."""

import re
from collections import Counter
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.agent import replay as memory
from sidestep.agent.replay import FANOUT, Replay, SumTree, empty_replay, importance, sum_tree

CAPACITIES = (
    1,
    33,
    1024,
    10_000,
    20_032,
)  # 1,024 is a power of the fanout of 32, 20,032 a multiple, the others neither
seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25)

# Compiled, which is quicker even for a single use than one operation after the other.
add, sample, reprioritise = map(eqx.filter_jit, (memory.add, memory.sample, memory.reprioritise))
set_leaves = eqx.filter_jit(lambda tree, leaf, value: tree.set(leaf, value))
find = eqx.filter_jit(lambda tree, mass: tree.find(mass)[0])


def tree_of(values: np.ndarray) -> SumTree:
    """A tree with these leaves, set at once."""
    return set_leaves(sum_tree(len(values)), jnp.arange(len(values)), jnp.asarray(values, jnp.float32))


def leaves_of(tree: SumTree) -> np.ndarray:
    """All leaves, the padding included."""
    return np.asarray(tree.leaves).ravel()


def integers(capacity: int, seed: int) -> np.ndarray:
    """Leaves of 0 to 39, whose sums 32-bit floats hold exactly; many are 0, the last perhaps, but never all."""
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 40, capacity) * (rng.random(capacity) < rng.choice([0.01, 0.5, 1]))
    values[rng.integers(capacity)] = rng.integers(1, 40)
    return values


# --- The tree by hand -----------------------------------------------------------------------------------------------


def test_a_tree_of_one_level() -> None:
    tree = tree_of(np.array([1, 2, 0, 3]))
    assert tree.total == 6
    # Leaf 0 holds [0, 1), leaf 1 [1, 3), leaf 2 nothing, leaf 3 [3, 6).
    assert find(tree, jnp.array([0, 0.99, 1, 2.99, 3, 5.99])).tolist() == [0, 0, 1, 1, 3, 3]


def test_a_tree_of_two_levels() -> None:
    tree = set_leaves(sum_tree(70), jnp.array([31, 32, 69]), jnp.array([2.0, 3.0, 1.0]))
    assert tree.total == 6
    # Leaf 31 holds [0, 2), leaf 32 [2, 5), leaf 69 [5, 6).
    assert find(tree, jnp.array([0, 1.99, 2, 4.99, 5, 5.99])).tolist() == [31, 31, 32, 32, 69, 69]
    tree = set_leaves(tree, jnp.array([31]), jnp.array([5.0]))
    assert tree.total == 9


@pytest.mark.parametrize(
    ("capacity", "blocks"),
    # Up to 64 blocks are the root's children. 10,000 / 32 = 312.5, and 313 / 32 = 9.8.
    [(1, [1]), (32, [1]), (33, [2]), (2048, [64]), (2049, [3, 65]), (10_000, [10, 313]), (70_000, [3, 69, 2188])],
)
def test_levels(capacity: int, blocks: list[int]) -> None:
    assert FANOUT == 32
    levels, up_to = jax.eval_shape(sum_tree(capacity)._sums)
    assert [level.shape for level in levels] == [(block, 32) for block in blocks]
    assert up_to.shape == (blocks[0],)
    assert sum_tree(capacity).total == 0


# --- The tree beside a plain array ----------------------------------------------------------------------------------


@pytest.mark.parametrize("capacity", CAPACITIES)
@few
@given(seed=seeds)
def test_sets_and_gets_like_an_array(capacity: int, seed: int) -> None:
    plain = integers(capacity, seed)
    tree = tree_of(plain)
    rng = np.random.default_rng(seed)
    for _ in range(3):
        where = rng.choice(capacity, min(8, capacity), replace=False)
        new = rng.integers(0, 40, len(where))
        plain[where] = new
        tree = set_leaves(tree, jnp.asarray(where), jnp.asarray(new, jnp.float32))
    np.testing.assert_array_equal(leaves_of(tree)[:capacity], plain)
    np.testing.assert_array_equal(leaves_of(tree)[capacity:], 0)
    assert tree.total == plain.sum()


@pytest.mark.parametrize("capacity", CAPACITIES)
@few
@given(seed=seeds)
def test_finds_like_searchsorted(capacity: int, seed: int) -> None:
    plain = integers(capacity, seed)
    ends = np.cumsum(plain)
    rng = np.random.default_rng(seed)
    # Whole numbers hit the borders between leaves, halves lie between: the last unit is left to the next test.
    mass = np.concatenate([rng.integers(0, ends[-1], 50), rng.integers(0, ends[-1], 50) - 0.5, [0, ends[-1] - 1]])
    mass = np.clip(mass, 0, ends[-1] - 1)
    found = find(tree_of(plain), jnp.asarray(mass, jnp.float32))
    np.testing.assert_array_equal(found, np.searchsorted(ends, mass, side="right"))


@pytest.mark.parametrize("capacity", CAPACITIES)
@few
@given(seed=seeds)
def test_never_draws_a_zero_leaf(capacity: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = 10.0 ** rng.uniform(-6, 3, capacity) * (rng.random(capacity) < rng.choice([0.003, 0.1, 0.9]))
    values[rng.integers(capacity)] = 10.0 ** rng.uniform(-6, 3)  # perhaps the only one
    tree = tree_of(values)
    total = np.float32(tree.total)
    borders = rng.choice(np.cumsum(values.astype(np.float32), dtype=np.float32), 50)
    around = np.concatenate([borders, np.nextafter(borders, np.float32(0)), np.nextafter(borders, np.float32(np.inf))])
    ends = [0, total, np.nextafter(total, np.float32(0)), np.nextafter(total, np.float32(np.inf)), total * (1 + 1e-5)]
    found = np.asarray(find(tree, jnp.asarray(np.concatenate([around, ends]), jnp.float32)))
    assert (found < capacity).all()
    assert (values[found] > 0).all()


@few
@given(pairs=st.lists(st.tuples(st.integers(0, 39), st.integers(1, 9)), min_size=16, max_size=16))
def test_a_leaf_named_twice_keeps_one_of_its_values(pairs: list[tuple[int, int]]) -> None:
    leaf, value = np.array(pairs).T
    tree = set_leaves(tree_of(np.full(40, 20)), jnp.asarray(leaf), jnp.asarray(value, jnp.float32))
    kept = leaves_of(tree)[:40]
    for scenario_map in range(40):
        assert kept[scenario_map] in (set(value[leaf == scenario_map]) or {20})
    assert tree.total == kept.sum()


def test_duplicates_do_not_add_up() -> None:
    # Leaf 35 is set to 2 and to 7: the tree holds one of them, not 9, and not the old 20 beside it.
    tree = set_leaves(tree_of(np.full(40, 20)), jnp.array([35, 35]), jnp.array([2.0, 7.0]))
    assert float(tree.leaves[1, 3]) in (2, 7)
    assert tree.total == 39 * 20 + tree.leaves[1, 3]


def test_values_are_found_with_their_leaves() -> None:
    leaf, value = eqx.filter_jit(SumTree.find)(tree_of(integers(1024, 0)), jnp.arange(0.0, 900.0, 7.0))
    np.testing.assert_array_equal(value, integers(1024, 0)[leaf])


def test_draws_in_proportion() -> None:
    # 100 leaves over four blocks, every fifth zero: 100,000 independent draws, chi-square on the 80 others.
    weight = np.arange(100) % 5 * (1.0 + np.arange(100) // 5)
    tree = tree_of(weight)
    mass = jax.random.uniform(jax.random.key(7), (100_000,)) * tree.total
    drawn = np.bincount(find(tree, mass), minlength=100)
    assert drawn[weight == 0].sum() == 0
    expected = weight / weight.sum() * drawn.sum()
    assert scipy.stats.chisquare(drawn[weight > 0], expected[weight > 0]).pvalue > 1e-4


# --- The replay -----------------------------------------------------------------------------------------------------

Item = dict[str, jax.Array]


def items(*numbers: float) -> Item:
    """Items with a number and a pair each."""
    number = jnp.array(numbers, jnp.float32)
    return {"number": number, "pair": jnp.stack([number, -number], axis=1)}


def replay_of(priorities: list[float], capacity: int = 8) -> Replay[Item]:
    """A replay of items 0, 1, 2, … with these priorities."""
    replay = empty_replay(jax.tree.map(lambda leaf: leaf[0], items(0)), capacity)
    replay = add(replay, items(*range(len(priorities))), len(priorities))
    return eqx.tree_at(
        lambda r: r.priorities,
        replay,
        set_leaves(replay.priorities, jnp.arange(len(priorities)), jnp.array(priorities)),
    )


def priorities_of(replay: Replay[Item]) -> list[float]:
    return leaves_of(replay.priorities)[: replay.capacity].tolist()


class Mixed(NamedTuple):
    """An item with leaves of every type and several shapes."""

    truth: jax.Array
    number: jax.Array
    grid: jax.Array
    word: jax.Array
    nothing: None = None


@few
@given(words=st.lists(st.integers(0, 2**32 - 1), min_size=18, max_size=18), truth=st.lists(st.booleans(), min_size=6))
def test_items_are_kept_to_the_bit(words: list[int], truth: list[bool]) -> None:
    some = np.array(words, np.uint32).reshape(2, 9)
    batch = Mixed(
        np.array(truth[:6]).reshape(2, 3), some[:, 0].view(np.int32), some[:, 1:7].view(np.float32).reshape(2, 3, 2),
        some[:, 7:],
    )  # fmt: skip
    ring = empty_replay(jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), batch), 4)
    assert ring.rows.shape == (4, 12)
    kept = add(add(ring, batch, 2), batch, 2).items
    assert jax.tree.structure(kept) == jax.tree.structure(batch)
    for one, leaf in zip(jax.tree.leaves(kept), jax.tree.leaves(batch), strict=True):
        other = np.concatenate([leaf, leaf])
        assert np.asarray(one).tobytes() == other.tobytes()  # NaN is kept, too, whatever its bits


def test_steps_copy_neither_the_ring_nor_the_leaves() -> None:
    # What XLA does not see to be safe in place it copies, at every step, which takes longer than learning.
    empty = empty_replay({"number": jnp.float32(0), "pair": jnp.zeros(2)}, 10_000)

    def step(replay: Replay[Item], uniform: jax.Array) -> tuple[Replay[Item], jax.Array]:
        replay = memory.add(replay, items(1), 1)
        place, batch, weight = memory.sample(replay, uniform, 0.4)
        error = weight * batch["number"] - batch["pair"].sum(axis=1)
        return memory.reprioritise(replay, place, batch["number"], 0.6, 0.01), jnp.mean(error)

    steps = jax.jit(lambda replay, draws: jax.lax.scan(step, replay, draws), donate_argnums=0)
    program = steps.lower(empty, jnp.zeros((100, 32))).compile().as_text()
    assert "s32[10000,3]" in program
    assert "f32[313,32]" in program
    assert not re.findall(r"= (?:s32\[10000,3\]|f32\[313,32\])\S* copy\(.*", program)


def test_the_ring_overwrites_the_oldest() -> None:
    replay = empty_replay({"number": jnp.float32(0), "pair": jnp.zeros(2)}, 6)
    for first in (10, 20, 30, 40):
        replay = add(replay, items(first, first + 1), 2)
    # Six places: 10 and 11 came first and have made room for 40 and 41.
    assert replay.items["number"].tolist() == [40, 41, 20, 21, 30, 31]
    assert replay.items["pair"].tolist() == [[n, -n] for n in (40, 41, 20, 21, 30, 31)]
    assert replay.added == 8


def test_new_items_get_the_highest_priority() -> None:
    replay = add(empty_replay({"number": jnp.float32(0), "pair": jnp.zeros(2)}, 8), items(1, 2), 2)
    assert priorities_of(replay) == [1, 1, 0, 0, 0, 0, 0, 0]
    # (|-8.99| + .01)^.5 = 3 and (|.15| + .01)^.5 = .4
    replay = reprioritise(replay, jnp.array([0, 1]), jnp.array([-8.99, 0.15]), alpha=0.5, floor=0.01)
    np.testing.assert_allclose(priorities_of(replay), [3, 0.4, 0, 0, 0, 0, 0, 0], rtol=1e-6)
    replay = add(replay, items(3, 4), 2)
    np.testing.assert_allclose(priorities_of(replay), [3, 0.4, 3, 3, 0, 0, 0, 0], rtol=1e-6)
    # The highest is remembered when its item has a lower one: (.24 + .01)^.5 = .5
    replay = reprioritise(replay, jnp.array([0, 2, 3]), jnp.array([0.24, 0.24, 0.24]), alpha=0.5, floor=0.01)
    replay = add(replay, items(5, 6), 2)
    np.testing.assert_allclose(priorities_of(replay), [0.5, 0.4, 0.5, 0.5, 3, 3, 0, 0], rtol=1e-6)


@pytest.mark.parametrize("count", [3, 5, 16])
def test_counts_that_do_not_divide_are_refused(count: int) -> None:
    replay = empty_replay({"number": jnp.float32(0), "pair": jnp.zeros(2)}, 8)
    with pytest.raises(ValueError, match=f"replay of 8 items cannot be filled {count} at a time"):
        add(replay, items(*range(count)), count)


def test_importance_weights() -> None:
    probability, size = jnp.array([0.25, 0.75]), jnp.int32(2)
    # N P = .5 and 1.5. β = 1: 2 and 2/3, over the largest 1 and 1/3. β = .5: √2 and √(2/3), so 1 and √(1/3) = .57735.
    np.testing.assert_allclose(importance(probability, size, 1.0), [1, 1 / 3], rtol=1e-6)
    np.testing.assert_allclose(importance(probability, size, 0.5), [1, 0.57735], rtol=1e-5)
    np.testing.assert_allclose(importance(probability, size, 0.0), [1, 1], rtol=1e-6)


def test_a_sample_is_items_at_their_places_with_their_weights() -> None:
    replay = replay_of([1.0, 3.0, 0.0, 4.0])
    # Total 8, four strata of 2; the middle of each: mass 1, 3, 5, 7. Leaf 0 holds [0, 1), 1 [1, 4), 3 [4, 8).
    scenario_map, batch, weight = sample(replay, jnp.full(4, 0.5), 1.0)
    assert scenario_map.tolist() == [1, 1, 3, 3]
    assert batch["number"].tolist() == [1, 1, 3, 3]
    assert batch["pair"].tolist() == [[1, -1], [1, -1], [3, -3], [3, -3]]
    # Weights are in proportion to 1 / 3, 1 / 3, 1 / 4, 1 / 4.
    np.testing.assert_allclose(weight, [1, 1, 0.75, 0.75], rtol=1e-6)
    # The beginnings of the strata, mass 0, 2, 4, 6: weights as 1 / 1, 1 / 3, 1 / 4, 1 / 4, to the power of β = .5.
    scenario_map, _, weight = sample(replay, jnp.zeros(4), 0.5)
    assert scenario_map.tolist() == [0, 1, 3, 3]
    np.testing.assert_allclose(weight, [1, 3**-0.5, 0.5, 0.5], rtol=1e-6)


def test_samples_are_stratified_and_in_proportion() -> None:
    priorities = [1.0, 2.0, 0.0, 4.0, 8.0, 3.0, 5.0, 9.0]
    share = np.array(priorities) / 32
    uniform = jax.random.uniform(jax.random.key(3), (500, 64))
    replay = replay_of(priorities)
    places = jax.jit(jax.vmap(lambda row: memory.sample(replay, row, 1.0)[0]))(uniform)
    drawn = np.stack([np.bincount(row, minlength=8) for row in np.asarray(places)])
    # A leaf covers whole strata, each drawn once, and parts of two at most: never two off its share in a batch.
    assert (np.abs(drawn - 64 * share) < 2).all()
    # Each of 500 batches is off by a standard deviation of at most √½; their mean by 0.032.
    np.testing.assert_allclose(drawn.mean(axis=0), 64 * share, atol=5 * 0.032)


def test_alpha_zero_is_uniform_replay() -> None:
    replay = replay_of([1.0] * 8)
    replay = reprioritise(replay, jnp.arange(4), jnp.array([0.0, 1e-3, 7.0, -900.0]), alpha=0.0, floor=0.01)
    replay = add(replay, items(10, 11), 2)
    assert priorities_of(replay) == [1] * 8
    scenario_map, _, weight = sample(replay, jnp.full(8, 0.5), 1.0)
    assert scenario_map.tolist() == list(range(8))
    assert weight.tolist() == [1] * 8


def test_places_never_filled_are_never_drawn() -> None:
    replay = replay_of([2.0, 1.0], capacity=1000)
    uniform = jnp.linspace(0, 1, 300).reshape(3, 100)  # 1 itself is included: the mass is then the total
    drawn = Counter(np.concatenate([np.asarray(sample(replay, row, 1.0)[0]) for row in uniform]).tolist())
    assert set(drawn) == {0, 1}


def test_survives_flattening_and_jit() -> None:
    replay = replay_of([1.0, 3.0, 2.0, 4.0])
    leaves, structure = jax.tree.flatten(replay)
    again = jax.tree.unflatten(structure, [jnp.asarray(np.asarray(leaf)) for leaf in leaves])
    compiled = jax.jit(lambda r: r)(replay)
    for other in (again, compiled):
        assert eqx.tree_equal(other, replay)
        assert other.capacity == 8
    # What is added and drawn afterwards is the same too.
    uniform = jnp.linspace(0, 0.99, 16)
    for other in (again, compiled):
        assert eqx.tree_equal(add(other, items(7, 8, 9, 10), 4), add(replay, items(7, 8, 9, 10), 4))
        assert eqx.tree_equal(sample(other, uniform, 0.4), sample(replay, uniform, 0.4))
