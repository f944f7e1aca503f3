"""The dueling network: its head by hand, its size, its inputs, what is trained, and how it begins."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent.layers import Linear
from sidestep.agent.presets import PRESETS, preset
from sidestep.agent.q_networks import DuelingQNetwork, QNetwork, QTable, dueling_network, tabulated, untrained
from sidestep.agent.segment_network import SegmentQNetwork
from sidestep.environment.types import Observation
from sidestep.network.graph import RoadNetwork
from sidestep.network.grid import grid_network
from sidestep.scenarios.builtin import scenario


@pytest.fixture(scope="module")
def grid() -> RoadNetwork:
    """The paper's 5 x 5 blocks."""
    return grid_network(6, np.random.default_rng(0))


def network_for(grid: RoadNetwork, name: str, seed: int = 0, **changes: object) -> DuelingQNetwork:
    """A fresh network as a preset has it, but with dueling heads in any case."""
    return dueling_network(PRESETS[name].changed(dueling=True, **changes), grid, jax.random.key(seed))


def everywhere(grid: RoadNetwork) -> Observation:
    """What is seen at every node."""
    return jax.vmap(Observation)(jnp.arange(grid.nodes), grid.position, grid.valid, jnp.zeros(grid.nodes, int))


values = eqx.filter_jit(lambda network, seen: jax.vmap(network)(seen))


# --- By hand --------------------------------------------------------------------------------------------------------


def test_a_network_by_hand() -> None:
    network = DuelingQNetwork(
        offset=jnp.array([100.0, 0.0]),
        scale=jnp.array([0.01, 0.1]),
        hidden=(Linear(jnp.array([[1.0, 2.0], [-1.0, 0.0]]), jnp.array([0.5, 1.0])),),
        value=Linear(jnp.array([[2.0, 1.0]]), jnp.array([3.0])),
        advantage=Linear(jnp.array([[1.0, 0.0], [0.0, 1.0], [3.0, 0.0]]), jnp.array([0.0, 5.0, 0.0])),
        crossings=0,
        unit=10.0,
    )
    seen = Observation(jnp.int32(0), jnp.array([300.0, 20.0]), jnp.array([True, True, False]), jnp.int32(0))
    # Inputs (300 - 100) / 100 = 2 and 20 / 10 = 2. Hidden: 2 + 4 + .5 = 6.5 and -2 + 1 = -1, which ReLU makes 0.
    # V = 13 + 3 = 16. A = 6.5, 5, (19.5); mean over the valid 5.75. Q = 10 (16 + .75) and 10 (16 - .75).
    assert network(seen)[:2].tolist() == [167.5, 152.5]


# --- Size -----------------------------------------------------------------------------------------------------------


def test_the_papers_network(grid: RoadNetwork) -> None:
    network = network_for(grid, "paper")
    shapes = [layer.weight.shape for layer in (*network.hidden, network.value, network.advantage)]
    assert shapes == [(50, 2), (50, 50), (1, 50), (4, 50)]
    trained = (network.hidden, network.value, network.advantage)
    # 2 * 50 + 50 = 150; 50 * 50 + 50 = 2,550; 50 * 1 + 1 = 51; 50 * 4 + 4 = 204: together 2,955.
    assert sum(leaf.size for leaf in jax.tree.leaves(trained)) == 2955
    # Beside these there are the two offsets and two scales of the input, and nothing else.
    assert sum(leaf.size for leaf in jax.tree.leaves(network)) == 2955 + 4


def test_the_default_network_knows_the_crossing(grid: RoadNetwork) -> None:
    network = network_for(grid, "default")
    assert network.crossings == 36
    # (2 + 36) * 50 + 50 = 1,950 instead of 150
    trained = (network.hidden, network.value, network.advantage)
    assert sum(leaf.size for leaf in jax.tree.leaves(trained)) == 2955 - 150 + 1950


# --- Inputs ---------------------------------------------------------------------------------------------------------


def inputs(network: DuelingQNetwork, seen: Observation) -> np.ndarray:
    """What the first layer is fed: a network without hidden layers whose value is one input after the other."""
    assert not network.hidden
    width = network.value.weight.shape[1]

    def one(row: jax.Array) -> jax.Array:
        bare = eqx.tree_at(
            lambda n: (n.value.weight, n.value.bias, n.advantage.weight, n.advantage.bias),
            network,
            (row[None], jnp.zeros(1), jnp.zeros((4, width)), jnp.zeros(4)),
        )
        return jax.vmap(bare)(seen)[:, 0]

    return np.asarray(jax.jit(jax.vmap(one, out_axes=1))(jnp.eye(width)))


