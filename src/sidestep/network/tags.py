"""What OpenStreetMap's tags mean for walkers: which ways are walked, in which direction, and how wide they are."""

import re
from collections.abc import Mapping
from enum import IntEnum

from sidestep.errors import SidestepError

Tags = Mapping[str, str]

_PATHS = {
    "bridleway": 2.0, "corridor": 3.0, "cycleway": 3.0, "footway": 2.0, "living_street": 5.0, "path": 1.5,
    "pedestrian": 6.0, "steps": 2.0, "track": 2.5,
}  # fmt: skip
_ROADS = {
    "primary": 5.0, "primary_link": 4.0, "residential": 4.0, "secondary": 5.0, "secondary_link": 4.0, "service": 3.0,
    "tertiary": 4.0, "tertiary_link": 4.0, "trunk": 4.0, "trunk_link": 4.0, "unclassified": 3.0,
}  # fmt: skip
WIDTHS: Mapping[str, float] = {**_PATHS, **_ROADS}
"""Metres available to walkers by kind of street, where no tag gives a width.

On roads this is the width of two pavements: the carriageway is not walked, whatever its ``width`` tag says.
"""
UNKNOWN_WIDTH = 2.0
"""Metres for kinds that are not in the table; GraphML files from elsewhere have them."""
NARROWEST, WIDEST = 0.3, 100.0
"""Metres; tags beyond these are mistyped."""
FULL_WIDTH = frozenset(_PATHS)
"""Kinds that are walked on their full width; the others are roads, walked on their pavements."""

SPECIAL = frozenset({"elevator", "steps"})
"""Kinds that not everybody can take, or not at the usual speed."""

_ALLOWED = frozenset({"yes", "designated", "permissive", "official"})
_FORBIDDEN = frozenset({"no", "private"})
_NEED_A_TAG = frozenset({"cycleway", "bridleway", "trunk", "trunk_link"})  # walked only where a tag says so
_NEED_PAVEMENT = frozenset({"primary", "primary_link", "secondary", "secondary_link", "trunk", "trunk_link"})
_LENGTH = re.compile(
    r"\s*(\d+(?:[.,]\d+)?|[.,]\d+)\s*(m|metres?|meters?|ft|feet|')?\s*(?:(\d+(?:\.\d+)?)\s*\")?\s*", re.ASCII
)
_FOOT, _INCH = 0.3048, 0.0254


class WidthError(SidestepError):
    """An invalid width for a kind of street; ``field`` is ``widths`` and the kind."""


class CrossingKind(IntEnum):
    """What a node means to people who walk past it."""

    NONE = 0
    """No crossing of vehicle traffic."""
    UNSIGNALISED = 1
    """A crossing of vehicle traffic without signals."""
    SIGNALS = 2
    """A crossing of vehicle traffic with signals."""


def exclusion_reason(tags: Tags) -> str | None:
    """Tell why a way is not walked.

    ``foot`` takes precedence over ``access``. A road whose pavements are mapped as separate ways
    (``sidewalk=separate``) is excluded, or walkers would have three parallel streets to choose from.

    Parameters
    ----------
    tags
        Tags of the way, ``highway`` among them.

    Returns
    -------
    str or None
        The reason, as reports have it; None for a way that is walked.
    """
    kind, foot, sides = tags["highway"], tags.get("foot"), _sides(tags)
    allowed = foot in _ALLOWED
    elsewhere = "separate" in sides and set(sides) <= {"separate", "no"}
    reasons = (
        ("way: not a walkable kind", kind not in WIDTHS),
        ("way: pavements mapped separately", foot == "use_sidepath"),
        ("way: no access", foot in _FORBIDDEN or (tags.get("access") in _FORBIDDEN and not allowed)),
        ("way: not tagged as walkable", kind in _NEED_A_TAG and not allowed and "yes" not in sides),
        ("way: pavements mapped separately", kind in _ROADS and elsewhere),
        ("way: no pavement", kind in _NEED_PAVEMENT and not allowed and sides == ("no", "no")),
    )
    return next((reason for reason, applies in reasons if applies), None)


