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
    origins=jnp.array([[2, 3, 5, 7, 11], [2, 3, 5, 7, 11]]),
    destinations=jnp.array([[13] * 5, [17] * 5]),
    departures=jnp.array([600.0, 900.0]),
    futures=jnp.array(4),
)
sample = partial(jax.jit(InstanceSampler.sample), SAMPLER)


def test_by_hand() -> None:
    # .5 * 5 = 2.5: the third origin; .5 * 2 = 1: the second goal; 600 + .25 * 300 = 675;
    # of its two crowds, 1 and 3, number .7 * 2 = 1.4: crowd 3
    one = sample(jnp.array([0.5, 0.5, 0.25, 0.7]))
    assert (int(one.origin), int(one.destination), float(one.departure), int(one.future)) == (5, 17, 675, 3)


def test_the_ends_of_the_unit_interval() -> None:
    first, last = sample(jnp.zeros(DRAWS)), sample(jnp.full(DRAWS, ALMOST_ONE))
    assert (int(first.origin), int(first.destination), float(first.departure), int(first.future)) == (2, 13, 600, 0)
    assert (int(last.origin), int(last.destination), int(last.future)) == (11, 17, 3)
    assert float(last.departure) == pytest.approx(900)


@pytest.mark.parametrize("count", [1, 7, 1000, 99_999])
def test_no_rounding_leads_beyond_the_last_crowd(count: int) -> None:
    one = InstanceSampler(SAMPLER.origins, SAMPLER.destinations, SAMPLER.departures, jnp.array(count)).sample(
        jnp.full(DRAWS, ALMOST_ONE)
    )
    # The last goal there are crowds for is 1, or 0 where there is but one; its crowds have the last odd number.
    assert int(one.future) == (0 if count == 1 else count - 1 - count % 2)


uniforms = st.floats(0, 1, exclude_max=True, allow_subnormal=False, width=32)


@given(st.lists(uniforms, min_size=DRAWS, max_size=DRAWS))
def test_everything_drawn_is_possible(uniform: list[float]) -> None:
    one = sample(jnp.array(uniform, jnp.float32))
    assert int(one.origin) in {2, 3, 5, 7, 11}
    assert int(one.destination) in {13, 17}
    assert 600 <= float(one.departure) <= 900
    assert 0 <= int(one.future) < 4


def draw_many(count: int) -> Instance:
    uniform = jnp.asarray(np.random.default_rng(2).random((count, DRAWS)), jnp.float32)
    return jax.vmap(SAMPLER.sample)(uniform)


def test_draws_are_uniform() -> None:
    many = draw_many(20_000)
    assert chisquare(np.unique(many.origin, return_counts=True)[1]).pvalue > 0.01
    assert chisquare(np.unique(many.destination, return_counts=True)[1]).pvalue > 0.01
    assert chisquare(np.unique(many.future, return_counts=True)[1]).pvalue > 0.01
    assert kstest((np.asarray(many.departure, np.float64) - 600) / 300, "uniform").pvalue > 0.01


def test_draws_are_independent() -> None:
    many = draw_many(20_000)
    drawn = [many.origin, many.destination, many.departure, many.future]
    correlation = np.corrcoef(np.stack([np.asarray(each, np.float64) for each in drawn]))
    # Goal 0 has crowds 0 and 2, goal 1 has 1 and 3: a covariance of 1/4 with standard deviations of 1/2 and
    # sqrt(5/4): .447. Standard error 1 / sqrt(20,000) = .007.
    by_hand = np.eye(4)
    by_hand[1, 3] = by_hand[3, 1] = 1 / np.sqrt(5)
    np.testing.assert_allclose(correlation, by_hand, atol=0.03)


# --- Goals and their crowds -----------------------------------------------------------------------------------------


def goals(futures: int) -> InstanceSampler:
    """Three goals, of which the second begins elsewhere and ends at one of two nodes."""
    return InstanceSampler(
        origins=jnp.array([[1, 2], [3, 4], [1, 2]]),
        destinations=jnp.array([[9, 9], [7, 8], [6, 6]]),
        departures=jnp.zeros(2),
        futures=jnp.array(futures),
    )


def draw_goals(futures: int) -> list[tuple[int, int, int]]:
    uniform = jnp.asarray(np.random.default_rng(3).random((500, DRAWS)), jnp.float32)
    many = jax.vmap(goals(futures).sample)(uniform)
    return list(zip(many.origin.tolist(), many.destination.tolist(), many.future.tolist(), strict=True))


def test_an_origin_has_its_own_destination() -> None:
    assert {(origin, end) for origin, end, _ in draw_goals(7)} == {(1, 9), (2, 9), (3, 7), (4, 8), (1, 6), (2, 6)}


def test_crowds_go_round_the_goals() -> None:
    # Crowd c is for goal c modulo 3: of seven, 0, 3 and 6 for the first, 1 and 4, 2 and 5 for the others.
    found: dict[int, set[int]] = {}
    for _, end, future in draw_goals(7):
        found.setdefault({9: 0, 7: 1, 8: 1, 6: 2}[end], set()).add(future)
    assert found == {0: {0, 3, 6}, 1: {1, 4}, 2: {2, 5}}


def test_goals_without_a_crowd_are_not_walked_to() -> None:
    assert {(end, future) for _, end, future in draw_goals(2)} == {(9, 0), (7, 1), (8, 1)}
    assert {(end, future) for _, end, future in draw_goals(1)} == {(9, 0)}


def test_goals_and_the_crowds_of_one_are_drawn_equally_often() -> None:
    drawn = draw_goals(6)  # crowds 0 and 3, 1 and 4, 2 and 5
    assert chisquare(np.bincount([future for *_, future in drawn])).pvalue > 0.01
