"""The reactive planners by hand on the diamond: which jam traps which; and all of them beside the clairvoyant."""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.environment.cost_to_go import expected_cost_to_go, live_cost_to_go
from sidestep.environment.types import EnvParams, Instance, KnowledgeError
from sidestep.planners.base import Planner, routes, walk_plan
from sidestep.planners.reactive import Forecast, GreedyLocal, GreedyMap, Snapshot
from sidestep.planners.time_dependent import Clairvoyant
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment, see_counts
from sidestep.scenarios.maps import ScenarioMap, draw_map
from sidestep.scenarios.model import Scenario
from sidestep.walking.speed_field import SpeedField, speed_field

KEY = jax.random.key(0)
REACTIVE = (GreedyLocal(), GreedyMap(), Snapshot(), Forecast())


SLOT = 150.0


@jax.jit
def knowing(params: EnvParams) -> EnvParams:
    """All is known of the way to node 3; what is forecast from the counts is what comes."""
    network, field = params.network, params.futures.speeds.of(jnp.int32(0))
    costs = expected_cost_to_go(params, (jnp.arange(network.nodes) == 3)[None], jnp.zeros(1))
    params = replace(params, cost_to_go=costs, level="live")

    def ahead(_now: jax.Array, _hour: jax.Array, slot: jax.Array) -> SpeedField:
        return speed_field(field.speed[:, jnp.minimum(slot + jnp.arange(4), field.slots - 1)], SLOT)

    volume = jnp.ones((1, field.slots, network.segments))
    live = live_cost_to_go(params, volume, ahead)
    return replace(params, futures=replace(params.futures, cost_to_go=live))


@pytest.fixture(scope="module")
def world(diamond, make_params) -> Callable[..., EnvParams]:
    """The diamond at some speeds, which are also expected unless others are."""

    def make(speed: jax.Array, expected: jax.Array | None = None) -> EnvParams:
        usual = speed if expected is None else expected
        return knowing(make_params(diamond, speed_field(speed, SLOT), speed_field(usual, SLOT), horizon=3000.0))

    return make


def walks(params: EnvParams, instance, planner: Planner) -> tuple[tuple[int, ...], float, bool]:
    (route,) = routes(planner, params, instance, KEY, 4)
    return route.nodes, pytest.approx(route.seconds, rel=1e-5), route.arrived


def test_local_walks_into_the_trap_that_map_avoids(world, make_instance) -> None:
    # 1 > 3 is slow for ever, at .85 m/s, and 2 > 3 is fast, at 2 m/s.
    params = world(jnp.ones((8, 2)).at[1].set(0.85).at[3].set(2.0))
    # At 0 both go on sqrt(2) 100 m straight, so 100 s beat 150 s. At 1 on 200 / .85 = 235.294 s; back 100 + 149.254 s.
    assert walks(params, make_instance([0]), GreedyLocal()) == ((0, 1, 3), 335.29412, True)
    # above 335 s, below 150 + 125 s
    for planner in (GreedyMap(), Snapshot(), Forecast()):
        assert walks(params, make_instance([0]), planner) == ((0, 2, 3), 275, True)


def test_local_may_pace_to_and_fro_for_ever(world, make_instance) -> None:
    # At .5 m/s on 1 > 3 it takes 400 s on and, it seems, 249 s back; and at 0 the way above seems best again.
    params = world(jnp.ones((8, 2)).at[1].set(0.5))
    assert walks(params, make_instance([0]), GreedyLocal()) == ((0, 1, 0, 1, 0), 3000, False)
    assert walks(params, make_instance([0]), GreedyMap()) == ((0, 2, 3), 400, True)


