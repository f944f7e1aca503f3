"""One step by hand (eq. 13 as corrected), its ends, its choices of exits, and its purity."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from sidestep.environment.dynamics import existing_exit, random_exit, reset, step
from sidestep.environment.observation import observe
from sidestep.environment.types import RECENT_NODES, EnvParams, EnvState, Instance, Outcome, RewardWeights
from sidestep.walking.crossing_time import crossing_time
from sidestep.walking.speed_field import speed_field


def take(params: EnvParams, instance: Instance, *actions: int) -> tuple[EnvState, Outcome]:
    """The last state and outcome of some steps."""
    state, _ = reset(params, instance)
    for action in actions:
        state, outcome = step(params, state, jnp.int32(action))
    return state, outcome


@pytest.fixture(scope="module")
def steady(diamond, constant_field, make_params) -> EnvParams:
    """The diamond at 1 m/s: metres are seconds."""
    return make_params(diamond, constant_field(diamond))


@pytest.fixture(scope="module")
def busy(make_busy) -> EnvParams:
    return make_busy(horizon=3000)


# --- By hand --------------------------------------------------------------------------------------------------------


def test_reset(steady, make_instance) -> None:
    state, seen = reset(steady, make_instance(origin=1, departure=70.0))
    assert (int(state.node), float(state.clock)) == (1, 70)
    assert state.recent_nodes.tolist() == [-1] * RECENT_NODES
    assert (int(seen.node), seen.position.tolist(), seen.valid.tolist()) == (1, [100, 100], [True, True])


def test_a_step_moves_in_space_and_time(steady, make_instance) -> None:
    state, outcome = take(steady, make_instance(departure=50.0), 0)
    assert (int(state.node), float(state.clock), float(outcome.crossed.seconds)) == (1, 150, 100)
    assert (int(outcome.observation.node), outcome.observation.position.tolist()) == (1, [100, 100])
    assert not outcome.terminated
    assert not outcome.truncated
    # the other way: 150 m down, then exit 0 of node 2 for 250 m
    state, outcome = take(steady, make_instance(departure=50.0), 1, 0)
    assert (int(state.node), float(state.clock), float(outcome.crossed.seconds)) == (3, 450, 250)


def test_the_trail_is_what_was_left_the_latest_first(steady, make_instance) -> None:
    # 0 > 1 > 0 > 2 > 0 > ...: exits 0 and 1 of node 0 lead to 1 and 2, and both have a way back as exit 1
    state, _ = take(steady, make_instance(), 0, 1, 1, 1)
    assert state.recent_nodes.tolist() == [2, 0, 1, 0] + [-1] * (RECENT_NODES - 4)
    # no more than the last ones are remembered: after ten steps, the nodes left at steps 10 to 3
    state, _ = take(steady, make_instance(), *[0, 1, 1, 1] * 2, 0, 1)
    assert state.recent_nodes.tolist() == [1, 0, 2, 0, 1, 0, 2, 0][:RECENT_NODES]


def test_reward_of_a_step_ahead(steady, make_instance) -> None:
    # 0 > 1: 100 s are 1.666667 min; straight lines to node 3 are 200 and sqrt(2) 100 = 141.421356 m:
    # -1.666667 + .001 * 58.578644 = -1.608088
    assert float(take(steady, make_instance(), 0)[1].reward) == pytest.approx(-1.608088, abs=1e-6)


def test_reward_of_arriving_has_the_bonus(steady, make_instance) -> None:
    # 1 > 3: 200 s are 3.333333 min: -3.333333 + .001 * 141.421356 + 1 = -2.191912
    assert float(take(steady, make_instance(), 0, 0)[1].reward) == pytest.approx(-2.191912, abs=1e-6)


def test_walking_away_is_punished(steady, make_instance) -> None:
    # 1 > 0: -1.666667 - .058579 = -1.725245; the paper's sign would give -1.608088
    assert float(take(steady, make_instance(), 0, 1)[1].reward) == pytest.approx(-1.725245, abs=1e-6)


def test_progress_there_and_back_cancels(steady, make_instance) -> None:
    there, back = (float(take(steady, make_instance(), *way)[1].reward) for way in ([1], [1, 1]))
    assert there + back == pytest.approx(-300 / 60, abs=1e-6)


def test_reward_weights(diamond, constant_field, make_params, make_instance) -> None:
    params = make_params(diamond, constant_field(diamond))
    params = EnvParams(
        params.network,
        params.futures,
        params.expected,
        params.horizon,
        RewardWeights(unit_seconds=10.0, progress=0.1, bonus=7.0),
    )
    # -200 / 10 + .1 * 141.421356 + 7 = 1.142136
    assert float(take(params, make_instance(origin=1), 0)[1].reward) == pytest.approx(1.142136, abs=1e-5)


def test_time_passes_at_the_speed_of_the_walks_own_crowd(diamond, make_params, make_instance) -> None:
    slow_then_fast = jnp.stack([jnp.full((8, 2), 1.0), jnp.full((8, 2), 2.0).at[0, 1].set(0.5)])
    params = make_params(diamond, speed_field(slow_then_fast, 40.0))
    assert float(take(params, make_instance(future=0), 0)[1].crossed.seconds) == pytest.approx(100)
    # crowd 1: 40 s at 2 m/s for 80 m, then 20 m at .5 m/s for 40 s
    assert float(take(params, make_instance(future=1), 0)[1].crossed.seconds) == pytest.approx(80)
    # under the entry rule 100 m at 2 m/s
    entry = make_params(diamond, speed_field(slow_then_fast, 40.0), rule="entry")
    assert float(take(entry, make_instance(future=1), 0)[1].crossed.seconds) == pytest.approx(50)


# --- How episodes end -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("horizon", [1e5, 300.0, 299.0, 100.5])
def test_arriving_terminates_even_at_or_after_the_horizon(
    diamond, constant_field, make_params, make_instance, horizon: float
) -> None:
    params = make_params(diamond, constant_field(diamond), horizon=horizon)
    # 0 > 1 > 3 takes 100 + 200 s; after the first step no horizon above 100 s is over
    _, before = take(params, make_instance(departure=1000.0), 0)
    assert (bool(before.terminated), bool(before.truncated)) == (False, False)
    _, outcome = take(params, make_instance(departure=1000.0), 0, 0)
    assert (bool(outcome.terminated), bool(outcome.truncated)) == (True, False)


@pytest.mark.parametrize(("horizon", "truncated"), [(100.0, True), (99.0, True), (100.5, False)])
def test_not_arriving_truncates_from_the_horizon_on(
    diamond, constant_field, make_params, make_instance, horizon: float, truncated: bool
) -> None:
    params = make_params(diamond, constant_field(diamond), horizon=horizon)
    _, outcome = take(params, make_instance(departure=1000.0), 0)
    assert (bool(outcome.terminated), bool(outcome.truncated)) == (False, truncated)


# --- Exits ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("node", "action", "leads_to"),
    [
        # lower left: up and right exist; 1 (down) becomes 2 (right), 3 (left) goes round to 0 (up)
        (0, 0, 3),
        (0, 1, 1),
        (0, 2, 1),
        (0, 3, 3),
        # lower right: up and left exist; 1 and 2 become 3
        (2, 1, 1),
        (2, 2, 1),
        (2, 0, 5),
        # upper right as an origin: down and left exist
        (8, 0, 5),
        (8, 2, 7),
        # inside all exist
        (4, 0, 7),
        (4, 1, 1),
        (4, 2, 5),
        (4, 3, 3),
    ],
)
def test_an_exit_that_does_not_exist_becomes_the_next(
    busy, make_instance, node: int, action: int, leads_to: int
) -> None:
    state, outcome = take(busy, make_instance(origin=node, destination=6), action)
    assert int(state.node) == leads_to
    # and it is the street to there that takes its time
    (segment,) = np.flatnonzero((busy.network.tail == node) & (busy.network.head == leads_to))
    row = busy.futures.speeds.row(jnp.int32(0), jnp.int32(segment))
    there = crossing_time(row, busy.network.length[segment], jnp.float32(0))
    assert float(outcome.crossed.seconds) == pytest.approx(float(there), rel=1e-6)


some_exits = st.lists(st.booleans(), min_size=5, max_size=5).filter(any)
choose_existing, choose_random = jax.jit(existing_exit), jax.jit(random_exit)


@given(some_exits, st.integers(0, 4))
def test_existing_exit_is_the_first_one_round(valid: list[bool], action: int) -> None:
    expected = next(way % 5 for way in range(action, action + 5) if valid[way % 5])
    assert int(choose_existing(jnp.array(valid), jnp.int32(action))) == expected


@given(some_exits, st.floats(0, 1, exclude_max=True, allow_subnormal=False, width=32))
def test_a_random_exit_always_exists(valid: list[bool], uniform: float) -> None:
    assert valid[int(choose_random(jnp.array(valid), jnp.float32(uniform)))]


@pytest.mark.parametrize("valid", [[1, 1, 1, 1, 1], [0, 1, 0, 1, 1], [1, 0, 0, 0, 1]])
def test_a_random_exit_is_uniform(valid: list[int]) -> None:
    draws = jnp.asarray(np.random.default_rng(1).random(20_000), jnp.float32)
    exits = jax.vmap(random_exit, in_axes=(None, 0))(jnp.array(valid, bool), draws)
    counts = np.bincount(exits, minlength=5)
    assert counts[np.array(valid) == 0].sum() == 0
    assert chisquare(counts[np.array(valid) == 1]).pvalue > 0.01


def test_the_only_exit_is_taken() -> None:
    only = jnp.array([False, False, True, False])
    assert set(jax.vmap(random_exit, in_axes=(None, 0))(only, jnp.linspace(0, 0.999, 7)).tolist()) == {2}


@pytest.mark.parametrize("uniform", [0.0, float(np.nextafter(np.float32(1), np.float32(0)))])
def test_the_ends_of_the_unit_interval(uniform: float) -> None:
    valid = jnp.array([False, True, True, False])
    assert int(random_exit(valid, jnp.float32(uniform))) == (1 if uniform == 0 else 2)


# --- Compiled, side by side, pure -----------------------------------------------------------------------------------


def batch() -> tuple[EnvState, jax.Array]:
    """Every node and action, at various clocks, in both crowds."""
    node, action = (jnp.asarray(each.ravel(), jnp.int32) for each in np.mgrid[:9, :4])
    clock = jnp.linspace(0, 1500, 36)
    instance = Instance(node, jnp.full(36, 8, jnp.int32), clock, (node + action) % 2)
    return jax.vmap(EnvState)(node, clock, instance, jnp.full((36, RECENT_NODES), -1), jnp.zeros(36, int)), action


def test_jit_and_vmap_agree_with_plain_calls(busy) -> None:
    states, actions = batch()
    together = jax.jit(jax.vmap(step, in_axes=(None, 0, 0)))(busy, states, actions)
    for i in range(0, 36, 5):
        state, action = jax.tree.map(lambda leaf, i=i: leaf[i], (states, actions))
        plain = step(busy, state, action)
        compiled = jax.jit(step)(busy, state, action)
        for one, other, several in zip(*map(jax.tree.leaves, (plain, compiled, together)), strict=True):
            np.testing.assert_allclose(other, one, rtol=1e-5)
            np.testing.assert_allclose(several[i], one, rtol=1e-5)


def test_stepping_has_no_effects(busy, make_instance) -> None:
    state, _ = reset(busy, make_instance(destination=8))
    before = jax.tree.map(np.array, (busy, state))
    first, second = (step(busy, state, jnp.int32(2)) for _ in range(2))
    for one, other in zip(*map(jax.tree.leaves, (first, second)), strict=True):
        assert one.tolist() == other.tolist()
    for one, other in zip(*map(jax.tree.leaves, (before, (busy, state))), strict=True):
        assert one.tolist() == other.tolist()
    assert not jax.make_jaxpr(step)(busy, state, jnp.int32(2)).effects


def test_a_second_step_is_not_traced_again(busy, make_instance) -> None:
    traces = 0

    @jax.jit
    def counted(params: EnvParams, state: EnvState, action: jax.Array) -> tuple[EnvState, Outcome]:
        nonlocal traces
        traces += 1
        return step(params, state, action)

    state, _ = reset(busy, make_instance(destination=8))
    for action in (0, 2, 3, 1):
        state, _ = counted(busy, state, jnp.int32(action))
    elsewhere, _ = reset(busy, make_instance(origin=4, destination=6, departure=33.0, future=1))
    counted(busy, elsewhere, jnp.int32(2))
    assert traces == 1


def test_observing_again_gives_what_the_step_gave(busy, make_instance) -> None:
    state, outcome = take(busy, make_instance(destination=8), 2)
    seen = observe(busy, state)
    assert seen.valid.tolist() == outcome.observation.valid.tolist() == [True, False, True, True]
    assert seen.position.tolist() == outcome.observation.position.tolist() == [550, 0]
