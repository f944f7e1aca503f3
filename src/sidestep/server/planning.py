"""Answers of the services ``route``, ``table`` and ``nearest``: options of OSRM in, what the router says out."""

import math
from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from sidestep.network.snapping import Snapper, StreetPoint
from sidestep.network.town import TownError
from sidestep.planners.registry import BASELINE
from sidestep.routing.plan import RoutePlan
from sidestep.routing.quick import QuickRouter
from sidestep.routing.request import RouteError, RouteRequest, TimeOfWeek, read_departure
from sidestep.server import osrm, osrm_options
from sidestep.server.hints import rounded
from sidestep.server.osrm import Stretch, Walk
from sidestep.server.osrm_options import Coordinates, Pair
from sidestep.server.problems import ProblemError
from sidestep.server.town import FEW, ServedTown

if TYPE_CHECKING:
    from sidestep.routing.directions import Leg

BACKWARDS = 45
"""Departures that are tried at most until a walk arrives by a deadline, in a town with slots of 5 minutes."""
FEW_FUTURES = 1
"""Futures that are simulated where nobody asks for their times."""


def snapped(served: ServedTown, coordinates: Coordinates, options: osrm_options.General) -> list[StreetPoint]:
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
    for field in ("hints", "radiuses", "bearings", "approaches"):
        given = getattr(options, field)
        if not given:  # as if it were not there
            continue
        osrm_options.check_number(field, given, count)
    snapper = _quick(served, options).snapper
    found = []
    for number, (longitude, latitude) in enumerate(coordinates):
        hint = options.hints[number] if options.hints and len(options.hints) == count else None
        point = None if options.walker else served.hinter.point(hint, longitude, latitude)
        if point is None:
            point = _nearest(snapper, coordinates[number], options.bearings[number] if options.bearings else None)[0]
        if options.radiuses and point.distance > options.radiuses[number]:
            said = f"no street within {options.radiuses[number]:g} m of coordinate {number}"
            raise ProblemError(400, said, field="radiuses", code="NoSegment")
        found.append(point)
    return found


def _nearest(
    snapper: Snapper, coordinate: Pair, bearing: osrm_options.Bearing | None = None, number: int = 1
) -> list[StreetPoint]:
    """The nearest streets, of those in a bearing if there is one; ProblemError (``NoSegment``) where there are none."""
    longitude, latitude = coordinate
    if bearing is None and number == 1:
        try:
            return [snapper.nearest(latitude, longitude)]
        except TownError as error:
            raise ProblemError(400, str(error), field="coordinates", code="NoSegment") from error
    points = snapper.several(latitude, longitude, snapper.town.streets if bearing else number)
    found = [point for point in points if bearing is None or _leads(snapper, point, bearing)]
    if not found:
        said = f"no street near {longitude:g},{latitude:g}" + (" in this bearing" if bearing else "")
        field = "bearings" if bearing else "coordinates"
        raise ProblemError(400, said, field=field, code="NoSegment")
    return found[:number]


def _leads(snapper: Snapper, point: StreetPoint, bearing: osrm_options.Bearing) -> bool:
    """Whether people may walk along a street in a bearing."""
    along, (value, most) = snapper.bearing(point), bearing
    ways = [along] if snapper.town.one_way[point.street] else [along, along + 180]
    return any(abs((way - value + 180) % 360 - 180) <= most for way in ways)


def _quick(served: ServedTown, options: osrm_options.General) -> QuickRouter:
    return served.variants.router(options.walker, None).quick


