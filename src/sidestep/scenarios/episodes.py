"""Which walks are walked: origins, destinations, departures and futures."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from sidestep.environment.instances import InstanceSampler
from sidestep.environment.types import EnvParams, Instance
from sidestep.scenarios.build import check_ways
from sidestep.scenarios.maps import CrowdedMap
from sidestep.scenarios.model import Scenario, ScenarioError
from sidestep.walking.waits import GOLDEN


def destinations(parts: tuple[int, ...], goals: int) -> Int[np.ndarray, "goal part"]:
    """Where walks may go: on each part its upper right corner, then other nodes, all different, as many as asked.

    There is one node of each part to a goal, and no part's first node is among them. The other nodes depend on the
    size of the map alone, so that a model and those it is compared with mean the same ones.
    """
    first = np.cumsum((0, *parts[:-1]))
    if not 1 <= goals <= min(parts) - 1:
        raise ScenarioError(f"there must be between 1 and {min(parts) - 1} destinations, not {goals}")
    rng = np.random.default_rng(len(parts))
    others = [1 + rng.permutation(nodes - 2)[: goals - 1] for nodes in parts]
    return np.stack([[nodes - 1, *rest] for nodes, rest in zip(parts, others, strict=True)], axis=1) + first


def goals_of(place: CrowdedMap, goals: int) -> Int[np.ndarray, "goal part"]:
    """Where walks on a map may go: those of :func:`destinations`, or some of its own destinations, where it has such.

    Raises
    ------
    ScenarioError
        More than there are.
    """
    if not place.ends:
        spared = _only_origin(place)
        if not spared:
            return destinations(place.parts, goals)
        # Nobody walks to where all walks begin.
        every = destinations(place.parts, place.network.nodes - 1)
        return _some(every[~np.isin(every[:, 0], spared)], goals)
    return _some(np.random.default_rng(len(place.ends)).permutation(place.ends)[:, None], goals)


def _some(every: Int[np.ndarray, "any part"], goals: int) -> Int[np.ndarray, "goal part"]:
    if not 1 <= goals <= len(every):
        raise ScenarioError(f"there must be between 1 and {len(every)} destinations, not {goals}")
    return every[:goals]


def _only_origin(place: CrowdedMap) -> tuple[int, ...]:
    return place.origins if len(place.origins) == 1 else ()


def set_out(scenario: Scenario, place: CrowdedMap, goals: Int[np.ndarray, "goal part"], first: int = 0) -> CrowdedMap:
    """The place at the hours of the week at which people set out for each goal, where the scenario has such hours.

    Raises
    ------
    ScenarioError
        A venue where somebody may come to a crossing from which there is no way on.
    """
    if scenario.venue is None:
        return place
    check_ways(place.network, place.origins, place.ends)
    return place.beginning(scenario.venue.starts(len(goals), first))


def anywhere_to_anywhere(place: CrowdedMap, walks: int, part: int) -> Int[np.ndarray, "goal 1"]:
    """As many destinations as walks, all different, drawn anew for each part of a comparison.

    Where the map has destinations of its own they are among these, and there may be fewer: walks go to each in turn.
    """
    nodes = place.network.nodes
    if walks > nodes - 1:
        raise ScenarioError(f"there cannot be {walks} different destinations among {nodes} nodes")
    rng = np.random.default_rng([*np.asarray(jax.random.key_data(place.key)).tolist(), part])
    among = rng.permutation(place.ends or nodes)
    return among[~np.isin(among, _only_origin(place))][:walks, None]


def _origins(place: CrowdedMap, goals: Int[np.ndarray, "goal 1"]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes that a map's walks to each goal begin at, as rows of one length, and how many of a row are different."""
    rows = [[node for node in place.origins if node != goal] for goal in goals[:, 0].tolist()]
    count = np.array([len(row) for row in rows])
    return np.stack([np.resize(row, max(len(place.origins), 1)) for row in rows]), count


