"""All planners by name."""

from collections.abc import Callable, Iterable, Mapping

from sidestep.errors import SidestepError
from sidestep.planners.base import Planner
from sidestep.planners.random import RandomProgress, RandomWalk
from sidestep.planners.reactive import Forecast, GreedyLocal, GreedyMap, Snapshot
from sidestep.planners.shortest_path import ShortestPath
from sidestep.planners.time_dependent import Clairvoyant, Expected
from sidestep.scenarios.maps import ScenarioMap

REFERENCE, BOUND, BASELINE = "shortest-path", "clairvoyant", "expected"  # rows that the others are set against
PlannerFactory = Callable[[ScenarioMap, int], Planner | None]  # for map and its number; None skips this map and later


BASELINES: dict[str, PlannerFactory] = {
    RandomWalk.name: lambda *_: RandomWalk(),
    RandomProgress.name: lambda *_: RandomProgress(),
    ShortestPath.name: lambda *_: ShortestPath(),
    Expected.name: lambda *_: Expected(),
    Clairvoyant.name: lambda *_: Clairvoyant(),
}


REPLANNING: dict[str, PlannerFactory] = {
    GreedyLocal.name: lambda *_: GreedyLocal(),
    GreedyMap.name: lambda *_: GreedyMap(),
    Snapshot.name: lambda *_: Snapshot(),
    Forecast.name: lambda *_: Forecast(),
}


class PlannerError(SidestepError):
    """A planner that is not known."""


def choose(names: Iterable[str], factories: Mapping[str, PlannerFactory]) -> dict[str, PlannerFactory]:
    """Pick planners by name; the three that the others are measured against are always among them."""
    wanted = list(dict.fromkeys([*names, REFERENCE, BASELINE, BOUND]))
    for name in wanted:
        if name not in factories:
            raise PlannerError(f"unknown planner {name!r}; there are {', '.join(factories)}")
    return {name: factory for name, factory in factories.items() if name in wanted}
