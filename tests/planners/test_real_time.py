"""Real-time search: by hand on a street with a dead end, on random streets, and in a town."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from sidestep.environment.types import EnvParams, KnowledgeError
from sidestep.network.graph import road_network
from sidestep.planners.base import Remembering, routes, walk_plan
from sidestep.planners.reactive import GreedyLocal
from sidestep.planners.real_time import WEIGHT, LrtaStar
from sidestep.routing.router import Router
from sidestep.walking.objective import WeightedObjective
from sidestep.walking.speed_field import speed_field

KEY = jax.random.key(0)
NODES, EXITS, MOST = 7, 3, 600


@pytest.fixture(scope="module")
def dead_end(make_params) -> EnvParams:
    """Node 1 lies before node 3, but only node 2, 100 m beside node 0, leads there: 300 m. All walk at 1 m/s."""
    network = road_network(
        np.array([[0, 0], [100, 0], [0, -100], [200, 0]]),
        tail=[0, 0, 2, 1, 2, 3], head=[1, 2, 3, 0, 0, 2], length=[100, 100, 300, 100, 100, 300],
    )  # fmt: skip
    params = make_params(network, speed_field(jnp.ones((6, 2)), 300.0, jnp.zeros((6, 2))), horizon=3000.0)
    return replace(params, free_speed=1.0)


def test_a_dead_end_is_tried_once(dead_end, make_instance) -> None:
    (route,) = routes(LrtaStar(), dead_end, make_instance([0]), KEY, 8)
    assert (route.nodes, route.seconds, route.arrived) == ((0, 1, 0, 2, 3), 600, True)
    # At 0 it is 100 + 200 s by 1 and 100 + 447 s by 2, but at least twice the 200 s straight; at 1 it is 100 + 400 s
    # back. Then it is 100 + 500 s by 1 and 547 s by 2, and there 300 s on, but at least twice the 224 s straight.
    assert route.remembered == pytest.approx((400, 500, 100 + 2 * 50_000**0.5, 2 * 50_000**0.5))
    (route,) = routes(GreedyLocal(), dead_end, make_instance([0]), KEY, 8)
    assert (route.nodes[:5], route.arrived, route.remembered) == ((0, 1, 0, 1, 0), False, ())


def test_walkers_remember_their_own_walks(dead_end, make_instance) -> None:
    todo = make_instance([0, 1, 2, 0])
    plan = LrtaStar().plan(dead_end, make_instance([0]))
    walked = walk_plan(LrtaStar(), dead_end, plan, todo, KEY)
    assert walked.seconds.tolist() == [600, 500, 300, 600]


def test_costs_are_those_of_the_objective(dead_end, make_instance) -> None:
    twice = replace(dead_end, objective=WeightedObjective(time=1.0, distance=1.0))
    (route,) = routes(LrtaStar(), twice, make_instance([0]), KEY, 8)
    assert (route.nodes, route.cost) == ((0, 1, 0, 2, 3), 1200)
    assert route.remembered[:2] == pytest.approx((800, 1000))


@st.composite
def streets(draw: st.DrawFn) -> tuple[np.ndarray, ...]:
    """A ring through all nodes, one way, and two more streets from each to any other; times for all, in s."""
    others = st.lists(st.integers(1, NODES - 1), min_size=2 * NODES, max_size=2 * NODES)
    tail = np.repeat(np.arange(NODES), EXITS)
    ahead = np.insert(np.array(draw(others)).reshape(NODES, 2), 0, 1, axis=1).reshape(-1)
    xy = st.tuples(st.integers(0, 200), st.integers(0, 200))
    position = np.array(draw(st.lists(xy, min_size=NODES, max_size=NODES, unique=True)), float)
    head = (tail + ahead) % NODES
    more = st.lists(st.integers(0, 200), min_size=len(tail), max_size=len(tail))
    length = np.linalg.norm(position[tail] - position[head], axis=1) + 20
    return position, tail, head, length, length + draw(more)


@given(streets())
def test_it_arrives_and_estimates_only_rise_up_to_what_is_so(make_params, make_instance, drawn) -> None:
    position, tail, head, length, seconds = drawn
    network = road_network(position, tail=tail, head=head, length=length)
    speed = np.repeat((length / seconds)[:, None], 2, axis=1)
    params = replace(make_params(network, speed_field(jnp.asarray(speed), 300.0), horizon=1e7), free_speed=1.0)
    (route,) = routes(LrtaStar(), params, make_instance([0]), KEY, MOST)
    assert route.arrived
    matrix = np.full((NODES, NODES), np.inf)
    np.minimum.at(matrix, (tail, head), seconds)
    least = dijkstra(csr_matrix(np.where(np.isfinite(matrix), matrix, 0)).T, indices=3)
    known = np.zeros(NODES)
    for node, number in zip(route.nodes, route.remembered, strict=False):
        assert number >= known[node] * (1 - 1e-6)
        assert number <= WEIGHT * least[node] * (1 + 1e-5)
        known[node] = number
    assert len(route.remembered) == len(route.nodes) - 1


def test_it_arrives_in_a_town_where_greedy_local_does_not(router) -> None:
    ends, arrived = (60.1719, 24.9414), {}
    for planner in ("greedy-local", "lrta-star"):
        arrived[planner] = router.plan(ends, (60.1640, 24.9480), planner=planner, futures=1).arrives
    assert arrived == {"greedy-local": False, "lrta-star": True}


@pytest.fixture(scope="module")
def router() -> Router:
    return Router("helsinki")


def test_it_is_a_planner_that_remembers() -> None:
    planner = LrtaStar()
    assert isinstance(planner, Remembering)
    assert not isinstance(GreedyLocal(), Remembering)
    assert (planner.name, planner.level, planner.observes) == ("lrta-star", "local", "local")


def test_observations_without_crowds_are_refused(dead_end, make_instance) -> None:
    blind = LrtaStar()
    blind.observes = "position"
    with pytest.raises(KnowledgeError) as caught:
        walk_plan(blind, dead_end, blind.plan(dead_end, make_instance([0])), make_instance([0]), KEY)
    assert caught.value.field == "observes"
