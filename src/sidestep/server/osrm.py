"""The shapes of OSRM's HTTP API, version 1: parameters, routes, tables and the nearest streets.

https://project-osrm.org/docs/ describes them. What is added has names that OSRM does not use.
"""

import base64
import math
import re
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Annotated, Any, Literal

import numpy as np
import polyline
from jaxtyping import Float
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from sidestep.network.snapping import StreetPoint, simplified
from sidestep.network.town import Town
from sidestep.routing.directions import CROWDING, Leg, Step
from sidestep.server.problems import ProblemError

MOST_COORDINATES = 100
"""Of one route or table."""
MOST_ALTERNATIVES = 3
MOST_NEAREST = 100
SIMPLIFIED = 10.0
"""Metres by which a simplified overview may be off."""
ANNOTATIONS = ("duration", "distance", "speed", "weight", "datasources", "congestion", "congestion_numeric")
SOURCE = "expected crowds"
"""What the numbers along a route come from."""
PLANNER = r"^[\w.-]{1,80}$"
"""Names of planners only: elsewhere ``module:name`` is one, too, which imports a module and calls what is in it."""
PROFILES = ("foot", "walking", "pedestrian")
CONGESTION = dict(zip((word for _, word in CROWDING), ("low", "moderate", "heavy", "severe"), strict=True))
"""Mapbox's words for congestion, which clients colour routes by, for ours of crowding."""
JAMMED = 5.4
"""Persons/m² of a ``congestion_numeric`` of 100: nobody moves there (U. Weidmann, Transporttechnik der Fussgänger)."""
_MODIFIERS = ((20.0, "straight"), (60.0, "slight {}"), (120.0, "{}"), (165.0, "sharp {}"), (math.inf, "uturn"))
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_COORDINATES = re.compile(rf"{_NUMBER},{_NUMBER}(?:;{_NUMBER},{_NUMBER})*", re.ASCII)
_ENCODED = re.compile(r"polyline(6?)\((.*)\)", re.ASCII | re.DOTALL)
_HINT = struct.Struct("<IIdii")
_SUFFIX = ".json"
_DIGITS = 6
"""Of degrees, as OSRM has them: clients look for waypoints among the points of a line, which must be the same."""
_DEGREE = 111_195.08
"""Metres of a degree of latitude."""
_BESIDE = 5.0, 300.0
"""Metres from the end of a route between which its place is said to be on one side."""

Coordinates = list[tuple[float, float]]
"""Longitudes and latitudes in degrees."""


def _split(given: Any) -> Any:
    """Text between semicolons, as URLs have lists; a query parameter comes as a list of one text."""
    if isinstance(given, list) and len(given) == 1 and isinstance(given[0], str):
        given = given[0]
    return given.split(";") if isinstance(given, str) else given


def _commas(given: Any) -> Any:
    """The same with commas."""
    if isinstance(given, list) and len(given) == 1 and isinstance(given[0], str):
        given = given[0]
    return given.split(",") if isinstance(given, str) else given


def _all_or_names(given: Any) -> Any:
    names = _commas(given)
    return names == ["true"] if names in (["true"], ["false"]) else names


def _unlimited(given: Any) -> Any:
    parts = _split(given)
    if not isinstance(parts, list):
        return parts
    return [math.inf if each in ("unlimited", "", None) else each for each in parts]


def _bearings(given: Any) -> Any:
    parts = _split(given)
    if not isinstance(parts, list):
        return parts
    return _tuples(
        [each.split(",") if isinstance(each, str) and each else None if each == "" else each for each in parts]
    )


def _tuples(parts: Any) -> Any:
    """Lists as tuples, which JSON does not have."""
    return [tuple(each) if isinstance(each, list) else each for each in parts] if isinstance(parts, list) else parts


def _numbers_or_all(given: Any) -> Any:
    return None if given in ("all", ["all"], []) else _split(given)


def _alternatives(given: Any) -> Any:
    given = {"true": True, "false": False}.get(given, given) if isinstance(given, str) else given
    return int(given) if isinstance(given, bool) else given


def _places(given: Any) -> Any:
    return read_coordinates(given) if isinstance(given, str) else _tuples(given)


