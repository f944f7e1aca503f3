"""The time-dependent search beside Dijkstra's algorithm in double precision, and a jam by hand."""

import heapq
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sidestep.environment.types import EnvParams
from sidestep.network.graph import RoadNetwork, road_network
from sidestep.planners.base import routes, walk_plan
from sidestep.planners.time_dependent import Clairvoyant, Expected, earliest_arrivals, leaving
from sidestep.walking.crossing_time import CrossingRule
from sidestep.walking.speed_field import SpeedField, speed_field

NODES, SEGMENTS, SLOTS, SLOT_SECONDS = 6, 14, 4, 100.0


def crossing(speed: np.ndarray, metres: float, clock: float) -> float:
    """Seconds to cross while the speed changes from slot to slot; double precision, one slot after the other."""
    now, ahead = clock, metres
    while True:
        slot = min(int(now // SLOT_SECONDS), SLOTS - 1)
        left = math.inf if slot == SLOTS - 1 else (slot + 1) * SLOT_SECONDS - now
        if ahead <= speed[slot] * left:
            return now + ahead / speed[slot] - clock
        ahead -= speed[slot] * left
        now = (slot + 1) * SLOT_SECONDS


def dijkstra(network: RoadNetwork, speed: np.ndarray, origin: int, departure: float) -> np.ndarray:
    """Earliest arrivals: first in, first out lets settled nodes stay settled."""
    tail, head, length = (np.asarray(each).tolist() for each in (network.tail, network.head, network.length))
    arrival = np.full(network.nodes, np.inf)
    queue = [(departure, origin)]
    while queue:
        clock, node = heapq.heappop(queue)
        if clock >= arrival[node]:
            continue
        arrival[node] = clock
        for segment in range(len(tail)):
            if tail[segment] == node:
                there = clock + crossing(speed[segment], length[segment], clock)
                heapq.heappush(queue, (there, head[segment]))
    return arrival


# Parallel segments and unreachable nodes are among what these make.
ends = st.tuples(st.integers(0, NODES - 1), st.integers(0, NODES - 1)).filter(lambda pair: pair[0] != pair[1])
streets = st.lists(ends, min_size=SEGMENTS, max_size=SEGMENTS)
lengths = hnp.arrays(np.float32, SEGMENTS, elements=st.floats(10, 300, width=32))
speeds = hnp.arrays(np.float32, (SEGMENTS, SLOTS), elements=st.floats(1 / 16, 4, width=32))
# Compiled programs take the smallest numbers for zero.
departures = st.floats(0, 1.2 * SLOTS * SLOT_SECONDS, allow_subnormal=False, width=32)
nodes = st.integers(0, NODES - 1)
# Distances of up to 1,700 m and clocks of up to about 25,000 s, rounded to six decimals, and slow streets.
CLOSE = dict(rtol=1e-5, atol=0.05)


def build(pairs: list[tuple[int, int]], length: np.ndarray) -> RoadNetwork:
    return road_network(np.zeros((NODES, 2)), *zip(*pairs, strict=True), length, exits=SEGMENTS)


def arrivals(
    network: RoadNetwork, field: SpeedField, origin: jax.Array, departure: jax.Array, rule: CrossingRule = "integrated"
):
    """Through one crowd, without waits."""
    one = jax.tree.map(lambda leaf: leaf[None], field)
    leave = leaving(network, one, jnp.int32(0), rule, lambda _segment, clock: jnp.zeros_like(clock))
    return earliest_arrivals(network, leave, origin, departure)


@jax.jit
def search(network: RoadNetwork, speed: jax.Array, origin: jax.Array, departure: jax.Array):
    return arrivals(network, speed_field(speed, SLOT_SECONDS), origin, departure)


@given(streets, lengths, speeds, nodes, departures)
def test_earliest_arrivals_are_dijkstras(
    pairs: list[tuple[int, int]], length: np.ndarray, speed: np.ndarray, origin: int, departure: float
) -> None:
    network = build(pairs, length)
    found, via = search(network, jnp.asarray(speed), jnp.int32(origin), jnp.float32(departure))
    expected = dijkstra(network, speed, origin, departure)
    np.testing.assert_allclose(found, expected, **CLOSE)  # unreachable nodes are at infinity in both
    assert float(found[origin]) == departure
    # The segment over which a node is reached ends there and explains its arrival.
    tail, head = np.asarray(network.tail), np.asarray(network.head)
    for node, segment in enumerate(np.asarray(via).tolist()):
        if node == origin or math.isinf(expected[node]):
            assert segment == -1
        else:
            enter = float(expected[tail[segment]])
            assert head[segment] == node
            assert enter + crossing(speed[segment], length[segment], enter) == pytest.approx(
                expected[node], rel=CLOSE["rtol"], abs=2 * CLOSE["atol"]
            )


@given(streets, lengths, speeds, nodes, nodes, departures)
def test_walking_the_fastest_exits_takes_the_time_foretold(
    make_params,
    make_instance,
    pairs: list[tuple[int, int]],
    length: np.ndarray,
    speed: np.ndarray,
    origin: int,
    destination: int,
    departure: float,
) -> None:
    network = build(pairs, length)
    field = speed_field(jnp.asarray(speed), SLOT_SECONDS)
    params = make_params(network, field, horizon=1e6)
    todo = make_instance([origin], destination, departure)
    plan = Clairvoyant().plan(params, todo)
    allowed = np.asarray(plan.own)[0]
    arrival = float(search(network, field.speed, jnp.int32(origin), jnp.float32(departure))[0][destination])
    if math.isinf(arrival) or origin == destination:
        assert not allowed.any()
        return
    # one path, without alternatives, of existing exits
    assert (allowed.sum(axis=1) <= 1).all()
    assert (np.asarray(network.valid) | ~allowed).all()
    walked = walk_plan(Clairvoyant(), params, plan, todo, jax.random.key(0))
    assert bool(walked.arrived[0])
    assert int(walked.steps[0]) == allowed.sum()
    # The same crossings in the same precision, but compiled into another program.
    assert float(walked.seconds[0]) == pytest.approx(arrival - departure, rel=1e-5, abs=CLOSE["atol"])


@given(st.integers(0, 2**32 - 1), st.integers(3, 6))
@settings(max_examples=25)
def test_paths_of_many_segments_are_dijkstras(make_params, make_instance, seed: int, crossings_each: int) -> None:
    # So many nodes that the search goes on from a small part of them at a time, and must get the order right.
    rng = np.random.default_rng(seed)
    nodes = 60
    pairs = rng.integers(nodes, size=(6 * nodes, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]][: crossings_each * nodes // 2]
    # Those that are left over lead nowhere new: as many segments in every example, so that one program serves them all.
    pairs = np.concatenate([pairs, np.tile([[0, 1]], (3 * nodes - len(pairs), 1))])
    length = rng.uniform(10, 300, len(pairs))
    speed = rng.choice([0.0625, 0.5, 1.0, 4.0], (len(pairs), SLOTS)).astype(np.float32)
    network = road_network(np.zeros((nodes, 2)), *pairs.T, length, exits=3 * nodes)
    origin, departure = int(rng.integers(nodes)), float(np.float32(rng.uniform(0, SLOTS * SLOT_SECONDS)))
    expected = dijkstra(network, speed, origin, departure)
    found, _ = search(network, jnp.asarray(speed), jnp.int32(origin), jnp.float32(departure))
    np.testing.assert_allclose(found, expected, **CLOSE)
    # The search for one destination stops early, and the walk along its exits takes as long.
    params = make_params(network, speed_field(jnp.asarray(speed), SLOT_SECONDS), horizon=1e6)
    ends = rng.permutation(np.flatnonzero(np.isfinite(expected)))[:4]
    todo = make_instance([origin] * 4, np.resize(ends, 4).tolist(), departure)
    walked = walk_plan(Clairvoyant(), params, Clairvoyant().plan(params, todo), todo, jax.random.key(0))
    np.testing.assert_allclose(
        walked.seconds, expected[np.asarray(todo.destination)] - departure, rtol=CLOSE["rtol"], atol=2 * CLOSE["atol"]
    )


def test_unreachable_nodes() -> None:
    # 0 > 1 > 0, and 2 > 0: nobody gets to 2 or to 3
    network = road_network(np.zeros((4, 2)), [0, 1, 2], [1, 0, 0], [10.0, 10.0, 10.0])
    field = speed_field(jnp.ones((3, 1)), 60.0)
    arrival, via = arrivals(network, field, jnp.int32(0), jnp.float32(5))
    assert arrival.tolist() == [5, 15, math.inf, math.inf]
    assert via.tolist() == [-1, 0, -1, -1]


def test_arrivals_on_the_diamond(diamond, constant_field) -> None:
    arrival, via = arrivals(diamond, constant_field(diamond, 2.0), jnp.int32(0), jnp.float32(7))
    # metres at 2 m/s: 100 and 150 to the nodes 1 and 2, 300 to node 3 by node 1
    assert arrival.tolist() == [7, 57, 82, 157]
    assert via.tolist() == [-1, 0, 2, 1]


@pytest.mark.parametrize(
    ("rule", "arrives"),
    [
        # 100 m at 2 m/s till 10 s, then at .5 m/s: 20 m in 10 s and 80 m in 160 s; then 55 m at 1 m/s
        ("integrated", 225.0),
        # at 2 m/s to the end: 50 s, and 55 s
        ("entry", 105.0),
    ],
)
def test_the_rule_is_heeded(rule: CrossingRule, arrives: float) -> None:
    network = road_network(np.zeros((3, 2)), [0, 1], [1, 2], [100.0, 55.0])
    field = speed_field(jnp.array([[2.0, 0.5], [1.0, 1.0]]), 10.0)
    arrival, _ = arrivals(network, field, jnp.int32(0), jnp.float32(0), rule)
    assert float(arrival[2]) == pytest.approx(arrives)


def jams() -> tuple[SpeedField, SpeedField]:
    """On the diamond, what is expected and what comes, in slots of 300 s, at 1 m/s where there is no jam.

    Expected: 1 > 3 is jammed at 0.1 m/s for ever. What comes: that jam clears at 300 s, and then 2 > 3 is jammed.
    """
    free = jnp.ones((8, 2))
    expected = free.at[1].set(0.1)
    real = free.at[1, 0].set(0.1).at[3, 1].set(0.1)
    return speed_field(expected, 300.0), speed_field(real, 300.0)


def test_in_hindsight_one_walks_into_the_jam_that_clears(diamond, make_params, make_instance) -> None:
    expected, real = jams()
    params = make_params(diamond, real, expected)
    (hindsight,) = routes(Clairvoyant(), params, make_instance([0]), jax.random.key(0), 5)
    # above: 100 s to node 1, 20 m in the jam till 300 s, 180 m in 180 s
    assert hindsight.nodes == (0, 1, 3)
    assert hindsight.clocks == pytest.approx((0, 100, 480))
    assert (hindsight.seconds, hindsight.arrived) == (pytest.approx(480), True)
    (planned,) = routes(Expected(), params, make_instance([0]), jax.random.key(0), 5)
    # expected above: 100 + 2,000 s, below: 150 + 250 s; below, 150 m by 300 s, and 100 m in the new jam take 1,000 s
    assert planned.nodes == (0, 2, 3)
    assert planned.clocks == pytest.approx((0, 150, 1300))
    # Had everything come as expected, both would have gone below.
    usual = make_params(diamond, expected)
    for planner in (Clairvoyant(), Expected()):
        (route,) = routes(planner, usual, make_instance([0]), jax.random.key(0), 5)
        assert (route.nodes, route.seconds) == ((0, 2, 3), pytest.approx(400))


@pytest.fixture(scope="module")
def both(diamond, make_params) -> EnvParams:
    """Future 0 is as expected, future 1 is what comes."""
    return make_params(diamond, jax.tree.map(lambda *leaves: jnp.stack(leaves), *jams()))


def test_the_departure_decides(both, make_instance) -> None:
    params = both
    todo = make_instance([0, 2, 2], 3, [300.0, 40.0, 40.0], 1)
    plan = Clairvoyant().plan(params, todo)
    # From 300 s on the way above is free. And who is at node 2 by 40 s is through by 290 s, before the jam there.
    assert np.asarray(plan.own).tolist() == [
        [[True, False], [True, False], [False, False], [False, False]],
        *[[[False, False], [False, False], [True, False], [False, False]]] * 2,
    ]
    walked = walk_plan(Clairvoyant(), params, plan, todo, jax.random.key(0))
    assert walked.seconds.tolist() == pytest.approx([300, 250, 250])


def test_each_walk_has_its_own_crowd(both, make_instance) -> None:
    params = both
    todo = make_instance([0, 0, 0], 3, 0.0, [0, 1, 0])
    plan = Clairvoyant().plan(params, todo)
    assert np.asarray(plan.own)[:, 0].tolist() == [[False, True], [True, False], [False, True]]
    walked = walk_plan(Clairvoyant(), params, plan, todo, jax.random.key(0))
    assert walked.seconds.tolist() == pytest.approx([400, 480, 400])


def test_where_no_path_is_known_a_walker_wanders(make_params, make_instance) -> None:
    # From 0 to 1 or to 2 and back, 10 s each; 3 is out of reach.
    network = road_network(np.zeros((4, 2)), [0, 0, 1, 2], [1, 2, 0, 0], [10.0] * 4)
    params = make_params(network, speed_field(jnp.ones((4, 1)), 60.0), horizon=800.0)
    todo = make_instance([0], 3)
    plan = Clairvoyant().plan(params, todo)
    assert not np.asarray(plan.own).any()
    walked = walk_plan(Clairvoyant(), params, plan, todo, jax.random.key(0), 80)
    segments = walked.segments[0].tolist()
    assert set(segments[::2]) == {0, 1}  # out
    assert set(segments[1::2]) == {2, 3}  # and back
    assert (bool(walked.arrived[0]), float(walked.seconds[0])) == (False, 800)