def test_map_knows_no_jam_that_is_unusual_before_it_stands_there(world, make_instance) -> None:
    # 1 > 3 is jammed today at .1 m/s, but usually free. At 1 it takes 2,000 s on, and back by 0 and 2 500 s. Back at 0
    # the usual way is above again: only who sees all counts stays away.
    params = world(jnp.ones((8, 2)).at[1].set(0.1), jnp.ones((8, 2)))
    # At 1, 0 > 1 > 3 is 300 s in the usual crowds, so 100 + 300 s back beat 2,000 s on: to and fro.
    assert walks(params, make_instance([0]), GreedyMap()) == ((0, 1, 0, 1, 0), 3000, False)
    for planner in (Snapshot(), Forecast()):
        assert walks(params, make_instance([0]), planner) == ((0, 2, 3), 400, True)


def test_snapshot_follows_the_counts_and_forecast_foresees_that_a_jam_clears(world, make_instance) -> None:
    # 1 > 3 is jammed at .1 m/s till 150 s.
    params = world(jnp.ones((8, 2)).at[1, 0].set(0.1))
    # As it stands, above takes 2,100 s and below 400 s.
    assert walks(params, make_instance([0]), Snapshot()) == ((0, 2, 3), 400, True)
    # Node 1 at 100 s, 5 m in the jam, 195 m at 1 m/s: 345 s.
    for planner in (Forecast(), Clairvoyant()):
        assert walks(params, make_instance([0]), planner) == ((0, 1, 3), 345, True)
    # Who knows the usual crowds goes above too, but believes the jam when standing before it at 100 s: 2,000 s on, and
    # 100 + 300 s back and again. Of that it is free at 300 s.
    assert walks(params, make_instance([0]), GreedyMap()) == ((0, 1, 0, 1, 3), 500, True)
    # When it has cleared, all go above.
    for planner in REACTIVE:
        assert walks(params, make_instance([0], departure=150.0), planner) == ((0, 1, 3), 300, True)


def test_snapshot_does_not_see_a_jam_coming(world, make_instance) -> None:
    # 1 > 3 is free till 150 s and then jammed at .1 m/s.
    params = world(jnp.ones((8, 2)).at[1, 1].set(0.1))
    # Node 1 at 100 s, where it is still free: 50 m, and 150 m at .1 m/s.
    assert walks(params, make_instance([0]), Snapshot()) == ((0, 1, 3), 1650, True)
    assert walks(params, make_instance([0]), Forecast()) == ((0, 2, 3), 400, True)


def test_all_are_planners() -> None:
    assert all(isinstance(planner, Planner) for planner in REACTIVE)
    assert [(planner.name, planner.level, planner.observes) for planner in REACTIVE] == [
        ("greedy-local", "local", "local"),
        ("greedy-map", "map", "map"),
        ("snapshot", "live", "live"),
        ("forecast", "live", "live"),
    ]


def test_observations_that_lack_the_estimate_are_refused(diamond, constant_field, make_params, make_instance) -> None:
    params = make_params(diamond, constant_field(diamond))
    blind, not_live = GreedyLocal(), Snapshot()
    blind.observes = "position"
    not_live.observes = "local"
    for planner, level in ((blind, "local"), (not_live, "live")):
        with pytest.raises(ValueError, match=f"observe level {level}"):
            walk_plan(planner, params, planner.plan(params, make_instance([0])), make_instance([0]), KEY)


@pytest.fixture(scope="module")
def small() -> tuple[EnvParams, Instance]:
    """Walks of level live on a small map, to two destinations."""
    problem = scenario("rush-16", side=4, crowded_nodes=1, horizon=2 * 3600.0)
    scenario_map = draw_map(problem, 3)
    to = np.array([[15], [5]])
    params = make_environment(problem, scenario_map, "test", 8, level="live", destinations=to)
    return params, instances(problem, scenario_map, params, 20, destinations=to)


def test_none_beats_the_clairvoyant(small) -> None:
    params, todo = small
    bound, *found = (
        walk_plan(planner, params, planner.plan(params, todo), todo, KEY) for planner in (Clairvoyant(), *REACTIVE)
    )
    least = np.asarray(bound.seconds)
    assert bound.arrived.all()
    for planner, walked in zip(REACTIVE, found, strict=True):
        seconds = np.asarray(walked.seconds)
        assert (seconds >= least * (1 - 1e-5)).all()
        # Planners that know the map come near the bound.
        assert planner.level == "local" or seconds.mean() < 1.05 * least.mean()


