"""Answers of the services ``route``, ``table`` and ``nearest``: options of OSRM in, what the router says out."""

from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from sidestep.network.snapping import StreetPoint
from sidestep.network.town import TownError
from sidestep.planners.registry import BASELINE
from sidestep.routing.plan import RoutePlan
from sidestep.routing.quick import QuickRouter
from sidestep.routing.request import RouteError, RouteRequest, read_departure
from sidestep.server import osrm
from sidestep.server.osrm import Coordinates, Pair, Stretch, Walk
from sidestep.server.problems import ProblemError
from sidestep.server.town import ServedTown

if TYPE_CHECKING:
    from sidestep.routing.directions import Leg

FEW_FUTURES = 1
"""Futures that are simulated where nobody asks for their times."""


def snapped(served: ServedTown, coordinates: Coordinates, options: osrm.General) -> list[StreetPoint]:
    """Find coordinates on the streets.

    Parameters
    ----------
    served, coordinates, options
        The town, the places, and what is said of them.

    Returns
    -------
    list of StreetPoint
        One for each.

    Raises
    ------
    ProblemError
        Lists of another length (``InvalidOptions``), places without a street near by (``NoSegment``).
    """
    count = len(coordinates)
    for field in ("hints", "radiuses", "approaches"):
        given = getattr(options, field)
        if field == "hints" and given in ([], [""]):
            continue
        osrm.check_number(field, given, count)
    quick, hints = _quick(served, options), options.hints or [None] * count
    if len(hints) != count:
        hints = [None] * count
    found = []
    for number, ((longitude, latitude), hint) in enumerate(zip(coordinates, hints, strict=True)):
        point = None if options.walker else served.hinter.point(hint, longitude, latitude)
        if point is None:
            try:
                point = quick.snapper.nearest(latitude, longitude)
            except TownError as error:
                said = str(error)
                if quick.snapper.is_swapped(latitude, longitude):
                    said = f"{longitude:g},{latitude:g} is the latitude before the longitude; swap them"
                raise ProblemError(400, said, field="coordinates", code="NoSegment") from error
        if options.radiuses is not None and point.distance > options.radiuses[number]:
            said = f"no street within {options.radiuses[number]:g} m of coordinate {number}"
            raise ProblemError(400, said, field="radiuses", code="NoSegment")
        found.append(point)
    return found


def _quick(served: ServedTown, options: osrm.General) -> QuickRouter:
    return served.routers(options.walker, None).quick


def waypoints(
    served: ServedTown, points: Sequence[StreetPoint], options: osrm.General, places: Sequence[Pair] | None = None
) -> list[dict[str, Any]]:
    """The coordinates on the streets, in OSRM's shape.

    Parameters
    ----------
    served, points, options
        The town, the places, and what was asked.
    places
        Longitudes and latitudes on the route; by default those of the points.

    Returns
    -------
    list of dict
        One for each.
    """
    names = _quick(served, options).snapper.town.name
    found = []
    for number, point in enumerate(points):
        place = point.place[::-1] if places is None else places[number]
        hint = served.hinter.hint(point) if options.generate_hints and not options.walker else None
        found.append(osrm.waypoint(place, point, names[point.street], hint))
    return found


def is_quick(served: ServedTown, options: osrm.RouteOptions, avoid: object) -> bool:
    """Whether a route needs no more than a search by expected times, which takes a millisecond."""
    asked = options.planner or (None if served.has_model else BASELINE)
    objective = options.objective or ("time" if served.scenario.objective.to_json() is None else None)
    more = options.alternatives or options.futures or options.arrive_by or options.confidence or avoid
    return asked == BASELINE and objective == "time" and not more


