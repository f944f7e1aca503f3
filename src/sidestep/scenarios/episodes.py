"""Which walks are walked: origins, destinations, departures and futures."""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sidestep.arguments import COUNT, Rule, checked, instance, whole
from sidestep.environment.types import EnvParams, Instance
from sidestep.scenarios.maps import A_MAP, ScenarioMap
from sidestep.scenarios.model import A_SCENARIO, Scenario
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.stations import check_ways
from sidestep.walking.waits import GOLDEN

DRAWS = 4
"""Uniform numbers that one instance takes."""
_ORIGINS = 1_000  # beyond the numbers of purposes


MOST_NUMBERED = 2**31 - 1
"""The largest number of a walk, and of a part of a comparison."""


def _nodes(value: Any) -> Int[np.ndarray, "destination part"]:
    nodes = np.asarray(value)
    if nodes.dtype.kind not in "iu" or nodes.ndim != len(("destination", "part")) or not nodes.size:
        raise ValueError
    return nodes


NODES = Rule("must be whole numbers of nodes, a row for each destination, such as [[8], [5]]", _nodes)
"""What public functions take as destinations."""


class InstanceSampler(eqx.Module):
    """Independent uniform draws of a destination, and then of an origin, a departure and a future for it."""

    origins: Int[Array, "destination origin"]
    """Nodes where walks to each destination begin."""
    destinations: Int[Array, "destination origin"]
    """Nodes where a walk to this destination from each origin ends; parts of a map have their own."""
    departures: Float[Array, "2"]
    """Earliest and latest clock, in s."""
    futures: Int[Array, "destination future"]
    """Numbers of the futures for each destination, then others."""
    counts: Int[Array, " destination"]
    """How many futures there are for each destination."""

    def sample(self, uniform: Float[Array, "4"]) -> Instance:
        """Turn uniform numbers in [0, 1) into an instance.

        Numbers, not a key, because drawing them for a whole chunk of training at once is many times cheaper.

        Returns
        -------
        Instance
            One walk.
        """
        destinations, origins = self.origins.shape
        destination = _pick(destinations, uniform[1])
        origin = _pick(origins, uniform[0])
        earliest, latest = self.departures
        return Instance(
            origin=self.origins[destination, origin],
            destination=self.destinations[destination, origin],
            departure=earliest + (latest - earliest) * uniform[2],
            future=self.futures[destination, _pick(self.counts[destination], uniform[3])],
        )


def _pick(count: Int[Array | np.ndarray, "*n"] | int, uniform: Float[Array, "*n"]) -> Int[Array, "*n"]:
    """A number below a count."""
    return jnp.minimum((uniform * count).astype(jnp.int32), count - 1)


def standard_destinations(parts: tuple[int, ...]) -> Int[np.ndarray, "destination part"]:
    """Where walks on grids go: to the upper right corner of each part, then to other nodes, all different.

    No part's first node is among them. The other nodes depend on the size of the map alone, so that a model and those
    it is compared with mean the same ones.

    Parameters
    ----------
    parts
        Nodes of each part of the map.

    Returns
    -------
    destinations
        A node of each part for each destination, as many as there are.
    """
    first = np.cumsum((0, *parts[:-1]))
    rng = np.random.default_rng(len(parts))
    others = [1 + rng.permutation(nodes - 2)[: min(parts) - 2] for nodes in parts]
    return np.stack([[nodes - 1, *rest] for nodes, rest in zip(parts, others, strict=True)], axis=1) + first


def destinations_of(scenario_map: ScenarioMap, destinations: int) -> Int[np.ndarray, "destination part"]:
    """Where walks on a map go: to some of its own destinations, or else to the standard ones.

    Parameters
    ----------
    scenario_map
        The map.
    destinations
        How many.

    Returns
    -------
    destinations
        A node of each part of the map for each destination.

    Raises
    ------
    ScenarioError
        More than there are, or none.
    """
    every, own = standard_destinations(scenario_map.parts), scenario_map.destinations
    if own:
        every = np.random.default_rng(len(own)).permutation(own)[:, None]
    every = every[~np.isin(every[:, 0], _only_origin(scenario_map))]  # nobody walks to where all walks begin
    if not 1 <= destinations <= len(every):
        raise ScenarioError(
            f"there must be between 1 and {len(every)} destinations, not {destinations}", field="destinations"
        )
    return every[:destinations]


