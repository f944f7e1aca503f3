"""Places in the middle of streets as crossings of their own, so that walks can begin and end there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from sidestep.network.graph import RoadNetwork, road_network
from sidestep.network.snap import Snapped
from sidestep.network.town import Town

AT_END = 1.0  # m from a crossing, or from another place, within which a place is taken to be there
NOWHERE = -1


@dataclass(frozen=True, eq=False)
class Spliced:
    """The streets of a town with some of them split where people set out or arrive.

    Nodes and segments of the town keep their numbers; a segment that is split keeps its first piece.
    """

    town: Town
    network: RoadNetwork
    nodes: tuple[int, ...]  # of the places, in the order in which they were given
    parent: Int[np.ndarray, " segment"]  # the segment of the town that each is a piece of
    street: Int[np.ndarray, " segment"]
    begin: Float64[np.ndarray, " segment"]  # part of the street's course at which a segment begins
    end: Float64[np.ndarray, " segment"]  # at which it ends: less than `begin` where it leads backwards

    @property
    def begins_whole(self) -> Bool[np.ndarray, " segment"]:
        """Which segments begin where the segment that they are a piece of does."""
        return (self.begin == 0.0) | (self.begin == 1.0)

    @property
    def share(self) -> Float64[np.ndarray, " segment"]:
        """Which part of the street each segment is, by length: 1 where it is the whole of it."""
        return np.abs(self.end - self.begin)

    def course(self, segment: int) -> Float[np.ndarray, "point 2"]:
        """Longitude and latitude along one segment, in the direction in which it is walked."""
        begin, end = float(self.begin[segment]), float(self.end[segment])
        piece = part_of_course(self.town, int(self.street[segment]), min(begin, end), max(begin, end))
        return piece if begin < end else piece[::-1]


def splice(town: Town, places: Sequence[int | Snapped]) -> Spliced:
    """Split streets at places; a place within ``AT_END`` of a crossing is that crossing.

    Parameters
    ----------
    places
        Nodes of the town, or places on its streets.
    """
    base = town.network()
    street, backwards = town.street_of_segment()
    stops: dict[int, list[tuple[float, int]]] = {}  # part of a street, and the node that stands there
    position = list(np.asarray(base.position))
    nodes: list[int] = []
    for place in places:
        node = place if isinstance(place, int) else _standing_at(town, place, stops)
        if not isinstance(place, int) and node == NOWHERE:
            node = len(position)
            position.append(town.project(np.array(place.place[::-1])))
            stops.setdefault(place.street, []).append((place.part, node))
        nodes.append(node)
    tail, head = np.asarray(base.tail).tolist(), np.asarray(base.head).tolist()
    parent = list(range(base.segments))
    begin, end = backwards.astype(float).tolist(), (~backwards).astype(float).tolist()
    for segment in np.flatnonzero(np.isin(street, list(stops))).tolist():
        back = bool(backwards[segment])
        inner = sorted(stops[int(street[segment])], reverse=back)
        parts = [begin[segment], *(part for part, _ in inner), end[segment]]
        chain = [tail[segment], *(node for _, node in inner), head[segment]]
        head[segment], end[segment] = chain[1], parts[1]
        for piece in range(1, len(parts) - 1):
            tail.append(chain[piece])
            head.append(chain[piece + 1])
            begin.append(parts[piece])
            end.append(parts[piece + 1])
            parent.append(segment)
    share = np.abs(np.array(end) - np.array(begin))
    network = road_network(
        np.stack(position),
        tail,
        head,
        np.asarray(base.length)[parent] * share,
        width=np.asarray(base.width)[parent],
        exits=max(base.exits, 2),
    )
    return Spliced(town, network, tuple(nodes), np.array(parent), street[parent], np.array(begin), np.array(end))


def _standing_at(town: Town, place: Snapped, stops: dict[int, list[tuple[float, int]]]) -> int:
    """The node that is there already, or ``NOWHERE``."""
    length = float(town.length[place.street])
    ends = [(0.0, int(town.tail[place.street])), (1.0, int(town.head[place.street]))]
    near = [(abs(part - place.part) * length, node) for part, node in ends + stops.get(place.street, [])]
    away, node = min(near)
    return node if away < AT_END else NOWHERE


def part_of_course(town: Town, street: int, begin: float, end: float) -> Float[np.ndarray, "point 2"]:
    """Longitude and latitude from one part of a street's course to a later one, by length."""
    course = town.course(street)
    along = np.append(0.0, np.linalg.norm(np.diff(town.project(course), axis=0), axis=1).cumsum())
    along /= max(along[-1], 1e-12)
    inside = (along > begin) & (along < end)
    ends = np.stack([[np.interp(part, along, column) for column in course.T] for part in (begin, end)])
    return np.concatenate([ends[:1], course[inside], ends[1:]])
