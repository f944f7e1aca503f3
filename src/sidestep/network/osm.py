"""From an OpenStreetMap extract to a town: the streets that people walk. Nothing is downloaded.

The only module that imports osmium. A file is read twice: first its ways, then the nodes of walkable ways. Relations
are not read, so an area mapped as a multipolygon has no outline to walk along.
"""

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import osmium
from jaxtyping import Int64

from sidestep.errors import SidestepError
from sidestep.files import reading
from sidestep.network import tags
from sidestep.network.geodesy import course_lengths
from sidestep.network.simplify import JOINED, assign_crossings, merge_crossings, simplify
from sidestep.network.streets import Nodes, Streets, largest_component, ranges
from sidestep.network.tags import CrossingKind
from sidestep.network.town import ATTRIBUTION, MOST_CROSSINGS, Town

MERGE = 8.0
"""Metres; the default for merging crossings."""
FORMATS = {".osm": "osm", ".osm.gz": "osm.gz", ".osm.bz2": "osm.bz2", ".osm.pbf": "pbf", ".pbf": "pbf"}
"""The reader's name of the format that each ending of a file name stands for."""

_LONGEST_NAME = 255  # characters; OpenStreetMap takes no more
_LARGEST_ID = 2**36  # the reader's filter takes smaller ones only; larger and negative ones are filtered here


class OsmError(SidestepError):
    """An unusable OpenStreetMap file or import option; ``line`` is known for damaged XML, ``field`` for options."""


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


@dataclass(eq=False)
class Ways:
    """Walkable ways, compactly: extracts hold millions of nodes."""

    refs: "array[int]" = field(default_factory=lambda: array("q"))
    """Node numbers of all ways one after another, in walking direction where a way is one-way."""
    counts: "array[int]" = field(default_factory=lambda: array("q"))
    """Nodes of each way."""
    kinds: "array[int]" = field(default_factory=lambda: array("l"))
    """Position of each way's kind in ``WIDTHS``."""
    names: "array[int]" = field(default_factory=lambda: array("l"))
    """Code of each way's name."""
    widths: "array[float]" = field(default_factory=lambda: array("d"))
    """Metres available to walkers."""
    one_way: "array[int]" = field(default_factory=lambda: array("b"))
    """1 where a way is walked in one direction only."""
    name_codes: dict[str, int] = field(default_factory=dict)
    """Names in the order of their codes."""
    read: int = 0
    """Ways with a ``highway`` tag, walkable or not."""
    dropped: Counter[str] = field(default_factory=Counter)
    """Number of ways that are not walked, by reason."""
    repaired: Counter[str] = field(default_factory=Counter)
    """Number of ways that were changed, by what was done."""


