"""The trade-off between time and the crowd that is met: the same walks with more and more weight on exposure."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from sidestep.errors import SidestepError
from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import Record
from sidestep.planners.registry import BASELINE, BASELINES, BOUND, REFERENCE, REPLANNING, choose
from sidestep.plotting import TradeOffPoint
from sidestep.scenarios.build import attribution_of
from sidestep.scenarios.model import Scenario

WEIGHTS = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # s for each person·s/m²
WALKS = 20
CURVES = (BASELINE, BOUND)


class TradeOffJson(TypedDict):
    """The shape of ``trade-off --json``."""

    scenario: str
    summary: str
    walks: int
    seed: int
    curves: dict[str, list[TradeOffPoint]]  # by planner, in the order of the weights
    shortest_path: TradeOffPoint
    attribution: str


@dataclass(frozen=True)
class TradeOff:
    """What :func:`trade_off` found."""

    scenario: Scenario
    walks: int
    seed: int
    curves: dict[str, list[TradeOffPoint]]
    shortest_path: TradeOffPoint

    @property
    def attribution(self) -> str:
        """Whose streets they are; "" on grids."""
        return attribution_of(self.scenario.place)

    @property
    def title(self) -> str:
        """Heading of the picture."""
        shortest = self.shortest_path
        return (
            f"{self.scenario.name}, map 0: means of {self.walks} walks, seed {self.seed}; numbers weigh exposure\n"
            f"shortest-path: {shortest['minutes']:.1f} min and {shortest['exposure']:,.0f} person·s/m²"
        )

    @property
    def caption(self) -> str:
        """What stands below the picture: where crowds and streets come from."""
        return self.scenario.summary + (f"\nStreets: {self.attribution}" if self.attribution else "")

    def as_json(self) -> TradeOffJson:
        """The shape of ``trade-off --json``."""
        return {
            "scenario": self.scenario.name,
            "summary": self.scenario.summary,
            "walks": self.walks,
            "seed": self.seed,
            "curves": self.curves,
            "shortest_path": self.shortest_path,
            "attribution": self.attribution,
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
    """Take the same walks on map 0 for one weight of exposure after the other; other weights are the scenario's own.

    Raises
    ------
    SidestepError
        Planners that are not known or learn, weights that cannot be or come twice.
    """
    names = list(dict.fromkeys(planners))
    if len(set(weights)) < len(weights):
        raise SidestepError(f"weights of exposure must all be different, not {weights}")
    every = choose(names, {**BASELINES, **REPLANNING})
    chosen = {name: factory for name, factory in every.items() if name in (*names, REFERENCE)}
    base = scenario.objective.changed(measured=True)
    problems = {weight: scenario.changed(objective=base.changed(exposure=weight)) for weight in sorted(weights)}
    curves: dict[str, list[TradeOffPoint]] = {name: [] for name in names}
    shortest: list[TradeOffPoint] = []
    for weight, problem in problems.items():
        records = compare(problem, chosen, maps=[0], walks=walks, seed=seed).records
        for name in names:
            curves[name].append(_point(weight, records[name]))
        shortest.append(_point(None, records[REFERENCE]))
        on_weight(weight)
    return TradeOff(scenario, walks, seed, curves, shortest[0])


def _point(weight: float | None, record: Record) -> TradeOffPoint:
    totals = record.totals
    assert totals is not None  # noqa: S101 # there is an objective
    return {
        "weight": weight,
        "minutes": float(np.mean(record.minutes)),
        "exposure": float(np.mean(totals.exposure)),
        "metres": float(np.mean(totals.metres)),
        "arrival_rate": float(np.mean(record.arrived)),
    }
