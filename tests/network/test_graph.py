"""The tables of a network by hand, the paper's D and P, invalid networks, and networks joined into one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.base import FlowField
from sidestep.network.graph import NetworkError, RoadNetwork, disjoint_union, road_network
from sidestep.network.grid import grid_network

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
    futures = FlowField(jnp.stack([field.counted, 2 * field.counted]))
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
    ("changes", "field", "item"),
    [
        (dict(tail=[], head=[], length=[]), "tail", "0 tails"),
        (dict(tail=[0, 1, 2]), "tail", "3 tails"),
        (dict(head=[1, 2, 0]), "tail", "3 heads"),
        (dict(length=[300]), "tail", "1 lengths"),
        (dict(width=[1, 1]), "width", "2 widths"),
        (dict(tail=[0, 1, -1, 0]), "tail", "segment 2 is -1"),
        (dict(tail=[0, 3, 2, 0]), "tail", "segment 1 is 3"),
        (dict(head=[1, 2, 0, 3]), "head", "segment 3 is 3"),
        (dict(head=[-2, 2, 0, 2]), "head", "segment 0 is -2"),
        (dict(head=[1, 1, 0, 2]), "head", "segment 1 is 1"),  # a loop
        (dict(length=[300, 0, 400, 450]), "length", "segment 1 is 0.0"),
        (dict(length=[300, 500, 400, -1]), "length", "segment 3 is -1.0"),
        (dict(length=[300, 500, np.nan, 450]), "length", "segment 2 is nan"),
        (dict(length=[np.inf, 500, 400, 450]), "length", "segment 0 is inf"),
        (dict(width=0), "width", "segment 0 is 0.0"),
        (dict(width=[1, 1, -2, 1]), "width", "segment 2 is -2.0"),
        (dict(exit_of=[0, 0, 0, 0]), "exit_of", "segment 3 is 0"),  # as segment 0, with the same tail
        (dict(exit_of=[0, 0, 0, -1]), "exit_of", "segment 3 is -1"),
        (dict(exit_of=[0, 0, 0, 3], exits=2), "exit_of", "segment 3 is 3"),
    ],
)
def test_invalid_networks(changes: dict, field: str, item: str) -> None:
    with pytest.raises(NetworkError, match=item) as caught:
        triangle(**changes)
    assert caught.value.field == field


@pytest.fixture(scope="module")
def loop() -> RoadNetwork:
    """One-way 0 > 1 > 2 > 0 and 2 > 1: at most two exits."""
    return road_network(
        np.array([[0, 0], [300, 0], [0, 400]]), [0, 1, 2, 2], [1, 2, 0, 1], [300, 500, 400, 501], width=2.0
    )


@pytest.fixture(scope="module")
def street() -> RoadNetwork:
    """One street there and back: one exit each."""
    return road_network(np.array([[5, 5], [5, 15]]), [1, 0], [0, 1], [10, 11], width=3.0)


def test_nodes_and_segments_follow_each_other(loop, street) -> None:
    both = disjoint_union([street, loop])
    assert (both.nodes, both.segments, both.exits) == (5, 6, 2)
    # The street's nodes 0 and 1 stay, the loop's become 2, 3, 4; its segments 0 to 3 become 2 to 5.
    assert both.exit_node.tolist() == [[1, -1], [0, -1], [3, -1], [4, -1], [2, 3]]
    assert both.exit_segment.tolist() == [[1, -1], [0, -1], [2, -1], [3, -1], [4, 5]]
    assert both.tail.tolist() == [1, 0, 2, 3, 4, 4]
    assert both.head.tolist() == [0, 1, 3, 4, 2, 3]
    assert both.length.tolist() == [10, 11, 300, 500, 400, 501]
    assert both.width.tolist() == [3, 3, 2, 2, 2, 2]
    assert both.position.tolist() == [[5, 5], [5, 15], [0, 0], [300, 0], [0, 400]]


def test_the_order_is_that_given(loop, street) -> None:
    both = disjoint_union([loop, street])
    assert both.exit_node.tolist() == [[1, -1], [2, -1], [0, 1], [4, -1], [3, -1]]
    assert both.length.tolist() == [300, 500, 400, 501, 10, 11]


def test_no_street_leads_from_one_to_another(loop, street) -> None:
    networks = [loop, grid_network(3, np.random.default_rng(1)), street, loop]
    several = disjoint_union(networks)
    assert (several.nodes, several.segments, several.exits) == (3 + 9 + 2 + 3, 4 + 24 + 2 + 4, 4)
    part = np.repeat(np.arange(4), [network.nodes for network in networks])
    assert (part[several.tail] == part[several.head]).all()
    distance = np.asarray(several.distance_matrix())
    assert (distance[part[:, None] != part] == -1).all()
    # and every part is what it was
    for number, network in enumerate(networks):
        here = part == number
        np.testing.assert_array_equal(distance[np.ix_(here, here)], network.distance_matrix())


def test_exits_and_ends_agree(loop, street) -> None:
    several = disjoint_union([street, loop, street])
    node, way = np.nonzero(np.asarray(several.valid))
    segment = np.asarray(several.exit_segment)[node, way]
    assert sorted(segment.tolist()) == list(range(several.segments))
    np.testing.assert_array_equal(np.asarray(several.tail)[segment], node)
    np.testing.assert_array_equal(np.asarray(several.head)[segment], np.asarray(several.exit_node)[node, way])


def test_one_alone_stays_what_it_is(loop) -> None:
    assert disjoint_union([loop]) is loop


def test_types_stay(loop, street) -> None:
    both = disjoint_union([street, loop])
    assert [leaf.dtype for leaf in jax.tree.leaves(both)] == [leaf.dtype for leaf in jax.tree.leaves(loop)]
