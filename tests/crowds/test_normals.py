"""Normal numbers are those of JAX, to the bit."""

import jax
import numpy as np
import pytest

from sidestep.crowds.normals import standard_normal

SHAPE = (7, 3, 5)


@pytest.mark.parametrize("seed", [0, 3, 2**31])
def test_numbers_are_those_of_jax(seed: int) -> None:
    key = jax.random.fold_in(jax.random.key(seed), 1)
    np.testing.assert_array_equal(standard_normal(key, SHAPE), jax.random.normal(key, SHAPE))


def test_several_keys_at_once() -> None:
    keys = jax.random.split(jax.random.key(4), 2)
    own, theirs = (
        jax.vmap(lambda key, draw=draw: draw(key, SHAPE))(keys) for draw in (standard_normal, jax.random.normal)
    )
    np.testing.assert_array_equal(own, theirs)


def test_other_generators_are_left_to_jax() -> None:
    key = jax.random.key(0, impl="rbg")
    np.testing.assert_array_equal(standard_normal(key, SHAPE), jax.random.normal(key, SHAPE))
