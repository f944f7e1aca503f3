"""Rings from pieces in any order and direction."""

from itertools import permutations

import pytest

from sidestep.network.rings import closed_rings


def turned(ring: list[int]) -> list[int]:
    """Write a ring in one way: from its least node, towards the lesser neighbour."""
    nodes = ring[:-1]
    start = nodes.index(min(nodes))
    nodes = nodes[start:] + nodes[:start]
    return [nodes[0], *min(nodes[1:], nodes[:0:-1])]


@pytest.mark.parametrize("pieces", list(permutations([(1, 2, 3), (5, 4, 3), (5, 6, 1)])))
def test_pieces_are_joined_in_any_order_and_direction(pieces) -> None:
    rings, gaps = closed_rings(pieces)
    assert [turned(ring) for ring in rings] == [[1, 2, 3, 4, 5, 6]]
    assert rings[0][0] == rings[0][-1]
    assert not gaps


def test_several_rings() -> None:
    rings, gaps = closed_rings([(1, 2, 3, 1), (4, 5), (7, 8, 9), (5, 6, 4), (9, 7)])
    assert sorted(turned(ring) for ring in rings) == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    assert not gaps


def test_what_does_not_close_is_told() -> None:
    rings, gaps = closed_rings([(3, 4), (1, 2), (2, 3), (8, 9, 8), (7,), ()])
    assert rings == [[8, 9, 8]]
    assert [min(gap, gap[::-1]) for gap in gaps] == [[1, 2, 3, 4]]


def test_no_pieces() -> None:
    assert closed_rings([]) == ([], [])
