"""Fields: densities from volumes, and from densities at sensors."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.base import FlowField, SensedField
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.network.graph import RoadNetwork, road_network


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    """Node 0 to 1 and back, 100 m; 2 m and 4 m wide."""
    return road_network(np.zeros((2, 2)), [0, 1], [1, 0], [100, 100], width=[2, 4])


def test_densities_from_volumes(network: RoadNetwork) -> None:
    field = FlowField(jnp.array([[100.0, 400], [0, 200]]), 60.0)
    assert field.density(network).tolist() == [[0.5, 1], [0, 0.5]]
    assert field.counted.tolist() == [[100, 400], [0, 200]]
    other = replace(field, counted=jnp.array([[200.0, 0]]))
    assert (other.density(network).tolist(), other.slot_seconds) == ([[1, 0]], 60)
    assert not field.interpolated


def test_the_flow_matrix_of_the_paper(network: RoadNetwork) -> None:
    field = FlowField(jnp.array([[100.0, 400], [0, 200]]), 60.0)
    assert field.flow_matrix(network, 1).tolist() == [[-1, 0], [200, -1]]


def test_densities_from_sensors(network: RoadNetwork) -> None:
    weights = InterpolationWeights(jnp.array([[0, 1], [1, 0]]), jnp.array([[0.5, 0.25], [1.0, 0.0]]))
    sensed = jnp.array([[[2.0, 4], [1, 8]], [[4.0, 8], [3, 16]]])  # [future, slot, sensor]
    field = SensedField(sensed, weights, 60.0)
    every = field.density(network)
    # .5 * 2 + .25 * 4 and 4
    assert every[0].tolist() == [[2, 4], [2.5, 8]]
    assert field.interpolated
    assert field.counted is sensed
    assert field.density_at(jnp.int32(1), jnp.array([1, 0]), jnp.int32(1)).tolist() == every[1, 1, ::-1].tolist()
    assert field.densities(jnp.int32(1), jnp.int32(0)).tolist() == every[1, :, 0].tolist()
    assert replace(field, counted=2 * sensed).density(network).tolist() == (2 * every).tolist()
