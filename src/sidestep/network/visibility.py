"""Straight lines across squares and other areas: from entry to entry, round holes and corners, few enough to be cheap.

A shortest walk through an area bends only at its corners, so entries and reflex corners that see each other are joined
(a visibility graph). Of these lines as many are kept as every walk between two entries needs to be at most ``STRETCH``
times as long as the shortest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float64, Int, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

STRETCH = 1.02
"""How many times as long as the shortest a walk across an area may be."""
MOST_CORNERS = 300
"""Entries and reflex corners of one area; larger areas are not crossed."""

_STRAIGHT = 1e-9  # sine of the turn up to which a corner may be one to go round: rounding must not close a way
_TOUCHING = 1e-3  # m; a line that passes a point where borders touch by less leads through a gap of no width


class AreaError(ValueError):
    """An area that is not crossed; the message is the reason, as reports have it."""


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines across one area."""

    ends: Int64[np.ndarray, "line 2"]
    """Nodes that each line joins; those after the last node given are new ones."""
    added: Float64[np.ndarray, "new 2"]
    """Metres east and north of new nodes: corners that come from repairing the rings."""
    width: float
    """Metres: twice the area by its perimeter, the width of a strip and half the side of a square."""


@dataclass(frozen=True, eq=False)
class _Corners:
    """Corners of a polygon that a walk may go round, with the directions between which the polygon lies there."""

    xy: Float64[np.ndarray, "corner 2"]
    begin: Float64[np.ndarray, "corner 2"]
    end: Float64[np.ndarray, "corner 2"]
    touching: Bool[np.ndarray, " corner"]
    pinches: Float64[np.ndarray, "pinch 2"]


def cross_area(
    xy: Float64[np.ndarray, "node 2"],
    outer: Sequence[Int[np.ndarray, " _"]],
    inner: Sequence[Int[np.ndarray, " _"]],
    entries: Int[np.ndarray, " entry"],
) -> Lines:
    """Join the entries of an area by straight lines within it.

    Rings that cross themselves or each other are repaired; where borders merely touch, nobody gets through, except by
    an entry.

    Parameters
    ----------
    xy
        Metres east and north of all nodes.
    outer, inner
        Nodes of the rings around the area and around its holes, each once; a hole may have an island, which is outer.
    entries
        Nodes on the rings or inside where walks come in and leave; those that are neither are not joined.

    Returns
    -------
    Lines
        Every walk between two entries along them is at most ``STRETCH`` times as long as the shortest within the area.

    Raises
    ------
    AreaError
        No area left within the rings, or more than ``MOST_CORNERS`` entries and corners.
    """
    parts, _ = free_space([xy[ring] for ring in outer], [xy[ring] for ring in inner])
    nodes = np.concatenate([*outer, *inner, entries])
    number = dict(zip(map(tuple, xy[nodes].tolist()), nodes.tolist(), strict=True))  # of two at one place the entry
    added: list[tuple[float, float]] = []
    lines = []
    for part in parts:
        shapely.prepare(part)
        here = entries[shapely.intersects_xy(part, *xy[entries].T)]
        corners = _corners(part)
        free = ~np.isin([number.get((x, y), -1) for x, y in corners.xy.tolist()], here)
        if len(here) + free.sum() > MOST_CORNERS:
            raise AreaError("too many corners")
        ends, at = _visible(part, xy[here], corners, np.flatnonzero(free))
        ends = _thin(ends, at, len(here))
        for corner in np.unique(ends[ends >= len(here)]).tolist():
            place = (float(at[corner, 0]), float(at[corner, 1]))
            if place not in number:
                number[place] = len(xy) + len(added)
                added.append(place)
        name = np.array([*here.tolist(), *(number.get((x, y), -1) for x, y in at[len(here) :].tolist())], np.int64)
        lines.append(name[ends])
    area, perimeter = (float(measure(parts).sum()) for measure in (shapely.area, shapely.length))
    return Lines(np.concatenate(lines), np.array(added).reshape(-1, 2), 2 * area / perimeter)


