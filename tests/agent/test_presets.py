"""The presets: the paper's literal numbers, and that the default solves a map."""

import dataclasses

import numpy as np
import pytest

from sidestep.agent.config import PRESETS, TrainConfigError, changed
from sidestep.environment.walk import Walk
from sidestep.planners.base import Planner, walk_plan
from sidestep.planners.darp import train_darp
from sidestep.planners.search import Clairvoyant
from sidestep.planners.shortest_path import ShortestPath
from sidestep.scenarios import BUILT_IN, draw_map, instances, make_environment, purpose_key, scenario


def test_the_paper_preset_is_the_papers_numbers() -> None:
    paper = PRESETS["paper"]
    assert paper.hidden == (50, 50)
    assert paper.capacity == 10**4
    assert paper.batch == 32
    assert paper.gamma == 0.95
    assert paper.learning_rate == paper.learning_rate_end == 1e-4
    assert paper.optimiser == "rmsprop"
    # One walker, one gradient step for each of its steps; a fixed ε; the target network is copied.
    assert (paper.walkers, paper.iterations) == (1, paper.round_steps)
    assert paper.epsilon == paper.epsilon_end
    assert paper.target_rate == 1
    assert paper.target_period > 1
    # Coordinates alone, no double Q, rewards as they are, all walks from the origin, the network of the last step.
    assert (paper.one_hot, paper.double) == (False, False)
    assert paper.unit == 1
    assert paper.random_origins == 0
    assert paper.keep == "last"
    # Prioritised, as the text says.
    assert paper.alpha > 0


@pytest.mark.parametrize("name", ["paper-unblocked", "paper-congested"])
def test_the_papers_reward(name: str) -> None:
    reward = BUILT_IN[name].reward
    assert reward.progress == 1e-3
    assert reward.bonus == 1
    assert reward.unit_seconds == 60


@pytest.mark.parametrize("name", PRESETS)
def test_presets_fit_together(name: str) -> None:
    config = PRESETS[name]
    assert config.capacity % config.walkers == 0  # or the replay refuses them
    assert config.round_steps % config.walkers == 0  # or a round is shorter than it says
    assert hash(config) == hash(dataclasses.replace(config))  # a static argument of compiled functions


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"rounds": 0}, "rounds must be at least 1, not 0"),
        ({"batch": -32}, "batch must be at least 1, not -32"),
        ({"gamma": 1.5}, "gamma must lie between 0 and 1, not 1.5"),
        ({"epsilon": float("nan")}, "epsilon must lie between 0 and 1, not nan"),
        ({"round_steps": 100}, "round_steps must be a multiple of the 64 walkers, not 100"),
        ({"capacity": 20_000}, "capacity must be a multiple of the 64 walkers, not 20000"),
    ],
)
def test_settings_that_cannot_be_are_refused(setting: dict[str, float], message: str) -> None:
    with pytest.raises(TrainConfigError, match=message):
        changed(PRESETS["default"], **setting)


def test_changed_leaves_what_is_none() -> None:
    default = PRESETS["default"]
    assert changed(default, rounds=3, gamma=None) == dataclasses.replace(default, rounds=3)


def test_the_default_solves_a_congested_map_whose_crowds_are_as_forecast() -> None:
    problem = scenario("paper-congested", flows="forecast")
    place = draw_map(problem, seed=1)
    rounds: list[int] = []
    darp = train_darp(PRESETS["default"], problem, place, lambda number, _: rounds.append(number))
    assert rounds == list(range(1, PRESETS["default"].rounds + 1))
    params = make_environment(problem, place, "test", 1)
    todo = instances(problem, params, 1)

    def walk(planner: Planner) -> Walk:
        return walk_plan(planner, params, planner.plan(params, todo), todo, purpose_key(place, "test"))

    learned, best, shortest = walk(darp), walk(Clairvoyant()), walk(ShortestPath())
    assert learned.arrived.all()
    # The crowds of training are those of the test here, so what the last test walks found is what is walked.
    np.testing.assert_allclose(darp.curve.min() * 60, learned.seconds, rtol=1e-4)
    assert float(best.seconds[0]) * (1 - 1e-5) <= float(learned.seconds[0]) <= 1.01 * float(best.seconds[0])
    assert learned.seconds[0] < 0.9 * shortest.seconds[0]  # and it is a map on which there is something to learn
