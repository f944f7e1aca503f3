"""Walk the same maps, crowds and departures with every planner."""

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, TypedDict

import jax
import numpy as np
from jaxtyping import Array, Int, Key

from sidestep.arguments import COUNT, FUNCTION, INDEX, MINUTES, SEED, Rule, brief, checked, each
from sidestep.environment.types import LEVELS, EnvParams, Information, Instance
from sidestep.evaluation.metrics import RESAMPLES, Record, Row, join_records, summarise
from sidestep.planners.base import Plan, Planner, plans_ahead, walk_plan
from sidestep.planners.registry import A_NAME, BASELINE, BOUND, REFERENCE, PlannerError, PlannerFactory
from sidestep.scenarios import episodes
from sidestep.scenarios.expectation import expected_pace
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import ScenarioMap, draw_map, purpose_key
from sidestep.scenarios.model import A_SCENARIO, Scenario, objective_of
from sidestep.scenarios.streets import walker_facts

if TYPE_CHECKING:
    from sidestep.evaluation.tables import WalkTable

CHUNK = 200
"""Most walks whose futures are held in memory at a time."""

TOWN_CHUNK = 50
"""The same where each walk has a destination of its own."""

FIRST_SECONDS = 3 * 3600.0
"""Time after the latest departure for which expected times are worked out at first, where most plans take no longer."""

_BELOW_MAP = ("position", "local")
"""Levels at which nobody knows what is expected."""

Factories = Mapping[str, PlannerFactory]
"""Factories of planners by name."""


class Results(TypedDict):
    """A comparison in ``results.json``."""

    scenario: str

    summary: str
    """What the scenario is, and where its crowds come from."""

    synthetic: str
    """What is invented of its crowds; empty where nothing is."""

    flows: str
    """What moves the crowds: forecast, arima, rush, sensors or table."""

    maps: int
    walks: int
    seed: int

    objective: dict[str, float | None] | None
    """Weights of the objective; None where time is all that counts."""

    walker: dict[str, Any] | None
    """The walker's numbers, and how many streets are left out; None for the adult that walks unless told otherwise."""

    baseline: str
    """The planner that ``difference_minutes`` is taken to."""

    by_minutes: float | None
    """Minutes that ``arrive_by`` asks about."""

    planners: dict[str, Row]


@dataclass(frozen=True)
class Comparison:
    """The walks of a comparison."""

    scenario: Scenario
    map_numbers: tuple[int, ...]
    """Numbers of the maps, in the order in which they were walked."""

    walks: int
    """Number of walks on each map."""

    seed: int
    records: dict[str, Record]
    """Walks by planner."""

    @property
    def maps(self) -> int:
        """Number of maps."""
        return len(self.map_numbers)

    def to_frame(self) -> "WalkTable":
        """Put the walks into a table, one row for each walk and planner, as ``compare --walks-out`` writes them.

        Returns
        -------
        pandas.DataFrame
            Columns ``scenario``, ``walker``, ``seed``, ``map``, ``walk`` (from 0 on each map), ``planner``, ``level``,
            ``minutes`` (the horizon where it did not arrive) and ``arrived``; with an objective also ``cost_minutes``,
            ``exposure`` (person·s/m²), ``metres`` and ``too_dense``. The same ``map`` and ``walk`` is the same walk
            through the same crowds for every planner.
        """
        from sidestep.evaluation.tables import walk_table  # pandas takes 0.3 s to import

        return walk_table(self.scenario, self.seed, self.map_numbers, self.records)

    @checked(PlannerError, by=MINUTES, baseline=A_NAME)
    def to_json(self, by: float | None = None, baseline: str = BASELINE) -> Results:
        """Sum up in the shape of ``compare --json`` and ``results.json``.

        Parameters
        ----------
        by
            Minutes to arrive within, for ``arrive_by``.
        baseline
            The planner that the others' minutes are set against.

        Returns
        -------
        Results
            Plain numbers and texts.

        Raises
        ------
        PlannerError
            The baseline, ``shortest-path`` or ``clairvoyant`` has not walked all maps (field ``baseline``).
        """
        return {
            "scenario": self.scenario.name,
            "summary": self.scenario.summary,
            "synthetic": self.scenario.place.synthetic,
            "flows": self.scenario.crowd_model,
            "maps": self.maps,
            "walks": self.walks,
            "seed": self.seed,
            "objective": self.scenario.objective.to_json(),
            "walker": walker_facts(self.scenario),
            "baseline": baseline,
            "by_minutes": by,
            "planners": self.rows(by, baseline),
        }

    def rows(self, by: float | None = None, baseline: str = BASELINE, resamples: int = RESAMPLES) -> dict[str, Row]:
        """Sum up each planner's walks, as :func:`~sidestep.evaluation.metrics.summarise` does."""
        for name in (baseline, REFERENCE, BOUND):
            if name not in self.records or self.records[name].maps < self.maps:
                found = f"{name!r:.60} has not walked all of these maps"
                raise PlannerError(f"{found}; choose it among the planners to compare", field="baseline")
        return summarise(self.records, self.seed, by, baseline, self.scenario.horizon / 60, resamples)


