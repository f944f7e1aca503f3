"""Which OpenStreetMap files are read, and what the reader does not know of XML: editors' deletes, and members' courses.

Editors mark what is to be deleted by ``action='delete'``. Overpass puts the courses of ways into the relations that
have them as members (``out geom``), where they stand alone if nobody asked for the ways, and centres into ways (``out
center``). Files with any of these are rewritten for the reader, in memory; others are only looked through.
"""

import bz2
import gzip
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from sidestep.errors import SidestepError
from sidestep.files import LARGEST

FORMATS = {".osm": "osm", ".osm.gz": "osm.gz", ".osm.bz2": "osm.bz2", ".osm.pbf": "pbf", ".pbf": "pbf"}
"""The reader's name of the format that each ending of a file name stands for."""

_CHANGES = "which says what changed and not what there is; apply it to an extract first, as osmium apply-changes does"
_NO_EXTRACTS = {
    b"osmChange": f"it is a change file (osmChange), {_CHANGES}",
    b"osmAugmentedDiff": f"it is an augmented diff, {_CHANGES}",
    b"gpx": "it is GPX, which holds tracks and no streets",
    b"kml": "it is KML and not OpenStreetMap's XML",
    b"html": "it is a web page and not OpenStreetMap's XML",
    b"graphml": "it is GraphML; name it .graphml and load it as it is",
}
_JSON = "it is JSON and not OpenStreetMap's XML; ask Overpass for [out:xml], or convert it"
_PACKINGS = {b"\x1f\x8b": "osm.gz", b"BZ": "osm.bz2"}
_ZIP, _PBF = b"PK\x03\x04", b"OSMHeader"
_BLANK = b"\xef\xbb\xbf \t\r\n"  # a byte-order mark, too
_ROOT = re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:(?:<\?.*?\?>|<!--.*?-->|<![^>]*>)\s*)*<([A-Za-z]+)", re.DOTALL)
_ATTRIBUTES = rb"""((?:[^<>"'/]|"[^"]*"|'[^']*'|/(?!>))*)"""
_DELETED = re.compile(rb"\baction\s*=\s*([\"'])delete\1")
_VISIBLE = re.compile(rb"\bvisible\s*=\s*(?:\"[^\"]*\"|'[^']*')")
_THING = re.compile(rb"<(node|way|relation)\b" + _ATTRIBUTES)
_MEMBER = re.compile(rb"<member\b" + _ATTRIBUTES + rb">(.*?)</member\s*>", re.DOTALL)
_UNFINISHED = re.compile(rb"<remark>\s*(runtime error[^<]*)", re.IGNORECASE)
_WAY = re.compile(rb"<way\b[^>]*?\bid\s*=\s*[\"'](-?\d+)")
_OF_WAY = re.compile(rb"\btype\s*=\s*[\"']way[\"']")
_POINT = re.compile(rb"<(?:nd|node)\b" + _ATTRIBUTES)
_NUMBERS = {
    key: re.compile(rb"\b" + name + rb"\s*=\s*[\"']([-+.\deE]+)[\"']")
    for key, name in (("ref", rb"(?:ref|id)"), ("lat", rb"lat"), ("lon", rb"lon"))
}
_CENTRE = re.compile(rb"<center\b" + _ATTRIBUTES + rb"/>")
_UNKNOWN = re.compile(rb"\baction\s*=\s*[\"']delete|</member\b|<action\b|<center\b")
_HINTS = (b"action", b"</member", b"<center")  # quicker to look for
_PIECE = 2**22  # bytes looked through at once
_OVERLAP = 2**12  # bytes; longer than any element's beginning


class OsmError(SidestepError):
    """An unusable OpenStreetMap file or import option; ``line`` is known for damaged XML, ``field`` for options."""


def file_format(path: Path) -> str:
    """Tell the format of a file by its name.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        The reader's name of the format.

    Raises
    ------
    OsmError
        Another ending.
    """
    name = path.name.lower()
    if name.endswith((".osc", ".osc.gz", ".osc.bz2")):
        raise OsmError(f"{path}: {_NO_EXTRACTS[b'osmChange']}")
    formats = [found for suffix, found in FORMATS.items() if name.endswith(suffix)]
    if not formats:
        raise OsmError(f"{path} is not named like an OpenStreetMap file; its name must end in {', '.join(FORMATS)}")
    return formats[0]


def packed_format(named: str, begins: bytes) -> str:
    """Tell the format of a file by how it begins, since files lose their endings.

    Parameters
    ----------
    named
        Its format by its name.
    begins
        Its first bytes.

    Returns
    -------
    str
        The reader's name of the format.

    Raises
    ------
    OsmError
        A zip archive.
    """
    if begins.startswith(_ZIP):
        raise OsmError("it is a zip archive; unpack it first")
    if _PBF in begins:
        return "pbf"
    if begins[:2] in _PACKINGS:
        return _PACKINGS[begins[:2]]
    return "osm" if named != "pbf" or begins.lstrip(_BLANK).startswith(b"<") else "pbf"


