"""Planned walks as GeoJSON (RFC 7946) and as GPX 1.1."""

import json
from datetime import timedelta
from typing import Any
from xml.etree import ElementTree as ET  # written only, never parsed

import numpy as np
from jaxtyping import Float

from sidestep.network.geodesy import metres_between
from sidestep.routing.directions import Leg, directions
from sidestep.routing.plan import Journey
from sidestep.routing.serialise import JourneyJson, itinerary

_GPX = "http://www.topografix.com/GPX/1/1"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_NEVER = "\ufffe\uffff"  # no characters, says XML
_ODBL = "https://opendatacommons.org/licenses/odbl/1-0/"
_ROUTE_MEMBERS = (
    "scenario", "objective", "planner", "level", "departure", "departs", "metres", "expected_minutes", "arrives",
    "mean_density", "exposure", "too_dense", "crowding", "futures", "median_minutes", "p90_minutes", "arrival_rate",
    "by_minutes", "arrive_by", "others",
)  # fmt: skip


def route_geojson(journey: Journey, by: float | None = None) -> str:
    """A feature for the whole route, one for each street, and a point for each end."""
    said = itinerary(journey, by)
    members = {name: said[name] for name in _ROUTE_MEMBERS}  # type: ignore[literal-required]
    origin, destination = journey.trip.origin, journey.trip.destination
    features = [
        _feature("LineString", _degrees(journey.course), {"part": "route", **members, "steps": said["steps"]}),
        *(_feature("LineString", _degrees(leg.course), {"part": "leg", **_leg_members(leg)}) for leg in journey.legs),
        _feature("Point", _degrees(journey.course[0]), {"part": "origin", "asked": origin.text}),
        _feature(
            "Point", _degrees(np.array(destination.place[::-1])), {"part": "destination", "asked": destination.text}
        ),
    ]
    whole = {
        "type": "FeatureCollection",
        "attribution": said["attribution"],
        "crowds": said["crowds"],
        "features": features,
    }
    return json.dumps(whole, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def _leg_members(leg: Leg) -> dict[str, object]:
    return {
        "street": leg.label,
        "metres": round(leg.metres, 2),
        "minutes": round(leg.minutes, 3),
        "density": round(leg.density, 4),
    }


def _feature(kind: str, coordinates: list[Any], members: dict[str, object]) -> dict[str, object]:
    return {"type": "Feature", "properties": members, "geometry": {"type": kind, "coordinates": coordinates}}


def _degrees(points: Float[np.ndarray, "*point 2"]) -> list[Any]:
    """Longitude and latitude to about a centimetre."""
    return np.round(points, 7).tolist()


def route_gpx(journey: Journey, by: float | None = None) -> str:
    """A route of the turns, and a track of the whole course.

    GPX wants UTC, but counts are in local wall time of no given zone: times are written without one. Where no day was
    given there are none.
    """
    said = itinerary(journey, by)
    ET.register_namespace("", _GPX)
    gpx = ET.Element(
        "gpx",
        {
            "xmlns": _GPX,
            "xmlns:xsi": _XSI,
            "xsi:schemaLocation": f"{_GPX} {_GPX}/gpx.xsd",
            "version": "1.1",
            "creator": "Sidestep",
        },
    )
    name = f"{said['origin']['asked']} to {said['destination']['asked']}"
    _metadata(gpx, journey, said, name)
    route = _add(gpx, "rte")
    _add(route, "name", name)
    walked = 0.0
    for step in directions(journey.legs):
        about = f"{step.metres:.0f} m, {step.minutes:.1f} min"
        _point(route, journey, "rtept", step.legs[0].course[0], walked, f"{step.turn}: {step.street}", about)
        walked += step.minutes
    _point(route, journey, "rtept", journey.legs[-1].course[-1], walked, "arrive" if journey.route.arrived else "end")
    track = _add(gpx, "trk")
    _add(track, "name", name)
    segment = _add(track, "trkseg")
    for number, leg in enumerate(journey.legs):
        shares = _shares(leg.course)
        for place, share in list(zip(leg.course, shares, strict=True))[number > 0 :]:
            _point(segment, journey, "trkpt", place, leg.entered + share * leg.minutes)
    ET.indent(gpx)
    return "<?xml version='1.0' encoding='UTF-8'?>\n" + ET.tostring(gpx, encoding="unicode") + "\n"


def _metadata(gpx: ET.Element, journey: Journey, said: JourneyJson, name: str) -> None:
    """In the order that the schema prescribes."""
    metadata = _add(gpx, "metadata")
    _add(metadata, "name", name)
    zone = "" if said["departure"] is None else " Times are local wall time."
    about = (
        f"{said['planner']}, departing {said['departs']}: {said['metres']:,.0f} m, {said['expected_minutes']:.1f} min"
    )
    likely = ""
    if said["arrive_by"] is not None:
        likely = f" Arrives within {said['by_minutes']:g} min with probability {said['arrive_by']:.2f}."
    _add(metadata, "desc", f"{about} if crowds are as expected.{likely} Crowds: {said['crowds']}.{zone}")
    copyright_ = _add(metadata, "copyright")
    copyright_.set("author", said["attribution"])
    if "ODbL" in said["attribution"]:
        _add(copyright_, "license", _ODBL)
    time = journey.trip.departure.time
    if time is not None:
        _add(metadata, "time", time.isoformat(timespec="seconds"))
    (west, south), (east, north) = journey.course.min(axis=0), journey.course.max(axis=0)
    corners = {"minlat": south, "minlon": west, "maxlat": north, "maxlon": east}
    _add(metadata, "bounds").attrib.update({corner: f"{value:.7f}" for corner, value in corners.items()})


def _point(
    parent: ET.Element,
    journey: Journey,
    tag: str,
    place: Float[np.ndarray, "2"],
    minutes: float,
    name: str = "",
    about: str = "",
) -> None:
    longitude, latitude = place
    point = _add(parent, tag)
    point.attrib.update(lat=f"{latitude:.7f}", lon=f"{longitude:.7f}")
    departure = journey.trip.departure.time
    if departure is not None:
        _add(point, "time", (departure + timedelta(minutes=minutes)).isoformat(timespec="seconds"))
    for tag_, text in (("name", name), ("desc", about)):
        if text:
            _add(point, tag_, text)


def _add(parent: ET.Element, tag: str, text: str | None = None) -> ET.Element:
    child = ET.SubElement(parent, tag)
    child.text = None if text is None else _printable(text)
    return child


def _printable(text: str) -> str:
    """Without what XML cannot hold: names of streets come from files."""
    return "".join(
        letter for letter in text if letter >= " " and not ("\ud800" <= letter <= "\udfff" or letter in _NEVER)
    )


def _shares(course: Float[np.ndarray, "point 2"]) -> list[float]:
    """Which part of a course's length lies before each of its points."""
    along = np.append(0.0, metres_between(course[:-1], course[1:]).cumsum())
    shares: list[float] = (along / max(float(along[-1]), 1e-12)).tolist()
    return shares