def sampler(
    scenario: Scenario,
    place: CrowdedMap,
    params: EnvParams,
    crowds: int,
    *,
    goals: Int[np.ndarray, "goal part"] | None = None,
    anywhere: bool = False,
) -> InstanceSampler:
    """The scenario's walks, or walks from anywhere, to ``goals``, through the first ``crowds`` futures.

    Where the map has origins of its own, all walks begin there.
    """
    goals = goals_of(place, 1) if goals is None else goals
    _check_futures(params, len(goals))
    part = np.repeat(np.arange(len(place.parts)), place.parts)
    first = np.cumsum((0, *place.parts[:-1]))
    # Both have as many candidates, so that training from either is the same compiled program.
    elsewhere = np.stack([np.setdiff1d(np.arange(len(part)), of_goal) for of_goal in goals])
    begins = elsewhere if anywhere or place.ends else first[part[elsewhere]]
    if place.origins:
        begins = elsewhere = _origins(place, goals)[0]
    return InstanceSampler(
        origins=jnp.asarray(begins, jnp.int32),
        destinations=jnp.asarray(goals[np.arange(len(goals))[:, None], part[elsewhere]], jnp.int32),
        departures=jnp.asarray(np.asarray(scenario.departures), jnp.float32),
        crowds=jnp.asarray(min(crowds, params.crowds.count), jnp.int32),
    )


def instances(
    scenario: Scenario,
    place: CrowdedMap,
    params: EnvParams,
    walks: int,
    first: int = 0,
    *,
    goals: Int[np.ndarray, "goal part"] | None = None,
) -> Instance:
    """Walks number ``first`` and on of the scenario, corner to corner, each through a future of its own.

    With ``goals``, walks from anywhere, or from the map's own origins, to each of these in turn; a map with origins or
    destinations of its own has no other walks. Departures are spread evenly by the golden ratio, and walks take the
    parts of the map in turn.
    """
    if goals is None and (place.origins or place.ends):
        goals = goals_of(place, 1)
    number = first + np.arange(walks)
    begins = np.cumsum((0, *place.parts))
    on = number % len(place.parts)
    origin, destination = begins[:-1][on], begins[1:][on] - 1
    crowd = number % params.crowds.count
    if goals is not None:
        _check_futures(params, len(goals))
        destination = goals[crowd % len(goals), on]
        # Uniform over the part's other nodes.
        others = np.asarray(place.parts)[on] - 1
        uniform = jax.random.uniform(jax.random.fold_in(place.key, _ORIGINS + first), (walks,))
        if place.origins:
            rows, count = (jnp.asarray(each[crowd % len(goals)]) for each in _origins(place, goals))
            chosen = jnp.minimum((uniform * count).astype(jnp.int32), count - 1)
            return _walks(scenario, number, rows[jnp.arange(walks), chosen], destination, crowd)
        step = 1 + jnp.minimum((uniform * others).astype(jnp.int32), others - 1)
        origin = begins[on] + (destination - begins[on] + step) % (others + 1)
    return _walks(scenario, number, origin, destination, crowd)


def _walks(
    scenario: Scenario,
    number: Int[np.ndarray, " walk"],
    origin: Int[Array | np.ndarray, " walk"],
    destination: Int[np.ndarray, " walk"],
    crowd: Int[np.ndarray, " walk"],
) -> Instance:
    earliest, latest = scenario.departures
    return Instance(
        origin=jnp.asarray(origin, jnp.int32),
        destination=jnp.asarray(destination, jnp.int32),
        departure=jnp.asarray(earliest + (latest - earliest) * (number * GOLDEN % 1), jnp.float32),
        crowd=jnp.asarray(crowd, jnp.int32),
    )


def _check_futures(params: EnvParams, goals: int) -> None:
    """Each crowd is for one goal."""
    if params.crowds.count < goals:
        raise ScenarioError(f"{goals} destinations need as many futures, but there are {params.crowds.count}")


_ORIGINS = 1_000  # beyond the numbers of purposes
