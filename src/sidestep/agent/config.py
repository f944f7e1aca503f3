"""How to learn: every setting of a training run, and the presets."""

from dataclasses import dataclass, replace
from typing import Literal

from sidestep.environment.types import Seen
from sidestep.errors import SidestepError
from sidestep.scenarios.catalogue import Scenario
from sidestep.scenarios.towns import town_of


@dataclass(frozen=True)
class TrainConfig:
    """How to learn. A *round* is ``round_steps`` environment steps, followed by greedy test walks."""

    rounds: int
    round_steps: int
    walkers: int  # walking side by side; each iteration takes one step of each, then one gradient step
    batch: int
    capacity: int  # of the replay
    alpha: float  # prioritisation; 0 is uniform
    beta: float  # importance correction; 1 is full
    priority_floor: float  # added to abs(δ), in units of reward
    gamma: float
    double: bool
    hidden: tuple[int, ...]  # widths of the hidden layers
    one_hot: bool  # tell the network the crossing itself beside its coordinates
    unit: float  # rewards per unit of the network's heads
    target_period: int  # K: iterations between updates of the target network
    target_rate: float  # how far it then moves; 1 copies
    optimiser: Literal["rmsprop", "adam", "sgd"]
    learning_rate: float
    learning_rate_end: float  # reached linearly at the end
    decay: float  # RMSProp's α, the memory of squared gradients
    damping: float  # RMSProp's σ
    epsilon: float
    epsilon_end: float
    epsilon_share: float  # share of the training in which ε falls linearly from one to the other
    random_origins: float  # share of the training whose episodes start anywhere; with several goals all of it
    keep: Literal["best", "last"]  # which network to return: that of the best test walks, or the last
    level: Seen = "position"  # what the walker sees
    table: bool = False  # level position: a number for every crossing and exit instead of a network
    dueling: bool = True  # value and advantage apart
    potential: bool = True  # beyond level position: Q corrects the level's own estimate of the time to go
    places: int = 0  # numbers to learn about each node and time of day, where the map is always the same
    n_step: int = 1  # steps of each return
    goals: int = 1  # destinations to learn, the scenario's own first
    crowds: int = 64  # futures that training walks meet; the test walks have their own
    fresh_crowds: int = 0  # how many of them are replaced by others after every round
    huber: float = 0.0  # beyond it errors count in proportion, not by their squares; in units of reward, 0: never
    test_walks: int = 10  # greedy walks after every round, as in the paper

    def __post_init__(self) -> None:
        self._check_sizes()
        for name in ("gamma", "alpha", "beta", "epsilon", "epsilon_end", "target_rate", "random_origins"):
            if not 0 <= getattr(self, name) <= 1:
                raise TrainConfigError(f"{name} must lie between 0 and 1, not {getattr(self, name)}")
        if not 0 < self.epsilon_share <= 1:
            raise TrainConfigError(f"epsilon_share must lie above 0 and up to 1, not {self.epsilon_share}")
        self._check_crowds()

    def _check_sizes(self) -> None:
        for name in (
            "rounds", "round_steps", "walkers", "batch", "capacity", "target_period", "n_step", "goals", "crowds",
            "test_walks",
        ):  # fmt: skip
            if getattr(self, name) < 1:
                raise TrainConfigError(f"{name} must be at least 1, not {getattr(self, name)}")
        if self.n_step > self.iterations:
            raise TrainConfigError(
                f"n_step must be at most the {self.iterations} iterations of a round, not {self.n_step}"
            )
        for name in ("places", "fresh_crowds", "huber"):
            if getattr(self, name) < 0:
                raise TrainConfigError(f"{name} must not be negative, not {getattr(self, name)}")
        for name in ("round_steps", "capacity"):
            if getattr(self, name) % self.walkers:
                raise TrainConfigError(
                    f"{name} must be a multiple of the {self.walkers} walkers, not {getattr(self, name)}"
                )

    def _check_crowds(self) -> None:
        if self.level == "position" and self.goals > 1:
            raise TrainConfigError(f"a walker that sees its position alone cannot tell {self.goals} destinations apart")
        if self.fresh_crowds and self.crowds % self.fresh_crowds:
            raise TrainConfigError(
                f"fresh_crowds must divide the {self.crowds} crowds, so {self.fresh_crowds} will not do"
            )
        if self.level == "live" and (self.crowds % self.goals or self.fresh_crowds % self.goals):
            raise TrainConfigError(
                f"at level live goals must divide the {self.crowds} crowds and the {self.fresh_crowds} fresh ones, "
                f"so {self.goals} will not do"
            )

    @property
    def iterations(self) -> int:
        """Gradient steps in a round."""
        return self.round_steps // self.walkers