Radius = Annotated[float, Field(ge=0)]
Bearing = tuple[Annotated[int, Field(ge=0, le=360)], Annotated[int, Field(ge=0, le=180)]]
"""Degrees clockwise from north, and how many the street may be off."""
Pair = tuple[float, float]
Approach = Literal["curb", "opposite", "unrestricted", ""]
Hints = Annotated[list[str | None], BeforeValidator(_split), Field(max_length=MOST_COORDINATES)]
Words = Annotated[list[str], BeforeValidator(_commas), Field(max_length=16)]
Names = Annotated[bool | Annotated[list[str], Field(max_length=16)], BeforeValidator(_all_or_names)]
Radiuses = Annotated[list[Radius], BeforeValidator(_unlimited), Field(max_length=MOST_COORDINATES)]
Bearings = Annotated[list[Bearing | None], BeforeValidator(_bearings), Field(max_length=MOST_COORDINATES)]
Approaches = Annotated[list[Approach | None], BeforeValidator(_split), Field(max_length=MOST_COORDINATES)]
Indices = Annotated[
    Annotated[list[Annotated[int, Field(ge=0)]], Field(max_length=MOST_COORDINATES)] | None,
    BeforeValidator(_numbers_or_all),
]
Places = Annotated[list[Pair], BeforeValidator(_places, json_schema_input_type=list[Pair] | str)]
Text = Annotated[str, Field(max_length=200)]


class General(BaseModel):
    """Parameters of all services."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    hints: Hints | None = None
    """From an earlier answer, one for each coordinate: the place on the streets is not looked for again."""
    radiuses: Radiuses | None = None
    """Metres from each coordinate within which its street lies."""
    bearings: Bearings | None = None
    """Bearings of the streets on which the coordinates are looked for. Walkers may set out either way."""
    approaches: Approaches | None = None
    """Accepted and ignored: walkers come from either side."""
    generate_hints: bool = True
    skip_waypoints: bool = False
    exclude: Words = Field(default_factory=list)
    """Kinds of streets that are not walked, such as ``steps``; ``none`` is none of them."""
    snapping: Literal["default", "any"] = "default"
    depart_at: Text | None = None
    """Local time: ISO 8601, ``Fri 17:30`` or ``17:30``; by default now."""
    walker: Text | None = None
    """Who walks, as in ``sidestep route --walker``."""


class RouteOptions(General):
    """Parameters of the service ``route``."""

    alternatives: Annotated[int, BeforeValidator(_alternatives, json_schema_input_type=bool | int), Field(ge=0)] = 0
    """The most of them; none between more than two coordinates."""
    steps: bool = False
    annotations: Names = False
    geometries: Literal["polyline", "polyline6", "geojson"] = "polyline"
    overview: Literal["simplified", "full", "false", False] = "simplified"
    continue_straight: Literal["default", "true", "false"] | bool = "default"
    """Accepted and ignored: walkers may turn round anywhere."""
    waypoints: Indices = None
    """Which coordinates are stops; between the others routes go on without one."""
    arrive_by: Text | None = None
    """When to be there; the route then departs as late as ``confidence`` allows."""
    confidence: Annotated[float, Field(gt=0, le=1)] | None = None
    planner: Annotated[str, Field(pattern=PLANNER)] | None = None
    """Who plans; by default ``expected``, or ``darp`` where the server has a model."""
    objective: Text | None = None
    """What is kept low, as in ``sidestep route --objective``."""
    futures: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Simulated futures; the route then has ``p50`` and ``p90``."""


class TableOptions(General):
    """Parameters of the service ``table``."""

    sources: Indices = None
    destinations: Indices = None
    annotations: Names = Field(default_factory=lambda: ["duration"])
    scale_factor: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    fallback_speed: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """Metres per second, as the crow flies, where no path leads."""
    fallback_coordinate: Literal["input", "snapped"] = "input"


class NearestOptions(General):
    """Parameters of the service ``nearest``."""

    number: Annotated[int, Field(ge=1, le=MOST_NEAREST)] = 1


class RouteBody(RouteOptions):
    """Body of a route's POST."""

    model_config = ConfigDict(strict=True)

    coordinates: Annotated[Places, Field(max_length=MOST_COORDINATES)]
    format: Literal["json"] = "json"
    avoid: dict[str, Any] | None = None
    """GeoJSON polygons whose streets are not walked."""


class TableBody(TableOptions):
    """Body of a table's POST."""

    model_config = ConfigDict(strict=True)

    coordinates: Annotated[Places, Field(max_length=MOST_COORDINATES)]
    format: Literal["json"] = "json"


class NearestBody(NearestOptions):
    """Body of a POST for the nearest streets."""

    model_config = ConfigDict(strict=True)

    coordinates: Annotated[Places, Field(max_length=MOST_COORDINATES)]
    format: Literal["json"] = "json"


def check_profile(profile: str) -> None:
    """Refuse profiles of vehicles."""
    if profile not in PROFILES:
        said = f"walks are all that is planned here; the profile must be {', '.join(PROFILES)}, not {profile!r:.40}"
        raise ProblemError(400, said, field="profile", code="InvalidValue")