def _factories(value: Any) -> Factories:
    if not isinstance(value, Mapping) or not value or not all(map(callable, value.values())):
        raise TypeError
    return value


@checked(
    PlannerError,
    scenario=A_SCENARIO,
    planners=Rule(
        "must be functions that make planners, by name, such as choose_planners(scenario, names).factories", _factories
    ),
    maps=each(INDEX, "a list of different numbers of maps, such as range(3)", different=True),
    walks=COUNT,
    seed=SEED,
    workers=COUNT,
    destinations=COUNT,
    on_map=FUNCTION,
    on_walks=FUNCTION,
)
def compare(
    scenario: Scenario,
    planners: Factories,
    *,
    maps: Sequence[int],
    walks: int,
    seed: int = 0,
    workers: int = 1,
    destinations: int | None = None,
    on_map: Callable[[int, dict[str, Record]], None] = lambda _index, _records: None,
    on_walks: Callable[[int, str, int], None] = lambda _index, _planner, _walks: None,
) -> Comparison:
    """Walk the same maps through the same crowds with every planner.

    Maps are independent and share their compiled programs; results do not depend on the number of workers.

    Parameters
    ----------
    scenario
        The problem.
    planners
        Factories of planners by name, such as those of :func:`sidestep.choose_planners`.
    maps
        Numbers of the maps to walk.
    walks
        Number of walks on each map.
    seed
        Seed of maps and crowds.
    workers
        Number of threads; each walks one map at a time.
    destinations
        How many destinations walks go to, in turn and from anywhere (see
        :func:`sidestep.scenarios.episodes.destinations_of`). By default walks go from corner to corner on grids and
        from anywhere to anywhere in towns.
    on_map
        Called with a map's number and its walks by planner as each map is done, in the order of ``maps``.
    on_walks
        Called with a map's number, a planner and the number of walks that it has just done there: 0 as it is made,
        which may be a training. Workers call it in their own threads.

    Returns
    -------
    Comparison
        All walks.

    Raises
    ------
    PlannerError
        Anything that is not as above (the parameter is its field); a planner that skips a map and walks a later one.

    Examples
    --------
    >>> import sidestep
    >>> problem = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
    >>> chosen = sidestep.choose_planners(problem, ["random-progress"])
    >>> found = sidestep.compare(problem, chosen.factories, maps=[0, 1], walks=5)
    >>> rows = found.to_json()["planners"]
    >>> rows["clairvoyant"]["gap"], rows["random-progress"]["gap"] > 0
    (0.0, True)
    """
    one = partial(_walk_map, scenario, planners, walks, seed, destinations, on_walks)
    collected: dict[str, list[Record]] = {name: [] for name in planners}
    pool = ThreadPoolExecutor(workers)
    try:
        # The first map compiles everything; side by side, several maps would compile the same.
        walked_maps = chain([one(maps[0])], pool.map(one, maps[1:]))
        for done, (index, walked) in enumerate(zip(maps, walked_maps, strict=True)):
            for name, record in walked.items():
                if len(collected[name]) < done:
                    raise PlannerError(
                        f"planner {name!r} skipped a map before map {index}; it must then skip all later ones"
                    )
                collected[name].append(record)
            on_map(index, walked)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    records = {name: join_records(found, np.stack) for name, found in collected.items() if found}
    return Comparison(scenario, tuple(maps), walks, seed, records)


