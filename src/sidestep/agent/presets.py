"""Ways to learn, by name: the settings of training for each level and kind of scenario."""

from dataclasses import replace
from typing import Literal

from sidestep.agent.config import TrainConfig, TrainConfigError
from sidestep.environment.types import Information
from sidestep.scenarios.build import town_of
from sidestep.scenarios.model import Scenario

_PAPER = TrainConfig(
    rounds=50, round_steps=1_000, walkers=1, batch=32, capacity=10_000, alpha=0.6, beta=0.4, priority_floor=0.01,
    gamma=0.95, double=False, hidden=(50, 50), one_hot=False, unit=1.0, target_period=200, target_rate=1.0,
    optimiser="rmsprop", learning_rate=1e-4, learning_rate_end=1e-4, decay=0.9, damping=1e-10,
    epsilon=0.1, epsilon_end=0.1, epsilon_share=1.0, random_origins=0.0, keep="last",
)  # fmt: skip


_POSITION = TrainConfig(
    rounds=40, round_steps=2_560, walkers=64, batch=256, capacity=20_032, alpha=0.6, beta=1.0, priority_floor=0.01,
    gamma=1.0, double=True, hidden=(50, 50), one_hot=True, unit=10.0, target_period=1, target_rate=0.02,
    optimiser="adam", learning_rate=3e-3, learning_rate_end=0.0, decay=0.9, damping=1e-10,
    epsilon=1.0, epsilon_end=0.05, epsilon_share=0.3, random_origins=0.5, keep="best",
)  # fmt: skip


# Walkers that see more than their position begin as their level's greedy planner, so they need explore less.
_LOCAL = TrainConfig(
    rounds=100, round_steps=102_400, walkers=1_024, batch=1_024, capacity=16_384, alpha=0.0, beta=1.0,
    priority_floor=0.01, gamma=1.0, double=True, hidden=(64, 64), one_hot=False, unit=10.0, target_period=1,
    target_rate=0.02, optimiser="adam", learning_rate=2e-3, learning_rate_end=0.0, decay=0.9, damping=1e-10,
    epsilon=0.3, epsilon_end=0.02, epsilon_share=0.5, random_origins=0.5, keep="last",
    level="local", places=8, fresh_futures=32, test_walks=50,
)  # fmt: skip


_MAP = replace(
    _LOCAL, level="map", places=4, n_step=6, learning_rate=1e-3, epsilon=0.05, rounds=120,
)  # fmt: skip


_LIVE = replace(
    _MAP, level="live", places=0, n_step=8, learning_rate=5e-4, futures=32, fresh_futures=8, test_walks=16, rounds=100,
)  # fmt: skip


_DEFAULT: dict[Information, TrainConfig] = {"position": _POSITION, "local": _LOCAL, "map": _MAP, "live": _LIVE}


_MANY_NODES = 500


Preset = Literal["default", "paper", "dqn", "tabular-q"]


def preset(name: Preset, level: Information = "position", *, several_maps: bool = False, nodes: int = 0) -> TrainConfig:
    """A way to learn at a level.

    ``default`` is ours; ``paper`` has the settings as printed, for its own level ``position``; ``dqn`` is the default
    without dueling heads, double Q-learning and priorities; ``tabular-q`` is Q-learning with a table of crossings and
    exits. Where ``several_maps`` are learned, nothing is remembered of places. On maps of many ``nodes`` forecasts take
    longer to work out, so that level ``live`` has to do with fewer crowds.

    Raises
    ------
    TrainConfigError
        A preset that there is not at this level.
    """
    if name in ("paper", "tabular-q"):
        if level != "position":
            raise TrainConfigError(f"the preset {name} knows the walker's position alone; there is none for {level}")
        return _PAPER if name == "paper" else _TABLE
    config = _DEFAULT[level]
    if several_maps:
        if level == "position":
            raise TrainConfigError("coordinates mean nothing on maps that were never walked; train at another level")
        config = replace(config, places=0, futures=16, fresh_futures=4, destinations=4)
    if level == "live" and nodes > _MANY_NODES:
        config = replace(config, futures=16, fresh_futures=1, test_walks=8, rounds=80)
    return replace(config, dueling=False, double=False, alpha=0.0) if name == "dqn" else config


def preset_for(scenario: Scenario, name: Preset, level: Information | None = None) -> TrainConfig:
    """The preset that fits a scenario's maps, at its own level unless another is given."""
    if scenario.place.anywhere and (level or scenario.level) == "position":
        raise TrainConfigError(
            f"a walker that sees its position alone cannot learn to walk anywhere in {scenario.name}"
        )
    several = bool(scenario.place.training_maps) or scenario.place.anywhere
    config = preset(name, level or scenario.level, several_maps=several, nodes=scenario.place.nodes)
    if not scenario.place.anywhere:
        return config
    # Streets are short, and jams make some walks many times longer than most: hence long returns, small steps, errors
    # that do not count by their squares.
    config = replace(config, rounds=60, n_step=16, huber=1.0, learning_rate=2e-4, epsilon=0.02, test_walks=32)
    # Crowds are for goals in turn, old ones and those that replace them alike, so their numbers are multiples of it.
    nodes = town_of(scenario.place.streets).nodes
    destinations = min(32, len(scenario.place.destinations) or 32, max(nodes - 2, 1))
    fresh = 32 // destinations * destinations
    if config.level == "live":  # forecasts take too long to be renewed
        return replace(
            config, destinations=destinations, futures=3 * fresh, fresh_futures=0, learning_rate=1e-4, rounds=40
        )
    return replace(config, destinations=destinations, futures=2 * fresh, fresh_futures=fresh)


# Each of a gradient step's 64 transitions, the latest of each walker, changes its number by 1/64 of its error: where
# all are of one crossing and exit, it still does not overshoot.
_TABLE = replace(
    _POSITION, table=True, batch=64, capacity=64, alpha=0.0, double=False, target_rate=1.0, optimiser="sgd",
    unit=1.0, learning_rate=0.5, learning_rate_end=0.005,
)  # fmt: skip


PRESETS = {"paper": _PAPER, "default": _POSITION, "dqn": preset("dqn"), "tabular-q": _TABLE}
