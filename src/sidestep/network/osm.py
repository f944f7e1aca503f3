"""From an OpenStreetMap extract to a town: the streets that people walk. Nothing is downloaded."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from sidestep.network.geodesy import course_lengths
from sidestep.network.merging import assign_crossings, merge_crossings
from sidestep.network.osm_file import OsmError, Ways, read_walkable
from sidestep.network.simplify import JOINED, simplify
from sidestep.network.streets import Nodes, Streets, largest_component, ranges
from sidestep.network.tags import WIDTHS, CrossingKind, width_table
from sidestep.network.town import ATTRIBUTION, MOST_CROSSINGS, Town

MERGE = 8.0
"""Metres; the default for merging crossings."""


@dataclass(frozen=True)
class ImportReport:
    """What an import kept, dropped and repaired."""

    source: str
    """Name of the file."""
    ways: int
    """Ways with a ``highway`` tag."""
    walkable: int
    """Ways of these that are walked."""
    dropped: dict[str, int]
    """Number of ways and streets dropped, by reason."""
    repaired: dict[str, int]
    """Number of ways and crossings changed, by what was done."""
    nodes_before: int
    """Crossings and dead ends before merging and simplifying."""
    streets_before: int
    """Streets before merging and simplifying."""
    kilometres_before: float
    """Kilometres of streets before merging and simplifying."""
    nodes: int
    """Crossings and dead ends kept."""
    streets: int
    """Streets kept."""
    kilometres: float
    """Kilometres of streets kept."""
    most_exits: int
    """Streets that leave the busiest crossing."""


def import_osm(
    path: str | Path, *, merge: float = MERGE, widths: Mapping[str, float] | None = None
) -> tuple[Town, ImportReport]:
    """Read the streets that people walk from an OpenStreetMap file.

    Ways are split where they meet and where an extract lacks their nodes; the largest part in which every crossing can
    be reached from every other is kept. `sidestep.network.tags` decides which ways are walked and how wide they are,
    `sidestep.network.merging` and `sidestep.network.simplify` what becomes of crossings.

    Parameters
    ----------
    path
        A file whose name ends in .osm, .osm.gz, .osm.bz2 or .osm.pbf.
    merge
        Crossings joined by a street shorter than this many metres become one, and so do streets between the same two
        crossings whose lengths differ by less; 0 leaves them.
    widths
        Metres available to walkers by kind of street, 0.3 to 100; other kinds keep their width in
        `sidestep.network.tags.WIDTHS`.

    Returns
    -------
    Town, ImportReport
        The streets, and what was kept, dropped and repaired.

    Raises
    ------
    OsmError
        A file that is missing, unreadable, cut short or not OpenStreetMap's; no street left; a negative or infinite
        distance.
    WidthError
        Widths of unknown kinds or out of range.

    Examples
    --------
    >>> import sidestep, tempfile
    >>> from pathlib import Path
    >>> extract = '''<osm version="0.6">
    ... <node id="1" lat="60.1700" lon="24.9400"/><node id="2" lat="60.1700" lon="24.9420"/>
    ... <node id="3" lat="60.1710" lon="24.9420"/><node id="4" lat="60.1690" lon="24.9420"/>
    ... <way id="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="footway"/></way>
    ... <way id="2"><nd ref="3"/><nd ref="2"/><nd ref="4"/><tag k="highway" v="residential"/></way>
    ... </osm>'''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "town.osm"
    ...     _ = path.write_text(extract)
    ...     town, report = sidestep.import_osm(path)
    >>> report.ways, report.walkable, town.nodes, town.streets
    (2, 2, 4, 3)
    >>> town.kind
    ('footway', 'residential', 'residential')
    """
    if not (math.isfinite(merge) and merge >= 0):
        raise OsmError(f"merge must be a distance of 0 m or more, not {merge} m", field="merge")
    path = Path(path)
    ways, nodes = read_walkable(path, width_table(widths))
    streets = _split(ways, nodes)
    if not len(streets):
        raise OsmError(f"{path}: no streets, since it lacks the nodes of its {len(ways.counts):,} walkable ways")
    before = streets.keep(largest_component(streets))
    ways.dropped["street: outside the largest connected part"] = len(streets) - len(before)
    streets = merge_crossings(assign_crossings(before, nodes.kind), nodes, merge)
    ways.dropped["street: inside a merged crossing"] = len(before) - len(streets)
    streets, fewer = simplify(streets, merge)
    ways.repaired[JOINED] = fewer.pop(JOINED)
    ways.dropped.update(fewer)
    if not len(streets):
        raise OsmError(f"{path}: no street between two crossings is left when those within {merge:g} m are merged")
    town = _town(ways, nodes, streets)
    starts = np.concatenate([town.tail, town.head[~town.one_way]])
    return town, ImportReport(
        source=path.name,
        ways=ways.read,
        walkable=len(ways.counts),
        dropped=dict(+ways.dropped),
        repaired=dict(+ways.repaired),
        nodes_before=len(np.unique(before.ends)),
        streets_before=len(before),
        kilometres_before=float(before.length.sum()) / 1000,
        nodes=town.nodes,
        streets=town.streets,
        kilometres=town.kilometres,
        most_exits=int(np.bincount(starts).max()),
    )


def _split(ways: Ways, nodes: Nodes) -> Streets:
    """Cut ways at absent nodes, and where a node belongs to several ways or occurs twice in one."""
    node = np.searchsorted(nodes.ids, np.array(ways.refs, np.int64))
    way = np.repeat(np.arange(len(ways.counts)), ways.counts)
    there = ~np.isnan(nodes.place[node, 0])
    ways.repaired["way: split at missing nodes"] += len(np.unique(way[~there]))
    cut = np.append(True, (way[1:] != way[:-1]) | ~there[:-1])
    piece = np.cumsum(cut)[there]
    node, way = node[there], way[there]
    again = (np.diff(node, prepend=-1) == 0) & (np.diff(piece, prepend=0) == 0)
    node, way, piece = node[~again], way[~again], piece[~again]
    other = piece[1:] != piece[:-1]
    ends = np.append(True, other) | np.append(other, True)
    stop = np.flatnonzero(ends | (np.bincount(node, minlength=len(nodes.ids))[node] > 1))
    joined = piece[stop[1:]] == piece[stop[:-1]]
    begin, end = stop[:-1][joined], stop[1:][joined]
    order, first = ranges(begin, end - begin + 1)
    points = nodes.place[node[order]]

    def inside(kind: CrossingKind) -> Int[np.ndarray, " street"]:
        """Count the nodes of a kind between the ends of each street."""
        count = np.append(0, np.cumsum(nodes.kind[node] == kind))
        return count[end] - count[begin + 1]

    return Streets(
        ends=np.stack([node[begin], node[end]], axis=1),
        one_way=np.array(ways.one_way, bool)[way[begin]],
        length=course_lengths(points, first),
        width=np.array(ways.widths, np.float64)[way[begin]],
        kind=np.array(ways.kinds, np.int64)[way[begin]],
        name=np.array(ways.names, np.int64)[way[begin]],
        signals=inside(CrossingKind.SIGNALS),
        crossings=inside(CrossingKind.UNSIGNALISED),
        points=points,
        first=first,
    )


def _town(ways: Ways, nodes: Nodes, streets: Streets) -> Town:
    kinds, names = list(WIDTHS), list(ways.name_codes)
    columns: dict[str, Any] = {
        **vars(streets),
        "kind": tuple(kinds[code] for code in streets.kind.tolist()),
        "name": tuple(names[code] for code in streets.name.tolist()),
        "signals": np.minimum(streets.signals, MOST_CROSSINGS),
        "crossings": np.minimum(streets.crossings, MOST_CROSSINGS),
    }
    return Town.of_streets(**columns, place=nodes.place, ids=nodes.ids, attribution=ATTRIBUTION)
