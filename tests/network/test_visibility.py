"""Lines across areas small enough to work out by hand, in metres."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from sidestep.network.visibility import MOST_CORNERS, STRETCH, AreaError, Lines, cross_area, free_space

SQUARE = [(0, 0), (100, 0), (100, 100), (0, 100)]


def crossed(outer, inner=(), entries=()) -> tuple[Lines, np.ndarray]:
    """Cross an area whose rings and entries are given as places."""
    places = list(dict.fromkeys([place for ring in [*outer, *inner, entries] for place in ring]))
    xy = np.array(places, float)
    number = {place: index for index, place in enumerate(places)}
    rings = [[np.array([number[place] for place in ring]) for ring in rings] for rings in (outer, inner)]
    lines = cross_area(xy, *rings, np.array([number[place] for place in entries], int))
    return lines, np.vstack([xy, lines.added])


def walks(lines: Lines, xy: np.ndarray) -> np.ndarray:
    """Lengths of the shortest walks between all nodes along the lines."""
    one, two = lines.ends.T
    metres = np.hypot(*(xy[one] - xy[two]).T)
    return dijkstra(coo_array((metres, (one, two)), shape=(len(xy),) * 2).tocsr(), directed=False)


def between(lines: Lines, xy: np.ndarray, start, stop) -> float:
    at = [int(np.flatnonzero((xy == place).all(axis=1))[0]) for place in (start, stop)]
    return float(walks(lines, xy)[tuple(at)])


def test_a_square_is_crossed_on_its_diagonal() -> None:
    lines, xy = crossed([SQUARE], entries=[(0, 0), (100, 100)])
    assert xy[lines.ends].tolist() == [[[0, 0], [100, 100]]]
    assert lines.width == pytest.approx(50)
    assert not len(lines.added)


@pytest.mark.parametrize("turn", [1, -1])
def test_rings_may_run_either_way_round(turn: int) -> None:
    hole = [(40, 40), (60, 40), (60, 60), (40, 60)]
    lines, xy = crossed([SQUARE[::turn]], [hole[::-turn]], entries=[(0, 0), (100, 100)])
    # round the corner (60, 40): twice the hypotenuse of 60 and 40
    assert between(lines, xy, (0, 0), (100, 100)) == pytest.approx(2 * np.hypot(60, 40))
    assert len(lines.ends) == 2
    assert lines.width == pytest.approx(2 * 9600 / 480)


def test_a_concave_corner_is_walked_round() -> None:
    corner = [(0, 0), (100, 0), (100, 20), (20, 20), (20, 100), (0, 100)]
    lines, xy = crossed([corner], entries=[(100, 20), (20, 100), (100, 0)])
    assert between(lines, xy, (100, 20), (20, 100)) == pytest.approx(160)
    assert between(lines, xy, (100, 0), (20, 100)) == pytest.approx(80 + np.hypot(80, 20))
    assert len(lines.ends) == 4


def test_a_narrow_area_is_as_wide_as_it_is() -> None:
    lines, _ = crossed([[(0, 0), (400, 0), (400, 4), (0, 4)]], entries=[(0, 0), (400, 4)])
    assert lines.width == pytest.approx(4, rel=0.02)


def test_entries_inside_are_joined_and_others_are_not() -> None:
    hole = [(40, 40), (60, 40), (60, 60), (40, 60)]
    lines, xy = crossed([SQUARE], [hole], entries=[(0, 0), (20, 10), (50, 50), (150, 50)])
    assert xy[lines.ends].tolist() == [[[0, 0], [20, 10]]]


def test_an_island_in_a_hole_is_apart() -> None:
    hole, island = [(20, 20), (80, 20), (80, 80), (20, 80)], [(40, 40), (60, 40), (60, 60), (40, 60)]
    lines, xy = crossed([island, SQUARE], [hole], entries=[(0, 0), (100, 0), (40, 40), (60, 60)])
    assert sorted(map(sorted, xy[lines.ends].tolist())) == [[[0, 0], [100, 0]], [[40, 40], [60, 60]]]


def test_many_entries_stay_cheap() -> None:
    angle = np.arange(40) * np.pi / 20
    xy = 50 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    lines = cross_area(xy, [np.arange(40)], [], np.arange(40))
    straight = np.hypot(*(xy[:, None] - xy[None]).T)
    assert (walks(lines, xy) <= STRETCH * straight + 1e-9).all()
    assert len(lines.ends) <= 620  # of 780: neighbours are reached along each other, diagonals are needed
    # Entries on straight sides are cheaper: the sides themselves are one line after another.
    places = [(i, 0) for i in range(0, 100, 10)] + [(100, i) for i in range(0, 100, 10)]
    places += [(100 - x, 100 - y) for x, y in places]
    lines, _ = crossed([places], entries=places)
    assert len(lines.ends) <= 410


def test_nobody_gets_through_where_holes_touch() -> None:
    # Two holes from wall to wall but for the touching point at (50, 50), and a way round them on the right.
    holes = [[(10, 40), (50, 50), (10, 60)], [(50, 50), (90, 40), (90, 60)]]
    lines, xy = crossed([SQUARE], holes, entries=[(50, 0), (50, 100)])
    round_right = 2 * np.hypot(40, 40) + 20
    assert between(lines, xy, (50, 0), (50, 100)) == pytest.approx(round_right)
    # An entry at that point is walked through.
    lines, xy = crossed([SQUARE], holes, entries=[(50, 0), (50, 100), (50, 50)])
    assert between(lines, xy, (50, 0), (50, 100)) == pytest.approx(100)


def test_nobody_gets_through_where_a_hole_touches_the_outline() -> None:
    on_a_corner = [(100, 100), (50, 50), (80, 90)]
    outline = [(0, 0), (100, 0), (100, 100), (0, 100)]
    lines, xy = crossed([outline], [on_a_corner], entries=[(100, 0), (0, 100)])
    assert between(lines, xy, (100, 0), (0, 100)) == pytest.approx(np.hypot(100, 100))
    # On the middle of a side that has no corner there.
    on_a_side = [(50, 0), (60, 30), (40, 30)]
    lines, xy = crossed([outline], [on_a_side], entries=[(0, 0), (100, 0)])
    assert between(lines, xy, (0, 0), (100, 0)) == pytest.approx(20 + 2 * np.hypot(40, 30))
    # From wall to wall: two areas.
    across = [(50, 0), (60, 50), (50, 100), (40, 50)]
    lines, xy = crossed([outline], [across], entries=[(0, 0), (100, 0), (0, 100)])
    assert xy[lines.ends].tolist() == [[[0, 0], [0, 100]]]


def test_a_ring_that_crosses_itself_is_repaired() -> None:
    # A square whose last two nodes were swapped: two triangles that touch in the middle.
    places = [(0, 0), (100, 0), (0, 100), (100, 100)]
    lines, xy = crossed([places], entries=places)
    assert sorted(map(sorted, xy[lines.ends].tolist())) == [[[0, 0], [100, 0]], [[0, 100], [100, 100]]]


def test_corners_that_repairing_makes_are_new_nodes() -> None:
    # Two holes that overlap in a cross, each of whose arms is a corner; the inner corners of the cross are new.
    flat, upright = [(10, 45), (90, 45), (90, 55), (10, 55)], [(45, 10), (55, 10), (55, 90), (45, 90)]
    lines, xy = crossed([SQUARE], [flat, upright], entries=[(0, 0), (40, 40), (100, 0), (60, 40)])
    assert between(lines, xy, (0, 0), (100, 0)) == pytest.approx(100)
    assert between(lines, xy, (40, 40), (60, 40)) == pytest.approx(2 * np.hypot(5, 30) + 10)
    # Where rings of the outline overlap, the corner between them is where the walk bends.
    lines, xy = crossed([SQUARE, [(80, 80), (200, 80), (200, 200), (80, 200)]], entries=[(100, 0), (200, 80)])
    assert lines.added.tolist() == [[100, 80]]
    assert between(lines, xy, (100, 0), (200, 80)) == pytest.approx(180)


def test_two_outer_rings_side_by_side_are_one_area() -> None:
    right = [(100, 0), (200, 0), (200, 100), (100, 100)]
    lines, xy = crossed([SQUARE, right], entries=[(0, 0), (200, 100)])
    assert xy[lines.ends].tolist() == [[[0, 0], [200, 100]]]


@pytest.mark.parametrize(
    ("outer", "inner", "expected"),
    [
        ([SQUARE], [], False),
        ([SQUARE], [[(40, 40), (60, 40), (60, 60)]], False),
        ([SQUARE, [(40, 40), (60, 40), (60, 60)]], [[(20, 20), (80, 20), (80, 80), (20, 80)]], False),  # an island
        ([[(0, 0), (100, 0), (0, 100), (100, 100)]], [], True),
        ([SQUARE, [(80, 80), (200, 80), (200, 200), (80, 200)]], [], True),
        ([SQUARE], [[(90, 40), (110, 40), (110, 60)]], True),
        ([SQUARE], [[(40, 40), (60, 40)]], True),
    ],
)
def test_broken_rings_are_told(outer, inner, expected: bool) -> None:
    rings = [[np.array(ring, float) for ring in rings] for rings in (outer, inner)]
    assert free_space(*rings)[1] == expected


@pytest.mark.parametrize("outer", [[(0, 0), (50, 0)], [(0, 0), (50, 0), (100, 0)], [(0, 0), (50, 0), (0, 0), (50, 0)]])
def test_rings_without_an_area(outer) -> None:
    with pytest.raises(AreaError, match="no area"):
        crossed([outer], entries=outer[:2])


def test_a_hole_as_large_as_its_area_leaves_none() -> None:
    with pytest.raises(AreaError, match="no area"):
        crossed([SQUARE], [SQUARE[::-1]], entries=SQUARE[:2])


def test_areas_with_too_many_corners_are_not_crossed() -> None:
    angle = np.linspace(0, 2 * np.pi, MOST_CORNERS + 2)[:-1]
    xy = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    everywhere = np.arange(len(xy))
    with pytest.raises(AreaError, match="corners"):
        cross_area(xy, [everywhere], [], everywhere)
    assert len(cross_area(xy, [everywhere], [], everywhere[:2]).ends) == 1


def test_entries_at_the_same_place_are_joined() -> None:
    xy = np.array([*SQUARE, (0, 0)], float)
    lines = cross_area(xy, [np.arange(4)], [], np.array([0, 2, 4]))
    assert walks(lines, xy)[[0, 4, 0], [2, 2, 4]] == pytest.approx([np.hypot(100, 100)] * 2 + [0])
