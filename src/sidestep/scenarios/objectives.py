"""What walkers keep low, as people say it: a word, or weights."""

from dataclasses import fields

from sidestep.scenarios.model import ScenarioError
from sidestep.walking.objective import Objective

# Exposure counts a hundredth of time as well: ways on which nobody is met would otherwise all be the same.
WORDS = {
    "time": None,
    "distance": Objective(time=0.0, distance=1.0),
    "exposure": Objective(time=0.01, exposure=1.0),
}
WEIGHTS = tuple(field.name for field in fields(Objective))


def read_objective(text: str) -> Objective | None:
    """``time``, ``distance``, ``exposure``, or weights such as ``exposure=0.5,max_density=4``; None is time alone.

    Time has a weight of 1 unless another is given. :class:`sidestep.walking.objective.Objective` has the units.

    Raises
    ------
    ScenarioError
        Unknown words and weights that are no numbers.
    """
    if text.strip() in WORDS:
        return WORDS[text.strip()]
    weights: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = (each.strip() for each in part.partition("="))
        if name not in WEIGHTS or name in weights:
            raise ScenarioError(
                f"objective must be {', '.join(WORDS)}, or weights of {', '.join(WEIGHTS)}, such as "
                f"exposure=0.5,max_density=4, not {text!r:.80}"
            )
        try:
            weights[name] = float(value)
        except ValueError as error:
            raise ScenarioError(f"objective: {name} must be a number, not {value!r:.40}") from error
    return only_time(Objective(**weights))


def only_time(objective: Objective) -> Objective | None:
    """The same, or None where it is time alone."""
    return None if objective == Objective() else objective


def objective_in_words(objective: dict[str, float | None]) -> str:
    """An objective's weights, by name, for people."""
    units = {"time": "s", "distance": "m", "exposure": "person·s/m² met"}
    terms = [f"{weight:g} x {units[name]}" for name, weight in objective.items() if name in units and weight]
    most = objective["max_density"]
    return " + ".join(terms) + ("" if most is None else f", avoiding streets above {most:g} persons/m²")
