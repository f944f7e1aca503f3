"""What all tags of a way say together, worked out once for each set of tags: a town repeats the same few."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

from sidestep.network import measures, tags
from sidestep.network.access import Access, Tags
from sidestep.network.obstacles import kerb_height

_NAMES = ("name", "is_sidepath:of:name")
_LONGEST_NAME = 255  # characters; OpenStreetMap takes no more
_DIFFERENT = 4096  # sets of tags that are kept


@dataclass(frozen=True)
class Meaning:
    """What the tags of a way or area say, apart from its name."""

    kind: str
    walked: tuple[tuple[int, Access], ...]
    """Directions in which a way is walked, and by whom; see `sidestep.network.tags.directions`."""
    right: Access
    """Who may walk across an area."""
    excluded: str | None
    """Why it is not walked, as reports have it; None if it is."""
    area: bool
    """Whether a way that ends where it begins is an area."""
    width: float
    """Metres available to walkers."""
    incline: float
    """Rise for each metre in the direction in which it is drawn; NaN where it is unknown."""
    kerb: float
    """Metres of the highest kerb."""
    level: str
    """As it is tagged; "" if it is not."""
    crossing: bool
    """Whether it leads over a carriageway."""
    storey: int
    """Storey on which it meets areas without a common node; -1 for none."""
    notes: tuple[str, ...]
    """Measures that cannot be read, as reports have them."""


def meanings(widths: Mapping[str, float]) -> Callable[[Tags], Meaning]:
    """Make a function that tells what tags say.

    Parameters
    ----------
    widths
        Metres available to walkers by kind of street, where no tag gives a width.

    Returns
    -------
    Callable
        Takes the tags of a way or area, with its kind as ``highway``.
    """

    @lru_cache(_DIFFERENT)
    def meaning(tagged: frozenset[tuple[str, str]]) -> Meaning:
        return _meaning(dict(tagged), widths)

    return lambda tagged: meaning(frozenset(tag for tag in tagged.items() if tag[0] not in _NAMES))


def _meaning(tagged: Tags, widths: Mapping[str, float]) -> Meaning:
    kind = tagged["highway"]
    width, no_width = measures.walkable_width(tagged, widths) if kind in widths else (0.0, False)
    incline, no_incline = measures.incline(tagged)
    kerb, no_kerb = kerb_height(tagged) if kind in tags.FULL_WIDTH else (0.0, False)
    unreadable = {
        "way: unreadable width ignored": no_width,
        "way: incline without a readable number ignored": no_incline,
        "way: unreadable kerb taken as raised": no_kerb,
    }
    return Meaning(
        kind=kind,
        walked=tuple(tags.directions(tagged)),
        right=tags.right_of_way(tagged),
        excluded=tags.exclusion_reason(tagged),
        area=tags.is_area(tagged, closed=True),
        width=width,
        incline=incline,
        kerb=kerb,
        level=tagged.get("level") or tagged.get("layer", ""),
        crossing="crossing" in (tagged.get("footway"), tagged.get("path"), tagged.get("cycleway")),
        storey=tags.storey(tagged),
        notes=tuple(note for note, applies in unreadable.items() if applies),
    )


def way_name(tagged: Tags) -> str:
    """Take a way's own name, or that of the street along which it runs.

    Parameters
    ----------
    tagged
        Tags of the way.

    Returns
    -------
    str
        Without unprintable characters, which other file formats do not allow; "" if it has none.
    """
    name = next(filter(None, map(tagged.get, _NAMES)), "")
    if not name.isprintable():
        name = "".join(sign for sign in name if sign.isprintable())
    return name.strip()[:_LONGEST_NAME].rstrip()