def rewritten_xml(path: Path) -> bytes | None:
    """Look through an XML file, and rewrite what the reader does not know.

    Lines keep their numbers.

    Parameters
    ----------
    path
        The file, packed or not.

    Returns
    -------
    bytes or None
        XML for the reader; None for a file that it can read, or that is damaged.

    Raises
    ------
    OsmError
        A file of something else, such as changes; one that Overpass did not finish; one to be rewritten that would fill
        the memory.
    """
    unknown, end = False, b""
    try:
        for number, piece in enumerate(_pieces(path)):
            root = _ROOT.match(piece) if number == 0 else None
            if root and root[1] in _NO_EXTRACTS:
                raise OsmError(_NO_EXTRACTS[root[1]])
            if number == 0 and piece.lstrip(_BLANK)[:1] in (b"{", b"["):
                raise OsmError(_JSON)
            both, end = end + piece, piece[-_OVERLAP:]
            _check_finished(both)
            found = _UNKNOWN.search(both) if any(each in both for each in _HINTS) else None
            if found and found[0] == b"<action":
                raise OsmError(_NO_EXTRACTS[b"osmAugmentedDiff"])
            if found:
                unknown = True
                break
        return _rewritten(path) if unknown else None
    except (OSError, EOFError, zlib.error):
        return None  # the reader says what is wrong


def _pieces(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        begins = file.read(2)
    unpackers: dict[bytes, Callable[..., Any]] = {b"\x1f\x8b": gzip.open, b"BZ": bz2.open}
    unpack = unpackers.get(begins, Path.open)
    with unpack(path, "rb") as stream:
        while piece := stream.read(_PIECE):
            yield piece


def _rewritten(path: Path) -> bytes:
    parts, size = [], 0
    for piece in _pieces(path):
        parts.append(piece)
        size += len(piece)
        if size > LARGEST:
            said = f"it is XML as editors and Overpass write it, of more than {LARGEST >> 30} GiB"
            raise OsmError(f"{said}; convert it to .osm.pbf first")
    xml = b"".join(parts)
    _check_finished(xml)
    xml = _CENTRE.sub(b"", _with_members(xml))
    return _THING.sub(_deleted, _MEMBER.sub(_without_course, xml))


def _check_finished(xml: bytes) -> None:
    """Refuse what Overpass could not finish: nobody knows what is missing."""
    if b"<remark" in xml and (found := _UNFINISHED.search(xml)):
        said = " ".join(found[1].decode(errors="replace").split()).rstrip(". ")
        raise OsmError(f"it is not whole, Overpass says: {said:.200}; ask for less at once, or for more time")


def _without_course(member: re.Match[bytes]) -> bytes:
    """A member without its course; lines keep their numbers."""
    return b"<member" + member[1] + b"/>" + b"\n" * member[2].count(b"\n")


def _with_members(xml: bytes) -> bytes:
    """Add the ways whose courses stand with the relations alone; their nodes are those at the same places."""
    there, added, close = set(_WAY.findall(xml)), [], xml.rfind(b"</osm")
    courses: dict[bytes, list[bytes]] = {}
    for attributes, inside in _MEMBER.findall(xml):
        way = _NUMBERS["ref"].search(attributes)
        if way and _OF_WAY.search(attributes) and way[1] not in there:
            courses.setdefault(way[1], _POINT.findall(inside))
    if not courses or close < 0:
        return xml
    number_at = {
        place: int(number[1])
        for point in _POINT.findall(xml)
        if (number := _NUMBERS["ref"].search(point)) and (place := _place(point))
    }
    free = min([0, *number_at.values()])
    for reference, points in courses.items():
        places = [place for point in points if (place := _place(point))]
        if len(places) < len(points):
            continue  # cut where nobody asked for more
        refs = [number_at.setdefault(place, free - 1 - len(number_at)) for place in places]
        nodes = (
            f'<nd ref="{ref}" lat="{lat:.7f}" lon="{lon:.7f}"/>' for ref, (lat, lon) in zip(refs, places, strict=True)
        )
        added.append(b'<way id="' + reference + b'">' + "".join(nodes).encode() + b"</way>")
    return xml[:close] + b"".join(added) + xml[close:]


def _place(point: bytes) -> tuple[float, float] | None:
    """Latitude and longitude of a node."""
    found = [_NUMBERS[key].search(point) for key in ("lat", "lon")]
    try:
        latitude, longitude = (round(float(each[1]), 7) for each in found if each)
    except ValueError:  # raised for a missing one, too
        return None
    return latitude, longitude


def _deleted(thing: re.Match[bytes]) -> bytes:
    if _DELETED.search(thing[2]) is None:
        return thing[0]
    kept = _VISIBLE.sub(b"", _DELETED.sub(b"", thing[2]))
    return b"<" + thing[1] + b' visible="false"' + kept