def blind(problem: Scenario, scenario_map: ScenarioMap, *, costs: bool) -> EnvParams:
    """The same where no counts are seen yet."""
    return make_environment(
        problem, scenario_map, "test", 8, level="map", costs=costs, densities=True, destinations=[[15], [5]]
    )


def test_costs_of_one_slot_are_those_of_all_slots(small) -> None:
    problem = scenario("rush-16", side=4, crowded_nodes=1, horizon=2 * 3600.0)
    scenario_map = draw_map(problem, 3)
    every, wanted = small[0].futures.cost_to_go, np.arange(8) % 3 > 0
    for forecasts in (True, False):
        params = blind(problem, scenario_map, costs=forecasts)
        seen = see_counts(problem, scenario_map.flow, params, forecasts=forecasts)(3, wanted).futures.cost_to_go
        np.testing.assert_allclose(seen.snapshot[wanted, 0], np.asarray(every.snapshot)[wanted, 3], rtol=1e-6)
        if forecasts:
            np.testing.assert_allclose(seen.forecast[wanted, 0], np.asarray(every.forecast)[wanted, 3], rtol=1e-5)
        else:
            assert seen.forecast is None
        assert not np.asarray(seen.snapshot)[~wanted].any()  # nobody is there


@pytest.mark.parametrize("planner", [Snapshot(), Forecast()], ids=lambda planner: planner.name)
def test_walks_that_see_slot_by_slot_are_those_that_see_all(small, planner) -> None:
    params, todo = small
    problem = scenario("rush-16", side=4, crowded_nodes=1, horizon=2 * 3600.0)
    scenario_map = draw_map(problem, 3)
    todo = replace(todo, departure=todo.departure + 400.0 * jnp.arange(20))  # in several slots
    unseen, slots = blind(problem, scenario_map, costs=True), []
    seen = see_counts(problem, scenario_map.flow, unseen)

    def see(slot: int, wanted: np.ndarray) -> EnvParams:
        slots.append(slot)
        return seen(slot, wanted)

    plan = planner.plan(params, todo)
    all_at_once = walk_plan(planner, params, plan, todo, KEY, 30)
    by_slots = walk_plan(planner, unseen, plan, todo, KEY, 30, see=see)
    assert len(slots) > 3
    assert slots == sorted(set(slots))
    np.testing.assert_array_equal(by_slots.segments, all_at_once.segments)
    np.testing.assert_allclose(by_slots.seconds, all_at_once.seconds, rtol=1e-6)
    np.testing.assert_allclose(by_slots.clocks, all_at_once.clocks, rtol=1e-6)


def test_costs_that_were_left_out_are_missed(small) -> None:
    problem = scenario("rush-16", side=4, crowded_nodes=1, horizon=2 * 3600.0)
    params = make_environment(problem, draw_map(problem, 3), "test", 2, level="map", costs=False, destinations=[[15]])
    todo = jax.tree.map(lambda leaf: leaf[:1], small[1])
    with pytest.raises(KnowledgeError) as caught:
        walk_plan(GreedyMap(), params, GreedyMap().plan(params, todo), todo, KEY)
    assert caught.value.field == "level"


def test_walks_that_a_level_knows_nothing_about_are_refused(small) -> None:
    params, todo = small

    def walk(params: EnvParams, todo: Instance) -> None:
        walk_plan(Forecast(), params, Forecast().plan(params, todo), todo, KEY)

    assert np.asarray(todo.destination).tolist() == [15, 5] * 10
    walk(params, todo)
    with pytest.raises(ValueError, match="node 6"):
        walk(params, replace(todo, destination=jnp.full(20, 6, jnp.int32)))
    with pytest.raises(ValueError):  # a future that is for the other destination
        walk(params, replace(todo, future=(todo.future + 1) % params.futures.count))
    with pytest.raises(ValueError, match="live"):
        walk(replace(params, futures=replace(params.futures, cost_to_go=None)), todo)
