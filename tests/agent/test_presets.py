"""The presets: the paper's literal numbers, and that the default solves a map."""

import dataclasses

import numpy as np
import pytest

from sidestep.agent.config import TrainConfig, TrainConfigError, changed
from sidestep.agent.presets import PRESETS, preset
from sidestep.environment.rollout import Walk
from sidestep.environment.types import LEVELS
from sidestep.planners.base import Planner, walk_plan
from sidestep.planners.learned import train_darp
from sidestep.planners.shortest_path import ShortestPath
from sidestep.planners.time_dependent import Clairvoyant
from sidestep.scenarios.builtin import BUILT_IN, scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map, purpose_key


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
    # Prioritised, as the text says, with dueling heads; single steps to one destination.
    assert paper.alpha > 0
    assert (paper.level, paper.table, paper.dueling) == ("position", False, True)
    assert (paper.n_step, paper.destinations, paper.test_walks, paper.fresh_futures) == (1, 1, 10, 0)


@pytest.mark.parametrize("name", ["paper-unblocked", "paper-congested"])
def test_the_papers_reward(name: str) -> None:
    reward = BUILT_IN[name].reward
    assert reward.progress == 1e-3
    assert reward.bonus == 1
    assert reward.unit_seconds == 60


CONFIGS = {
    **PRESETS,
    **{f"{name}-{level}": preset(name, level) for name in ("default", "dqn") for level in LEVELS},
    **{f"maps-{level}": preset("default", level, several_maps=True) for level in LEVELS if level != "position"},
    "live-large": preset("default", "live", nodes=1024),
}


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_presets_fit_together(config: TrainConfig) -> None:
    assert config.capacity % config.walkers == 0  # or the replay refuses them
    assert config.round_steps % config.walkers == 0  # or a round is shorter than it says
    assert hash(config) == hash(dataclasses.replace(config))  # a static argument of compiled functions
    assert config.batch <= config.capacity
    assert config.n_step <= config.iterations
    # All crowds are replaced in turn, each as often as the others.
    assert config.fresh_futures == 0 or config.futures % config.fresh_futures == 0


@pytest.mark.parametrize("level", LEVELS)
def test_the_default_of_a_level_sees_that_level(level: str) -> None:
    config = preset("default", level)
    assert config.level == level
    assert (config.dueling, config.double, config.potential, config.table) == (True, True, True, False)
    # The baseline differs from it in three settings, and in no other.
    dqn = preset("dqn", level)
    assert (dqn.dueling, dqn.double, dqn.alpha) == (False, False, 0)
    assert dataclasses.replace(dqn, dueling=True, double=True, alpha=config.alpha) == config


def test_presets_by_name() -> None:
    assert {name: preset(name) for name in PRESETS} == PRESETS
    assert list(PRESETS) == ["paper", "default", "dqn", "tabular-q"]


@pytest.mark.parametrize("level", ["local", "map", "live"])
def test_nothing_is_remembered_of_places_where_several_maps_are_learned(level: str) -> None:
    one, several = preset("default", level), preset("default", level, several_maps=True)
    assert several.places == 0
    assert several.destinations > 1
    assert (one.places > 0) == (level != "live")
    assert (several.level, several.n_step) == (level, one.n_step)


@pytest.mark.parametrize("level", ["local", "map", "live"])
@pytest.mark.parametrize("name", ["paper", "tabular-q"])
def test_what_knows_positions_alone_is_refused_beyond(name: str, level: str) -> None:
    with pytest.raises(TrainConfigError, match=f"the preset {name} knows the walker's position alone; .*{level}"):
        preset(name, level)


@pytest.mark.parametrize("name", ["default", "dqn"])
def test_positions_mean_nothing_on_other_maps(name: str) -> None:
    with pytest.raises(TrainConfigError, match="coordinates mean nothing on maps that were never walked"):
        preset(name, "position", several_maps=True)


@pytest.mark.parametrize("level", LEVELS)
def test_forecasts_of_large_maps_are_few(level: str) -> None:
    small, large = (preset("default", level, nodes=nodes) for nodes in (256, 1024))
    assert small == preset("default", level)
    assert (large == small) == (level != "live")
    assert large.futures <= small.futures
    assert preset("dqn", level, nodes=1024).futures == large.futures


