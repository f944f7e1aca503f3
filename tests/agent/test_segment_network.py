"""The network of streets: untrained it is its level's greedy planner; what must not matter does not."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent.policy import Policy
from sidestep.agent.presets import preset
from sidestep.agent.segment_network import Places, SegmentQNetwork, segment_network
from sidestep.environment.dynamics import reset
from sidestep.environment.observation import observe
from sidestep.environment.types import EnvParams, EnvState, Instance, Observation
from sidestep.planners.base import routes
from sidestep.planners.learned import Darp
from sidestep.planners.reactive import Forecast, GreedyLocal, GreedyMap
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import ScenarioMap, draw_map
from sidestep.scenarios.model import Scenario

KEY = jax.random.key(4)
LEVELS = ("local", "map", "live")
UNIT_SECONDS = 60.0

Rush = tuple[Scenario, ScenarioMap, EnvParams]


@pytest.fixture(scope="module")
def rush() -> Rush:
    """Four by four nodes, whose corners have two exits and whose sides three, with eight futures."""
    small = scenario("rush-16", side=4, crowded_nodes=1, horizon=2 * 3600.0)
    scenario_map = draw_map(small, 3)
    return small, scenario_map, make_environment(small, scenario_map, "test", 8, level="live")


def fresh(rush: Rush, level: str, **changes) -> SegmentQNetwork:
    config = preset("default", level).changed(**({"hidden": (8, 8), "places": 3} | changes))
    return segment_network(config, rush[0], rush[2].network, KEY)


def trained(rush: Rush, level: str, **changes) -> SegmentQNetwork:
    """As if trained: random last layers and tolls."""
    made = fresh(rush, level, **changes)
    last = [made.value[-1].weight, made.advantage[-1].weight]
    made = eqx.tree_at(
        lambda net: [net.value[-1].weight, net.advantage[-1].weight],
        made,
        [jax.random.normal(KEY, weight.shape) for weight in last],
    )
    if made.places is None:
        return made
    return eqx.tree_at(lambda net: net.places.table, made, jax.random.normal(KEY, made.places.table.shape))


@pytest.fixture(scope="module")
def sights(rush) -> dict[str, Observation]:
    """What walkers of each level see at all nodes but the destination, at various clocks, in all crowds."""
    params = rush[2]
    node = jnp.arange(params.network.nodes - 1)
    clock = jnp.linspace(0, 6000, len(node))
    instance = Instance(node, jnp.full(len(node), params.network.nodes - 1), clock, node % params.futures.count)
    recent_nodes = jnp.stack([(node + 1) % params.network.nodes, *[jnp.full(len(node), -1)] * 7], axis=1)
    states = jax.vmap(EnvState)(node, clock, instance, recent_nodes, jnp.zeros_like(node))
    return {level: jax.jit(jax.vmap(partial(observe, replace(params, level=level))))(states) for level in LEVELS}


@eqx.filter_jit
def values(network: SegmentQNetwork, seen: Observation) -> jax.Array:
    return jax.vmap(network)(seen)


@eqx.filter_jit
@eqx.filter_grad(has_aux=True)
def gradient(network: SegmentQNetwork, seen: Observation) -> tuple[jax.Array, jax.Array]:
    """Of the sum of squares, with the values."""
    q = jax.vmap(network)(seen)
    return jnp.sum(q**2, where=seen.valid), q


def each_exit(seen: Observation, change: Callable[[jax.Array], jax.Array]) -> Observation:
    """Change whatever is seen of exits, which counts along the second axis of a batch."""
    exits = seen.valid.shape[1]

    def changed(leaf: jax.Array) -> jax.Array:
        return change(leaf) if leaf.ndim > 1 and leaf.shape[1] == exits else leaf

    # Coordinates have another number of columns than there are exits.
    assert exits != 2
    return jax.tree.map(changed, seen)


# --- Untrained ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize(("places", "dueling"), [(0, False), (3, True)])
def test_untrained_it_is_its_levels_estimate(rush, sights, level: str, places: int, dueling: bool) -> None:
    seen = sights[level]
    q = values(fresh(rush, level, places=places, dueling=dueling), seen)
    assert q.shape == (15, 4)
    # minutes, no constant beside
    np.testing.assert_allclose(q, -seen.estimate / UNIT_SECONDS, rtol=1e-6)


def test_without_potential_it_knows_nothing(rush, sights) -> None:
    assert (values(fresh(rush, "map", potential=False), sights["map"]) == 0).all()


@pytest.mark.parametrize(
    ("level", "planner"), [("local", GreedyLocal()), ("map", GreedyMap()), ("live", Forecast())], ids=LEVELS
)
def test_untrained_it_walks_as_its_levels_greedy_planner(rush, level: str, planner) -> None:
    small, scenario_map, params = rush
    todo = instances(small, scenario_map, params, 20)
    network = fresh(rush, level)
    found = routes(Darp(Policy(network), np.zeros((0, 10), np.float32), level), params, todo, KEY, 40)
    greedy = routes(planner, params, todo, KEY, 40)
    assert [(route.segments, route.arrived) for route in found] == [(route.segments, route.arrived) for route in greedy]
    np.testing.assert_allclose([route.clocks[-1] for route in found], [route.clocks[-1] for route in greedy], rtol=1e-6)
    assert len({route.nodes for route in found}) > 1


def test_without_potential_it_does_not(rush) -> None:
    small, scenario_map, params = rush
    todo = instances(small, scenario_map, params, 20)
    network = fresh(rush, "map", potential=False)
    found = routes(Darp(Policy(network), np.zeros((0, 10), np.float32), "map"), params, todo, KEY, 40)
    # All are worth the same, so it takes the first exit, up, as far as it goes, and then paces.
    assert {route.nodes[:6] for route in found} == {(0, 4, 8, 12, 8, 12)}
    assert not any(route.arrived for route in found)


def test_level_position_has_no_streets_to_score(rush) -> None:
    params = rush[2]
    _, seen = reset(replace(params, level="position"), Instance(*map(jnp.int32, (0, 15)), jnp.float32(0), jnp.int32(0)))
    with pytest.raises(ValueError, match="from level local on"):
        fresh(rush, "local")(seen)


# --- Trained --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", LEVELS)
def test_trained_it_corrects_the_estimate(rush, sights, level: str) -> None:
    seen = sights[level]
    network = trained(rush, level)
    q = values(network, seen)
    assert jnp.isfinite(q).all(where=seen.valid)
    # With and without potential the same correction, which differs from exit to exit.
    correction = values(replace(network, potential=False), seen)
    np.testing.assert_allclose(q, correction - seen.estimate / UNIT_SECONDS, rtol=1e-4, atol=1e-3)
    valid = np.asarray(seen.valid)
    assert (np.nanstd(np.where(valid, np.asarray(correction), np.nan), axis=1) > 0).all()


def test_dueling_the_value_is_the_mean_of_the_corrections(rush, sights) -> None:
    seen = sights["map"]
    network = trained(rush, "map", places=0, potential=False)
    shifted = eqx.tree_at(lambda net: net.value[-1].bias, network, jnp.array([0.7]))
    # Another value shifts all exits by 10 units of .7; a constant advantage shifts none.
    np.testing.assert_allclose(values(shifted, seen) - values(network, seen), 7.0, atol=1e-3)
    shifted = eqx.tree_at(lambda net: net.advantage[-1].bias, network, jnp.array([0.7]))
    np.testing.assert_allclose(values(shifted, seen), values(network, seen), atol=1e-3)
    # Without dueling the value counts for nothing, and the advantage for all.
    single = replace(network, dueling=False)
    shifted = eqx.tree_at(lambda net: net.value[-1].bias, single, jnp.array([0.7]))
    np.testing.assert_array_equal(values(shifted, seen), values(single, seen))
    shifted = eqx.tree_at(lambda net: net.advantage[-1].bias, single, jnp.array([0.7]))
    np.testing.assert_allclose(values(shifted, seen) - values(single, seen), 7.0, atol=1e-3)


def test_a_toll_counts_directly(rush, sights) -> None:
    seen = sights["map"]
    network = fresh(rush, "map", dueling=False)
    tolled = eqx.tree_at(lambda net: net.places.table, network, network.places.table.at[:, 5, 0].set(-0.3))
    # Ten units of -.3 for every exit that leads to node 5, at any time.
    q, tolls = values(network, seen), values(tolled, seen)
    onto = np.asarray(seen.local.onto) == 5
    assert onto.sum() == 4
    np.testing.assert_allclose(tolls, np.asarray(q) - 3 * onto, rtol=1e-5)


# --- What must not matter -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", LEVELS)
def test_exits_that_do_not_exist_do_not_matter(rush, sights, level: str) -> None:
    seen = sights[level]
    absent = ~np.asarray(seen.valid)
    assert absent.any()

    def spoil(leaf: jax.Array, garbage: float) -> jax.Array:
        if leaf.dtype == bool:
            return leaf
        where = absent.reshape(*absent.shape, *[1] * (leaf.ndim - 2))
        return jnp.where(where, jnp.asarray(garbage, leaf.dtype), leaf)

    network = trained(rush, level)
    slope, q = gradient(network, seen)
    # Units are not learned.
    assert (float(slope.metres), float(slope.seconds)) == (0, 0)
    assert float(jnp.abs(slope.advantage[0].weight).max()) > 0
    for garbage in (-7, 0, 1e9):
        spoilt = each_exit(seen, partial(spoil, garbage=garbage))
        # Nodes that do not exist are -1, always.
        spoilt = eqx.tree_at(lambda one: one.local.onto, spoilt, seen.local.onto)
        other, spoilt_q = gradient(network, spoilt)
        np.testing.assert_allclose(np.asarray(spoilt_q)[~absent], np.asarray(q)[~absent], rtol=1e-5, atol=1e-4)
        for one, another in zip(jax.tree.leaves(slope), jax.tree.leaves(other), strict=True):
            assert jnp.isfinite(another).all()
            np.testing.assert_allclose(another, one, rtol=1e-3, atol=1e-2 * float(jnp.abs(one).max() + 1e-6))


@pytest.mark.parametrize("level", LEVELS)
def test_the_order_of_exits_does_not_matter(rush, sights, level: str) -> None:
    seen = sights[level]
    network, order = trained(rush, level), jnp.array([2, 0, 3, 1])
    turned = values(network, each_exit(seen, lambda leaf: leaf[:, order]))
    valid = np.asarray(seen.valid[:, order])
    np.testing.assert_allclose(
        np.asarray(turned)[valid], np.asarray(values(network, seen)[:, order])[valid], rtol=1e-4, atol=1e-3
    )


@pytest.mark.parametrize("dueling", [True, False])
def test_the_number_of_exits_does_not_matter(rush, sights, dueling: bool) -> None:
    seen = sights["live"]
    network = trained(rush, "live", dueling=dueling)
    q = np.asarray(values(network, seen))
    counts = np.asarray(seen.valid).sum(axis=1)
    assert set(counts.tolist()) == {2, 3, 4}
    # One more exit that does not exist, as on a map where another node has five.
    padded = each_exit(seen, lambda leaf: jnp.concatenate([leaf, jnp.zeros_like(leaf[:, :1])], axis=1))
    wider = np.asarray(values(network, padded))
    assert wider.shape == (15, 5)
    valid = np.asarray(seen.valid)
    np.testing.assert_allclose(wider[:, :4][valid], q[valid], rtol=1e-4, atol=1e-3)
    # And a node alone without those that do not exist.
    node = int(np.flatnonzero(counts == 3)[0])
    alone = jax.tree.map(lambda leaf: leaf[node][None], seen)
    fewer = values(network, each_exit(alone, lambda leaf: leaf[:, valid[node]]))
    np.testing.assert_allclose(fewer[0], q[node][valid[node]], rtol=1e-4, atol=1e-3)


# --- Places ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("node", "clock", "numbers"),
    [
        (0, 0, [10, 1]),
        (0, 50, [15, 2]),  # half-way from 10 to 20, and from 1 to 3
        (1, 125, [250, 6]),  # a quarter of the way from 200 to 400, and from 7 to 3
        (1, 200, [400, 3]),
        (0, 1e6, [40, 5]),
        (0, -5, [10, 1]),
    ],
)
def test_places_are_linear_in_time(node: int, clock: float, numbers: list[float]) -> None:
    table = jnp.array([[[10.0, 1], [100, 8]], [[20, 3], [200, 7]], [[40, 5], [400, 3]]])
    places = Places(table, 100.0)
    assert places(jnp.int32(node), jnp.float32(clock)).tolist() == pytest.approx(numbers)
    # several at once
    several = places(jnp.array([node, 1]), jnp.array([clock, 100], float))
    assert several.tolist() == [pytest.approx(numbers), pytest.approx([200, 7])]


def test_places_are_remembered_where_streets_lead_and_when(rush) -> None:
    params = replace(rush[2], level="local")
    network = fresh(rush, "local", dueling=False, potential=False)
    # Node 1 costs a unit in the bin at 1,800 s, and nothing at 900 s and at 2,700 s.
    network = eqx.tree_at(lambda net: net.places.table, network, network.places.table.at[2, 1, 0].set(1.0))
    _, seen = reset(params, Instance(*map(jnp.int32, (0, 15)), jnp.float32(600), jnp.int32(0)))
    seen = replace(seen, local=replace(seen.local, crossing=jnp.full(4, 975.0)))
    # Node 1 is to the right (exit 2), reached at 600 + 975 = 1,575 s, three quarters of the way to the bin.
    assert values(network, jax.tree.map(lambda leaf: leaf[None], seen))[0].tolist() == [0, 0, pytest.approx(7.5), 0]
