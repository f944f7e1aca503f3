"""Towns in files: our own format, GraphML as osmnx has it, and GeoJSON. The only module that imports networkx."""

import ast
import json
import math
import re
import warnings
from collections import defaultdict
from collections.abc import Iterable
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float, Float64

from sidestep.files import check_unpacked, reading, whole_file, write_text
from sidestep.network.tags import UNKNOWN_WIDTH, WHOLE, WIDTHS, parse_width
from sidestep.network.town import SAME_DEGREES, Town, TownError, course_lengths

FORMAT = 1  # of our own files; counts up when what they hold changes
SUFFIXES = (".npz", ".graphml", ".geojson")

_ARRAYS = ("place", "ids", "tail", "head", "one_way", "length", "width", "signals", "crossings", "points", "first")
_TYPES = {
    "place": np.float64, "ids": np.int64, "tail": np.int32, "head": np.int32, "one_way": np.bool_,
    "length": np.float32, "width": np.float32, "signals": np.int16, "crossings": np.int16,
    "points": np.float64, "first": np.int64,
}  # fmt: skip
_PAIRED = 1.0  # m that a street's length may differ from there to back, where osmnx has rounded or joined
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LONGEST = 1e9  # m; no street is as long, and single precision holds it
_COUNTS = np.iinfo(np.int16).max


