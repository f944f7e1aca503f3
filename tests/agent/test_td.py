"""Temporal-difference errors by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from sidestep.agent.td import mask, q_learning

Q_TM1 = jnp.array([1.0, 2.0, 3.0, 4.0])
Q_T = jnp.array([4.0, 5.0, 6.0, 90.0])
SELECTOR_T = jnp.array([9.0, 1.0, 2.0, 50.0])
VALID_T = jnp.array([True, True, False, False])
A_TM1, R_T = jnp.int32(1), jnp.float32(0.5)


def test_mask() -> None:
    assert mask(Q_T, VALID_T).tolist() == [4, 5, -np.inf, -np.inf]


def test_q_learning() -> None:
    # .5 + .9 * 5 - 2 = 3: the 6 and the 90 belong to exits that do not exist
    td_error = q_learning(Q_TM1, A_TM1, R_T, jnp.float32(0.9), Q_T, Q_T, VALID_T)
    np.testing.assert_allclose(td_error, 3, rtol=1e-6)
    # With all exits .5 + .9 * 90 - 2 = 79.5
    td_error = q_learning(Q_TM1, A_TM1, R_T, jnp.float32(0.9), Q_T, Q_T, VALID_T | True)
    np.testing.assert_allclose(td_error, 79.5, rtol=1e-6)


def test_double_q_learning() -> None:
    # The selector's best valid exit is 0, where the target network says 4: .5 + .9 * 4 - 2 = 2.1, not the single 3.
    td_error = q_learning(Q_TM1, A_TM1, R_T, jnp.float32(0.9), Q_T, SELECTOR_T, VALID_T)
    np.testing.assert_allclose(td_error, 2.1, rtol=1e-6)
    # With all exits the selector takes exit 3: .5 + .9 * 90 - 2 = 79.5
    td_error = q_learning(Q_TM1, A_TM1, R_T, jnp.float32(0.9), Q_T, SELECTOR_T, VALID_T | True)
    np.testing.assert_allclose(td_error, 79.5, rtol=1e-6)


@pytest.mark.parametrize("action", range(4))
def test_after_the_end_only_the_reward_counts(action: int) -> None:
    end, a_tm1 = jnp.float32(0), jnp.int32(action)
    # .5 - (1 + action)
    assert q_learning(Q_TM1, a_tm1, R_T, end, Q_T, Q_T, VALID_T) == -0.5 - action
    assert q_learning(Q_TM1, a_tm1, R_T, end, Q_T, SELECTOR_T, VALID_T) == -0.5 - action


numbers = st.floats(-100, 100, width=32)
fours = st.lists(numbers, min_size=4, max_size=4)
exits = st.lists(st.booleans(), min_size=4, max_size=4).filter(any)
double = jax.jit(q_learning)


@jax.jit
def single(
    q_tm1: jax.Array, a_tm1: jax.Array, r_t: jax.Array, discount_t: jax.Array, q_t: jax.Array, valid_t: jax.Array
) -> jax.Array:
    """As printed (eqs. 16 and 17): the maximum of the target network's values."""
    largest = jnp.max(mask(q_t, valid_t))
    return r_t + jnp.where(discount_t > 0, discount_t * largest, 0.0) - q_tm1[a_tm1]


@settings(max_examples=100)
@given(q_t=fours, selector_t=fours, valid_t=exits, noise=fours)
def test_double_is_at_most_single_and_ignores_missing_exits(
    q_t: list[float], selector_t: list[float], valid_t: list[bool], noise: list[float]
) -> None:
    valid, target, selector = jnp.array(valid_t), jnp.array(q_t), jnp.array(selector_t)
    shared = (Q_TM1, A_TM1, R_T, jnp.float32(0.9))
    one, two = single(*shared, target, valid), double(*shared, target, selector, valid)
    assert two <= one + 1e-4
    assert abs(double(*shared, target, target, valid) - one) < 1e-4  # who selects for himself gets the maximum
    garbage = jnp.array(noise)
    garbled = jnp.where(valid, target, garbage)
    assert double(*shared, garbled, garbled, valid) == double(*shared, target, target, valid)
    assert double(*shared, jnp.where(valid, target, garbage), jnp.where(valid, selector, garbage), valid) == two


@settings(max_examples=50)
@given(q_t=fours, shift=st.floats(1, 50, width=32))
def test_double_differs_where_selector_and_target_disagree(q_t: list[float], shift: float) -> None:
    best = int(np.argmax(q_t))
    other = (best + 1) % 4
    assume(q_t[best] - q_t[other] > 1)
    selector = jnp.array(q_t).at[other].set(q_t[best] + shift)
    shared = (Q_TM1, A_TM1, R_T, jnp.float32(0.5))
    everywhere = jnp.ones(4, bool)
    # Single takes the maximum, double what the selector prefers: half their difference lies between.
    lost = single(*shared, jnp.array(q_t), everywhere) - double(*shared, jnp.array(q_t), selector, everywhere)
    np.testing.assert_allclose(lost, 0.5 * (q_t[best] - q_t[other]), rtol=1e-4, atol=1e-4)


def test_vmap_equals_a_loop() -> None:
    rng = np.random.default_rng(0)
    q_tm1, q_t, selector_t = (jnp.asarray(rng.normal(size=(20, 4)), jnp.float32) for _ in range(3))
    a_tm1, r_t = jnp.asarray(rng.integers(4, size=20)), jnp.asarray(rng.normal(size=20), jnp.float32)
    discount_t = jnp.asarray(rng.choice([0, 0.95], 20), jnp.float32)
    valid_t = jnp.asarray(rng.random((20, 4)) < 0.6).at[:, 0].set(True)
    batch = (q_tm1, a_tm1, r_t, discount_t, q_t)
    for chooses in (q_t, selector_t):
        looped = [q_learning(*(leaf[i] for leaf in batch), chooses[i], valid_t[i]) for i in range(20)]
        np.testing.assert_allclose(jax.vmap(q_learning)(*batch, chooses, valid_t), looped, rtol=1e-6, atol=1e-6)


def test_a_destination_without_exits_ends_the_episode_all_the_same() -> None:
    # r - Q = -3 - 2 = -5; the next state's values must not turn 0 times minus infinity into NaN
    nowhere = jnp.zeros(2, bool)
    q_tm1, nothing = jnp.array([2.0, 7.0]), jnp.zeros(2)
    common = (q_tm1, jnp.int32(0), jnp.float32(-3), jnp.float32(0))
    for q_t in (nothing, nothing - jnp.inf):
        assert float(q_learning(*common, q_t, nothing, nowhere)) == -5
