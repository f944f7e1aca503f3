"""Ways drawn over a square of 100 m whose nodes they do not share; nodes 0 to 3 are its corners."""

import numpy as np
import pytest
import shapely

from sidestep.network.meetings import Meetings, Polylines, find_meetings

SQUARE = [(0, 0), (100, 0), (100, 100), (0, 100)]


def meet(ways, nodes, storeys=None, more=()) -> Meetings:
    """Let ways of the nodes given, numbered from 4, meet the square, and further areas of nodes."""
    outlines = [[0, 1, 2, 3, 0], *more]
    rows = [*ways, *outlines]
    xy = np.array([*SQUARE, *nodes], float)
    lines = Polylines(
        xy=xy,
        node=np.concatenate(rows).astype(np.int64),
        line=np.repeat(np.arange(len(rows)), list(map(len, rows))),
        storey=np.array(storeys or [0] * len(rows), np.int64),
        area=np.array([-1] * len(ways) + list(range(len(outlines))), np.int64),
    )
    return find_meetings(lines, [shapely.Polygon(xy[outline]) for outline in outlines])


def inserted(found: Meetings) -> list[tuple[int, int]]:
    return sorted(zip(found.after.tolist(), found.node.tolist(), strict=True))


def test_a_way_across_gets_a_node_at_each_side() -> None:
    found = meet([[4, 5]], [(50, -30), (50, 130)])
    assert found.added.tolist() == [[50, 0], [50, 100]]
    # After the way's first stop, in its order; and after the first and the third corner, at stops 2 and 4.
    assert inserted(found) == [(0, 6), (0, 7), (2, 6), (4, 7)]
    assert not len(found.inside)


def test_a_way_that_ends_inside_is_entered_there() -> None:
    found = meet([[4, 5, 6], [7, 6]], [(50, -30), (50, 40), (60, 50), (70, 50)])
    # The bend at node 5 is nowhere to leave the way; node 6 is where two ways end, and node 7 where one does.
    assert found.inside.tolist() == [[0, 6], [0, 7]]
    assert found.added.tolist() == [[50, 0]]


def test_a_node_on_the_outline_becomes_one_of_it() -> None:
    found = meet([[4, 5]], [(50, -30), (50, 0.05)])
    assert inserted(found) == [(2, 5)]
    # A corner of the outline that a way passes becomes one of the way.
    found = meet([[4, 5]], [(-50, 50), (50, -50)])
    assert inserted(found) == [(0, 0)]


@pytest.mark.parametrize("way", [[0, 2], [4, 0, 5], [4, 5, 1]])
def test_shared_nodes_are_left_alone(way) -> None:
    assert not len(meet([way], [(-20, -30), (-40, -20)]).node)


def test_ways_on_other_storeys_do_not_meet_it() -> None:
    for storeys in ([1, 0], [-1, 0], [0, -1], [-1, -1]):
        found = meet([[4, 5, 6]], [(50, -30), (50, 50), (50, 60)], storeys)
        assert not len(found.node)
        assert not len(found.inside)


def test_areas_that_overlap_meet_where_their_outlines_cross() -> None:
    found = meet([], [(50, 50), (150, 50), (150, 150), (50, 150)], more=[[4, 5, 6, 7, 4]])
    assert sorted(found.added.tolist()) == [[50, 100], [100, 50]]
    assert [after for after, _ in inserted(found)] == [1, 2, 5, 8]


def test_a_corner_on_a_side_of_another_area_joins_them() -> None:
    # A small square beside the large one, on whose side it lies with two corners.
    found = meet([], [(100, 20), (120, 20), (120, 40), (100, 40)], more=[[4, 5, 6, 7, 4]])
    assert inserted(found) == [(1, 4), (1, 7)]


def test_lines_with_absent_nodes_or_none_at_all() -> None:
    found = meet([[4, 5, 6]], [(50, -30), (np.nan, np.nan), (50, 50)])
    assert not len(found.node)
    assert not len(meet([], []).node)