def check_suffix(path: Path) -> str:
    """The ending of a name that a town can be saved under.

    Raises
    ------
    TownError
        Where it is another.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise TownError(f"{path} names no format for streets; its name must end in {', '.join(SUFFIXES)}")
    return suffix


def save_town(town: Town, path: str | Path) -> None:
    """Write a town, whole or not at all, as the name's ending says: .npz, .graphml or .geojson.

    The same town gives the same bytes.

    Raises
    ------
    TownError
        Another ending.
    OutputError
        A place that cannot be written to.
    """
    path = Path(path)
    suffix = check_suffix(path)
    if suffix == ".geojson":
        write_text(path, json.dumps(_features(town), ensure_ascii=False, separators=(",", ":"), allow_nan=False) + "\n")
        return
    with whole_file(path) as temporary, temporary.open("wb") as file:
        if suffix == ".npz":
            np.savez_compressed(file, allow_pickle=False, **_columns(town))
        else:
            _write_graphml(town, file)


def load_town(path: str | Path) -> Town:
    """Read a town from our own format (.npz) or from GraphML, ours or osmnx's.

    Raises
    ------
    TownError
        A file that is not there, cannot be read, is cut short or holds no streets; GeoJSON, which is written only.
    """
    path = Path(path)
    suffix = check_suffix(path)
    if suffix == ".geojson":
        raise TownError(f"{path} cannot be read: GeoJSON does not say which streets meet; load .npz or .graphml")
    # The libraries warn of types that a damaged file leaves out; either it can be read all the same, or not.
    with reading(path, TownError, "town") as file, warnings.catch_warnings(action="ignore"):
        return _read_npz(file) if suffix == ".npz" else _read_graphml(file)


@lru_cache(maxsize=1)
def load_helsinki() -> Town:
    """Central Helsinki, bundled: `scripts/make_helsinki.py` makes it. Read once and shared.

    References
    ----------
    © OpenStreetMap contributors, ODbL 1.0, https://www.openstreetmap.org/copyright.
    """
    with resources.as_file(resources.files("sidestep.network") / "helsinki.npz") as path:
        return load_town(path)


def _columns(town: Town) -> dict[str, np.ndarray]:
    names, name = np.unique(np.array(town.name, np.str_), return_inverse=True)
    kinds, kind = np.unique(np.array(town.kind, np.str_), return_inverse=True)
    return {
        "format": np.array(FORMAT),
        **{column: getattr(town, column) for column in _ARRAYS},
        "names": names, "name": name.astype(np.int32), "kinds": kinds, "kind": kind.astype(np.int32),
        "attribution": np.array(town.attribution),
    }  # fmt: skip


def _read_npz(file: BinaryIO) -> Town:
    check_unpacked(file, TownError)
    with np.load(file, allow_pickle=False) as columns:
        if "format" not in columns:
            raise TownError("it is not a Sidestep town")
        if columns["format"].shape or columns["format"] != FORMAT:
            raise TownError(f"it has town format {columns['format']!s:.20}, and this version reads {FORMAT}")
        arrays = {column: columns[column] for column in _ARRAYS}
        for column, array in arrays.items():
            if array.dtype != _TYPES[column] or array.ndim != 1 + (column in ("place", "points")):
                raise TownError(f"{column} is {array.dtype} with {array.ndim} dimensions")
            if array.ndim == 2 and array.shape[1] != 2:
                raise TownError(f"{column} has {array.shape[1]} columns instead of 2")
        words = {column: _decoded(columns[f"{column}s"], columns[column], column) for column in ("name", "kind")}
        return Town(**arrays, **words, attribution=str(columns["attribution"]))  # type: ignore[arg-type]


def _decoded(vocabulary: np.ndarray, code: np.ndarray, column: str) -> tuple[str, ...]:
    if vocabulary.dtype.kind != "U" or code.dtype.kind != "i" or vocabulary.ndim != 1 or code.ndim != 1:
        raise TownError(f"{column} is not text")
    if len(code) and (code.min() < 0 or code.max() >= len(vocabulary)):
        raise TownError(f"{column} has a number without a text")
    words = vocabulary.tolist()
    return tuple(words[number] for number in code.tolist())


def _features(town: Town) -> dict[str, object]:
    """GeoJSON (RFC 7946): a line a street."""
    points = np.round(town.points, 7).tolist()
    first = town.first.tolist()
    return {
        "type": "FeatureCollection",
        "attribution": town.attribution,
        "features": [
            {
                "type": "Feature",
                "id": street,
                "properties": {
                    "tail": int(town.ids[town.tail[street]]),
                    "head": int(town.ids[town.head[street]]),
                    "one_way": bool(town.one_way[street]),
                    "length": round(float(town.length[street]), 2),
                    "width": round(float(town.width[street]), 2),
                    "kind": town.kind[street],
                    "name": town.name[street],
                    "signals": int(town.signals[street]),
                    "crossings": int(town.crossings[street]),
                },
                "geometry": {"type": "LineString", "coordinates": points[first[street] : first[street + 1]]},
            }
            for street in range(town.streets)
        ],
    }


def _write_graphml(town: Town, file: BinaryIO) -> None:
    """Write what osmnx.load_graphml takes: every value as text, an edge for each direction.

    osmnx tells the two directions of a street by their `osmid`. Joined streets have no way's number any more, so they
    are numbered anew, and negatively, as OpenStreetMap's editors number what is not in the database.
    """
    import networkx as nx

    graph = nx.MultiDiGraph(
        crs="epsg:4326", simplified="True", created_with="Sidestep", attribution=town.attribution, name="streets"
    )
    ids = town.ids.tolist()
    if len(set(ids)) < len(ids):
        raise TownError("crossings with the same number cannot be saved as GraphML")
    meeting = np.bincount(np.concatenate([town.tail, town.head]), minlength=town.nodes).tolist()
    for number, (x, y), streets in zip(ids, town.place.tolist(), meeting, strict=True):
        graph.add_node(number, x=str(x), y=str(y), street_count=str(streets))
    segments = zip(*(values.tolist() for values in town.street_of_segment()), strict=True)
    for street, backwards in sorted(segments):
        ends = ids[town.tail[street]], ids[town.head[street]]
        course = town.course(street)[::-1] if backwards else town.course(street)
        values = {
            "osmid": -1 - street,
            "highway": town.kind[street],
            "name": town.name[street],
            "oneway": bool(town.one_way[street]),
            "reversed": backwards,
            "length": float(town.length[street]),
            "width": float(town.width[street]),
            "signals": int(town.signals[street]),
            "crossings": int(town.crossings[street]),
            "street": street,
        }
        if len(course) > 2:
            values["geometry"] = "LINESTRING (" + ", ".join(f"{x!r} {y!r}" for x, y in course.tolist()) + ")"
        graph.add_edge(*(ends[::-1] if backwards else ends), **{k: str(v) for k, v in values.items() if v != ""})
    nx.write_graphml_xml(graph, file)


class _Edge:
    """One directed edge of a GraphML file, its values made sense of."""

    def __init__(
        self, number: int, tail: int, head: int, values: dict[str, Any], place: Float[np.ndarray, "node 2"]
    ) -> None:
        self.number, self.tail, self.head = number, tail, head
        self.course = _course(values.get("geometry"), place[tail], place[head], number)
        kind = _words(values.get("highway"))
        self.kind = kind[0] if kind else ""
        self.name = " / ".join(_words(values.get("name")))
        self.osmid = tuple(sorted(_words(values.get("osmid"))))
        # Joined ways that were drawn in both directions have both values: the edge is not backwards of anything.
        self.reversed = _words(values.get("reversed")) == ["True"]
        self.street = _count(values.get("street", -1), "street", number, -1, 2**53)
        self.signals = _count(values.get("signals", 0), "signals", number, 0, _COUNTS)
        self.crossings = _count(values.get("crossings", 0), "crossings", number, 0, _COUNTS)
        measured = float(course_lengths(self.course, np.array([0, len(self.course)]))[0])
        self.length = _number(values["length"], "length", number) if "length" in values else measured
        self.width = _width(values, self.kind, number)


def _read_graphml(file: BinaryIO) -> Town:
    import networkx as nx

    try:
        graph = nx.read_graphml(file, node_type=str, force_multigraph=True)
    except nx.NetworkXException as error:
        raise TownError(str(error)) from error
    if not graph.is_directed():
        raise TownError("its edges have no direction; save the directed graph")
    crs = str(graph.graph.get("crs", "epsg:4326")).lower()
    if crs not in ("epsg:4326", "wgs84", "wgs 84", "ogc:crs84"):
        raise TownError(f"its coordinates are in {crs:.40}, not in degrees (epsg:4326)")
    labels = list(graph.nodes)
    place = np.array([[_number(graph.nodes[node].get(axis), axis, node) for axis in "xy"] for node in labels])
    place = place.reshape(len(labels), 2)
    if not (np.abs(place) <= (180, 90)).all():
        worst = labels[int(np.argmin((np.abs(place) <= (180, 90)).all(axis=1)))]
        raise TownError(f"node {worst:.40} lies outside longitude -180 to 180 and latitude -90 to 90")
    number = {node: index for index, node in enumerate(labels)}
    edges = [
        _Edge(count, number[u], number[v], values, place)
        for count, (u, v, values) in enumerate(graph.edges(data=True))
        if u != v
    ]
    if not edges:
        raise TownError("it has no streets between two crossings")
    streets = _paired(edges)
    used, ends = np.unique([[edge.tail, edge.head] for edge, _ in streets], return_inverse=True)
    ends = ends.reshape(-1, 2)
    return Town(
        place=place[used],
        ids=np.array([_identity(labels[node], node) for node in used.tolist()], np.int64),
        tail=ends[:, 0].astype(np.int32),
        head=ends[:, 1].astype(np.int32),
        one_way=np.array([one_way for _, one_way in streets]),
        length=np.array([edge.length for edge, _ in streets], np.float32),
        width=np.array([edge.width for edge, _ in streets], np.float32),
        kind=tuple(edge.kind for edge, _ in streets),
        name=tuple(edge.name for edge, _ in streets),
        signals=np.array([edge.signals for edge, _ in streets], np.int16),
        crossings=np.array([edge.crossings for edge, _ in streets], np.int16),
        points=np.concatenate([edge.course for edge, _ in streets]),
        first=np.cumsum([0, *(len(edge.course) for edge, _ in streets)], dtype=np.int64),
        attribution=str(graph.graph.get("attribution", "© OpenStreetMap contributors, ODbL 1.0")),
    )


def _paired(edges: Iterable[_Edge]) -> list[tuple[_Edge, bool]]:
    """Each street once, and whether it is one-way: no edge leads back with the same numbers and the same length."""
    between: defaultdict[tuple[object, ...], list[_Edge]] = defaultdict(list)
    for edge in edges:
        between[min(edge.tail, edge.head), max(edge.tail, edge.head), edge.osmid].append(edge)
    streets = []
    for group in between.values():
        waiting = sorted((edge for edge in group if edge.tail > edge.head), key=lambda edge: edge.length)
        for edge in sorted((edge for edge in group if edge.tail < edge.head), key=lambda edge: edge.length):
            back = min(waiting, key=lambda other: abs(other.length - edge.length), default=None)
            if back is None or abs(back.length - edge.length) > _PAIRED:
                streets.append((edge, True))
                continue
            waiting.remove(back)
            forth = back if edge.reversed and not back.reversed else edge
            streets.append((forth, False))
        streets += [(edge, True) for edge in waiting]
    return sorted(streets, key=lambda street: (street[0].street, street[0].number))


def _course(
    geometry: str | None, start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"], edge: int
) -> Float64[np.ndarray, "point 2"]:
    """The points of a line in well-known text, or a straight line; both ends are where the crossings are."""
    if geometry is None:
        return np.stack([start, end])
    text = geometry.strip()
    if not text.upper().startswith("LINESTRING"):
        raise TownError(f"edge {edge} has the geometry {text:.30}, which is no LINESTRING")
    numbers = np.array([float(found) for found in _NUMBER.findall(text)])
    inner = text[len("LINESTRING") :].strip()
    if (
        not (inner.startswith("(") and inner.endswith(")"))
        or len(numbers) < 4
        or len(numbers) != 2 * text.count(",") + 2
    ):
        raise TownError(f"edge {edge} has a LINESTRING that is not of pairs of numbers")
    points = numbers.reshape(-1, 2)
    ends = [start[None]] * bool(np.abs(points[0] - start).max() > SAME_DEGREES)
    tails = [end[None]] * bool(np.abs(points[-1] - end).max() > SAME_DEGREES)
    return np.concatenate([*ends, points, *tails])


def _words(value: object) -> list[str]:
    """What osmnx wrote as one value, or as the text of a list of values."""
    text = "" if value is None else str(value).strip()
    if text.startswith("[") and text.endswith("]"):
        try:
            listed = ast.literal_eval(text)
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            return [text]
        if isinstance(listed, list):
            return list(dict.fromkeys(str(each) for each in listed))
    return [text] if text else []


def _width(values: dict[str, Any], kind: str, edge: int) -> float:
    """The narrowest of the widths that are given and make sense, or what is usual for the kind.

    On a road, osmnx passes on the width of the carriageway, which is not walked.
    """
    said = _words(values.get("width"))
    if "street" in values and said:
        return _number(said[0], "width", edge)  # our own, which may come from a join of the table's
    found = [width for width in map(parse_width, said) if width is not None and kind in WHOLE]
    return min(found, default=WIDTHS.get(kind, UNKNOWN_WIDTH))


def _number(value: object, what: str, where: object) -> float:
    try:
        number = float(str(value))
    except ValueError:
        number = math.nan
    if not abs(number) < _LONGEST:
        raise TownError(f"{what} of {where!s:.40} is {value!s:.40}, which is no number that can be used")
    return number


def _count(value: object, what: str, edge: int, least: int, most: int) -> int:
    text = str(value)
    if not re.fullmatch(r"-?\d{1,18}", text) or not least <= int(text) <= most:
        raise TownError(f"{what} of edge {edge} is {text:.40}; it must be a whole number from {least} to {most}")
    return int(text)


def _identity(label: str, index: int) -> int:
    """OpenStreetMap's number of a node, or its place in the file where it is called something else."""
    return int(label) if re.fullmatch(r"-?\d{1,18}", label) else index
