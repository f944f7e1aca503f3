"""Where ways meet areas with which they share no node: they end inside, touch an outline, or run across it.

Mappers draw paths over squares without a common node. Walkers step off them all the same, so each way that comes into
an area on the same level gets a node where it crosses the outline, as does the outline.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float64, Int, Int64

from sidestep.network.streets import ranges
from sidestep.network.visibility import cross

SAME_POINT = 0.1
"""Metres from an outline within which a node lies on it."""

_CELL = 64.0  # m; side of the squares by which the ways near areas are found


@dataclass(frozen=True, eq=False)
class Polylines:
    """Ways, and the outlines of areas, as nodes one after another; outlines end where they begin."""

    xy: Float64[np.ndarray, "node 2"]
    """Metres east and north of all nodes; NaN where a file lacks the node."""
    node: Int64[np.ndarray, " stop"]
    """Index of each node along the lines."""
    line: Int64[np.ndarray, " stop"]
    """Number of the line that each belongs to, ascending."""
    storey: Int64[np.ndarray, " line"]
    """Lines meet only on the same storey, and none on a negative one."""
    area: Int64[np.ndarray, " line"]
    """Number of the area that a line is an outline of; -1 for ways."""

    def pieces(self, lines: Int[np.ndarray, " some"]) -> Int64[np.ndarray, " piece"]:
        """Give the stops of some lines, but for the last of each: where their straight pieces begin."""
        begins = np.searchsorted(self.line, lines)
        return ranges(begins, np.searchsorted(self.line, lines, "right") - begins - 1)[0]


@dataclass(frozen=True, eq=False)
class Meetings:
    """Nodes to add where lines meet, and entries inside areas."""

    added: Float64[np.ndarray, "new 2"]
    """Metres east and north of new nodes."""
    after: Int64[np.ndarray, " insertion"]
    """Stop after which each node is to be inserted, ascending."""
    node: Int64[np.ndarray, " insertion"]
    """Node to insert; those after the last one known are new."""
    inside: Int64[np.ndarray, "entry 2"]
    """Areas, and nodes inside them at which ways end or meet."""


def find_meetings(lines: Polylines, areas: Sequence[shapely.Geometry]) -> Meetings:
    """Find where lines meet areas with which they share no node.

    Parameters
    ----------
    lines
        Ways and outlines.
    areas
        Polygons of the areas, by number.

    Returns
    -------
    Meetings
        Nodes to insert, and entries inside areas.
    """
    polygons = list(areas)
    shapely.prepare(polygons)
    piece, area = _near(lines, polygons)
    same = lines.area[lines.line[piece]] != area
    outlines = np.flatnonzero(lines.area >= 0)
    outlines = outlines[np.argsort(lines.area[outlines], kind="stable")]
    storey = np.full(len(polygons), -1)
    storey[lines.area[outlines]] = lines.storey[outlines]
    same &= lines.storey[lines.line[piece]] == storey[area]
    piece, area = piece[same], area[same]
    stops_here = _stops_here(lines)
    new: dict[frozenset[tuple[int, int]], int] = {}
    found: set[tuple[int, float, int]] = set()
    inside: list[tuple[int, int]] = []
    places: list[list[float]] = []
    numbers, begins = np.unique(area, return_index=True)
    for number, pieces in zip(numbers.tolist(), np.split(piece, begins)[1:], strict=True):
        edges = lines.pieces(outlines[lines.area[outlines] == number])
        nodes, outline = (np.unique(lines.node[np.concatenate([at, at + 1])]) for at in (pieces, edges))
        nodes = nodes[~np.isin(nodes, outline)]
        touching = _touching(lines, nodes, edges)
        found.update(touching, _touching(lines, outline, pieces))
        nodes = nodes[stops_here[nodes] & ~np.isin(nodes, [node for *_, node in touching])]
        entries = nodes[shapely.intersects_xy(polygons[number], *lines.xy[nodes].T)]
        inside.extend((number, node) for node in entries.tolist())
        for one, other, along, across in _crossing(lines, pieces, edges):
            pair = frozenset(tuple(sorted(lines.node[[at, at + 1]].tolist())) for at in (one, other))
            if pair not in new:
                new[pair] = len(lines.xy) + len(places)
                start, stop = lines.xy[lines.node[[one, one + 1]]]
                places.append((start + along * (stop - start)).tolist())
            found.update([(one, along, new[pair]), (other, across, new[pair])])
    after, _, node = np.array(sorted(found)).reshape(-1, 3).T
    return Meetings(
        np.array(places).reshape(-1, 2), after.astype(np.int64), node.astype(np.int64),
        np.array(inside, np.int64).reshape(-1, 2),
    )  # fmt: skip


def _near(
    lines: Polylines, polygons: list[shapely.Geometry]
) -> tuple[Int64[np.ndarray, " pair"], Int64[np.ndarray, " pair"]]:
    """Find straight pieces of lines that come near areas; give their first stops, and the areas in ascending order."""
    piece = np.flatnonzero((lines.line[1:] == lines.line[:-1]) & (lines.storey[lines.line[:-1]] >= 0))
    cells = np.floor(lines.xy / _CELL)
    keys = np.nan_to_num(cells) @ [2**26, 1.0]
    around = []
    for west, south, east, north in np.floor(shapely.bounds(polygons) / _CELL).tolist():
        x, y = np.mgrid[west - 1 : east + 2, south - 1 : north + 2]
        around.append((x * 2**26 + y).ravel())
    close = np.isin(keys, np.concatenate(around))
    ends = np.stack([lines.node[piece], lines.node[piece + 1]], axis=1)
    # A piece that reaches farther than to the next cell may pass an area without a node near it.
    far = np.abs(np.diff(cells[ends], axis=1)).max(axis=(1, 2)) > 1
    wanted = (close[ends].any(axis=1) | far) & ~np.isnan(lines.xy[ends]).any(axis=(1, 2))
    piece, ends = piece[wanted], ends[wanted]
    found, area = shapely.STRtree(polygons).query(shapely.linestrings(lines.xy[ends]), "dwithin", SAME_POINT)
    order = np.lexsort((piece[found], area))
    return piece[found[order]], area[order]


def _stops_here(lines: Polylines) -> Bool[np.ndarray, " node"]:
    """Find the nodes at which ways end or meet."""
    ways = lines.area[lines.line] < 0
    ends = np.diff(lines.line, prepend=-1) != 0
    ends |= np.roll(ends, -1)
    return np.bincount(lines.node[ways], 1 + ends[ways], len(lines.xy)) > 1


def _touching(
    lines: Polylines, nodes: Int64[np.ndarray, " node"], pieces: Int64[np.ndarray, " piece"]
) -> list[tuple[int, float, int]]:
    """Find nodes that lie on lines that lack them; give the stop before them, the part of its piece, and the node."""
    ends = lines.node[np.stack([pieces, pieces + 1], axis=1)]
    start, stop = lines.xy[ends].transpose(1, 0, 2)
    span, to_node = stop - start, lines.xy[nodes][:, None] - start
    along = np.clip((to_node * span).sum(axis=2) / np.maximum((span**2).sum(axis=1), 1e-12), 0, 1)
    apart = np.hypot(*(to_node - along[..., None] * span).transpose(2, 0, 1))
    node, piece = np.nonzero(apart <= SAME_POINT)
    line = lines.line[pieces[piece]]
    order = np.lexsort((apart[node, piece], line, node))
    group = np.stack([node, line])[:, order]
    nearest = order[(np.diff(group, prepend=-1) != 0).any(axis=0)]
    has = {(at, on) for at, on in zip(ends.ravel().tolist(), np.repeat(lines.line[pieces], 2).tolist(), strict=True)}
    return [
        (int(pieces[piece[i]]), float(along[node[i], piece[i]]), int(nodes[node[i]]))
        for i in nearest.tolist()
        if (int(nodes[node[i]]), int(line[i])) not in has
    ]


def _crossing(
    lines: Polylines, pieces: Int64[np.ndarray, " piece"], edges: Int64[np.ndarray, " edge"]
) -> list[tuple[int, int, float, float]]:
    """Find pieces and edges that cross, with how far along each this is, 0 to 1; not those that touch."""
    one, other = (lines.node[np.stack([at, at + 1], axis=1)] for at in (pieces, edges))
    p, q = lines.xy[one], lines.xy[other]
    a, b = np.diff(p, axis=1), np.diff(q, axis=1).transpose(1, 0, 2)
    between = q[None, :, 0] - p[:, None, 0]
    turn = cross(a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        along, across = cross(between, b) / turn, cross(between, a) / turn
        # As far from both ends as nodes that would lie on the other line.
        margin = [SAME_POINT / np.maximum(np.abs(turn) / np.hypot(*np.moveaxis(span, -1, 0)), 1e-12) for span in (b, a)]
    fits = (along > margin[0]) & (along < 1 - margin[0]) & (across > margin[1]) & (across < 1 - margin[1])
    fits &= ~(one[:, None, :, None] == other[None, :, None, :]).any(axis=(2, 3))
    found = np.argwhere(fits)
    return [(int(pieces[i]), int(edges[j]), float(along[i, j]), float(across[i, j])) for i, j in found.tolist()]
