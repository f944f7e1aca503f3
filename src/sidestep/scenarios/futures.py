"""Environments on a map, with possible futures of its crowds for one purpose."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.arguments import COUNT, FLAG, NUMBER, checked, each, instance, one_of, whole
from sidestep.crowds.base import Field, FlowModel
from sidestep.environment.cost_to_go import (
    WINDOW,
    expected_cost_to_go,
    live_cost_to_go,
    unknown_cost_to_go,
)
from sidestep.environment.types import (
    DENSITY_SCALE,
    LEVELS,
    EnvParams,
    ExpectedCostToGo,
    Futures,
    Information,
    LiveCostToGo,
    Meant,
    SeeSlot,
    destinations_in_turn,
    futures_in_turn,
)
from sidestep.network.graph import RoadNetwork
from sidestep.programs import Kept, on_device, program
from sidestep.scenarios.episodes import MOST_NUMBERED, NODES, check_nodes, destinations_of
from sidestep.scenarios.expectation import Crowds, Expectation
from sidestep.scenarios.maps import A_MAP, PURPOSES, Purpose, ScenarioMap, purpose_key
from sidestep.scenarios.model import A_SCENARIO, Scenario, objective_of, reward_of
from sidestep.scenarios.spec import ScenarioError
from sidestep.walking.crossing_time import CrossingRule
from sidestep.walking.expected_times import Speeds
from sidestep.walking.speed_field import SpeedField, dense_speeds, walking_speeds

MOST_BYTES = 2**29
"""Of costs from counts that are kept for walks that ask for them again."""


@checked(
    ScenarioError,
    scenario=A_SCENARIO,
    scenario_map=A_MAP,
    purpose=one_of(PURPOSES),
    futures=COUNT,
    level=one_of(LEVELS),
    destinations=NODES,
    hours=each(NUMBER, "a list of hours of the week"),
    part=whole(0, MOST_NUMBERED),
    costs=FLAG,
    densities=FLAG,
    samples=whole(0, MOST_NUMBERED),
    pace=instance(jax.Array, "an array, such as expected_pace gives"),
)
def make_environment(
    scenario: Scenario,
    scenario_map: ScenarioMap,
    purpose: Purpose,
    futures: int,
    *,
    level: Information = "position",
    destinations: Int[np.ndarray, "destination part"] | None = None,
    hours: Sequence[float] | None = None,
    part: int = 0,
    costs: bool = True,
    densities: bool = False,
    samples: int | None = None,
    pace: Float[Array, "segment step"] | None = None,
) -> EnvParams:
    """The environment on one map with possible futures for one purpose.

    Futures are for each of the destinations in turn, at the hour at which walks to it set out.

    Parameters
    ----------
    scenario, scenario_map
        The problem, and one of its maps.
    purpose
        Decides the random stream that futures are drawn from; "expect" is that of expected times.
    futures
        How many to draw. Where crowds come as expected there is one for each hour, whatever was asked.
    level
        The highest level of the walkers; from ``map`` on, costs of getting to the destinations are worked out.
    destinations
        A node of each part of the map for each destination; by default the scenario's own.
    hours
        Hour of the week at which walks to each destination set out; by default the scenario's.
    part
        Each part of a comparison has futures of its own.
    costs
        Whether costs of getting to the destinations are worked out from level ``map`` on. Without them walkers may look
        at snapshots only (:func:`see_counts`).
    densities
        Whether densities are kept beside speeds even where the objective does not need them.
    samples
        Futures that expected times to cross are means over, for each hour; by default as many as the size of the map
        allows. They are drawn from the crowds to learn from, and are those of no other purpose. With 0, times are those
        in the mean crowds: for walkers who know nothing of either.
    pace
        Mean seconds for each metre at the only hour (:func:`sidestep.scenarios.expectation.expected_pace`); by default
        they are worked out.

    Returns
    -------
    params
        The environment, for walkers of ``level``.

    Raises
    ------
    ScenarioError
        An unknown purpose or level, nodes that the map does not have, more hours than destinations or fewer, and
        anything else that is not as above; the parameter is its field.

    Examples
    --------
    >>> from sidestep.scenarios.builtin import scenario
    >>> from sidestep.scenarios.futures import make_environment
    >>> from sidestep.scenarios.maps import draw_map
    >>> problem = scenario("paper-congested")
    >>> params = make_environment(problem, draw_map(problem, seed=0), "test", futures=3)
    >>> params.futures.count, params.network.nodes
    (3, 36)
    """
    nodes = destinations_of(scenario_map, 1) if destinations is None else destinations
    check_nodes(scenario_map, nodes)
    if hours is not None and len(hours) != len(nodes):
        said = f"hours must be as many as the destinations, {len(nodes)}"
        raise ScenarioError(f"{said}, not {len(hours)}", field="hours")
    hours = scenario.place.departure_hours(len(nodes), part * futures) if hours is None else hours
    objective = objective_of(scenario.objective)
    rule, network, free_speed = scenario.rule, scenario_map.network, scenario.walker.free_speed
    rest = {"horizon": on_device(scenario.horizon), "reward": reward_of(scenario.reward)}
    rest |= {"objective": objective, "waits": scenario_map.waits}
    drawn, expected, known = _environment(
        Crowds.of(scenario, scenario_map.flow_for(purpose)),
        Crowds.of(scenario, scenario_map.flow),
        purpose_key(scenario_map, purpose, part),
        purpose_key(scenario_map, "expect"),
        on_device(np.array(hours)),
        on_device(nodes, np.int32),
        futures=futures,
        samples=samples,
        pace=pace,
        costs=costs,
        densities=densities or objective.needs_density,
        level=level,
        network=network,
        rule=rule,
        free_speed=free_speed,
        rest=rest,
    )
    # Only what was worked out is returned: streets and waits would be copied.
    given: dict[str, Any] = {"level": level, "rule": rule, "free_speed": free_speed, **rest}
    return EnvParams(network, drawn, expected, cost_to_go=known, **given)


def sample_futures(
    scenario: Scenario, scenario_map: ScenarioMap, params: EnvParams, turn: int, futures: int, among: int | None = None
) -> Futures:
    """Other futures for a training, to replace as many of an environment.

    They take the destinations and hours of those that they replace, which are taken in turn.

    Parameters
    ----------
    scenario, scenario_map, params
        The problem, its map, and the environment.
    turn
        Which renewal it is, counted from 1.
    futures
        How many to draw.
    among
        How many of the environment's futures are renewed in turn, the first ones; by default all.

    Returns
    -------
    Futures
        As many as were asked for.
    """
    index = _in_turn(params, turn * futures, futures, among)
    crowds, key = Crowds.of(scenario, scenario_map.flow), purpose_key(scenario_map, "learn", turn)
    return _sampled(crowds, params, key, index)


def replace_futures(
    params: EnvParams, futures: Futures, first: Int[Array, ""] | int, among: int | None = None
) -> EnvParams:
    """The environment with some of its futures replaced.

    Parameters
    ----------
    params, futures
        The environment, and its new futures.
    first
        Number of the first one that is replaced; after the last of those that are renewed comes number 0.
    among
        How many of the environment's futures are renewed in turn, the first ones; by default all.

    Returns
    -------
    EnvParams
        It shares everything else with the old one.
    """
    index = _in_turn(params, first, futures.destination.shape[0], among)
    # Not in the whole environment: expected costs take gigabytes in large towns, and would be copied.
    return replace(params, futures=_replaced(params.futures, futures, index))


def see_counts(scenario: Scenario, flow: FlowModel, params: EnvParams, *, forecasts: bool = True) -> SeeSlot:
    """The same environment for walkers of level ``live``, slot by slot.

    Costs of all slots of all futures take gigabytes in large towns, and forecasts much longer than all else: they are
    worked out where walkers are.

    Parameters
    ----------
    scenario, flow
        The problem, and the crowds that forecasts are made of.
    params
        An environment of level ``map`` at least, with densities.
    forecasts
        Whether forecasts are worked out; else there are none, for walkers who do not look at them.

    Returns
    -------
    SeeSlot
        Gives the environment for walkers who are in one slot. Its futures have the costs that follow from the counts of
        the slot, and from forecasts.
    """
    costs_in = KEPT.given(Crowds.of(scenario, flow), params, forecasts=forecasts)

    def see(slot: int, wanted: Bool[np.ndarray, " future"]) -> EnvParams:
        costs = costs_in(on_device(np.array(slot), np.int32), on_device(wanted, np.bool_))
        return replace(params, futures=replace(params.futures, cost_to_go=costs), level="live")

    return see


_replaced = jax.jit(Futures.replaced)


def _in_turn(params: EnvParams, first: Int[Array, ""] | int, futures: int, among: int | None) -> Int[Array, " future"]:
    """Numbers of the futures that are replaced."""
    return (first + jnp.arange(futures)) % min(among or params.futures.count, params.futures.count)


@program("futures", "samples", "costs", "densities", "level", "rule", "free_speed")
def _environment(
    crowds: Crowds,
    learned: Crowds,
    key: Key[Array, ""],
    key_of_expected: Key[Array, ""],
    hours: Float[Array, " destination"],
    destinations: Int[Array, "destination part"],
    *,
    futures: int,
    samples: int | None,
    pace: Float[Array, "segment step"] | None,
    costs: bool,
    densities: bool,
    level: Information,
    network: RoadNetwork,
    rule: CrossingRule,
    free_speed: float,
    rest: dict[str, Any],
) -> tuple[Futures, Speeds, ExpectedCostToGo | None]:
    """Futures, what is expected, and from level ``map`` on the costs of getting to the destinations."""
    expectation = Expectation(learned, network, key_of_expected, hours, rule, samples, densities)
    expected = expectation.speeds(pace=pace)
    given: dict[str, Any] = {"level": level, "rule": rule, "free_speed": free_speed, **rest}
    params = EnvParams(network, futures_in_turn(expected, hours), expected, **given)
    if level in ("map", "live"):
        nothing = jnp.zeros((len(destinations), network.nodes), bool)
        where = nothing.at[jnp.arange(len(destinations))[:, None], destinations].set(True)
        if costs:
            scaled = expectation.speeds(DENSITY_SCALE) if expected.interpolated else None
            known = expected_cost_to_go(params, where, hours, scaled)
        else:
            known = unknown_cost_to_go(where)
        params = replace(params, cost_to_go=known)
    number = expected.count if crowds.as_expected else futures
    return _drawn(crowds, params, key, destinations_in_turn(number, hours)), expected, params.cost_to_go


@jax.jit
def _sampled(crowds: Crowds, params: EnvParams, key: Key[Array, ""], index: Int[Array, " future"]) -> Futures:
    old = params.futures
    return _drawn(crowds, params, key, (old.destination[index], old.hour[index], old.phase[index]))


def _drawn(crowds: Crowds, params: EnvParams, key: Key[Array, ""], meant: Meant) -> Futures:
    """Possible futures and, at level ``live``, the costs that can be worked out from their counts."""
    flow, slots, (_, hour, _) = crowds.flow, crowds.slots, meant
    field = flow.expected(hour, slots) if crowds.as_expected else flow.draw(key, hour, slots)
    speeds = walking_speeds(params.network, field, crowds.law, densities=params.expected.keeps_density)
    futures = Futures(speeds, *meant)
    if params.level != "live":
        return futures
    return replace(futures, cost_to_go=_live_cost_to_go(crowds, replace(params, futures=futures), field))


def _live_cost_to_go(
    crowds: Crowds,
    params: EnvParams,
    field: Field,
    slot: Int[Array, ""] | None = None,
    wanted: Bool[Array, " future"] | None = None,
    *,
    forecasts: bool = True,
) -> LiveCostToGo:
    network, law, seen = params.network, crowds.law, params.futures.speeds.sightings

    def ahead(now: Float[Array, " counter"], hour: Float[Array, ""], slot: Int[Array, ""]) -> SpeedField:
        forecast = replace(field, counted=crowds.flow.ahead(now, hour, slot, WINDOW))
        if seen is None:
            return dense_speeds(network, forecast, law, densities=params.objective.needs_density)
        return dense_speeds(network, forecast, law, densities=True).seeing(seen.later(slot, WINDOW), law, network.pace)

    return live_cost_to_go(params, field.counted, ahead, slot, wanted, forecasts=forecasts)


@program("forecasts")
def _in_slot(
    crowds: Crowds, params: EnvParams, slot: Int[Array, ""], wanted: Bool[Array, " future"], *, forecasts: bool
) -> LiveCostToGo:
    field = params.futures.speeds.field(params.network)
    return _live_cost_to_go(crowds, params, field, slot, wanted, forecasts=forecasts)


KEPT = Kept(_in_slot, MOST_BYTES)
"""Costs from the counts of slots, of the latest walks."""
