"""The shapes of OSRM's HTTP API, version 1: routes, tables and the nearest streets.

https://project-osrm.org/docs/ describes them. What is added has names that OSRM does not use.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
import polyline

from sidestep.network.geodesy import heading, metres_between
from sidestep.network.snapping import StreetPoint, simplified
from sidestep.network.town import Town
from sidestep.routing.directions import CROWDING, TURNS, Leg, Step, crowding_word, turn_word
from sidestep.server.hints import DIGITS, rounded
from sidestep.server.osrm_options import ANNOTATIONS, Pair, RouteOptions

SIMPLIFIED = 10.0
"""Metres by which a simplified overview may be off."""
SOURCE = "expected crowds"
"""What the numbers along a route come from."""
CONGESTION = dict(zip((word for _, word in CROWDING), ("low", "moderate", "heavy", "severe"), strict=True))
"""Mapbox's words for congestion, which clients colour routes by, for ours of crowding."""
JAMMED = 5.4
"""Persons/m² of a ``congestion_numeric`` of 100: nobody moves there (U. Weidmann, Transporttechnik der Fussgänger)."""
_MODIFIERS = {
    ours.format(side): theirs.format(side)
    for (_, ours), theirs in zip(TURNS, ("straight", "slight {}", "{}", "sharp {}", "uturn"), strict=True)
    for side in ("left", "right")
}
"""OSRM's words for our turns."""
_BESIDE = 5.0, 300.0
"""Metres from the end of a route between which its place is said to be on one side."""


def waypoint(place: Pair, point: StreetPoint, name: str, hint: str | None) -> dict[str, Any]:
    """A coordinate on the streets.

    Parameters
    ----------
    place
        Longitude and latitude of the place on the street.
    point, name
        The place, and the name of its street.
    hint
        Text for later requests, if it is wanted.

    Returns
    -------
    dict
        OSRM's waypoint.
    """
    found = {"location": list(rounded(place)), "name": name, "distance": round(point.distance, 3)}
    return found if hint is None else {"hint": hint, **found}


@dataclass(frozen=True)
class Stretch:
    """A walk from one stop to the next: one of OSRM's legs."""

    legs: Sequence[Leg]
    """The segments of it; none where both stops are the same place."""
    steps: Sequence[Step]
    """Turn by turn."""
    place: Pair
    """Longitude and latitude where it begins."""
    sought: Pair | None = None
    """Those of the coordinate at its end, which may lie beside the street."""

    @property
    def seconds(self) -> float:
        return 60 * sum(leg.minutes for leg in self.legs)

    @property
    def metres(self) -> float:
        return sum(leg.metres for leg in self.legs)

    @cached_property
    def course(self) -> list[list[float]]:
        """Longitudes and latitudes, points at which two segments meet once; two points at least."""
        points = [point for number, leg in enumerate(self.legs) for point in (leg.coordinates or [])[number > 0 :]]
        return np.round(points or [[*self.place], [*self.place]], DIGITS).tolist()

    @cached_property
    def begins(self) -> list[int]:
        """Which point of the course each segment begins at, and at last which one the walk ends at."""
        return [0, *accumulate(len(leg.coordinates or ()) - 1 for leg in self.legs)]


def geometry(points: Any, form: str) -> Any:
    """A line as text or GeoJSON.

    Parameters
    ----------
    points
        Longitude and latitude of each.
    form
        ``polyline``, ``polyline6`` or ``geojson``.

    Returns
    -------
    str or dict
        The line.
    """
    if form == "geojson":
        return {"type": "LineString", "coordinates": points}
    return polyline.encode(points, 6 if form == "polyline6" else 5, geojson=True)


def modifier(before: float | None, after: float) -> str:
    """OSRM's word for a turn from one bearing to another, in degrees clockwise from north."""
    return "straight" if before is None else _MODIFIERS[turn_word(before, after)]


