"""OpenStreetMap files as tables: what is walked, the nodes along it, and what stands in the way.

A file is read in turns: its relations, its ways, again if there are several versions of them, of which the latest
count, and the nodes along these. Only this module and `sidestep.network.osm_relations` import osmium.
"""

from array import array
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import osmium

from sidestep.files import reading
from sidestep.network import tags
from sidestep.network.access import NEVER, Access, Tags
from sidestep.network.extract import Extract, Ways
from sidestep.network.meanings import Meaning, meanings, way_name
from sidestep.network.obstacles import kerb_height, passage
from sidestep.network.osm_files import OsmError, file_format, packed_format, rewritten_xml
from sidestep.network.osm_relations import Relations, read_relations
from sidestep.network.rings import closed_rings
from sidestep.network.streets import Nodes

_LARGEST_ID = 2**36  # the reader's filter takes smaller ones only; larger and negative ones are filtered here
_POLE = 90 * 10**7  # latitude of the North Pole in the units of files
_KIND_CODES = {kind: code for code, kind in enumerate(tags.KINDS)}


def read_extract(path: Path, widths: Mapping[str, float]) -> Extract:
    """Read the walkable ways of a file, and the nodes along them.

    Parameters
    ----------
    path
        The file; it is recognised by its name, and by how it begins.
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
            return _read(file, meanings(widths))
        except osmium.InvalidLocationError as error:
            raise OsmError(f"it is damaged: {error}") from error


def _read(file: Any, meaning: Callable[[Tags], Meaning]) -> Extract:
    """Read relations, ways and nodes."""
    relations = read_relations(file)
    extract, latest = _read_ways(file, meaning, relations, None)
    if latest is not None:
        extract, _ = _read_ways(file, meaning, relations, latest)
    _add_relations(extract, relations, meaning)
    if not extract.ways.counts and not extract.areas.counts:
        found = f"none of its {extract.read:,} highways is walkable" if extract.read else "it holds no highways"
        raise OsmError(f"no streets for walkers: {found}")
    _read_nodes(file, extract)
    return extract


def _read_ways(
    file: Any, meaning: Callable[[Tags], Meaning], relations: Relations, latest: dict[int, int] | None
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
            said = meaning({**tagged, "highway": kind})
            _add_way(extract, way, said, way_name(tagged), relations)
    return extract, versions if several else None


def _add_way(extract: Extract, way: Any, said: Meaning, name: str, relations: Relations) -> None:
    """Add a way to what is walked, or to what is not."""
    refs = [node.ref for node in way.nodes]
    excluded = said.excluded or ("way: fewer than two nodes" if len(refs) < 2 else None)
    if excluded is not None:
        extract.dropped[excluded] += 1
        ferry = said.kind == tags.FERRY
        if ferry and said.walked and len(refs) > 1:
            extract.ferries.add(refs)
        elif name and not ferry and said.kind in tags.WIDTHS:
            extract.roads.add(refs, extract.names[name])
        else:
            return
        _locate(extract, way)
        return
    _locate(extract, way)
    if said.area and refs[0] == refs[-1]:
        if way.id in relations.untagged:
            relations.adopted.setdefault(relations.untagged[way.id], (said, name))
        if way.id in relations.outer or way.id in relations.untagged:
            extract.dropped["area: mapped by a relation as well"] += 1
            return
        _add_area(extract, [(refs, False)], said, name, whole=True)
        return
    extract.walkable += 1
    for second, (direction, right) in enumerate(said.walked):
        _add_row(extract, extract.ways, refs if direction >= 0 else refs[::-1], said, name, direction, right)
        extract.ways.second[-1] = second
    extract.repaired.update(said.notes)
    _note(extract, "way", *(right for _, right in said.walked))


def _add_relations(extract: Extract, relations: Relations, meaning: Callable[[Tags], Meaning]) -> None:
    """Add multipolygons, with what does not close of their rings."""
    own = {number: (meaning(tagged), way_name(tagged)) for number, tagged in relations.tagged.items()}
    for number, (said, name) in {**own, **relations.adopted}.items():
        extract.read += 1
        excluded = said.excluded
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
        _add_area(extract, rings, said, name, whole)


def _add_area(extract: Extract, rings: list[tuple[list[int], bool]], said: Meaning, name: str, whole: bool) -> None:
    """Add an area by its rings, each with whether it is around a hole; and whether they are whole."""
    extract.walkable += 1
    areas = extract.areas
    number = areas.numbers[-1] + 1 if areas.numbers else 0
    for refs, inner in rings:
        _add_row(extract, areas, refs, said, name, 0, said.right)
        areas.numbers.append(number)
        areas.inner.append(inner)
        areas.whole.append(whole)
    extract.repaired.update(said.notes)
    _note(extract, "way", said.right)


def _add_row(
    extract: Extract, ways: Ways, refs: list[int], said: Meaning, name: str, direction: int, right: Access
) -> None:
    """Add a row to a table of ways."""
    ways.add(refs, extract.names[name])
    ways.kinds.append(_KIND_CODES[said.kind])
    ways.widths.append(said.width)
    ways.one_way.append(direction != 0)
    ways.second.append(0)
    ways.openings.append(extract.openings[right.opening])
    ways.restricted.append(right.restricted)
    ways.inclines.append(said.incline if direction >= 0 else -said.incline)
    ways.kerbs.append(said.kerb)
    ways.levels.append(extract.levels[said.level])
    ways.crossing.append(said.crossing)
    ways.storeys.append(said.storey)


def _read_nodes(file: Any, extract: Extract) -> None:
    """Read the nodes along ways; of several versions the latest counts."""
    courses = (extract.ways, extract.areas, extract.roads, extract.ferries)
    ids = np.sort(np.concatenate([np.array(ways.refs, np.int64) for ways in courses]))
    ids = ids[np.append(True, np.diff(ids) > 0)]  # np.unique takes forty times as long for so many
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
    found = tuple(one for one in found if one.opening or one.restricted or one.notes)
    if not found:  # most
        return
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
