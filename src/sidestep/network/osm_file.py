"""Reading walkable ways, and the nodes along them, from OpenStreetMap files. The only module that imports osmium.

A file is read twice: first its ways, then the nodes of walkable ways. Relations are not read, so an area mapped as a
multipolygon has no outline to walk along.
"""

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import osmium
from jaxtyping import Int64

from sidestep.errors import SidestepError
from sidestep.files import reading
from sidestep.network.streets import Nodes
from sidestep.network.tags import WIDTHS, CrossingKind, crossing_kind, direction, exclusion_reason, walkable_width

FORMATS = {".osm": "osm", ".osm.gz": "osm.gz", ".osm.bz2": "osm.bz2", ".osm.pbf": "pbf", ".pbf": "pbf"}
"""The reader's name of the format that each ending of a file name stands for."""

_LONGEST_NAME = 255  # characters; OpenStreetMap takes no more
_LARGEST_ID = 2**36  # the reader's filter takes smaller ones only; larger and negative ones are filtered here


class OsmError(SidestepError):
    """An unusable OpenStreetMap file or import option; ``line`` is known for damaged XML, ``field`` for options."""


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


def read_walkable(path: Path, widths: Mapping[str, float]) -> tuple[Ways, Nodes]:
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
    kinds = list(WIDTHS)
    seen: set[int] = set()
    for way in osmium.FileProcessor(file, osmium.osm.WAY).with_filter(osmium.filter.KeyFilter("highway")):
        if not isinstance(way, osmium.osm.Way) or way.deleted:
            continue
        ways.read += 1
        tags = dict(way.tags)
        refs = [node.ref for node in way.nodes]
        excluded = "way: repeated number" if way.id in seen else exclusion_reason(tags)
        if len(refs) < 2:
            excluded = excluded or "way: fewer than two nodes"
        seen.add(way.id)
        if excluded is not None:
            ways.dropped[excluded] += 1
            continue
        width, ignored = walkable_width(tags, widths)
        ways.repaired["way: unreadable width ignored"] += ignored
        walked = direction(tags)
        ways.refs.extend(refs if walked >= 0 else refs[::-1])
        ways.counts.append(len(refs))
        ways.kinds.append(kinds.index(tags["highway"]))
        ways.names.append(ways.name_codes.setdefault(_printable(tags.get("name", "")), len(ways.name_codes)))
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
        kinds.append(crossing_kind(dict(node.tags)) if len(node.tags) else CrossingKind.NONE)
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
