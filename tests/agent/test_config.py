"""Settings are checked when they are made and when they are changed, and errors name the one at fault."""

from typing import Any

import pytest
from pydantic import ValidationError

from sidestep.agent.config import TrainConfig, TrainConfigError
from sidestep.agent.presets import PRESETS, preset

DEFAULT, MAP = PRESETS["default"], preset("default", "map")


@pytest.mark.parametrize(
    ("setting", "field"),
    [
        ({"rounds": 0}, "rounds"),
        ({"rounds": 1.5}, "rounds"),
        ({"rounds": "3"}, "rounds"),
        ({"rounds": True}, "rounds"),
        ({"rounds": None}, "rounds"),
        ({"batch": -32}, "batch"),
        ({"hidden": [50, 50]}, "hidden"),
        ({"hidden": (50, 0)}, "hidden"),
        ({"double": 1}, "double"),
        ({"keep": "all"}, "keep"),
        ({"optimiser": "lion"}, "optimiser"),
        ({"level": "hindsight"}, "level"),
        ({"unit": 0.0}, "unit"),
        ({"gamma": 1.5}, "gamma"),
        ({"epsilon": float("nan")}, "epsilon"),
        ({"learning_rate": float("inf")}, "learning_rate"),
        ({"learning_rate_end": -1.0}, "learning_rate_end"),
        ({"huber": -1.0}, "huber"),
        ({"epsilon_share": 0.0}, "epsilon_share"),
        ({"random_origins": 1.1}, "random_origins"),
        ({"round_steps": 100}, "round_steps"),  # 64 walkers
        ({"rounds": 2**31}, "round_steps"),
        ({"capacity": 20_000}, "capacity"),
        ({"n_step": 0}, "n_step"),
        ({"n_step": 41}, "n_step"),  # 40 iterations
        ({"destinations": 0}, "destinations"),
        ({"destinations": 2}, "destinations"),  # a walker that observes its position cannot tell them apart
        ({"futures": 0}, "futures"),
        ({"test_walks": 0}, "test_walks"),
        ({"places": -1}, "places"),
        ({"fresh_futures": -2}, "fresh_futures"),
        ({"futures": 64, "fresh_futures": 65}, "fresh_futures"),
        ({"futures_reach": -1.0}, "futures_reach"),
        ({"temperature": -0.5}, "temperature"),
        ({"correction_margin_seconds": -1.0}, "correction_margin_seconds"),
        ({"correction_margin_seconds": 3.0}, "correction_margin_seconds"),  # level position has no estimate
        ({"estimate_when_revisiting": True}, "estimate_when_revisiting"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_wrong_settings_are_named(setting: dict[str, Any], field: str) -> None:
    with pytest.raises(TrainConfigError) as caught:
        DEFAULT.changed(**setting)
    assert caught.value.field == field
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(TrainConfigError) as caught:
        TrainConfig(**(dict(DEFAULT) | setting))
    assert caught.value.field == field


def test_what_is_missing_is_named() -> None:
    with pytest.raises(TrainConfigError) as caught:
        TrainConfig(rounds=3)  # type: ignore[call-arg]
    assert caught.value.field == "walkers"
    assert "gamma" in [other.field for other in caught.value.others]


def test_any_number_of_futures_is_renewed() -> None:
    # 48 futures of 5 destinations, 7 of them fresh after every round: nothing need divide anything.
    for level in ("local", "map", "live"):
        config = preset("default", level).changed(destinations=5, futures=48, fresh_futures=7)
        assert (config.destinations, config.futures, config.fresh_futures) == (5, 48, 7)


@pytest.mark.parametrize("level", ["local", "map", "live"])
def test_every_destination_needs_a_future(level: Any) -> None:
    config = preset("default", level).changed(futures=8, fresh_futures=2)
    assert config.changed(destinations=8).destinations == 8
    with pytest.raises(TrainConfigError) as caught:
        config.changed(destinations=9)
    assert caught.value.field == "destinations"


def test_a_whole_round_may_be_one_return() -> None:
    assert DEFAULT.changed(n_step=40).n_step == DEFAULT.iterations


def test_configurations_are_values() -> None:
    same = DEFAULT.changed(rounds=DEFAULT.rounds)
    assert same is not DEFAULT
    assert (same, hash(same)) == (DEFAULT, hash(DEFAULT))  # a static argument of compiled functions
    assert MAP.changed(places=0) != MAP
    with pytest.raises(ValidationError):
        MAP.places = 0  # type: ignore[misc]


def test_whole_numbers_serve_as_numbers() -> None:
    config = DEFAULT.changed(gamma=1, epsilon=0)
    assert isinstance(config.gamma, float)
    assert config.epsilon == 0


@pytest.mark.parametrize("config", [DEFAULT, MAP.changed(correction_margin_seconds=3.0)])
def test_there_and_back_through_json(config: TrainConfig) -> None:
    assert TrainConfig.model_validate_json(config.model_dump_json()) == config


@pytest.mark.parametrize(
    ("iterations", "period", "span"), [(1_000, 200, 200), (40, 1, 1), (1_000, 300, 100), (10, 25, 5), (7, 5, 1)]
)
def test_rounds_divide_by_spans_that_end_where_the_target_moves(iterations: int, period: int, span: int) -> None:
    config = PRESETS["paper"].changed(round_steps=iterations, target_period=period)
    assert config.span == span
