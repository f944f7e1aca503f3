"""What OpenStreetMap's tags mean for walkers: which ways are walked, in which direction, and by whom."""

import re
from collections.abc import Mapping
from enum import IntEnum

from sidestep.network.access import NEVER, Access, Tags, access

_PATHS = {
    "bridleway": 2.0, "corridor": 3.0, "cycleway": 3.0, "elevator": 1.5, "footway": 2.0, "living_street": 5.0,
    "path": 1.5, "pedestrian": 6.0, "pier": 3.0, "platform": 3.0, "steps": 2.0, "track": 2.5,
}  # fmt: skip
_ROADS = {
    "busway": 4.0, "primary": 5.0, "primary_link": 4.0, "residential": 4.0, "secondary": 5.0, "secondary_link": 4.0,
    "service": 3.0, "tertiary": 4.0, "tertiary_link": 4.0, "trunk": 4.0, "trunk_link": 4.0, "unclassified": 3.0,
}  # fmt: skip
WIDTHS: Mapping[str, float] = {**_PATHS, **_ROADS}
"""Metres available to walkers by kind of street, where no tag gives a width.

On roads this is the width of two pavements: the carriageway is not walked, whatever its ``width`` tag says.
"""
UNKNOWN_WIDTH = 2.0
"""Metres for kinds that are not in the table; GraphML files from elsewhere have them."""
AREA = "area"
"""Kind of the streets across squares and other walkable areas, but for platforms and piers, stairs and lifts."""
KINDS = (*WIDTHS, AREA)
"""All kinds of streets that imports make; tables of ways and streets have positions in this tuple."""
FULL_WIDTH = frozenset({*_PATHS, AREA})
"""Kinds that are walked on their full width; the others are roads, walked on their pavements."""

SPECIAL = frozenset({"elevator", "steps"})
"""Kinds that not everybody can take, or not at the usual speed."""
ACROSS = frozenset({AREA, "pier", "platform"})
"""Kinds of streets across areas; on their way over one, people do not say that they change streets."""

FERRY = "ferry"
"""Kind of the ways of ferries, which are not walked."""
_LEVEL = re.compile(r"[+-]?\d", re.ASCII)
_GROUND = 10  # storey of level 0: nothing below has a number less than 1
_CYCLING = frozenset({"yes", "designated", "permissive", "official"})
_NEED_A_TAG = frozenset({"cycleway", "bridleway", "busway", "trunk", "trunk_link"})  # walked only where a tag says so
_NEED_PAVEMENT = frozenset({"primary", "primary_link", "secondary", "secondary_link", "trunk", "trunk_link"})


class CrossingKind(IntEnum):
    """What a node means to people who walk past it."""

    NONE = 0
    """No crossing of vehicle traffic."""
    UNSIGNALISED = 1
    """A crossing of vehicle traffic without signals."""
    SIGNALS = 2
    """A crossing of vehicle traffic with signals."""


def way_kind(tags: Tags) -> str | None:
    """Tell what kind of way people might walk.

    Parameters
    ----------
    tags
        Tags of the way.

    Returns
    -------
    str or None
        Its ``highway``, or "platform", "pier" or `FERRY`; None for what is no way.
    """
    if "highway" in tags:
        return tags["highway"]
    if "platform" in (tags.get("railway"), tags.get("public_transport")):
        return "platform"
    if tags.get("man_made") == "pier":
        return "pier"
    return FERRY if tags.get("route") == "ferry" else None


def right_of_way(tags: Tags, direction: str = "") -> Access:
    """Tell who may walk on a way, and when.

    Motor roads, kinds that are walked only where a tag says so, and busy roads without a pavement are open when
    ``foot`` lets people walk, and at no other time.

    Parameters
    ----------
    tags
        Tags of the way, with its kind as ``highway``.
    direction
        "forward" or "backward" for one direction, as it is drawn.

    Returns
    -------
    Access
        What the tags say.
    """
    return access(tags, direction, by_foot=_why_by_foot(tags) is not None)


def _why_by_foot(tags: Tags) -> str | None:
    """Why a way is closed unless ``foot`` lets people walk, as reports have it; None for others."""
    kind, sides = tags["highway"], pavements(tags)
    reasons = (
        ("way: motor road", tags.get("motorroad") == "yes"),
        ("way: not tagged as walkable", kind in _NEED_A_TAG and "yes" not in sides),
        ("way: no pavement", kind in _NEED_PAVEMENT and sides == ("no", "no")),
    )
    return next((reason for reason, applies in reasons if applies), None)


