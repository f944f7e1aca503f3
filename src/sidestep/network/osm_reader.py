"""OpenStreetMap files as tables: what is walked, the nodes along it, and what stands in the way.

The only module that imports osmium. A file is read twice: first its ways, then the nodes along them. A third time if it
has several versions of its ways, of which the latest count.
"""

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import osmium

from sidestep.files import reading
from sidestep.network import measures, tags
from sidestep.network.access import NEVER, Access
from sidestep.network.obstacles import kerb_height, passage
from sidestep.network.osm_files import OsmError, file_format, rewritten_xml
from sidestep.network.streets import Nodes

_LONGEST_NAME = 255  # characters; OpenStreetMap takes no more
_LARGEST_ID = 2**36  # the reader's filter takes smaller ones only; larger and negative ones are filtered here
_KIND_CODES = {kind: code for code, kind in enumerate(tags.WIDTHS)}


@dataclass(eq=False)
class Courses:
    """Ways as lists of nodes, compactly: extracts hold millions of nodes."""

    refs: "array[int]" = field(default_factory=lambda: array("q"))
    """Node numbers of all ways one after another."""
    counts: "array[int]" = field(default_factory=lambda: array("q"))
    """Nodes of each way."""
    names: "array[int]" = field(default_factory=lambda: array("l"))
    """Code of each way's name."""

    def add(self, refs: list[int], name: int = 0) -> None:
        """Add a way."""
        self.refs.extend(refs)
        self.counts.append(len(refs))
        self.names.append(name)


@dataclass(eq=False)
class Ways(Courses):
    """Walkable ways; their nodes are in walking direction where a way is one-way."""

    kinds: "array[int]" = field(default_factory=lambda: array("l"))
    """Position of each way's kind in ``WIDTHS``."""
    widths: "array[float]" = field(default_factory=lambda: array("d"))
    """Metres available to walkers."""
    one_way: "array[int]" = field(default_factory=lambda: array("b"))
    """1 where a way is walked in one direction only."""
    second: "array[int]" = field(default_factory=lambda: array("b"))
    """1 for the second of two rows of one way, which differ in direction and access."""
    openings: "array[int]" = field(default_factory=lambda: array("l"))
    """Code of each way's opening times."""
    restricted: "array[int]" = field(default_factory=lambda: array("b"))
    """1 for ways that only lead to destinations."""
    inclines: "array[float]" = field(default_factory=lambda: array("d"))
    """Rise for each metre; NaN where it is unknown."""
    kerbs: "array[float]" = field(default_factory=lambda: array("d"))
    """Metres of the highest kerb."""
    levels: "array[int]" = field(default_factory=lambda: array("l"))
    """Code of the level of each way; 0 where none is tagged."""
    crossing: "array[int]" = field(default_factory=lambda: array("b"))
    """1 where a way leads over a carriageway."""


class Codes(dict[str, int]):
    """Texts and their codes, in order; "" is 0."""

    def __init__(self) -> None:
        super().__init__({"": 0})

    def __missing__(self, text: str) -> int:
        return self.setdefault(text, len(self))


@dataclass(eq=False)
class Extract:
    """What a file holds for walkers."""

    ways: Ways = field(default_factory=Ways)
    """What is walked."""
    roads: Courses = field(default_factory=Courses)
    """Streets with names that are not walked themselves, such as those whose pavements are ways of their own."""
    ferries: Courses = field(default_factory=Courses)
    """Ferries that take walkers."""
    nodes: Nodes = field(default_factory=lambda: Nodes(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0, np.int8)))
    """All nodes along these, also those that the file lacks."""
    passages: dict[int, Access] = field(default_factory=dict)
    """Who may pass the nodes, by number, that are not always open to everybody."""
    kerbs: dict[int, float] = field(default_factory=dict)
    """Metres of the kerbs at nodes, by number."""
    lifts: set[int] = field(default_factory=set)
    """Numbers of nodes that are lifts between levels."""
    names: Codes = field(default_factory=Codes)
    openings: Codes = field(default_factory=Codes)
    levels: Codes = field(default_factory=Codes)
    read: int = 0
    """Ways that people might walk: those with a ``highway`` tag, platforms, piers and ferries."""
    walkable: int = 0
    """Ways of these that are walked."""
    dropped: Counter[str] = field(default_factory=Counter)
    """Number of ways that are not walked, by reason."""
    repaired: Counter[str] = field(default_factory=Counter)
    """Number of ways and nodes that were changed, or tags ignored, by what was done."""
    limited: Counter[str] = field(default_factory=Counter)
    """Number of ways and nodes that are not open to everybody at all times, by how."""
    located: tuple["array[int]", "array[float]"] = field(default_factory=lambda: (array("q"), array("d")))
    """Numbers of nodes whose places stand with the ways, and these places: longitude, latitude."""


