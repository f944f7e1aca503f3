"""The planners beside brute force and SciPy, and the properties that all of them share."""

from itertools import pairwise, permutations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sidestep.agent.policy import Policy
from sidestep.agent.presets import PRESETS
from sidestep.agent.q_networks import dueling_network
from sidestep.environment.types import EnvParams
from sidestep.network.graph import RoadNetwork, road_network
from sidestep.network.grid import grid_network
from sidestep.planners.base import Plan, Planner, _Named, keep_to_plan, routes, walk_plan
from sidestep.planners.learned import Darp
from sidestep.planners.random import RandomProgress, RandomWalk
from sidestep.planners.shortest_path import ShortestPath, distances_to
from sidestep.planners.time_dependent import Clairvoyant, Expected
from sidestep.walking.speed_field import speed_field

KEY = jax.random.key(0)
SIDE = 4
WALKS, TRACE = 200, 40  # on the grid; one number each, so that all tests share compiled programs
PAIRS = list(permutations(range(4), 2))  # all walks on the diamond


def crowded_grid(make_params, seed: int = 0) -> EnvParams:
    """A grid with two crowds whose speeds change every 300 s."""
    rng = np.random.default_rng(seed)
    network = grid_network(SIDE, rng)
    speed = rng.uniform(0.3, 2, (2, network.segments, 6))
    return make_params(network, speed_field(jnp.asarray(speed, jnp.float32), 300.0), horizon=1e5)


def untrained(params: EnvParams) -> Darp:
    network = dueling_network(PRESETS["default"].changed(hidden=(8,), unit=1.0), params.network, KEY)
    return Darp(Policy(network), np.zeros((0, 10), np.float32))


def metres(network: RoadNetwork, nodes: tuple[int, ...]) -> float:
    distance = np.asarray(network.distance_matrix())
    assert all(distance[here, there] > 0 for here, there in pairwise(nodes))
    return float(sum(distance[here, there] for here, there in pairwise(nodes)))


# --- Shortest path --------------------------------------------------------------------------------------------------


def by_brute_force(network: RoadNetwork, origin: int, destination: int) -> float:
    """The shortest of all orders in which other nodes could be passed."""
    distance = np.asarray(network.distance_matrix())
    others = [node for node in range(network.nodes) if node not in {origin, destination}]
    paths = [
        (origin, *between, destination) for count in range(len(others) + 1) for between in permutations(others, count)
    ]
    return min(
        sum(distance[here, there] for here, there in pairwise(path))
        for path in paths
        if all(distance[here, there] > 0 for here, there in pairwise(path))
    )


def test_shortest_paths_on_the_diamond(diamond, constant_field, make_params, make_instance) -> None:
    params = make_params(diamond, constant_field(diamond))
    origins, destinations = zip(*PAIRS, strict=True)
    found = routes(ShortestPath(), params, make_instance(list(origins), list(destinations)), KEY, 5)
    for (origin, destination), route in zip(PAIRS, found, strict=True):
        assert (route.nodes[0], route.nodes[-1], route.arrived) == (origin, destination, True)
        assert metres(diamond, route.nodes) == by_brute_force(diamond, origin, destination)
        assert route.seconds == pytest.approx(metres(diamond, route.nodes))  # at 1 m/s
    # by hand: 0 > 1 > 3 is 300 m, by 2 it is 400; 1 > 0 > 2 is 250 m, by 3 it is 450
    assert found[PAIRS.index((0, 3))].nodes == (0, 1, 3)
    assert found[PAIRS.index((1, 2))].nodes == (1, 0, 2)


def test_the_shortest_path_heeds_no_crowd(diamond, make_params, make_instance) -> None:
    jammed = jnp.ones((8, 2)).at[1].set(0.01)
    params = make_params(diamond, speed_field(jammed, 300.0))
    (route,) = routes(ShortestPath(), params, make_instance([0]), KEY, 5)
    # 100 s, and 200 m at 1 cm/s
    assert (route.nodes, route.clocks) == ((0, 1, 3), pytest.approx((0, 100, 20_100)))