def read_coordinates(text: str, most: int = MOST_COORDINATES) -> Coordinates:
    """Read the coordinates of a URL.

    Parameters
    ----------
    text
        ``LON,LAT;LON,LAT;…``, ``polyline(…)`` or ``polyline6(…)``; ``.json`` may follow.
    most
        The most of them.

    Returns
    -------
    Coordinates
        Longitudes and latitudes.

    Raises
    ------
    ProblemError
        Anything else (``InvalidQuery``), degrees that do not exist (``InvalidValue``), too many (``TooBig``).
    """
    text = text.removesuffix(_SUFFIX)
    if text.endswith(".flatbuffers"):
        raise ProblemError(400, "answers are JSON only", field="format", code="NotImplemented")
    if text.count(";") >= most or len(text) > 64 * most:
        raise ProblemError(400, f"there may be {most} coordinates at most", field="coordinates", code="TooBig")
    if encoded := _ENCODED.fullmatch(text):
        try:
            found = polyline.decode(encoded[2], 6 if encoded[1] else 5, geojson=True)
        except (IndexError, OverflowError, ValueError) as error:
            raise ProblemError(400, "this is no polyline", field="coordinates", code="InvalidQuery") from error
    elif _COORDINATES.fullmatch(text):
        numbers = [float(each) for pair in text.split(";") for each in pair.split(",")]
        found = list(zip(numbers[::2], numbers[1::2], strict=True))
    else:
        said = (
            "coordinates must be LONGITUDE,LATITUDE pairs with semicolons between them, such as 24.94,60.17;24.95,60.16"
        )
        raise ProblemError(400, said, field="coordinates", code="InvalidQuery")
    return check_coordinates(found, most)


def check_coordinates(found: Sequence[Pair], most: int = MOST_COORDINATES) -> Coordinates:
    """Refuse too many coordinates, and degrees that do not exist.

    Parameters
    ----------
    found, most
        Longitudes and latitudes, and how many there may be.

    Returns
    -------
    Coordinates
        The same.

    Raises
    ------
    ProblemError
        With the field ``coordinates``.
    """
    if len(found) > most:
        raise ProblemError(400, f"there may be {most} coordinates at most", field="coordinates", code="TooBig")
    for longitude, latitude in found:
        if not (-180 <= longitude <= 180 and -90 <= latitude <= 90):
            said = f"{longitude:g},{latitude:g} is no place: give the longitude (-180 to 180), then the latitude"
            raise ProblemError(400, said, field="coordinates", code="InvalidValue")
    return list(found)


def excluded(options: General) -> tuple[str, ...]:
    """The kinds of streets that are not walked."""
    return tuple(kind for kind in options.exclude if kind != "none")


def check_number(field: str, given: Sequence[Any] | None, coordinates: int) -> None:
    """Refuse lists that must have one entry for each coordinate, and have not."""
    if given is not None and len(given) != coordinates:
        said = f"{field} must be as many as the coordinates, {coordinates}, not {len(given)}"
        raise ProblemError(400, said, field=field, code="InvalidOptions")


def check_indices(field: str, given: Sequence[int] | None, coordinates: int) -> Sequence[int]:
    """Numbers of coordinates, by default all.

    Parameters
    ----------
    field, given
        The parameter, and its value.
    coordinates
        How many there are.

    Returns
    -------
    Sequence[int]
        The numbers.

    Raises
    ------
    ProblemError
        Numbers of no coordinate.
    """
    found = range(coordinates) if given is None else given
    if not found or max(found) >= coordinates or len(found) > coordinates:
        said = f"{field} must be numbers of coordinates, 0 to {coordinates - 1}"
        raise ProblemError(400, said, field=field, code="InvalidOptions")
    return found


def checked_annotations(given: bool | Sequence[str], known: Sequence[str]) -> list[str]:
    """Names of annotations; those that are not known are refused."""
    if isinstance(given, bool):
        return [*known] if given else []
    for name in given:
        if name not in known:
            said = f"annotations must be among {', '.join(known)}, not {name!r:.40}"
            # The points between two crossings have no numbers here.
            code = "NotImplemented" if name == "nodes" and len(known) > 2 else "InvalidQuery"
            raise ProblemError(400, said, field="annotations", code=code)
    return list(dict.fromkeys(given))


