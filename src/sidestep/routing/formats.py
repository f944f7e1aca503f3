"""Plans as JSON, text, GeoJSON (RFC 7946) and GPX 1.1; the last three are made from the first."""

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any, TypedDict
from xml.etree import ElementTree as ET  # written only, never parsed

import numpy as np
from jaxtyping import Float

from sidestep.network.town import metres_between
from sidestep.routing.directions import LegJson, StepJson
from sidestep.routing.request import NO_COORDINATES, EndJson, RouteError
from sidestep.scenarios.objectives import objective_in_words

GeoJson = dict[str, Any]
_GPX = "http://www.topografix.com/GPX/1/1"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_NEVER = "\ufffe\uffff"  # no characters, says XML
_NOT_OF_ROUTES = {"origin", "destination", "legs", "nodes", "minutes", "attribution", "crowds", "synthetic"}
_ODBL = "https://opendatacommons.org/licenses/odbl/1-0/"


class WalksJson(TypedDict):
    """The walks of one planner through simulated futures."""

    level: str
    """What the planner knows."""
    futures: int
    median_minutes: float
    p90_minutes: float
    arrival_rate: float


class BaselineJson(WalksJson):
    """Another planner in the same futures, or in the first of them."""

    mean_difference_minutes: float
    """Above zero where it takes longer than the plan."""
    mean_difference_exposure: float | None
    """Above zero where it meets more people, person·s/m²; None where time is all that counts."""


class PlanJson(WalksJson):
    """A planned route."""

    scenario: str
    objective: dict[str, float | None] | None
    """Weights of what is kept low; None: time."""
    planner: str
    departure: str | None
    """Local time, ISO 8601; None where no day was given."""
    departure_minutes: float
    """After the scenario's start; in towns this is the departure."""
    departs: str
    """The departure for people."""
    hour_of_week: float | None
    """0 is Monday 0:00; None where crowds do not depend on it."""
    counted_sensors: int | None
    """With current counts; None where none were given."""
    sensors: int | None
    """None where crowds are not known from sensors."""
    origin: EndJson
    destination: EndJson
    steps: list[StepJson] | None
    """None on grids."""
    legs: list[LegJson]
    nodes: list[int]
    minutes: list[float]
    """After the departure, at which each node is reached if crowds are as expected."""
    metres: float
    expected_minutes: float
    arrives: bool
    mean_density: float
    """Persons/m², averaged over the time."""
    exposure: float
    """Crowd met, person·s/m²."""
    too_dense: int
    """Streets entered above the objective's maximum density."""
    crowding: str
    by_minutes: float | None
    arrive_by: float | None
    """Share of the futures in which the walk arrives within ``by_minutes``."""
    baselines: dict[str, BaselineJson]
    attribution: str
    """Of the streets."""
    crowds: str
    """Their source."""
    expected_crowds: str
    """The crowds that are expected, after "Crowds are …"."""
    synthetic: str
    """What is invented, and by how much."""


def crowds_in_words(plan: PlanJson) -> str:
    """The source of the crowds, and what is invented of them."""
    return "; ".join(filter(None, (plan["crowds"], plan["synthetic"])))


# --- Text -----------------------------------------------------------------------------------------------------------


def text(plan: PlanJson) -> str:
    """Directions and times for people, one line each."""
    low = "" if plan["objective"] is None else f", keeping low {objective_in_words(plan['objective'])}"
    lines = [f"{plan['planner']} ({plan['level']}), departing {plan['departs']}{low}, if crowds are as expected:"]
    lines += [
        f"{end['asked']} is {end['metres_away']:,.0f} m from the street"
        for end in (plan["origin"], plan["destination"])
        if end["metres_away"] >= 1
    ]
    lines += _table(_node_rows(plan) if plan["steps"] is None else _step_rows(plan["steps"], plan["arrives"]))
    missed = "" if plan["arrives"] else " without arriving"
    lines.append(
        f"{plan['metres']:,.0f} m, {plan['expected_minutes']:.1f} min{missed}; crowds on the way: {plan['crowding']}, "
        f"{plan['mean_density']:.2f} persons/m², {plan['exposure']:,.0f} person·s/m² met"
    )
    if plan["too_dense"]:
        lines.append(f"{plan['too_dense']} of its streets are entered above the density that nobody should enter.")
    several = "s" * (plan["futures"] > 1)
    lines.append(f"In {plan['futures']} simulated future{several}: {_quantiles(plan)}")
    if plan["arrive_by"] is not None:
        lines.append(f"Arrives within {plan['by_minutes']:g} min with probability {plan['arrive_by']:.2f}")
    lines += [_baseline(name, baseline, plan["futures"]) for name, baseline in plan["baselines"].items()]
    lines += ["", f"Crowds are {plan['expected_crowds']}."]
    lines.append(f"Streets: {plan['attribution']}. Crowds: {crowds_in_words(plan)}.")
    return "\n".join(lines) + "\n"


