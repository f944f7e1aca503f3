"""Routes by expected times, a millisecond each: what is asked of a server a hundred times a second.

The same routes as :class:`~sidestep.planners.time_dependent.Expected` plans, without simulated futures. That planner's
search is compiled, for many walks side by side; this one is for a single walk at a time and looks only at the few streets
that may be on its path.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np

from sidestep.network.graph import ABSENT, SHUT
from sidestep.network.snapping import SAME_NODE, Snapper, StreetPoint, piece_of
from sidestep.routing.clocks import TownClock
from sidestep.routing.directions import Leg, Step, bearings, directions
from sidestep.routing.request import RouteError
from sidestep.routing.street_times import StreetTimes, Tables
from sidestep.scenarios.maps import ScenarioMap

GOAL = -1
"""Stands for the place in the middle of a street where a walk ends."""

End = int | StreetPoint
"""A crossing, or a place on a street."""
Exits = list[list[tuple[int, int]]]
"""Of every node the segments that leave it, and the nodes where they end."""
Bearings = tuple[float, float]
"""Degrees clockwise from north in which a segment begins and ends."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A segment of a walk, or the part of it that is walked."""

    segment: int
    begin: float
    """Share of the segment's length at which its part begins."""
    end: float
    """Share at which it ends."""
    clock: float
    """When the walker comes to it, in s since the table's clock 0."""
    leaves: float
    """When the walker leaves it."""
    wait: float
    """Seconds before it."""


@dataclass(frozen=True, slots=True)
class QuickRoute:
    """A route from one place to the next."""

    departs: TownClock
    """The departure."""
    table: StreetTimes
    pieces: Sequence[Piece]
    legs: Sequence[Leg]
    """The segments in their order; none where both places are the same."""
    bearings: Sequence[Bearings]
    """Of each leg."""
    seconds: float
    """Expected travel time."""

    @property
    def steps(self) -> list[Step]:
        """Turn by turn."""
        return directions(self.legs, self.bearings)


