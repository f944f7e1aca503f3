"""The routers that planning.py compares."""

import platform
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from planning_streets import DEPARTURE, Matcher, Place, Segments, path_to
from routers import Osrm, Valhalla

import sidestep
from sidestep.environment.crossing import as_expected
from sidestep.environment.types import Instance
from sidestep.planners.base import Planner, walk_plan

FIRST = "Sidestep: `expected`"


@dataclass
class Router:
    """Something that plans routes."""

    name: str
    plan: Callable[[int, int], Any]
    """A route from one crossing to another: what is timed."""
    path: Callable[[Any, int, int], Segments] | None = None
    """The segments of what it answered; None where another row has them, or it decides on the way."""
    minutes: Callable[[int, int], Float[np.ndarray, " future"]] | None = None
    """The walks of who decides on the way."""
    batch: int = 1
    """Routes at a time."""
    matcher: Matcher | None = None


def own(place: Place, model: Path | None, absent: dict[str, str]) -> list[Router]:
    """Sidestep's planners, and all that ``Router.plan`` says of a route."""
    nodes = place.network.nodes

    def alone(planner: Planner, *pair: int) -> Segments:
        (route,) = sidestep.routes(planner, place.alone, place.instance(*pair), place.key, nodes)
        return list(route.segments)

    def together(*_: int) -> object:
        (origin, destination), none = place.pairs.T.astype(np.int32), np.zeros(len(place.pairs), np.int32)
        todo = Instance(*jax.device_put((origin, destination, none.astype(np.float32), none)))
        walked = walk_plan(expected, place.alone, expected.plan(place.alone, todo), todo, place.key, nodes)
        return jax.block_until_ready(walked)

    def answered(futures: int, *pair: int) -> object:
        return router.plan(*pair, depart=DEPARTURE, futures=futures)

    router, expected = sidestep.Router("helsinki"), sidestep.find_planner("expected")
    found = [
        Router(f"Sidestep: `{name}`", partial(alone, sidestep.find_planner(name)), lambda path, *_: path)
        for name in ("expected", "shortest-path")
    ]
    found += [
        Router("Sidestep: `expected`, all pairs at once", together, batch=len(place.pairs)),
        Router("Sidestep: `Router.plan`, one future, with two baselines", partial(answered, 1)),
        Router("Sidestep: `Router.plan`, 200 futures, with two baselines", partial(answered, 200)),
    ]
    if model is None:
        absent["Sidestep: `darp`"] = "no model was given"
        return found
    darp = sidestep.trained_darp(sidestep.load_model(model))

    def decided(*pair: int) -> object:
        params, todo = as_expected(place.environment(pair[1], darp.observes, 1)), place.instance(*pair)
        return jax.block_until_ready(walk_plan(darp, params, darp.plan(params, todo), todo, place.key, nodes))

    def through(*pair: int) -> Float[np.ndarray, " future"]:
        params, todo = place.environment(pair[1], darp.observes), place.instance(*pair, place.futures)
        return np.asarray(walk_plan(darp, params, darp.plan(params, todo), todo, place.key).seconds, float) / 60

    return [*found, Router(f"Sidestep: `darp` of level {darp.level}", decided, minutes=through)]


def graphs(place: Place, absent: dict[str, str]) -> list[Router]:
    """Libraries of graphs on Sidestep's streets."""
    found = []
    for said, weight in (("metres", place.metres), ("seconds", place.seconds)):
        edges, matrix, segments = place.edges(weight), place.graph(weight), place.segments(weight)

        def named(nodes: Any, *_: int, segments: Callable[[list[int]], Segments] = segments) -> Segments:
            return segments(list(nodes))

        found.append(Router(f"SciPy, by {said}", partial(path_to, matrix), named))
        try:
            import networkx as nx
        except ImportError as error:
            absent["networkx"] = str(error)
        else:
            graph = nx.DiGraph()
            graph.add_weighted_edges_from(edges)
            found.append(Router(f"networkx, by {said}", partial(nx.dijkstra_path, graph), named))
        try:
            import rustworkx as rx
        except ImportError as error:
            absent["rustworkx"] = str(error)
        else:
            directed = rx.PyDiGraph()
            directed.add_nodes_from(range(place.network.nodes))
            directed.add_edges_from(edges)
            search = partial(_by_rustworkx, rx.dijkstra_shortest_paths, directed)
            found.append(Router(f"rustworkx, by {said}", search, named))
    return found


def _by_rustworkx(search: Callable[..., Any], graph: object, origin: int, destination: int) -> Any:
    return search(graph, origin, destination, weight_fn=float)[destination]


def on_extract(place: Place, extract: Path, folder: Path, absent: dict[str, str]) -> list[Router]:
    """OSRM and Valhalla, which read the extract themselves."""
    found = []
    engines: dict[str, Callable[[Path, Path], Osrm | Valhalla]] = {
        "OSRM, foot": Osrm,
        "OSRM, foot, across squares": partial(Osrm, areas=True),
        "Valhalla, pedestrian": Valhalla,
    }
    for name, make in engines.items():
        try:
            engine = make(extract, folder)
        except ImportError as error:
            absent[name] = f"{error}; Python {platform.python_version()}"
            continue

        def line(*pair: int, engine: Osrm | Valhalla = engine) -> Float[np.ndarray, "point 2"]:
            return engine.line(*place.town.place[list(pair)])

        matcher = Matcher(place)
        found.append(Router(name, line, matcher, matcher=matcher))
    return found
