"""What the OpenAPI document says of answers. The tests hold the answers to it."""

from typing import Any

Shape = dict[str, Any]
Answers = dict[int | str, dict[str, Any]]
"""By status, as the paths' parameter ``responses``."""


def _object(required: Shape, **more: Shape) -> Shape:
    """An object with members that are always there, and others."""
    return {"type": "object", "properties": {**required, **more}, "required": list(required)}


def _list(items: Shape, **more: Any) -> Shape:
    return {"type": "array", "items": items, **more}


def _or_null(kind: str) -> Shape:
    return {"type": [kind, "null"]}


TEXT: Shape = {"type": "string"}
NUMBER: Shape = {"type": "number"}
COUNT: Shape = {"type": "integer", "minimum": 0}
AMOUNT: Shape = {"type": "number", "minimum": 0}
FLAG: Shape = {"type": "boolean"}
PLACE = _list(NUMBER, minItems=2, maxItems=2, description="Longitude and latitude.")
TIME: Shape = {"type": "string", "description": "ISO 8601."}


def _word(*words: str) -> Shape:
    return {"type": "string", "enum": list(words)}


def answers(said: str, schema: Shape, media_type: str = "application/json") -> Answers:
    """What a path says of its answer.

    Parameters
    ----------
    said
        In words.
    schema, media_type
        JSON schema, and type of the body.

    Returns
    -------
    dict
        For the parameter ``responses`` of a path.
    """
    return {200: {"description": said, "content": {media_type: {"schema": schema}}}}


def _problems(media_type: str, schema: Shape) -> Answers:
    content = {"content": {media_type: {"schema": schema}}}
    return {
        "4XX": {"description": "The request is refused, and why.", **content},
        "5XX": {"description": "It cannot be answered now.", **content},
    }


PROBLEMS = _problems(
    "application/problem+json",
    _object({"type": TEXT, "title": TEXT, "status": COUNT, "detail": TEXT, "field": _or_null("string")}),
)
"""Problem details (RFC 9457); ``field`` is the parameter at fault."""
OSRM_PROBLEMS = _problems("application/json", _object({"code": TEXT, "message": TEXT}))
"""OSRM's errors."""

OK = _word("Ok")
WAYPOINT = _object({"location": PLACE, "name": TEXT, "distance": AMOUNT}, hint=TEXT, waypoint_index=COUNT)
LINE: Shape = {"anyOf": [TEXT, _object({"type": _word("LineString"), "coordinates": _list(PLACE)})]}
MANEUVER = _object(
    {"type": TEXT, "modifier": TEXT, "location": PLACE, "bearing_before": COUNT, "bearing_after": COUNT},
    instruction=TEXT,
)
STEP = _object(
    {
        "geometry": LINE,
        "maneuver": MANEUVER,
        "mode": TEXT,
        "name": TEXT,
        "intersections": _list(_object({"location": PLACE})),
        "weight": AMOUNT,
        "duration": AMOUNT,
        "distance": AMOUNT,
    }
)
LEG = _object(
    {"steps": _list(STEP), "summary": TEXT, "weight": AMOUNT, "duration": AMOUNT, "distance": AMOUNT},
    annotation={"type": "object"},
)
ROUTE = _object(
    {
        "legs": _list(LEG),
        "weight_name": TEXT,
        "weight": NUMBER,
        "duration": AMOUNT,
        "distance": AMOUNT,
        "planner": TEXT,
        "people_met": {**AMOUNT, "description": "Persons met, person·s/m²."},
    },
    geometry=LINE,
    departure=TIME,
    p50={**AMOUNT, "description": "Seconds within which half of the simulated walks arrive."},
    p90={**AMOUNT, "description": "Seconds within which 90 % of them arrive."},
    shared={**AMOUNT, "description": "Share of an alternative that is in better routes, too."},
)
_CELLS = _list(_list(_or_null("number")))

ROUTES = answers("Routes, the best first.", _object({"code": OK, "routes": _list(ROUTE)}, waypoints=_list(WAYPOINT)))
TABLES = answers(
    "Seconds and metres, row by row; null where no path leads.",
    _object(
        {"code": OK},
        durations=_CELLS,
        distances=_CELLS,
        sources=_list(WAYPOINT),
        destinations=_list(WAYPOINT),
        fallback_speed_cells=_list(_list(COUNT)),
    ),
)
NEAREST = answers("The nearest streets.", _object({"code": OK, "waypoints": _list(WAYPOINT)}))


