"""How to learn: every setting of a training run."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sidestep.environment.types import Information
from sidestep.errors import SidestepError

Count = Annotated[int, Field(ge=1)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]


class TrainConfigError(SidestepError):
    """A setting that is out of range, unknown or at odds with another; ``field`` names it."""


class TrainConfig(BaseModel):
    """Every setting of a training run.

    A *round* is ``round_steps`` environment steps, followed by greedy test walks. Configurations are frozen and
    hashable; :meth:`changed` makes a checked copy.

    Raises
    ------
    TrainConfigError
        A setting is missing, unknown, of the wrong type, out of range, or at odds with another.

    Examples
    --------
    >>> from sidestep import preset
    >>> config = preset("default", "map").changed(rounds=3, gamma=0.99)
    >>> config.rounds, config.iterations
    (3, 100)
    >>> config.changed(gamma=1.5)
    Traceback (most recent call last):
    sidestep.agent.config.TrainConfigError: gamma must be less than or equal to 1, not 1.5
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    rounds: Count
    """Training rounds in all."""
    round_steps: Count
    """Environment steps in a round, over all walkers."""
    walkers: Count
    """Walkers side by side. Each iteration takes one step of each, then one gradient step."""
    batch: Count
    """Transitions in a gradient step."""
    capacity: Count
    """Transitions that the replay holds."""
    alpha: Share
    """Exponent of prioritisation in the replay; 0 samples uniformly."""
    beta: Share
    """Exponent of the importance weights that correct for prioritisation; 1 corrects in full."""
    priority_floor: NonNegative
    """Added to the absolute temporal-difference error of each transition, in units of reward."""
    gamma: Share
    """Discount factor for each step."""
    double: bool
    """Double Q-learning: the online network chooses the next action, the target network values it."""
    hidden: tuple[Count, ...]
    """Widths of the hidden layers."""
    one_hot: bool
    """Level ``position``: the network is told the crossing itself, one-hot, beside its coordinates."""
    unit: Annotated[float, Field(gt=0)]
    """Units of reward in one unit of the network's heads."""
    target_period: Count
    """Iterations between updates of the target network (the paper's K)."""
    target_rate: Share
    """How far the target network then moves to the online network; 1 copies it."""
    optimiser: Literal["rmsprop", "adam", "sgd"]
    """Rule of gradient descent."""
    learning_rate: NonNegative
    """Learning rate at the beginning."""
    learning_rate_end: NonNegative
    """Learning rate at the end; it changes linearly."""
    decay: Share
    """RMSProp: weight of the past in the mean of squared gradients (α)."""
    damping: NonNegative
    """RMSProp: added to the root of that mean (σ)."""
    epsilon: Share
    """Share of random steps at the beginning."""
    epsilon_end: Share
    """Share of random steps at the end of the fall."""
    epsilon_share: Annotated[float, Field(gt=0, le=1)]
    """Share of the training over which ε falls linearly."""
    random_origins: Share
    """Share of the training whose episodes begin anywhere; with several destinations all of it."""
    keep: Literal["best", "last"]
    """The network that a run results in: that of the best test walks, or the last."""
    level: Information = "position"
    """What the walker observes."""
    table: bool = False
    """Level ``position``: learn a number for every crossing and exit instead of a network."""
    dueling: bool = True
    """Learn value and advantage apart."""
    potential: bool = True
    """Beyond level ``position``: Q is a correction to the level's own estimate of the cost to go."""
    places: Annotated[int, Field(ge=0)] = 0
    """Numbers to learn for each node and quarter of an hour, where the map is always the same."""
    n_step: Count = 1
    """Steps in each return."""
    destinations: Count = 1
    """Destinations to learn, the scenario's own first."""
    futures: Count = 64
    """Futures that training walks meet; test walks have their own."""
    fresh_futures: Annotated[int, Field(ge=0)] = 0
    """Futures that are replaced by new ones after every round, in turn."""
    huber: NonNegative = 0.0
    """Error, in units of reward, beyond which losses grow linearly instead of by the square; 0 is never."""
    test_walks: Count = 10
    """Greedy walks after every round, as in the paper."""
    correction_margin_seconds: NonNegative = 0.0
    """Deployed and in test walks: leave the exit that the level's estimate prefers only for one whose learned value is
    better by at least as many seconds."""
    estimate_when_revisiting: bool = False
    """Deployed and in test walks: follow the level's estimate at crossings that this walk has left before. Estimates
    never lead in circles, learned corrections may."""

    if not TYPE_CHECKING:  # type checkers see the fields as parameters

        def __init__(self, /, **settings: Any) -> None:
            try:
                super().__init__(**settings)
            except ValidationError as error:
                raise _first_fault(error) from error

        __init__.__pydantic_base_init__ = True  # as a field of another model it is validated without it

    @model_validator(mode="after")
    def _check_together(self) -> "TrainConfig":
        if self.n_step > self.iterations:
            raise TrainConfigError(
                f"n_step must be at most the {self.iterations} iterations of a round, not {self.n_step}", field="n_step"
            )
        for name in ("round_steps", "capacity"):
            if getattr(self, name) % self.walkers:
                raise TrainConfigError(
                    f"{name} must be a multiple of the {self.walkers} walkers, not {getattr(self, name)}", field=name
                )
        for name, value in (("destinations", self.destinations), ("fresh_futures", self.fresh_futures)):
            if value > self.futures:
                raise TrainConfigError(f"{name} must be at most the {self.futures} futures, not {value}", field=name)
        if self.level == "position":
            self._check_position()
        return self

    def _check_position(self) -> None:
        needs = {
            "destinations": self.destinations > 1,
            "correction_margin_seconds": self.correction_margin_seconds > 0,
            "estimate_when_revisiting": self.estimate_when_revisiting,
        }
        for name, asked in needs.items():
            if asked:
                raise TrainConfigError(
                    f"{name} needs level local or more: at level position a walker knows neither its destination nor "
                    "an estimate",
                    field=name,
                )

    @property
    def iterations(self) -> int:
        """Gradient steps in a round."""
        return self.round_steps // self.walkers

    def changed(self, **settings: Any) -> "TrainConfig":
        """Copy the configuration with some settings changed, and check it.

        Raises
        ------
        TrainConfigError
            As for a new configuration.
        """
        return TrainConfig(**{**dict(self), **settings})


_FAULTS = {"missing": "is missing", "extra_forbidden": "is not a setting"}


def _first_fault(error: ValidationError) -> TrainConfigError:
    """The first fault, as one sentence."""
    first = error.errors()[0]
    found = first.get("ctx", {}).get("error")
    if isinstance(found, TrainConfigError):
        return found
    field = ".".join(map(str, first["loc"]))
    said = f"{first['msg'].replace('Input should be', 'must be')}, not {first['input']!r}"
    return TrainConfigError(f"{field} {_FAULTS.get(first['type'], said)}", field=field)