def _only_origin(scenario_map: ScenarioMap) -> tuple[int, ...]:
    return scenario_map.origins if len(scenario_map.origins) == 1 else ()


def random_destinations(scenario_map: ScenarioMap, walks: int, part: int) -> Int[np.ndarray, "destination 1"]:
    """As many destinations as walks, all different, drawn anew for each part of a comparison.

    Where the map has destinations of its own they are among these, and there may be fewer: walks go to each in turn.

    Returns
    -------
    Int[np.ndarray, "destination 1"]
        A node for each of them.

    Raises
    ------
    ScenarioError
        More walks than nodes to go to.
    """
    nodes = scenario_map.network.nodes
    if walks > nodes - 1:
        raise ScenarioError(f"there cannot be {walks} different destinations among {nodes} nodes", field="walks")
    rng = np.random.default_rng([*np.asarray(jax.random.key_data(scenario_map.key)).tolist(), part])
    among = rng.permutation(scenario_map.destinations or nodes)
    return among[~np.isin(among, _only_origin(scenario_map))][:walks, None]


def check_paths(scenario_map: ScenarioMap) -> None:
    """Refuse a town where a walker may come to a node from which no path leads on; grids have none.

    Raises
    ------
    ScenarioError
        Such a node.
    """
    if not scenario_map.connected:
        check_ways(scenario_map.network, scenario_map.origins, scenario_map.destinations)


def _own_origins(
    scenario_map: ScenarioMap, destinations: Int[np.ndarray, "destination 1"]
) -> tuple[Int[np.ndarray, "destination origin"], Int[np.ndarray, " destination"]]:
    """A map's own origins of walks to each destination, as rows of one length, and how many of a row are different."""
    origins = np.array(scenario_map.origins, np.int32)
    rows = [origins[origins != end] for end in destinations[:, 0]]
    count = np.array([len(row) for row in rows])
    return np.stack([np.resize(row, max(len(scenario_map.origins), 1)) for row in rows]), count


def sampler(
    scenario: Scenario,
    scenario_map: ScenarioMap,
    params: EnvParams,
    futures: int,
    *,
    destinations: Int[np.ndarray, "destination part"] | None = None,
    anywhere: bool = False,
) -> InstanceSampler:
    """Random walks of a scenario. Where the map has origins of its own, all walks begin there.

    Parameters
    ----------
    scenario, scenario_map, params
        The problem, its map, and the environment that was made for these destinations.
    futures
        How many of the environment's futures are walked through, the first ones.
    destinations
        A node of each part of the map for each destination; by default the scenario's own.
    anywhere
        Whether walks begin anywhere, not where the scenario's do.

    Returns
    -------
    InstanceSampler
        It draws walks to all destinations alike.

    Raises
    ------
    ScenarioError
        Fewer futures than destinations.
    """
    destinations = destinations_of(scenario_map, 1) if destinations is None else destinations
    _check_futures(min(futures, params.futures.count), len(destinations))
    numbers, counts = _futures_for_each(params.futures.destination, futures, len(destinations))
    part = np.repeat(np.arange(len(scenario_map.parts)), scenario_map.parts)
    first = np.cumsum((0, *scenario_map.parts[:-1]))
    # Both have as many candidates, so that training from either is the same compiled program.
    elsewhere = np.stack([np.setdiff1d(np.arange(len(part)), nodes) for nodes in destinations])
    begins = elsewhere if anywhere or scenario_map.destinations else first[part[elsewhere]]
    if scenario_map.origins:
        begins = elsewhere = _own_origins(scenario_map, destinations)[0]
    return InstanceSampler(
        origins=jnp.asarray(begins, jnp.int32),
        destinations=jnp.asarray(np.take_along_axis(destinations, part[elsewhere], axis=1), jnp.int32),
        departures=jnp.asarray(np.asarray(scenario.departures), jnp.float32),
        futures=numbers,
        counts=counts,
    )


@partial(jax.jit, static_argnums=(1, 2))
def _futures_for_each(
    destination: Int[Array, " future"], futures: int, destinations: int
) -> tuple[Int[Array, "destination first"], Int[Array, " destination"]]:
    """Numbers of the first futures, those for each destination first in its row, and how many these are."""
    for_each = destination[:futures] == jnp.arange(destinations)[:, None]
    return jnp.argsort(~for_each, axis=1, stable=True).astype(jnp.int32), for_each.sum(axis=1).astype(jnp.int32)