def route(
    served: ServedTown, coordinates: Coordinates, options: osrm.RouteOptions, avoid: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Plan a route through some places.

    Parameters
    ----------
    served, coordinates, options
        The town, the places in their order, and what is wanted.
    avoid
        GeoJSON polygons whose streets are not walked.

    Returns
    -------
    dict
        OSRM's answer.

    Raises
    ------
    ProblemError
        Too few coordinates, and stops that are none of them.
    SidestepError
        What no route answers, with the parameter as its field.
    """
    annotations = osrm.checked_annotations(options.annotations, osrm.ANNOTATIONS)
    if len(coordinates) < 2:
        raise ProblemError(400, "a route needs two coordinates or more", field="coordinates", code="InvalidQuery")
    stops = osrm.check_indices("waypoints", options.waypoints, len(coordinates))
    if stops[0] != 0 or stops[-1] != len(coordinates) - 1 or sorted(set(stops)) != [*stops]:
        said = "waypoints must begin with the first coordinate, end with the last, and rise"
        raise ProblemError(400, said, field="waypoints", code="InvalidOptions")
    points = snapped(served, coordinates, options)
    if is_quick(served, options, avoid):
        walks = [_quick_walk(served, points, stops, options)]
    else:
        walks = _planned_walks(served, coordinates, options, avoid)
    found: dict[str, Any] = {
        "code": "Ok",
        "routes": [osrm.route(walk, options, served.town, annotations) for walk in walks],
    }
    if not options.skip_waypoints:
        places = _places(walks[0], points, stops)
        found["waypoints"] = [
            {**each, "waypoint_index": number} for number, each in enumerate(waypoints(served, points, options, places))
        ]
    return found


def _places(walk: Walk, points: Sequence[StreetPoint], stops: Sequence[int]) -> list[Pair]:
    """Where the stops are on the route; those between them are where they were found."""
    places = [point.place[::-1] for point in points]
    for stop, stretch in zip(stops, walk.stretches, strict=False):
        places[stop] = stretch.place
    course = walk.stretches[-1].course
    places[-1] = (course[-1][0], course[-1][1])
    return places


def _quick_walk(
    served: ServedTown, points: Sequence[StreetPoint], stops: Sequence[int], options: osrm.RouteOptions
) -> Walk:
    """A walk by expected times from place to place; ProblemError (``NoRoute``) where no path leads."""
    router = served.routers(options.walker, None)
    quick, departs = router.quick, served.departs(options.depart_at, router=router)
    stretches: list[Stretch] = []
    legs: list[Leg] = []
    clock, begins = departs, points[0]
    for number, (before, after) in enumerate(pairwise(points), start=1):
        try:
            found = quick.route(before, after, clock, options.exclude)
        except RouteError as error:
            raise _no_route(error) from error
        legs = [*legs, *found.legs]
        clock = clock.earlier(-found.seconds)
        if number in stops:
            longitude, latitude = (legs[0].coordinates or [])[0] if legs else begins.place[::-1]
            steps = quick.steps(legs) if options.steps else []
            stretches.append(Stretch(legs, steps, (longitude, latitude)))
            legs, begins = [], after
    return Walk(
        stretches=stretches,
        planner=BASELINE,
        departs=departs.date,
        weight=sum(stretch.seconds for stretch in stretches),
    )


def _no_route(error: RouteError) -> ProblemError:
    code = "NoRoute" if error.field == "destination" else None
    return ProblemError(400, str(error), field=error.field, code=code)


def _planned_walks(
    served: ServedTown, coordinates: Coordinates, options: osrm.RouteOptions, avoid: dict[str, Any] | None
) -> list[Walk]:
    """A walk by any planner, and alternatives to it."""
    if len(coordinates) != 2:
        asked = "alternatives, futures, arrive_by, avoid, objective and planners other than expected"
        said = f"{asked} are for routes between two coordinates; leave them out, or ask for each route"
        raise ProblemError(400, said, field="coordinates", code="NotImplemented")
    router = served.routers(options.walker, options.objective)
    origin, destination = ((latitude, longitude) for longitude, latitude in coordinates)
    deadline = read_departure(options.arrive_by, "arrive_by")
    depart = served.asked("depart_at", options.depart_at) if deadline is None or options.depart_at else None
    alternatives = int(options.alternatives) if options.alternatives is not True else 1
    futures = options.futures or (None if deadline is not None else FEW_FUTURES)
    request = RouteRequest(
        origin=origin,
        destination=destination,
        depart=depart,
        planner=options.planner,
        futures=futures,
        avoid=avoid,
        alternatives=alternatives,
        arrive_by=deadline,
        confidence=options.confidence,
        exclude=tuple(options.exclude),
    )
    try:
        plan = router.answer(request)
    except RouteError as error:
        raise _no_route(error) from error
    timed = options.futures is not None or deadline is not None
    return [_walk_of(each, timed=timed, scene=plan) for each in (plan, *plan.alternatives)]


def _walk_of(plan: RoutePlan, *, timed: bool, scene: RoutePlan) -> Walk:
    longitude, latitude = plan.course[0]
    more = {"arrives_in_time": plan.arrive_by, "shared": plan.shared}
    return Walk(
        stretches=[Stretch(plan.legs, plan.steps or [], (longitude, latitude))],
        planner=plan.planner,
        departs=None if scene.departure is None else datetime.fromisoformat(scene.departure),
        weight=60 * plan.cost_minutes,
        weight_name="duration" if scene.objective is None else "cost",
        p50=60 * plan.median_minutes if timed else None,
        p90=60 * plan.p90_minutes if timed else None,
        more={name: value for name, value in more.items() if value is not None},
    )


def table(served: ServedTown, coordinates: Coordinates, options: osrm.TableOptions) -> dict[str, Any]:
    """Times and lengths of the walks from many places to many others.

    Parameters
    ----------
    served, coordinates, options
        The town, the places, and what is wanted.

    Returns
    -------
    dict
        OSRM's answer.

    Raises
    ------
    SidestepError
        What no table answers, with the parameter as its field.
    """
    wanted = osrm.checked_annotations(options.annotations, ("duration", "distance"))
    sources = osrm.check_indices("sources", options.sources, len(coordinates))
    destinations = osrm.check_indices("destinations", options.destinations, len(coordinates))
    points = snapped(served, coordinates, options)
    router = served.routers(options.walker, None)
    departs = served.departs(options.depart_at, router=router)
    froms, tos = ([points[number] for number in numbers] for numbers in (sources, destinations))
    seconds, metres = router.quick.matrix(froms, tos, departs, options.exclude)
    found: dict[str, Any] = {"code": "Ok"}
    if "duration" in wanted:
        found["durations"] = _cells(seconds * options.scale_factor)
    if "distance" in wanted:
        found["distances"] = _cells(metres)
    if not options.skip_waypoints:
        found["sources"] = waypoints(served, froms, options)
        found["destinations"] = waypoints(served, tos, options)
    return found


def _cells(numbers: Any) -> list[list[float | None]]:
    """Rows of a table to a tenth; None where no path leads."""
    rounded = np.round(numbers, 1).astype(object)
    rounded[~np.isfinite(numbers)] = None
    return rounded.tolist()


def nearest(served: ServedTown, coordinates: Coordinates, options: osrm.NearestOptions) -> dict[str, Any]:
    """The streets nearest to a place.

    Parameters
    ----------
    served, coordinates, options
        The town, the place, and what is wanted.

    Returns
    -------
    dict
        OSRM's answer.

    Raises
    ------
    ProblemError
        No street near by (``NoSegment``).
    """
    if len(coordinates) != 1:
        raise ProblemError(400, "give one coordinate", field="coordinates", code="InvalidOptions")
    ((longitude, latitude),) = coordinates
    points = snapped(served, coordinates, options)
    snapper = _quick(served, options).snapper
    if options.number > 1:
        points = snapper.several(latitude, longitude, options.number)
    town = snapper.town
    found = waypoints(served, points, options)
    for each, point in zip(found, points, strict=True):
        each["nodes"] = [int(town.ids[town.tail[point.street]]), int(town.ids[town.head[point.street]])]
    return {"code": "Ok", "waypoints": found}
