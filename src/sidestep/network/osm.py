"""OpenStreetMap's files: reading the streets that people walk. The only module that imports osmium.

Nothing is fetched: a file is read twice, first its ways, then the places of the nodes that walked ways go through.
Relations are not read, so an area drawn as a multipolygon has no outline to walk on.
"""

import math
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int, Int8, Int64

from sidestep.errors import SidestepError
from sidestep.files import reason
from sidestep.network import simplify
from sidestep.network import tags as walkable
from sidestep.network.simplify import Streets
from sidestep.network.town import EARTH_RADIUS, Town, course_lengths

MERGE = 8.0  # m
ATTRIBUTION = "© OpenStreetMap contributors, ODbL 1.0"
FORMATS = {".osm": "osm", ".osm.gz": "osm.gz", ".osm.bz2": "osm.bz2", ".osm.pbf": "pbf", ".pbf": "pbf"}

_LONGEST_NAME = 255  # characters; OpenStreetMap takes no more
_LARGEST_ID = 2**36  # the reader's own filter makes room for all smaller ones: larger ones, and negative, are for us
_MOST = np.iinfo(np.int16).max


class OsmError(SidestepError):
    """An OpenStreetMap file, or a wish about it, that cannot be used. One sentence that names the file."""


@dataclass(frozen=True)
class ImportReport:
    """What an import kept, dropped and repaired."""

    source: str
    ways: int  # with a `highway` tag
    walkable: int  # of these
    dropped: dict[str, int]  # by reason: first ways, then streets
    repaired: dict[str, int]
    nodes_before: int  # crossings and ends before merging
    streets_before: int
    kilometres_before: float
    nodes: int
    streets: int
    kilometres: float
    most_exits: int  # streets that leave the busiest crossing


@dataclass(eq=False)
class _Ways:
    """Walked ways as they are read, compactly: extracts hold millions of nodes."""

    refs: "array[int]" = field(default_factory=lambda: array("q"))
    counts: "array[int]" = field(default_factory=lambda: array("q"))
    kinds: "array[int]" = field(default_factory=lambda: array("l"))
    names: "array[int]" = field(default_factory=lambda: array("l"))
    widths: "array[float]" = field(default_factory=lambda: array("d"))
    one_way: "array[int]" = field(default_factory=lambda: array("b"))
    name_codes: dict[str, int] = field(default_factory=dict)
    seen: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    repaired: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True, eq=False)
class _Nodes:
    """The nodes that walked ways go through, in the order of their numbers."""

    ids: Int64[np.ndarray, " node"]
    place: Float64[np.ndarray, "node 2"]  # NaN where the file does not hold the node
    standing: Int8[np.ndarray, " node"]  # see `walkable.standing`


def import_osm(
    path: str | Path, *, merge: float = MERGE, widths: Mapping[str, float] | None = None
) -> tuple[Town, ImportReport]:
    """Read the streets that people walk from an OpenStreetMap file.

    Ways are split where they meet and where an extract cut nodes off; of what remains, the largest part in which
    everybody gets everywhere is kept. `sidestep.network.tags` says what is walked and how wide it is,
    `sidestep.network.simplify` what happens to the crossings.

    Parameters
    ----------
    path
        A file whose name ends in .osm, .osm.gz, .osm.bz2 or .osm.pbf.
    merge
        Crossings joined by a street shorter than this many metres become one, and streets between the same two
        crossings one if they differ by less; 0 leaves them.
    widths
        Widths in metres by kind of street, instead of those in `walkable.WIDTHS`; 0.3 to 100.

    Returns
    -------
    Town, ImportReport
        The streets, and what was kept, dropped and repaired.

    Raises
    ------
    OsmError
        A file that is not there, cannot be read, is cut short or is not OpenStreetMap's; no street left; a distance
        to merge that is negative or no number.
    WidthError
        Widths of unknown kinds or out of range.
    """
    path = Path(path)
    form = _form(path)
    if not (math.isfinite(merge) and merge >= 0):
        raise OsmError(f"crossings can be merged within 0 m or more, not {merge} m")
    table = walkable.width_table(widths)
    _check_readable(path)
    with _reading(path):
        ways = _read_ways(path, form, table)
    if not ways.counts:
        seen = f"none of its {ways.seen:,} highways is walked" if ways.seen else "it holds no highways"
        raise OsmError(f"{path} has no streets for walkers: {seen}")
    with _reading(path):
        nodes = _read_nodes(path, form, ways)
    streets = None if np.isnan(nodes.place).all() else _split(ways, nodes)
    if streets is None or not len(streets):
        raise OsmError(
            f"{path} has no streets: it lacks the nodes that its {len(ways.counts):,} walked ways go through"
        )
    return _town(path, ways, nodes, streets, merge)


