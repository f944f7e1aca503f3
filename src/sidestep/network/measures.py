"""What OpenStreetMap's tags measure: how wide ways are for walkers, and how steep."""

import math
import re
from collections.abc import Mapping

from sidestep.arguments import NUMBER
from sidestep.errors import SidestepError
from sidestep.network.access import Tags
from sidestep.network.tags import FULL_WIDTH, WIDTHS, pavements

NARROWEST, WIDEST = 0.3, 100.0
"""Metres; tags beyond these are mistyped."""
STEPS_INCLINE = 0.5
"""Rise for each metre of steps tagged as leading up or down without a number: 16 cm up for 32 cm ahead."""

_LENGTH = re.compile(r"\s*(\d+(?:[.,]\d+)?|[.,]\d+)\s*([a-z]+|'|\")?\s*(?:(\d+(?:\.\d+)?)\s*\")?\s*", re.ASCII)
_RISE = re.compile(r"([+-]?\d+(?:[.,]\d+)?)\s*(%|°|deg)|([+-]?)1\s*[:/]\s*(\d+(?:[.,]\d+)?)", re.ASCII)
_FOOT, _INCH = 0.3048, 0.0254
_UNITS = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
    "cm": 0.01,
    "mm": 0.001,
    **dict.fromkeys(("ft", "feet", "foot", "'"), _FOOT),
    **dict.fromkeys(("in", "inch", "inches", '"'), _INCH),
}
_STEEPEST = 2.0  # rise for each metre; steeper values are mistyped


class WidthError(SidestepError):
    """An invalid width for a kind of street; ``field`` is ``widths`` and the kind."""


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
    sides = zip(("left", "right"), pavements(tags), strict=True)
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
    metres = parse_length(text)
    return metres if metres is not None and NARROWEST <= metres <= WIDEST else None


def parse_length(text: str) -> float | None:
    """Read a length.

    Parameters
    ----------
    text
        Such as "3", "3.5 m", "4 cm", "12'", "6 ft" or feet and inches.

    Returns
    -------
    float or None
        Metres, 0 or more; None if unreadable.
    """
    match = _LENGTH.fullmatch(text[:40].lower())
    if match is None:
        return None
    number, unit, inches = match.groups()
    scale = _UNITS.get(unit or "m")
    if scale is None or (inches is not None and scale != _FOOT):
        return None
    return float(number.replace(",", ".")) * scale + float(inches or 0) * _INCH


def incline(tags: Tags) -> tuple[float, bool]:
    """Tell how steep a way is.

    Parameters
    ----------
    tags
        Tags of the way, with its kind as ``highway``.

    Returns
    -------
    float, bool
        Rise for each metre in the direction in which it is drawn, NaN where it is unknown; and whether a tag without a
        readable number was ignored. Steps that lead up or down have ``STEPS_INCLINE``.
    """
    text = tags.get("incline", "").strip().lower()
    if not text:
        return math.nan, False
    if tags["highway"] == "steps" and text in ("up", "down"):
        return (STEPS_INCLINE if text == "up" else -STEPS_INCLINE), False
    match = _RISE.fullmatch(text[:40])
    if match is None:
        return math.nan, True
    number, unit, sign, run = match.groups()
    if run is not None:
        rise = float(sign + "1") / max(float(run.replace(",", ".")), 1e-9)
    else:
        value = float(number.replace(",", "."))
        rise = value / 100 if unit == "%" else math.tan(math.radians(max(min(value, 89.0), -89.0)))
    return (rise, False) if abs(rise) <= _STEEPEST else (math.nan, True)


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
        if not NARROWEST <= NUMBER(WidthError, f"widths.{kind}", width) <= WIDEST:
            raise WidthError(
                f"the width of {kind} must be {NARROWEST} to {WIDEST:g} m, not {width}", field=f"widths.{kind}"
            )
    return {**WIDTHS, **(changes or {})}


def _first_width(tags: Tags, keys: tuple[str, ...], default: float) -> tuple[float, bool]:
    """Give the first readable width among some tags, and whether any of them is unreadable."""
    given = [parse_width(tags[key]) for key in keys if key in tags]
    return next((width for width in given if width is not None), default), None in given
