"""Which futures are renewed before which round."""

from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent import problem
from sidestep.agent.presets import preset
from sidestep.environment.types import EnvParams
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map

ROUNDS = 6
SMALL = scenario("paper-congested", side=3, crowded_nodes=1, horizon=3600.0)


@pytest.fixture
def renewals(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The renewals that are made for the rounds after some: the number of each, and the first future it replaces."""
    scenario_map = draw_map(SMALL, 6)
    params = make_environment(SMALL, scenario_map, "learn", 2)
    made: list[tuple[int, int]] = []
    asked: list[int] = []

    def sample(_scenario: Any, _map: Any, _params: Any, number: int, *, futures: int, among: int) -> tuple[int, int]:
        assert futures == asked[1]
        return number, among

    def replace(params: EnvParams, fresh: tuple[int, int], first: jax.Array, *, among: int) -> EnvParams:
        # Test walks have futures of their own behind these.
        assert among == fresh[1] == asked[0]
        made.append((fresh[0], int(first)))
        return params

    monkeypatch.setattr(problem, "sample_futures", sample)
    monkeypatch.setattr(problem, "replace_futures", replace)

    def after(before: int, futures: int, fresh: int) -> list[tuple[int, int]]:
        asked[:] = futures, fresh
        config = preset("default", "local").changed(rounds=ROUNDS, futures=futures, fresh_futures=fresh)
        with ThreadPoolExecutor(1) as executor:
            rounds = problem.renewed(config, SMALL, scenario_map, params, before, executor)
            assert len(list(islice(rounds, ROUNDS - before))) == ROUNDS - before
        return made

    return after


@pytest.mark.parametrize(("before", "first"), [(0, 1), (1, 1), (2, 1), (4, 3), (5, 4)])
def test_two_of_four_futures_are_renewed_in_turn(renewals: Any, before: int, first: int) -> None:
    # Number 1 replaces futures 2 and 3, number 2 futures 0 and 1, … After a resumption only those are drawn again that
    # have not been replaced since.
    in_turn = {1: 2, 2: 0, 3: 2, 4: 0, 5: 2}
    assert renewals(before, futures=4, fresh=2) == list(in_turn.items())[first - 1 :]


@pytest.mark.parametrize(("before", "first"), [(0, 1), (3, 1), (4, 2), (5, 3)])
def test_renewing_wraps_round(renewals: Any, before: int, first: int) -> None:
    # Number 2 replaces futures 4 and 0, and so on; three renewals replace them all.
    in_turn = {1: 2, 2: 4, 3: 1, 4: 3, 5: 0}
    assert renewals(before, futures=5, fresh=2) == list(in_turn.items())[first - 1 :]


def test_in_towns_fresh_futures_are_others_at_the_same_sensors() -> None:
    town = scenario("helsinki", horizon=1200.0, departures=(0.0, 300.0))
    here = draw_map(town, 1)
    config = preset("default", "local").changed(destinations=2, futures=4, fresh_futures=2, test_walks=3)
    params = problem.pose(config, town, here)[0].params
    with ThreadPoolExecutor(1) as executor:
        _, after = islice(problem.renewed(config.changed(rounds=2), town, here, params, 0, executor), 2)
    before, new = (each.futures.speeds.crowds for each in (params, after))
    assert (np.asarray(new.counted)[2:4] != np.asarray(before.counted)[2:4]).all(axis=(1, 2)).all()
    kept = [0, 1, 4, 5, 6]  # the last three are those of the test walks
    np.testing.assert_array_equal(new.counted[jnp.array(kept)], before.counted[jnp.array(kept)])
    assert eqx.tree_equal(new.weights, here.flow.weights)
    assert new.counted.shape[0] == config.futures + config.test_walks


def test_without_fresh_futures_nothing_is_renewed(renewals: Any) -> None:
    assert renewals(2, futures=4, fresh=0) == []


def test_futures_reach_as_far_as_walks_are_likely_to_last() -> None:
    day = scenario("paper-congested", side=3, lengths=(100.0, 300.0), walker="older")
    here = draw_map(day, 6)
    # 2 + 2 streets of 200 m, 800 m at 1.16 m/s are 690 s; three times that is 2,069 s, in slots of 300 s.
    config = preset("default").changed(futures=4, futures_reach=3.0, fresh_futures=2, test_walks=3, rounds=2)
    params = problem.pose(config, day, here)[0].params
    assert params.futures.speeds.speed.shape == (7, 24, 7)
    assert float(params.horizon) == day.horizon  # walks go on
    with ThreadPoolExecutor(1) as executor:
        _, after = islice(problem.renewed(config, day, here, params, 0, executor), 2)
    assert after.futures.speeds.speed.shape == (7, 24, 7)
    # Not beyond the horizon, and without a limit up to it.
    for reach in (0.0, 1e6):
        shapes, _ = jax.eval_shape(
            lambda here, reach=reach: problem.pose(config.changed(futures_reach=reach), SMALL, here), here
        )
        assert shapes.params.futures.speeds.speed.shape == (7, 24, 12)


def test_in_towns_futures_reach_to_the_horizon() -> None:
    town = scenario("helsinki", horizon=1200.0)
    assert problem.as_far_as_futures_reach(preset("default").changed(futures_reach=1.0), town) == town