def exclusion_reason(tags: Tags) -> str | None:
    """Tell why a way is not walked.

    A road whose pavements are mapped as separate ways (``sidewalk=separate``) is excluded, or walkers would have three
    parallel streets to choose from.

    Parameters
    ----------
    tags
        Tags of the way, with its kind as ``highway``.

    Returns
    -------
    str or None
        The reason, as reports have it; None for a way that is walked.
    """
    kind, foot, sides = tags["highway"], tags.get("foot"), pavements(tags)
    plain, rights = ([say(tags, way) for way in ("forward", "backward")] for say in (access, right_of_way))
    needs_foot = _why_by_foot(tags)
    elsewhere = "separate" in sides and set(sides) <= {"separate", "no"}
    reasons = (
        ("way: ferry", kind == FERRY),
        ("way: not a walkable kind", kind not in WIDTHS),
        ("way: pavements mapped separately", foot == "use_sidepath"),
        ("way: no access", all(right.opening == NEVER for right in plain)),
        (needs_foot or "", needs_foot is not None and all(right.opening == NEVER for right in rights)),
        ("way: pavements mapped separately", kind in _ROADS and elsewhere),
        ("way: contradicting directions", not directions(tags)),
    )
    return next((reason for reason, applies in reasons if applies), None)


def directions(tags: Tags) -> list[tuple[int, Access]]:
    """Tell in which directions a way is walked, and who may do so.

    ``oneway:foot`` counts everywhere, and escalators (``conveying``) carry people one way. ``oneway`` is about
    vehicles; it counts for walkers only on footways, steps and corridors where cycling is not allowed. So do
    ``foot:forward`` and ``foot:backward``, where they differ.

    Parameters
    ----------
    tags
        Tags of the way, with its kind as ``highway``.

    Returns
    -------
    list
        1 for as it is drawn, -1 for against that, 0 for both ways, with the access of each; none if no direction is
        left.
    """
    value = {"forward": "yes", "backward": "-1"}.get(tags.get("conveying", ""), tags.get("oneway:foot"))
    if value is None and tags["highway"] in ("footway", "steps", "corridor") and tags.get("bicycle") not in _CYCLING:
        value = tags.get("oneway")
    only = {"yes": 1, "true": 1, "1": 1, "-1": -1, "reverse": -1}.get(value or "", 0)
    forward, backward = right_of_way(tags, "forward"), right_of_way(tags, "backward")
    walked = [(1, forward)] * (only >= 0) + [(-1, backward)] * (only <= 0)
    if only == 0 and forward == backward:
        walked = [(0, forward)]
    return [(way, right) for way, right in walked if right.opening != NEVER]


def crossing_kind(tags: Tags) -> CrossingKind:
    """Tell whether a node is a crossing of vehicle traffic, and whether it has signals.

    Parameters
    ----------
    tags
        Tags of the node.

    Returns
    -------
    CrossingKind
        What it is.
    """
    crossing = tags.get("crossing", "no")
    signals = tags.get("crossing:signals") == "yes"
    if signals or "traffic_signals" in (crossing, tags.get("highway")):
        return CrossingKind.SIGNALS
    return CrossingKind(tags.get("highway") == "crossing" or crossing != "no")


def pavements(tags: Tags) -> tuple[str | None, str | None]:
    """Tell for the left and the right side: pavement (yes), no pavement (no), mapped separately, or unknown (None)."""
    known = {"yes": "yes", "no": "no", "none": "no", "separate": "separate"}
    plain = tags.get("sidewalk", "")
    either = {"left": ("yes", "no"), "right": ("no", "yes"), "both": ("yes", "yes")}
    both = known.get(tags.get("sidewalk:both", ""))
    left, right = (both or side for side in either.get(plain, (known.get(plain),) * 2))
    return known.get(tags.get("sidewalk:left", ""), left), known.get(tags.get("sidewalk:right", ""), right)


def is_area(tags: Tags, closed: bool) -> bool:
    """Tell whether a closed way is walked across, and not around.

    Parameters
    ----------
    tags
        Tags of the way, with its kind as ``highway``.
    closed
        Whether it ends where it begins.

    Returns
    -------
    bool
        Whether it is tagged as an area; platforms, piers and pedestrian squares are, unless ``area=no``.
    """
    square = tags["highway"] in ("platform", "pier") or (
        tags["highway"] == "pedestrian" and tags.get("place") == "square"
    )
    return closed and tags.get("area", "yes" if square else "no") == "yes"


def storey(tags: Tags) -> int:
    """Tell on which storey a way meets areas with which it shares no node.

    Parameters
    ----------
    tags
        Tags of the way or area.

    Returns
    -------
    int
        The same number for those on the same level or layer; -1 in tunnels, on bridges and between levels, where only
        common nodes join.
    """
    level = tags.get("level") or tags.get("layer") or "0"
    apart = any(tags.get(key, "no") != "no" for key in ("tunnel", "bridge"))
    return -1 if apart or _LEVEL.fullmatch(level) is None else _GROUND + int(level)
