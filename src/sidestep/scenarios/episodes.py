"""Which walks are walked: origins, destinations, departures and futures."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from sidestep.environment.instances import InstanceSampler
from sidestep.environment.types import EnvParams, Instance
from sidestep.scenarios.maps import ScenarioMap
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.stations import check_ways
from sidestep.walking.waits import GOLDEN


def standard_destinations(parts: tuple[int, ...], destinations: int) -> Int[np.ndarray, "goal part"]:
    """Where walks may go: on each part its upper right corner, then other nodes, all different, as many as asked.

    There is one node of each part to a goal, and no part's first node is among them. The other nodes depend on the
    size of the map alone, so that a model and those it is compared with mean the same ones.
    """
    first = np.cumsum((0, *parts[:-1]))
    if not 1 <= destinations <= min(parts) - 1:
        raise ScenarioError(f"there must be between 1 and {min(parts) - 1} destinations, not {destinations}")
    rng = np.random.default_rng(len(parts))
    others = [1 + rng.permutation(nodes - 2)[: destinations - 1] for nodes in parts]
    return np.stack([[nodes - 1, *rest] for nodes, rest in zip(parts, others, strict=True)], axis=1) + first


def destinations_of(scenario_map: ScenarioMap, destinations: int) -> Int[np.ndarray, "goal part"]:
    """Where walks on a map may go: those of :func:`destinations`, or some of its own destinations, where it has such.

    Raises
    ------
    ScenarioError
        More than there are.
    """
    if not scenario_map.destinations:
        spared = _only_origin(scenario_map)
        if not spared:
            return standard_destinations(scenario_map.parts, destinations)
        # Nobody walks to where all walks begin.
        every = standard_destinations(scenario_map.parts, scenario_map.network.nodes - 1)
        return _some(every[~np.isin(every[:, 0], spared)], destinations)
    return _some(
        np.random.default_rng(len(scenario_map.destinations)).permutation(scenario_map.destinations)[:, None],
        destinations,
    )


def _some(every: Int[np.ndarray, "any part"], destinations: int) -> Int[np.ndarray, "goal part"]:
    if not 1 <= destinations <= len(every):
        raise ScenarioError(f"there must be between 1 and {len(every)} destinations, not {destinations}")
    return every[:destinations]


def _only_origin(scenario_map: ScenarioMap) -> tuple[int, ...]:
    return scenario_map.origins if len(scenario_map.origins) == 1 else ()


def set_out(
    scenario: Scenario, scenario_map: ScenarioMap, destinations: Int[np.ndarray, "goal part"], first: int = 0
) -> ScenarioMap:
    """The place at the hours of the week at which people set out for each goal, where the scenario has such hours.

    Raises
    ------
    ScenarioError
        A venue where somebody may come to a crossing from which there is no way on.
    """
    if not scenario.place.anywhere:
        return scenario_map
    check_ways(scenario_map.network, scenario_map.origins, scenario_map.destinations)
    return scenario_map.at_departure_hours(scenario.place.departure_hours(len(destinations), first))


def anywhere_to_anywhere(scenario_map: ScenarioMap, walks: int, part: int) -> Int[np.ndarray, "goal 1"]:
    """As many destinations as walks, all different, drawn anew for each part of a comparison.

    Where the map has destinations of its own they are among these, and there may be fewer: walks go to each in turn.
    """
    nodes = scenario_map.network.nodes
    if walks > nodes - 1:
        raise ScenarioError(f"there cannot be {walks} different destinations among {nodes} nodes")
    rng = np.random.default_rng([*np.asarray(jax.random.key_data(scenario_map.key)).tolist(), part])
    among = rng.permutation(scenario_map.destinations or nodes)
    return among[~np.isin(among, _only_origin(scenario_map))][:walks, None]


def _origins(scenario_map: ScenarioMap, destinations: Int[np.ndarray, "goal 1"]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes that a map's walks to each goal begin at, as rows of one length, and how many of a row are different."""
    rows = [[node for node in scenario_map.origins if node != goal] for goal in destinations[:, 0].tolist()]
    count = np.array([len(row) for row in rows])
    return np.stack([np.resize(row, max(len(scenario_map.origins), 1)) for row in rows]), count


