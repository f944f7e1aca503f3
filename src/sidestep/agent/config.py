"""How to learn: every setting of a training run, and the presets."""

from dataclasses import dataclass, replace
from typing import Literal

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
    hidden: tuple[int, ...]
    one_hot: bool  # tell the network the crossing itself beside its coordinates
    unit: float  # rewards per unit of the network's heads
    target_period: int  # K: iterations between updates of the target network
    target_rate: float  # how far it then moves; 1 copies
    optimiser: Literal["rmsprop", "adam"]
    learning_rate: float
    learning_rate_end: float  # reached linearly at the end
    decay: float  # RMSProp's α, the memory of squared gradients
    damping: float  # RMSProp's σ
    epsilon: float
    epsilon_end: float
    epsilon_share: float  # share of the training in which ε falls linearly from one to the other
    random_origins: float  # share of the training whose episodes start anywhere
    keep: Literal["best", "last"]  # which network to return: that of the best test walks, or the last

    def __post_init__(self) -> None:
        for name in ("rounds", "round_steps", "walkers", "batch", "capacity", "target_period"):
            if getattr(self, name) < 1:
                raise TrainConfigError(f"{name} must be at least 1, not {getattr(self, name)}")
        for name in ("gamma", "alpha", "beta", "epsilon", "epsilon_end", "target_rate", "random_origins"):
            if not 0 <= getattr(self, name) <= 1:
                raise TrainConfigError(f"{name} must lie between 0 and 1, not {getattr(self, name)}")
        if not 0 < self.epsilon_share <= 1:
            raise TrainConfigError(f"epsilon_share must lie above 0 and up to 1, not {self.epsilon_share}")
        for name in ("round_steps", "capacity"):
            if getattr(self, name) % self.walkers:
                raise TrainConfigError(
                    f"{name} must be a multiple of the {self.walkers} walkers, not {getattr(self, name)}"
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


PRESETS = {
    "paper": TrainConfig(
        rounds=50, round_steps=1_000, walkers=1, batch=32, capacity=10_000, alpha=0.6, beta=0.4, priority_floor=0.01,
        gamma=0.95, double=False, hidden=(50, 50), one_hot=False, unit=1.0, target_period=200, target_rate=1.0,
        optimiser="rmsprop", learning_rate=1e-4, learning_rate_end=1e-4, decay=0.9, damping=1e-10,
        epsilon=0.1, epsilon_end=0.1, epsilon_share=1.0, random_origins=0.0, keep="last",
    ),
    "default": TrainConfig(
        rounds=40, round_steps=2_560, walkers=64, batch=256, capacity=20_032, alpha=0.6, beta=1.0, priority_floor=0.01,
        gamma=1.0, double=True, hidden=(50, 50), one_hot=True, unit=10.0, target_period=1, target_rate=0.02,
        optimiser="adam", learning_rate=3e-3, learning_rate_end=0.0, decay=0.9, damping=1e-10,
        epsilon=1.0, epsilon_end=0.05, epsilon_share=0.3, random_origins=0.5, keep="best",
    ),
}  # fmt: skip
