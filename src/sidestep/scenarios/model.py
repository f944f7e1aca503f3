"""A whole problem as plain values: where people walk, through which crowds, how fast, and what they keep low.

Nothing here is drawn or computed: :mod:`sidestep.scenarios.maps` makes streets and crowds of a scenario. How to
write one as a file: docs/scenarios.md.
"""

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from sidestep.arguments import instance
from sidestep.crowds.base import SLOT_SECONDS
from sidestep.environment.types import Information, RewardWeights
from sidestep.scenarios import values
from sidestep.scenarios.places import Grid, Place
from sidestep.scenarios.spec import ScenarioError, Spec
from sidestep.scenarios.walkers import ADULT, AnyWalker
from sidestep.walking.crossing_time import CrossingRule
from sidestep.walking.objective import TravelTime, WeightedObjective
from sidestep.walking.speed_laws import Law, SpeedLaw

MOST_WEIGHT = 100.0  # of anything in an objective; sums of larger ones are lost in single precision
MOST_SLOTS = 10_000  # of one walk; futures are worked out for each of them
Flows = Literal["arima", "forecast"]


class RewardSpec(Spec):
    """Weights of eq. 13, as corrected (:class:`sidestep.environment.types.RewardWeights`)."""

    unit_seconds: values.Positive = 60.0
    """Seconds of cost that make one unit of reward; the paper's -67 are minutes."""
    progress: float = 1e-3
    """w_r, for each metre of straight-line distance."""
    bonus: float = 1.0
    """On arrival."""


Weight = Annotated[float, Field(ge=0, le=MOST_WEIGHT)]


class ObjectiveSpec(Spec):
    """What walkers keep low: a weighted sum, by default time alone (:mod:`sidestep.walking.objective`)."""

    time: Weight = 1.0
    """For each second."""
    distance: Weight = 0.0
    """Seconds for each metre."""
    exposure: Weight = 0.0
    """Seconds for each person·s/m² met: the density, integrated over the walk."""
    max_density: values.Positive | None = None
    """Persons/m² above which nobody should enter a street; by default none."""
    measured: bool = False
    """Whether distance and crowds met are measured even where time alone counts, which takes time and memory."""

    @model_validator(mode="after")
    def _not_exposure_alone(self) -> "ObjectiveSpec":
        if not self.time and not self.distance:
            raise ValueError("must give time or distance a weight: by exposure alone all empty paths are the same")
        return self

    @property
    def is_time(self) -> bool:
        """Whether time alone counts and nothing else is measured."""
        return self == ObjectiveSpec()

    def to_json(self) -> dict[str, float | None] | None:
        """The weights; None where time alone counts."""
        return None if self.is_time else self.model_dump(exclude={"measured"})


def objective_of(objective: ObjectiveSpec) -> TravelTime | WeightedObjective:
    """What walkers keep low, as environments have it."""
    return TravelTime() if objective.is_time else WeightedObjective(**objective.model_dump(exclude={"measured"}))


def reward_of(reward: RewardSpec) -> RewardWeights:
    """What an agent is rewarded for, as environments have it."""
    return RewardWeights(**dict(reward))


WORDS = {
    "time": ObjectiveSpec(),
    "distance": ObjectiveSpec(time=0.0, distance=1.0),
    # Exposure counts a hundredth of time as well: paths on which nobody is met would otherwise all be the same.
    "exposure": ObjectiveSpec(time=0.01, exposure=1.0),
}
WEIGHTS = ("time", "distance", "exposure", "max_density")


def read_objective(text: str) -> ObjectiveSpec:
    """``time``, ``distance``, ``exposure``, or weights such as ``exposure=0.5,max_density=4``.

    Parameters
    ----------
    text
        Time has a weight of 1 unless another is given. :class:`ObjectiveSpec` has the units.

    Returns
    -------
    ObjectiveSpec
        What the word or the weights say.

    Raises
    ------
    ScenarioError
        Unknown words, and weights that are no numbers or out of range.
    """
    if text.strip() in WORDS:
        return WORDS[text.strip()]
    weights: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = (each.strip() for each in part.partition("="))
        if name not in WEIGHTS or name in weights:
            raise ScenarioError(
                f"objective must be {', '.join(WORDS)}, or weights of {', '.join(WEIGHTS)}, such as "
                f"exposure=0.5,max_density=4, not {text!r:.80}",
                field="objective",
            )
        try:
            weights[name] = float(value)
        except ValueError as error:
            raise ScenarioError(f"objective: {name} must be a number, not {value!r:.40}", field=name) from error
    try:
        return ObjectiveSpec().changed(**weights)
    except ScenarioError as error:
        error.field = error.field or "objective"
        raise