def test_a_table_never_overshoots() -> None:
    table = PRESETS["tabular-q"]
    # The mean over 64 squared errors has a gradient of 2 / 64 of each: .5 * 2 / 64 = 1 / 64, so 64 of one number are 1.
    assert (table.table, table.optimiser, table.unit, table.target_rate) == (True, "sgd", 1, 1)
    assert table.learning_rate * 2 == pytest.approx(1)
    assert table.learning_rate_end * 2 == pytest.approx(0.01)
    # from the steps that were just made, one each
    assert table.batch == table.capacity == table.walkers


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"rounds": 0}, "rounds must be at least 1, not 0"),
        ({"batch": -32}, "batch must be at least 1, not -32"),
        ({"gamma": 1.5}, "gamma must lie between 0 and 1, not 1.5"),
        ({"epsilon": float("nan")}, "epsilon must lie between 0 and 1, not nan"),
        ({"round_steps": 100}, "round_steps must be a multiple of the 64 walkers, not 100"),
        ({"capacity": 20_000}, "capacity must be a multiple of the 64 walkers, not 20000"),
        ({"n_step": 0}, "n_step must be at least 1, not 0"),
        ({"n_step": 41}, "n_step must be at most the 40 iterations of a round, not 41"),
        ({"destinations": 0}, "destinations must be at least 1, not 0"),
        ({"futures": 0}, "futures must be at least 1, not 0"),
        ({"test_walks": 0}, "test_walks must be at least 1, not 0"),
        ({"epsilon_share": 0.0}, "epsilon_share must lie above 0 and up to 1, not 0"),
        ({"random_origins": 1.1}, "random_origins must lie between 0 and 1, not 1.1"),
        ({"destinations": 2}, "a walker that sees its position alone cannot tell 2 destinations apart"),
        ({"places": -1}, "places must not be negative, not -1"),
        ({"fresh_futures": -2}, "fresh_futures must not be negative, not -2"),
        ({"fresh_futures": 10}, "fresh_futures must divide the 64 futures, so 10 will not do"),
        ({"fresh_futures": 128}, "fresh_futures must divide the 64 futures, so 128 will not do"),
    ],
)
def test_settings_that_cannot_be_are_refused(setting: dict[str, float], message: str) -> None:
    with pytest.raises(TrainConfigError, match=message):
        changed(PRESETS["default"], **setting)


@pytest.mark.parametrize(
    ("setting", "fits"),
    [
        # Crowd c is for goal c modulo goals: of 48 crowds with 2 fresh ones, 5 goals or 4 would get mixed up.
        ({"destinations": 2}, True),
        ({"destinations": 4, "fresh_futures": 4}, True),
        ({"destinations": 4}, False),
        ({"destinations": 5}, False),
        ({"destinations": 3, "fresh_futures": 0}, True),
    ],
)
def test_at_level_live_goals_divide_the_crowds(setting: dict[str, float], fits: bool) -> None:
    live = changed(preset("default", "live"), futures=48, fresh_futures=2)
    if fits:
        assert changed(live, **setting).destinations == setting["destinations"]
        return
    with pytest.raises(
        TrainConfigError, match="at level live goals must divide the 48 crowds and the 2 fresh ones, so"
    ):
        changed(live, **setting)
    # at the other levels what is known is the same for all crowds
    assert changed(preset("default", "map"), **setting).destinations == setting["destinations"]


def test_a_whole_round_may_be_one_return() -> None:
    assert changed(PRESETS["default"], n_step=40).n_step == PRESETS["default"].iterations


def test_changed_leaves_what_is_none() -> None:
    default = PRESETS["default"]
    assert changed(default, rounds=3, gamma=None) == dataclasses.replace(default, rounds=3)


def test_the_default_solves_a_congested_map_whose_crowds_are_as_forecast() -> None:
    problem = scenario("paper-congested", flows="forecast")
    scenario_map = draw_map(problem, seed=1)
    rounds: list[int] = []
    darp = train_darp(PRESETS["default"], problem, scenario_map, lambda number, _: rounds.append(number))
    assert rounds == list(range(1, PRESETS["default"].rounds + 1))
    params = make_environment(problem, scenario_map, "test", 1)
    todo = instances(problem, scenario_map, params, 1)

    def walk(planner: Planner) -> Walk:
        return walk_plan(planner, params, planner.plan(params, todo), todo, purpose_key(scenario_map, "test"))

    learned, best, shortest = walk(darp), walk(Clairvoyant()), walk(ShortestPath())
    assert learned.arrived.all()
    # The crowds of training are those of the test here, so what the last test walks found is what is walked.
    np.testing.assert_allclose(darp.curve.min() * 60, learned.seconds, rtol=1e-4)
    assert float(best.seconds[0]) * (1 - 1e-5) <= float(learned.seconds[0]) <= 1.01 * float(best.seconds[0])
    assert learned.seconds[0] < 0.9 * shortest.seconds[0]  # and it is a map on which there is something to learn
