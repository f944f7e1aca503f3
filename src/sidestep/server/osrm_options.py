"""The parameters of OSRM's services, in URLs and in JSON, and what is refused of them.

https://project-osrm.org/docs/ describes them. What is added has names that OSRM does not use.
"""

import math
import re
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import polyline
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from sidestep.server.problems import PLANNER, ProblemError

MOST_COORDINATES = 100
"""Of one route or table."""
MOST_ALTERNATIVES = 3
MOST_NEAREST = 100
ANNOTATIONS = ("duration", "distance", "speed", "weight", "datasources", "congestion", "congestion_numeric")
PROFILES = ("foot", "walking", "pedestrian")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_COORDINATES = re.compile(rf"{_NUMBER},{_NUMBER}(?:;{_NUMBER},{_NUMBER})*", re.ASCII)
_ENCODED = re.compile(r"polyline(6?)\((.*)\)", re.ASCII | re.DOTALL)
_SUFFIX = ".json"
Coordinates = list[tuple[float, float]]
"""Longitudes and latitudes in degrees."""


def _split(given: Any, mark: str = ";") -> Any:
    """Text between semicolons, as URLs have lists; a query parameter comes as a list of one text, or of none."""
    if isinstance(given, list) and len(given) == 1 and isinstance(given[0], str):
        given = given[0]
    if given == "":
        return []
    return given.split(mark) if isinstance(given, str) else given


def _commas(given: Any) -> Any:
    """The same with commas."""
    return _split(given, ",")


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

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

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
    """Local time: ISO 8601, ``Fri 17:30`` or, of today, ``17:30``; by default now."""
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
            raise ProblemError(
                400, f"coordinates must be a polyline, not {encoded[2]!r:.60}", field="coordinates", code="InvalidQuery"
            ) from error
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
