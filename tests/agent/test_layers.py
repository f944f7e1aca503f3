"""Layers, and the dueling head (eq. 20) by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.agent.layers import Linear, combine, through, uniform_layers, zero_ended_layers

# --- The head (eq. 20) ----------------------------------------------------------------------------------------------


def test_combine() -> None:
    advantage = jnp.array([1.0, 3.0, 8.0, 100.0])
    two = jnp.array([True, True, False, False])
    # Two valid exits: mean (1 + 3) / 2 = 2, so Q = 5 + 1 - 2 and 5 + 3 - 2; the 8 and the 100 do not count.
    assert combine(jnp.float32(5), advantage, two)[:2].tolist() == [4, 6]
    # Three: mean (1 + 3 + 8) / 3 = 4.
    assert combine(jnp.float32(5), advantage, two.at[2].set(True))[:3].tolist() == [2, 4, 9]
    # All four: mean 112 / 4 = 28.
    assert combine(jnp.float32(5), advantage, two | True).tolist() == [-22, -20, -15, 77]
    # One: nothing is left of the advantage.
    assert combine(jnp.float32(5), advantage, jnp.array([False, False, True, False]))[2] == 5


numbers = st.floats(-100, 100, width=32)


@settings(max_examples=200)
@given(
    value=numbers,
    advantage=st.lists(numbers, min_size=4, max_size=4),
    valid=st.lists(st.booleans(), min_size=4, max_size=4).filter(any),
)
def test_the_mean_over_valid_exits_is_the_value(value: float, advantage: list[float], valid: list[bool]) -> None:
    q = np.asarray(combine(jnp.float32(value), jnp.array(advantage), jnp.array(valid)))[valid]
    np.testing.assert_allclose(q.mean(), value, atol=1e-3)
    # and differences between exits are those of the advantage
    np.testing.assert_allclose(q - q[0], np.array(advantage)[valid] - np.array(advantage)[valid][0], atol=1e-3)


def test_a_node_without_exits_has_a_value_all_the_same() -> None:
    q = combine(jnp.float32(2.0), jnp.array([1.0, 3.0]), jnp.zeros(2, bool))
    assert q.tolist() == [3.0, 5.0]


# --- Layers ---------------------------------------------------------------------------------------------------------


def test_layers_by_hand() -> None:
    first = Linear(jnp.array([[1.0, 2.0], [-1.0, 0.0]]), jnp.array([0.5, 1.0]))
    last = Linear(jnp.array([[2.0, 3.0]]), jnp.array([-1.0]))
    # (1, 2): 1 + 4 + .5 = 5.5 and -1 + 1 = 0; 2 * 5.5 - 1 = 10. (-3, 0): -2.5, which ReLU makes 0, and 4; 12 - 1 = 11.
    assert through((first, last), jnp.array([[1.0, 2.0], [-3.0, 0.0]])).tolist() == [[10.0], [11.0]]
    assert first(jnp.array([1.0, 2.0])).tolist() == [5.5, 0.0]


def test_the_last_layer_begins_at_zero() -> None:
    first, middle, last = zero_ended_layers((3, 5, 4, 2), jax.random.key(0))
    assert [layer.weight.shape for layer in (first, middle, last)] == [(5, 3), (4, 5), (2, 4)]
    assert not last.weight.any()
    for layer in (first, middle, last):
        assert not layer.bias.any()
    for layer, fan_in in ((first, 3), (middle, 5)):
        assert 0 < float(jnp.abs(layer.weight).max()) <= fan_in**-0.5
    assert not np.allclose(first.weight[:4, 0], middle.weight[:, 0])


@pytest.mark.parametrize("shapes", [[(3, 5)], [(2, 50), (50, 50), (50, 1)]])
def test_layers_are_uniform_in_what_their_inputs_allow(shapes: list[tuple[int, int]]) -> None:
    for layer, (fan_in, fan_out) in zip(uniform_layers(shapes, jax.random.key(1)), shapes, strict=True):
        assert layer.weight.shape == (fan_out, fan_in)
        both = np.concatenate([np.asarray(layer.weight).ravel(), np.asarray(layer.bias)])
        assert np.abs(both).max() <= fan_in**-0.5
        assert len(np.unique(both)) == both.size
