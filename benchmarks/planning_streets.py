"""The streets and crowds on which planning.py compares routers, and lines mapped onto them."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import jax
import numpy as np
import shapely
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

import sidestep
from sidestep.environment.crossing import as_expected, crossings
from sidestep.environment.types import EnvParams, Instance
from sidestep.network.graph import ABSENT
from sidestep.planners.base import walk_plan
from sidestep.routing.alternatives import KeptPath
from sidestep.scenarios.expectation import expected_pace

HOUR_OF_WEEK, DEPARTURE = 5 * 24 + 17.5, "2025-05-24T17:30"
APART, NEAR, FAR = 10.0, 25.0, 100.0  # m: points along streets; what is on a line, and what is as far as anything
Segments = list[int]
"""One after the other."""


class Place:
    """Central Helsinki at the departure, with simulated futures.

    Parameters
    ----------
    futures, pairs, seed
        How many to walk, between how many pairs of crossings, and the seed of these.
    """

    def __init__(self, futures: int, pairs: int, seed: int) -> None:
        self.problem = sidestep.scenario("helsinki").changed(departures=(0.0, 0.0))
        self.map, self.town = sidestep.draw_map(self.problem, seed=0), sidestep.load_helsinki()
        self.network, self.key, self.futures = self.map.network, jax.random.key(0), futures
        self.pace = expected_pace(self.problem, self.map, HOUR_OF_WEEK)
        self.params = self.environment(0)
        self.alone = as_expected(self.params)
        first = np.int32(0)
        crossed = crossings(self.alone, self.alone.expected.of(first), self.alone.wait_in(first))
        self.metres, self.seconds = (np.asarray(each, float) for each in (self.network.length, crossed.seconds[0]))
        self.tail, self.head = np.asarray(self.network.tail), np.asarray(self.network.head)
        # Of streets for some only, it depends on where a walk ends whether it may take them: nobody takes them here.
        restricted = self.network.owners() != ABSENT
        self.walked = np.flatnonzero(~restricted)
        graph = self.graph(self.metres)
        start = int(self.tail[self.walked[0]])
        both = (np.isfinite(dijkstra(each, indices=start)) for each in (graph, graph.T))
        nodes = np.flatnonzero(next(both) & next(both))
        rng = np.random.default_rng(seed)
        self.pairs = np.array([rng.choice(nodes, 2, replace=False) for _ in range(pairs)])

    def environment(self, destination: int, level: Any = "position", futures: int | None = None) -> EnvParams:
        """The walks to a crossing, for walkers of a level; by default through all futures."""
        asked: dict[str, Any] = {"level": level, "hours": [HOUR_OF_WEEK], "pace": self.pace}
        ends = np.array([[destination]])
        number = futures or self.futures
        return sidestep.make_environment(self.problem, self.map, "test", number, destinations=ends, **asked)

    def best(self, weight: Float[np.ndarray, " segment"]) -> Int[np.ndarray, " segment"]:
        """Of the segments that all walks may take, the best of parallel ones."""
        order = self.walked[np.lexsort((weight[self.walked], self.head[self.walked], self.tail[self.walked]))]
        ends = np.stack([self.tail[order], self.head[order]])
        return order[np.append(True, (ends[:, 1:] != ends[:, :-1]).any(axis=0))]

    def graph(self, weight: Float[np.ndarray, " segment"]) -> csr_array:
        """The streets with a weight of each segment."""
        chosen = self.best(weight)
        ends = (self.tail[chosen], self.head[chosen])
        return csr_array((weight[chosen], ends), shape=(self.network.nodes,) * 2)

    def edges(self, weight: Float[np.ndarray, " segment"]) -> list[tuple[int, int, float]]:
        """The same as tuples."""
        chosen = self.best(weight)
        return list(zip(self.tail[chosen].tolist(), self.head[chosen].tolist(), weight[chosen].tolist(), strict=True))

    def segments(self, weight: Float[np.ndarray, " segment"]) -> Callable[[list[int]], Segments]:
        """Turns the nodes of a path into segments."""
        known = {(int(self.tail[each]), int(self.head[each])): int(each) for each in self.best(weight)}
        return lambda nodes: [known[ends] for ends in pairwise(nodes)]

    def instance(self, origin: int, destination: int, futures: int = 1) -> Instance:
        """The same walk in the first futures."""
        ends = (np.full(futures, node, np.int32) for node in (origin, destination))
        return Instance(*jax.device_put((*ends, np.zeros(futures, np.float32), np.arange(futures, dtype=np.int32))))

    def walk(self, path: Segments, origin: int, destination: int) -> Float[np.ndarray, " future"]:
        """Minutes of the walks along a path; the horizon for those that do not arrive."""
        exits, taken = np.zeros((self.network.nodes, self.network.exits), bool), np.array(path)
        exits[self.tail[taken]] = np.asarray(self.network.exit_segment)[self.tail[taken]] == taken[:, None]
        kept, todo = KeptPath(exits), self.instance(origin, destination, self.futures)
        plan = kept.plan(self.params, self.instance(origin, destination))
        walked = walk_plan(kept, self.params, plan, todo, self.key)
        arrived = np.asarray(walked.arrived)
        if not arrived.any():
            raise RuntimeError(f"the route from crossing {origin} to {destination} never arrives")
        return np.where(arrived, np.asarray(walked.seconds, float), self.problem.horizon) / 60


def path_to(graph: csr_array, origin: int, destination: int) -> list[int]:
    """The nodes of the best path, by SciPy."""
    _, before = dijkstra(graph, indices=origin, return_predecessors=True)
    nodes = [destination]
    while nodes[-1] != origin:
        nodes.append(int(before[nodes[-1]]))
    return nodes[::-1]


class Matcher:
    """Maps lines onto streets: the walk that keeps nearest to a line."""

    def __init__(self, place: Place) -> None:
        town, self.place = place.town, place
        lines = [shapely.LineString(town.project(town.course(street))) for street in range(town.streets)]
        points = [
            shapely.line_interpolate_point(line, np.arange(APART / 2, max(line.length, APART), APART)) for line in lines
        ]
        self.points, self.of = np.concatenate(points), np.repeat(np.arange(town.streets), list(map(len, points)))
        self.street, _ = town.street_of_segment()
        self.shares: list[float] = []
        """Of the metres of each walk, how many lie on its line."""

    def __call__(self, line: Float[np.ndarray, "point 2"], origin: int, destination: int) -> Segments:
        """The segments nearest to a line of longitudes and latitudes."""
        if len(line) < 2:
            raise RuntimeError(f"there is no route from crossing {origin} to {destination}")
        on_line = shapely.LineString(self.place.town.project(line))
        away = np.minimum(shapely.distance(self.points, on_line), FAR)
        off = (np.bincount(self.of, away) / np.bincount(self.of))[self.street]
        weight = self.place.metres * (0.02 + off / APART)
        path = self.place.segments(weight)(path_to(self.place.graph(weight), origin, destination))
        metres = self.place.metres[path]
        self.shares.append(float(metres[off[path] < NEAR].sum() / metres.sum()))
        return path
