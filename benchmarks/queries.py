"""Time what planners of walks ask in central Helsinki, after loading and compiling: the goals of docs/routes.md."""

from collections.abc import Callable
from statistics import median
from time import perf_counter, process_time

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
    print(f"| {name} | {best:,.0f} ms | {middle:,.0f} ms | {processor:,.0f} ms |", flush=True)


def main() -> None:
    router = sidestep.Router("helsinki")
    nodes = np.random.default_rng(1).integers(0, sidestep.load_helsinki().nodes, 200).tolist()
    print("| | best | median | processors, median |\n|---|--:|--:|--:|")
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
