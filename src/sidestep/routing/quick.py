"""Routes by expected times, a millisecond each: what is asked of a server a hundred times a second.

The same routes as :class:`~sidestep.planners.time_dependent.Expected` plans, without simulated futures. That planner's
search is compiled, for many walks side by side; this one is for a single walk at a time and looks only at the few
streets that may be on its path. Who walks a part of a street takes that share of the time that the whole one takes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

import numpy as np
from jaxtyping import Float

from sidestep.network.graph import ABSENT, SHUT, RoadNetwork
from sidestep.network.snapping import SAME_NODE, Snapper, StreetPoint, piece_of
from sidestep.routing.clocks import TownClock
from sidestep.routing.directions import Leg, Step, bearings, directions, opening_word
from sidestep.routing.request import RouteError, at_fault
from sidestep.routing.street_times import Row, StreetTimes, Tables

GOAL = -1
"""Stands for the first place in the middle of a street where walks end; numbers below it are the others."""
MOST_EXITS = 64
"""Sets of streets that may be walked, of which each is kept: one for each restricted area, and kind to exclude."""

DETOUR, SPARE = 2.0, 120.0
"""Times the straight line, and seconds besides: how far least times to the end of a walk are worked out at first.
Routes do not depend on it: where that is not enough, those of farther nodes follow."""

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
    shut: float
    """Seconds until it opens, when it is come to."""


@dataclass(frozen=True, slots=True)
class QuickRoute:
    """A route from one place to the next."""

    departs: TownClock
    """The departure."""
    legs: Sequence[Leg]
    """The segments in their order; none where both places are the same."""
    seconds: float
    """Expected travel time."""


class QuickRouter:
    """Searches routes through one town by expected times.

    Parameters
    ----------
    network
        Streets.
    snapper
        The same with their names and coordinates.
    tables
        Expected times on them.
    """

    def __init__(self, network: RoadNetwork, snapper: Snapper, tables: Tables) -> None:
        self.snapper, self.tables = snapper, tables
        self._street, self._backwards = (each.tolist() for each in snapper.town.street_of_segment())
        self._length, self._tail, self._head = (
            np.asarray(each).tolist() for each in (network.length, network.tail, network.head)
        )
        self._position = np.asarray(network.position)
        self._owner = network.owners().tolist()
        self._enters = None if network.enters is None else np.asarray(network.enters).tolist()
        self._area = None if network.area is None else np.asarray(network.area).tolist()
        self._exits_to: dict[tuple[int, frozenset[str]], Exits] = {}
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

    def route(self, origin: End, destination: End, departs: TownClock, exclude: Sequence[str] = ()) -> QuickRoute:
        """Find the route of least expected time.

        Parameters
        ----------
        origin, destination
            Crossings, or places on streets.
        departs
            When the walk begins: clock 0 is the departure.
        exclude
            Kinds of streets that are not walked, such as ``steps``.

        Returns
        -------
        QuickRoute
            Without any leg where both ends are the same place.

        Raises
        ------
        RouteError
            No path leads from one to the other, or it takes longer than the horizon (field ``destination``).
        TownError
            No street is of a kind (``exclude``).
        """
        table, clock = self.tables.at(departs)
        closed = frozenset(exclude)
        (pieces,) = self._search(table, self._at_crossing(origin), [self._at_crossing(destination)], clock, closed)
        if pieces is None:
            said = "no path leads from the origin to the destination; streets may be one-way or unconnected"
            raise RouteError(said, field="destination")
        seconds = pieces[-1].leaves - clock if pieces else 0.0
        if seconds > self.tables.horizon:
            most = self.tables.horizon / 60
            said = f"the walk takes {seconds / 60:,.0f} min, and walks are given up after {most:g}"
            raise RouteError(f"{said}; choose a nearer destination, or another departure", field="destination")
        legs = [self._leg(table, piece) for piece in pieces]
        return QuickRoute(departs, legs, seconds)

    def steps(self, legs: Sequence[Leg]) -> list[Step]:
        """Turn by turn, for the legs of one route or of several that follow each other."""
        return directions(legs, [self._bearing(leg) for leg in legs])

    def matrix(
        self, origins: Sequence[End], destinations: Sequence[End], departs: TownClock, exclude: Sequence[str] = ()
    ) -> Float[np.ndarray, "2 origin destination"]:
        """Find the times and lengths of the walks from many places to many others.

        Parameters
        ----------
        origins, destinations, departs, exclude
            As for :meth:`route`.

        Returns
        -------
        Float[np.ndarray, "2 origin destination"]
            Expected seconds, and metres; infinite where no path leads within the horizon.
        """
        (table, clock), closed = self.tables.at(departs), frozenset(exclude)
        ends = [self._at_crossing(each) for each in destinations]
        areas = np.array([self._area_of(each) for each in ends])
        found = np.full((2, len(origins), len(ends)), np.inf)
        for row, origin in enumerate(map(self._at_crossing, origins)):
            for area in np.unique(areas):
                columns = np.flatnonzero(areas == area).tolist()
                walks = self._search(table, origin, [ends[column] for column in columns], clock, closed)
                for column, pieces in zip(columns, walks, strict=True):
                    if pieces is not None and (not pieces or pieces[-1].leaves - clock <= self.tables.horizon):
                        metres = sum(self._length[piece.segment] * (piece.end - piece.begin) for piece in pieces)
                        found[:, row, column] = pieces[-1].leaves - clock if pieces else 0.0, metres
        return found

    def crowds(self, at: TownClock) -> Float[np.ndarray, " street"]:
        """Expected persons/m² on every street at a time, of both directions the larger."""
        table, clock = self.tables.at(at)
        densest = np.zeros(self.snapper.town.streets, np.float32)
        np.maximum.at(densest, self._street, table.densities(clock))
        return densest

    def _at_crossing(self, end: End) -> End:
        """The crossing itself for places within ``SAME_NODE`` of it."""
        if isinstance(end, int):
            return end
        town = self.snapper.town
        along = end.fraction * float(town.length[end.street])
        if min(along, float(town.length[end.street]) - along) >= SAME_NODE:
            return end
        return int((town.tail if end.fraction < 1 / 2 else town.head)[end.street])

    def _is_same(self, one: End, other: End) -> bool:
        """Whether two ends are the same place: crossings, or within ``SAME_NODE`` of each other on one street."""
        if isinstance(one, int) or isinstance(other, int):
            return one == other
        apart = abs(one.fraction - other.fraction) * float(self.snapper.town.length[one.street])
        return one.street == other.street and apart < SAME_NODE

    def _straight(self, one: End, other: End) -> float:
        """Metres between two ends, or the first crossings of their streets."""
        tail = self.snapper.town.tail
        return math.dist(
            *(self._position[each if isinstance(each, int) else tail[each.street]] for each in (one, other))
        )

    def _shares(self, point: StreetPoint) -> list[tuple[int, float]]:
        """The segments along a place's street, each with the share of its length that lies before the place."""
        return [
            (segment, 1 - point.fraction if self._backwards[segment] else point.fraction)
            for segment in self._segments_of.get(point.street, ())
        ]

    def _area_of(self, end: End) -> int:
        """The restricted area that an end is in; negative where it is in none."""
        if self._area is None:
            return ABSENT
        if isinstance(end, int):
            return self._area[end]
        return max((self._owner[segment] for segment, _ in self._shares(end)), default=ABSENT)

    def _open_exits(self, area: int, closed: frozenset[str]) -> Exits:
        """The exits of every node for walks that end in an area: restricted areas are entered only to end there."""
        key = max(area, ABSENT), closed
        found = self._exits_to.get(key)
        if found is None:
            with at_fault("exclude"):
                shut = self.snapper.town.of_kinds(sorted(closed)).tolist()
            street, enters, allowed = self._street, self._enters, {ABSENT, area} if area >= 0 else {ABSENT}

            def goes(segment: int) -> bool:
                return (enters is None or enters[segment] in allowed) and not shut[street[segment]]

            found = [[each for each in row if goes(each[0])] for row in self._exits]
            if len(self._exits_to) >= MOST_EXITS:
                self._exits_to.clear()
            self._exits_to[key] = found
        return found

    def _search(  # noqa: C901, PLR0912 - one loop, the innermost of all
        self, table: StreetTimes, origin: End, destinations: Sequence[End], clock: float, closed: frozenset[str]
    ) -> list[list[Piece] | None]:
        """Search for the earliest arrivals (Dijkstra); at a single place guided by the least times to it (A*).

        Least times are worked out within reach of the walk, and farther as soon as an arrival is no sooner than they
        reach. Until then no node is looked at from which they are not exact, so routes, and which one of several that
        take as long, are those that least times over the whole town lead to.

        Parameters
        ----------
        table, clock
            Expected times, and the departure in s since their clock 0.
        origin, destinations
            Both ends; all destinations are in the same restricted area, or in none.
        closed
            Kinds of streets that are not walked.

        Returns
        -------
        list
            The pieces of each walk; None where no path leads.
        """
        exits, step, rows = self._open_exits(self._area_of(destinations[0]), closed), table.step_seconds, table.rows
        last, bounds = len(rows) - 1, []
        entries: dict[int, list[tuple[int, float, int]]] = {}  # by crossing: segments, shares of them, and the goal
        goals = [each if isinstance(each, int) else GOAL - number for number, each in enumerate(destinations)]
        for goal, destination in zip(goals, destinations, strict=True):
            for segment, share in () if isinstance(destination, int) else self._shares(destination):
                tail = self._tail[segment]
                if any(segment == onto for onto, _ in exits[tail]):
                    entries.setdefault(tail, []).append((segment, share, goal))
                    bounds.append((tail, share * float(table.least[segment])))
            if isinstance(destination, int):
                bounds.append((destination, 0.0))
        potentials: list[tuple[Row, float]]
        if len(destinations) > 1 or not bounds:
            within, potentials = math.inf, [([0.0] * len(exits), 0.0)]
        else:
            within = SPARE + DETOUR * table.pace * self._straight(origin, destinations[0])
            potentials = [(table.potential(node, within), further) for node, further in bounds]
        (ahead, beyond), *others = potentials
        reach = clock + within
        gated = {} if table.gates is None else table.gates.of_segment
        arrival: dict[int, float] = {}
        via: dict[int, Piece | int] = {}
        heap: list[tuple[float, float, int]] = []

        def come(node: int, piece: Piece) -> None:
            if piece.leaves < arrival.get(node, math.inf):
                arrival[node], via[node] = piece.leaves, piece
                heappush(heap, estimate(node, piece.leaves))

        def estimate(node: int, at: float) -> tuple[float, float, int]:
            least = 0.0 if node < 0 else min(bound[node] + further for bound, further in potentials)
            return at + least, at, node

        if isinstance(origin, int):
            arrival[origin] = clock
            heappush(heap, (clock, clock, origin))
        else:
            for segment, share in self._shares(origin):
                if self._owner[segment] == SHUT or self.snapper.town.kind[origin.street] in closed:
                    continue
                come(self._head[segment], self._piece(table, segment, share, 1.0, clock))
                for goal, destination in zip(goals, destinations, strict=True):
                    until = 0.0 if isinstance(destination, int) else dict(self._shares(destination)).get(segment, 0.0)
                    if until > share:
                        come(goal, self._piece(table, segment, share, until, clock))
        done: set[int] = set()
        same = [self._is_same(origin, each) for each in destinations]
        missing = {goal for goal, stays in zip(goals, same, strict=True) if not stays}
        while heap and missing:
            total, at, node = heappop(heap)
            if node in done:
                continue
            if total >= reach:
                if within == math.inf:  # no path leads from here
                    break
                within = 2 * within if within < table.lasts else math.inf
                reach = clock + within
                potentials = [(table.potential(end, within), further) for end, further in bounds]
                (ahead, beyond), *others = potentials
                heap = [estimate(node, at) for node, at in arrival.items() if node not in done]
                heapify(heap)
                continue
            done.add(node)
            missing.discard(node)
            if node < 0:
                continue
            position = at / step
            number = min(int(position), last)
            row, after, part = rows[number], rows[min(number + 1, last)], position - number
            for segment, head in exits[node]:
                if segment in gated:
                    come(head, self._piece(table, segment, 0.0, 1.0, at))
                    continue
                before = row[segment]
                there = at + before + part * (after[segment] - before)
                if there < arrival.get(head, math.inf):
                    arrival[head], via[head] = there, segment
                    least = ahead[head] + beyond
                    for other, further in others:
                        least = min(least, other[head] + further)
                    heappush(heap, (there + least, there, head))
            for segment, share, goal in entries.get(node, ()):
                come(goal, self._piece(table, segment, 0.0, share, at))
        return [
            [] if stays else None if goal in missing else self._traced(table, via, origin, goal, clock)
            for goal, stays in zip(goals, same, strict=True)
        ]

    def _piece(self, table: StreetTimes, segment: int, begin: float, end: float, clock: float) -> Piece:
        """A segment, or a part of it, come to at a clock."""
        shut = table.until_open(segment, clock)
        enters = clock + shut
        whole, wait = table.at(table.seconds, segment, enters), table.at(table.waits, segment, enters)
        # Who begins in the middle of a street waits for its gate, but not for lights where it begins.
        before = wait if begin == 0.0 else 0.0
        return Piece(segment, begin, end, clock, enters + before + (end - begin) * (whole - wait), shut)

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

    def _bearing(self, leg: Leg) -> Bearings:
        """The bearings in which a leg begins and ends; those of whole segments are worked out once."""
        segment, course = leg.segment, leg.coordinates
        if course is not self._courses.get(segment):
            return bearings(np.array(course))
        found = self._bearings.get(segment)
        if found is None:
            found = self._bearings[segment] = bearings(np.array(course))
        return found

    def _leg(self, table: StreetTimes, piece: Piece) -> Leg:
        town, street = self.snapper.town, self._street[piece.segment]
        density = table.density_at(piece.segment, (piece.clock + piece.leaves) / 2)
        return Leg(
            segment=piece.segment,
            metres=self._length[piece.segment] * (piece.end - piece.begin),
            minutes=(piece.leaves - piece.clock) / 60,
            opens=opening_word(table.hour, piece.clock, piece.shut),
            minutes_until_open=piece.shut / 60,
            density=density,
            exposure=density * (piece.leaves - piece.clock),
            too_dense=False,
            street=street,
            name=town.name[street],
            kind=town.kind[street],
            coordinates=self._part(piece),
        )
