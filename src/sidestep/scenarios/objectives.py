"""What walkers keep low, as people say it: a word, or weights."""

from sidestep.scenarios.model import ObjectiveSpec
from sidestep.scenarios.spec import ScenarioError

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
        Time has a weight of 1 unless another is given. :class:`sidestep.scenarios.model.ObjectiveSpec` has the units.

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
    return ObjectiveSpec().changed(**weights)


def objective_in_words(objective: dict[str, float | None]) -> str:
    """An objective's weights, by name, for people."""
    units = {"time": "s", "distance": "m", "exposure": "person·s/m² met"}
    terms = [f"{weight:g} x {units[name]}" for name, weight in objective.items() if name in units and weight]
    most = objective["max_density"]
    return " + ".join(terms) + ("" if most is None else f", avoiding streets above {most:g} persons/m²")