def _steps(stretch: Stretch, form: str) -> list[dict[str, Any]]:
    """Turn by turn, with the arrival at last."""
    found: list[dict[str, Any]] = []
    firsts = [step.first_leg for step in stretch.steps]
    for number, (step, (first, beyond)) in enumerate(
        zip(stretch.steps, pairwise([*firsts, len(stretch.legs)]), strict=True)
    ):
        points = stretch.course[stretch.begins[first] : stretch.begins[beyond] + 1]
        turned = modifier(step.bearing_before, step.bearing_after)
        name = stretch.legs[first].name or ""
        kind = "turn"
        if number == 0:
            kind = "depart"
        elif name and name == found[-1]["name"]:
            kind = "continue"
        elif turned == "straight":
            kind = "new name"
        maneuver = _maneuver(kind, turned, points[0], step.bearing_before, step.bearing_after)
        maneuver["instruction"] = f"{step.turn}: {step.street}"
        found.append(_step(points, form, maneuver, name, 60 * step.minutes, step.metres))
    points = stretch.course
    end = heading(*(stretch.legs[-1].coordinates or points)[-2:])[0] if stretch.legs else 0.0
    arrival = _maneuver("arrive", _side(stretch, end), points[-1], end, None)
    arrival["instruction"] = "arrive"
    name = (stretch.legs[-1].name or "") if stretch.legs else ""
    if not found:
        begin = _maneuver("depart", "straight", points[0], None, 0.0) | {"instruction": "depart"}
        found.append(_step(points, form, begin, name, 0.0, 0.0))
    found.append(_step([points[-1], points[-1]], form, arrival, name, 0.0, 0.0))
    return found


def _side(stretch: Stretch, ahead: float) -> str:
    """On which side of a walk's end the coordinate is that it leads to; straight on where it is on the street."""
    if stretch.sought is None:
        return "straight"
    bearing, metres = heading(stretch.course[-1], stretch.sought)
    nearest, farthest = _BESIDE
    return modifier(ahead, bearing) if nearest <= metres <= farthest else "straight"


def _maneuver(kind: str, turned: str, place: list[float], before: float | None, after: float | None) -> dict[str, Any]:
    return {
        "type": kind,
        "modifier": turned,
        "location": place,
        "bearing_before": 0 if before is None else round(before) % 360,
        "bearing_after": 0 if after is None else round(after) % 360,
    }


def _step(
    points: list[list[float]], form: str, maneuver: dict[str, Any], name: str, seconds: float, metres: float
) -> dict[str, Any]:
    after, back = maneuver["bearing_after"], (maneuver["bearing_before"] + 180) % 360
    crossing: dict[str, Any] = {"location": maneuver["location"]}
    match maneuver["type"]:
        case "depart":
            crossing |= {"out": 0, "bearings": [after], "entry": [True]}
        case "arrive":
            crossing |= {"in": 0, "bearings": [back], "entry": [True]}
        case _:
            ways = sorted({back, after})
            crossing |= {"in": ways.index(back), "out": ways.index(after), "bearings": ways}
            crossing["entry"] = [way == after for way in ways]
    return {
        "geometry": geometry(points, form),
        "maneuver": maneuver,
        "mode": "walking",
        "driving_side": "right",
        "name": name,
        "intersections": [crossing],
        "weight": round(seconds, 1),
        "duration": round(seconds, 1),
        "distance": round(metres, 1),
    }


