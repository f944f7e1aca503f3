"""Times to go beside Dijkstra's where nothing changes, beside the exact search where it does, and jams by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sidestep.environment.cost_to_go import (
    UNREACHABLE,
    at_clock,
    cost_to_go,
    field_cost_to_go,
    static_cost_from,
    static_cost_to_go,
)
from sidestep.environment.crossing import CrossStep, crossings
from sidestep.environment.types import EnvParams, futures_in_turn
from sidestep.network.graph import RoadNetwork, road_network
from sidestep.network.grid import grid_network
from sidestep.planners.shortest_path import distances_to
from sidestep.planners.time_dependent import earliest_arrivals, leaving
from sidestep.walking.crossing_time import CrossingRule
from sidestep.walking.objective import Crossing
from sidestep.walking.speed_field import SpeedField, speed_field

NODES, SEGMENTS, SLOTS, SLOT_SECONDS = 6, 14, 4, 100.0
CLOSE = 0.02  # s; twice what counts as settled


def ends(nodes: int, *which: int) -> jax.Array:
    return jnp.isin(jnp.arange(nodes), jnp.array(which))


def world(network: RoadNetwork, field: SpeedField, rule: CrossingRule = "integrated") -> EnvParams:
    """Where time is all that counts."""
    alone = jax.tree.map(lambda leaf: leaf[None], field)
    return EnvParams(network, futures_in_turn(alone, jnp.zeros(1)), alone, jnp.float32(1e5), rule=rule)


def to_go(
    network: RoadNetwork, field: SpeedField, destination: jax.Array, rule: CrossingRule = "integrated"
) -> jax.Array:
    params = world(network, field, rule)
    return field_cost_to_go(params, field, params.wait_in(jnp.int32(0)), destination)


def line(*metres: float) -> RoadNetwork:
    """0 > 1 > 2 and so on, one way."""
    nodes = len(metres) + 1
    return road_network(np.zeros((nodes, 2)), range(nodes - 1), range(1, nodes), metres)


# --- Speeds that stay -----------------------------------------------------------------------------------------------


def test_constant_speeds_on_the_diamond(diamond, constant_field) -> None:
    table = to_go(diamond, constant_field(diamond, 2.0), ends(4, 3))
    # metres to node 3 at 2 m/s: 300 from 0, 200 from 1, 250 from 2
    np.testing.assert_allclose(table, [[150, 100, 125, 0]] * 2, atol=CLOSE)
    # to node 1: 100 from 0, 250 from 2 by 0, 200 from 3
    table = to_go(diamond, constant_field(diamond, 2.0), ends(4, 1))
    np.testing.assert_allclose(table, [[50, 0, 125, 100]] * 2, atol=CLOSE)


def test_several_nodes_at_once(diamond, constant_field) -> None:
    # whichever is nearer: from node 0, node 1 in 100 s; from node 3, node 1 in 200 s and node 2 in 250 s
    table = to_go(diamond, constant_field(diamond), ends(4, 1, 2))
    np.testing.assert_allclose(table, [[100, 0, 0, 200]] * 2, atol=CLOSE)


def test_all_segments_as_they_are_now(diamond) -> None:
    # 1 > 3 takes 2,000 s: from node 1 it is faster back by 0 and 2, 100 + 150 + 250 s
    crossing = diamond.length.at[1].set(2000.0)
    assert static_cost_to_go(diamond, crossing, ends(4, 3)).tolist() == [400, 500, 250, 0]


# Parallel segments and unreachable nodes are among what these make.
tail_and_head = st.tuples(st.integers(0, NODES - 1), st.integers(0, NODES - 1)).filter(lambda pair: pair[0] != pair[1])
streets = st.lists(tail_and_head, min_size=SEGMENTS, max_size=SEGMENTS)
lengths = hnp.arrays(np.float32, SEGMENTS, elements=st.floats(1, 300, width=32))
steady = hnp.arrays(np.float32, SEGMENTS, elements=st.floats(1 / 8, 4, width=32))
any_exits = hnp.arrays(np.int32, NODES, elements=st.integers(0, SEGMENTS - 1))
destinations = st.sets(st.integers(0, NODES - 1), min_size=1, max_size=3)
both = jax.jit(
    lambda network, speed, destination: (
        to_go(network, speed_field(speed, SLOT_SECONDS), destination),
        static_cost_to_go(network, network.length / speed[:, 0], destination),
    )
)


either = jax.jit(
    lambda network, destination, exits: (
        static_cost_to_go(network, network.length, destination),
        *static_cost_from(network, network.length, destination, exits),
    )
)


@given(streets, lengths, destinations, any_exits)
def test_whatever_is_known_beforehand_costs_are_the_same_to_the_bit(
    pairs: list[tuple[int, int]], length: np.ndarray, destination: set[int], exits: np.ndarray
) -> None:
    network = road_network(np.zeros((NODES, 2)), *zip(*pairs, strict=True), length, exits=SEGMENTS)
    plain, found, best = map(np.asarray, either(network, ends(NODES, *destination), jnp.asarray(exits)))
    assert found.tobytes() == plain.tobytes()
    onto, segment = (np.asarray(each)[np.arange(NODES), best] for each in (network.exit_node, network.exit_segment))
    goes = (plain < UNREACHABLE) & ~np.isin(np.arange(NODES), list(destination))
    assert np.array_equal(plain[goes], (np.asarray(length)[segment] + plain[onto])[goes])


@given(streets, lengths, steady, destinations)
def test_constant_speeds_are_dijkstras(
    pairs: list[tuple[int, int]], length: np.ndarray, speed: np.ndarray, destination: set[int]
) -> None:
    network = road_network(np.zeros((NODES, 2)), *zip(*pairs, strict=True), length, exits=SEGMENTS)
    found = both(network, jnp.tile(jnp.asarray(speed)[:, None], SLOTS), ends(NODES, *destination))
    seconds = np.asarray(network.length, float) / speed
    exact = np.min([distances_to(network, seconds, one) for one in destination], axis=0)
    reached = np.isfinite(exact)
    for found_to_go in (*np.asarray(found[0]), np.asarray(found[1])):
        np.testing.assert_allclose(found_to_go[reached], exact[reached], rtol=1e-5, atol=CLOSE)
        assert (found_to_go[~reached] >= (1 - 1e-6) * UNREACHABLE).all()


# --- Speeds that change ---------------------------------------------------------------------------------------------


def test_a_jam_that_clears_and_one_that_comes(diamond) -> None:
    # 1 m/s, but .1 m/s on 1 > 3 till 300 s and on 2 > 3 from then on
    speed = jnp.ones((8, 2)).at[1, 0].set(0.1).at[3, 1].set(0.1)
    table = to_go(diamond, speed_field(speed, 300.0), ends(4, 3))
    # At 300 s: 200 s from node 1 and 300 s from node 0; from node 2 back and over the top, 150 + 300 s.
    # At 0 s: from node 1 30 m in the jam and 170 m after it, 470 s; from node 2 250 s, before the jam there.
    # From node 0: by 1, 100 s and then 470 - 1/3 * 270 = 380 s; by 2, 150 s and then 250 + 1/2 * 200 = 350 s.
    np.testing.assert_allclose(table, [[480, 470, 250, 0], [300, 200, 450, 0]], atol=CLOSE)


def test_crossings_shorter_than_a_slot_lead_back_into_it() -> None:
    network = line(30, 30, 30)
    speed = jnp.array([1.0, 2.0]) * jnp.ones((3, 1))
    table = to_go(network, speed_field(speed, 300.0), ends(4, 3))
    # From 300 s on 15 s a street. Before, 30 s a street are a tenth of the slot:
    # 30;  30 + .9 * 30 + .1 * 15 = 58.5;  30 + .9 * 58.5 + .1 * 30 = 85.65
    np.testing.assert_allclose(table, [[85.65, 58.5, 30, 0], [45, 30, 15, 0]], atol=CLOSE)


def taking(*seconds: float) -> CrossStep:
    """Segments that always take as long."""
    return lambda _slot: Crossing(jnp.array(seconds), jnp.array(seconds), {})


def test_what_comes_after_the_last_slot() -> None:
    network, destination, later = line(150, 150), ends(3, 2), jnp.array([1000.0, 500, 0])
    # From node 1 150 s. From node 0 half a slot, to between 150 s now and 500 s later: 150 + 325.
    found = cost_to_go(network, taking(150.0, 150.0), 1, 300.0, destination, later)
    np.testing.assert_allclose(found, [[475, 150, 0]], atol=CLOSE)
    # Two slots: after the last of them it is 500 s from node 1.
    found = cost_to_go(network, taking(600.0, 150.0), 1, 300.0, destination, later)
    np.testing.assert_allclose(found, [[1100, 150, 0]], atol=CLOSE)


@pytest.mark.parametrize(
    ("rule", "seconds"),
    [
        # 100 m: 20 m at 2 m/s till 10 s and 80 m at .5 m/s
        ("integrated", 170.0),
        # all at 2 m/s
        ("entry", 50.0),
    ],
)
def test_the_rule_is_heeded(rule: CrossingRule, seconds: float) -> None:
    network, field = line(100), speed_field(jnp.array([[2.0, 0.5]]), 10.0)
    params = world(network, field, rule)
    crossed = crossings(params, field, params.wait_in(jnp.int32(0)))
    np.testing.assert_allclose(crossed.seconds, [[seconds], [200]])
    np.testing.assert_allclose(crossed.cost, crossed.seconds)
    np.testing.assert_allclose(to_go(network, field, ends(2, 1), rule), [[seconds, 0], [200, 0]], atol=CLOSE)


@pytest.fixture(scope="module")
def rush() -> tuple[RoadNetwork, SpeedField]:
    """Six by six nodes, every street with a rush hour of its own within four hours; some streets are jammed."""
    rng = np.random.default_rng(3)
    network = grid_network(6, rng)
    wave = np.sin(2 * np.pi * np.arange(48) / 48 + rng.uniform(0, 2 * np.pi, (network.segments, 1)))
    density = rng.uniform(0.5, 10, (network.segments, 1)) * np.exp(rng.uniform(0.2, 0.8, (network.segments, 1)) * wave)
    speed = 1.34 * np.minimum(density**-0.8, 1)
    return network, speed_field(jnp.asarray(speed, jnp.float32), 300.0)


def test_changing_speeds_are_nearly_the_exact_searchs(rush) -> None:
    network, field = rush
    destination = network.nodes - 1
    # at beginnings of slots, and within slots
    node, slot = (
        jnp.asarray(each.ravel()) for each in np.meshgrid(np.arange(destination), [0, 7, 20, 33, 47, 12.4, 26.7])
    )
    clock = slot * 300.0
    one = jax.tree.map(lambda leaf: leaf[None], field)
    leave = leaving(network, one, jnp.int32(0), "integrated", lambda _segment, clock: jnp.zeros_like(clock))
    search = jax.jit(jax.vmap(lambda origin, at: earliest_arrivals(network, leave, origin, at)[0][destination]))
    exact = search(node, clock) - clock
    found = at_clock(to_go(network, field, ends(network.nodes, destination)), 300.0, clock, node)
    error = np.abs(np.asarray(found / exact) - 1)
    assert error.mean() < 0.005
    assert error.max() < 0.03
    # The crowds do matter: from the same node, times differ by more than that.
    assert np.ptp(np.asarray(exact).reshape(7, destination), axis=0).max() > 300


# --- Between the beginnings of slots --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("clock", "node", "seconds"),
    [
        (0, 0, 10),
        (50, 0, 15),  # half-way from 10 to 20
        (125, 1, 250),  # a quarter of the way from 200 to 400
        (100, 1, 200),
        (200, 0, 40),  # the last slot begins
        (250, 0, 40),  # and lasts
        (1e6, 1, 400),
        (-30, 1, 100),  # before the first slot as at its beginning
    ],
)
def test_between_slots_time_is_linear(clock: float, node: int, seconds: float) -> None:
    table = jnp.array([[10.0, 100], [20, 200], [40, 400]])
    assert at_clock(table, 100.0, jnp.array([clock], float), jnp.array([node])).tolist() == [pytest.approx(seconds)]
