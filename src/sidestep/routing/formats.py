"""The file formats of routes: GeoJSON (RFC 7946), GPX 1.1, and plain tables."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any
from xml.etree import ElementTree as ET  # written only, never parsed

import numpy as np

from sidestep.network.geodesy import Projection, line_geometry

_GPX = "http://www.topografix.com/GPX/1/1"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_ODBL = "https://opendatacommons.org/licenses/odbl/1-0/"
_UNPRINTABLE = re.compile("[\x00-\x1f\ud800-\udfff\ufffe\uffff]")  # XML cannot hold them; street names come from files


def table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with aligned columns; those whose heading begins with > hold numbers."""
    lines = [[title.removeprefix(">") for title in heading], *rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    align = [f"{'>' if title[:1] == '>' else '<'}{width}" for title, width in zip(heading, widths, strict=True)]
    return ["  ".join(map(format, line, align)).rstrip() for line in lines]


def feature(kind: str, coordinates: Sequence[Any], /, **properties: object) -> dict[str, object]:
    """A GeoJSON feature; coordinates are longitude and latitude in degrees."""
    geometry = {"type": kind, "coordinates": coordinates} if kind != "LineString" else line_geometry(coordinates)
    return {"type": "Feature", "properties": properties, "geometry": geometry}


@dataclass(frozen=True)
class Waypoint:
    """A point of a GPX route or track."""

    place: Sequence[float]
    """Longitude and latitude, degrees."""

    minutes: float
    """After the departure."""

    name: str = ""
    about: str = ""


@dataclass(frozen=True)
class GpxRoute:
    """One of the routes of a file."""

    name: str
    about: str
    turns: list[Waypoint]
    """Points of the route."""
    track: list[Waypoint]
    """Points of the track, which is the whole course."""


def gpx(name: str, about: str, attribution: str, departure: str | None, routes: Sequence[GpxRoute]) -> str:
    """For each route one of its turns, and a track of its whole course.

    GPX wants UTC, but counts are in local wall time of no given zone: times are written without one, and left out where
    the departure has no day.

    Parameters
    ----------
    name, about
        Of the file.
    attribution
        Source and licence of the streets.
    departure
        Local time, ISO 8601; None where no day was given.
    routes
        The best one first.

    Returns
    -------
    str
        An XML document.
    """
    departs = None if departure is None else datetime.fromisoformat(departure)

    def time(minutes: float) -> str:
        return "" if departs is None else (departs + timedelta(minutes=minutes)).isoformat(timespec="seconds")

    location = {"xmlns": _GPX, "xmlns:xsi": _XSI, "xsi:schemaLocation": f"{_GPX} {_GPX}/gpx.xsd"}
    root = ET.Element("gpx", {**location, "version": "1.1", "creator": "Sidestep"})
    metadata = ET.SubElement(root, "metadata")  # its parts have an order
    _put(metadata, name=name, desc=about)
    legal = ET.SubElement(metadata, "copyright", author=_UNPRINTABLE.sub("", attribution))
    _put(legal, license=_ODBL if "ODbL" in attribution else "")
    _put(metadata, time=time(0.0))
    course = np.array([point.place for route in routes for point in route.track])
    plane = Projection.of(course)
    xy = plane.project(course)
    ends = plane.unproject(np.stack([xy.min(axis=0), xy.max(axis=0)]))[:, ::-1].ravel()
    corners = zip(("minlat", "minlon", "maxlat", "maxlon"), ends.tolist(), strict=True)
    ET.SubElement(metadata, "bounds", {corner: f"{degrees:.7f}" for corner, degrees in corners})
    parents = [(ET.SubElement(root, "rte"), "rtept", route, route.turns) for route in routes]
    parents += [(ET.SubElement(root, "trk"), "trkpt", route, route.track) for route in routes]  # after all routes
    for parent, tag, route, points in parents:
        _put(parent, name=route.name, desc=route.about)
        segment = parent if tag == "rtept" else ET.SubElement(parent, "trkseg")
        for point in points:
            child = ET.SubElement(segment, tag, lat=f"{point.place[1]:.7f}", lon=f"{point.place[0]:.7f}")
            _put(child, time=time(point.minutes), name=point.name, desc=point.about)
    ET.indent(root)
    return "<?xml version='1.0' encoding='UTF-8'?>\n" + ET.tostring(root, encoding="unicode") + "\n"


def _put(parent: ET.Element, **texts: str) -> None:
    """Add elements of text by their tags; empty ones are left out."""
    for tag, text in texts.items():
        if text:
            ET.SubElement(parent, tag).text = _UNPRINTABLE.sub("", text)
