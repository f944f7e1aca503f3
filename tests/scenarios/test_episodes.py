"""Which walks are walked, in turn and at random."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare, kstest

from sidestep.environment.types import EnvParams, Instance
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import (
    DRAWS,
    InstanceSampler,
    destinations_of,
    instances,
    sampler,
    standard_destinations,
)
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import ScenarioMap, draw_map, draw_training_map
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.spec import ScenarioError

ALMOST_ONE = float(np.nextafter(np.float32(1), np.float32(0)))
SAMPLER = InstanceSampler(
    origins=jnp.array([[2, 3, 5, 7, 11], [2, 3, 5, 7, 11]]),
    destinations=jnp.array([[13] * 5, [17] * 5]),
    departures=jnp.array([600.0, 900.0]),
    futures=jnp.array([[0, 2, 1, 3], [1, 3, 0, 2]]),
    counts=jnp.array([2, 2]),
)
sample = partial(jax.jit(InstanceSampler.sample), SAMPLER)
sample_all = jax.jit(jax.vmap(InstanceSampler.sample, in_axes=(None, 0)))


def test_by_hand() -> None:
    # .5 * 5 = 2.5: the third origin; .5 * 2 = 1: the second destination; 600 + .25 * 300 = 675;
    # of its two futures, 1 and 3, number .7 * 2 = 1.4: future 3
    one = sample(jnp.array([0.5, 0.5, 0.25, 0.7]))
    assert (int(one.origin), int(one.destination), float(one.departure), int(one.future)) == (5, 17, 675, 3)


def test_the_ends_of_the_unit_interval() -> None:
    first, last = sample(jnp.zeros(DRAWS)), sample(jnp.full(DRAWS, ALMOST_ONE))
    assert (int(first.origin), int(first.destination), float(first.departure), int(first.future)) == (2, 13, 600, 0)
    assert (int(last.origin), int(last.destination), int(last.future)) == (11, 17, 3)
    assert float(last.departure) == pytest.approx(900)


@pytest.mark.parametrize("count", [1, 7, 1000, 99_999])
def test_no_rounding_leads_beyond_the_last_future(count: int) -> None:
    futures, counts = jnp.stack([jnp.arange(count)] * 2), jnp.full(2, count)
    one = InstanceSampler(SAMPLER.origins, SAMPLER.destinations, SAMPLER.departures, futures, counts)
    assert int(one.sample(jnp.full(DRAWS, ALMOST_ONE)).future) == count - 1


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
    return sample_all(SAMPLER, uniform)


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
    # Destination 0 has futures 0 and 2, destination 1 has 1 and 3: a covariance of 1/4 with standard deviations of 1/2
    # and sqrt(5/4): .447. Standard error 1 / sqrt(20,000) = .007.
    by_hand = np.eye(4)
    by_hand[1, 3] = by_hand[3, 1] = 1 / np.sqrt(5)
    np.testing.assert_allclose(correlation, by_hand, atol=0.03)


# --- Scenarios' walks -------------------------------------------------------------------------------------------------

HOUR = 3600.0


def small(**changes) -> Scenario:
    """Nine crossings and twelve slots."""
    return scenario("paper-congested", **(dict(side=3, crowded_nodes=2, horizon=HOUR) | changes))


@pytest.fixture(scope="module")
def scenario_map() -> ScenarioMap:
    return draw_map(small(), 0)


@pytest.fixture(scope="module")
def params_of_test(scenario_map) -> EnvParams:
    return make_environment(small(), scenario_map, "test", 4)


def tiny_unseen(**changes) -> Scenario:
    """Two maps of nine crossings to learn on; others of nine and sixteen to walk."""
    return scenario("unseen-maps", **(dict(side=3, larger=(4,), crowded_nodes=1, training_maps=2) | changes))


def test_walks_go_from_corner_to_corner_each_through_its_own_future(scenario_map, params_of_test) -> None:
    todo = instances(small(), scenario_map, params_of_test, 6, first=3)
    assert todo.origin.tolist() == [0] * 6
    assert todo.destination.tolist() == [8] * 6
    assert todo.departure.tolist() == [0] * 6
    assert todo.future.tolist() == [3, 0, 1, 2, 3, 0]  # of four


def test_samplers(scenario_map, params_of_test) -> None:
    here, anywhere = (sampler(small(), scenario_map, params_of_test, 3, anywhere=where) for where in (False, True))
    draws = jnp.asarray(np.random.default_rng(0).random((200, 4)), jnp.float32)
    from_here, from_anywhere = (sample_all(one, draws) for one in (here, anywhere))
    assert set(from_here.origin.tolist()) == {0}
    assert set(from_anywhere.origin.tolist()) == set(range(8))
    for drawn in (from_here, from_anywhere):
        assert set(drawn.destination.tolist()) == {8}
        assert set(drawn.departure.tolist()) == {0}
        assert set(drawn.future.tolist()) == {0, 1, 2}
    # no more than there are
    assert sampler(small(), scenario_map, params_of_test, 99).counts.tolist() == [4]
    # the same compiled program serves both
    assert jax.tree.map(jnp.shape, here) == jax.tree.map(jnp.shape, anywhere)


def test_walks_depart_within_the_hour() -> None:
    rush = scenario("rush-16", side=3, crowded_nodes=1, horizon=HOUR)
    scenario_map = draw_map(rush, 0)
    params = make_environment(rush, scenario_map, "test", 2)
    # the golden ratio: 0, .618034, 1.236068 - 1, 1.854102 - 1 of an hour
    todo = instances(rush, scenario_map, params, 4)
    np.testing.assert_allclose(todo.departure, [0, 2224.92, 849.84, 3074.77], atol=0.01)
    np.testing.assert_allclose(instances(rush, scenario_map, params, 2, first=2).departure, todo.departure[2:])
    drawn = sample_all(sampler(rush, scenario_map, params, 2), jnp.linspace(0, 0.999, 50)[:, None] * jnp.ones(4))
    assert (float(drawn.departure[0]), float(drawn.departure[-1])) == (0, pytest.approx(3596.4))


def test_walks_take_the_parts_in_turn() -> None:
    unseen = tiny_unseen(horizon=HOUR)
    learned = draw_training_map(unseen, 0)
    params = make_environment(unseen, learned, "learn", 3)
    todo = instances(unseen, learned, params, 5, first=1)
    assert todo.origin.tolist() == [9, 0, 9, 0, 9]
    assert todo.destination.tolist() == [17, 8, 17, 8, 17]
    assert todo.future.tolist() == [1, 2, 0, 1, 2]
    draws = jnp.asarray(np.random.default_rng(0).random((300, 4)), jnp.float32)
    here, anywhere = (sample_all(sampler(unseen, learned, params, 3, anywhere=where), draws) for where in (False, True))
    assert set(zip(here.origin.tolist(), here.destination.tolist(), strict=True)) == {(0, 8), (9, 17)}
    assert set(anywhere.origin.tolist()) == set(range(18)) - {8, 17}
    # nobody is sent to the other part
    assert (anywhere.origin // 9 == anywhere.destination // 9).all()


def test_destinations_are_a_node_of_each_part() -> None:
    ends = standard_destinations((9, 16))
    assert ends.shape == (8, 2)
    assert ends[0].tolist() == [8, 24]  # the scenario's own come first
    assert len(set(ends.ravel().tolist())) == 16
    assert set(ends[:, 0].tolist()) == set(range(1, 9))  # never the first node, where walks begin
    assert set(ends[:, 1].tolist()) <= set(range(10, 25))


def test_fewer_destinations_are_the_first_of_all(scenario_map) -> None:
    every = standard_destinations((9,)).tolist()
    assert destinations_of(scenario_map, 3).tolist() == every[:3]
    # nobody walks to where all walks begin
    alone = replace(scenario_map, origins=(every[1][0],))
    assert destinations_of(alone, 2).tolist() == [every[0], every[2]]
    own = replace(scenario_map, destinations=(2, 5, 7))
    assert sorted(destinations_of(own, 3).ravel().tolist()) == [2, 5, 7]
    with pytest.raises(ScenarioError) as caught:
        destinations_of(own, 4)
    assert caught.value.field == "destinations"


@pytest.mark.parametrize("destinations", [0, -1, 9])
def test_there_are_not_that_many_destinations(scenario_map, destinations: int) -> None:
    with pytest.raises(ScenarioError, match=f"between 1 and 8 destinations, not {destinations}") as caught:
        destinations_of(scenario_map, destinations)
    assert caught.value.field == "destinations"


def test_samplers_for_several_destinations(scenario_map) -> None:
    ends = destinations_of(scenario_map, 3)
    params = make_environment(small(), scenario_map, "learn", 9, destinations=ends)
    draws = jnp.asarray(np.random.default_rng(0).random((500, 4)), jnp.float32)
    samplers = [sampler(small(), scenario_map, params, 4, destinations=ends, anywhere=where) for where in (False, True)]
    assert jax.tree.map(jnp.shape, samplers[0]) == jax.tree.map(jnp.shape, samplers[1])
    here, anywhere = (sample_all(one, draws) for one in samplers)
    for drawn in (here, anywhere):
        assert set(drawn.destination.tolist()) == set(ends.ravel().tolist())
        assert (drawn.origin != drawn.destination).all()
        assert (ends[np.asarray(params.futures.destination[drawn.future]), 0] == drawn.destination).all()
        assert set(drawn.future.tolist()) == {0, 1, 2, 3}
        counts = np.bincount(drawn.future)  # the first destination has two futures
        assert chisquare(counts, counts.sum() * np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6])).pvalue > 0.01
    assert set(here.origin.tolist()) == {0}
    assert set(anywhere.origin.tolist()) == set(range(9))


def test_more_destinations_than_futures_are_refused() -> None:
    scenario_map = draw_map(small(), 0)
    params = make_environment(small(flows="forecast"), scenario_map, "test", 5)
    destinations = destinations_of(scenario_map, 3)
    with pytest.raises(ScenarioError, match="3 destinations need as many futures, but there are 1"):
        sampler(small(), scenario_map, params, 5, destinations=destinations)
    enough = make_environment(small(), scenario_map, "test", 9, destinations=destinations)
    with pytest.raises(ScenarioError, match="3 destinations need as many futures, but there are 2"):
        sampler(small(), scenario_map, enough, 2, destinations=destinations)
    with pytest.raises(ScenarioError, match="3 destinations need as many futures, but there are 1"):
        instances(small(), scenario_map, params, 5, destinations=destinations)


def test_walks_from_anywhere_go_to_each_destination_in_turn() -> None:
    scenario_map = draw_map(small(), 0)
    destinations = destinations_of(scenario_map, 3)
    params = make_environment(small(), scenario_map, "test", 90, level="map", destinations=destinations)
    walks = instances(small(), scenario_map, params, 90, destinations=destinations)
    assert np.asarray(walks.destination).tolist() == destinations[:, 0].tolist() * 30
    assert (np.asarray(walks.origin) != np.asarray(walks.destination)).all()
    assert set(np.asarray(walks.origin).tolist()) == set(range(9))
    assert np.asarray(walks.future).tolist() == list(range(90))
    others = instances(small(), scenario_map, params, 90, first=90, destinations=destinations)
    assert (np.asarray(others.origin) != np.asarray(walks.origin)).any()