def features(said: str, geometry: Shape, properties: Shape, **more: Shape) -> Answers:
    """What a path says of its answer in GeoJSON.

    Parameters
    ----------
    said
        In words.
    geometry, properties
        JSON schemas of those of each feature.
    **more
        Those of other members of the collection.

    Returns
    -------
    dict
        For the parameter ``responses`` of a path.
    """
    each = _object({"type": _word("Feature"), "geometry": geometry, "properties": properties})
    whole = _object({"type": _word("FeatureCollection"), "features": _list(each)}, **more)
    return answers(said, whole, "application/geo+json")


def _geometry(*kinds: str) -> Shape:
    return _object({"type": _word(*kinds), "coordinates": _list({})})


_STREET: Shape = {"street": COUNT, "name": TEXT, "kind": TEXT, "metres": AMOUNT}
_CROWD: Shape = {"density": {**AMOUNT, "description": "Persons/m²."}, "crowding": TEXT}

STREETS = features("All streets.", _geometry("LineString"), _object(_STREET)) | {304: {"description": "As before."}}
CROWDS = features("All streets with their crowds.", _geometry("LineString"), _object({**_STREET, **_CROWD}))
CROWDS[200]["content"]["application/json"] = {"schema": _object({"density": _list(AMOUNT)}, at=_or_null("string"))}
ISOCHRONE = features("Areas that are reached.", {"type": ["object", "null"]}, {"type": "object"})
SENSORS = features(
    "Sensors.",
    _geometry("Point"),
    _object({"sensor": TEXT, "count": _or_null("number"), "counted_from": _or_null("string"), "expected": NUMBER}),
)
WHEN = answers(
    "Departures, the earliest first.",
    _object(
        {
            "departures": _list(
                _object(
                    {"departs": TEXT, "median_minutes": AMOUNT, "p90_minutes": AMOUNT, "expected_minutes": AMOUNT},
                    on_time=_or_null("number"),
                )
            )
        },
        planner=TEXT,
    ),
)
FOUND = answers(
    "Streets, the best match first.",
    _list(_object({"name": TEXT, "longitude": NUMBER, "latitude": NUMBER, "metres": AMOUNT, "streets": _list(COUNT)})),
)
TOWN = answers(
    "The town.",
    _object(
        {
            "scenario": TEXT,
            "summary": TEXT,
            "bounds": _list(NUMBER, minItems=4, maxItems=4, description="West, south, east, north."),
            "attribution": _or_null("string"),
            "crowds": _or_null("string"),
            "synthetic": _or_null("string"),
            "timezone": _or_null("string"),
            "timed": {"type": "boolean", "description": "Whether crowds depend on the time of day."},
            "planners": _list(TEXT),
            "walkers": _list(TEXT),
            "objectives": _list(TEXT),
            "crowding": _list(_object({"word": TEXT, "limit": _or_null("number")})),
            "horizon_minutes": NUMBER,
            "sensors": COUNT,
            "streets": COUNT,
            "version": TEXT,
        }
    ),
)
WALK = answers(
    "How the walk goes on.",
    _object(
        {
            "id": TEXT,
            "next": {"anyOf": [_object({"name": TEXT, "distance": AMOUNT, "location": PLACE}), {"type": "null"}]},
            "arrival": _or_null("string"),
            "p50": AMOUNT,
            "p90": AMOUNT,
            "changed": FLAG,
            "why": _or_null("string"),
            "arrived": FLAG,
            "seen": FLAG,
            "left_route": FLAG,
            "crowd_ahead": {"type": ["object", "null"]},
            "route": {"anyOf": [ROUTE, {"type": "null"}]},
            "expires": TIME,
        }
    ),
)
CLOCK = answers("The clock.", _object({"now": TIME, "speed": NUMBER, "simulated": FLAG, "hour_of_week": AMOUNT}))
HEALTH = answers("It answers.", _object({"status": TEXT}))
READY = answers("It is ready.", _object({"status": TEXT, "prepared": FLAG}))
METRICS = answers("The numbers.", TEXT, "text/plain")

COUNTED = answers(
    "What became of the counts.",
    _object(dict.fromkeys(("accepted", "new", "unchanged", "corrected", "late"), COUNT)),
)
_COUNT = _object(
    {"sensor": TEXT, "time": TIME},
    seconds={"type": "number", "minimum": 60, "maximum": 3600},
    count=AMOUNT,
    towards=AMOUNT,
    away=AMOUNT,
)
COUNTS: Any = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {"schema": {"anyOf": [_COUNT, _list(_COUNT, minItems=1), {"type": "object"}]}},
            "text/csv": {"schema": {**TEXT, "description": "A header, then a row for each sensor and interval."}},
            "application/ld+json": {"schema": {"anyOf": [{"type": "object"}, _list({"type": "object"})]}},
        },
    }
}
"""What may be posted; docs/live-counts.md has all of it."""