def free_space(
    outer: Sequence[Float64[np.ndarray, "_ 2"]], inner: Sequence[Float64[np.ndarray, "_ 2"]]
) -> tuple[list[shapely.Polygon], bool]:
    """Build valid polygons of rings.

    Parameters
    ----------
    outer, inner
        Corners of the rings around the area and around its holes, each once, in metres.

    Returns
    -------
    list, bool
        Polygons that do not overlap, the exterior anticlockwise and holes clockwise; and whether rings crossed
        themselves or each other, or were none.

    Raises
    ------
    AreaError
        No area is left within the rings.
    """
    polygons, holes = ([shapely.Polygon(ring) for ring in rings if len(ring) >= 3] for rings in (outer, inner))
    broken = len(polygons) < len(outer) or len(holes) < len(inner)
    if len(outer) == len(polygons) == 1:
        area = shapely.Polygon(polygons[0].exterior, [hole.exterior for hole in holes])
        if area.is_valid:
            return _parts(area), broken
    sound, gaps = (shapely.make_valid(rings, method="structure", keep_collapsed=False) for rings in (polygons, holes))
    # An outer ring in a hole is an island there; one in another outer ring is a hole that lacks its role.
    islands = [_lies_in(polygon, gaps).any() for polygon in sound]
    loose = np.array([_lies_in(polygon, sound).any() for polygon in sound], bool) & ~np.array(islands, bool)
    sound, gaps = sound[~loose], np.append(gaps, sound[loose])
    area = shapely.Polygon()
    for polygon in sound:
        area = area.union(polygon.difference(shapely.union_all(gaps[~_lies_in(polygon, gaps)])))
    nested = np.isclose(area.area, shapely.area(sound).sum() - shapely.area(gaps).sum())
    return _parts(area), broken or not nested or not shapely.is_valid([*polygons, *holes]).all()


def _lies_in(polygon: shapely.Geometry, others: np.ndarray) -> Bool[np.ndarray, " other"]:
    return shapely.covers(others, polygon) & ~shapely.equals(others, polygon)


def _parts(area: shapely.Geometry) -> list[shapely.Polygon]:
    parts = shapely.get_parts(area)
    parts = parts[(shapely.get_type_id(parts) == shapely.GeometryType.POLYGON) & (shapely.area(parts) > 0)]
    if not len(parts):
        raise AreaError("no area within its rings")
    return list(shapely.orient_polygons(parts))


def _corners(polygon: shapely.Polygon) -> _Corners:
    """Find the corners of a polygon at which it takes up half of the directions or more."""
    rings = _with_touching_points([shapely.get_coordinates(ring) for ring in (polygon.exterior, *polygon.interiors)])
    # Two corners may be in the same place; a side without length leads nowhere.
    xy = np.concatenate(rings := [ring[(ring != np.roll(ring, 1, axis=0)).any(axis=1)] for ring in rings])
    end = np.concatenate([np.roll(ring, 1, axis=0) for ring in rings]) - xy
    begin = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings]) - xy
    _, place, times = np.unique(xy, axis=0, return_inverse=True, return_counts=True)
    touching = (times > 1)[place]
    borders = end.copy()
    for corner in np.flatnonzero(touching).tolist():
        # From the border that begins here anticlockwise, the polygon ends at the nearest border.
        ends = borders[place == place[corner]]
        end[corner] = ends[_angle(np.broadcast_to(begin[corner], ends.shape), ends).argmin()]
    begin, end = (ahead / np.hypot(*ahead.T)[:, None] for ahead in (begin, end))
    reflex = cross(begin, end) <= _STRAIGHT
    return _Corners(xy[reflex], begin[reflex], end[reflex], touching[reflex], np.unique(xy[touching], axis=0))


def _with_touching_points(rings: list[Float64[np.ndarray, "_ 2"]]) -> list[Float64[np.ndarray, "_ 2"]]:
    """Open closed rings, and give each a corner where a corner of another ring touches one of its sides."""
    corners = np.concatenate([ring[:-1] for ring in rings])
    ring_of = np.repeat(np.arange(len(rings)), [len(ring) - 1 for ring in rings])
    after = np.concatenate([ring[1:] for ring in rings])
    if len(rings) > 1:
        sides = shapely.STRtree(shapely.linestrings(np.stack([corners, after], axis=1)))
        corner, side = sides.query(shapely.points(corners), "dwithin", _TOUCHING)
        found = corners[corner]
        apart = [np.hypot(*(found - ends[side]).T) > _TOUCHING for ends in (corners, after)]
        new = (ring_of[corner] != ring_of[side]) & apart[0] & apart[1]
        found, side = found[new], side[new]
        order = np.lexsort((np.hypot(*(found - corners[side]).T), side))
        corners = np.insert(corners, side[order] + 1, found[order], axis=0)
        ring_of = np.insert(ring_of, side[order] + 1, ring_of[side[order]])
    return [corners[ring_of == ring] for ring in range(len(rings))]