def read_extract(path: Path, widths: Mapping[str, float]) -> Extract:
    """Read the walkable ways of a file, and the nodes along them.

    Parameters
    ----------
    path
        The file; its ending is its format.
    widths
        Metres available to walkers by kind of street, where no tag gives a width.

    Returns
    -------
    Extract
        At least one way, and all nodes that ways name.

    Raises
    ------
    OsmError
        Another ending; a file that is missing, damaged, not an extract, or without walkable ways.
    """
    kind = file_format(path)
    # The reader opens the file itself, but might take its name for a web address, or for the standard input.
    with reading(path, OsmError, "OpenStreetMap data") as opened:
        if not opened.read(1):
            raise OsmError("it is empty")
        xml = None if kind == "pbf" else rewritten_xml(path)
        file = osmium.io.File(str(path.resolve()), kind) if xml is None else osmium.io.FileBuffer(xml, "osm")
        extract, latest = _read_ways(file, widths, None)
        if latest is not None:
            extract, _ = _read_ways(file, widths, latest)
        if not extract.ways.counts:
            found = f"none of its {extract.read:,} highways is walkable" if extract.read else "it holds no highways"
            raise OsmError(f"no streets for walkers: {found}")
        try:
            _read_nodes(file, extract)
        except osmium.InvalidLocationError as error:
            raise OsmError(f"it is damaged: {error}") from error
        return extract


def _read_ways(
    file: Any, widths: Mapping[str, float], latest: dict[int, int] | None
) -> tuple[Extract, dict[int, int] | None]:
    """Read ways; of several versions only the given ones, which are returned if they are not known yet."""
    extract = Extract()
    versions: dict[int, int] = {}
    several = False
    for way in osmium.FileProcessor(file, osmium.osm.WAY):
        if not isinstance(way, osmium.osm.Way):
            continue
        number, version = way.id, way.version
        known = versions.get(number)
        several |= known is not None and known != version
        versions[number] = version if known is None else max(known, version)
        if way.deleted or not len(way.tags):
            continue
        tagged = dict(way.tags)
        kind = tags.way_kind(tagged)
        if kind is None:
            continue
        extract.read += 1
        if latest is not None and version != latest[number]:
            extract.dropped["way: older version"] += 1
        elif known == version:
            extract.dropped["way: repeated number"] += 1
        else:
            _add_way(extract, way, {**tagged, "highway": kind}, widths)
    return extract, versions if several else None


def _add_way(extract: Extract, way: Any, tagged: dict[str, str], widths: Mapping[str, float]) -> None:
    """Add a way to what is walked, or to what is not."""
    refs = [node.ref for node in way.nodes]
    walked = tags.directions(tagged)
    excluded = tags.exclusion_reason(tagged)
    if len(refs) < 2:
        excluded = excluded or "way: fewer than two nodes"
    if not walked:
        excluded = excluded or "way: contradicting directions"
    name = _printable(tagged.get("name") or tagged.get("is_sidepath:of:name", ""))
    if excluded is not None:
        extract.dropped[excluded] += 1
        ferry = tagged["highway"] == tags.FERRY
        if ferry and walked and len(refs) > 1:
            extract.ferries.add(refs)
        elif name and not ferry and tagged["highway"] in tags.WIDTHS:
            extract.roads.add(refs, extract.names[name])
        else:
            return
        _locate(extract, way)
        return
    extract.walkable += 1
    _locate(extract, way)
    width, ignored = measures.walkable_width(tagged, widths)
    extract.repaired["way: unreadable width ignored"] += ignored
    incline, ignored = measures.incline(tagged)
    extract.repaired["way: incline without a readable number ignored"] += ignored
    full = tagged["highway"] in tags.FULL_WIDTH
    kerb, ignored = kerb_height(tagged) if full else (0.0, False)
    extract.repaired["way: unreadable kerb taken as raised"] += ignored
    ways, crossing = extract.ways, "crossing" in (tagged.get("footway"), tagged.get("path"), tagged.get("cycleway"))
    for second, (direction, access) in enumerate(walked):
        ways.add(refs if direction >= 0 else refs[::-1], extract.names[name])
        ways.kinds.append(_KIND_CODES[tagged["highway"]])
        ways.widths.append(width)
        ways.one_way.append(direction != 0)
        ways.second.append(second)
        ways.openings.append(extract.openings[access.opening])
        ways.restricted.append(access.restricted)
        ways.inclines.append(incline if direction >= 0 else -incline)
        ways.kerbs.append(kerb)
        ways.levels.append(extract.levels[tagged.get("level") or tagged.get("layer", "")])
        ways.crossing.append(crossing)
    _note(extract, "way", *(access for _, access in walked))


