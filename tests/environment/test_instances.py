"""What the sampler draws."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare, kstest

from sidestep.environment.instances import DRAWS, InstanceSampler
from sidestep.environment.types import Instance

ALMOST_ONE = float(np.nextafter(np.float32(1), np.float32(0)))
SAMPLER = InstanceSampler(
    origins=jnp.array([2, 3, 5, 7, 11]),
    destinations=jnp.array([13, 17]),
    departures=jnp.array([600.0, 900.0]),
    crowds=jnp.array(3),
)
sample = partial(jax.jit(InstanceSampler.sample), SAMPLER)


def test_by_hand() -> None:
    # .5 * 5 = 2.5: the third origin; .5 * 2 = 1: the second destination; 600 + .25 * 300 = 675; .7 * 3 = 2.1: crowd 2
    one = sample(jnp.array([0.5, 0.5, 0.25, 0.7]))
    assert (int(one.origin), int(one.destination), float(one.departure), int(one.crowd)) == (5, 17, 675, 2)


def test_the_ends_of_the_unit_interval() -> None:
    first, last = sample(jnp.zeros(DRAWS)), sample(jnp.full(DRAWS, ALMOST_ONE))
    assert (int(first.origin), int(first.destination), float(first.departure), int(first.crowd)) == (2, 13, 600, 0)
    assert (int(last.origin), int(last.destination), int(last.crowd)) == (11, 17, 2)
    assert float(last.departure) == pytest.approx(900)


@pytest.mark.parametrize("count", [1, 7, 1000, 99_999])
def test_no_rounding_leads_beyond_the_last_crowd(count: int) -> None:
    one = InstanceSampler(SAMPLER.origins, SAMPLER.destinations, SAMPLER.departures, jnp.array(count)).sample(
        jnp.full(DRAWS, ALMOST_ONE)
    )
    assert int(one.crowd) == count - 1


uniforms = st.floats(0, 1, exclude_max=True, allow_subnormal=False, width=32)


@given(st.lists(uniforms, min_size=DRAWS, max_size=DRAWS))
def test_everything_drawn_is_possible(uniform: list[float]) -> None:
    one = sample(jnp.array(uniform, jnp.float32))
    assert int(one.origin) in {2, 3, 5, 7, 11}
    assert int(one.destination) in {13, 17}
    assert 600 <= float(one.departure) <= 900
    assert 0 <= int(one.crowd) < 3


def draw_many(count: int) -> Instance:
    uniform = jnp.asarray(np.random.default_rng(2).random((count, DRAWS)), jnp.float32)
    return jax.vmap(SAMPLER.sample)(uniform)


def test_draws_are_uniform() -> None:
    many = draw_many(20_000)
    assert chisquare(np.unique(many.origin, return_counts=True)[1]).pvalue > 0.01
    assert chisquare(np.unique(many.destination, return_counts=True)[1]).pvalue > 0.01
    assert chisquare(np.unique(many.crowd, return_counts=True)[1]).pvalue > 0.01
    assert kstest((np.asarray(many.departure, np.float64) - 600) / 300, "uniform").pvalue > 0.01


def test_draws_are_independent() -> None:
    many = draw_many(20_000)
    drawn = [many.origin, many.destination, many.departure, many.crowd]
    correlation = np.corrcoef(np.stack([np.asarray(each, np.float64) for each in drawn]))
    # standard error 1 / sqrt(20,000) = .007
    np.testing.assert_allclose(correlation, np.eye(4), atol=0.03)