def objective_in_words(objective: dict[str, float | None]) -> str:
    """An objective's weights, by name, for people."""
    units = {"time": "s", "distance": "m", "exposure": "person·s/m² met"}
    terms = [f"{weight:g} x {units[name]}" for name, weight in objective.items() if name in units and weight]
    most = objective["max_density"]
    return " + ".join(terms) + ("" if most is None else f", avoiding streets above {most:g} persons/m²")


class Scenario(Spec):
    """A whole problem. The defaults are the paper's (section V-A), or stand for what it leaves open.

    Examples
    --------
    >>> from sidestep.scenarios.model import Scenario
    >>> from sidestep.scenarios.places import Grid
    >>> small = Scenario(name="small", place=Grid(side=3), horizon=3600.0)
    >>> small.slots
    12
    >>> small.changed(side=4, law="weidmann").place.side
    4
    >>> small.changed(horizon=-1.0)
    Traceback (most recent call last):
    sidestep.scenarios.spec.ScenarioError: horizon must be greater than 0, not -1.0
    """

    name: values.Line
    summary: values.Remark = ""
    """One line; may be empty."""
    place: Annotated[Place, Field(discriminator="kind")] = Grid()
    """Streets, and the crowds on them."""
    flows: Flows = "arima"
    """Crowds with the noise of their model, whichever that is, or the forecast only."""
    horizon: values.Positive = 24 * 3600.0
    """Seconds after which a walk is given up, and counts as that long."""
    departures: values.Range = (0.0, 0.0)
    """Earliest and latest departure, in seconds after clock 0."""
    slot_seconds: values.Positive = SLOT_SECONDS
    """Seconds in which crowds do not change."""
    law: Law = "power"
    """Speed by density; ``power`` is the paper's, above free speed where there is less than a person per m²."""
    rule: CrossingRule = "integrated"
    """How a segment is crossed while crowds change (:mod:`sidestep.walking.crossing_time`)."""
    walker: AnyWalker = ADULT
    """Who walks, or the kind of walker alone, such as ``"wheelchair"``."""
    reward: RewardSpec = RewardSpec()
    """What an agent is rewarded for."""
    objective: ObjectiveSpec = ObjectiveSpec()
    """What walkers keep low."""
    level: Information = "position"
    """What the agents see that learn it, unless told otherwise."""
    maps: values.Count = 10
    """Maps of a comparison, unless told otherwise."""
    walks: values.Count = 20
    """Walks on each of them."""

    inner: ClassVar[str] = "place"

    _empty_streets = values.across(
        "law",
        lambda law, given: law != "power" or not given["place"].anywhere,
        "must have a speed on the empty streets of a venue, as power-capped and weidmann do",
    )
    _own_law = values.across(
        "walker",
        lambda walker, given: walker.law != "power" or not given["place"].anywhere,
        "must have a law with a speed on the empty streets of a venue, as power-capped and weidmann are",
    )
    _few_slots = values.across(
        "slot_seconds",
        lambda seconds, given: (given["horizon"] + given["departures"][1]) / seconds <= MOST_SLOTS,
        f"must give at most {MOST_SLOTS:,} slots up to the horizon",
    )

    @property
    def called(self) -> str:
        return f"{self.name}, {self.place.called},"

    @property
    def speed_law(self) -> SpeedLaw:
        """Speed of its walker by density."""
        return self.walker.speed_law(self.law)

    @property
    def crowd_model(self) -> str:
        """What moves the crowds: a model of them, or a forecast."""
        return self.flows if self.flows == "forecast" else self.place.crowd_model

    @property
    def slots(self) -> int:
        """Slots from the scenario's start to the horizon of the latest departure."""
        return math.ceil((self.departures[1] + self.horizon) / self.slot_seconds)


A_SCENARIO = instance(Scenario, "a scenario, such as sidestep.scenario('rush-16')")
"""What public functions take as their scenario."""
