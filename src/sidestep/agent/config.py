"""How to learn: every setting of a training run."""

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from sidestep.environment.types import Information
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.spec import Spec, SpecError
from sidestep.scenarios.values import NonNegative, Positive, across

Count = Annotated[int, Field(ge=1)]
CountFrom0 = Annotated[int, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]


def _at_position(field: str, only: float, requirement: str) -> Any:
    """Allow a field only one value at level ``position``."""
    return across(field, lambda value, given: value == only or given["level"] != "position", f"must be {requirement}")


def _multiple_of_walkers(field: str) -> Any:
    return across(field, lambda number, given: number % given["walkers"] == 0, "must be a multiple of walkers")


def _at_most_futures(field: str) -> Any:
    return across(field, lambda number, given: number <= given["futures"], "must be at most futures")


_MOST_STEPS = 2**31
"""Steps are counted in 32 bits."""


class TrainConfigError(SpecError):
    """A setting that is missing, unknown, out of range or at odds with another; ``field`` names it."""


class TrainConfig(Spec):
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
    sidestep.agent.config.TrainConfigError: gamma must be at most 1, not 1.5
    """

    refusal: ClassVar[type[SpecError]] = TrainConfigError
    called: ClassVar[str] = "a training configuration"

    rounds: Count
    """Training rounds in all."""
    walkers: Count
    """Walkers side by side. Each iteration takes one step of each, then one gradient step."""
    round_steps: Count
    """Environment steps in a round, over all walkers."""
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
    unit: Positive
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
    keep: Literal["best", "last", "mean"]
    """The network that a run results in: that of the best test walks, the last, or the mean of those after each of the
    last quarter of rounds, or the last if training ends before that quarter."""
    level: Information = "position"
    """What the walker observes."""
    temperature: NonNegative = 0.0
    """Steps of training that are not random take each exit in proportion to exp(Q / temperature), in units of reward:
    exits nearly as good as the best are then tried nearly as often. 0 takes the best alone."""
    table: bool = False
    """Level ``position``: learn a number for every crossing and exit instead of a network."""
    dueling: bool = True
    """Learn value and advantage apart."""
    potential: bool = True
    """Beyond level ``position``: Q is a correction to the level's own estimate of the cost to go."""
    places: CountFrom0 = 0
    """Numbers to learn for each node and quarter of an hour, where the map is always the same."""
    n_step: Count = 1
    """Steps in each return."""
    futures: Count = 64
    """Futures that training walks meet; test walks have their own."""
    futures_reach: NonNegative = 0.0
    """On grids: how far futures of training and test walks reach, in times that a straight walk from corner to corner
    takes at free speed. Later, crowds stay as they are then. 0 reaches to the horizon."""
    fresh_futures: CountFrom0 = 0
    """Futures that are replaced by new ones after every round, in turn."""
    destinations: Count = 1
    """Destinations to learn, the scenario's own first."""
    huber: NonNegative = 0.0
    """Error, in units of reward, beyond which losses grow linearly instead of by the square; 0 is never."""
    test_walks: Count = 10
    """Greedy walks after every round, as in the paper."""
    patience: CountFrom0 = 0
    """Rounds after which training ends early if all of their test walks took as long as those before, to the bit, and
    arrived; 0 trains all rounds. With 12, a training of the preset ``default`` takes half the time where crowds come as
    forecast, and one in a hundred ends 0.3 % off the best plan."""
    correction_margin_seconds: NonNegative = 0.0
    """Deployed and in test walks: leave the exit that the level's estimate prefers only for one whose learned value is
    better by more than this."""
    estimate_when_revisiting: bool = False
    """Deployed and in test walks: follow the level's estimate at crossings that this walk has left before. Estimates
    never lead in circles; learned corrections may."""

    _countable = across(
        "round_steps",
        lambda steps, given: steps * given["rounds"] < _MOST_STEPS,
        f"must be less than {_MOST_STEPS:,} in all rounds together",
    )
    _whole_round = _multiple_of_walkers("round_steps")
    _whole_ring = _multiple_of_walkers("capacity")
    _return_in_round = across(
        "n_step",
        lambda steps, given: steps <= given["round_steps"] // given["walkers"],
        "must be at most the iterations of a round (round_steps over walkers)",
    )
    _fresh_ones = _at_most_futures("fresh_futures")
    _future_each = _at_most_futures("destinations")
    _told_apart = _at_position("destinations", 1, "1 at level position (the walker does not know its destination)")
    _margin = _at_position("correction_margin_seconds", 0, "0 at level position (it has no estimate)")
    _revisiting = _at_position("estimate_when_revisiting", False, "false at level position (it has no estimate)")

    @property
    def iterations(self) -> int:
        """Gradient steps in a round."""
        return self.round_steps // self.walkers

    @property
    def span(self) -> int:
        """Gradient steps in a row, by which rounds divide, without a move of the target network between them."""
        return math.gcd(self.iterations, self.target_period)

    @property
    def rounds_before_mean(self) -> int:
        """Rounds before the last quarter, of which the mean network is."""
        return self.rounds - math.ceil(self.rounds / 4)

    @property
    def remembers_places(self) -> bool:
        """Whether what is learned is of the nodes of one map."""
        return self.level == "position" or self.places > 0


def settings_by_name(scenario: Scenario, seed: int, map_number: int, config: TrainConfig | None) -> dict[str, Any]:
    """Name all that a training depends on.

    Parameters
    ----------
    scenario, seed, map_number, config
        What is learned, the seed of all of it, and how; no configuration where only planners walk.

    Returns
    -------
    dict
        Values as in JSON: the scenario's fields, with dots, ``seed``, ``map`` and the fields of the configuration.
    """
    fields = _flat(scenario.model_dump(mode="json"), "scenario.")
    settings = {} if config is None else config.model_dump(mode="json")
    return {**fields, "seed": seed, "map": map_number, **settings}


def _flat(fields: dict[str, Any], prefix: str) -> dict[str, Any]:
    """The same without dictionaries in it, whose fields have names with dots instead."""
    flat: dict[str, Any] = {}
    for name, value in fields.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat


def differences(mine: dict[str, Any], theirs: dict[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Both values of every setting that is not the same; None where one has no such setting."""
    return {name: (mine.get(name), theirs.get(name)) for name in mine | theirs if mine.get(name) != theirs.get(name)}
