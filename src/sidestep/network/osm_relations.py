"""Relations of OpenStreetMap files: multipolygons that might be walked across, and ferries."""

from dataclasses import dataclass, field
from typing import Any

import osmium

from sidestep.network import tags
from sidestep.network.meanings import Meaning

_ABOUT_RELATIONS = frozenset({"type", "source", "created_by", "note", "fixme"})
"""Tags of multipolygons that do not say of what."""
_BESIDE_FERRIES = ("platform", "stop")
"""Roles of the ways at which ferries land."""


@dataclass(eq=False)
class Relations:
    """Multipolygons that might be walked, and ferries."""

    tagged: dict[int, dict[str, str]] = field(default_factory=dict)
    """Their tags by number, with their kind as ``highway``."""
    members: dict[int, list[tuple[int, bool]]] = field(default_factory=dict)
    """Numbers of their ways, and whether these are around holes."""
    pieces: dict[int, list[int]] = field(default_factory=dict)
    """Nodes of these ways, as far as the file has them."""
    outer: set[int] = field(default_factory=set)
    """Numbers of ways around those that are walked, which are no areas of their own then."""
    ferries: dict[int, dict[str, str]] = field(default_factory=dict)
    """Tags of ferries by the numbers of the ways along which they go."""
    untagged: dict[int, int] = field(default_factory=dict)
    """Multipolygons without tags of their own by the ways around them, whose tags they get if these are areas."""
    adopted: dict[int, tuple[Meaning, str]] = field(default_factory=dict)
    """What the tags of such ways say, and their names, by the numbers of their relations."""


def read_relations(file: Any) -> Relations:
    """Read multipolygons that might be walked, and ferries; of several versions the latest counts.

    Parameters
    ----------
    file
        The file, as the reader knows it.

    Returns
    -------
    Relations
        The nodes of ``pieces``, and ``adopted``, are not yet known: ways are read later.
    """
    found = Relations()
    versions: dict[int, int] = {}
    for relation in osmium.FileProcessor(file, osmium.osm.RELATION):
        if not isinstance(relation, osmium.osm.Relation):
            continue
        number = relation.id
        if relation.version < versions.get(number, 0):
            continue
        versions[number] = relation.version
        found.tagged.pop(number, None)
        found.members.pop(number, None)
        tagged = dict(relation.tags)
        kind = tags.way_kind(tagged)
        ferry = kind == tags.FERRY
        if relation.deleted or tagged.get("type") != ("route" if ferry else "multipolygon"):
            continue
        if ferry or (kind is not None and tagged.get("area") != "no") or tagged.keys() <= _ABOUT_RELATIONS:
            if kind is not None:
                found.tagged[number] = {**tagged, "highway": kind}
            members = [member for member in relation.members if member.type == "w"]
            along = [each for each in members if not each.role.startswith(_BESIDE_FERRIES)]
            found.members[number] = [(each.ref, each.role == "inner") for each in along]
    _tell_apart(found)
    return found


def _tell_apart(found: Relations) -> None:
    """Note which ways belong to which kind of multipolygon, and take the ferries out of these."""
    for number, members in [*found.members.items()]:
        tagged = found.tagged.get(number, {})
        if tagged.get("highway") == tags.FERRY:
            found.ferries.update((way, tagged) for way, _ in members)
            del found.tagged[number], found.members[number]
            continue
        found.pieces.update((way, []) for way, _ in members)
        outer = [way for way, inner in members if not inner]
        if number not in found.tagged:
            found.untagged.update(dict.fromkeys(outer, number))
        elif tags.exclusion_reason(found.tagged[number]) is None:
            found.outer.update(outer)
