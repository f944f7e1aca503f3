"""Ways to learn, by name: the settings of training for each level and kind of scenario.

Examples
--------
>>> from sidestep import PRESETS
>>> list(PRESETS)
['paper', 'default', 'dqn', 'tabular-q']
>>> PRESETS["paper"].gamma
0.95
"""

from typing import Literal, get_args

from sidestep.agent.config import TrainConfig, TrainConfigError
from sidestep.arguments import FLAG, checked, whole
from sidestep.environment.types import LEVELS, Information
from sidestep.errors import hint
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.streets import walked_streets

Preset = Literal["default", "paper", "dqn", "tabular-q"]

_PAPER = TrainConfig(
    rounds=50, round_steps=1_000, walkers=1, batch=32, capacity=10_000, alpha=0.6, beta=0.4, priority_floor=0.01,
    gamma=0.95, double=False, hidden=(50, 50), one_hot=False, unit=1.0, target_period=200, target_rate=1.0,
    optimiser="rmsprop", learning_rate=1e-4, learning_rate_end=1e-4, decay=0.9, damping=1e-10,
    epsilon=0.1, epsilon_end=0.1, epsilon_share=1.0, random_origins=0.0, keep="last",
)  # fmt: skip

# Crowds are noisy and paths nearly equal: only the mean over many futures, on both of two paths, tells which is better.
# Hence a thousand futures, which need not reach further than walks, a temperature, a replay that holds all steps of the
# second half, and the mean network. The target follows fast, so that values reach the origin while walkers are still
# scattered and correct what is wrong on the way.
_POSITION = TrainConfig(
    rounds=40, round_steps=2_560, walkers=64, batch=256, capacity=51_200, alpha=0.6, beta=1.0, priority_floor=0.01,
    gamma=1.0, double=True, hidden=(50, 50), one_hot=True, unit=10.0, target_period=1, target_rate=0.05,
    optimiser="adam", learning_rate=3e-3, learning_rate_end=0.0, decay=0.9, damping=1e-10,
    epsilon=1.0, epsilon_end=0.05, epsilon_share=0.3, random_origins=0.5, keep="mean",
    temperature=0.5, futures=1_024, futures_reach=2.0,
)  # fmt: skip

# Walkers that see more than their position begin as their level's greedy planner, so they need explore less.
_LOCAL = TrainConfig(
    rounds=100, round_steps=102_400, walkers=1_024, batch=1_024, capacity=16_384, alpha=0.0, beta=1.0,
    priority_floor=0.01, gamma=1.0, double=True, hidden=(64, 64), one_hot=False, unit=10.0, target_period=1,
    target_rate=0.02, optimiser="adam", learning_rate=2e-3, learning_rate_end=0.0, decay=0.9, damping=1e-10,
    epsilon=0.3, epsilon_end=0.02, epsilon_share=0.5, random_origins=0.5, keep="last",
    level="local", places=8, fresh_futures=32, test_walks=50,
)  # fmt: skip

_MAP = _LOCAL.changed(level="map", places=4, n_step=6, learning_rate=1e-3, epsilon=0.05, rounds=120)

_LIVE = _MAP.changed(
    level="live", places=0, n_step=8, learning_rate=5e-4, futures=32, fresh_futures=8, test_walks=16, rounds=100
)

_DEFAULT: dict[Information, TrainConfig] = {"position": _POSITION, "local": _LOCAL, "map": _MAP, "live": _LIVE}

# Each of a gradient step's 64 transitions, the latest of each walker, changes its number by 1/64 of its error: where
# all are of one crossing and exit, it still does not overshoot.
_TABLE = _POSITION.changed(
    table=True, batch=64, capacity=64, alpha=0.0, double=False, target_rate=1.0, optimiser="sgd",
    unit=1.0, learning_rate=0.5, learning_rate_end=0.005, keep="best", temperature=0.0, futures=64, futures_reach=0.0,
)  # fmt: skip

_POSITION_ONLY: dict[Preset, TrainConfig] = {"paper": _PAPER, "tabular-q": _TABLE}

_MANY_NODES = 500
"""From here on forecasts take so long that level ``live`` has to do with fewer futures."""

_TABULATED = 36 * 1_024
"""Nodes times futures that level ``position`` learns from: on larger maps there are fewer futures, down to 64."""

# Streets in towns are short, and jams make some walks many times longer than most: hence long returns, small steps,
# errors that do not count by their squares.
_TOWN = {"rounds": 60, "n_step": 16, "huber": 1.0, "learning_rate": 2e-4, "epsilon": 0.02, "test_walks": 32}