def _annotation(stretch: Stretch, names: Sequence[str]) -> dict[str, Any]:
    """Numbers for each pair of neighbouring points of the course."""
    columns: dict[str, list[Any]] = {name: [] for name in ANNOTATIONS}
    for leg in stretch.legs:
        points = np.array(leg.coordinates)
        metres = metres_between(points[:-1], points[1:])
        shares = (metres / max(float(metres.sum()), 1e-9)).tolist()
        seconds = [round(60 * leg.minutes * share, 3) for share in shares]
        columns["distance"] += [round(leg.metres * share, 3) for share in shares]
        columns["duration"] += seconds
        columns["weight"] += seconds
        columns["datasources"] += [0] * len(shares)
        columns["speed"] += [round(leg.metres / max(60 * leg.minutes, 1e-9), 3)] * len(shares)
        columns["congestion"] += [CONGESTION[crowding_word(leg.density)]] * len(shares)
        columns["congestion_numeric"] += [min(100, round(100 * leg.density / JAMMED))] * len(shares)
    if not stretch.legs:
        empty = {"datasources": 0, "congestion": "unknown", "congestion_numeric": None}
        columns = {name: [empty.get(name, 0.0)] for name in ANNOTATIONS}
    found: dict[str, Any] = {name: columns[name] for name in names}
    return found | ({"metadata": {"datasource_names": [SOURCE]}} if "datasources" in names else {})


def _summary(stretch: Stretch) -> str:
    """Names of the two longest streets, in the order of the route."""
    metres: dict[str, float] = {}
    for leg in stretch.legs:
        if leg.name:
            metres[leg.name] = metres.get(leg.name, 0.0) + leg.metres
    longest = sorted(metres, key=lambda name: -metres[name])[:2]
    return ", ".join(name for name in metres if name in longest)


@dataclass(frozen=True, kw_only=True)
class Walk:
    """A whole route."""

    stretches: Sequence[Stretch]
    planner: str
    departs: datetime | None
    """Local time of the departure; None where no day was given, or crowds know no times."""
    departs_in_words: str
    """The same for people."""
    weight: float
    """Cost by the objective, in s."""
    weight_name: str = "duration"
    p50: float | None = None
    """Seconds within which it arrives in half of the simulated futures; None where there are none."""
    p90: float | None = None
    """The same in 90 % of them."""
    more: dict[str, Any] | None = None
    """What else is said of it."""


def route(walk: Walk, options: RouteOptions, town: Town, annotations: Sequence[str]) -> dict[str, Any]:
    """A route in OSRM's shape.

    Parameters
    ----------
    walk, options
        The route, and how it is wanted.
    town
        The streets.
    annotations
        Names of what is wanted along its course.

    Returns
    -------
    dict
        Ready for JSON.
    """
    legs = []
    for stretch in walk.stretches:
        seconds = round(stretch.seconds, 1)
        leg: dict[str, Any] = {
            "steps": _steps(stretch, options.geometries) if options.steps else [],
            "summary": _summary(stretch) if options.steps else "",
            "weight": seconds,
            "duration": seconds,
            "distance": round(stretch.metres, 1),
        }
        if annotations:
            leg["annotation"] = _annotation(stretch, annotations)
        legs.append(leg)
    seconds = sum(stretch.seconds for stretch in walk.stretches)
    found: dict[str, Any] = {
        "legs": legs,
        "weight_name": walk.weight_name,
        "weight": round(walk.weight, 1),
        "duration": round(seconds, 1),
        "distance": round(sum(stretch.metres for stretch in walk.stretches), 1),
        "planner": walk.planner,
        "people_met": round(sum(leg.exposure for stretch in walk.stretches for leg in stretch.legs), 1),
    }
    if options.overview not in {"false", False}:
        courses = [stretch.course for stretch in walk.stretches]
        if options.overview == "simplified":  # one by one, so that stops are not left out
            courses = [simplified(town, course, SIMPLIFIED) for course in courses]
        points = [point for number, course in enumerate(courses) for point in course[number > 0 :]]
        found = {"geometry": geometry(points, options.geometries), **found}
    found["departs"] = walk.departs_in_words
    if walk.departs is not None:
        found["departure"] = walk.departs.isoformat(timespec="seconds")
    if walk.p50 is not None and walk.p90 is not None:
        found |= {"p50": round(walk.p50, 1), "p90": round(walk.p90, 1)}
    return found | (walk.more or {})
