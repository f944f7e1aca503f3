"""Whatever the rings, lines across an area stay within it, and walks along them are hardly longer than the shortest."""

from itertools import combinations, pairwise

import numpy as np
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from sidestep.network.visibility import STRETCH, AreaError, cross_area

OUTLINE = st.lists(
    st.tuples(st.integers(0, 35), st.integers(3, 20)), min_size=3, max_size=14, unique_by=lambda at: at[0]
)
HOLE = st.tuples(st.integers(-12, 12), st.integers(-12, 12), st.integers(1, 6), st.integers(1, 6), st.booleans())


def star(points) -> np.ndarray:
    turn, radius = np.array(sorted(points)).T
    angle = turn * np.pi / 18
    return np.round(radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1) * 2) / 2


def hole(x: int, y: int, width: int, height: int, rhombus: bool) -> np.ndarray:
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)] if not rhombus else [(-1, 0), (0, -1), (1, 0), (0, 1)])
    return corners * [width, height] / 2 + [x, y]


def shortest(ends, xy) -> np.ndarray:
    one, two = np.array(ends, int).reshape(-1, 2).T
    metres = np.maximum(np.hypot(*(xy[one] - xy[two]).T), 1e-9)
    return dijkstra(coo_array((metres, (one, two)), shape=(len(xy),) * 2).tocsr(), directed=False)


def geodesics(area, entries) -> np.ndarray:
    """Find the shortest walks by testing every line between corners."""
    xy = np.concatenate([entries, np.unique(shapely.get_coordinates(area), axis=0)])
    shapely.prepare(area)
    pairs = np.array(list(combinations(range(len(xy)), 2)))
    seen = shapely.covers(area, shapely.linestrings(xy[pairs])) | (xy[pairs[:, 0]] == xy[pairs[:, 1]]).all(axis=1)
    return shortest(pairs[seen], xy)[: len(entries), : len(entries)]


@settings(max_examples=150)
@given(OUTLINE, st.lists(HOLE, max_size=4), st.data())
def test_walks_across_an_area(points, holes, data) -> None:
    rings = [star(points), *(hole(*each) for each in holes)]
    area = shapely.make_valid(shapely.Polygon(rings[0]), method="structure", keep_collapsed=False)
    area = area.difference(shapely.union_all([shapely.Polygon(ring) for ring in rings[1:]]))
    first = np.cumsum([0, *map(len, rings)])
    xy = np.concatenate([*rings, [[0.5, 0.5], [-2.5, 1.5]]])
    numbers = [np.arange(*border) for border in pairwise(first)]
    entries = np.array(data.draw(st.lists(st.integers(0, len(xy) - 1), min_size=2, max_size=12, unique=True)), int)
    try:
        lines = cross_area(xy, numbers[:1], numbers[1:], entries)
    except AreaError:
        assert area.area == 0
        return
    all_xy = np.vstack([xy, lines.added])
    # Union and difference may move corners by rounding; nothing else is allowed.
    within = shapely.covers(area.buffer(1e-6), shapely.linestrings(all_xy[lines.ends]))
    assert within.all()
    walked, least = shortest(lines.ends, all_xy)[np.ix_(entries, entries)], geodesics(area, xy[entries])
    assert (walked >= least - 1e-6).all()
    borders = shapely.get_rings(shapely.get_parts(area))
    assume(all(one.distance(two) > 0 for one, two in combinations(borders, 2)))
    apart = least > 1e-6
    np.testing.assert_array_equal(np.isfinite(walked)[apart], np.isfinite(least)[apart])
    finite = np.isfinite(least) & apart
    assert (walked[finite] <= STRETCH * least[finite] + 1e-6).all()
