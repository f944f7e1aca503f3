"""The file formats of routes: GeoJSON (RFC 7946), GPX 1.1, and plain tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any
from xml.etree import ElementTree as ET  # written only, never parsed

import numpy as np

_GPX = "http://www.topografix.com/GPX/1/1"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_NEVER = "\ufffe\uffff"  # no characters, says XML
_ODBL = "https://opendatacommons.org/licenses/odbl/1-0/"


def table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with aligned columns; those whose heading begins with > hold numbers."""
    lines = [[title.removeprefix(">") for title in heading], *rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    align = [f"{'>' if title[:1] == '>' else '<'}{width}" for title, width in zip(heading, widths, strict=True)]
    return ["  ".join(map(format, line, align)).rstrip() for line in lines]


def feature(kind: str, coordinates: Sequence[Any], **properties: object) -> dict[str, object]:
    """A GeoJSON feature; coordinates are longitude and latitude in degrees."""
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


@dataclass(frozen=True)
class Waypoint:
    """A point of a GPX route or track."""

    place: Sequence[float]
    """Longitude and latitude, degrees."""

    minutes: float
    """After the departure."""

    name: str = ""
    about: str = ""


def gpx(
    *,
    name: str,
    about: str,
    attribution: str,
    departure: datetime | None,
    turns: Sequence[Waypoint],
    track: Sequence[Waypoint],
) -> str:
    """A route of the turns, and a track of the whole course.

    GPX wants UTC, but counts are in local wall time of no given zone: times are written without one, and left out where
    the departure has no day.
    """
    ET.register_namespace("", _GPX)
    location = {"xmlns": _GPX, "xmlns:xsi": _XSI, "xsi:schemaLocation": f"{_GPX} {_GPX}/gpx.xsd"}
    root = ET.Element("gpx", {**location, "version": "1.1", "creator": "Sidestep"})
    metadata = _add(root, "metadata", name=name, desc=about)  # its parts have an order
    legal = _add(metadata, "copyright", **({"license": _ODBL} if "ODbL" in attribution else {}))
    legal.set("author", attribution)
    _put(metadata, _time(departure, 0.0))
    course = np.array([point.place for point in track])
    (west, south), (east, north) = course.min(axis=0), course.max(axis=0)
    corners = {"minlat": south, "minlon": west, "maxlat": north, "maxlon": east}
    _add(metadata, "bounds").attrib.update({corner: f"{value:.7f}" for corner, value in corners.items()})
    route = _add(root, "rte", name=name)
    segment = _add(_add(root, "trk", name=name), "trkseg")
    for parent, tag, points in ((route, "rtept", turns), (segment, "trkpt", track)):
        for point in points:
            said = {"name": point.name, "desc": point.about}
            child = _add(parent, tag, **_time(departure, point.minutes), **{tag: it for tag, it in said.items() if it})
            child.attrib.update(lat=f"{point.place[1]:.7f}", lon=f"{point.place[0]:.7f}")
    ET.indent(root)
    return "<?xml version='1.0' encoding='UTF-8'?>\n" + ET.tostring(root, encoding="unicode") + "\n"


def _time(departure: datetime | None, minutes: float) -> dict[str, str]:
    if departure is None:
        return {}
    return {"time": (departure + timedelta(minutes=minutes)).isoformat(timespec="seconds")}


def _add(parent: ET.Element, tag: str, **texts: str) -> ET.Element:
    child = ET.SubElement(parent, tag)
    _put(child, texts)
    return child


def _put(parent: ET.Element, texts: dict[str, str]) -> None:
    """Elements of text in an element, by their tags."""
    for tag, text in texts.items():
        ET.SubElement(parent, tag).text = _printable(text)


def _printable(text: str) -> str:
    """Without the characters that XML cannot hold: names of streets come from files."""
    return "".join(
        letter for letter in text if letter >= " " and not ("\ud800" <= letter <= "\udfff" or letter in _NEVER)
    )