def _visible(
    polygon: shapely.Polygon, entries: Float64[np.ndarray, "entry 2"], corners: _Corners, free: Int[np.ndarray, " free"]
) -> tuple[Int64[np.ndarray, "line 2"], Float64[np.ndarray, "place 2"]]:
    """Join entries, and corners at which a walk may bend; give the lines and what they join, entries first."""
    xy = np.concatenate([entries, corners.xy[free]])
    one, two = np.triu_indices(len(xy), 1)
    useful = np.ones(len(one), bool)
    for here, there in ((one, two), (two, one)):
        corner = np.flatnonzero(useful & (here >= len(entries)))
        at = free[here[corner] - len(entries)]
        ahead = xy[there[corner]] - xy[here[corner]]
        ahead /= np.hypot(*ahead.T)[:, None]
        sides = np.stack([cross(ahead, corners.begin[at]), cross(ahead, corners.end[at])])
        # Both borders of a corner are on the same side of the line, or the shortest walk would not bend here.
        bends = (sides.min(axis=0) >= -_STRAIGHT) | (sides.max(axis=0) <= _STRAIGHT)
        useful[corner] = bends & (~corners.touching[at] | _within(ahead, corners, at))
    one, two = one[useful], two[useful]
    lines = shapely.linestrings(np.stack([xy[one], xy[two]], axis=1))
    seen = shapely.covers(polygon, lines) | (xy[one] == xy[two]).all(axis=1)
    for pinch in corners.pinches:
        ends = (np.hypot(*(xy - pinch).T) <= _TOUCHING)[np.stack([one, two])].any(axis=0)
        seen &= ends | (shapely.distance(lines, shapely.Point(pinch)) > _TOUCHING)
    return np.stack([one, two], axis=1)[seen], xy


def _within(
    ahead: Float64[np.ndarray, "line 2"], corners: _Corners, at: Int[np.ndarray, " line"]
) -> Bool[np.ndarray, " line"]:
    """Tell which directions lie between the borders of a corner."""
    whole = _angle(corners.begin[at], corners.end[at])
    angle = _angle(corners.begin[at], ahead)
    return (angle <= whole + _STRAIGHT) | (angle >= 2 * np.pi - _STRAIGHT)


def _thin(
    ends: Int64[np.ndarray, "line 2"], xy: Float64[np.ndarray, "place 2"], entries: int
) -> Int64[np.ndarray, "kept 2"]:
    """Keep lines until no walk between two entries is longer than need be, the nearest entries first."""
    if not len(ends):
        return ends
    size = len(xy)
    one, two = ends.T
    length = np.maximum(np.hypot(*(xy[one] - xy[two]).T), 1e-9)  # a line of 0 m would not be one to the search
    graph = coo_array((length, (one, two)), shape=(size, size)).tocsr()
    shortest, before = dijkstra(graph, directed=False, indices=np.arange(entries), return_predecessors=True)
    start, stop = np.triu_indices(entries, 1)
    order = np.argsort(shortest[start, stop], kind="stable")
    order = order[np.isfinite(shortest[start[order], stop[order]])]
    kept = np.where(np.eye(size, dtype=bool), 0.0, np.inf)  # metres along the lines that are kept
    lines = []
    for a, b in zip(start[order].tolist(), stop[order].tolist(), strict=True):
        if kept[a, b] <= STRETCH * shortest[a, b]:
            continue
        there = b
        while there != a:
            here = int(before[a, there])
            step = float(np.hypot(*(xy[there] - xy[here])))
            if kept[there, here] > step:
                lines.append((here, there))
                through = kept[:, [here]] + step + kept[there]
                kept = np.minimum(kept, np.minimum(through, through.T))
            there = here
    return np.array(lines, np.int64).reshape(-1, 2)


def cross(a: Float64[np.ndarray, "... 2"], b: Float64[np.ndarray, "... 2"]) -> Float64[np.ndarray, "..."]:
    """Compute the cross products of vectors in the plane.

    Parameters
    ----------
    a, b
        The vectors; their shapes are broadcast.

    Returns
    -------
    Float64[np.ndarray, "..."]
        Positive where ``b`` points to the left of ``a``.
    """
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _angle(a: Float64[np.ndarray, "_ 2"], b: Float64[np.ndarray, "_ 2"]) -> Float64[np.ndarray, " _"]:
    """Give the angle anticlockwise from one direction to another, 0 to 2 π."""
    return np.arctan2(cross(a, b), (a * b).sum(axis=-1)) % (2 * np.pi)