@pytest.mark.parametrize("seed", range(6))
def test_shortest_paths_on_grids_are_scipys(make_params, make_instance, seed: int) -> None:
    params = crowded_grid(make_params, seed)
    network = params.network
    length = csr_array((network.length, (network.tail, network.head)), shape=(SIDE**2, SIDE**2))
    shortest = dijkstra(length)
    ends = np.random.default_rng(seed).choice(SIDE**2, (WALKS, 2))
    found = routes(ShortestPath(), params, make_instance(ends[:, 0].tolist(), ends[:, 1].tolist()), KEY, TRACE)
    for (origin, destination), route in zip(ends.tolist(), found, strict=True):
        assert route.nodes[-1] == destination
        assert metres(network, route.nodes) == pytest.approx(shortest[origin, destination], rel=1e-6)
    for destination in (0, 5):
        np.testing.assert_allclose(
            distances_to(network, np.asarray(network.length), destination), shortest[:, destination], rtol=1e-6
        )


def test_distances_respect_one_way_streets() -> None:
    # 0 > 1 > 2 > 0, and node 3 that only leads out
    network = road_network(np.zeros((4, 2)), [0, 1, 2, 3], [1, 2, 0, 0], [1.0, 10.0, 100.0, 1000.0])
    assert distances_to(network, np.asarray(network.length), 2).tolist() == [11, 10, 0, 1011]
    assert distances_to(network, np.asarray(network.length), 3).tolist() == [np.inf, np.inf, np.inf, 0]
    assert distances_to(network, np.ones(4), 1).tolist() == [1, 0, 2, 2]


