"""Several networks as one: what is shifted, what is padded, and that no street leads from one to another."""

import jax
import numpy as np
import pytest

from sidestep.network.graph import RoadNetwork, disjoint_union, road_network
from sidestep.network.grid import grid_network


@pytest.fixture(scope="module")
def triangle() -> RoadNetwork:
    """One-way 0 > 1 > 2 > 0 and 2 > 1: at most two exits."""
    return road_network(
        np.array([[0, 0], [300, 0], [0, 400]]), [0, 1, 2, 2], [1, 2, 0, 1], [300, 500, 400, 501], width=2.0
    )


@pytest.fixture(scope="module")
def street() -> RoadNetwork:
    """One street there and back: one exit each."""
    return road_network(np.array([[5, 5], [5, 15]]), [1, 0], [0, 1], [10, 11], width=3.0)


def test_nodes_and_segments_follow_each_other(triangle, street) -> None:
    both = disjoint_union([street, triangle])
    assert (both.nodes, both.segments, both.exits) == (5, 6, 2)
    # The street's nodes 0 and 1 stay, the triangle's become 2, 3, 4; its segments 0 to 3 become 2 to 5.
    assert both.exit_node.tolist() == [[1, -1], [0, -1], [3, -1], [4, -1], [2, 3]]
    assert both.exit_segment.tolist() == [[1, -1], [0, -1], [2, -1], [3, -1], [4, 5]]
    assert both.tail.tolist() == [1, 0, 2, 3, 4, 4]
    assert both.head.tolist() == [0, 1, 3, 4, 2, 3]
    assert both.length.tolist() == [10, 11, 300, 500, 400, 501]
    assert both.width.tolist() == [3, 3, 2, 2, 2, 2]
    assert both.position.tolist() == [[5, 5], [5, 15], [0, 0], [300, 0], [0, 400]]


def test_the_order_is_that_given(triangle, street) -> None:
    both = disjoint_union([triangle, street])
    assert both.exit_node.tolist() == [[1, -1], [2, -1], [0, 1], [4, -1], [3, -1]]
    assert both.length.tolist() == [300, 500, 400, 501, 10, 11]


def test_no_street_leads_from_one_to_another(triangle, street) -> None:
    networks = [triangle, grid_network(3, np.random.default_rng(1)), street, triangle]
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


def test_exits_and_ends_agree(triangle, street) -> None:
    several = disjoint_union([street, triangle, street])
    node, way = np.nonzero(np.asarray(several.valid))
    segment = np.asarray(several.exit_segment)[node, way]
    assert sorted(segment.tolist()) == list(range(several.segments))
    np.testing.assert_array_equal(np.asarray(several.tail)[segment], node)
    np.testing.assert_array_equal(np.asarray(several.head)[segment], np.asarray(several.exit_node)[node, way])


def test_one_alone_stays_what_it_is(triangle) -> None:
    assert disjoint_union([triangle]) is triangle


def test_types_stay(triangle, street) -> None:
    both = disjoint_union([street, triangle])
    assert [leaf.dtype for leaf in jax.tree.leaves(both)] == [leaf.dtype for leaf in jax.tree.leaves(triangle)]
