"""Environments on a map with futures for one purpose, and the walks to be done there."""

import math
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.environment.instances import InstanceSampler
from sidestep.environment.knowledge import WINDOW, live_to_go, usual_to_go
from sidestep.environment.types import EnvParams, Instance, LiveToGo, Seen, UsualToGo, walking_speeds
from sidestep.flow.field import FlowField
from sidestep.scenarios.catalogue import LAWS, Scenario, ScenarioError
from sidestep.scenarios.maps import CrowdedMap, Purpose, purpose_key
from sidestep.travel_time import SpeedField


def make_environment(
    scenario: Scenario,
    place: CrowdedMap,
    purpose: Purpose,
    crowds: int,
    *,
    level: Seen = "position",
    goals: Int[np.ndarray, "goal part"] | None = None,
    part: int = 0,
) -> EnvParams:
    """The environment on one map with possible futures for one purpose.

    ``crowds`` futures are drawn; where the flows are the forecast only there is one, whatever was asked. ``level`` is
    the highest that walkers will see; from ``map`` on it knows the ways to ``goals``, by default to the scenario's own
    destinations. Each ``part`` has futures of its own.
    """
    goals = destinations(place.parts, 1) if goals is None else goals
    return _environment(
        scenario, place, _future_key(place, purpose, part), crowds, level, jnp.asarray(goals, jnp.int32)
    )


Futures = tuple[SpeedField, LiveToGo | None]  # and what level live works out from their counts


def new_crowds(scenario: Scenario, place: CrowdedMap, params: EnvParams, number: int, crowds: int) -> Futures:
    """Other futures for a training, those of renewal ``number``, counted from 1."""
    usual = params.usual if params.level == "live" else None
    return _futures(scenario, place, usual, _future_key(place, "learn", number), crowds)


@jax.jit
def put_crowds(params: EnvParams, futures: Futures, first: Int[Array, ""]) -> EnvParams:
    """The environment with some of its futures replaced, from ``first`` on."""
    crowds, live = jax.tree.map(
        lambda old, new: jax.lax.dynamic_update_slice_in_dim(old, new, first, 0), (params.crowds, params.live), futures
    )
    return replace(params, crowds=crowds, live=live)


def _future_key(place: CrowdedMap, purpose: Purpose, part: int) -> Key[Array, ""]:
    key = purpose_key(place, purpose)
    return jax.random.fold_in(key, part) if part else key


@partial(jax.jit, static_argnames=("scenario", "crowds", "level"))
def _environment(
    scenario: Scenario,
    place: CrowdedMap,
    key: Key[Array, ""],
    crowds: int,
    level: Seen,
    goals: Int[Array, "goal part"],
) -> EnvParams:
    network = place.network
    expected = walking_speeds(network, place.flow.expected(scenario.slots), LAWS[scenario.law])
    usual = None
    if level in ("map", "live"):
        where = jnp.zeros((len(goals), network.nodes), bool).at[jnp.arange(len(goals))[:, None], goals].set(True)
        usual = usual_to_go(network, expected, where, scenario.rule)
    drawn, live = _futures(scenario, place, usual if level == "live" else None, key, crowds)
    return EnvParams(
        network=network,
        crowds=drawn,
        expected=expected,
        horizon=jnp.float32(scenario.horizon),
        reward=scenario.reward,
        rule=scenario.rule,
        level=level,
        usual=usual,
        live=live,
    )


@partial(jax.jit, static_argnames=("scenario", "crowds"))
def _futures(
    scenario: Scenario, place: CrowdedMap, usual: UsualToGo | None, key: Key[Array, ""], crowds: int
) -> Futures:
    """Speeds of possible futures and, with ``usual``, what can be worked out from their counts."""
    network, law = place.network, LAWS[scenario.law]
    if scenario.flows == "forecast":
        drawn = jax.tree.map(lambda leaf: leaf[None], place.flow.expected(scenario.slots))
    else:
        drawn = place.flow.draw(key, crowds, scenario.slots)
    speeds = walking_speeds(network, drawn, law)
    if usual is None:
        return speeds, None

    def ahead(now: Float[Array, " segment"], slot: Int[Array, ""]) -> Float[Array, "segment window"]:
        field = FlowField(place.flow.ahead(now, slot, WINDOW), scenario.slot_seconds)
        return law.speed(field.density(network)).T

    return speeds, live_to_go(network, speeds, drawn.volume, ahead, usual, scenario.rule)


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


def sampler(
    scenario: Scenario,
    place: CrowdedMap,
    params: EnvParams,
    crowds: int,
    *,
    goals: Int[np.ndarray, "goal part"] | None = None,
    anywhere: bool = False,
) -> InstanceSampler:
    """The scenario's walks, or walks from anywhere, to ``goals``, through the first ``crowds`` futures."""
    goals = destinations(place.parts, 1) if goals is None else goals
    _check_futures(params, len(goals))
    part = np.repeat(np.arange(len(place.parts)), place.parts)
    first = np.cumsum((0, *place.parts[:-1]))
    # Both have as many candidates, so that training from either is the same compiled program.
    elsewhere = np.stack([np.setdiff1d(np.arange(len(part)), of_goal) for of_goal in goals])
    return InstanceSampler(
        origins=jnp.asarray(elsewhere if anywhere else first[part[elsewhere]], jnp.int32),
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

    With ``goals``, walks from anywhere to each of these in turn. Departures are spread evenly by the golden ratio, and
    walks take the parts of the map in turn.
    """
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
        step = 1 + jnp.minimum((uniform * others).astype(jnp.int32), others - 1)
        origin = begins[on] + (destination - begins[on] + step) % (others + 1)
    earliest, latest = scenario.departures
    return Instance(
        origin=jnp.asarray(origin, jnp.int32),
        destination=jnp.asarray(destination, jnp.int32),
        departure=jnp.asarray(earliest + (latest - earliest) * (number * _GOLDEN % 1), jnp.float32),
        crowd=jnp.asarray(crowd, jnp.int32),
    )


def _check_futures(params: EnvParams, goals: int) -> None:
    """Each crowd is for one goal."""
    if params.crowds.count < goals:
        raise ScenarioError(f"{goals} destinations need as many futures, but there are {params.crowds.count}")


_ORIGINS = 1_000  # beyond the numbers of purposes
_GOLDEN = (math.sqrt(5) - 1) / 2
