"""OpenStreetMap files as tables: what is walked, the nodes along it, and what stands in the way.

The only module that imports osmium. A file is read in turns: its relations, its ways, again if there are several
versions of them, of which the latest count, and the nodes along these.
"""

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import osmium

from sidestep.files import reading
from sidestep.network import measures, tags
from sidestep.network.access import NEVER, Access, access
from sidestep.network.extract import Extract, Ways
from sidestep.network.obstacles import kerb_height, passage
from sidestep.network.osm_files import OsmError, file_format, packed_format, rewritten_xml
from sidestep.network.rings import closed_rings
from sidestep.network.streets import Nodes

_LONGEST_NAME = 255  # characters; OpenStreetMap takes no more
_LARGEST_ID = 2**36  # the reader's filter takes smaller ones only; larger and negative ones are filtered here
_POLE = 90 * 10**7  # latitude of the North Pole in the units of files
_ABOUT_RELATIONS = frozenset({"type", "source", "created_by", "note", "fixme"})
"""Tags of multipolygons that do not say of what."""
_KIND_CODES = {kind: code for code, kind in enumerate(tags.KINDS)}


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
        At least one way or area, and all nodes that they name.

    Raises
    ------
    OsmError
        Another ending; a file that is missing, damaged, not an extract, or without walkable ways.
    """
    kind = file_format(path)
    # The reader opens the file itself, but might take its name for a web address, or for the standard input.
    with reading(path, OsmError, "OpenStreetMap data") as opened:
        if not (begins := opened.read(64)):
            raise OsmError("it is empty")
        kind = packed_format(kind, begins)
        xml = None if kind == "pbf" else rewritten_xml(path)
        file = osmium.io.File(str(path.resolve()), kind) if xml is None else osmium.io.FileBuffer(xml, "osm")
        try:
            return _read(file, widths)
        except osmium.InvalidLocationError as error:
            raise OsmError(f"it is damaged: {error}") from error


def _read(file: Any, widths: Mapping[str, float]) -> Extract:
    """Read relations, ways and nodes."""
    relations = _read_relations(file)
    extract, latest = _read_ways(file, widths, relations, None)
    if latest is not None:
        extract, _ = _read_ways(file, widths, relations, latest)
    _add_relations(extract, relations, widths)
    if not extract.ways.counts and not extract.areas.counts:
        found = f"none of its {extract.read:,} highways is walkable" if extract.read else "it holds no highways"
        raise OsmError(f"no streets for walkers: {found}")
    _read_nodes(file, extract)
    return extract


@dataclass(eq=False)
class _Relations:
    """Multipolygons that might be walked, and ferries."""

    tagged: dict[int, dict[str, str]] = field(default_factory=dict)
    """Their tags by number, with their kind as ``highway``."""
    members: dict[int, list[tuple[int, bool]]] = field(default_factory=dict)
    """Numbers of their ways, and whether these are around holes."""
    pieces: dict[int, list[int]] = field(default_factory=dict)
    """Nodes of these ways, as far as the file has them."""
    outer: set[int] = field(default_factory=set)
    """Numbers of ways around those that are walked, which are no areas of their own then."""
    ferries: dict[int, dict[str, str]] = field(default_factory=dict)
    """Tags of ferries by the numbers of the ways along which they go."""
    untagged: dict[int, int] = field(default_factory=dict)
    """Relations with no tags of their own, by the ways around them, whose tags they have if these are areas."""
    adopted: dict[int, dict[str, str]] = field(default_factory=dict)
    """Tags of such ways by the numbers of their relations."""


def _read_relations(file: Any) -> _Relations:
    """Read multipolygons that might be walked, and ferries; of several versions the latest counts."""
    found = _Relations()
    versions: dict[int, int] = {}
    for relation in osmium.FileProcessor(file, osmium.osm.RELATION):
        if not isinstance(relation, osmium.osm.Relation):
            continue
        number = relation.id
        if relation.version < versions.get(number, 0):
            continue
        versions[number] = relation.version
        found.tagged.pop(number, None)
        found.members.pop(number, None)
        tagged = dict(relation.tags)
        kind = tags.way_kind(tagged)
        ferry = kind == tags.FERRY
        if relation.deleted or tagged.get("type") != ("route" if ferry else "multipolygon"):
            continue
        if ferry or (kind is not None and tagged.get("area") != "no") or tagged.keys() <= _ABOUT_RELATIONS:
            if kind is not None:
                found.tagged[number] = {**tagged, "highway": kind}
            members = [(member.ref, member.role == "inner") for member in relation.members if member.type == "w"]
            found.members[number] = members
    for number, members in [*found.members.items()]:
        tagged = found.tagged.get(number, {})
        if tagged.get("highway") == tags.FERRY:
            found.ferries.update((way, tagged) for way, _ in members)
            del found.tagged[number], found.members[number]
            continue
        found.pieces.update((way, []) for way, _ in members)
        outer = [way for way, inner in members if not inner]
        if number not in found.tagged:
            found.untagged.update(dict.fromkeys(outer, number))
        elif tags.exclusion_reason(found.tagged[number]) is None:
            found.outer.update(outer)
    return found


def _read_ways(
    file: Any, widths: Mapping[str, float], relations: _Relations, latest: dict[int, int] | None
) -> tuple[Extract, dict[int, int] | None]:
    """Read ways; of several versions only the given ones, which are returned if they are not known yet."""
    extract = Extract()
    relations.adopted.clear()
    versions: dict[int, int] = {}
    several = False
    for way in osmium.FileProcessor(file, osmium.osm.WAY):
        if not isinstance(way, osmium.osm.Way):
            continue
        number, version = way.id, way.version
        known = versions.get(number)
        several |= known is not None and known != version
        versions[number] = version if known is None else max(known, version)
        if number in relations.pieces and (latest is None or version == latest[number]):
            relations.pieces[number] = [] if way.deleted else [node.ref for node in way.nodes]
            _locate(extract, way)
        if way.deleted or not (len(way.tags) or number in relations.ferries):
            continue
        tagged = dict(way.tags)
        kind = tags.way_kind(tagged)
        if kind is None and number in relations.ferries:
            tagged, kind = relations.ferries[number], tags.FERRY
        if kind is None:
            continue
        extract.read += 1
        if latest is not None and version != latest[number]:
            extract.dropped["way: older version"] += 1
        elif known == version:
            extract.dropped["way: repeated number"] += 1
        else:
            _add_way(extract, way, {**tagged, "highway": kind}, widths, relations)
    return extract, versions if several else None


def _add_way(
    extract: Extract, way: Any, tagged: dict[str, str], widths: Mapping[str, float], relations: _Relations
) -> None:
    """Add a way to what is walked, or to what is not."""
    refs = [node.ref for node in way.nodes]
    walked = tags.directions(tagged)
    excluded = tags.exclusion_reason(tagged)
    if len(refs) < 2:
        excluded = excluded or "way: fewer than two nodes"
    if not walked:
        excluded = excluded or "way: contradicting directions"
    name = _name(tagged)
    if excluded is not None:
        extract.dropped[excluded] += 1
        ferry = tagged["highway"] == tags.FERRY
        if ferry and any(right.opening != NEVER for _, right in walked) and len(refs) > 1:
            extract.ferries.add(refs)
        elif name and not ferry and tagged["highway"] in tags.WIDTHS:
            extract.roads.add(refs, extract.names[name])
        else:
            return
        _locate(extract, way)
        return
    _locate(extract, way)
    if tags.is_area(tagged, refs[0] == refs[-1]):
        if way.id in relations.untagged:
            relations.adopted.setdefault(relations.untagged[way.id], tagged)
        if way.id in relations.outer or way.id in relations.untagged:
            extract.dropped["area: mapped by a relation as well"] += 1
            return
        _add_area(extract, [(refs, False)], tagged, widths, whole=True)
        return
    extract.walkable += 1
    for second, (direction, right) in enumerate(walked):
        _add_row(extract, extract.ways, refs if direction >= 0 else refs[::-1], tagged, widths, direction, right)
        extract.ways.second[-1] = second
    _note_unreadable(extract, tagged)
    _note(extract, "way", *(right for _, right in walked))


def _add_relations(extract: Extract, relations: _Relations, widths: Mapping[str, float]) -> None:
    """Add multipolygons, with what does not close of their rings."""
    for number, tagged in {**relations.tagged, **relations.adopted}.items():
        extract.read += 1
        excluded = tags.exclusion_reason(tagged)
        members = relations.members[number]
        if excluded is None and not any(relations.pieces[way] for way, _ in members):
            excluded = "way: fewer than two nodes"
        if excluded is not None:
            extract.dropped[excluded] += 1
            continue
        rings: list[tuple[list[int], bool]] = []
        whole = all(relations.pieces[way] for way, _ in members)
        for around_hole in (False, True):
            pieces = [relations.pieces[way] for way, inner in members if inner == around_hole]
            closed, open_ones = closed_rings(pieces)
            whole &= not open_ones
            rings += [(refs, around_hole) for refs in (*closed, *open_ones)]
        _add_area(extract, rings, tagged, widths, whole)


def _add_area(
    extract: Extract,
    rings: list[tuple[list[int], bool]],
    tagged: dict[str, str],
    widths: Mapping[str, float],
    whole: bool,
) -> None:
    """Add an area by its rings, each with whether it is around a hole; and whether they are whole."""
    extract.walkable += 1
    areas, right = extract.areas, access(tagged)
    number = areas.numbers[-1] + 1 if areas.numbers else 0
    for refs, inner in rings:
        _add_row(extract, areas, refs, tagged, widths, 0, right)
        areas.numbers.append(number)
        areas.inner.append(inner)
        areas.whole.append(whole)
    _note_unreadable(extract, tagged)
    _note(extract, "way", right)


def _add_row(
    extract: Extract,
    ways: Ways,
    refs: list[int],
    tagged: dict[str, str],
    widths: Mapping[str, float],
    direction: int,
    right: Access,
) -> None:
    """Add a row to a table of ways."""
    ways.add(refs, extract.names[_name(tagged)])
    ways.kinds.append(_KIND_CODES[tagged["highway"]])
    ways.widths.append(measures.walkable_width(tagged, widths)[0])
    ways.one_way.append(direction != 0)
    ways.second.append(0)
    ways.openings.append(extract.openings[right.opening])
    ways.restricted.append(right.restricted)
    incline, _ = measures.incline(tagged)
    ways.inclines.append(incline if direction >= 0 else -incline)
    ways.kerbs.append(kerb_height(tagged)[0] if tagged["highway"] in tags.FULL_WIDTH else 0.0)
    ways.levels.append(extract.levels[tagged.get("level") or tagged.get("layer", "")])
    ways.crossing.append("crossing" in (tagged.get("footway"), tagged.get("path"), tagged.get("cycleway")))
    ways.storeys.append(tags.storey(tagged))


def _note_unreadable(extract: Extract, tagged: dict[str, str]) -> None:
    """Count measures of a way that cannot be read."""
    kerb = tagged["highway"] in tags.FULL_WIDTH and kerb_height(tagged)[1]
    extract.repaired["way: unreadable width ignored"] += measures.walkable_width(tagged)[1]
    extract.repaired["way: incline without a readable number ignored"] += measures.incline(tagged)[1]
    extract.repaired["way: unreadable kerb taken as raised"] += kerb


def _read_nodes(file: Any, extract: Extract) -> None:
    """Read the nodes along ways; of several versions the latest counts."""
    courses = (extract.ways, extract.areas, extract.roads, extract.ferries)
    ids = np.unique(np.concatenate([np.array(ways.refs, np.int64) for ways in courses]))
    found, versions, lon, lat = array("q"), array("q"), array("d"), array("d")
    tagged: dict[int, dict[str, str]] = {}
    swapped = False
    nodes = osmium.FileProcessor(file, osmium.osm.NODE)
    if ids[0] >= 0 and ids[-1] < _LARGEST_ID:
        nodes = nodes.with_filter(osmium.filter.IdFilter(ids.tolist()))
    for node in nodes:
        if not isinstance(node, osmium.osm.Node):
            continue
        location = node.location
        there = not node.deleted and location.valid()
        swapped |= not node.deleted and _POLE < abs(location.y) <= 2 * _POLE and abs(location.x) <= _POLE
        if there and len(node.tags):
            tagged[len(found)] = dict(node.tags)
        found.append(node.id)
        versions.append(node.version)
        lon.append(location.lon if there else np.nan)
        lat.append(location.lat if there else np.nan)
    if swapped and np.isnan(lat).all():
        raise OsmError("no node has a latitude of -90 to 90 degrees; latitude and longitude are swapped")
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
    if len(way.nodes) and (way.nodes[0].location.valid() or way.nodes[-1].location.valid()):
        numbers, places = extract.located
        for node in way.nodes:
            if node.location.valid():
                numbers.append(node.ref)
                places.extend((node.location.lon, node.location.lat))


def _name(tagged: dict[str, str]) -> str:
    """Take a way's own name, or that of the street along which it runs."""
    return _printable(tagged.get("name") or tagged.get("is_sidepath:of:name", ""))


def _printable(name: str) -> str:
    """Remove unprintable characters, which other file formats do not allow."""
    return "".join(sign for sign in name if sign.isprintable()).strip()[:_LONGEST_NAME].rstrip()