class QuickRouter:
    """Searches routes through one town by expected times.

    Parameters
    ----------
    scenario_map
        Streets and crowds.
    snapper
        The streets of the map with their names and coordinates.
    tables
        Expected times on them.
    """

    def __init__(self, scenario_map: ScenarioMap, snapper: Snapper, tables: Tables) -> None:
        network = scenario_map.network
        self.snapper, self.tables = snapper, tables
        self._street, self._backwards = (each.tolist() for each in snapper.town.street_of_segment())
        self._length, self._tail, self._head = (
            np.asarray(each).tolist() for each in (network.length, network.tail, network.head)
        )
        self._owner = network.owners().tolist()
        self._enters = None if network.enters is None else np.asarray(network.enters).tolist()
        self._area = None if network.area is None else np.asarray(network.area).tolist()
        self._exits_to: dict[int, Exits] = {}
        segments, heads = np.asarray(network.exit_segment).tolist(), np.asarray(network.exit_node).tolist()
        self._exits = [
            [(segment, node) for segment, node in zip(*row, strict=True) if node != ABSENT]
            for row in zip(segments, heads, strict=True)
        ]
        self._segments_of: dict[int, list[int]] = {}
        for row in self._exits:
            for segment, _ in row:
                self._segments_of.setdefault(self._street[segment], []).append(segment)
        self._courses: dict[int, list[list[float]]] = {}
        self._bearings: dict[int, Bearings] = {}

    def route(self, origin: End, destination: End, departs: TownClock) -> QuickRoute:
        """Find the route of least expected time.

        Parameters
        ----------
        origin, destination
            Crossings, or places on streets.
        departs
            When the walk begins: clock 0 is the departure.

        Returns
        -------
        QuickRoute
            Without any leg where both ends are the same place.

        Raises
        ------
        RouteError
            No path leads from one to the other (field ``destination``).
        """
        table, clock = self.tables.at(departs)
        pieces = self._search(table, self._at_crossing(origin), self._at_crossing(destination), clock)
        legs = [self._leg(table, piece) for piece in pieces]
        seconds = pieces[-1].leaves - clock if pieces else 0.0
        return QuickRoute(departs, table, pieces, legs, [self._bearing(piece) for piece in pieces], seconds)

    def _at_crossing(self, end: End) -> End:
        """The crossing itself for places within ``SAME_NODE`` of it."""
        if isinstance(end, int):
            return end
        town = self.snapper.town
        along = end.fraction * float(town.length[end.street])
        if min(along, float(town.length[end.street]) - along) >= SAME_NODE:
            return end
        return int((town.tail if end.fraction < 1 / 2 else town.head)[end.street])

    def _shares(self, point: StreetPoint) -> list[tuple[int, float]]:
        """The segments along a place's street, each with the share of its length that lies before the place."""
        return [
            (segment, 1 - point.fraction if self._backwards[segment] else point.fraction)
            for segment in self._segments_of.get(point.street, ())
        ]

    def _open_exits(self, end: End) -> Exits:
        """The exits of every node for walks that end somewhere: restricted areas are entered only to end there."""
        if self._enters is None or self._area is None:
            return self._exits
        if isinstance(end, int):
            area = self._area[end]
        else:
            area = max((self._owner[segment] for segment, _ in self._shares(end)), default=ABSENT)
        if area not in self._exits_to:
            allowed = {ABSENT, area} if area >= 0 else {ABSENT}
            enters = self._enters
            self._exits_to[area] = [[each for each in row if enters[each[0]] in allowed] for row in self._exits]
        return self._exits_to[area]

    def _search(self, table: StreetTimes, origin: End, destination: End, clock: float) -> list[Piece]:
        """Search for the earliest arrival, guided by the least times to the destination (A*)."""
        if origin == destination:
            return []
        exits, step, rows = self._open_exits(destination), table.step_seconds, table.rows
        last, entries, bounds = len(rows) - 1, self._entries(destination, exits), []
        goal = destination if isinstance(destination, int) else GOAL
        if goal == GOAL:
            for node, streets in entries.items():
                least = min(share * float(table.least[segment]) for segment, share in streets)
                bounds.append((table.potential(node), least))
        else:
            bounds.append((table.potential(goal), 0.0))
        arrival: dict[int, float] = {}
        via: dict[int, Piece | int] = {}
        heap: list[tuple[float, float, int]] = []

        def come(node: int, piece: Piece) -> None:
            if piece.leaves < arrival.get(node, math.inf):
                arrival[node], via[node] = piece.leaves, piece
                least = 0.0 if node == goal else min(ahead[node] + further for ahead, further in bounds)
                heappush(heap, (piece.leaves + least, piece.leaves, node))

        if isinstance(origin, int):
            arrival[origin] = clock
            heappush(heap, (clock, clock, origin))
        else:
            until = {} if isinstance(destination, int) else dict(self._shares(destination))
            for segment, share in self._shares(origin):
                if self._owner[segment] == SHUT:
                    continue
                come(self._head[segment], self._piece(table, segment, share, 1.0, clock))
                if until.get(segment, 0.0) > share:
                    come(goal, self._piece(table, segment, share, until[segment], clock))
        (ahead, beyond), *others = bounds or [(memoryview(b""), 0.0)]
        done: set[int] = set()
        while heap:
            _, at, node = heappop(heap)
            if node in done:
                continue
            if node == goal:
                return self._traced(table, via, origin, goal, clock)
            done.add(node)
            position = at / step
            number = min(int(position), last)
            row, after, part = rows[number], rows[min(number + 1, last)], position - number
            for segment, head in exits[node]:
                before = row[segment]
                there = at + before + part * (after[segment] - before)
                if there < arrival.get(head, math.inf):
                    arrival[head], via[head] = there, segment
                    least = ahead[head] + beyond
                    for other, further in others:
                        least = min(least, other[head] + further)
                    heappush(heap, (there + least, there, head))
            for segment, share in entries.get(node, ()):
                come(GOAL, self._piece(table, segment, 0.0, share, at))
        said = "no path leads from the origin to the destination; streets may be one-way or unconnected"
        raise RouteError(said, field="destination")

    def _entries(self, destination: End, exits: Exits) -> dict[int, list[tuple[int, float]]]:
        """Crossings from which a place in the middle of a street is reached, each with segments and shares of them."""
        found: dict[int, list[tuple[int, float]]] = {}
        if isinstance(destination, StreetPoint):
            for segment, share in self._shares(destination):
                tail = self._tail[segment]
                if any(segment == onto for onto, _ in exits[tail]):
                    found.setdefault(tail, []).append((segment, share))
        return found

    def _piece(self, table: StreetTimes, segment: int, begin: float, end: float, clock: float) -> Piece:
        """A segment, or a part of it, come to at a clock."""
        whole, wait = table.at(table.seconds, segment, clock), table.at(table.waits, segment, clock)
        # Who begins in the middle of a street waits for its gate, but not for lights where it begins.
        before = wait if begin == 0.0 else table.at(table.shut, segment, clock)
        return Piece(segment, begin, end, clock, clock + before + (end - begin) * (whole - wait), before)

    def _traced(
        self, table: StreetTimes, via: dict[int, Piece | int], origin: End, goal: int, clock: float
    ) -> list[Piece]:
        """The pieces of the path that leads to the goal."""
        node, path = goal, []
        while node != origin:
            found = via[node]
            path.append(found)
            if isinstance(found, Piece) and found.begin > 0:  # from the middle of a street
                break
            node = self._tail[found.segment if isinstance(found, Piece) else found]
        pieces: list[Piece] = []
        for each in reversed(path):
            piece = each if isinstance(each, Piece) else self._piece(table, each, 0.0, 1.0, clock)
            pieces.append(piece)
            clock = piece.leaves
        return pieces

    def _course(self, segment: int) -> list[list[float]]:
        """Longitudes and latitudes of a whole segment, in walking direction; looked up once."""
        found = self._courses.get(segment)
        if found is None:
            course = np.round(self.snapper.town.course(self._street[segment]), 7)
            found = self._courses[segment] = (course[::-1] if self._backwards[segment] else course).tolist()
        return found

    def _part(self, piece: Piece) -> list[list[float]]:
        if piece.begin == 0 and piece.end == 1:
            return self._course(piece.segment)
        begin, end = piece.begin, piece.end
        if self._backwards[piece.segment]:
            begin, end = 1 - begin, 1 - end
        return np.round(piece_of(self.snapper.town, self._street[piece.segment], begin, end), 7).tolist()

    def bearing(self, segment: int) -> Bearings:
        """The bearings in which a whole segment begins and ends, in degrees clockwise from north."""
        found = self._bearings.get(segment)
        if found is None:
            found = self._bearings[segment] = bearings(np.array(self._course(segment)))
        return found

    def _bearing(self, piece: Piece) -> Bearings:
        whole = piece.begin == 0 and piece.end == 1
        return self.bearing(piece.segment) if whole else bearings(np.array(self._part(piece)))

    def _leg(self, table: StreetTimes, piece: Piece) -> Leg:
        town, street = self.snapper.town, self._street[piece.segment]
        density = table.density_at(piece.segment, (piece.clock + piece.leaves) / 2)
        return Leg(
            segment=piece.segment,
            metres=self._length[piece.segment] * (piece.end - piece.begin),
            minutes=(piece.leaves - piece.clock) / 60,
            density=density,
            exposure=density * (piece.leaves - piece.clock),
            too_dense=False,
            street=street,
            name=town.name[street],
            kind=town.kind[street],
            coordinates=self._part(piece),
        )