def _read_nodes(file: Any, extract: Extract) -> None:
    """Read the nodes along ways; of several versions the latest counts."""
    courses = (extract.ways, extract.roads, extract.ferries)
    ids = np.unique(np.concatenate([np.array(ways.refs, np.int64) for ways in courses]))
    found, versions, lon, lat = array("q"), array("q"), array("d"), array("d")
    tagged: dict[int, dict[str, str]] = {}
    nodes = osmium.FileProcessor(file, osmium.osm.NODE)
    if ids[0] >= 0 and ids[-1] < _LARGEST_ID:
        nodes = nodes.with_filter(osmium.filter.IdFilter(ids.tolist()))
    for node in nodes:
        if not isinstance(node, osmium.osm.Node):
            continue
        location = node.location
        there = not node.deleted and location.valid()
        if there and len(node.tags):
            tagged[len(found)] = dict(node.tags)
        found.append(node.id)
        versions.append(node.version)
        lon.append(location.lon if there else np.nan)
        lat.append(location.lat if there else np.nan)
    numbers = np.array(found, np.int64)
    order = np.lexsort((np.array(versions, np.int64), numbers))  # stable: of the same version the last in the file
    rows = order[np.append(numbers[order][1:] != numbers[order][:-1], True)[: len(order)]]
    at = np.minimum(np.searchsorted(ids, numbers[rows]), len(ids) - 1)
    needed = ids[at] == numbers[rows]
    rows, at = rows[needed], at[needed]
    place, kind = np.full((len(ids), 2), np.nan), np.zeros(len(ids), np.int8)
    index_of_row = dict(zip(*(column[np.isin(rows, list(tagged))].tolist() for column in (rows, at)), strict=True))
    for row, index in index_of_row.items():
        kind[index] = tags.crossing_kind(tagged[row])
        _note_obstacle(extract, int(ids[index]), tagged[row])
    numbers, places = (np.array(column) for column in extract.located)
    place[np.searchsorted(ids, numbers.astype(np.int64))] = places.reshape(-1, 2)
    place[at] = np.stack([lon, lat], axis=1)[rows]
    extract.nodes = Nodes(ids, place, kind)


def _note_obstacle(extract: Extract, number: int, tagged: dict[str, str]) -> None:
    """Keep what stands at a node on a way."""
    found = passage(tagged)
    if found is not None:
        extract.passages[number] = found
        _note(extract, "node", found)
    if tagged.get("highway") == "elevator":
        extract.lifts.add(number)
    kerb, ignored = kerb_height(tagged)
    extract.repaired["node: unreadable kerb taken as raised"] += ignored
    if kerb > 0:
        extract.kerbs[number] = kerb


def _note(extract: Extract, what: str, *found: Access) -> None:
    """Count what limits a way or node, and what was ignored."""
    limits = {"closed" if one.opening == NEVER else "opening times" for one in found if one.opening}
    if any(one.restricted for one in found):
        limits.add("for destinations only")
    extract.limited.update(f"{what}: {limit}" for limit in limits)
    extract.repaired.update(f"{what}: {note}" for note in {note for one in found for note in one.notes})


def _locate(extract: Extract, way: Any) -> None:
    """Keep the places of nodes that stand with a way, as Overpass writes them."""
    if way.nodes[0].location.valid() or way.nodes[-1].location.valid():
        numbers, places = extract.located
        for node in way.nodes:
            if node.location.valid():
                numbers.append(node.ref)
                places.extend((node.location.lon, node.location.lat))


def _printable(name: str) -> str:
    """Remove unprintable characters, which other file formats do not allow."""
    return "".join(sign for sign in name if sign.isprintable()).strip()[:_LONGEST_NAME].rstrip()
