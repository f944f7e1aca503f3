"""Environments on a map with futures for one purpose, and the walks to be done there."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.base import Field, FlowModel
from sidestep.environment.knowledge import WINDOW, expected_cost_to_go, live_cost_to_go
from sidestep.environment.types import EnvParams, Information, LiveCostToGo, dense_speeds, field_of, walking_speeds
from sidestep.network.graph import RoadNetwork
from sidestep.scenarios.build import objective_of, reward_of
from sidestep.scenarios.episodes import destinations_of
from sidestep.scenarios.maps import Purpose, ScenarioMap, purpose_key
from sidestep.scenarios.model import ObjectiveSpec, Scenario
from sidestep.walking.objective import Objective
from sidestep.walking.speed_field import SensedSpeeds, SpeedField, Speeds
from sidestep.walking.speed_laws import LAWS
from sidestep.walking.waits import Waits


def make_environment(
    scenario: Scenario,
    scenario_map: ScenarioMap,
    purpose: Purpose,
    futures: int,
    *,
    level: Information = "position",
    destinations: Int[np.ndarray, "goal part"] | None = None,
    part: int = 0,
    densities: bool = False,
) -> EnvParams:
    """The environment on one map with possible futures for one purpose.

    ``futures`` futures are drawn; where the flows are the forecast only there is one, whatever was asked. ``level`` is
    the highest that walkers will see; from ``map`` on it knows the ways to ``destinations``, by default to the
    scenario's own. Each ``part`` has futures of its own. ``densities`` says whether crowds shall answer how dense they
    are, as they do anyway where they spread from sensors or an objective asks for it.
    """
    nodes = jnp.asarray(destinations_of(scenario_map, 1) if destinations is None else destinations, jnp.int32)
    key, flow = _future_key(scenario_map, purpose, part), scenario_map.flow_for(purpose)
    plain, objective = _apart(scenario)
    keep = densities or objective is not None
    return _environment(
        plain,
        objective,
        scenario_map.network,
        flow,
        scenario_map.hours,
        scenario_map.waits,
        key,
        futures,
        level,
        nodes,
        densities=keep,
    )


Futures = tuple[Speeds, LiveCostToGo | None]  # and what level live works out from their counts


def sample_futures(
    scenario: Scenario, scenario_map: ScenarioMap, params: EnvParams, number: int, futures: int
) -> Futures:
    """Other futures for a training, those of renewal ``number``, counted from 1."""
    key = _future_key(scenario_map, "learn", number)
    return _futures(_apart(scenario)[0], scenario_map.flow, scenario_map.hours, params, key, futures)


def _apart(scenario: Scenario) -> tuple[Scenario, Objective | None]:
    """The scenario without its objective, and this: programs need not be compiled anew for other weights."""
    return scenario.changed(objective=ObjectiveSpec()), objective_of(scenario.objective)


def replace_futures(params: EnvParams, futures: Futures, first: Int[Array, ""]) -> EnvParams:
    """The environment with some of its futures replaced, from ``first`` on."""
    speeds, live = _put((params.futures, params.live), futures, first)
    return replace(params, futures=speeds, live=live)


@jax.jit
def _put(before: Futures, futures: Futures, first: Int[Array, ""]) -> Futures:
    # Not the whole environment: what is known of usual crowds takes gigabytes in large towns, and would be copied.
    def put(old: Array, new: Array) -> Array:
        return jax.lax.dynamic_update_slice_in_dim(old, new, first, 0)

    (old, old_live), (speeds, live) = before, futures
    if isinstance(old, SensedSpeeds) and isinstance(speeds, SensedSpeeds):
        speeds = replace(old, density=put(old.density, speeds.density))
    else:
        speeds = jax.tree.map(put, old, speeds)
    return speeds, jax.tree.map(put, old_live, live)


def _future_key(scenario_map: ScenarioMap, purpose: Purpose, part: int) -> Key[Array, ""]:
    key = purpose_key(scenario_map, purpose)
    return jax.random.fold_in(key, part) if part else key


@partial(jax.jit, static_argnames=("scenario", "futures", "level", "densities"))
def _environment(
    scenario: Scenario,
    objective: Objective | None,
    network: RoadNetwork,
    flow: FlowModel,
    hours: Float[Array, " hour"],
    waits: Waits | None,
    key: Key[Array, ""],
    futures: int,
    level: Information,
    destinations: Int[Array, "goal part"],
    *,
    densities: bool,
) -> EnvParams:
    expected = walking_speeds(network, flow.expected(hours, scenario.slots), LAWS[scenario.law], densities=densities)
    params = EnvParams(
        network=network,
        futures=expected,
        expected=expected,
        horizon=jnp.float32(scenario.horizon),
        reward=reward_of(scenario.reward),
        rule=scenario.rule,
        level=level,
        objective=objective,
        waits=waits,
    )
    if level in ("map", "live"):
        where = (
            jnp.zeros((len(destinations), network.nodes), bool)
            .at[jnp.arange(len(destinations))[:, None], destinations]
            .set(True)
        )
        params = replace(params, usual=expected_cost_to_go(params, where))
    drawn, live = _futures(scenario, flow, hours, params, key, futures)
    return replace(params, futures=drawn, live=live)


@partial(jax.jit, static_argnames=("scenario", "futures"))
def _futures(
    scenario: Scenario,
    flow: FlowModel,
    hours: Float[Array, " hour"],
    params: EnvParams,
    key: Key[Array, ""],
    futures: int,
) -> Futures:
    """Speeds of possible futures and, at level ``live``, what can be worked out from their counts."""
    forecast = scenario.flows == "forecast"
    each = hours[jnp.arange(futures) % hours.shape[0]]
    drawn = flow.expected(hours, scenario.slots) if forecast else flow.draw(key, each, scenario.slots)
    densities = params.expected.density is not None
    speeds = walking_speeds(params.network, drawn, LAWS[scenario.law], densities=densities)
    if params.level != "live":
        return speeds, None
    return speeds, _live(scenario, flow, hours, replace(params, futures=speeds), drawn)


def _live(
    scenario: Scenario, flow: FlowModel, hours: Float[Array, " hour"], params: EnvParams, drawn: Field
) -> LiveCostToGo:
    def ahead(now: Float[Array, " counter"], slot: Int[Array, ""], future: Int[Array, ""]) -> SpeedField:
        foreseen = drawn.with_counted(flow.ahead(now, hours[future % hours.shape[0]], slot, WINDOW))
        return dense_speeds(params.network, foreseen, LAWS[scenario.law], densities=params.objective is not None)

    return live_cost_to_go(params, drawn.counted, ahead)


@partial(jax.jit, static_argnames=("scenario", "slots", "forecasts"))
def see_counts(
    scenario: Scenario,
    flow: FlowModel,
    hours: Float[Array, " hour"],
    params: EnvParams,
    slots: int,
    *,
    forecasts: bool = True,
) -> EnvParams:
    """The same crowds for walkers of level ``live``, who are shown counts and forecasts of the first slots only.

    Forecasts take much longer than all else, so that it pays to leave out slots in which everybody has arrived. After
    the last of them walkers see what they saw in it. Without ``forecasts`` these are zero, for walkers who do not look
    at them. ``params`` is of level ``map`` at least, and its crowds have their densities.
    """
    shown = replace(params, futures=params.futures.first(slots=slots))
    live = _live(scenario, flow, hours, shown, field_of(params.network, shown.futures))
    if not forecasts:  # the compiler then leaves out what they take
        live = LiveCostToGo(jnp.zeros_like(live.forecast), live.snapshot)
    return replace(params, live=live, level="live")
