"""What environments are made of: possible futures, what is expected, and futures that are renewed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.environment.types import EnvParams, RewardWeights
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import destinations_of
from sidestep.scenarios.futures import make_environment, replace_futures, sample_futures
from sidestep.scenarios.maps import ScenarioMap, draw_map
from sidestep.scenarios.model import Scenario
from sidestep.walking.speed_laws import LAWS

HOUR = 3600.0
ANY_HOUR = jnp.zeros(1)  # grids know none


def small(**changes) -> Scenario:
    """Nine crossings and twelve slots."""
    return scenario("paper-congested", **(dict(side=3, crowded_nodes=2, horizon=HOUR) | changes))


def volumes(scenario_map: ScenarioMap) -> np.ndarray:
    return np.asarray(scenario_map.flow.initial)


def crowded(scenario_map: ScenarioMap) -> np.ndarray:
    """Which segments are: no other has more than 1,000 people."""
    return volumes(scenario_map) > 1001


def renewed(scenario: Scenario, scenario_map: ScenarioMap, params: EnvParams, number: int, futures: int, first: int):
    return replace_futures(params, sample_futures(scenario, scenario_map, params, number, futures), jnp.int32(first))


# --- What an environment has ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scenario_map() -> ScenarioMap:
    return draw_map(small(), 0)


@pytest.fixture(scope="module")
def params_of_test(scenario_map) -> EnvParams:
    return make_environment(small(), scenario_map, "test", 4)


def test_an_environment_has_what_was_asked_for(scenario_map, params_of_test) -> None:
    assert params_of_test.futures.speeds.speed.shape == (4, 24, 12)
    assert params_of_test.expected.seconds.shape == (1, 24, 12)
    assert params_of_test.futures.speeds.slot_seconds == params_of_test.expected.slot_seconds == 300
    assert float(params_of_test.horizon) == HOUR
    assert (params_of_test.network.length == scenario_map.network.length).all()
    assert (params_of_test.rule, params_of_test.reward) == ("integrated", RewardWeights())
    assert make_environment(small(rule="entry"), scenario_map, "test", 4).rule == "entry"


def test_the_same_purpose_gives_the_same_futures_and_another_others(scenario_map, params_of_test) -> None:
    again = make_environment(small(), draw_map(small(), 0), "test", 4)
    assert (again.futures.speeds.speed == params_of_test.futures.speeds.speed).all()
    futures = {"test": np.asarray(params_of_test.futures.speeds.speed)}
    for purpose in ("learn", "explore"):
        futures[purpose] = np.asarray(make_environment(small(), scenario_map, purpose, 4).futures.speeds.speed)
    # Slot 0 is today's crowd. After it no future of one purpose is one of another, and none is there twice.
    everything = np.concatenate(list(futures.values()))
    assert np.ptp(everything[:, :, 0], axis=0).max() == 0
    for slot in (1, 11):
        assert len(np.unique(everything[:, 0, slot])) == 12


def test_what_is_expected_does_not_depend_on_the_purpose(scenario_map, params_of_test) -> None:
    learn = make_environment(small(), scenario_map, "learn", 4)
    assert (learn.expected.seconds == params_of_test.expected.seconds).all()
    assert (learn.expected.mean.speed == params_of_test.expected.mean.speed).all()


def test_futures_vary_about_what_is_expected(scenario_map) -> None:
    slots = 12
    expected = np.asarray(scenario_map.flow.expected(ANY_HOUR, slots).counted)[0]
    drawn = np.asarray(scenario_map.flow.draw(jax.random.key(0), jnp.zeros(400), slots).counted)
    assert expected.shape == (slots, 24)
    assert drawn.shape == (400, slots, 24)
    assert np.ptp(drawn[:, 0], axis=0).max() == 0
    spread = drawn.std(axis=0, dtype=np.float64)
    assert (np.diff(spread.mean(axis=1)) > 0).all()
    # Crowded segments are so full that the floor of one person is never met, so there the mean is the forecast.
    full = crowded(scenario_map)
    error = (drawn.mean(axis=0) - expected)[1:, full] / (spread[1:, full] / 20)  # in standard errors
    assert abs(error).max() < 5


def test_flows_of_the_forecast_have_one_future_which_is_expected(scenario_map) -> None:
    params = make_environment(small(flows="forecast"), scenario_map, "test", 4)
    assert params.futures.speeds.speed.shape == (1, 24, 12)
    assert (params.futures.speeds.speed[0] == params.expected.speed).all()
    assert (params.futures.speeds.covered[0] == params.expected.covered).all()


def test_slot_0_is_the_crowd_of_the_map(scenario_map, params_of_test) -> None:
    for field in (
        scenario_map.flow.expected(ANY_HOUR, 12),
        scenario_map.flow.draw(jax.random.key(1), jnp.zeros(3), 12),
    ):
        assert (np.moveaxis(np.asarray(field.counted), -2, 0)[0] == volumes(scenario_map)).all()
    # x0 (p/d)^-0.8
    speed = 1.34 * (volumes(scenario_map) / np.asarray(scenario_map.network.length)) ** -0.8
    np.testing.assert_allclose(params_of_test.expected.mean.speed[0, :, 0], speed, rtol=1e-5)
    for future in range(4):
        np.testing.assert_allclose(params_of_test.futures.speeds.speed[future, :, 0], speed, rtol=1e-5)


def test_one_slot_is_enough(scenario_map) -> None:
    params = make_environment(small(horizon=10.0), scenario_map, "test", 2)
    assert params.futures.speeds.speed.shape == (2, 24, 1)


@pytest.mark.parametrize("law", LAWS)
def test_speeds_are_positive_and_finite_all_day(law: str) -> None:
    day = small(law=law, horizon=24 * HOUR)
    params = make_environment(day, draw_map(day, 1), "test", 16)
    assert params.expected.seconds.shape[-1] == 288
    assert (np.asarray(params.expected.seconds) > 0).all()
    for field in (params.futures.speeds, params.expected.mean):
        assert field.slots == 288
        assert np.isfinite(field.speed).all()
        assert (np.asarray(field.speed) > 0).all()
        assert np.isfinite(field.covered).all()
        if law != "power":
            assert float(field.speed.max()) <= 1.34 * (1 + 1e-6)
    # nobody on the street is taken for one: x0 (1/d)^-0.8 is the highest speed of the literal law
    highest = 1.34 * np.asarray(params.network.length) ** 0.8
    assert (np.asarray(params.futures.speeds.speed).max(axis=(0, 2)) <= highest * (1 + 1e-5)).all()


def tiny_unseen(**changes) -> Scenario:
    """Two maps of nine crossings to learn on; others of nine and sixteen to walk."""
    return scenario("unseen-maps", **(dict(side=3, larger=(4,), crowded_nodes=1, training_maps=2) | changes))


# --- Futures of training and of tests -------------------------------------------------------------------------------


def futures(params: EnvParams) -> set[float]:
    """One number of each future that tells it from all others."""
    return set(np.asarray(params.futures.speeds.speed)[:, 0, -1].tolist())


def test_no_future_of_a_test_is_one_of_training(scenario_map) -> None:
    tests = [make_environment(small(), scenario_map, "test", 4, part=part) for part in range(3)]
    params = make_environment(small(), scenario_map, "learn", 4)
    learns = [params]
    for number in (1, 2):
        params = renewed(small(), scenario_map, params, number, 2, 2 * (number - 1))
        learns.append(params)
    tested, learned = (set().union(*map(futures, many)) for many in (tests, learns))
    assert len(tested) == 12  # parts have futures of their own
    assert len(learned) == 8  # and renewals bring new ones
    assert not tested & learned
    assert futures(tests[0]) == futures(make_environment(small(), scenario_map, "test", 4))


@pytest.mark.parametrize("first", [0, 2, 5])
def test_renewing_replaces_these_futures_and_no_others(first: int) -> None:
    rush = tiny_unseen(horizon=1500.0)
    scenario_map = draw_map(rush, 0)
    before = make_environment(rush, scenario_map, "learn", 6, level="live")
    after = renewed(rush, scenario_map, before, 1, 2, first)
    fresh = np.isin(np.arange(6), [first, (first + 1) % 6])  # after the last future comes the first one
    assert before.futures.destination.tolist() == after.futures.destination.tolist()
    parts = ((params.futures.speeds, params.futures.cost_to_go) for params in (before, after))
    for old, new in zip(*map(jax.tree.leaves, parts), strict=True):
        same = (np.asarray(old) == np.asarray(new)).reshape(6, -1)
        assert same[~fresh].all()
        assert not same[fresh].all(axis=1).any()
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), before.expected, after.expected))
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), before.cost_to_go, after.cost_to_go))
    # another renewal, other crowds; the same again, the same
    assert futures(renewed(rush, scenario_map, before, 2, 2, first)) != futures(after)
    assert futures(renewed(rush, scenario_map, before, 1, 2, first)) == futures(after)


def test_renewed_futures_take_the_place_of_those_they_replace() -> None:
    # Of eight futures for three destinations the first five are renewed, two at a time: 2 and 3, 4 and 0, and so on.
    problem = tiny_unseen(horizon=1500.0)
    scenario_map = draw_map(problem, 0)
    destinations = destinations_of(scenario_map, 3)
    params = make_environment(
        problem, scenario_map, "learn", 8, level="live", destinations=destinations, hours=[7.0, 30.0, 100.0]
    )
    assert params.futures.destination.tolist() == [0, 1, 2, 0, 1, 2, 0, 1]
    assert params.futures.hour.tolist() == [7, 30, 100, 7, 30, 100, 7, 30]
    after = params
    for number, replaced in ((1, [2, 3]), (2, [4, 0]), (3, [1, 2])):
        fresh = sample_futures(problem, scenario_map, params, number, 2, among=5)
        assert fresh.destination.tolist() == [each % 3 for each in replaced]
        for leaf, mine in ((fresh.hour, params.futures.hour), (fresh.phase, params.futures.phase)):
            assert leaf.tolist() == mine[jnp.array(replaced)].tolist()
        before, after = after, replace_futures(after, fresh, 2 * number % 5, among=5)
        changed = np.asarray(before.futures.speeds.speed != after.futures.speeds.speed).any(axis=(1, 2))
        assert np.flatnonzero(changed).tolist() == sorted(replaced)
        # What level live knows of them is of their own destinations, where nothing is left to go.
        here = jnp.asarray(destinations)[after.futures.destination, 0]
        assert not after.futures.cost_to_go.snapshot[jnp.arange(8), :, here].any()
