"""The trade-off between time and crowds: the same walks with more and more weight on the crowd met (exposure)."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np

from sidestep.errors import SidestepError
from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import Record
from sidestep.planners.registry import (
    BASELINE,
    BOUND,
    REFERENCE,
    PlannerError,
    choose_planners,
    find_planner,
    planner_infos,
)
from sidestep.plotting import TradeOffPoint
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.streets import attribution_of, sources_of, walker_facts

WEIGHTS = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Weights of exposure, in seconds for each person·s/m²."""

WALKS = 20
CURVES = (BASELINE, BOUND)


class TradeOffJson(TypedDict):
    """The shape of ``trade-off --json``."""

    scenario: str
    summary: str

    synthetic: str
    """What is invented of its crowds; empty where nothing is."""

    walker: dict[str, Any] | None
    """The walker's numbers, and how many streets are left out; None for the adult that walks unless told otherwise."""

    walks: int
    seed: int

    curves: dict[str, list[TradeOffPoint]]
    """By planner, in the order of the weights."""

    shortest_path: TradeOffPoint

    attribution: str
    """Whose streets they are; empty on grids."""


@dataclass(frozen=True)
class TradeOff:
    """The results of :func:`trade_off`."""

    scenario: Scenario
    walks: int
    seed: int
    curves: dict[str, list[TradeOffPoint]]
    """By planner, in the order of the weights."""

    shortest_path: TradeOffPoint

    @property
    def title(self) -> str:
        """Heading of the picture."""
        shortest = self.shortest_path
        return (
            f"{self.scenario.name}, map 0, seed {self.seed}: means of {self.walks} walks, labelled by weight of "
            f"exposure\nshortest-path: {shortest['minutes']:.1f} min and {shortest['exposure']:,.0f} person·s/m²"
        )

    @property
    def caption(self) -> str:
        """Text below the picture: where crowds and streets come from."""
        return "\n".join(sources_of(self.scenario))

    def to_json(self) -> TradeOffJson:
        """Sum up in the shape of ``trade-off --json``."""
        return {
            "scenario": self.scenario.name,
            "summary": self.scenario.summary,
            "synthetic": self.scenario.place.synthetic,
            "walker": walker_facts(self.scenario),
            "walks": self.walks,
            "seed": self.seed,
            "curves": self.curves,
            "shortest_path": self.shortest_path,
            "attribution": attribution_of(self.scenario.place),
        }


def trade_off(
    scenario: Scenario,
    *,
    planners: Iterable[str] = CURVES,
    weights: Sequence[float] = WEIGHTS,
    walks: int = WALKS,
    seed: int = 0,
    on_weight: Callable[[float], None] = lambda _weight: None,
) -> TradeOff:
    """Take the same walks on map 0 with one weight of exposure after the other.

    Parameters
    ----------
    scenario
        The problem. Other weights than that of exposure are those of its objective.
    planners
        Names of planners that need no training; a curve each.
    weights
        Weights of exposure, in seconds for each person·s/m².
    walks
        Number of walks for each weight.
    seed
        Seed of map and crowds.
    on_weight
        Called as each weight is done.

    Returns
    -------
    TradeOff
        One curve for each planner.

    Raises
    ------
    PlannerError
        Planners that are unknown or learn.
    SidestepError
        Weights that are negative, too large or given twice.
    """
    if len(set(weights)) < len(weights):
        raise SidestepError(f"weights of exposure must all be different, not {weights}", field="weights")
    given = tuple(planners)
    infos = planner_infos()
    for name in given:
        if name in infos and infos[name].learns:
            raise PlannerError(f"{name} learns; a trade-off takes planners that need no training", field="planner")
    names = list(dict.fromkeys(find_planner(name).name for name in given))
    every = choose_planners(scenario, names).factories
    chosen = {name: every[name] for name in every if name in (*names, REFERENCE)}
    base = scenario.objective.changed(measured=True)
    problems = {weight: scenario.changed(objective=base.changed(exposure=weight)) for weight in sorted(weights)}
    records: dict[float, dict[str, Record]] = {}
    for weight, problem in problems.items():
        records[weight] = compare(problem, chosen, maps=[0], walks=walks, seed=seed).records
        on_weight(weight)
    curves = {name: [_point(weight, found[name]) for weight, found in records.items()] for name in names}
    return TradeOff(scenario, walks, seed, curves, _point(None, records[min(weights)][REFERENCE]))


def _point(weight: float | None, record: Record) -> TradeOffPoint:
    return {
        "weight": weight,
        "minutes": float(np.mean(record.minutes)),
        "exposure": float(np.mean(record.totals["exposure"])),
        "metres": float(np.mean(record.totals["metres"])),
        "arrival_rate": float(np.mean(record.arrived)),
    }
