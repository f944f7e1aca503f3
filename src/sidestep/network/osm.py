"""From an OpenStreetMap extract to a town: the streets that people walk. Nothing is downloaded."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64

from sidestep.arguments import NUMBER, PATH, TEXT, checked, instance
from sidestep.network import tags
from sidestep.network.areas import cross_areas
from sidestep.network.components import connect
from sidestep.network.extract import Extract
from sidestep.network.measures import width_table
from sidestep.network.merging import merge_crossings
from sidestep.network.osm_files import OsmError
from sidestep.network.osm_reader import read_extract
from sidestep.network.pavements import name_pavements
from sidestep.network.simplify import JOINED, SAME_PLACE, assign_crossings, simplify
from sidestep.network.splitting import split_ways
from sidestep.network.streets import Nodes, Streets
from sidestep.network.town import ATTRIBUTION, MOST_CROSSINGS, Town

MERGE = 8.0
"""Metres; the default for merging crossings."""


@dataclass(frozen=True)
class ImportReport:
    """What an import kept, dropped and repaired."""

    source: str
    """Name of the file."""
    ways: int
    """Ways that people might walk: those with a ``highway`` tag, platforms, piers and ferries."""
    walkable: int
    """Ways and areas of these that are walked."""
    areas: int
    """Areas that are walked across."""
    dropped: dict[str, int]
    """Number of ways and streets dropped, by reason."""
    repaired: dict[str, int]
    """Number of ways, nodes and crossings changed, and of tags ignored, by what was done."""
    limited: dict[str, int]
    """Number of ways, nodes and streets that are not open to everybody at all times, by how."""
    parts_left_out: int
    """Connected parts of which no street is kept."""
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


@checked(
    OsmError, path=PATH, merge=NUMBER, widths=instance(Mapping, "a table of metres by kind of street"), attribution=TEXT
)
def import_osm(
    path: str | Path,
    *,
    merge: float = MERGE,
    widths: Mapping[str, float] | None = None,
    attribution: str = ATTRIBUTION,
) -> tuple[Town, ImportReport]:
    """Read the streets that people walk from an OpenStreetMap file.

    Ways are split where they meet, where an extract lacks their nodes, and where nobody may pass; the largest part in
    which every crossing can be reached from every other is kept. `sidestep.network.tags` decides which ways are walked,
    `sidestep.network.obstacles` what bars them, `sidestep.network.simplify` which streets are one,
    `sidestep.network.merging` which crossings are.

    Parameters
    ----------
    path
        A file whose name ends in .osm, .osm.gz, .osm.bz2 or .osm.pbf.
    merge
        Crossings joined by a street shorter than this many metres become one if walks across keep their lengths within
        half of it; so do streets that run beside each other and whose lengths differ by less. 0 leaves them.
    widths
        Metres available to walkers by kind of street, 0.3 to 100; other kinds keep their width in
        `sidestep.network.tags.WIDTHS`.
    attribution
        Whose data it is, and under which licence.

    Returns
    -------
    Town, ImportReport
        The streets, and what was kept, dropped and repaired.

    Raises
    ------
    OsmError
        A file that is missing, unreadable, cut short or no extract of OpenStreetMap's; no street left; a negative or
        infinite distance; an attribution of no or several lines.
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
    if not 0 <= merge < np.inf:
        raise OsmError(f"merge must be a distance of 0 m or more, not {merge} m", field="merge")
    if not attribution.isprintable() or not attribution.strip():
        raise OsmError("attribution must say in one line whose the streets are", field="attribution")
    path, table = Path(path), width_table(widths)
    extract = read_extract(path, table)
    cross_areas(extract)
    if not extract.ways.counts:
        raise OsmError(
            f"{path}: no streets for walkers, since nothing leads to its {extract.walkable:,} walkable areas"
        )
    streets, nodes = split_ways(extract, table)
    if not len(streets):
        raise OsmError(f"{path}: no streets, since it lacks the nodes of its {extract.walkable:,} walkable ways")
    streets = name_pavements(extract, streets, nodes)
    dropped, repaired = extract.dropped, extract.repaired
    town = connect(streets, _ferry_links(extract))
    extract.limited["street: public, but reached only through restricted ones"] = int(town.secluded.sum())
    dropped["street: reached only by ferry"] = int(town.by_ferry.sum())
    dropped["street: outside the largest connected part"] = int((~town.kept & ~town.by_ferry).sum())
    before = replace(streets, restricted=streets.restricted | town.secluded).keep(town.kept)
    single, fewer = simplify(assign_crossings(before, nodes.kind), 0)
    streets = merge_crossings(single, nodes, merge)
    streets = replace(streets, length=np.maximum(streets.length, SAME_PLACE))  # lifts lead nowhere on the map
    dropped["street: inside a merged crossing"] = len(single) - len(streets)
    streets, more = simplify(streets, merge)
    fewer.update(more)
    repaired[JOINED] = fewer.pop(JOINED)
    dropped.update(fewer)
    if not len(streets):
        raise OsmError(f"{path}: no street between two crossings is left when those within {merge:g} m are merged")
    made = _town(extract, nodes, streets, attribution)
    return made, ImportReport(
        source=path.name,
        ways=extract.read,
        walkable=extract.walkable,
        areas=extract.crossed,
        dropped=dict(+dropped),
        repaired=dict(+repaired),
        limited=dict(+extract.limited),
        parts_left_out=town.parts,
        nodes_before=len(np.unique(before.ends)),
        streets_before=len(before),
        kilometres_before=float(before.length.sum()) / 1000,
        nodes=made.nodes,
        streets=made.streets,
        kilometres=made.kilometres,
        most_exits=int(np.bincount(np.concatenate([made.tail, made.head[~made.one_way]])).max()),
    )


def _ferry_links(extract: Extract) -> Int64[np.ndarray, "link 2"]:
    """List the pairs of nodes that ferries join."""
    node = extract.nodes.indices(extract.ferries.refs)
    way = np.repeat(np.arange(len(extract.ferries.counts)), np.array(extract.ferries.counts, np.int64))
    return np.stack([node[:-1], node[1:]], axis=1)[way[1:] == way[:-1]]


def _town(extract: Extract, nodes: Nodes, streets: Streets, attribution: str) -> Town:
    kinds, names, openings = tags.KINDS, list(extract.names), list(extract.openings)
    columns: dict[str, Any] = {
        **vars(streets),
        "kind": tuple(kinds[code] for code in streets.kind.tolist()),
        "name": tuple(names[code] for code in streets.name.tolist()),
        "opening": tuple(openings[code] for code in streets.opening.tolist()),
    }
    columns["crossings"], columns["signals"] = np.minimum(columns.pop("traffic"), MOST_CROSSINGS).T
    return Town.of_streets(**columns, place=nodes.place, ids=nodes.ids, attribution=attribution)