def waypoints(
    served: ServedTown,
    coordinates: Sequence[Pair],
    points: Sequence[StreetPoint],
    options: osrm_options.General,
    places: Sequence[Pair] | None = None,
) -> list[dict[str, Any]]:
    """The coordinates on the streets, in OSRM's shape.

    Parameters
    ----------
    served, coordinates, points, options
        The town, the coordinates and where they are on the streets, and what was asked.
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
        hinted = options.generate_hints and not options.walker
        hint = served.hinter.hint(point, coordinates[number]) if hinted else None
        found.append(osrm.waypoint(place, point, names[point.street], hint))
    return found


def is_quick(served: ServedTown, options: osrm_options.RouteOptions, avoid: object) -> bool:
    """Whether a route needs no more than a search by expected times, which takes a millisecond."""
    asked = options.planner or (None if served.has_model else BASELINE)
    objective = options.objective or ("time" if served.scenario.objective.to_json() is None else None)
    more = options.alternatives or options.futures or options.arrive_by or options.confidence or avoid is not None
    return asked == BASELINE and objective == "time" and not more


def route(
    served: ServedTown,
    coordinates: Coordinates,
    options: osrm_options.RouteOptions,
    avoid: dict[str, Any] | None = None,
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
    annotations = osrm_options.checked_annotations(options.annotations, osrm_options.ANNOTATIONS)
    if options.alternatives > osrm_options.MOST_ALTERNATIVES:
        said = f"there may be {osrm_options.MOST_ALTERNATIVES} alternatives at most"
        raise ProblemError(400, said, field="alternatives", code="TooBig")
    _check_two(coordinates)
    if len(coordinates) > 2 and options.alternatives:  # clients ask for them without looking
        options = options.model_copy(update={"alternatives": 0})
    stops = osrm_options.check_indices("waypoints", options.waypoints, len(coordinates))
    if stops[0] != 0 or stops[-1] != len(coordinates) - 1 or sorted(set(stops)) != [*stops]:
        said = "waypoints must begin with the first coordinate, end with the last, and rise"
        raise ProblemError(400, said, field="waypoints", code="InvalidValue")
    points = snapped(served, coordinates, options)
    if is_quick(served, options, avoid):
        walks = [_quick_walk(served, coordinates, points, stops, options)]
    else:
        walks = _planned_walks(served, coordinates, points, options, avoid)
    found: dict[str, Any] = {
        "code": "Ok",
        "routes": [osrm.route(walk, options, served.town, annotations) for walk in walks],
    }
    if not options.skip_waypoints:
        found["waypoints"] = waypoints(served, coordinates, points, options, _places(walks[0], points, stops))
    return found


def _check_two(coordinates: Coordinates) -> None:
    if len(coordinates) < 2:
        raise ProblemError(
            400, f"give two coordinates or more, not {len(coordinates)}", field="coordinates", code="InvalidOptions"
        )


def _places(walk: Walk, points: Sequence[StreetPoint], stops: Sequence[int]) -> list[Pair]:
    """Where the stops are on the route; those between them are where they were found."""
    places = [point.place[::-1] for point in points]
    for (before, after), stretch in zip(pairwise(stops), walk.stretches, strict=True):
        places[before], places[after] = rounded(stretch.course[0]), rounded(stretch.course[-1])
    return places


def _quick_walk(
    served: ServedTown,
    coordinates: Coordinates,
    points: Sequence[StreetPoint],
    stops: Sequence[int],
    options: osrm_options.RouteOptions,
) -> Walk:
    """A walk by expected times from place to place; ProblemError (``NoRoute``) where no path leads."""
    router = served.variants.router(options.walker, None)
    quick, departs = router.quick, served.departs(options.depart_at, router=router)
    stretches: list[Stretch] = []
    legs: list[Leg] = []
    clock, begins, excluded = departs, points[0].place[::-1], osrm_options.excluded(options)
    for number, (before, after) in enumerate(pairwise(points), start=1):
        try:
            found = quick.route(before, after, clock, excluded)
        except RouteError as error:
            raise _no_route(error) from error
        legs = [*legs, *found.legs]
        clock = clock.earlier(-found.seconds)
        if number in stops:
            steps = quick.steps(legs) if options.steps else []
            stretch = Stretch(legs, steps, begins, coordinates[number])
            stretches.append(stretch)
            legs, begins = [], rounded(stretch.course[-1])
    return Walk(
        stretches=stretches,
        planner=BASELINE,
        departs=departs.date,
        departs_in_words=str(departs.facts(0.0)["departs"]),
        weight=sum(stretch.seconds for stretch in stretches),
    )


def _no_route(error: RouteError) -> ProblemError:
    code = "NoRoute" if error.field in {"destination", "avoid"} else None
    return ProblemError(400, str(error), field=error.field, code=code)


def _planned_walks(
    served: ServedTown,
    coordinates: Coordinates,
    points: Sequence[StreetPoint],
    options: osrm_options.RouteOptions,
    avoid: dict[str, Any] | None,
) -> list[Walk]:
    """A walk by any planner, and alternatives to it."""
    if len(coordinates) != 2:
        asked = "futures, arrive_by, avoid, objective and planners other than expected"
        said = f"{asked} are for routes between two coordinates; leave them out, or ask for each route"
        raise ProblemError(400, said, field="coordinates", code="NotImplemented")
    router = served.variants.router(options.walker, options.objective)
    origin, destination = (point.place for point in points)
    deadline = read_departure(options.arrive_by, "arrive_by", grids=False)
    some_week = isinstance(deadline, TimeOfWeek) and deadline.day is not None
    # What is past cannot be walked.
    depart = None if some_week and options.depart_at is None else served.asked("depart_at", options.depart_at)
    if deadline is None:
        futures = served.futures(options.planner, options.futures or FEW_FUTURES)
    else:
        futures = served.futures(options.planner, options.futures or FEW, BACKWARDS)
    request = RouteRequest(
        origin=origin,
        destination=destination,
        depart=depart,
        planner=options.planner,
        futures=futures,
        avoid=avoid,
        alternatives=options.alternatives,
        arrive_by=deadline,
        confidence=options.confidence,
        exclude=osrm_options.excluded(options),
    )
    try:
        plan = router.answer(request)
    except RouteError as error:
        raise _no_route(error) from error
    if not plan.arrives:
        most = router.scenario.horizon / 60
        said = f"the walk by {plan.planner} does not arrive: walks are given up after {most:g} minutes"
        raise ProblemError(400, said, field="destination", code="NoRoute")
    timed = options.futures is not None or deadline is not None
    return [_walk_of(each, coordinates[-1], timed=timed, scene=plan) for each in (plan, *plan.alternatives)]


def _walk_of(plan: RoutePlan, sought: Pair, *, timed: bool, scene: RoutePlan) -> Walk:
    longitude, latitude = plan.course[0]
    more = {"arrives_in_time": plan.arrive_by, "shared": plan.shared}
    return Walk(
        stretches=[Stretch(plan.legs, plan.steps or [], (longitude, latitude), sought)],
        planner=plan.planner,
        departs=None if scene.departure is None else datetime.fromisoformat(scene.departure),
        departs_in_words=scene.departs,
        weight=60 * plan.cost_minutes,
        weight_name="duration" if scene.objective is None else "cost",
        p50=60 * plan.median_minutes if timed else None,
        p90=60 * plan.p90_minutes if timed else None,
        more={name: value for name, value in more.items() if value is not None},
    )


def walk_of(plan: RoutePlan) -> Walk:
    """A plan with its simulated times as a whole route."""
    place = plan.destination
    return _walk_of(plan, (place.longitude or 0.0, place.latitude or 0.0), timed=True, scene=plan)


def table(served: ServedTown, coordinates: Coordinates, options: osrm_options.TableOptions) -> dict[str, Any]:
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
    wanted = osrm_options.checked_annotations(options.annotations, ("duration", "distance"))
    _check_two(coordinates)
    sources = osrm_options.check_indices("sources", options.sources, len(coordinates))
    destinations = osrm_options.check_indices("destinations", options.destinations, len(coordinates))
    points = snapped(served, coordinates, options)
    router = served.variants.router(options.walker, None)
    departs = served.departs(options.depart_at, router=router)
    froms, tos = ([points[number] for number in numbers] for numbers in (sources, destinations))
    seconds, metres = router.quick.matrix(froms, tos, departs, osrm_options.excluded(options))
    found: dict[str, Any] = {"code": "Ok"}
    seconds *= options.scale_factor
    if options.fallback_speed is not None:
        places = coordinates if options.fallback_coordinate == "input" else [point.place[::-1] for point in points]
        xy = served.town.project(np.array(places))
        apart = np.linalg.norm(xy[[*sources], None] - xy[None, [*destinations]], axis=-1)
        missing = ~np.isfinite(seconds)
        seconds[missing], metres[missing] = apart[missing] / options.fallback_speed, apart[missing]
        found["fallback_speed_cells"] = np.argwhere(missing).tolist()
    if "duration" in wanted:
        found["durations"] = _cells(seconds)
    if "distance" in wanted:
        found["distances"] = _cells(metres)
    if not options.skip_waypoints:
        for name, numbers, each in ("sources", sources, froms), ("destinations", destinations, tos):
            found[name] = waypoints(served, [coordinates[number] for number in numbers], each, options)
    return found


def _cells(numbers: Any) -> list[list[float | None]]:
    """Rows of a table to a tenth; None where no path leads."""
    rounded = np.round(numbers, 1).astype(object)
    rounded[~np.isfinite(numbers)] = None
    return rounded.tolist()


def nearest(served: ServedTown, coordinates: Coordinates, options: osrm_options.NearestOptions) -> dict[str, Any]:
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
        raise ProblemError(
            400, f"give one coordinate, not {len(coordinates)}", field="coordinates", code="InvalidOptions"
        )
    points = snapped(served, coordinates, options)
    snapper = _quick(served, options).snapper
    if options.number > 1:
        bearing = options.bearings[0] if options.bearings else None
        most = options.radiuses[0] if options.radiuses else math.inf
        nearest_first = _nearest(snapper, coordinates[0], bearing, options.number)
        points = [point for point in nearest_first if point.distance <= most]
    town = snapper.town
    found = waypoints(served, coordinates * len(points), points, options)
    for each, point in zip(found, points, strict=True):
        each["nodes"] = [int(town.ids[town.tail[point.street]]), int(town.ids[town.head[point.street]])]
    return {"code": "Ok", "waypoints": found}