def import_osm(
    path: str | Path, *, merge: float = MERGE, widths: Mapping[str, float] | None = None
) -> tuple[Town, ImportReport]:
    """Read the streets that people walk from an OpenStreetMap file.

    Ways are split where they meet and where an extract lacks their nodes; the largest part in which every crossing can
    be reached from every other is kept. `sidestep.network.tags` decides which ways are walked and how wide they are,
    `sidestep.network.simplify` what becomes of crossings.

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
    if not 0 <= merge < np.inf:
        raise OsmError(f"merge must be a distance of 0 m or more, not {merge} m", field="merge")
    path = Path(path)
    ways, nodes = _read_walkable(path, tags.width_table(widths))
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
        most_exits=int(np.bincount(np.concatenate([town.tail, town.head[~town.one_way]])).max()),
    )


def _read_walkable(path: Path, widths: Mapping[str, float]) -> tuple[Ways, Nodes]:
    """Read the walkable ways of a file, and the nodes along them.

    Parameters
    ----------
    path
        The file; its ending is its format.
    widths
        Metres available to walkers by kind of street, where no tag gives a width.

    Returns
    -------
    Ways, Nodes
        At least one way, and all nodes that ways name.

    Raises
    ------
    OsmError
        Another ending; a file that is missing, damaged, or without walkable ways.
    """
    formats = [name for suffix, name in FORMATS.items() if path.name.lower().endswith(suffix)]
    if not formats:
        raise OsmError(f"{path} is not named like an OpenStreetMap file; its name must end in {', '.join(FORMATS)}")
    # The reader opens the file itself, but might take its name for a web address, or for the standard input.
    with reading(path, OsmError, "OpenStreetMap data") as opened:
        if not opened.read(1):
            raise OsmError("it is empty")
        file = osmium.io.File(str(path.resolve()), formats[0])
        ways = _read_ways(file, widths)
        if not ways.counts:
            found = f"none of its {ways.read:,} highways is walkable" if ways.read else "it holds no highways"
            raise OsmError(f"no streets for walkers: {found}")
        try:
            return ways, _read_nodes(file, np.unique(np.array(ways.refs, np.int64)))
        except osmium.InvalidLocationError as error:
            raise OsmError(f"it is damaged: {error}") from error


def _read_ways(file: osmium.io.File, widths: Mapping[str, float]) -> Ways:
    ways = Ways()
    kinds = list(tags.WIDTHS)
    seen: set[int] = set()
    for way in osmium.FileProcessor(file, osmium.osm.WAY).with_filter(osmium.filter.KeyFilter("highway")):
        if not isinstance(way, osmium.osm.Way) or way.deleted:
            continue
        ways.read += 1
        tagged = dict(way.tags)
        refs = [node.ref for node in way.nodes]
        excluded = "way: repeated number" if way.id in seen else tags.exclusion_reason(tagged)
        if len(refs) < 2:
            excluded = excluded or "way: fewer than two nodes"
        seen.add(way.id)
        if excluded is not None:
            ways.dropped[excluded] += 1
            continue
        width, ignored = tags.walkable_width(tagged, widths)
        ways.repaired["way: unreadable width ignored"] += ignored
        walked = tags.direction(tagged)
        ways.refs.extend(refs if walked >= 0 else refs[::-1])
        ways.counts.append(len(refs))
        ways.kinds.append(kinds.index(tagged["highway"]))
        ways.names.append(ways.name_codes.setdefault(_printable(tagged.get("name", "")), len(ways.name_codes)))
        ways.widths.append(width)
        ways.one_way.append(walked != 0)
    return ways


def _read_nodes(file: osmium.io.File, ids: Int64[np.ndarray, " node"]) -> Nodes:
    found, lon, lat, kinds = array("q"), array("d"), array("d"), array("b")
    nodes = osmium.FileProcessor(file, osmium.osm.NODE)
    if ids[0] >= 0 and ids[-1] < _LARGEST_ID:
        nodes = nodes.with_filter(osmium.filter.IdFilter(ids.tolist()))
    for node in nodes:
        if not isinstance(node, osmium.osm.Node) or node.deleted or not node.location.valid():
            continue
        found.append(node.id)
        lon.append(node.location.lon)
        lat.append(node.location.lat)
        kinds.append(tags.crossing_kind(dict(node.tags)) if len(node.tags) else CrossingKind.NONE)
    numbers = np.array(found, np.int64)
    at = np.minimum(np.searchsorted(ids, numbers), len(ids) - 1)
    needed = ids[at] == numbers
    place, kind = np.full((len(ids), 2), np.nan), np.zeros(len(ids), np.int8)
    place[at[needed]] = np.stack([lon, lat], axis=1)[needed]
    kind[at[needed]] = np.array(kinds, np.int8)[needed]
    return Nodes(ids, place, kind)


def _printable(name: str) -> str:
    """Remove unprintable characters, which other file formats do not allow."""
    return "".join(sign for sign in name if sign.isprintable()).strip()[:_LONGEST_NAME].rstrip()


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
    crossed = [np.flatnonzero(nodes.kind[node] == kind) for kind in (CrossingKind.UNSIGNALISED, CrossingKind.SIGNALS)]
    return Streets(
        ends=np.stack([node[begin], node[end]], axis=1),
        one_way=np.array(ways.one_way, bool)[way[begin]],
        length=course_lengths(points, first),
        width=np.array(ways.widths, np.float64)[way[begin]],
        kind=np.array(ways.kinds, np.int64)[way[begin]],
        name=np.array(ways.names, np.int64)[way[begin]],
        traffic=np.stack([np.searchsorted(at, end) - np.searchsorted(at, begin, "right") for at in crossed], axis=1),
        opening=np.zeros(len(begin), np.int64),
        restricted=np.zeros(len(begin), bool),
        incline=np.full(len(begin), np.nan),
        kerb=np.zeros(len(begin)),
        points=points,
        first=first,
    )


def _town(ways: Ways, nodes: Nodes, streets: Streets) -> Town:
    kinds, names = list(tags.WIDTHS), list(ways.name_codes)
    columns: dict[str, Any] = {
        **vars(streets),
        "kind": tuple(kinds[code] for code in streets.kind.tolist()),
        "name": tuple(names[code] for code in streets.name.tolist()),
        "opening": tuple("" for _ in streets.opening),
    }
    columns["crossings"], columns["signals"] = np.minimum(columns.pop("traffic"), MOST_CROSSINGS).T
    return Town.of_streets(**columns, place=nodes.place, ids=nodes.ids, attribution=ATTRIBUTION)
