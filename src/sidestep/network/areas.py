"""Squares, platforms and other areas of an extract become ways across them, from entry to entry.

An area has entries where its rings share nodes with ways or other areas, and where ways meet it without one. Areas that
cannot be crossed are walked along their outlines.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float64, Int64

from sidestep.network.access import NEVER
from sidestep.network.extract import Areas, Extract
from sidestep.network.geodesy import Projection
from sidestep.network.measures import NARROWEST, WIDEST
from sidestep.network.meetings import Meetings, Polylines, find_meetings
from sidestep.network.visibility import AreaError, cross_area, free_space


@dataclass(eq=False)
class _Additions:
    """Ways to add, and new nodes along them."""

    first: int
    """Number of the first new node."""
    places: list[tuple[float, float]] = field(default_factory=list)
    """Metres east and north of new nodes."""
    rows: list[int] = field(default_factory=list)
    """Ring whose tags each way has."""
    courses: list[list[int]] = field(default_factory=list)
    """Nodes of each way."""
    widths: list[float | None] = field(default_factory=list)
    """Metres available to walkers on each way; None for those of the tags."""

    def node(self, place: tuple[float, float]) -> int:
        """Add a node; give its number."""
        self.places.append(place)
        return self.first + len(self.places) - 1

    def way(self, row: int, course: list[int], width: float | None = None) -> None:
        """Add a way."""
        self.rows.append(row)
        self.courses.append(course)
        self.widths.append(width)


def cross_areas(extract: Extract) -> None:
    """Add ways across the areas of an extract, or along the outlines of those that cannot be crossed.

    Nobody walks through a gate at an entry but those who come in or leave there: the ways across begin at another node
    at its place, to which a way from the gate leads.

    Parameters
    ----------
    extract
        What a file holds; ways and nodes are added, and its counters go on counting.
    """
    nodes = extract.nodes
    there = ~np.isnan(nodes.place[:, 0])
    if not extract.areas.counts or not there.any():
        return
    plane = Projection.of(nodes.place[there])
    xy = plane.project(nodes.place)
    rings, polygons = _crossable(extract, xy)
    if not rings:
        return
    lines = _polylines(extract, rings, xy)
    found = find_meetings(lines, polygons)
    node = np.insert(lines.node, found.after + 1, found.node)
    line = np.insert(lines.line, found.after + 1, lines.line[found.after])
    xy = np.concatenate([xy, found.added])
    courses = np.split(node, np.flatnonzero(np.diff(line)) + 1)
    additions = _Additions(len(xy))
    ways = len(extract.ways.counts)
    _add_lines(extract, additions, xy, rings, courses[ways:], _entries(node, line, lines.area, len(xy), found))
    ids = extract.add_nodes(plane.unproject(np.array([*found.added.tolist(), *additions.places]).reshape(-1, 2)))
    extract.ways.replace_nodes(ids[node[line < ways]], np.bincount(line[line < ways], minlength=ways))
    for row, course, width in zip(additions.rows, additions.courses, additions.widths, strict=True):
        extract.ways.copy(extract.areas, row, ids[course].tolist(), width)


def _crossable(extract: Extract, xy: Float64[np.ndarray, "node 2"]) -> tuple[list[list[int]], list[shapely.Geometry]]:
    """List the rings of each area that can be crossed, and its polygons; add the outlines of others to the ways."""
    areas = extract.areas
    border = np.append(0, np.cumsum(areas.counts))
    node = np.searchsorted(extract.nodes.ids, np.array(areas.refs, np.int64))
    rings: dict[int, list[int]] = {}
    for row, number in enumerate(areas.numbers):
        rings.setdefault(number, []).append(row)
    kept, polygons = [], []
    for rows in rings.values():
        courses = [node[border[row] : border[row + 1]] for row in rows]
        try:
            parts, repaired = _free_space(areas, rows, [xy[course[:-1]] for course in courses])
        except AreaError as error:
            _note_outline(extract, error)
            for row, course in zip(rows, courses, strict=True):
                extract.ways.copy(areas, row, extract.nodes.ids[course].tolist())
            continue
        extract.repaired["area: rings that cross or overlap"] += repaired
        kept.append(rows)
        polygons.append(shapely.multipolygons(parts))
    return kept, polygons


def _free_space(
    areas: Areas, rows: list[int], rings: list[Float64[np.ndarray, "_ 2"]]
) -> tuple[list[shapely.Polygon], bool]:
    if not areas.whole[rows[0]]:
        raise AreaError("open ring")
    if any(np.isnan(ring).any() for ring in rings):
        raise AreaError("missing nodes")
    return free_space(*_by_role(areas, rows, rings))


def _by_role(areas: Areas, rows: list[int], rings: list[Any]) -> tuple[list[Any], list[Any]]:
    """Tell rings around an area from those around holes."""
    both = list(zip(rows, rings, strict=True))
    return [ring for row, ring in both if not areas.inner[row]], [ring for row, ring in both if areas.inner[row]]


def _polylines(extract: Extract, rings: list[list[int]], xy: Float64[np.ndarray, "node 2"]) -> Polylines:
    """Put ways and rings one after another."""
    ways, areas = extract.ways, extract.areas
    row = np.array([row for rows in rings for row in rows], np.int64)
    border = np.append(0, np.cumsum(areas.counts)).astype(np.int64)
    refs = np.array(areas.refs, np.int64)
    along = [refs[border[at] : border[at + 1]] for at in row.tolist()]
    counts = np.concatenate([np.array(ways.counts, np.int64), np.array(areas.counts, np.int64)[row]])
    return Polylines(
        xy=xy,
        node=np.searchsorted(extract.nodes.ids, np.concatenate([np.array(ways.refs, np.int64), *along])),
        line=np.repeat(np.arange(len(counts)), counts),
        storey=np.concatenate([np.array(ways.storeys, np.int64), np.array(areas.storeys, np.int64)[row]]),
        area=np.append(np.full(len(ways.counts), -1), np.repeat(np.arange(len(rings)), list(map(len, rings)))),
    )


def _entries(
    node: Int64[np.ndarray, " stop"],
    line: Int64[np.ndarray, " stop"],
    area: Int64[np.ndarray, " line"],
    nodes: int,
    found: Meetings,
) -> list[Int64[np.ndarray, " entry"]]:
    """List the nodes of each area's rings that belong to ways or other areas, and those inside it where ways stop."""
    areas = int(area.max(initial=-1)) + 1
    of = area[line]
    on_ways = np.bincount(node[of < 0], minlength=nodes) > 0
    # Each node once for each area, whatever its rings.
    owner, member = np.divmod(np.unique(of[of >= 0] * nodes + node[of >= 0]), nodes)
    shared = on_ways[member] | (np.bincount(member, minlength=nodes)[member] > 1)
    owner, member = np.append(owner[shared], found.inside[:, 0]), np.append(member[shared], found.inside[:, 1])
    order = np.argsort(owner, kind="stable")
    return np.split(member[order], np.searchsorted(owner[order], np.arange(1, areas)))


