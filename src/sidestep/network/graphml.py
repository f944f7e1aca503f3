"""Towns as GraphML, as osmnx reads and writes it. The only module that imports networkx."""

import ast
import math
import re
from typing import Any, BinaryIO

import numpy as np
import shapely
from jaxtyping import Float, Float64

from sidestep.network.geodesy import course_lengths
from sidestep.network.measures import parse_width
from sidestep.network.tags import FULL_WIDTH, UNKNOWN_WIDTH, WIDTHS
from sidestep.network.town import ATTRIBUTION, MOST_CROSSINGS, SAME_DEGREES, USUAL, Town, TownError

_PAIRED = 1.0  # m that a street's length may differ from there to back, where osmnx has rounded or joined
_STEEPEST = 10.0  # metres up for each metre
_LONGEST = 1e9  # m; no street is as long, and single precision holds it


def write_graphml(town: Town, file: BinaryIO) -> None:
    """Write what ``osmnx.load_graphml`` reads: every value as text, an edge for each direction.

    osmnx tells the two directions of a street by their ``osmid``. A joined street has no way's number any more, so
    streets are numbered anew, and negatively, as OpenStreetMap's editors number objects outside its database.

    Parameters
    ----------
    town
        The streets.
    file
        Where to write.

    Raises
    ------
    TownError
        Two crossings have the same number.
    """
    import networkx as nx

    graph = nx.MultiDiGraph(
        crs="epsg:4326", simplified="True", created_with="Sidestep", attribution=town.attribution, name="streets"
    )
    ids = town.ids.tolist()
    if len(set(ids)) < len(ids):
        raise TownError("GraphML needs crossings with different numbers; save this town as .npz", field="ids")
    meeting = np.bincount(np.concatenate([town.tail, town.head]), minlength=town.nodes).tolist()
    for number, (x, y), streets in zip(ids, town.place.tolist(), meeting, strict=True):
        graph.add_node(number, x=str(x), y=str(y), street_count=str(streets))
    segments = zip(*(values.tolist() for values in town.street_of_segment()), strict=True)
    for street, backwards in sorted(segments):
        step = -1 if backwards else 1
        tail, head = (ids[town.tail[street]], ids[town.head[street]])[::step]
        course = town.course(street)[::step]
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
            "opening": town.opening[street],
            "restricted": bool(town.restricted[street]),
            "incline": "" if math.isnan(town.incline[street]) else float(town.incline[street]),
            "kerb": float(town.kerb[street]),
            "street": street,
        }
        if len(course) > 2:
            values["geometry"] = shapely.to_wkt(shapely.LineString(course), rounding_precision=-1)
        graph.add_edge(tail, head, **{key: str(value) for key, value in values.items() if value != ""})
    nx.write_graphml_xml(graph, file)


def read_graphml(file: BinaryIO) -> Town:
    """Read a town from a directed graph in degrees, ours or osmnx's.

    Parameters
    ----------
    file
        Where to read.

    Returns
    -------
    Town
        The streets.

    Raises
    ------
    TownError
        A graph that is undirected, not in degrees or without streets; invalid values.
    """
    import networkx as nx

    try:
        graph = nx.read_graphml(file, node_type=str, force_multigraph=True)
    except nx.NetworkXException as error:
        raise TownError(str(error)) from error
    if not graph.is_directed():
        raise TownError("its edges have no direction; save the directed graph", field="edgedefault")
    crs = str(graph.graph.get("crs", "epsg:4326")).lower()
    if crs not in ("epsg:4326", "wgs84", "wgs 84", "ogc:crs84"):
        raise TownError(f"its coordinates are in {crs:.40}, not in degrees (epsg:4326)", field="crs")
    place = np.array(
        [
            [_number(values.get(axis), axis, f"node {label}", most) for axis, most in (("x", 180), ("y", 90))]
            for label, values in graph.nodes(data=True)
        ]
    )
    number = {label: index for index, label in enumerate(graph)}
    numbered = enumerate(graph.edges(data=True))
    edges = [_Edge(count, number[u], number[v], values, place) for count, (u, v, values) in numbered if u != v]
    if not edges:
        raise TownError("it has no streets between two crossings", field="edge")
    streets = _paired(edges)
    columns: dict[str, Any] = {
        name: tuple(getattr(edge, name) for edge in streets)
        for name in ("one_way", "length", "width", "kind", "name", "signals", "crossings", *USUAL)
    }
    return Town.of_streets(
        np.array([edge.ends for edge in streets]),
        **columns,
        place=place,
        # Nodes whose labels are not numbers of OpenStreetMap are numbered as they come in the file.
        ids=np.array([int(label) if re.fullmatch(r"-?\d{1,18}", label) else node for label, node in number.items()]),
        points=np.concatenate([edge.course for edge in streets]),
        first=np.cumsum([0, *(len(edge.course) for edge in streets)]),
        attribution=str(graph.graph.get("attribution", ATTRIBUTION)),
    )