def _form(path: Path) -> str:
    lower = path.name.lower()
    for suffix in sorted(FORMATS, key=len, reverse=True):
        if lower.endswith(suffix):
            return FORMATS[suffix]
    raise OsmError(f"{path} is not named like an OpenStreetMap file; its name must end in {', '.join(FORMATS)}")


def _check_readable(path: Path) -> None:
    # Also keeps the reader from taking a name for a web address, or "-" for the standard input.
    try:
        with path.open("rb") as file:
            if not file.read(1):
                raise OsmError(f"{path} is empty")
    except OSError as error:
        raise OsmError(f"cannot read {path}: {reason(error)}") from error


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    import osmium

    try:
        yield
    except (RuntimeError, ValueError, OverflowError, MemoryError, osmium.InvalidLocationError) as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise OsmError(f"{path} is damaged or not an OpenStreetMap file: {said:.200}") from error


def _read_ways(path: Path, form: str, table: Mapping[str, float]) -> _Ways:
    import osmium

    ways = _Ways()
    kinds = list(walkable.WIDTHS)
    seen: set[int] = set()
    source = osmium.io.File(str(path.resolve()), form)
    for way in osmium.FileProcessor(source, osmium.osm.WAY).with_filter(osmium.filter.KeyFilter("highway")):
        if not isinstance(way, osmium.osm.Way) or way.deleted:
            continue
        ways.seen += 1
        if way.id in seen:
            ways.dropped["way: given twice"] += 1
            continue
        seen.add(way.id)
        tags = dict(way.tags)
        refs = [node.ref for node in way.nodes]
        why = walkable.refusal(tags) or ("way: fewer than two nodes" if len(refs) < 2 else None)
        if why is not None:
            ways.dropped[why] += 1
            continue
        width, nonsense = walkable.room(tags, table)
        ways.repaired["way: width that makes no sense, passed over"] += nonsense
        only = walkable.direction(tags)
        ways.refs.extend(refs if only >= 0 else refs[::-1])
        ways.counts.append(len(refs))
        ways.kinds.append(kinds.index(tags["highway"]))
        ways.names.append(ways.name_codes.setdefault(_clean(tags.get("name", "")), len(ways.name_codes)))
        ways.widths.append(width)
        ways.one_way.append(only != 0)
    return ways


def _clean(name: str) -> str:
    """A name without what cannot be printed, which files of other formats could not hold."""
    return "".join(sign for sign in name if sign.isprintable()).strip()[:_LONGEST_NAME].rstrip()


def _read_nodes(path: Path, form: str, ways: _Ways) -> _Nodes:
    import osmium

    ids = np.unique(np.frombuffer(ways.refs, np.int64))
    found, lon, lat, standing = array("q"), array("d"), array("d"), array("b")
    nodes = osmium.FileProcessor(osmium.io.File(str(path.resolve()), form), osmium.osm.NODE)
    if ids[0] >= 0 and ids[-1] < _LARGEST_ID:
        nodes = nodes.with_filter(osmium.filter.IdFilter(ids.tolist()))
    for node in nodes:
        if not isinstance(node, osmium.osm.Node) or node.deleted or not node.location.valid():
            continue
        found.append(node.id)
        lon.append(node.location.lon)
        lat.append(node.location.lat)
        standing.append(walkable.standing(dict(node.tags)) if len(node.tags) else 0)
    place = np.full((len(ids), 2), np.nan)
    stands = np.zeros(len(ids), np.int8)
    if found:
        numbers = np.frombuffer(found, np.int64)
        at = np.minimum(np.searchsorted(ids, numbers), len(ids) - 1)
        needed = ids[at] == numbers
        at = at[needed]
        place[at] = np.stack([np.frombuffer(lon, np.float64), np.frombuffer(lat, np.float64)], axis=1)[needed]
        stands[at] = np.frombuffer(standing, np.int8)[needed]
    return _Nodes(ids, place, stands)


