"""Time what planners of walks ask in central Helsinki, after loading and compiling; goals: benchmarks/README.md."""

from collections.abc import Callable
from statistics import median
from time import perf_counter, process_time

import jax
import numpy as np

import sidestep

ORIGIN, DESTINATION, NOON = (60.1719, 24.9414), (60.1640, 24.9480), "Sat 17:30"


def time(name: str, ask: Callable[[int], object], turns: int) -> None:
    ask(0)
    ask(1)
    seconds, worked = [], []
    for turn in range(turns):
        began, used = perf_counter(), process_time()
        ask(turn)
        seconds.append(perf_counter() - began)
        worked.append(process_time() - used)
    best, middle, processor = (1e3 * each for each in (min(seconds), median(seconds), median(worked)))
    print(f"| {name} | {best:,.3g} ms | {middle:,.3g} ms | {processor:,.3g} ms |", flush=True)


def alone() -> Callable[[int], object]:
    """Ask for one route of `expected` and its walk through one future, without baselines and directions."""
    problem = sidestep.scenario("helsinki")
    scenario_map, planner = sidestep.draw_map(problem, seed=0), sidestep.find_planner("expected")
    params = sidestep.make_environment(problem, scenario_map, "test", futures=1)
    todo = sidestep.instances(problem, scenario_map, params, walks=100)
    walks = [jax.tree.map(lambda leaf, at=at: leaf[at : at + 1], todo) for at in range(100)]
    key, nodes = jax.random.key(0), scenario_map.network.nodes
    return lambda turn: sidestep.routes(planner, params, walks[turn], key, nodes)


def main() -> None:
    router = sidestep.Router("helsinki")
    nodes = np.random.default_rng(1).integers(0, sidestep.load_helsinki().nodes, 200).tolist()
    print("| | best | median | processors, median |\n|---|--:|--:|--:|")
    time("route of `expected` alone", alone(), 100)
    time("isochrone", lambda turn: router.isochrone(nodes[turn], depart=NOON), 40)
    time("isochrone, 200 futures", lambda turn: router.isochrone(nodes[turn], depart=NOON, futures=200), 20)
    time("matrix, 100 × 100", lambda _: router.matrix(nodes[:100], nodes[100:], depart=NOON), 5)
    time("matrix, 10 × 10, 200 futures", lambda _: router.matrix(nodes[:10], nodes[10:20], depart=NOON, futures=200), 5)
    time("crowds", lambda _: router.crowds(at=NOON), 10)
    time("route with baselines", lambda _: router.plan(ORIGIN, DESTINATION, depart=NOON), 5)
    time("route with three alternatives", lambda _: router.plan(ORIGIN, DESTINATION, depart=NOON, alternatives=3), 5)
    time("route to arrive by", lambda _: router.plan(ORIGIN, DESTINATION, arrive_by="Sat 18:00"), 3)
    time("when, 25 departures", lambda _: router.when(ORIGIN, DESTINATION, depart=NOON), 3)


if __name__ == "__main__":
    main()