def _quantiles(walks: WalksJson) -> str:
    return (
        f"median {walks['median_minutes']:.1f} min, 90 % within {walks['p90_minutes']:.1f} min, "
        f"{100 * walks['arrival_rate']:.1f} % arrive"
    )


def _baseline(name: str, baseline: BaselineJson, futures: int) -> str:
    which = "the same futures" if baseline["futures"] == futures else f"the first {baseline['futures']} of them"
    more, met = baseline["mean_difference_minutes"], baseline["mean_difference_exposure"]
    crowd = "" if met is None else f", {abs(met):,.0f} person·s/m² {'more' if met >= 0 else 'less'} met"
    return (
        f"{name} in {which}: {_quantiles(baseline)}; "
        f"on average {abs(more):.1f} min {'longer' if more >= 0 else 'shorter'}{crowd}"
    )


def _node_rows(plan: PlanJson) -> list[tuple[str, ...]]:
    reached = zip(plan["nodes"], plan["minutes"], strict=True)
    return [(">node", ">minutes"), *((str(node), f"{minutes:.1f}") for node, minutes in reached)]


def _step_rows(steps: Sequence[StepJson], arrives: bool) -> list[tuple[str, ...]]:
    rows = [
        (
            step["turn"],
            step["street"],
            f"{step['metres']:,.0f}",
            f"{step['minutes']:.1f}",
            step["crowding"],
            f"{step['density']:.2f}",
        )
        for step in steps
    ]
    end = [("arrive", "", "", "", "", "")] if arrives else []
    return [("", "street", ">metres", ">minutes", "crowds", ">persons/m²"), *rows, *end]


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Aligned columns between empty lines; those whose heading begins with > hold numbers."""
    columns = []
    for heading, *cells in zip(*rows, strict=True):
        column = [heading.removeprefix(">"), *cells]
        width = max(map(len, column))
        columns.append([cell.rjust(width) if heading[:1] == ">" else cell.ljust(width) for cell in column])
    return ["", *("  ".join(row).rstrip() for row in zip(*columns, strict=True)), ""]


# --- GeoJSON --------------------------------------------------------------------------------------------------------


def geojson(plan: PlanJson) -> GeoJson:
    """A feature for the whole route, one for each leg, and a point for each end."""
    course = course_of(plan)
    whole = {key: value for key, value in plan.items() if key not in _NOT_OF_ROUTES}
    legs = [_feature("LineString", leg["coordinates"], {"part": "leg", **_leg_members(leg)}) for leg in plan["legs"]]
    ends = [
        _feature("Point", np.round([end["longitude"], end["latitude"]], 7), {"part": part, "asked": end["asked"]})
        for part, end in (("origin", plan["origin"]), ("destination", plan["destination"]))
    ]
    return {
        "type": "FeatureCollection",
        "attribution": plan["attribution"],
        "crowds": plan["crowds"],
        "synthetic": plan["synthetic"],
        "features": [_feature("LineString", course, {"part": "route", **whole}), *legs, *ends],
    }


def _leg_members(leg: LegJson) -> dict[str, object]:
    return {
        "street": leg["label"],
        "metres": round(leg["metres"], 2),
        "minutes": round(leg["minutes"], 3),
        "density": round(leg["density"], 4),
    }


def _feature(kind: str, coordinates: Any, members: dict[str, object]) -> dict[str, object]:
    points = np.asarray(coordinates).tolist()
    return {"type": "Feature", "properties": members, "geometry": {"type": kind, "coordinates": points}}


def course_of(plan: PlanJson) -> Float[np.ndarray, "point 2"]:
    """Longitude and latitude along all legs; points at which two of them meet come once.

    Raises
    ------
    RouteError
        On grids.
    """
    points = [point for number, leg in enumerate(plan["legs"]) for point in (leg["coordinates"] or [])[number > 0 :]]
    if not points:
        raise RouteError(NO_COORDINATES, field="format")
    return np.array(points)


# --- GPX ------------------------------------------------------------------------------------------------------------


def gpx(plan: PlanJson) -> str:
    """A route of the turns, and a track of the whole course."""
    course = course_of(plan)
    ET.register_namespace("", _GPX)
    root = ET.Element(
        "gpx",
        {
            "xmlns": _GPX,
            "xmlns:xsi": _XSI,
            "xsi:schemaLocation": f"{_GPX} {_GPX}/gpx.xsd",
            "version": "1.1",
            "creator": "Sidestep",
        },
    )
    name = f"{plan['origin']['asked']} to {plan['destination']['asked']}"
    _metadata(root, plan, name, course)
    route = _add(root, "rte")
    _add(route, "name", name)
    for step in plan["steps"] or []:
        at, about = step["first_leg"], f"{step['metres']:.0f} m, {step['minutes']:.1f} min"
        place = _points(plan["legs"][at])[0]
        _point(route, plan, "rtept", place, plan["minutes"][at], f"{step['turn']}: {step['street']}", about)
    _point(route, plan, "rtept", course[-1], plan["minutes"][-1], "arrive" if plan["arrives"] else "end")
    track = _add(root, "trk")
    _add(track, "name", name)
    segment = _add(track, "trkseg")
    for number, (leg, entered) in enumerate(zip(plan["legs"], plan["minutes"], strict=False)):
        points = _points(leg)
        for place, share in list(zip(points, _shares(points), strict=True))[number > 0 :]:
            _point(segment, plan, "trkpt", place, entered + share * leg["minutes"])
    ET.indent(root)
    return "<?xml version='1.0' encoding='UTF-8'?>\n" + ET.tostring(root, encoding="unicode") + "\n"


def _points(leg: LegJson) -> Float[np.ndarray, "point 2"]:
    return np.array(leg["coordinates"])


def _metadata(root: ET.Element, plan: PlanJson, name: str, course: Float[np.ndarray, "point 2"]) -> None:
    """In the order that the schema prescribes."""
    metadata = _add(root, "metadata")
    _add(metadata, "name", name)
    about = (
        f"{plan['planner']}, departing {plan['departs']}: {plan['metres']:,.0f} m, {plan['expected_minutes']:.1f} min"
        " if crowds are as expected."
    )
    if plan["arrive_by"] is not None:
        about += f" Arrives within {plan['by_minutes']:g} min with probability {plan['arrive_by']:.2f}."
    zone = "" if plan["departure"] is None else " Times are local wall time."
    _add(metadata, "desc", f"{about} Crowds: {crowds_in_words(plan)}.{zone}")
    copyright_ = _add(metadata, "copyright")
    copyright_.set("author", plan["attribution"])
    if "ODbL" in plan["attribution"]:
        _add(copyright_, "license", _ODBL)
    _add_time(metadata, plan, 0.0)
    (west, south), (east, north) = course.min(axis=0), course.max(axis=0)
    corners = {"minlat": south, "minlon": west, "maxlat": north, "maxlon": east}
    _add(metadata, "bounds").attrib.update({corner: f"{value:.7f}" for corner, value in corners.items()})


def _point(
    parent: ET.Element,
    plan: PlanJson,
    tag: str,
    place: Float[np.ndarray, "2"],
    minutes: float,
    name: str = "",
    about: str = "",
) -> None:
    longitude, latitude = place
    point = _add(parent, tag)
    point.attrib.update(lat=f"{latitude:.7f}", lon=f"{longitude:.7f}")
    _add_time(point, plan, minutes)
    for inner, words in (("name", name), ("desc", about)):
        if words:
            _add(point, inner, words)


def _add_time(parent: ET.Element, plan: PlanJson, minutes: float) -> None:
    """The local time so many minutes after the departure, where its day is known."""
    if plan["departure"] is not None:
        time = datetime.fromisoformat(plan["departure"]) + timedelta(minutes=minutes)
        _add(parent, "time", time.isoformat(timespec="seconds"))


def _add(parent: ET.Element, tag: str, words: str | None = None) -> ET.Element:
    child = ET.SubElement(parent, tag)
    child.text = None if words is None else _printable(words)
    return child


def _printable(words: str) -> str:
    """Without the characters that XML cannot hold: names of streets come from files."""
    return "".join(
        letter for letter in words if letter >= " " and not ("\ud800" <= letter <= "\udfff" or letter in _NEVER)
    )


def _shares(course: Float[np.ndarray, "point 2"]) -> list[float]:
    """Share of a course's length before each of its points."""
    along = np.append(0.0, metres_between(course[:-1], course[1:]).cumsum())
    shares: list[float] = (along / max(float(along[-1]), 1e-12)).tolist()
    return shares