class Hinter:
    """Writes places on streets as text that clients send back, so that these are not looked for again.

    Parameters
    ----------
    town
        The streets; hints of other streets are ignored.
    """

    def __init__(self, town: Town) -> None:
        self._town = town
        self._sum = zlib.crc32(town.points.tobytes())

    def hint(self, point: StreetPoint, coordinate: Pair) -> str:
        """Text for a place on a street, found for a longitude and a latitude."""
        return base64.urlsafe_b64encode(
            _HINT.pack(self._sum, point.street, point.fraction, *_fixed(coordinate))
        ).decode()

    def point(self, hint: str | None, longitude: float, latitude: float) -> StreetPoint | None:
        """The place on a street that a hint says.

        Parameters
        ----------
        hint
            Text of :meth:`hint`; anything else is ignored.
        longitude, latitude
            Degrees of the place that is asked for.

        Returns
        -------
        StreetPoint or None
            None where it must be looked for, as for other coordinates than those of the hint.
        """
        try:
            total, street, fraction, *coordinate = _HINT.unpack(base64.urlsafe_b64decode(hint or ""))
        except (ValueError, struct.error):
            return None
        town = self._town
        if total != self._sum or not (0 <= street < town.streets and 0 <= fraction <= 1):
            return None
        if tuple(coordinate) != _fixed((longitude, latitude)):
            return None
        course = town.project(town.course(street))
        along = np.append(0.0, np.linalg.norm(np.diff(course, axis=0), axis=1).cumsum())
        at = np.array([np.interp(fraction * along[-1], along, column) for column in course.T])
        away = float(np.linalg.norm(town.project(np.array([longitude, latitude])) - at))
        there = town.projection.unproject(at).tolist()
        return StreetPoint(street, fraction, away, (there[1], there[0]))


def _fixed(coordinate: Pair) -> tuple[int, int]:
    longitude, latitude = coordinate
    return round(longitude * 10**_DIGITS), round(latitude * 10**_DIGITS)


def rounded(place: Sequence[float]) -> Pair:
    """A longitude and latitude with as many digits as all places have in answers."""
    longitude, latitude = place
    return round(longitude, _DIGITS), round(latitude, _DIGITS)


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
        return np.round(points or [[*self.place], [*self.place]], _DIGITS).tolist()

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
    if before is None:
        return "straight"
    angle = (after - before + 180) % 360 - 180
    words = next(words for limit, words in _MODIFIERS if abs(angle) <= limit)
    return words.format("right" if angle > 0 else "left")


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
    end = _heading(stretch.legs)
    arrival = _maneuver("arrive", _side(stretch, end), points[-1], end, None)
    arrival["instruction"] = "arrive"
    name = (stretch.legs[-1].name or "") if stretch.legs else ""
    if not found:
        begin = _maneuver("depart", "straight", points[0], None, 0.0) | {"instruction": "depart"}
        found.append(_step(points, form, begin, name, 0.0, 0.0))
    found.append(_step([points[-1], points[-1]], form, arrival, name, 0.0, 0.0))
    return found


def _heading(legs: Sequence[Leg]) -> float:
    """The bearing in which the last of the segments ends; 0 where there are none."""
    if not legs or not legs[-1].coordinates:
        return 0.0
    (west, south), (east, north) = legs[-1].coordinates[-2:]
    return math.degrees(math.atan2((east - west) * math.cos(math.radians(north)), north - south)) % 360


def _side(stretch: Stretch, heading: float) -> str:
    """On which side of a walk's end the coordinate is that it leads to; straight on where it is on the street."""
    if stretch.sought is None:
        return "straight"
    (west, south), (east, north) = stretch.course[-1], stretch.sought
    beside, ahead = (east - west) * math.cos(math.radians(north)), north - south
    nearest, farthest = _BESIDE
    if not nearest <= _DEGREE * math.hypot(beside, ahead) <= farthest:
        return "straight"
    return modifier(heading, math.degrees(math.atan2(beside, ahead)) % 360)


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
        metres = np.linalg.norm(np.diff(points, axis=0) * _scale(points), axis=1)
        shares = (metres / max(float(metres.sum()), 1e-9)).tolist()
        seconds = [round(60 * leg.minutes * share, 3) for share in shares]
        columns["distance"] += [round(leg.metres * share, 3) for share in shares]
        columns["duration"] += seconds
        columns["weight"] += seconds
        columns["datasources"] += [0] * len(shares)
        columns["speed"] += [round(leg.metres / max(60 * leg.minutes, 1e-9), 3)] * len(shares)
        word = next(word for limit, word in CROWDING if leg.density < limit)
        columns["congestion"] += [CONGESTION[word]] * len(shares)
        columns["congestion_numeric"] += [min(100, round(100 * leg.density / JAMMED))] * len(shares)
    if not stretch.legs:
        empty = {"datasources": 0, "congestion": "unknown", "congestion_numeric": None}
        columns = {name: [empty.get(name, 0.0)] for name in ANNOTATIONS}
    found: dict[str, Any] = {name: columns[name] for name in names}
    return found | ({"metadata": {"datasource_names": [SOURCE]}} if "datasources" in names else {})


def _scale(points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "2"]:
    return np.array([math.cos(math.radians(float(points[0, 1]))), 1.0])


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
    """Local time of the departure; None where crowds know none."""
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
    if walk.departs is not None:
        found["departure"] = walk.departs.isoformat(timespec="seconds")
    if walk.p50 is not None and walk.p90 is not None:
        found |= {"p50": round(walk.p50, 1), "p90": round(walk.p90, 1)}
    return found | (walk.more or {})