def direction(tags: Tags) -> int:
    """Tell in which direction a way is walked.

    ``oneway:foot`` counts everywhere, and escalators (``conveying``) carry people one way. ``oneway`` is about
    vehicles; it counts for walkers only on footways, steps and corridors where cycling is not allowed.

    Parameters
    ----------
    tags
        Tags of the way, ``highway`` among them.

    Returns
    -------
    int
        1 only as it is drawn, -1 only against that, 0 both ways.
    """
    value = {"forward": "yes", "backward": "-1"}.get(tags.get("conveying", ""), tags.get("oneway:foot"))
    if value is None and tags["highway"] in ("footway", "steps", "corridor") and tags.get("bicycle") not in _ALLOWED:
        value = tags.get("oneway")
    return {"yes": 1, "true": 1, "1": 1, "-1": -1, "reverse": -1}.get(value or "", 0)


def walkable_width(tags: Tags, table: Mapping[str, float] = WIDTHS) -> tuple[float, bool]:
    """Tell how wide a way is for walkers.

    Roads with a pavement on one side, or none, have half the table's width.

    Parameters
    ----------
    tags
        Tags of the way, ``highway`` among them.
    table
        Metres by kind of street where no tag gives a width.

    Returns
    -------
    float, bool
        Metres, and whether an unreadable width tag was ignored.
    """
    kind = tags["highway"]
    if kind in FULL_WIDTH:
        return _first_width(tags, ("width", "est_width"), table[kind])
    sides = zip(("left", "right"), _sides(tags), strict=True)
    walked = [side for side, state in sides if state not in ("no", "separate")] or ["both"]
    both = ("sidewalk:both:width", "sidewalk:width")
    widths = [_first_width(tags, (f"sidewalk:{side}:width", *both), table[kind] / 2) for side in walked]
    return sum(width for width, _ in widths), any(ignored for _, ignored in widths)


def parse_width(text: str) -> float | None:
    """Read a width.

    Parameters
    ----------
    text
        Such as "3", "3.5 m", "12'" or "10 ft".

    Returns
    -------
    float or None
        Metres; None if unreadable or not 0.3 to 100 m.
    """
    match = _LENGTH.fullmatch(text[:40].lower())
    if match is None:
        return None
    number, unit, inches = match.groups()
    feet = unit is not None and unit[0] in "f'"
    if inches is not None and not feet:
        return None
    metres = float(number.replace(",", ".")) * (_FOOT if feet else 1.0) + float(inches or 0) * _INCH
    return metres if NARROWEST <= metres <= WIDEST else None


def width_table(changes: Mapping[str, float] | None) -> dict[str, float]:
    """Change some widths of the table.

    Parameters
    ----------
    changes
        Metres by kind of street.

    Returns
    -------
    dict
        Metres for all kinds of streets that are walked.

    Raises
    ------
    WidthError
        Unknown kinds, and widths that are not 0.3 to 100 m.
    """
    for kind, width in (changes or {}).items():
        if kind not in WIDTHS:
            raise WidthError(
                f"{kind!r:.60} is not a kind of street whose width can be set; the kinds are {', '.join(WIDTHS)}",
                field="widths",
            )
        if not NARROWEST <= width <= WIDEST:
            raise WidthError(
                f"the width of {kind} must be {NARROWEST} to {WIDEST:g} m, not {width}", field=f"widths.{kind}"
            )
    return {**WIDTHS, **(changes or {})}


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


def _first_width(tags: Tags, keys: tuple[str, ...], default: float) -> tuple[float, bool]:
    """Give the first readable width among some tags, and whether any of them is unreadable."""
    given = [parse_width(tags[key]) for key in keys if key in tags]
    return next((width for width in given if width is not None), default), None in given


def _sides(tags: Tags) -> tuple[str | None, str | None]:
    """Tell for the left and the right side: pavement (yes), no pavement (no), mapped separately, or unknown (None)."""
    known = {"yes": "yes", "no": "no", "none": "no", "separate": "separate"}
    plain = tags.get("sidewalk", "")
    either = {"left": ("yes", "no"), "right": ("no", "yes"), "both": ("yes", "yes")}
    both = known.get(tags.get("sidewalk:both", ""))
    left, right = (both or side for side in either.get(plain, (known.get(plain),) * 2))
    return known.get(tags.get("sidewalk:left", ""), left), known.get(tags.get("sidewalk:right", ""), right)
