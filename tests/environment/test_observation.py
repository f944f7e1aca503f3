"""What each level of knowledge sees on the diamond, by hand, and that each sees what the one before it sees."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.base import SensedField
from sidestep.crowds.interpolation import InterpolationWeights, interpolation_weights
from sidestep.environment.cost_to_go import Ahead, check_known, expected_cost_to_go, live_cost_to_go
from sidestep.environment.dynamics import reset, step
from sidestep.environment.observation import EMPTY, observe
from sidestep.environment.rollout import Walk, walk
from sidestep.environment.types import (
    DENSITY_SCALE,
    LEVELS,
    RECENT_NODES,
    EnvParams,
    EnvState,
    Instance,
    LiveCostToGo,
    Observation,
    futures_in_turn,
)
from sidestep.network.graph import RoadNetwork, road_network
from sidestep.network.grid import grid_network
from sidestep.planners.shortest_path import distances_to
from sidestep.walking.speed_field import SensedSpeeds, SpeedField, speed_field
from sidestep.walking.speed_laws import FREE_SPEED, Weidmann

CLOSE = dict(rtol=1e-5, atol=0.02)  # s; twice what counts as settled
SLOT = 300.0
# Each is one program for an environment's shapes, not a small one for every operation.
begin, take, look = jax.jit(reset), jax.jit(step), jax.jit(observe)


def only(nodes: int, *which: int) -> jax.Array:
    """One destination a row."""
    return jnp.arange(nodes) == jnp.array(which)[:, None]


@jax.jit
def with_map(params: EnvParams, destinations: jax.Array) -> EnvParams:
    """With the expected costs of getting to some destinations."""
    scaled = params.expected.scaled(DENSITY_SCALE) if params.expected.interpolated else None
    costs = expected_cost_to_go(params, destinations, jnp.zeros(len(destinations)), scaled)
    return replace(params, level="map", cost_to_go=costs)


@partial(jax.jit, static_argnums=1)
def with_counts(params: EnvParams, ahead: Ahead, counted: jax.Array) -> EnvParams:
    """With what is forecast from counts."""
    costs = live_cost_to_go(params, counted, ahead)
    return replace(params, level="live", futures=replace(params.futures, cost_to_go=costs))


@partial(jax.jit, static_argnums=1)
def known(params: EnvParams, destinations: tuple[int, ...]) -> EnvParams:
    """With all that can be known: counts stay as they are for three slots, then crowds are as expected.

    Only forecasts look at volumes, so speeds stand for them.
    """
    volume = jnp.swapaxes(params.futures.speeds.speed, 1, 2)
    return with_counts(
        with_map(params, only(params.network.nodes, *destinations)),
        lambda now, *_: speed_field(jnp.tile(now[:, None], 3), SLOT),
        volume,
    )


def jammed() -> SpeedField:
    """On the diamond: 1 m/s, but .1 m/s on 1 > 3 till 300 s and on 2 > 3 from then on.

    Seconds to node 3, as worked out in test_cost_to_go.py, at 0 s: 480, 470, 250, 0; at 300 s: 300, 200, 450, 0.
    """
    return speed_field(jnp.ones((8, 2)).at[1, 0].set(0.1).at[3, 1].set(0.1), SLOT)


@pytest.fixture(scope="module")
def informed(diamond, make_params) -> EnvParams:
    """The jams are expected. Crowd 0 is as expected; crowd 1 walks at .5 m/s, then at .8; crowd 2 at 1 m/s."""
    steady = jnp.stack([jnp.full((8, 2), 0.5).at[:, 1].set(0.8), jnp.ones((8, 2))])
    futures = speed_field(jnp.concatenate([jammed().speed[None], steady]), SLOT)
    return known(make_params(diamond, futures, jammed()), (3,))


def see(
    params: EnvParams, node: int, clock: float, future: int = 0, destination: int = 3, level: str | None = None
) -> Observation:
    instance = Instance(*map(jnp.int32, (node, destination)), jnp.float32(clock), jnp.int32(future))
    return begin(params if level is None else replace(params, level=level), instance)[1]


# --- Position -------------------------------------------------------------------------------------------------------


def test_position_sees_nothing_else(informed) -> None:
    seen = see(informed, 1, 0.0, level="position")
    assert (int(seen.node), seen.position.tolist(), seen.valid.tolist()) == (1, [100, 100], [True, True])
    assert len(jax.tree.leaves(seen)) == 4
    assert (seen.local, seen.expected, seen.live, seen.estimate) == (None, None, None, None)


# --- Local ----------------------------------------------------------------------------------------------------------


def test_local_sees_the_streets_that_leave(informed) -> None:
    seen = see(informed, 0, 310.0, future=1, level="local")
    assert float(seen.local.clock) == 310
    # node 3 lies 200 m to the right; from the nodes 1 and 2 it is 100 m to the right, and down or up
    assert seen.local.ahead.tolist() == [200, 0]
    assert seen.local.onto.tolist() == [1, 2]
    assert seen.local.onward.tolist() == [[100, -100], [100, 100]]
    assert seen.local.length.tolist() == [100, 150]
    # at .8 m/s from 300 s on: 125 and 187.5 s
    assert seen.local.crossing.tolist() == pytest.approx([125, 187.5])
    # and then sqrt(2) 100 m at 1.34 m/s: 105.5383 s
    assert seen.estimate.tolist() == pytest.approx([230.5383, 293.0383])
    assert (seen.expected, seen.live) == (None, None)


@pytest.mark.parametrize(
    ("clock", "seconds"),
    [(0.0, 200.0), (299.9, 200.0), (300.0, 125.0), (1e5, 125.0)],  # the last slot lasts
)
def test_the_speed_seen_is_that_of_the_slot(informed, clock: float, seconds: float) -> None:
    # Whoever enters at 299.9 s will mostly walk at .8 m/s, but sees .5 m/s.
    assert float(see(informed, 0, clock, future=1, level="local").local.crossing[0]) == pytest.approx(seconds)


def test_before_the_destination_nothing_is_left_to_go(informed) -> None:
    # 200 m at .5 m/s to the destination; back to node 0 200 s and 200 m at 1.34 m/s
    seen = see(informed, 1, 0.0, future=1, level="local")
    assert seen.estimate.tolist() == pytest.approx([400, 200 + 200 / FREE_SPEED])


def walked(params: EnvParams, *actions: int) -> EnvState:
    state, _ = begin(params, Instance(*map(jnp.int32, (0, 3)), jnp.float32(0), jnp.int32(2)))
    for action in actions:
        state, _ = take(params, state, jnp.int32(action))
    return state


def test_crossings_since_a_next_node_was_left(informed) -> None:
    params, never = replace(informed, level="local"), RECENT_NODES + 1
    for actions, node, left in [
        ([], 0, [never, never]),
        ([0], 1, [never, 1]),  # 0 > 1: exits to 3 and back
        ([0, 0], 3, [1, never]),  # 0 > 1 > 3: exits to 1 and 2
        ([0, 0, 1], 2, [1, 3]),  # 0 > 1 > 3 > 2: to 3 and to 0, which was left first
        ([0, 1, 1], 2, [never, 1]),  # 0 > 1 > 0 > 2: 0 was left twice, and the later time counts
        ([1, 1], 0, [never, 1]),  # 0 > 2 > 0
        ([1, 1, 0, 1], 0, [1, 3]),  # and then 1 and back
    ]:
        state = walked(params, *actions)
        assert (int(state.node), look(params, state).local.steps_since_visit.tolist()) == (node, left)


def test_what_was_left_long_ago_is_forgotten(informed) -> None:
    params = replace(informed, level="local")
    # Node 2 is left on the second step; then to and fro between 0 and 1, two steps a time.
    state, found = walked(params, 1, 1), []
    for _ in range(6):
        found.append(look(params, state).local.steps_since_visit.tolist()[1])
        for action in (0, 1):
            state, _ = take(params, state, jnp.int32(action))
    assert found == [1, 3, 5, 7, RECENT_NODES + 1, RECENT_NODES + 1]


# --- Map ------------------------------------------------------------------------------------------------------------


def test_map_knows_the_expected_time_from_when_the_next_node_is_reached(informed) -> None:
    # Crowd 2 at 1 m/s: node 1 at 100 s, 470 - 270 / 3 = 380 s to go; node 2 at 150 s, half-way from 250 to 450 s.
    seen = see(informed, 0, 0.0, future=2, level="map")
    np.testing.assert_allclose(seen.expected.to_go, [380, 350], **CLOSE)
    np.testing.assert_allclose(seen.estimate, [480, 500], **CLOSE)
    # Crowd 1 at .5 m/s: node 1 at 200 s, 470 - 2/3 * 270 = 290 s to go; node 2 at 300 s, 450 s to go.
    seen = see(informed, 0, 0.0, future=1, level="map")
    np.testing.assert_allclose(seen.expected.to_go, [290, 450], **CLOSE)
    np.testing.assert_allclose(seen.estimate, [490, 750], **CLOSE)
    # In the last slot and after it nothing changes any more.
    seen = see(informed, 0, 600.0, future=2, level="map")
    np.testing.assert_allclose(seen.estimate, [300, 600], **CLOSE)


def test_map_knows_the_expected_crowd_of_now(informed) -> None:
    # From node 1 to 3 and to 0, 200 and 100 m; a jam is expected on the first till 300 s. Nobody is jammed in future 2.
    for clock, expected in ((0.0, [2000, 100]), (300.0, [200, 100])):
        seen = see(informed, 1, clock, future=2, level="map")
        assert seen.expected.cost.tolist() == pytest.approx(expected)
        assert seen.local.crossing.tolist() == pytest.approx([200, 100])


def test_every_destination_has_a_table_of_its_own(diamond, make_params) -> None:
    params = known(make_params(diamond, speed_field(jnp.ones((3, 8, 2)), SLOT), hours=(0.0, 0.0)), (3, 0))
    assert params.cost_to_go.table.shape == (2, 2, 4)
    assert params.cost_to_go.destination.tolist() == [1, -1, -1, 0]
    np.testing.assert_allclose(params.cost_to_go.table[:, 0], [[300, 200, 250, 0], [0, 100, 150, 300]], **CLOSE)
    # From node 1: on to node 3 and back to node 0.
    np.testing.assert_allclose(see(params, 1, 0.0, destination=3, level="map").expected.to_go, [0, 300], **CLOSE)
    np.testing.assert_allclose(see(params, 1, 0.0, destination=0, level="map").expected.to_go, [300, 0], **CLOSE)


def test_a_destination_may_be_several_nodes(diamond, constant_field, make_params) -> None:
    # One destination of the nodes 1 and 2, as on maps side by side.
    costs = with_map(make_params(diamond, constant_field(diamond)), only(4, 1) | only(4, 2)).cost_to_go
    assert costs.destination.tolist() == [-1, 0, 0, -1]
    np.testing.assert_allclose(costs.table, [[[100, 0, 0, 200]] * 2], **CLOSE)


# --- Live -----------------------------------------------------------------------------------------------------------


def test_snapshot_is_the_shortest_path_as_it_stands(informed) -> None:
    # Crowd 0 till 300 s: 1 > 3 takes 2,000 s, so from node 1 it is back and below, 500 s; from node 2 250 s.
    # Afterwards: from node 1 200 s; from node 2 back and above, 150 + 300 s.
    for clock, snapshot in ((0.0, [600, 400]), (299.0, [600, 400]), (300.0, [300, 600])):
        np.testing.assert_allclose(see(informed, 0, clock).live.snapshot, snapshot, **CLOSE)
    # Crowd 1: 100 + 200 m and 150 + 250 m at .5 m/s, then at .8 m/s
    np.testing.assert_allclose(see(informed, 0, 0.0, future=1).live.snapshot, [600, 800], **CLOSE)
    np.testing.assert_allclose(see(informed, 0, 300.0, future=1).live.snapshot, [375, 500], **CLOSE)


def test_forecast_of_a_jam_that_is_seen_to_clear(diamond, make_params) -> None:
    # Whatever is counted, what is forecast is what comes; beyond the window it stays so.
    field = jammed()
    params = make_params(diamond, field)

    def ahead(_now: jax.Array, _hour: jax.Array, slot: jax.Array) -> SpeedField:
        return speed_field(field.speed[:, jnp.minimum(slot + jnp.arange(3), 1)], SLOT)

    params = with_counts(with_map(params, only(4, 3)), ahead, jnp.ones((1, 2, 8)))
    # Entered at 0 s: by 1 100 + 380, by 2 150 + 350; at 300 s: 100 + 200, 150 + 450; in between linear.
    for clock, forecast in ((0.0, [480, 500]), (150.0, [390, 550]), (300.0, [300, 600]), (1e4, [300, 600])):
        seen = see(params, 0, clock)
        np.testing.assert_allclose(seen.live.forecast, forecast, **CLOSE)
        np.testing.assert_array_equal(seen.estimate, seen.live.forecast)
    # From node 1: 470 s by 3 at 0 s, 200 s at 300 s; back: node 0 at 100 s, 480 - 180 / 3 = 420 s, then 300 s.
    np.testing.assert_allclose(see(params, 1, 0.0).live.forecast, [470, 520], **CLOSE)


def test_after_the_window_of_a_forecast_crowds_are_as_expected(make_params) -> None:
    # 0 > 1 > 2, 100 m each, in slots of 100 s: .5 m/s now and for two slots, 1 m/s expected.
    network = road_network(np.zeros((3, 2)), [0, 1], [1, 2], [100.0, 100])
    params = make_params(network, *(speed_field(jnp.full((2, 8), speed), 100.0) for speed in (0.5, 1.0)))
    params = with_map(params, only(3, 2))

    @partial(jax.jit, static_argnums=0)
    def foreseen(slots: int) -> LiveCostToGo:
        stays = lambda now, *_: speed_field(jnp.tile(now[:, None], slots), 100.0)  # noqa: E731
        return live_cost_to_go(params, jnp.swapaxes(params.futures.speeds.speed, 1, 2), stays)

    live = foreseen(2)
    # 200 s to node 1, when the window is over, and 100 s on. From node 1 200 s: who enters the jam stays in it.
    np.testing.assert_allclose(live.forecast[0, 0], [[300, 200], [300, 200]], **CLOSE)
    # With a third slot of it, node 1 is reached with one slot to go, in which 50 m are covered: as slots begin it is
    # 200 s from node 1, and after the last of them 100 s; entered at 100 s, node 1 is reached after the window.
    live = foreseen(3)
    np.testing.assert_allclose(live.forecast[0, 0], [[400, 200], [300, 200]], **CLOSE)


def test_a_forecast_of_what_stays_is_exact(make_params) -> None:
    rng = np.random.default_rng(2)
    network = grid_network(3, rng)
    speed = rng.uniform(0.2, 1.3, (network.segments, 1)).astype(np.float32)
    params = known(make_params(network, speed_field(jnp.tile(speed, 4), SLOT)), (8,))
    seconds = np.asarray(network.length, float) / speed[:, 0]
    over = seconds + distances_to(network, seconds, 8)[np.asarray(network.head)]
    for node, clock in [(0, 0.0), (1, 100.0), (4, 600.0), (5, 1e4)]:
        seen = see(params, node, clock)
        exits = np.asarray(network.exit_segment)[node][np.asarray(seen.valid)]
        for found in (seen.live.forecast, seen.live.snapshot, seen.local.cost + seen.expected.to_go):
            np.testing.assert_allclose(np.asarray(found)[np.asarray(seen.valid)], over[exits], rtol=1e-5, atol=0.1)


def test_futures_are_for_the_destinations_in_turn(diamond, make_params) -> None:
    speed = jnp.array([1.0, 0.5, 0.25])[:, None, None] * jnp.ones((8, 2))
    fields = speed_field(speed, SLOT), speed_field(speed[0], SLOT)
    params = known(make_params(diamond, *fields, hours=(7.0, 30.0)), (3, 0))
    assert params.futures.destination.tolist() == [0, 1, 0]
    assert params.futures.hour.tolist() == [7, 30, 7]
    live = params.futures.cost_to_go
    assert live.forecast.shape == (3, 2, 2, 8)
    assert live.snapshot.shape == (3, 2, 4)
    # Futures 0 and 2 are for node 3, future 1 for node 0.
    expected = [[300, 200, 250, 0], [0, 200, 300, 600], [1200, 800, 1000, 0]]
    np.testing.assert_allclose(live.snapshot[:, 0], expected, **CLOSE)
    # segment 1 is 1 > 3 and segment 4 is 1 > 0
    np.testing.assert_allclose(live.forecast[0, 0, 0, [1, 4]], [200, 400], **CLOSE)
    np.testing.assert_allclose(live.forecast[1, 0, 0, 4], 200, **CLOSE)


# --- All levels -----------------------------------------------------------------------------------------------------


def same(one: object, other: object) -> None:
    for first, second in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(("node", "clock", "future"), [(0, 0.0, 0), (1, 333.0, 1), (2, 150.0, 2), (3, 1e5, 0)])
def test_each_level_sees_what_the_one_before_it_sees(informed, node: int, clock: float, future: int) -> None:
    assert LEVELS == ("position", "local", "map", "live")
    position, local, of_map, live = (see(informed, node, clock, future, level=level) for level in LEVELS)
    same(position, replace(local, local=None, estimate=None))
    same(replace(local, estimate=None), replace(of_map, expected=None, estimate=None))
    same(replace(of_map, estimate=None), replace(live, live=None, estimate=None))
    assert live.live is not None


def test_the_level_is_the_environments(informed) -> None:
    for level in LEVELS:
        params = replace(informed, level=level)
        state, seen = begin(params, Instance(*map(jnp.int32, (0, 3)), jnp.float32(7), jnp.int32(1)))
        same(seen, see(informed, 0, 7.0, 1, level=level))
        state, outcome = take(params, state, jnp.int32(0))
        same(outcome.observation, look(params, state))


@pytest.mark.parametrize("level", ["map", "live"])
def test_missing_knowledge_is_said(diamond, constant_field, make_params, level: str) -> None:
    params = replace(make_params(diamond, constant_field(diamond)), level=level)
    with pytest.raises(ValueError, match="made for a level below map"):
        see(params, 0, 0.0)


def test_missing_counts_are_said(informed) -> None:
    without = replace(informed, futures=replace(informed.futures, cost_to_go=None))
    with pytest.raises(ValueError, match="made for a level below live"):
        see(without, 0, 0.0)
    with pytest.raises(ValueError, match="made for a level below live"):
        check_known(without, walks([3]))


def walks(destinations: list[int], future: int = 0) -> Instance:
    """From node 1."""
    many = len(destinations)
    return Instance(jnp.full(many, 1), jnp.array(destinations), jnp.zeros(many), jnp.full(many, future))


def test_walks_that_nothing_is_known_about_are_refused(informed, diamond, make_params) -> None:
    check_known(informed, walks([3, 3]))
    with pytest.raises(ValueError, match="getting to node 2"):
        check_known(informed, walks([3, 2]))
    check_known(replace(informed, level="local"), walks([2]))
    two = make_params(diamond, speed_field(jnp.ones((3, 8, 2)), SLOT), hours=(0.0, 0.0))
    for params in (known(two, (3, 0)), replace(with_map(two, only(4, 3, 0)), expected=two.futures.speeds)):
        check_known(params, walks([0, 0], future=1))
        with pytest.raises(ValueError, match="walk 1 meets future 1, which is for another destination"):
            check_known(params, walks([0, 3], future=1))
    # Where hours do not matter, any future does at level map.
    check_known(with_map(two, only(4, 3, 0)), walks([0, 3], future=1))


def test_walkers_see_side_by_side_what_they_see_alone(informed) -> None:
    node, clock = jnp.array([0, 1, 2, 3]), jnp.array([0.0, 150, 333, 700])
    instance = Instance(node, jnp.full(4, 3), clock, jnp.array([0, 1, 2, 0]))
    _, together = jax.jit(jax.vmap(lambda one: reset(informed, one)))(instance)
    for walker in range(4):
        alone = see(informed, walker, float(clock[walker]), int(instance.future[walker]))
        for one, several in zip(jax.tree.leaves(alone), jax.tree.leaves(together), strict=True):
            np.testing.assert_allclose(several[walker], one, rtol=1e-5)


def test_the_network_may_have_nodes_out_of_reach(make_params) -> None:
    # 0 > 1 > 0 and 2 > 0: nobody gets to 2
    network: RoadNetwork = road_network(np.eye(3, 2), [0, 1, 2], [1, 0, 0], [10.0] * 3)
    params = known(make_params(network, speed_field(jnp.ones((3, 2)), 60.0)), (2,))
    seen = see(params, 0, 0.0, destination=2)
    assert (np.asarray([seen.expected.to_go[0], seen.live.snapshot[0], seen.live.forecast[0]]) > 0.99e9).all()


# --- Level map where crowds are interpolated ------------------------------------------------------------------------

END = 15


def sensed(density: np.ndarray, weights: InterpolationWeights) -> SensedSpeeds:
    return SensedSpeeds(SensedField(jnp.asarray(density, jnp.float32), weights, SLOT), Weidmann())


@pytest.fixture(scope="module")
def town() -> EnvParams:
    """4 x 4 nodes and three counters. Future 0 is as expected, always the same; 1 thrice, 2 half as dense."""
    network = grid_network(4, np.random.default_rng(2))
    spread = interpolation_weights(network, np.array([3, 20, 40]), 400.0)
    usual = np.tile([0.4, 2.0, 1.2], (1, 3, 1))
    futures, expected = sensed(usual * np.array([1, 3, 0.5])[:, None, None], spread), sensed(usual, spread)
    params = EnvParams(network, futures_in_turn(futures, jnp.zeros(1)), expected, jnp.float32(1e5))
    return with_map(params, only(16, END))


def to_the_end(future: int) -> Instance:
    """From everywhere else to the last node."""
    each = jnp.arange(15, dtype=jnp.int32)
    return Instance(each, jnp.full(15, END, jnp.int32), jnp.full(15, 70.0), jnp.full(15, future, jnp.int32))


@jax.jit
def see_all(params: EnvParams, instances: Instance) -> Observation:
    recent_nodes = jnp.full(8, -1)
    return jax.vmap(lambda one: observe(params, EnvState(one.origin, one.departure, one, recent_nodes, jnp.int32(0))))(
        instances
    )


@jax.jit
def walk_all(params: EnvParams, instances: Instance) -> Walk:
    def decide(seen: Observation, _key: jax.Array) -> jax.Array:
        return jnp.argmin(jnp.where(seen.valid, seen.estimate, jnp.inf))

    return jax.vmap(lambda one: walk(params, decide, one, jax.random.key(0)))(instances)


def test_crowds_as_expected_have_a_ratio_of_one(town) -> None:
    seen = see_all(town, to_the_end(0))
    valid = np.asarray(seen.valid)
    np.testing.assert_allclose(np.asarray(seen.expected.log_density_ratio)[valid], 0, atol=1e-6)
    np.testing.assert_allclose(seen.expected.cost, seen.local.crossing, rtol=1e-6)


def test_the_density_ratio_is_a_logarithm(town) -> None:
    segment = np.asarray(town.network.exit_segment)[:15]
    usual = np.asarray(town.expected.crowds.weights.everywhere(jnp.array([0.4, 2.0, 1.2])))[segment]
    for future, times in ((1, 3), (2, 0.5)):
        seen = see_all(town, to_the_end(future))
        valid = np.asarray(seen.valid)
        by_hand = np.log((times * usual + EMPTY) / (usual + EMPTY))
        np.testing.assert_allclose(
            np.asarray(seen.expected.log_density_ratio)[valid], by_hand[valid], rtol=1e-4, atol=1e-5
        )
        assert (np.sign(by_hand[valid]) == np.sign(times - 1)).all()


def test_denser_crowds_take_longer(town) -> None:
    seen = see_all(town, to_the_end(0))
    valid = np.asarray(seen.valid)
    cost_to_go_scaled = np.asarray(seen.expected.cost_to_go_scaled)
    assert (cost_to_go_scaled[valid] >= -0.02).all()
    assert cost_to_go_scaled[valid].max() > 10
    # It is what it takes if the expected crowds are DENSITY_SCALE times as dense.
    dense = replace(town, expected=town.expected.scaled(DENSITY_SCALE))
    other = with_map(dense, only(16, END)).cost_to_go.table[0, 0]
    onto = np.asarray(town.network.exit_node)[:15]
    np.testing.assert_allclose(
        cost_to_go_scaled[valid], (np.asarray(other - town.cost_to_go.table[0, 0])[onto])[valid], atol=0.1
    )


def test_who_meets_what_is_expected_takes_the_expected_time(town) -> None:
    done = walk_all(town, to_the_end(0))
    assert np.asarray(done.arrived).all()
    np.testing.assert_allclose(done.seconds, town.cost_to_go.table[0, 0, :15], rtol=1e-4, atol=0.1)
    # The best estimate at the origin is that time as well.
    seen = see_all(town, to_the_end(0))
    best = np.where(np.asarray(seen.valid), np.asarray(seen.estimate), np.inf).min(axis=1)
    np.testing.assert_allclose(best, done.seconds, rtol=1e-4, atol=0.1)


@pytest.mark.parametrize("future", [1, 2])
def test_nobody_walks_to_and_fro_whatever_the_crowd(town, future: int) -> None:
    # The way through the expected crowds, crossing by crossing, however long it then takes.
    usual, done = walk_all(town, to_the_end(0)), walk_all(town, to_the_end(future))
    assert np.asarray(done.arrived).all()
    np.testing.assert_array_equal(done.steps, usual.steps)
    assert (np.asarray(done.seconds > usual.seconds) == (future == 1)).all()


def test_each_destination_is_expected_at_its_own_hour(town) -> None:
    # At two hours other densities are expected; each future meets what is expected at the hour of its destination.
    usual = np.tile([0.4, 2.0, 1.2], (2, 3, 1)) * np.array([1, 2])[:, None, None]
    spread = town.expected.crowds.weights
    futures = futures_in_turn(sensed(usual[[0, 1, 0]], spread), jnp.zeros(2))
    both = replace(town, expected=sensed(usual, spread), futures=futures)
    for future in range(3):
        seen = see_all(both, to_the_end(future))
        np.testing.assert_allclose(np.asarray(seen.expected.log_density_ratio)[np.asarray(seen.valid)], 0, atol=1e-6)
