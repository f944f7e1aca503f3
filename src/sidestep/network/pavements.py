"""Names for pavements: a footway without a name is called after the street along which it runs.

Along a footway, every ``SPACING`` metres the nearest named street is looked for that is at most ``NEAR`` metres away
and runs in the same direction, up to ``ASIDE`` degrees. The footway gets the name that holds on most of its length, if
that is at least half of it.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Float64, Int64

from sidestep.network.extract import Extract
from sidestep.network.geodesy import Projection
from sidestep.network.streets import Nodes, Streets, ranges
from sidestep.network.tags import AREA, FULL_WIDTH, KINDS, WIDTHS

NEAR = 20.0
"""Metres from the middle of a street to its pavement, at most."""
ASIDE = 20.0
"""Degrees between the directions of a pavement and its street, at most."""
SPACING = 10.0
"""Metres between the places at which a pavement looks for its street, at most."""
PAVEMENTS = frozenset({"cycleway", "footway", "path"})
"""Kinds of ways that are called after streets."""
NAMESAKES = (frozenset(WIDTHS) - FULL_WIDTH) | {"living_street", "pedestrian", AREA}
"""Kinds of streets after which pavements are called."""

_AT_ONCE = 50_000  # places, which bounds memory


@dataclass(frozen=True, eq=False)
class _Legs:
    """Straight parts of courses, in metres."""

    begin: Float64[np.ndarray, "leg 2"]
    end: Float64[np.ndarray, "leg 2"]
    of: Int64[np.ndarray, " leg"]
    """Street, or name, of each."""

    @property
    def length(self) -> Float64[np.ndarray, " leg"]:
        return np.hypot(*(self.end - self.begin).T)

    @property
    def bearing(self) -> Float64[np.ndarray, " leg"]:
        """Degrees."""
        return np.degrees(np.arctan2(*(self.end - self.begin).T))


def name_pavements(extract: Extract, streets: Streets, nodes: Nodes) -> Streets:
    """Call pavements after the streets along which they run.

    Parameters
    ----------
    extract
        What the file holds; its ``repaired`` counts the streets that get a name.
    streets
        All streets, before crossings are merged.
    nodes
        The nodes that they join.

    Returns
    -------
    Streets
        The same streets, with more names.
    """
    nameless = (streets.name == 0) & np.array([kind in PAVEMENTS for kind in KINDS])[streets.kind]
    named = (streets.name > 0) & np.array([kind in NAMESAKES for kind in KINDS])[streets.kind]
    if not nameless.any() or not (named.any() or len(extract.roads.counts)):
        return streets
    plane = Projection.of(nodes.place[~np.isnan(nodes.place[:, 0])])
    pavements, roads = streets.keep(nameless), streets.keep(named)
    road_place = nodes.place[extract.nodes.indices(extract.roads.refs)]
    border = np.append(0, np.cumsum(np.array(extract.roads.counts, np.int64)))
    sources = (
        _legs(plane.project(roads.points), roads.first, roads.name),
        _legs(plane.project(road_place), border, np.array(extract.roads.names, np.int64)),
    )
    columns = ("begin", "end", "of")
    namesakes = _Legs(*(np.concatenate([getattr(source, column) for source in sources]) for column in columns))
    if not len(namesakes.of):
        return streets
    legs = _legs(plane.project(pavements.points), pavements.first, np.arange(len(pavements)))
    found = _names(legs, namesakes, len(pavements))
    extract.repaired["street: called after the street along which it runs"] += int((found > 0).sum())
    name = streets.name.copy()
    name[nameless] = found
    return replace(streets, name=name)


def _legs(
    xy: Float64[np.ndarray, "point 2"], first: Int64[np.ndarray, " border"], of: Int64[np.ndarray, " course"]
) -> _Legs:
    """Take courses apart; parts without a length, or with an end that nobody knows, are left out."""
    course = np.repeat(np.arange(len(of)), np.diff(first))
    inside = course[1:] == course[:-1]
    legs = _Legs(xy[:-1][inside], xy[1:][inside], of[course[:-1][inside]])
    kept = legs.length > 0  # NaN is not
    return _Legs(legs.begin[kept], legs.end[kept], legs.of[kept])


def _names(pavements: _Legs, streets: _Legs, number: int) -> Int64[np.ndarray, " pavement"]:
    """Find the code of the name of each of a number of pavements; 0 where there is none."""
    many = np.ceil(pavements.length / SPACING).astype(np.int64)
    leg, first = ranges(np.arange(len(many)), many, 0)
    share = (np.arange(len(leg)) - first[leg] + 0.5) / many[leg]
    places = pavements.begin[leg] + share[:, None] * (pavements.end - pavements.begin)[leg]
    lines = shapely.linestrings(np.stack([streets.begin, streets.end], axis=1))
    tree = shapely.STRtree(lines)
    name = np.zeros(len(leg), np.int64)
    for begin in range(0, len(leg), _AT_ONCE):
        here = slice(begin, begin + _AT_ONCE)
        points = shapely.points(places[here])
        place, street = tree.query(points, predicate="dwithin", distance=NEAR)
        turn = (pavements.bearing[leg[here][place]] - streets.bearing[street] + 90) % 180 - 90
        place, street = place[np.abs(turn) <= ASIDE], street[np.abs(turn) <= ASIDE]
        order = np.lexsort((streets.of[street], shapely.distance(points[place], lines[street]), place))
        nearest = order[np.diff(place[order], prepend=-1) > 0]
        name[begin + place[nearest]] = streets.of[street[nearest]]
    metres = (pavements.length / many)[leg]
    of = pavements.of[leg]
    codes = int(name.max(initial=0)) + 1
    key, which = np.unique(of * codes + name, return_inverse=True)
    votes = np.bincount(which, metres)
    pavement, code = np.divmod(key, codes)
    total = np.bincount(of, metres)
    most = (code > 0) & (votes >= total[pavement] / 2)
    found = np.zeros(number, np.int64)
    found[pavement[most]] = code[most]
    return found