# --- Random ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_random_progress_takes_the_fewest_crossings(make_params, make_instance, seed: int) -> None:
    params = crowded_grid(make_params, seed)
    ends = np.random.default_rng(seed).choice(SIDE**2, (WALKS, 2))
    todo = make_instance(ends[:, 0].tolist(), ends[:, 1].tolist())
    walked = walk_plan(RandomProgress(), params, RandomProgress().plan(params, todo), todo, KEY, TRACE)
    (x, y), (to_x, to_y) = ((nodes % SIDE, nodes // SIDE) for nodes in ends.T)
    assert walked.steps.tolist() == (abs(to_x - x) + abs(to_y - y)).tolist()
    assert walked.arrived.all()


def test_random_progress_takes_every_path_of_fewest_crossings(make_params, make_instance) -> None:
    params = crowded_grid(make_params)
    found = routes(RandomProgress(), params, make_instance([0] * WALKS, 10), KEY, TRACE)
    # two to the right and two up: 4! / (2! 2!) = 6 paths, the rarest with probability 1/8
    assert len({route.nodes for route in found}) == 6


def test_random_progress_never_steps_sideways(make_params, make_instance) -> None:
    # From 0, both 1 and 2 are one crossing from 3 and one from each other: not from one to the other.
    tail, head = zip(*[(0, 1), (0, 2), (1, 2), (2, 1), (1, 3), (2, 3)], strict=True)
    network = road_network(np.zeros((4, 2)), tail, head, np.ones(6))
    params = make_params(network, speed_field(jnp.ones((6, 1)), 300.0))
    found = routes(RandomProgress(), params, make_instance([0] * 50), KEY, 8)
    assert {route.nodes for route in found} == {(0, 1, 3), (0, 2, 3)}


def test_a_random_walk_keeps_to_the_streets_and_takes_them_all(make_params, make_instance) -> None:
    params = crowded_grid(make_params)
    found = routes(RandomWalk(), params, make_instance([0] * WALKS, SIDE**2 - 1), KEY, TRACE)
    taken = {step for route in found for step in pairwise(route.nodes)}
    streets = set(zip(params.network.tail.tolist(), params.network.head.tolist(), strict=True))
    # Nobody leaves the destination; everything else is walked sooner or later.
    assert taken == {(here, there) for here, there in streets if here != SIDE**2 - 1}
    assert len({len(route.nodes) for route in found}) > 10
    allowed = np.asarray(RandomWalk().plan(params, make_instance([0, 1])).own)
    assert (allowed == np.asarray(params.network.valid)).all()


# --- All ------------------------------------------------------------------------------------------------------------


def every_planner(params: EnvParams) -> list[Planner]:
    return [RandomWalk(), RandomProgress(), ShortestPath(), Expected(), Clairvoyant(), untrained(params)]


def test_every_planner_plans_and_decides(make_params, make_instance) -> None:
    params = crowded_grid(make_params)
    alike = WALKS // 4
    todo = make_instance(
        [0, 5, 15, 3] * alike, [15, 10, 0, 3] * alike, [0.0, 10.0, 700.0, 5.0] * alike, [0, 1] * 2 * alike
    )
    for planner in every_planner(params):
        plan = planner.plan(params, todo)
        assert isinstance(plan, Plan)
        assert all(leaf.shape[0] == WALKS for leaf in jax.tree.leaves(plan.own))
        assert planner.decide is type(planner).decide  # static: one compiled program for all of a kind
        walked = walk_plan(planner, params, plan, todo, KEY, TRACE)
        assert walked.segments.shape == (WALKS, TRACE)
        assert params.network.tail[walked.segments[:3, 0]].tolist() == [0, 5, 15]
        assert walked.segments[3].tolist() == [-1] * TRACE  # it is there already
        assert (bool(walked.arrived[3]), float(walked.seconds[3])) == (True, 0)
        # To arrive takes time; a walk that does not arrive counts as the horizon.
        seconds, arrived = np.asarray(walked.seconds[:3]), np.asarray(walked.arrived[:3])
        assert (seconds > 0).all()
        assert (arrived | (seconds == 1e5)).all()
        if planner.name != "darp":
            assert arrived.all()


def test_the_same_key_gives_the_same_walks(make_params, make_instance) -> None:
    params = crowded_grid(make_params)
    todo = make_instance([0] * WALKS, 15)

    def walks(planner: Planner, seed: int) -> list[list[int]]:
        return walk_plan(
            planner, params, planner.plan(params, todo), todo, jax.random.key(seed), TRACE
        ).segments.tolist()

    for planner in (RandomWalk(), RandomProgress()):
        assert walks(planner, 0) == walks(type(planner)(), 0)
        assert walks(planner, 0) != walks(planner, 1)
    assert walks(ShortestPath(), 0) == walks(ShortestPath(), 1)
    # Walks of one batch have random numbers of their own.
    assert len({tuple(segments) for segments in walks(RandomWalk(), 0)}) > 0.75 * WALKS


def test_planners_that_allow_the_same_meet_the_same_chance(make_params, make_instance) -> None:
    # Common random numbers: the draws depend on key, walk and crossing, and not on who asks.
    params = crowded_grid(make_params)
    todo = make_instance([0] * WALKS, 15)

    class Double(RandomWalk):
        name = "double"

    plans = [planner.plan(params, todo) for planner in (RandomWalk(), Double())]
    one, other = (
        walk_plan(planner, params, plan, todo, KEY, TRACE)
        for planner, plan in zip((RandomWalk(), Double()), plans, strict=True)
    )
    assert one.segments.tolist() == other.segments.tolist()
    assert one.seconds.tolist() == other.seconds.tolist()


def test_plans_of_another_number_of_walks_are_refused(make_params, make_instance) -> None:
    params = crowded_grid(make_params)
    plan = ShortestPath().plan(params, make_instance([0, 1], 15))
    with pytest.raises(ValueError, match="inconsistent sizes"):
        walk_plan(ShortestPath(), params, plan, make_instance([0, 1, 2], 15), KEY)


def test_decisions_of_others_are_not_told_by_their_names() -> None:
    # Their code may change while their names stay; a program that is found by the name would walk the old way.
    assert _Named.of(keep_to_plan)() is keep_to_plan
    assert _Named.of(crowded_grid) is crowded_grid


def test_routes_are_cut_at_the_trace_and_end_with_the_walk(diamond, constant_field, make_params, make_instance) -> None:
    params = make_params(diamond, constant_field(diamond))
    todo = make_instance([0], 3, 10.0)
    (whole,) = routes(ShortestPath(), params, todo, KEY, 5)
    assert (whole.segments, whole.nodes, whole.clocks, whole.seconds) == ((0, 1), (0, 1, 3), (10, 110, 310), 300)
    (cut,) = routes(ShortestPath(), params, todo, KEY, 1)
    assert (cut.segments, cut.nodes, cut.clocks, cut.seconds, cut.arrived) == ((0,), (0, 1), (10, 110), 300, True)


def test_routes_say_which_of_two_parallel_segments_was_walked(make_params, make_instance) -> None:
    network = road_network(np.zeros((2, 2)), [0, 0], [1, 1], [10.0, 5.0])
    params = make_params(network, speed_field(jnp.ones((2, 1)), 60.0))
    for planner in (ShortestPath(), Clairvoyant()):
        (route,) = routes(planner, params, make_instance([0], 1), KEY, 3)
        assert (route.segments, route.nodes, route.seconds) == ((1,), (0, 1), 5)
