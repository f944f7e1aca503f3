"""Nobody is faster than the clairvoyant, or walks where nobody may, whatever gates and restricted streets there are."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.environment.cost_to_go import GATE_STEP, expected_cost_to_go
from sidestep.environment.types import EnvParams, Instance, futures_in_turn
from sidestep.network.snapping import StreetPoint, split_streets
from sidestep.network.town import Town
from sidestep.planners.base import walk_plan
from sidestep.planners.random import RandomProgress, RandomWalk
from sidestep.planners.reactive import GreedyLocal, GreedyMap
from sidestep.planners.real_time import LrtaStar
from sidestep.planners.shortest_path import ShortestPath
from sidestep.planners.time_dependent import Clairvoyant, Expected, earliest_arrivals, leaving
from sidestep.walking.objective import TravelTime, WeightedObjective
from sidestep.walking.opening import with_opening_times
from sidestep.walking.speed_field import speed_field
from sidestep.walking.waits import NoWaits

NODES, STREETS, WALKS, SLOTS, SLOT = 16, 25, 4, 24, 300.0
HORIZON = SLOTS * SLOT - 1800
TIMES = ("", "06:00-22:00", "22:00-06:00", "00:00-00:10,00:20-00:30,00:40-00:50")
NO_TRAFFIC = with_opening_times(NoWaits(), TIMES)
TRACE = 60
AROUND = 10
"""Steps before and after: walks in this town cross up to ten streets."""
PLANNERS = (
    Clairvoyant(),
    RandomWalk(),
    RandomProgress(),
    ShortestPath(),
    Expected(),
    GreedyLocal(),
    LrtaStar(),
    GreedyMap(),
)


def problem(block, seed: int) -> tuple[EnvParams, Instance, float, Town]:
    """Streets with gates, some of them restricted, in a crowd that changes every five minutes; hour and town."""
    rng = np.random.default_rng(seed)
    times = rng.choice(4, STREETS, p=[0.5, 0.2, 0.15, 0.15])
    restricted = rng.random(STREETS) < 0.3
    restricted[rng.integers(STREETS)] = True
    town = replace(block(), restricted=restricted)
    network = town.network()
    street, _ = town.street_of_segment()
    waits = replace(NO_TRAFFIC, timetable=jnp.asarray(times[street]))
    speed, density = (rng.uniform(low, high, (1, network.segments, SLOTS)) for low, high in ((0.2, 1.34), (0, 3)))
    field = speed_field(jnp.asarray(speed, jnp.float32), SLOT, jnp.asarray(density, jnp.float32))
    hour = float(rng.choice([0.0, 5.5, 21.75, 23.5]))
    hours, ends = jnp.array([hour]), rng.permutation(NODES)
    params = EnvParams(network, futures_in_turn(field, hours), field, jnp.float32(HORIZON), waits=waits, level="map")
    origin = rng.choice(ends[1:], WALKS)
    todo = Instance(
        jnp.asarray(origin, jnp.int32),
        jnp.full(WALKS, ends[0], jnp.int32),
        jnp.asarray(rng.uniform(0, 1800, WALKS), jnp.float32),
        jnp.zeros(WALKS, jnp.int32),
    )
    return params, todo, hour, town


costs = jax.jit(expected_cost_to_go)


@pytest.mark.parametrize("weighted", [False, True])
@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_planner_beats_the_clairvoyant(block, weighted: bool, seed: int) -> None:
    params, todo, hour, _ = problem(block, seed)
    params = replace(params, objective=WeightedObjective(exposure=0.3, distance=0.2) if weighted else TravelTime())
    end = int(todo.destination[0])
    known = costs(params, (jnp.arange(NODES) == end)[None], jnp.array([hour]))
    params = replace(params, cost_to_go=known)
    network = params.network
    allowed = np.asarray(network.may_take(todo.destination[0]))
    best = None
    for planner in PLANNERS:
        walked = walk_plan(planner, params, planner.plan(params, todo), todo, jax.random.key(seed), TRACE)
        segments = np.asarray(walked.segments)
        assert allowed[segments[segments >= 0]].all(), planner.name
        cost = np.asarray(walked.cost if weighted else walked.seconds, np.float64)
        best = cost if best is None else best
        # With an objective costs are tabulated in steps of 15 s, and a gate may shut within one.
        slack = 0.02 * cost + 30 if weighted else 0.05
        arrived = np.asarray(walked.arrived)
        assert (cost >= best - slack)[arrived | (not weighted)].all(), planner.name
        assert (np.asarray(walked.seconds) <= HORIZON).all()


@jax.jit
def arrivals(params: EnvParams, origin: jax.Array, departures: jax.Array) -> jax.Array:
    """The earliest clock at every node, for each departure."""
    leave = leaving(params.network, params.expected, jnp.int32(0), params.rule, params.wait_in(jnp.int32(0)))
    search = partial(earliest_arrivals, params.network, leave, origin)
    return jax.vmap(lambda departure: search(departure)[0])(departures)


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_places_in_the_middle_of_streets_change_no_walk(block, seed: int) -> None:
    params, todo, _, town = problem(block, seed)
    rng = np.random.default_rng(seed)
    # Two on one street, and one on another.
    first, second = rng.permutation(STREETS)[:2].tolist()
    where = ((first, rng.uniform(0.1, 0.4)), (first, rng.uniform(0.6, 0.9)), (second, rng.uniform(0.1, 0.9)))
    split = split_streets(town, [StreetPoint(street, part, 0.0, (0.0, 0.0)) for street, part in where])
    parent = jnp.asarray(split.parent)
    pieces = replace(
        params,
        network=split.network,
        expected=speed_field(params.expected.speed[:, parent], SLOT),
        waits=params.waits.on_pieces(parent, jnp.asarray(split.begins_at_crossing)),
    )
    origin, departures = todo.origin[0], jnp.sort(todo.departure)
    for node in (int(origin), *split.nodes):
        found = np.asarray(arrivals(pieces.begun_at(node), jnp.int32(node), departures))
        # Nobody who sets out later arrives earlier.
        assert (np.diff(np.where(np.isfinite(found), found, 1e9), axis=0) >= -0.05).all()
        if node == origin:
            whole = arrivals(params, origin, departures)
            np.testing.assert_allclose(found[:, :NODES], whole, atol=0.1)


@jax.jit
def least_seconds(params: EnvParams, end: jax.Array, departures: jax.Array) -> jax.Array:
    """Seconds from every node to one, for each departure."""
    leave = leaving(params.network, params.expected, jnp.int32(0), params.rule, params.wait_in(jnp.int32(0)))

    def one(origin: jax.Array, departure: jax.Array) -> jax.Array:
        return earliest_arrivals(params.network, leave, origin, departure, end)[0][end] - departure

    return jax.vmap(jax.vmap(one, (0, None)), (None, 0))(jnp.arange(NODES), departures)


@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1))
def test_costs_to_go_are_those_of_a_moment_before_or_after(block, seed: int) -> None:
    params, todo, hour, _ = problem(block, seed)
    end = todo.destination[0]
    known = costs(params, (jnp.arange(NODES) == end)[None], jnp.array([hour]))
    first = int(np.random.default_rng(seed).integers(AROUND, 40))
    near = GATE_STEP * jnp.arange(first - AROUND, first + AROUND + 1)
    truly, found = np.asarray(least_seconds(params, end, near)), np.asarray(known.table[0, first])
    # Later crowds and gates are not in the table.
    truly, found = (np.minimum(each, SLOTS * SLOT - 3600) for each in (truly, found))
    assert (found >= truly.min(axis=0) - 1).all()
    assert (found <= truly.max(axis=0) + 1).all()
