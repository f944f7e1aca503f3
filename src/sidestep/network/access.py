"""Who may walk where, by OpenStreetMap's access tags: everybody, at some hours, only to get there, or nobody.

``foot`` outranks ``access``, and conditional values outrank plain ones of the same key. ``opening_hours`` limit what is
then left.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np
from jaxtyping import Int8

from sidestep.network.opening_hours import WEEK, conditional_values, names_special_days, open_minutes, opening_text

Tags = Mapping[str, str]

NEVER = "off"
"""Opening times of what is never open."""


class Right(IntEnum):
    """Who may walk."""

    CLOSED = 0
    """Nobody, or only some people."""
    DESTINATION = 1
    """Those whose walk begins or ends there."""
    OPEN = 2
    """Everybody."""


_VALUES = {
    **dict.fromkeys(("yes", "designated", "permissive", "official", "public", "discouraged", "open"), Right.OPEN),
    **dict.fromkeys(
        (
            "destination", "customers", "customer", "resident", "residents", "residential", "tenants", "visitors",
            "guests",
        ),
        Right.DESTINATION,
    ),
    **dict.fromkeys(
        (
            "no", "private", "agricultural", "forestry", "military", "delivery", "employees", "permit", "emergency",
            "use_sidepath", "staff", "members", "authorized", "authorised", "restricted", "closed", "key", "service",
            "psv", "bus", "taxi", "hgv", "goods", "motorcar",
        ),
        Right.CLOSED,
    ),
}  # fmt: skip
_NOT_OF_THE_WAY = frozenset({"amenity", "shop", "office", "tourism", "leisure", "craft", "healthcare"})


@dataclass(frozen=True)
class Access:
    """When something is open to walkers, and to whom."""

    opening: str = ""
    """Opening times as `sidestep.network.opening_hours.opening_text` writes them; "" always, "off" never."""
    restricted: bool = False
    """Whether it is only for those whose walk begins or ends there."""
    notes: tuple[str, ...] = ()
    """What was ignored or contradictory, as reports have it."""


_ALWAYS = Access()


def access(tags: Tags, direction: str = "", *, by_foot: bool = False) -> Access:
    """Tell who may walk, and when.

    Values that nobody knows and conditions that cannot be read are ignored, with a note.

    Parameters
    ----------
    tags
        Tags of a way or node.
    direction
        "forward" or "backward" for one direction of a way, as it is drawn.
    by_foot
        Whether it is closed to walkers unless tags about them let them in; then ``access`` does not count.

    Returns
    -------
    Access
        What the tags say; where they say nothing, open to everybody, or closed if ``by_foot``.
    """
    keys = (key for key in _KEYS[direction] if not (by_foot and key.startswith("access")))
    rules = tuple((key, tags[key]) for key in keys if key in tags)
    if not rules and not by_foot:
        return _ALWAYS
    if "opening_hours" in tags and not _NOT_OF_THE_WAY.isdisjoint(tags):
        rules = tuple(rule for rule in rules if rule[0] != "opening_hours")
    return evaluate(rules, Right.CLOSED if by_foot else Right.OPEN)


@lru_cache(maxsize=4096)  # a town repeats the same few
def evaluate(rules: tuple[tuple[str, str], ...], begin: Right = Right.OPEN) -> Access:
    """Tell who may walk by rules of rising precedence.

    Parameters
    ----------
    rules
        Keys and values; keys may end in ``:conditional``. ``opening_hours``, at last, limit the others.
    begin
        Who may walk without any rule.

    Returns
    -------
    Access
        What they say together.
    """
    right = np.full(WEEK, begin, np.int8)
    notes: list[str] = []
    for key, value in rules:
        if key == "opening_hours":
            right = _within_hours(right, value, notes)
            continue
        if key.endswith(":conditional"):
            right = _under_conditions(right, value, notes)
        elif (best := _meaning(value, notes)) is not None:
            right = np.full(WEEK, best, np.int8)
    public, anyone = right == Right.OPEN, right > Right.CLOSED
    if public.any() and (public != anyone).any():
        notes.append("restricted at some hours, taken as closed then")
    restricted = not public.any() and bool(anyone.any())
    return Access(opening_text(anyone if restricted else public), restricted, tuple(sorted(set(notes))))


def both(one: Access, other: Access) -> Access:
    """Tell who may walk where two rules apply at once.

    Parameters
    ----------
    one, other
        The rules.

    Returns
    -------
    Access
        Open when both are, and restricted if either is; without notes.
    """
    opening, minutes, others = one.opening or other.opening, open_minutes(one.opening), open_minutes(other.opening)
    if one.opening and other.opening and minutes is not None and others is not None:
        opening = opening_text(minutes & others)
    return Access(opening, one.restricted or other.restricted)


def _meaning(value: str, notes: list[str]) -> Right | None:
    """Give the most open of the values in a list; None if all are unknown."""
    known = [_VALUES.get(part.strip()) for part in value.lower().split(";")]
    rights = {right for right in known if right is not None}
    if None in known:
        notes.append("unknown access ignored")
    if {Right.OPEN, Right.CLOSED} <= rights:
        notes.append("contradicting access")
    return max(rights, default=None)


def _under_conditions(right: Int8[np.ndarray, " minute"], text: str, notes: list[str]) -> Int8[np.ndarray, " minute"]:
    if names_special_days(text):
        notes.append("rules for holidays or dates ignored")
    for value, minutes in conditional_values(text) or [("", None)]:
        then = None if minutes is None else _meaning(value, notes)
        if minutes is None or then is None:
            notes.append("conditional access not understood")
        else:
            right = np.where(minutes, then, right).astype(np.int8)
    return right


def _within_hours(right: Int8[np.ndarray, " minute"], text: str, notes: list[str]) -> Int8[np.ndarray, " minute"]:
    minutes = open_minutes(text)
    if minutes is None:
        notes.append("opening hours not understood")
        return right
    if names_special_days(text):
        notes.append("rules for holidays or dates ignored")
    return np.where(minutes, right, Right.CLOSED).astype(np.int8)


def _keys(direction: str) -> tuple[str, ...]:
    """List the keys that matter, by rising precedence."""
    keys = [key + suffix for key in ("access", "foot") for suffix in ("", f":{direction}" if direction else "")]
    pairs = dict.fromkeys(part for key in keys for part in (key, f"{key}:conditional"))
    return (*pairs, "opening_hours")


_KEYS = {direction: _keys(direction) for direction in ("", "forward", "backward")}
