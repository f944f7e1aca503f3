"""The tables of a network by hand, the paper's D and P, and every network that cannot be."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.base import FlowField
from sidestep.network.graph import NetworkError, RoadNetwork, road_network

CORNERS = np.array([[0, 0], [300, 0], [0, 400]])


def triangle(**changes) -> RoadNetwork:
    """One-way 0 > 1 > 2 > 0, and 0 > 2."""
    good = dict(position=CORNERS, tail=[0, 1, 2, 0], head=[1, 2, 0, 2], length=[300, 500, 400, 450])
    return road_network(**(good | changes))


def test_tables() -> None:
    network = triangle()
    assert (network.nodes, network.exits, network.segments) == (3, 2, 4)
    # Node 0 has the segments 0 and 3, in the order given; the others have one exit, padded with -1.
    assert network.exit_node.tolist() == [[1, 2], [2, -1], [0, -1]]
    assert network.exit_segment.tolist() == [[0, 3], [1, -1], [2, -1]]
    assert network.valid.tolist() == [[True, True], [True, False], [True, False]]
    assert network.tail.tolist() == [0, 1, 2, 0]
    assert network.head.tolist() == [1, 2, 0, 2]
    assert network.width.tolist() == [1, 1, 1, 1]


def test_exits_may_be_chosen_and_padded() -> None:
    network = triangle(exit_of=[2, 0, 1, 0], exits=4)
    assert network.exit_node.tolist() == [[2, -1, 1, -1], [2, -1, -1, -1], [-1, 0, -1, -1]]
    assert network.exit_segment.tolist() == [[3, -1, 0, -1], [1, -1, -1, -1], [-1, 2, -1, -1]]


def test_default_exits_do_not_need_tails_in_order() -> None:
    network = triangle(tail=[2, 0, 1, 0], head=[0, 1, 2, 2])
    assert network.exit_segment.tolist() == [[1, 3], [2, -1], [0, -1]]


def test_widths_one_for_all_or_one_for_each() -> None:
    assert triangle(width=3).width.tolist() == [3, 3, 3, 3]
    assert triangle(width=[1, 2, 3, 4]).width.tolist() == [1, 2, 3, 4]


def test_distance_matrix_has_minus_one_where_no_segment_leads() -> None:
    assert triangle().distance_matrix().tolist() == [[-1, 300, 450], [-1, -1, 500], [400, -1, -1]]


def test_flow_matrix_of_one_slot() -> None:
    field = FlowField(jnp.array([[1.0, 2, 3, 4], [50, 60, 70, 80]]))
    assert field.flow_matrix(triangle(), 0).tolist() == [[-1, 1, 4], [-1, -1, 2], [3, -1, -1]]
    assert field.flow_matrix(triangle(), 1).tolist() == [[-1, 50, 80], [-1, -1, 60], [70, -1, -1]]


def test_density_is_volume_over_area() -> None:
    field = FlowField(jnp.array([[300.0, 500, 400, 450], [600, 50, 4, 0]]))
    # 600 / (300 * 2) = 1;  50 / (500 * 1) = .1;  4 / (400 * .5) = .02
    density = field.density(triangle(width=[2, 1, 0.5, 1]))
    np.testing.assert_allclose(density, [[0.5, 1, 2, 1], [1, 0.1, 0.02, 0]], rtol=1e-6)
    futures = FlowField(jnp.stack([field.volume, 2 * field.volume]))
    np.testing.assert_allclose(futures.density(triangle())[1], 2 * field.density(triangle()), rtol=1e-6)


def test_straight_line() -> None:
    network = triangle()
    # 3-4-5 triangle
    assert float(network.straight_line(jnp.int32(1), jnp.int32(2))) == pytest.approx(500)
    assert float(network.straight_line(jnp.int32(2), jnp.int32(2))) == 0


def test_a_network_is_a_pytree_of_single_precision_and_four_byte_integers() -> None:
    kinds = {str(leaf.dtype) for leaf in jax.tree.leaves(triangle())}
    assert kinds == {"float32", "int32"}


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        (dict(tail=[], head=[], length=[]), ["needs segments", "0 tails"]),
        (dict(tail=[0, 1, 2]), ["3 tails", "4 heads"]),
        (dict(head=[1, 2, 0]), ["3 heads"]),
        (dict(length=[300]), ["1 lengths"]),
        (dict(tail=[0, 1, -1, 0]), ["segment 2", "tail -1", "3 nodes"]),
        (dict(tail=[0, 3, 2, 0]), ["segment 1", "tail 3", "3 nodes"]),
        (dict(head=[1, 2, 0, 3]), ["segment 3", "head 3"]),
        (dict(head=[-2, 2, 0, 2]), ["segment 0", "head -2"]),
        (dict(length=[300, 0, 400, 450]), ["segment 1", "length 0.0 m", "positive"]),
        (dict(length=[300, 500, 400, -1]), ["segment 3", "length -1.0 m"]),
        (dict(length=[300, 500, np.nan, 450]), ["segment 2", "length nan"]),
        (dict(length=[np.inf, 500, 400, 450]), ["segment 0", "length inf"]),
        (dict(width=0), ["segment 0", "width 0.0 m"]),
        (dict(width=[1, 1, -2, 1]), ["segment 2", "width -2.0 m"]),
        (dict(width=[1, 1]), ["4 segments", "2 widths"]),
        (dict(exit_of=[0, 0, 0, 0]), ["segments 0 and 3", "exit 0 of node 0"]),
        (dict(exit_of=[0, 0, 0, -1]), ["numbered 0 to", "-1"]),
        (dict(exit_of=[0, 0, 0, 3], exits=2), ["numbered 0 to 1", "to 3"]),
        (dict(head=[1, 1, 0, 2]), ["segment 1", "begins and ends at node 1"]),
    ],
)
def test_networks_that_cannot_be(changes: dict, names: list[str]) -> None:
    with pytest.raises(NetworkError) as caught:
        triangle(**changes)
    for name in names:
        assert name in str(caught.value)