class TrainConfigError(SidestepError):
    """A setting that cannot be."""


def changed(config: TrainConfig, **settings: float | None) -> TrainConfig:
    """A configuration with some settings changed; None leaves one as it is."""
    return replace(config, **{name: value for name, value in settings.items() if value is not None})  # type: ignore[arg-type]


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
    level="local", places=8, fresh_crowds=32, test_walks=50,
)  # fmt: skip
_MAP = replace(
    _LOCAL, level="map", places=4, n_step=6, learning_rate=1e-3, epsilon=0.05, rounds=120,
)  # fmt: skip
_LIVE = replace(
    _MAP, level="live", places=0, n_step=8, learning_rate=5e-4, crowds=32, fresh_crowds=8, test_walks=16, rounds=100,
)  # fmt: skip
_DEFAULT: dict[Seen, TrainConfig] = {"position": _POSITION, "local": _LOCAL, "map": _MAP, "live": _LIVE}

_MANY_NODES = 500
Preset = Literal["default", "paper", "dqn", "tabular-q"]


def preset(name: Preset, level: Seen = "position", *, several_maps: bool = False, nodes: int = 0) -> TrainConfig:
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
        config = replace(config, places=0, crowds=16, fresh_crowds=4, goals=4)
    if level == "live" and nodes > _MANY_NODES:
        config = replace(config, crowds=16, fresh_crowds=1, test_walks=8, rounds=80)
    return replace(config, dueling=False, double=False, alpha=0.0) if name == "dqn" else config


def preset_for(scenario: Scenario, name: Preset, level: Seen | None = None) -> TrainConfig:
    """The preset that fits a scenario's maps, at its own level unless another is given."""
    if scenario.venue is not None and (level or scenario.level) == "position":
        raise TrainConfigError(
            f"a walker that sees its position alone cannot learn to walk anywhere in {scenario.name}"
        )
    several = bool(scenario.training_maps) or scenario.venue is not None
    config = preset(name, level or scenario.level, several_maps=several, nodes=scenario.side**2)
    if scenario.venue is None:
        return config
    # Streets are short, and jams make some walks many times longer than most: hence long returns, small steps, errors
    # that do not count by their squares.
    config = replace(config, rounds=60, n_step=16, huber=1.0, learning_rate=2e-4, epsilon=0.02, test_walks=32)
    # Crowds are for goals in turn, old ones and those that replace them alike, so their numbers are multiples of it.
    nodes = town_of(scenario.venue.streets).nodes
    goals = min(32, len(scenario.venue.destinations) or 32, max(nodes - 2, 1))
    fresh = 32 // goals * goals
    if config.level == "live":  # forecasts take too long to be renewed
        return replace(config, goals=goals, crowds=3 * fresh, fresh_crowds=0, learning_rate=1e-4, rounds=40)
    return replace(config, goals=goals, crowds=2 * fresh, fresh_crowds=fresh)


# Each of a gradient step's 64 transitions, the latest of each walker, changes its number by 1/64 of its error: where
# all are of one crossing and exit, it still does not overshoot.
_TABLE = replace(
    _POSITION, table=True, batch=64, capacity=64, alpha=0.0, double=False, target_rate=1.0, optimiser="sgd",
    unit=1.0, learning_rate=0.5, learning_rate_end=0.005,
)  # fmt: skip
PRESETS = {"paper": _PAPER, "default": _POSITION, "dqn": preset("dqn"), "tabular-q": _TABLE}