def _add_lines(
    extract: Extract,
    additions: _Additions,
    xy: Float64[np.ndarray, "node 2"],
    rings: list[list[int]],
    courses: list[Int64[np.ndarray, " _"]],
    entries: list[Int64[np.ndarray, " _"]],
) -> None:
    """Add lines across areas, and the outlines of those that have too many corners."""
    passages = extract.passages
    closed = extract.nodes.indices([number for number in passages if passages[number].opening == NEVER])
    gates = set(extract.nodes.indices({*passages, *extract.lifts}).tolist())
    begins = 0
    for rows, all_entries in zip(rings, entries, strict=True):
        around = courses[begins : begins + len(rows)]
        begins += len(rows)
        within = all_entries[~np.isin(all_entries, closed)]
        local, at = np.unique(np.concatenate([*around, within]), return_inverse=True)
        pieces = np.split(at, np.cumsum([len(ring) for ring in around]))
        try:
            lines = cross_area(
                xy[local], *_by_role(extract.areas, rows, [ring[:-1] for ring in pieces[:-1]]), pieces[-1]
            )
        except AreaError as error:
            _note_outline(extract, error)
            for row, ring in zip(rows, around, strict=True):
                additions.way(row, ring.tolist())
            continue
        extract.crossed += len(lines.ends) > 0
        extract.dropped["area: no two entries that see each other"] += not len(lines.ends)
        width = min(max(lines.width, NARROWEST), WIDEST)
        number = [*local.tolist(), *(additions.node((x, y)) for x, y in lines.added.tolist())]
        used = {number[end] for end in lines.ends.ravel().tolist()}
        stand_in = {gate: additions.node((float(xy[gate, 0]), float(xy[gate, 1]))) for gate in sorted(used & gates)}
        for gate in sorted(stand_in.keys() & set(within.tolist())):
            additions.way(rows[0], [gate, stand_in[gate]], width)
        for ends in lines.ends.tolist():
            additions.way(rows[0], [stand_in.get(number[end], number[end]) for end in ends], width)


def _note_outline(extract: Extract, error: AreaError) -> None:
    extract.repaired[f"area: walked along its outline, {error}"] += 1