def _walk_map(
    scenario: Scenario,
    planners: Factories,
    walks: int,
    seed: int,
    destinations: int | None,
    on_walks: Callable[[int, str, int], None],
    index: int,
) -> dict[str, Record]:
    """Walk map number ``index`` with all planners."""
    scenario_map = draw_map(scenario, seed, index)
    episodes.check_paths(scenario_map)
    chosen: dict[str, Planner] = {}
    for name, factory in planners.items():
        on_walks(index, name, 0)
        if (planner := factory(scenario_map, index)) is None:
            continue
        if not isinstance(planner, Planner):
            raise PlannerError(f"what is called {name!r:.60} made {brief(planner)}, no planner", field="planners")
        chosen[name] = planner
    if not chosen:
        raise PlannerError(f"no planner walks map {index}", field="maps")
    level = max((planner.observes for planner in chosen.values()), key=LEVELS.index)
    expecting = [planner for planner in chosen.values() if planner.level not in _BELOW_MAP]
    # What is expected takes the longest to work out.
    samples = None if expecting else 0
    first = _first_slots(scenario, level, expecting) if expecting else None
    collected: dict[str, list[Record]] = {name: [] for name in chosen}
    parts = math.ceil(walks / most_at_once(scenario, scenario_map, destinations))
    size = math.ceil(walks / parts)  # all parts have one size, so that they share compiled programs
    for part in range(parts):
        nodes = nodes_of_part(scenario, scenario_map, size, destinations, part)
        make = partial(
            make_environment, scenario, scenario_map, "test", size, level=level, destinations=nodes, part=part
        )
        begun = nodes is None and first is not None
        if begun:  # all walks are of one hour
            (hour,) = scenario.place.departure_hours(1, part * size)
            params = make(pace=expected_pace(scenario, scenario_map, hour, first))
        else:
            params = make(samples=samples)
        todo = episodes.instances(scenario, scenario_map, params, size, first=part * size, destinations=nodes)
        key = purpose_key(scenario_map, "test")
        key = jax.random.fold_in(key, part) if part else key
        for name, planner in chosen.items():
            plan = _plan_within(planner, params, todo) if begun else planner.plan(params, todo)
            if plan is None:  # it gets further
                params, begun = make(), False
                plan = planner.plan(params, todo)
            collected[name].append(_walk(planner, params, plan, todo, key))
            on_walks(index, name, min(size, walks - part * size))
    return {name: join_records(found, lambda each: np.concatenate(each)[:walks]) for name, found in collected.items()}


def _first_slots(scenario: Scenario, level: Information, expecting: list[Planner]) -> int | None:
    """Slots that expected times are worked out for at first; None: for all of them from the beginning."""
    slots = math.ceil((scenario.departures[1] + FIRST_SECONDS) / scenario.slot_seconds)
    ahead = level in _BELOW_MAP and all(map(plans_ahead, expecting))
    few = ahead and not objective_of(scenario.objective).needs_density and 2 * slots <= scenario.slots
    return slots if few else None


def _plan_within(planner: Planner, params: EnvParams, todo: Instance) -> Plan | None:
    """A plan by those expected times that were worked out; None where they are too few."""
    return planner.plan_within(params, todo) if plans_ahead(planner) else planner.plan(params, todo)


def most_at_once(scenario: Scenario, scenario_map: ScenarioMap, destinations: int | None) -> int:
    """Most walks of a comparison that share an environment; more are walked in parts of one size.

    Parameters
    ----------
    scenario, scenario_map, destinations
        As for :func:`compare`.

    Returns
    -------
    int
        In towns fewer, where each walk has a destination of its own.
    """
    if scenario.place.anywhere and destinations is None:
        return min(TOWN_CHUNK, scenario_map.network.nodes - 1)
    return CHUNK


def nodes_of_part(
    scenario: Scenario, scenario_map: ScenarioMap, walks: int, destinations: int | None, part: int = 0
) -> Int[np.ndarray, "destination part"] | None:
    """Where the walks of one part of a comparison go.

    Parameters
    ----------
    scenario, scenario_map, destinations
        As for :func:`compare`.
    walks, part
        How many, and the number of the part.

    Returns
    -------
    Int[np.ndarray, "destination part"] | None
        None for walks from corner to corner.
    """
    if destinations is not None:
        return episodes.destinations_of(scenario_map, destinations)
    return episodes.random_destinations(scenario_map, walks, part) if scenario.place.anywhere else None


def _walk(planner: Planner, params: EnvParams, plan: Plan, todo: Instance, key: Key[Array, ""]) -> Record:
    walked = walk_plan(planner, params, plan, todo, key)
    return Record(
        planner.level,
        np.asarray(walked.seconds, np.float64) / 60,
        np.asarray(walked.arrived),
        np.asarray(walked.cost, np.float64) / 60,
        {name: np.asarray(total, np.float64) for name, total in walked.measures.items()},
    )
