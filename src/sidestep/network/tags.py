"""What OpenStreetMap's tags say about a way: whether it is walked, in which direction, and how much room there is."""

import math
import re
from collections.abc import Mapping

from sidestep.errors import SidestepError

Tags = Mapping[str, str]

# The room that people have, in metres, where no tag says it. Ways of their own are walked on their whole width; on
# roads it is that of two pavements, since the carriageway is not walked, whatever its `width` says.
WIDTHS: Mapping[str, float] = {
    "bridleway": 2.0,
    "corridor": 3.0,
    "cycleway": 3.0,
    "footway": 2.0,
    "living_street": 5.0,
    "path": 1.5,
    "pedestrian": 6.0,
    "steps": 2.0,
    "track": 2.5,
    "primary": 5.0,
    "primary_link": 4.0,
    "residential": 4.0,
    "secondary": 5.0,
    "secondary_link": 4.0,
    "service": 3.0,
    "tertiary": 4.0,
    "tertiary_link": 4.0,
    "trunk": 4.0,
    "trunk_link": 4.0,
    "unclassified": 3.0,
}
UNKNOWN_WIDTH = 2.0  # m, a kind of street that is not in the table: it can come with a GraphML file of others
NARROWEST, WIDEST = 0.3, 100.0  # m; what is beyond them is a mistyped tag

WHOLE = frozenset(
    {"bridleway", "corridor", "cycleway", "footway", "living_street", "path", "pedestrian", "steps", "track"}
)
"""Kinds that are walked on their whole width."""

_ALLOWED = frozenset({"yes", "designated", "permissive", "official"})
_FORBIDDEN = frozenset({"no", "private"})
_BY_LEAVE = frozenset({"cycleway", "bridleway", "trunk", "trunk_link"})  # walked only where a tag says so
_BUSY = frozenset(
    {"primary", "primary_link", "secondary", "secondary_link", "trunk", "trunk_link"}
)  # not walked on without a pavement
_LENGTH = re.compile(
    r"\s*(\d+(?:[.,]\d+)?|[.,]\d+)\s*(m|metres?|meters?|ft|feet|')?\s*(?:(\d+(?:\.\d+)?)\s*\")?\s*", re.ASCII
)
_FOOT, _INCH = 0.3048, 0.0254


class WidthError(SidestepError):
    """A width that was asked for and cannot be."""


def refusal(tags: Tags) -> str | None:
    """Why a way with a `highway` tag is not walked, or None where it is.

    What is said of walkers (`foot`) counts more than what is said of all (`access`). A road whose pavements are ways
    of their own (`sidewalk=separate`) is not walked, or everybody would have three parallel streets to choose from.
    """
    kind, foot = tags["highway"], tags.get("foot")
    allowed = foot in _ALLOWED
    why = None
    if kind not in WIDTHS:
        why = "way: not a kind that is walked"
    elif foot == "use_sidepath":
        why = "way: its pavements are ways of their own"
    elif foot in _FORBIDDEN or (tags.get("access") in _FORBIDDEN and not allowed):
        why = "way: no access"
    elif kind in _BY_LEAVE and not allowed and "yes" not in _sides(tags):
        why = "way: walked only where a tag says so"
    elif kind not in WHOLE:
        sides = _sides(tags)
        if "separate" in sides and set(sides) <= {"separate", "no"}:
            why = "way: its pavements are ways of their own"
        elif kind in _BUSY and sides == ("no", "no") and not allowed:
            why = "way: no pavement"
    return why


def direction(tags: Tags) -> int:
    """1 where people walk only as the way is drawn, -1 only against it, 0 both ways.

    `oneway` speaks of vehicles. It is taken to speak of walkers only on footways, steps and corridors where nobody
    cycles; `oneway:foot` counts everywhere and before it, and escalators carry people one way.
    """
    conveying = tags.get("conveying")
    if conveying in ("forward", "backward"):
        return 1 if conveying == "forward" else -1
    value = tags.get("oneway:foot")
    if value is None and tags["highway"] in ("footway", "steps", "corridor") and tags.get("bicycle") not in _ALLOWED:
        value = tags.get("oneway")
    if value in ("yes", "true", "1"):
        return 1
    return -1 if value in ("-1", "reverse") else 0


def room(tags: Tags, table: Mapping[str, float] = WIDTHS) -> tuple[float, bool]:
    """Width in metres that walkers have on a way, and whether a tag about it made no sense and was passed over.

    On a road with a pavement on one side, or none, the table's width is halved.
    """
    kind = tags["highway"]
    if kind in WHOLE:
        said = [parse_width(tags[key]) for key in ("width", "est_width") if key in tags]
        found = next((width for width in said if width is not None), None)
        return (table[kind] if found is None else found), None in said
    sides = _sides(tags)
    walked = [side for side, state in zip(("left", "right"), sides, strict=True) if state not in ("no", "separate")]
    total, nonsense = 0.0, False
    for side in walked or ["both"]:
        keys = (f"sidewalk:{side}:width", "sidewalk:both:width", "sidewalk:width")
        said = [parse_width(tags[key]) for key in keys if key in tags]
        nonsense |= None in said
        total += next((width for width in said if width is not None), table[kind] / 2)
    return total, nonsense


def parse_width(text: str) -> float | None:
    """Metres from "3", "3.5 m", "12'" or "10 ft"; None where it is nonsense or beyond 0.3 to 100 m."""
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
    """The table of widths with some of them changed.

    Raises
    ------
    WidthError
        Unknown kinds, and widths that are not between 0.3 and 100 m.
    """
    for kind, width in (changes or {}).items():
        if kind not in WIDTHS:
            raise WidthError(f"no width can be given for {kind!r:.60}; the kinds of streets are {', '.join(WIDTHS)}")
        if not (math.isfinite(width) and NARROWEST <= width <= WIDEST):
            raise WidthError(f"the width of {kind} must be {NARROWEST} to {WIDEST:g} m, not {width}")
    return {**WIDTHS, **(changes or {})}


def standing(tags: Tags) -> int:
    """What a node is to people who walk past: 2 a crossing with lights, 1 one without, 0 neither."""
    crossing = tags.get("crossing", "no")
    if (
        tags.get("highway") == "traffic_signals"
        or crossing == "traffic_signals"
        or tags.get("crossing:signals") == "yes"
    ):
        return 2
    return int(tags.get("highway") == "crossing" or crossing != "no")


def _sides(tags: Tags) -> tuple[str | None, str | None]:
    """What there is on the left and on the right: yes, no, separate, or None where no tag says it."""
    plain = tags.get("sidewalk")
    left = right = {"both": "yes", "yes": "yes", "separate": "separate", "no": "no", "none": "no"}.get(plain or "")
    if plain in ("left", "right"):
        left, right = ("yes", "no") if plain == "left" else ("no", "yes")
    known = {"yes": "yes", "no": "no", "none": "no", "separate": "separate"}
    both = known.get(tags.get("sidewalk:both", ""))
    left = known.get(tags.get("sidewalk:left", ""), both or left)
    right = known.get(tags.get("sidewalk:right", ""), both or right)
    return left, right
