"""Walk the same maps, crowds and departures with every planner."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import TypedDict

import jax
import numpy as np
from jaxtyping import Float

from sidestep.environment.observation import at_level
from sidestep.environment.types import LEVELS, EnvParams, Instance
from sidestep.evaluation.metrics import Record, Row, Totals, joined, summarise, totals_of
from sidestep.evaluation.timing import decision_seconds
from sidestep.planners.base import Planner, walk_plan
from sidestep.planners.registry import BASELINE, PlannerError, PlannerFactory
from sidestep.scenarios import episodes
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map, purpose_key
from sidestep.scenarios.model import Scenario

CHUNK = 200  # walks whose futures are held in memory at a time
TOWN_CHUNK = 50  # the same where each has a destination of its own


@dataclass(frozen=True)
class Walked:
    """One planner on one map."""

    planner: Planner
    minutes: Float[np.ndarray, " walk"]
    arrived: np.ndarray
    decision_us: float
    totals: Totals | None = None


class Results(TypedDict):
    """A comparison in ``results.json``."""

    scenario: str
    summary: str  # of the scenario: where its crowds come from
    flows: str  # what moves the crowds: forecast, arima, rush, sensors or table
    maps: int
    walks: int
    seed: int
    objective: dict[str, float | None] | None  # weights of what walkers keep low; None: time
    baseline: str  # whom `difference_minutes` is taken to
    by_minutes: float | None
    planners: dict[str, Row]


@dataclass(frozen=True)
class Comparison:
    """What :func:`compare` found."""

    scenario: Scenario
    maps: int
    walks: int
    seed: int
    records: dict[str, Record]

    def as_json(self, by: float | None = None, baseline: str = BASELINE) -> Results:
        """The shape of ``compare --json`` and ``results.json``.

        ``by`` are minutes to arrive within, ``baseline`` is the planner that the others' minutes are set against.
        """
        if baseline not in self.records or self.records[baseline].maps < self.maps:
            raise PlannerError(f"nothing can be set against {baseline!r}: it has not walked all maps")
        return {
            "scenario": self.scenario.name,
            "summary": self.scenario.summary,
            "flows": self.scenario.crowd_model,
            "maps": self.maps,
            "walks": self.walks,
            "seed": self.seed,
            "objective": self.scenario.objective.to_json(),
            "baseline": baseline,
            "by_minutes": by,
            "planners": summarise(self.records, self.seed, by, baseline),
        }


def compare(
    scenario: Scenario,
    planners: Mapping[str, PlannerFactory],
    *,
    maps: Sequence[int],
    walks: int,
    seed: int = 0,
    workers: int = 1,
    destinations: int | None = None,
    on_map: Callable[[int, dict[str, Walked]], None] = lambda _index, _walked: None,
) -> Comparison:
    """Compare planners on the maps of these numbers, with ``walks`` walks on each.

    Walks go from corner to corner, or from anywhere to so many ``destinations`` in turn (those of
    :func:`sidestep.scenarios.episodes.destinations_of`). Maps are independent and run on ``workers`` threads, which
    share one compiled program. Results do not depend on their number. ``on_map`` is called as each map is done.
    """
    if not maps or walks < 1 or workers < 1:
        raise PlannerError(f"nothing to compare: {len(maps)} maps, {walks} walks, {workers} workers")
    one = partial(walk_map, scenario, planners, walks, seed, destinations)
    collected: dict[str, list[Walked]] = {name: [] for name in planners}
    # The first map compiles everything; the others then do not compile it a second time beside it.
    pool = ThreadPoolExecutor(workers)
    try:
        for done, (index, walked) in enumerate(zip(maps, _first_then_rest(pool, one, maps), strict=True)):
            for name, result in walked.items():
                if len(collected[name]) < done:
                    raise PlannerError(
                        f"planner {name!r} skipped a map before map {index}; it must then skip all later ones"
                    )
                collected[name].append(result)
            on_map(index, walked)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    records = {
        name: Record(
            level=found[0].planner.level,
            minutes=np.stack([walked.minutes for walked in found]),
            arrived=np.stack([walked.arrived for walked in found]),
            decision_us=float(np.median([walked.decision_us for walked in found])),
            totals=joined([walked.totals for walked in found if walked.totals is not None], np.stack),
        )
        for name, found in collected.items()
        if found
    }
    return Comparison(scenario, len(maps), walks, seed, records)


def _first_then_rest(
    pool: ThreadPoolExecutor, one: Callable[[int], dict[str, Walked]], maps: Sequence[int]
) -> Iterable[dict[str, Walked]]:
    yield one(maps[0])
    yield from pool.map(one, maps[1:])


def walk_map(
    scenario: Scenario,
    planners: Mapping[str, PlannerFactory],
    walks: int,
    seed: int,
    destinations: int | None,
    index: int,
) -> dict[str, Walked]:
    """All planners on map number ``index``."""
    scenario_map = draw_map(scenario, seed, index)
    episodes.check_paths(scenario_map)
    chosen = {
        name: planner for name, factory in planners.items() if (planner := factory(scenario_map, index)) is not None
    }
    level = max((planner.observes for planner in chosen.values()), key=LEVELS.index)
    collected: dict[str, list[Walked]] = {name: [] for name in chosen}
    pairs = scenario.place.anywhere and destinations is None
    parts = math.ceil(walks / (min(TOWN_CHUNK, scenario_map.network.nodes - 1) if pairs else CHUNK))
    size = math.ceil(walks / parts)  # all parts have one size, so that they share compiled programs
    for part in range(parts):
        nodes = None if destinations is None else episodes.destinations_of(scenario_map, destinations)
        if pairs:
            nodes = episodes.random_destinations(scenario_map, size, part)
        params = make_environment(scenario, scenario_map, "test", size, level=level, destinations=nodes, part=part)
        todo = instances(scenario, scenario_map, params, size, first=part * size, destinations=nodes)
        key = purpose_key(scenario_map, "test")
        for name, planner in chosen.items():
            collected[name].append(_walked(planner, params, todo, jax.random.fold_in(key, part) if part else key))
    return {
        name: Walked(
            planner,
            np.concatenate([part.minutes for part in collected[name]])[:walks],
            np.concatenate([part.arrived for part in collected[name]])[:walks],
            float(np.median([part.decision_us for part in collected[name]])),
            joined(
                [part.totals for part in collected[name] if part.totals is not None],
                lambda arrays: np.concatenate(arrays)[:walks],
            ),
        )
        for name, planner in chosen.items()
    }


def _walked(planner: Planner, params: EnvParams, todo: Instance, key: jax.Array) -> Walked:
    planner.plan(params, todo)  # compiles, so that planning itself is timed
    began = perf_counter()
    plan = planner.plan(params, todo)
    jax.tree.map(np.asarray, plan.own)  # waits until it is there
    planning = perf_counter() - began
    walked = walk_plan(planner, params, plan, todo, key)
    decisions = max(int(np.sum(walked.steps)), 1)
    each = decision_seconds(planner, at_level(params, planner.observes), plan, todo, key)
    return Walked(
        planner,
        np.asarray(walked.seconds, np.float64) / 60,
        np.asarray(walked.arrived),
        1e6 * (planning / decisions + each),
        totals_of(walked),
    )
