"""The presets: the paper's literal numbers, and that the default solves a map."""

import subprocess
import sys

import numpy as np
import pytest

from sidestep.agent.config import TrainConfig, TrainConfigError
from sidestep.agent.presets import PRESETS, preset, preset_for
from sidestep.agent.runs import train
from sidestep.environment.rollout import Walk
from sidestep.environment.types import LEVELS
from sidestep.planners.base import Planner, walk_plan
from sidestep.planners.learned import trained_darp
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
    assert hash(config) == hash(config.changed())  # a static argument of compiled functions
    assert config.batch <= config.capacity
    assert config.n_step <= config.iterations
    # All futures are replaced in turn, each as often as the others, and every destination has as many of them.
    assert config.fresh_futures == 0 or config.futures % config.fresh_futures == 0
    assert config.futures % config.destinations == 0


@pytest.mark.parametrize("level", LEVELS)
def test_the_default_of_a_level_sees_that_level(level: str) -> None:
    config = preset("default", level)
    assert config.level == level
    assert (config.dueling, config.double, config.potential, config.table) == (True, True, True, False)
    # The baseline differs from it in three settings, and in no other.
    dqn = preset("dqn", level)
    assert (dqn.dueling, dqn.double, dqn.alpha) == (False, False, 0)
    assert dqn.changed(dueling=True, double=True, alpha=config.alpha) == config


def test_presets_by_name() -> None:
    assert {name: preset(name) for name in PRESETS} == PRESETS
    assert list(PRESETS) == ["paper", "default", "dqn", "tabular-q"]


def test_what_does_not_exist_is_refused() -> None:
    # In a process of its own, where types are not checked.
    code = """
import sidestep
for name, level in (("defualt", "map"), ("default", "nowhere")):
    try:
        sidestep.preset(name, level)
    except sidestep.SidestepError as error:
        print(type(error).__name__, error.field)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "TrainConfigError preset\nTrainConfigError level\n"


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
    with pytest.raises(TrainConfigError) as caught:
        preset(name, level)
    assert caught.value.field == "preset"


@pytest.mark.parametrize("name", PRESETS)
def test_positions_mean_nothing_on_other_maps(name: str) -> None:
    with pytest.raises(TrainConfigError) as caught:
        preset(name, "position", several_maps=True)
    assert caught.value.field == "level"


@pytest.mark.parametrize("level", LEVELS)
def test_futures_of_large_maps_are_few(level: str) -> None:
    small, large = (preset("default", level, nodes=nodes) for nodes in (36, 1024))
    assert small == preset("default", level)
    assert (large == small) == (level not in ("position", "live"))
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


def test_large_maps_have_fewer_futures_at_level_position() -> None:
    futures = [preset("default", nodes=nodes).futures for nodes in (9, 36, 72, 576, 577, 10_000)]
    assert futures == [1024, 1024, 512, 64, 64, 64]


def test_what_is_kept() -> None:
    # Ten noisy walks say little about a network; a table that follows every reward does not settle.
    assert {name: config.keep for name, config in PRESETS.items()} == {
        "paper": "last", "default": "mean", "dqn": "mean", "tabular-q": "best",
    }  # fmt: skip


# --- Towns ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", ["local", "map", "live"])
def test_towns_have_long_returns_and_many_destinations(level: str) -> None:
    config = preset_for(BUILT_IN["helsinki"], "default", level)
    assert (config.level, config.places, config.n_step, config.destinations) == (level, 0, 16, 32)
    assert config.huber > 0
    # Each destination has as many futures; forecasts take too long to be renewed.
    assert (config.futures, config.fresh_futures) == ((96, 0) if level == "live" else (64, 32))
    assert preset_for(BUILT_IN["helsinki"], "dqn", level) == config.changed(dueling=False, double=False, alpha=0.0)


def test_corrections_have_margins_where_crowds_are_interpolated() -> None:
    # Forecasts from counts are nearly exact: they are left for 30 s, expected crowds for 3 s.
    for level, seconds in (("local", 0), ("map", 3), ("live", 30)):
        config = preset_for(BUILT_IN["helsinki"], "default", level)
        assert (config.correction_margin_seconds, config.estimate_when_revisiting) == (seconds, seconds > 0)
    for name in ("rush-16", "unseen-maps"):
        for level in ("local", "map", "live"):
            config = preset_for(BUILT_IN[name], "default", level)
            assert (config.correction_margin_seconds, config.estimate_when_revisiting) == (0, False)


@pytest.mark.parametrize("name", ["default", "paper", "tabular-q"])
def test_no_agent_walks_a_town_by_its_position(name: str) -> None:
    with pytest.raises(TrainConfigError) as caught:
        preset_for(BUILT_IN["helsinki"], name, "position")
    assert caught.value.field == "level"


def test_the_scenario_says_the_level() -> None:
    assert preset_for(BUILT_IN["helsinki"], "default").level == BUILT_IN["helsinki"].level
    assert preset_for(BUILT_IN["paper-congested"], "default") == PRESETS["default"]
    assert preset_for(BUILT_IN["unseen-maps"], "default", "map").places == 0
    assert preset_for(BUILT_IN["rush-32"], "default", "live") == preset("default", "live", nodes=1024)


# --- The default, for real ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1])  # with the target at half the speed the training of seed 0 ends 2 % off
def test_the_default_solves_a_congested_map_whose_crowds_are_as_forecast(seed: int) -> None:
    problem = scenario("paper-congested", flows="forecast")
    scenario_map = draw_map(problem, seed)
    darp = trained_darp(train(problem, PRESETS["default"], seed=seed).model)
    params = make_environment(problem, scenario_map, "test", 1)
    todo = instances(problem, scenario_map, params, 1)

    def walk(planner: Planner) -> Walk:
        return walk_plan(planner, params, planner.plan(params, todo), todo, purpose_key(scenario_map, "test"))

    learned, best, shortest = walk(darp), walk(Clairvoyant()), walk(ShortestPath())
    assert learned.arrived.all()
    # The crowds of training are those of the test here, so what the last test walks found is what is walked.
    np.testing.assert_allclose(darp.curve[-1] * 60, float(learned.seconds[0]), rtol=1e-4)
    assert float(best.seconds[0]) * (1 - 1e-5) <= float(learned.seconds[0]) <= 1.003 * float(best.seconds[0])
    assert learned.seconds[0] < 0.9 * shortest.seconds[0]  # and it is a map on which there is something to learn