def _split(ways: _Ways, nodes: _Nodes) -> Streets:
    """Cut ways at absent nodes, and wherever a node belongs to several ways or comes twice in one."""
    node = np.searchsorted(nodes.ids, np.frombuffer(ways.refs, np.int64))
    way = np.repeat(np.arange(len(ways.counts)), np.frombuffer(ways.counts, np.int64))
    there = ~np.isnan(nodes.place[node, 0])
    ways.repaired["way: cut where the file lacks nodes"] += len(np.unique(way[~there]))
    cut = np.append(True, (way[1:] != way[:-1]) | ~there[:-1])
    piece = np.cumsum(cut)[there]
    node, way = node[there], way[there]
    again = np.append(False, (node[1:] == node[:-1]) & (piece[1:] == piece[:-1]))
    node, way, piece = node[~again], way[~again], piece[~again]
    other = piece[1:] != piece[:-1]
    ends = np.append(True, other) | np.append(other, True)
    stop = np.flatnonzero(ends | (np.bincount(node, minlength=len(nodes.ids))[node] > 1))
    joined = piece[stop[1:]] == piece[stop[:-1]]
    begin, end = stop[:-1][joined], stop[1:][joined]
    order, first = simplify.spans(begin, end - begin + 1)
    points = nodes.place[node[order]]
    standing = nodes.standing[node]
    inside = {value: np.append(0, np.cumsum(standing == value)) for value in (1, 2)}
    return Streets(
        tail=node[begin],
        head=node[end],
        one_way=np.frombuffer(ways.one_way, np.int8).astype(bool)[way[begin]],
        length=course_lengths(points, first),
        width=np.frombuffer(ways.widths, np.float64)[way[begin]],
        kind=np.array(ways.kinds, np.int64)[way[begin]],
        name=np.array(ways.names, np.int64)[way[begin]],
        signals=inside[2][end] - inside[2][begin + 1],
        crossings=inside[1][end] - inside[1][begin + 1],
        points=points,
        first=first,
    )


def _town(path: Path, ways: _Ways, nodes: _Nodes, streets: Streets, merge: float) -> tuple[Town, ImportReport]:
    dropped, repaired = Counter(ways.dropped), Counter(ways.repaired)
    inside = simplify.largest_part(streets)
    dropped["street: apart from the largest part"] += int((~inside).sum())
    before = streets = simplify.keep(streets, inside)
    own_way = np.array([kind in walkable.WHOLE for kind in walkable.WIDTHS])[streets.kind]
    streets = simplify.give_to_one(streets, nodes.standing, own_way)
    streets, short = simplify.merge_crossings(streets, nodes.place, _flat(nodes.place), nodes.ids, merge)
    dropped["street: within a merged crossing"] += short
    streets, changed = simplify.tidy(streets, merge)
    repaired["crossing: only two streets met, joined"] += changed.pop("joined", 0)
    dropped += changed
    if not len(streets):
        raise OsmError(f"{path} has no street between two crossings, once those within {merge:g} m are merged")
    used, ends = np.unique(np.concatenate([streets.tail, streets.head]), return_inverse=True)
    names, kinds = list(ways.name_codes), list(walkable.WIDTHS)
    town = Town(
        place=nodes.place[used],
        ids=nodes.ids[used],
        tail=ends[: len(streets)].astype(np.int32),
        head=ends[len(streets) :].astype(np.int32),
        one_way=streets.one_way,
        length=streets.length.astype(np.float32),
        width=streets.width.astype(np.float32),
        kind=tuple(kinds[code] for code in streets.kind.tolist()),
        name=tuple(names[code] for code in streets.name.tolist()),
        signals=np.minimum(streets.signals, _MOST).astype(np.int16),
        crossings=np.minimum(streets.crossings, _MOST).astype(np.int16),
        points=streets.points,
        first=streets.first,
        attribution=ATTRIBUTION,
    )
    report = ImportReport(
        source=path.name,
        ways=ways.seen,
        walkable=len(ways.counts),
        dropped={why: number for why, number in dropped.items() if number},
        repaired={what: number for what, number in repaired.items() if number},
        nodes_before=len(np.unique(np.concatenate([before.tail, before.head]))),
        streets_before=len(before),
        kilometres_before=float(before.length.sum()) / 1000,
        nodes=town.nodes,
        streets=town.streets,
        kilometres=town.kilometres,
        most_exits=_most_exits(town),
    )
    return town, report


def _flat(place: Float64[np.ndarray, "node 2"]) -> Float64[np.ndarray, "node 2"]:
    """Metres on a plane, with the scale of the middle's latitude; 0 for nodes that the file does not hold."""
    there = place[~np.isnan(place[:, 0])]
    middle = (there.min(axis=0) + there.max(axis=0)) / 2
    scale = np.radians(EARTH_RADIUS) * np.array([np.cos(np.radians(middle[1])), 1.0])
    return np.nan_to_num((place - middle) * scale)


def _most_exits(town: Town) -> int:
    street, backwards = town.street_of_segment()
    starts: Int[np.ndarray, " segment"] = np.where(backwards, town.head[street], town.tail[street])
    return int(np.bincount(starts).max())