_MARGINS: dict[Information, float] = {"map": 3.0, "live": 30.0}
"""Seconds that a correction must save where crowds are interpolated between counters.

Streets are alike there, and what is learned of them is small against the walk. Forecasts from counts are nearly exact,
and corrections to them seldom right.
"""


@checked(TrainConfigError, several_maps=FLAG, nodes=whole())
def preset(name: Preset, level: Information = "position", *, several_maps: bool = False, nodes: int = 0) -> TrainConfig:
    """Get a way to learn by its name.

    Parameters
    ----------
    name
        ``default`` is ours. ``paper`` has the settings as printed. ``dqn`` is the default without dueling heads,
        double Q-learning and priorities. ``tabular-q`` is Q-learning with a table of crossings and exits.
    level
        What the walker observes. ``paper`` and ``tabular-q`` exist at level ``position`` only.
    several_maps
        Whether several maps are learned; then nothing is remembered of their nodes.
    nodes
        Nodes of the map, such as ``scenario.place.nodes``. Futures of large maps take much memory, and forecasts long,
        so that levels ``position`` and ``live`` have fewer futures there. If it is left out, level ``position`` has the
        1,024 futures of the paper's grids, which take gigabytes on a grid of 32 × 32 crossings.

    Returns
    -------
    TrainConfig
        The settings, to be used as they are or :meth:`~sidestep.TrainConfig.changed`.

    Raises
    ------
    TrainConfigError
        The preset or the level does not exist, or not together.

    Examples
    --------
    >>> from sidestep import preset
    >>> preset("paper").learning_rate
    0.0001
    >>> preset("default", "map").n_step
    6
    """
    for field, value, known in (("preset", name, get_args(Preset)), ("level", level, LEVELS)):
        if value not in known:
            raise TrainConfigError(f"unknown {field} {value!r:.60}{hint(value, known)}", field=field)
    if several_maps and level == "position":
        raise TrainConfigError(
            "coordinates mean nothing on maps that were never walked; train at another level", field="level"
        )
    if name in _POSITION_ONLY:
        if level != "position":
            raise TrainConfigError(
                f"the preset {name} knows the walker's position alone; there is none for level {level}", field="preset"
            )
        return _POSITION_ONLY[name]
    config = _DEFAULT[level]
    if level == "position" and nodes:
        config = config.changed(futures=min(max(_TABULATED // nodes, 64), config.futures))
    if several_maps:
        config = config.changed(places=0, futures=16, fresh_futures=4, destinations=4)
    if level == "live" and nodes > _MANY_NODES:
        config = config.changed(futures=16, fresh_futures=1, test_walks=8, rounds=80)
    return config.changed(dueling=False, double=False, alpha=0.0) if name == "dqn" else config


def preset_for(scenario: Scenario, name: Preset, level: Information | None = None) -> TrainConfig:
    """Get the preset that fits a scenario's maps.

    Parameters
    ----------
    scenario
        What is to be learned.
    name
        As for :func:`preset`.
    level
        What the walker observes; the scenario's own level by default.

    Returns
    -------
    TrainConfig
        The settings.

    Raises
    ------
    TrainConfigError
        The preset does not exist at this level, or nothing can be learned there at it.
    """
    level, place = level or scenario.level, scenario.place
    if not place.anywhere:
        return preset(name, level, several_maps=place.training_maps > 0, nodes=place.nodes)
    if level == "position":
        raise TrainConfigError(
            f"a walker that observes its position alone cannot learn to walk anywhere in {scenario.name}", field="level"
        )
    nodes = len(walked_streets(place.streets, scenario.walker).crossings)
    destinations = min(32, len(place.destinations) or 32, max(nodes - 2, 1))
    each = 32 // destinations * destinations  # the same number of futures for every destination
    config = preset(name, level, several_maps=True).changed(
        **_TOWN, destinations=destinations, futures=2 * each, fresh_futures=each
    )
    if place.interpolated and level in _MARGINS:
        config = config.changed(correction_margin_seconds=_MARGINS[level], estimate_when_revisiting=True)
    if level == "live":  # forecasts take too long to be renewed
        return config.changed(futures=3 * each, fresh_futures=0, learning_rate=1e-4, rounds=40)
    return config


PRESETS: dict[str, TrainConfig] = {name: preset(name) for name in ("paper", "default", "dqn", "tabular-q")}
"""The presets of level ``position``, by name."""
