"""Walks under way: where the walker is, what it saw of crowds, and what its planner decides next.

Of a walk only a :class:`~sidestep.routing.under_way.WalkUnderWay` is kept from one report to the next. What a planner
works out is worked out anew, by the programs of all routes.

A walk has a route. It begins where the walk does or, once the walker has left it, where that was noticed. The planner
decides at the next crossing of the route, or at the place where it begins. Planners that look at crowds on the way
decide there anew, as in every walk; others keep to their route, unless another one has become better.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from itertools import compress
from typing import Protocol, runtime_checkable

import numpy as np

from sidestep.crowds.wall_time import DAYS
from sidestep.errors import SidestepError
from sidestep.planners.base import Planner
from sidestep.routing.clocks import TownClock
from sidestep.routing.deciding import THERE, News, arrived_at, decided, standing_of
from sidestep.routing.following import NEAR, Found, follow
from sidestep.routing.locate import Circumstances
from sidestep.routing.located import Located
from sidestep.routing.places import AskedPlace
from sidestep.routing.request import (
    Counts,
    Departure,
    Place,
    RouteError,
    RouteRequest,
    TimeOfWeek,
    check_request,
    read_departure,
    read_place,
)
from sidestep.routing.sighted import check_density, remembering, sightings_of
from sidestep.routing.under_way import Ahead, Decision, WalkUnderWay
from sidestep.walking.waits import HOUR

FUTURES = 20
"""Futures that the rest of a walk is simulated in by default."""

ARRIVED = 15.0
"""Metres of its route, or in a straight line where it has left that, within which a walker has arrived."""


@runtime_checkable
class Streets(Protocol):
    """What :class:`~sidestep.routing.router.Router` does for walks under way."""

    def locate_walk(self, origin: AskedPlace, destination: AskedPlace, given: Circumstances, /) -> Located:
        """Locate a walk from one place to another."""

    def choose_planner(self, asked: Planner | str | None, located: Located, /) -> Planner:
        """Find who decides."""


def begin(streets: Streets, request: RouteRequest) -> tuple[WalkUnderWay, Decision]:
    """Begin a walk.

    Parameters
    ----------
    streets
        A :class:`~sidestep.routing.router.Router`.
    request
        Origin, destination, departure, planner by its name, futures, current counts, and an area to avoid as GeoJSON.

    Returns
    -------
    WalkUnderWay, Decision
        The walk, and the way to go.

    Raises
    ------
    RouteError
        What walks under way have none of: deadlines, alternatives, planners without a name, areas in files; with their
        field.
    SidestepError
        As :meth:`sidestep.routing.router.Router.answer`.
    """
    check_request(request)
    _check_plain(request)
    avoid = request.avoid if isinstance(request.avoid, dict) else None
    given = Circumstances(depart=request.depart, live=request.live, avoid=avoid)
    ends = AskedPlace("origin", request.origin), AskedPlace("destination", request.destination)
    located = streets.locate_walk(*ends, given)
    planner = streets.choose_planner(request.planner, located)
    start, futures = located.start, FUTURES if request.futures is None else request.futures
    walk = WalkUnderWay(
        scenario=located.scenario.name,
        origin=request.origin,
        destination=request.destination,
        planner=planner.name,
        futures=1 if located.scenario.place.certain else futures,
        avoid=avoid,
        crowds_at=_text(start.given) if isinstance(start, TownClock) else located.clock / 60,
        crowds_from=-located.clock,
        begins=request.origin,
    )
    # Walks that begin in the same slot share what is expected.
    early = round(start.hour * HOUR, 3) % located.scenario.slot_seconds
    if (moved := _crowds_moved(walk, located, -early)) is not walk:
        walk, located = moved, _located(streets, moved, request.live)
    walk, decision = _decided(streets, walk, located, News())
    if walk.arrival is not None:
        located.departing(-walk.crowds_from).check_covered(walk.arrival)
    return walk, decision


def report(
    streets: Streets,
    walk: WalkUnderWay,
    location: Place | str,
    time: Departure | str,
    *,
    density: float | None = None,
    ahead: Sequence[Ahead] = (),
    live: Counts | None = None,
) -> tuple[WalkUnderWay, Decision]:
    """Go on with a walk from where the walker is.

    Parameters
    ----------
    streets
        The :class:`~sidestep.routing.router.Router` of the walk.
    walk
        As the last call returned it.
    location
        Latitude and longitude, or the number of a node.
    time
        When the walker is there, as a departure; minutes since the departure where crowds have no times.
    density
        The crowd that the walker sees on the street that it is on, persons/m².
    ahead
        The crowds that it sees on streets that leave the crossing ahead.
    live
        Current counts, as for :meth:`sidestep.routing.router.Router.plan`.

    Returns
    -------
    WalkUnderWay, Decision
        The walk as it is now, and the way to go.

    Raises
    ------
    RouteError
        Places outside the town, or from which no path leads to the destination (field ``location``); times before that
        of the last report (``time``); densities that nobody sees (``density``), also on streets that do not leave the
        crossing ahead (``ahead``); the walk of another scenario (``walk``).
    """
    place = read_place("location", location)
    if place is None:
        raise RouteError("the location is missing; give latitude and longitude, or a node", field="location")
    located = _located(streets, walk, live)
    if density is not None:
        check_density(density, located, "density")
    for each in ahead:
        check_density(each.density, located, "ahead")
    clock = _clock(walk, located, time)
    if walk.arrived:
        return replace(walk, clock=clock), THERE
    found = _found(walk, located, place, clock - walk.clock)
    walk = replace(walk, clock=clock)
    if found is not None:
        walk = _come(walk, located, found.metres)
        if sum(located.metres_of(walk.segments)) - walk.along <= ARRIVED:
            return arrived_at(walk, located, found.away)
    elif _is_there(walk, located, place):
        return arrived_at(walk, located, None)
    else:
        walk = _rerouted(walk, located, place)
    moved = _crowds_moved(walk, located)
    if found is None or moved is not walk:
        walk, located = moved, _located(streets, moved, live)
    seen = sightings_of(walk, located, standing_of(walk, located).node, density, ahead)
    away = located.ends[0].metres_away if found is None else found.away
    news = News(left=found is None, seen=tuple(seen), away=away)
    return _decided(streets, remembering(walk, seen), located, news)


def replan(
    streets: Streets, walk: WalkUnderWay, *, live: Counts | None = None, time: Departure | str | None = None
) -> tuple[WalkUnderWay, Decision]:
    """Decide anew where the walker was last, since crowds have changed.

    Parameters
    ----------
    streets, walk, live
        As for :func:`report`.
    time
        Now; by default the time of the last report. The walker is taken to be where it was then.

    Returns
    -------
    WalkUnderWay, Decision
        The walk, and the way to go.

    Raises
    ------
    RouteError
        As :func:`report`.
    """
    located = _located(streets, walk, live)
    if time is not None:
        walk = replace(walk, clock=_clock(walk, located, time))
    if walk.arrived:
        return walk, THERE
    if (moved := _crowds_moved(walk, located)) is not walk:
        walk, located = moved, _located(streets, moved, live)
    return _decided(streets, remembering(walk, []), located, News(counts=True))


def _check_plain(request: RouteRequest) -> None:
    """Refuse what walks under way have none of, or cannot keep."""
    for name in ("by", "arrive_by", "confidence", "alternatives"):
        if getattr(request, name):
            said = "a walk under way sets out now and has one route"
            raise RouteError(f"{said}; leave out {name}, which plans of routes have", field=name)
    if not isinstance(request.planner, str | None):
        said = "a walk under way may go on in another process; give its planner by name"
        raise RouteError(f"{said}, not {request.planner!r:.60}", field="planner")
    if not isinstance(request.avoid, dict | None):
        said = "a walk under way may go on on another machine; give the content of the GeoJSON file"
        raise RouteError(f"{said}, not {request.avoid!r:.60}", field="avoid")


def _text(given: datetime | TimeOfWeek | None) -> str | None:
    """A departure as :func:`~sidestep.routing.request.read_departure` reads it."""
    if isinstance(given, TimeOfWeek):
        return f"{DAYS[given.day or 0]} {given.time.isoformat()}"
    return None if given is None else given.isoformat()


def _located(streets: Streets, walk: WalkUnderWay, live: Counts | None) -> Located:
    """The streets, split where the present route begins and at the destination, and the crowds."""
    field = "location" if walk.rerouted else "origin"
    begins, ends = AskedPlace(field, walk.begins), AskedPlace("destination", walk.destination)
    given = Circumstances(depart=read_departure(walk.crowds_at), live=live, avoid=walk.avoid)
    with _of_location(walk):
        located = streets.locate_walk(begins, ends, given)
    if located.scenario.name != walk.scenario:
        said = f"the walk is one through {walk.scenario}, not {located.scenario.name}"
        raise RouteError(f"{said}; go on with it where it began", field="walk")
    if not _is_route(walk.segments, located):
        raise RouteError("the segments of the walk are no route on these streets; begin it anew", field="walk")
    return located


def _is_route(segments: Sequence[int], located: Located) -> bool:
    if not all(0 <= segment < located.scenario_map.network.segments for segment in segments):
        return False
    tails, heads = located.ends_of(segments)
    return heads[:-1] == tails[1:]


@contextmanager
def _of_location(walk: WalkUnderWay) -> Iterator[None]:
    """Let errors name the location where the present route begins at one."""
    try:
        yield
    except SidestepError as error:
        if walk.rerouted and error.field in {"origin", "destination", "avoid"}:
            error.field = "location"
        raise


def _clock(walk: WalkUnderWay, located: Located, time: Departure | str) -> float:
    """Seconds since the departure; times before the last report are refused."""
    given, start = read_departure(time, "time"), located.start
    if given is None:
        raise RouteError("the time is missing; say when the walker was there", field="time")
    if isinstance(start, TownClock) and not start.timed and isinstance(given, float):
        clock = 60 * given
    else:
        clock = walk.crowds_from + start.clock(given, "time")
    if not walk.clock <= clock < math.inf:
        said = f"the time, {time}, is {walk.clock - clock:,.0f} s before that of the last report"
        raise RouteError(f"{said}; report places in their order", field="time")
    return clock


def _crowds_moved(walk: WalkUnderWay, located: Located, seconds: float | None = None) -> WalkUnderWay:
    """Let clock 0 of the crowds be the beginning of the present slot, or of the last one in which crowds are known.

    Parameters
    ----------
    walk, located
        The walk, and the streets with their crowds.
    seconds
        Of another time, from clock 0 on, if crowds are known then.

    Returns
    -------
    WalkUnderWay
        The walk itself where clock 0 stays.
    """
    start, slot = located.start, located.scenario.slot_seconds
    ahead = slot * ((walk.clock - walk.crowds_from) // slot) if seconds is None else seconds
    if not isinstance(start, TownClock) or not start.timed:
        return walk
    while ahead > 0 and not located.scenario_map.flow.covers(start.earlier(-ahead).hour):
        ahead -= slot
    moved = start.earlier(-ahead)
    if ahead == 0 or not located.scenario_map.flow.covers(moved.hour):
        return walk
    return replace(walk, crowds_at=_text(moved.given), crowds_from=walk.crowds_from + ahead)


def _found(walk: WalkUnderWay, located: Located, place: Place, seconds: float) -> Found | None:
    """Find a place on the rest of the route."""
    if isinstance(place, int):
        tails, heads = located.ends_of(walk.segments)
        nodes, metres = [*tails[:1], *heads], np.append(0.0, np.cumsum(located.metres_of(walk.segments))).tolist()
        passed = zip(nodes, metres, strict=False)
        there = next((at for node, at in passed if node == place and at >= walk.along - NEAR), None)
        return None if there is None else Found(max(there, walk.along), 0.0)
    here = located.on_plane(*place)
    if not walk.segments:
        return None
    lines = [*map(located.line, walk.segments)]
    return follow(lines, located.metres_of(walk.segments), here, walk.along, seconds)


def _come(walk: WalkUnderWay, located: Located, metres: float) -> WalkUnderWay:
    """The walk once the walker has come some metres from where its segments begin."""
    lengths, along, gone = located.metres_of(walk.segments), metres, 0
    while gone < len(lengths) - 1 and along >= lengths[gone]:
        along -= lengths[gone]
        gone += 1
    left, _ = located.ends_of(walk.segments[:gone])
    return replace(
        walk,
        segments=walk.segments[gone:],
        along=min(along, lengths[gone]),
        nodes=(*walk.nodes, *left),
        metres=walk.metres + metres - walk.along,
    )


def _rerouted(walk: WalkUnderWay, located: Located, place: Place) -> WalkUnderWay:
    """The walk without a route, which is to begin anew at a place."""
    before, _ = located.ends_of(walk.segments[:1])
    # Numbers of places in the middle of streets are those of one route.
    nodes = (*walk.nodes, *before)
    lasting = [node < located.nodes for node in nodes]
    walk = replace(walk, nodes=tuple(compress(nodes, lasting)), remembered=tuple(compress(walk.remembered, lasting)))
    return replace(walk, begins=place, rerouted=True, segments=(), along=0.0)


def _is_there(walk: WalkUnderWay, located: Located, place: Place) -> bool:
    """Whether a place is the destination, as the crow flies: as it was asked for, or on the street."""
    end = located.ends[1]
    if isinstance(place, int) or end.latitude is None or end.longitude is None:
        return place == end.node
    here, there = located.on_plane(*place), [(end.latitude, end.longitude)]
    if isinstance(walk.destination, tuple):
        there.append(walk.destination)
    return min(float(np.linalg.norm(here - located.on_plane(*each))) for each in there) <= ARRIVED


def _decided(streets: Streets, walk: WalkUnderWay, located: Located, news: News) -> tuple[WalkUnderWay, Decision]:
    with _of_location(walk):
        planner = streets.choose_planner(walk.planner, located)
    return decided(walk, located, planner, news)