def check_nodes(scenario_map: ScenarioMap, nodes: Int[np.ndarray, "destination part"]) -> None:
    """Refuse destinations that are no nodes of a map, or not one in each of its parts.

    Raises
    ------
    ScenarioError
        With the field ``destinations``.
    """
    last, parts = scenario_map.network.nodes - 1, len(scenario_map.parts)
    if nodes.shape[1] != parts:
        said = f"destinations must have a node for each part of the map, {parts}"
        raise ScenarioError(f"{said}, not {nodes.shape[1]}", field="destinations")
    if nodes.min() < 0 or nodes.max() > last:
        wrong = nodes.min() if nodes.min() < 0 else nodes.max()
        raise ScenarioError(f"destinations must be nodes, 0 to {last}, not {wrong}", field="destinations")


@checked(
    ScenarioError,
    scenario=A_SCENARIO,
    scenario_map=A_MAP,
    params=instance(EnvParams, "an environment, such as sidestep.make_environment(scenario, scenario_map, 'test', 1)"),
    walks=COUNT,
    first=whole(0, MOST_NUMBERED),
    destinations=NODES,
)
def instances(
    scenario: Scenario,
    scenario_map: ScenarioMap,
    params: EnvParams,
    walks: int,
    first: int = 0,
    *,
    destinations: Int[np.ndarray, "destination part"] | None = None,
) -> Instance:
    """The walks of a scenario, corner to corner, each through the next of the environment's futures.

    Departures are spread evenly by the golden ratio, and walks take the parts of the map in turn.

    Parameters
    ----------
    scenario, scenario_map, params
        The problem, its map, and the environment.
    walks, first
        How many walks, and the number of the first.
    destinations
        With these, walks from anywhere, or from the map's own origins, to the destination of each future; a map with
        origins or destinations of its own has no other walks.

    Returns
    -------
    walks
        With a leading axis of walks.

    Raises
    ------
    ScenarioError
        Fewer futures than destinations, nodes that the map does not have, and anything else that is not as above; the
        parameter is its field.

    Examples
    --------
    >>> from sidestep.scenarios.builtin import scenario
    >>> from sidestep.scenarios.episodes import instances
    >>> from sidestep.scenarios.futures import make_environment
    >>> from sidestep.scenarios.maps import draw_map
    >>> problem = scenario("paper-congested")
    >>> here = draw_map(problem, seed=0)
    >>> walks = instances(problem, here, make_environment(problem, here, "test", futures=2), walks=3)
    >>> walks.origin.tolist(), walks.destination.tolist(), walks.future.tolist()
    ([0, 0, 0], [35, 35, 35], [0, 1, 0])
    """
    if destinations is None and (scenario_map.origins or scenario_map.destinations):
        destinations = destinations_of(scenario_map, 1)
    number = first + np.arange(walks)
    begins = np.cumsum((0, *scenario_map.parts))
    part = number % len(scenario_map.parts)
    origin, destination = jnp.asarray(begins[:-1][part]), jnp.asarray(begins[1:][part] - 1)
    future = number % params.futures.count
    if destinations is not None:
        check_nodes(scenario_map, destinations)
        _check_futures(params.futures.count, len(destinations))
        which = params.futures.destination[future]
        destination = jnp.asarray(destinations)[which, part]
        uniform = jax.random.uniform(jax.random.fold_in(scenario_map.key, _ORIGINS + first), (walks,))
        if scenario_map.origins:
            rows, count = (jnp.asarray(each)[which] for each in _own_origins(scenario_map, destinations))
            origin = rows[jnp.arange(walks), _pick(count, uniform)]
        else:  # uniform over the part's other nodes
            others = np.asarray(scenario_map.parts)[part] - 1
            origin = origin + (destination - origin + 1 + _pick(others, uniform)) % (others + 1)
    earliest, latest = scenario.departures
    return Instance(
        origin=origin.astype(jnp.int32),
        destination=destination.astype(jnp.int32),
        departure=jnp.asarray(earliest + (latest - earliest) * (number * GOLDEN % 1), jnp.float32),
        future=jnp.asarray(future, jnp.int32),
    )


def _check_futures(futures: int, count: int) -> None:
    if futures < count:
        raise ScenarioError(f"{count} destinations need as many futures, but there are {futures}", field="destinations")