def test_the_paper_feeds_coordinates_in_blocks(grid: RoadNetwork) -> None:
    fed = inputs(network_for(grid, "paper", hidden=()), everywhere(grid))
    node = np.arange(36)
    # Node y * 6 + x stands at column x and row y of 5 x 5 blocks: inputs from (0, 0) to (5, 5) (eq. 10).
    np.testing.assert_allclose(fed, np.stack([node % 6, node // 6], axis=1), atol=1e-5)


def test_the_default_feeds_centred_coordinates_and_the_crossing(grid: RoadNetwork) -> None:
    fed = inputs(network_for(grid, "default", hidden=(), unit=1.0), everywhere(grid))
    node = np.arange(36)
    # Column 0 to 5 becomes -1, -.6, -.2, .2, .6, 1.
    np.testing.assert_allclose(fed[:, 0], 0.4 * (node % 6) - 1, atol=1e-6)
    np.testing.assert_allclose(fed[:, 1], 0.4 * (node // 6) - 1, atol=1e-6)
    np.testing.assert_array_equal(fed[:, 2:], np.eye(36))


def test_unit_scales_the_values(grid: RoadNetwork) -> None:
    seen = everywhere(grid)
    one, ten = (values(network_for(grid, "default", unit=unit), seen) for unit in (1.0, 10.0))
    np.testing.assert_allclose(ten, 10 * one, rtol=1e-5)
    assert np.ptp(one) > 0


# --- Training and beginning -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", PRESETS)
def test_the_scaling_of_inputs_is_not_trained(grid: RoadNetwork, preset: str) -> None:
    network, seen = network_for(grid, preset), everywhere(grid)
    gradient = jax.jit(jax.grad(lambda n: jnp.sum(jax.vmap(n)(seen) ** 2)))(network)
    assert not gradient.offset.any()
    assert not gradient.scale.any()
    for layer in (*gradient.hidden, gradient.value, gradient.advantage):
        assert layer.weight.any()
        assert layer.bias.any()


@pytest.mark.parametrize("preset", PRESETS)
def test_initial_weights(grid: RoadNetwork, preset: str) -> None:
    network = network_for(grid, preset)
    layers = (*network.hidden, network.value, network.advantage)
    scaled = []
    for layer in layers:
        fan_in = layer.weight.shape[1]
        both = np.concatenate([np.asarray(layer.weight).ravel(), np.asarray(layer.bias)])
        assert np.abs(both).max() <= fan_in**-0.5
        scaled.append(both * fan_in**0.5)
    drawn = np.concatenate(scaled)
    # Uniform on ±1: the variance of n draws is 1/3 with a standard deviation of √(4/45 / n), 0.0055 for 2,955 of them.
    assert len(drawn) >= 2955
    np.testing.assert_allclose(drawn.var(), 1 / 3, atol=5 * 0.0055)
    np.testing.assert_allclose(drawn.mean(), 0, atol=5 * (3 * len(drawn)) ** -0.5)
    assert len(np.unique(drawn)) > 0.99 * len(drawn)  # no layer repeats the numbers of another


def test_another_key_gives_another_network(grid: RoadNetwork) -> None:
    seen = everywhere(grid)
    assert eqx.tree_equal(network_for(grid, "paper", seed=1), network_for(grid, "paper", seed=1))
    assert not np.allclose(
        values(network_for(grid, "paper", seed=1), seen), values(network_for(grid, "paper", seed=2), seen)
    )


# --- Which one a configuration has ----------------------------------------------------------------------------------


def test_configurations_have_the_network_that_they_ask_for(grid: RoadNetwork) -> None:
    problem, key = scenario("paper-congested"), jax.random.key(0)
    table = untrained(PRESETS["tabular-q"], problem, grid, key)
    assert isinstance(table, QTable)
    assert table.q.shape == (36, 4)
    position = untrained(PRESETS["default"], problem, grid, key)
    assert eqx.tree_equal(position, network_for(grid, "default"))
    local = untrained(preset("default", "local"), problem, grid, key)
    assert isinstance(local, SegmentQNetwork)
    assert local.reward_seconds == problem.reward.unit_seconds
    # A day of quarters of an hour, each with 8 numbers for every node.
    assert local.places is not None
    assert local.places.table.shape == (97, 36, 8)
    assert untrained(preset("default", "live"), problem, grid, key).places is None


def test_a_table_of_a_network_is_the_same_function_with_the_same_gradient(grid: RoadNetwork) -> None:
    node = jnp.array([4, 0, 8, 4])
    seen = jax.tree.map(lambda leaf: leaf[node], everywhere(grid))

    def loss(q_network: QNetwork) -> jax.Array:
        return jnp.sum(jnp.where(seen.valid, jax.vmap(q_network)(seen), 0.0) ** 2)

    def of_table(q_network: QNetwork) -> jax.Array:
        return loss(tabulated(q_network, grid, jnp.int32(35)))

    q_network = network_for(grid, "default")
    (one, slope), (other, by_table) = (
        eqx.filter_jit(eqx.filter_value_and_grad(each))(q_network) for each in (loss, of_table)
    )
    assert float(one) == pytest.approx(float(other))
    assert eqx.tree_equal(slope, by_table, rtol=1e-4, atol=1e-4)
