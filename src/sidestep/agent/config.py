"""How to learn: every setting of a training run, and the presets."""

from dataclasses import dataclass, replace
from typing import Literal

from sidestep.environment.types import Information
from sidestep.errors import SidestepError


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
    level: Information = "position"  # what the walker sees
    table: bool = False  # level position: a number for every crossing and exit instead of a network
    dueling: bool = True  # value and advantage apart
    potential: bool = True  # beyond level position: Q corrects the level's own estimate of the time to go
    places: int = 0  # numbers to learn about each node and time of day, where the map is always the same
    n_step: int = 1  # steps of each return
    destinations: int = 1  # destinations to learn, the scenario's own first
    futures: int = 64  # futures that training walks meet; the test walks have their own
    fresh_futures: int = 0  # how many of them are replaced by others after every round
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
            "rounds", "round_steps", "walkers", "batch", "capacity", "target_period", "n_step", "destinations",
            "futures", "test_walks",
        ):  # fmt: skip
            if getattr(self, name) < 1:
                raise TrainConfigError(f"{name} must be at least 1, not {getattr(self, name)}")
        if self.n_step > self.iterations:
            raise TrainConfigError(
                f"n_step must be at most the {self.iterations} iterations of a round, not {self.n_step}"
            )
        for name in ("places", "fresh_futures", "huber"):
            if getattr(self, name) < 0:
                raise TrainConfigError(f"{name} must not be negative, not {getattr(self, name)}")
        for name in ("round_steps", "capacity"):
            if getattr(self, name) % self.walkers:
                raise TrainConfigError(
                    f"{name} must be a multiple of the {self.walkers} walkers, not {getattr(self, name)}"
                )

    def _check_crowds(self) -> None:
        if self.level == "position" and self.destinations > 1:
            raise TrainConfigError(
                f"a walker that sees its position alone cannot tell {self.destinations} destinations apart"
            )
        if self.fresh_futures and self.futures % self.fresh_futures:
            raise TrainConfigError(
                f"fresh_futures must divide the {self.futures} futures, so {self.fresh_futures} will not do"
            )
        if self.level == "live" and (self.futures % self.destinations or self.fresh_futures % self.destinations):
            raise TrainConfigError(
                f"at level live goals must divide the {self.futures} futures and the {self.fresh_futures} fresh ones, "
                f"so {self.destinations} will not do"
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