def sampler(
    scenario: Scenario,
    scenario_map: ScenarioMap,
    params: EnvParams,
    futures: int,
    *,
    destinations: Int[np.ndarray, "goal part"] | None = None,
    anywhere: bool = False,
) -> InstanceSampler:
    """The scenario's walks, or walks from anywhere, to ``destinations``, through the first ``futures`` futures.

    Where the map has origins of its own, all walks begin there.
    """
    destinations = destinations_of(scenario_map, 1) if destinations is None else destinations
    _check_futures(params, len(destinations))
    part = np.repeat(np.arange(len(scenario_map.parts)), scenario_map.parts)
    first = np.cumsum((0, *scenario_map.parts[:-1]))
    # Both have as many candidates, so that training from either is the same compiled program.
    elsewhere = np.stack([np.setdiff1d(np.arange(len(part)), of_goal) for of_goal in destinations])
    begins = elsewhere if anywhere or scenario_map.destinations else first[part[elsewhere]]
    if scenario_map.origins:
        begins = elsewhere = _origins(scenario_map, destinations)[0]
    return InstanceSampler(
        origins=jnp.asarray(begins, jnp.int32),
        destinations=jnp.asarray(destinations[np.arange(len(destinations))[:, None], part[elsewhere]], jnp.int32),
        departures=jnp.asarray(np.asarray(scenario.departures), jnp.float32),
        futures=jnp.asarray(min(futures, params.futures.count), jnp.int32),
    )


def instances(
    scenario: Scenario,
    scenario_map: ScenarioMap,
    params: EnvParams,
    walks: int,
    first: int = 0,
    *,
    destinations: Int[np.ndarray, "goal part"] | None = None,
) -> Instance:
    """Walks number ``first`` and on of the scenario, corner to corner, each through a future of its own.

    With ``destinations``, walks from anywhere, or from the map's own origins, to each of these in turn; a map with
    origins or destinations of its own has no other walks. Departures are spread evenly by the golden ratio, and walks
    take the parts of the map in turn.
    """
    if destinations is None and (scenario_map.origins or scenario_map.destinations):
        destinations = destinations_of(scenario_map, 1)
    number = first + np.arange(walks)
    begins = np.cumsum((0, *scenario_map.parts))
    on = number % len(scenario_map.parts)
    origin, destination = begins[:-1][on], begins[1:][on] - 1
    future = number % params.futures.count
    if destinations is not None:
        _check_futures(params, len(destinations))
        destination = destinations[future % len(destinations), on]
        # Uniform over the part's other nodes.
        others = np.asarray(scenario_map.parts)[on] - 1
        uniform = jax.random.uniform(jax.random.fold_in(scenario_map.key, _ORIGINS + first), (walks,))
        if scenario_map.origins:
            rows, count = (
                jnp.asarray(each[future % len(destinations)]) for each in _origins(scenario_map, destinations)
            )
            chosen = jnp.minimum((uniform * count).astype(jnp.int32), count - 1)
            return _walks(scenario, number, rows[jnp.arange(walks), chosen], destination, future)
        step = 1 + jnp.minimum((uniform * others).astype(jnp.int32), others - 1)
        origin = begins[on] + (destination - begins[on] + step) % (others + 1)
    return _walks(scenario, number, origin, destination, future)


def _walks(
    scenario: Scenario,
    number: Int[np.ndarray, " walk"],
    origin: Int[Array | np.ndarray, " walk"],
    destination: Int[np.ndarray, " walk"],
    future: Int[np.ndarray, " walk"],
) -> Instance:
    earliest, latest = scenario.departures
    return Instance(
        origin=jnp.asarray(origin, jnp.int32),
        destination=jnp.asarray(destination, jnp.int32),
        departure=jnp.asarray(earliest + (latest - earliest) * (number * GOLDEN % 1), jnp.float32),
        future=jnp.asarray(future, jnp.int32),
    )


def _check_futures(params: EnvParams, destinations: int) -> None:
    """Each crowd is for one goal."""
    if params.futures.count < destinations:
        raise ScenarioError(f"{destinations} destinations need as many futures, but there are {params.futures.count}")


_ORIGINS = 1_000  # beyond the numbers of purposes