class _Edge:
    """One directed edge with its values parsed; with the edge that leads back it is one street."""

    def __init__(
        self, number: int, tail: int, head: int, values: dict[str, Any], place: Float[np.ndarray, "node 2"]
    ) -> None:
        where = f"edge {number}"
        self.number, self.ends, self.one_way = number, (tail, head), True
        self.course = _course(values.get("geometry"), place[[tail, head]], where)
        self.kind = next(iter(_words(values.get("highway"))), "")
        self.name = " / ".join(_words(values.get("name")))
        self.osmid = tuple(sorted(_words(values.get("osmid"))))
        # Joined ways that were drawn in both directions have both values: the edge is not backwards of anything.
        self.reversed = _words(values.get("reversed")) == ["True"]
        self.street = int(_number(values.get("street", -1), "street", where, 2**53))
        self.signals = int(_number(values.get("signals", 0), "signals", where, MOST_CROSSINGS))
        self.crossings = int(_number(values.get("crossings", 0), "crossings", where, MOST_CROSSINGS))
        self.opening = " ".join(_words(values.get("opening")))
        self.restricted = _words(values.get("restricted")) == ["True"]
        rise = values.get("incline", math.nan)
        self.incline = math.nan if str(rise) == "nan" else _number(rise, "incline", where, _STEEPEST)
        self.kerb = _number(values.get("kerb", 0), "kerb", where)
        (measured,) = course_lengths(self.course, np.array([0, len(self.course)])).tolist()
        self.length = _number(values.get("length", measured), "length", where)
        self.width = _width(values, self.kind, where)


def _paired(edges: list[_Edge]) -> list[_Edge]:
    """List each street once; it is one-way where no edge leads back with the same numbers and length."""
    between: dict[tuple[object, ...], list[_Edge]] = {}
    for edge in sorted(edges, key=lambda edge: edge.length):
        between.setdefault((*sorted(edge.ends), edge.osmid), []).append(edge)
    streets = []
    for group in between.values():
        waiting = [edge for edge in group if edge.ends[0] > edge.ends[1]]
        for edge in (edge for edge in group if edge.ends[0] < edge.ends[1]):
            back = min(waiting, key=lambda other: abs(other.length - edge.length), default=None)
            street = edge
            if back is not None and abs(back.length - edge.length) <= _PAIRED:
                waiting.remove(back)
                street = back if edge.reversed and not back.reversed else edge
                street.one_way = False
            streets.append(street)
        streets += waiting
    return sorted(streets, key=lambda street: (street.street, street.number))


def _course(geometry: str | None, ends: Float[np.ndarray, "2 2"], where: str) -> Float64[np.ndarray, "point 2"]:
    """Read a line in well-known text, or draw a straight one; both ends are where the crossings are."""
    if geometry is None:
        return ends
    line = shapely.from_wkt(geometry, on_invalid="ignore")
    if line is None or line.geom_type != "LineString" or line.is_empty:
        raise TownError(
            f"geometry of {where} is {geometry:.30}; it must be a LINESTRING of longitudes and latitudes",
            field="geometry",
        )
    points = shapely.get_coordinates(line)
    apart = np.abs(points[[0, -1]] - ends).max(axis=1) > SAME_DEGREES
    return np.concatenate([ends[:1][apart[:1]], points, ends[1:][apart[1:]]])


def _words(value: object) -> list[str]:
    """Read what osmnx wrote as one value, or as the text of a list of values."""
    text = "" if value is None else str(value).strip()
    if text.startswith("[") and text.endswith("]"):
        try:
            listed = ast.literal_eval(text)
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            return [text]
        if isinstance(listed, list):
            return list(dict.fromkeys(str(each) for each in listed))
    return [text] if text else []


def _width(values: dict[str, Any], kind: str, where: str) -> float:
    """Take the narrowest of the readable widths given, or else the usual width of the kind.

    On roads osmnx passes on the width of the carriageway, which is not walked.

    Returns
    -------
    float
        Metres.
    """
    said = _words(values.get("width"))
    if "street" in values and said:
        return _number(said[0], "width", where)  # our own, which may be a mean of the table's
    found = [width for width in map(parse_width, said) if width is not None and kind in FULL_WIDTH]
    return min(found, default=WIDTHS.get(kind, UNKNOWN_WIDTH))


def _number(value: object, field: str, where: str, most: float = _LONGEST) -> float:
    try:
        number = float(str(value))
    except ValueError:
        number = math.nan
    if not abs(number) <= most:
        raise TownError(f"{field} of {where:.40} is {value!s:.40}; it must be a number up to {most:,g}", field=field)
    return number
