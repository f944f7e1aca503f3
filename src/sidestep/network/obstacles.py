"""What stands on a way: gates and doors, walls that close it, kerbs, and lifts between levels.

A barrier closes a way to walkers if its kind does, or its tags of access do; where tags let people through, its kind
does not matter.
"""

from dataclasses import replace

from sidestep.network.access import Access, Right, Tags, access, evaluate
from sidestep.network.measures import parse_length

IMPASSABLE = frozenset({
    "cable_barrier", "chain_link", "city_wall", "fence", "guard_rail", "hedge", "noise_barrier", "retaining_wall",
    "wall", "wire_fence", "yes",
})  # fmt: skip
"""Kinds of barriers that nobody passes; all others, such as gates, stiles and bollards, are passed on foot."""
RAISED = 0.1
"""Metres; the height of kerbs tagged as raised, and of those whose height nobody says."""
KERBS = {"flush": 0.0, "no": 0.0, "lowered": 0.03, "rolled": 0.05, "raised": RAISED, "regular": RAISED, "yes": RAISED}
"""Metres by value of ``kerb`` where ``kerb:height`` does not say."""
HIGHEST_KERB = 0.5
"""Metres; higher values are mistyped."""

_WAYS_THROUGH = ("gate", "door", "entrance", "stile")


def passage(tags: Tags) -> Access | None:
    """Tell who may pass a node on a way.

    Barriers, entrances, doors and lifts count; the access tags of other nodes are about something beside the way. A
    lock closes what opens at no particular hours, unless ``foot`` lets people through.

    Parameters
    ----------
    tags
        Tags of the node.

    Returns
    -------
    Access or None
        Who may pass, and when; None for a node that is in nobody's way.
    """
    barriers = {kind.strip() for kind in tags.get("barrier", "").split(";")} - {"", "no"}
    through = any(tags.get(key, "no") != "no" for key in _WAYS_THROUGH)
    if not barriers and not through and tags.get("highway") != "elevator":
        return None
    shut = (barriers and barriers <= IMPASSABLE and not through) or tags.get("entrance") == "emergency"
    rules = [(key, tags[key]) for key in ("access", "access:conditional") if key in tags]
    timed = any(key in tags for key in ("access:conditional", "foot:conditional", "opening_hours"))
    locked = tags.get("locked") == "yes" and not timed
    rules += [("locked", "no")] * locked
    rules += [(key, tags[key]) for key in ("foot", "foot:conditional", "opening_hours") if key in tags]
    if not rules and not shut:
        return None
    found = evaluate(tuple(rules), Right.CLOSED if shut else Right.OPEN)
    if locked and "access" in tags and not access({"access": tags["access"]}).opening:
        found = replace(found, notes=(*found.notes, "contradicting access"))
    return found if found.opening or found.restricted or found.notes else None


def kerb_height(tags: Tags) -> tuple[float, bool]:
    """Tell how high the kerb of a node or a crossing is.

    Parameters
    ----------
    tags
        Its tags.

    Returns
    -------
    float, bool
        Metres, 0 where there is no kerb; and whether an unreadable tag was ignored.
    """
    kind, text = tags.get("kerb"), tags.get("kerb:height")
    if kind is None and text is None:
        return RAISED * (tags.get("barrier") == "kerb"), False
    metres = None if text is None else parse_length(text)
    if metres is not None and metres <= HIGHEST_KERB:
        return metres, False
    return KERBS.get(kind or "", RAISED), text is not None or kind not in KERBS
