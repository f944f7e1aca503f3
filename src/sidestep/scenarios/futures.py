"""Environments on a map with futures for one purpose, and the walks to be done there."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.base import Field, FlowModel
from sidestep.environment.knowledge import WINDOW, live_to_go, usual_to_go
from sidestep.environment.types import EnvParams, LiveToGo, Seen, dense_speeds, field_of, walking_speeds
from sidestep.network.graph import RoadNetwork
from sidestep.scenarios.episodes import goals_of
from sidestep.scenarios.maps import CrowdedMap, Purpose, purpose_key
from sidestep.scenarios.model import LAWS, Scenario
from sidestep.walking.objective import Objective
from sidestep.walking.speed_field import SensedSpeeds, SpeedField, Speeds
from sidestep.walking.waits import Waits


def make_environment(
    scenario: Scenario,
    place: CrowdedMap,
    purpose: Purpose,
    crowds: int,
    *,
    level: Seen = "position",
    goals: Int[np.ndarray, "goal part"] | None = None,
    part: int = 0,
    densities: bool = False,
) -> EnvParams:
    """The environment on one map with possible futures for one purpose.

    ``crowds`` futures are drawn; where the flows are the forecast only there is one, whatever was asked. ``level`` is
    the highest that walkers will see; from ``map`` on it knows the ways to ``goals``, by default to the scenario's own
    destinations. Each ``part`` has futures of its own. ``densities`` says whether crowds shall answer how dense they
    are, as they do anyway where they spread from sensors or an objective asks for it.
    """
    nodes = jnp.asarray(goals_of(place, 1) if goals is None else goals, jnp.int32)
    key, flow = _future_key(place, purpose, part), place.flow_for(purpose)
    plain, objective = _apart(scenario)
    keep = densities or objective is not None
    return _environment(plain, objective, place.network, flow, place.waits, key, crowds, level, nodes, densities=keep)


Futures = tuple[Speeds, LiveToGo | None]  # and what level live works out from their counts


def new_crowds(scenario: Scenario, place: CrowdedMap, params: EnvParams, number: int, crowds: int) -> Futures:
    """Other futures for a training, those of renewal ``number``, counted from 1."""
    key = _future_key(place, "learn", number)
    return _futures(_apart(scenario)[0], place.flow, params, key, crowds)


def _apart(scenario: Scenario) -> tuple[Scenario, Objective | None]:
    """The scenario without its objective, and this: programs need not be compiled anew for other weights."""
    return replace(scenario, objective=None), scenario.objective


def put_crowds(params: EnvParams, futures: Futures, first: Int[Array, ""]) -> EnvParams:
    """The environment with some of its futures replaced, from ``first`` on."""
    crowds, live = _put((params.crowds, params.live), futures, first)
    return replace(params, crowds=crowds, live=live)


@jax.jit
def _put(before: Futures, futures: Futures, first: Int[Array, ""]) -> Futures:
    # Not the whole environment: what is known of usual crowds takes gigabytes in large towns, and would be copied.
    def put(old: Array, new: Array) -> Array:
        return jax.lax.dynamic_update_slice_in_dim(old, new, first, 0)

    (old, old_live), (crowds, live) = before, futures
    if isinstance(old, SensedSpeeds) and isinstance(crowds, SensedSpeeds):
        crowds = replace(old, density=put(old.density, crowds.density))
    else:
        crowds = jax.tree.map(put, old, crowds)
    return crowds, jax.tree.map(put, old_live, live)


def _future_key(place: CrowdedMap, purpose: Purpose, part: int) -> Key[Array, ""]:
    key = purpose_key(place, purpose)
    return jax.random.fold_in(key, part) if part else key


@partial(jax.jit, static_argnames=("scenario", "crowds", "level", "densities"))
def _environment(
    scenario: Scenario,
    objective: Objective | None,
    network: RoadNetwork,
    flow: FlowModel,
    waits: Waits | None,
    key: Key[Array, ""],
    crowds: int,
    level: Seen,
    goals: Int[Array, "goal part"],
    *,
    densities: bool,
) -> EnvParams:
    expected = walking_speeds(network, _expected(flow, scenario.slots), LAWS[scenario.law], densities=densities)
    params = EnvParams(
        network=network,
        crowds=expected,
        expected=expected,
        horizon=jnp.float32(scenario.horizon),
        reward=scenario.reward,
        rule=scenario.rule,
        level=level,
        objective=objective,
        waits=waits,
    )
    if level in ("map", "live"):
        where = jnp.zeros((len(goals), network.nodes), bool).at[jnp.arange(len(goals))[:, None], goals].set(True)
        params = replace(params, usual=usual_to_go(params, where))
    drawn, live = _futures(scenario, flow, params, key, crowds)
    return replace(params, crowds=drawn, live=live)


@partial(jax.jit, static_argnames=("scenario", "crowds"))
def _futures(scenario: Scenario, flow: FlowModel, params: EnvParams, key: Key[Array, ""], crowds: int) -> Futures:
    """Speeds of possible futures and, at level ``live``, what can be worked out from their counts."""
    forecast = scenario.flows == "forecast"
    drawn = _expected(flow, scenario.slots) if forecast else flow.draw(key, crowds, scenario.slots)
    densities = params.expected.density is not None
    speeds = walking_speeds(params.network, drawn, LAWS[scenario.law], densities=densities)
    if params.level != "live":
        return speeds, None
    return speeds, _live(scenario, flow, replace(params, crowds=speeds), drawn)


def _live(scenario: Scenario, flow: FlowModel, params: EnvParams, drawn: Field) -> LiveToGo:
    def ahead(now: Float[Array, " counter"], slot: Int[Array, ""], crowd: Int[Array, ""]) -> SpeedField:
        foreseen = drawn.with_counted(flow.ahead(now, slot, WINDOW, crowd))
        return dense_speeds(params.network, foreseen, LAWS[scenario.law], densities=params.objective is not None)

    return live_to_go(params, drawn.counted, ahead)


@partial(jax.jit, static_argnames=("scenario", "slots", "forecasts"))
def see_counts(
    scenario: Scenario, flow: FlowModel, params: EnvParams, slots: int, *, forecasts: bool = True
) -> EnvParams:
    """The same crowds for walkers of level ``live``, who are shown counts and forecasts of the first slots only.

    Forecasts take much longer than all else, so that it pays to leave out slots in which everybody has arrived. After
    the last of them walkers see what they saw in it. Without ``forecasts`` these are zero, for walkers who do not look
    at them. ``params`` is of level ``map`` at least, and its crowds have their densities.
    """
    shown = replace(params, crowds=params.crowds.first(slots=slots))
    live = _live(scenario, flow, shown, field_of(params.network, shown.crowds))
    if not forecasts:  # the compiler then leaves out what they take
        live = LiveToGo(jnp.zeros_like(live.forecast), live.snapshot)
    return replace(params, live=live, level="live")


def _expected(flow: FlowModel, slots: int) -> Field:
    """Expected crowds with a leading axis of one or more."""
    field = flow.expected(slots)
    return field if field.counted.ndim == 3 else field.with_counted(field.counted[None])
