"""Find what makes walks differ from those of OSRM: compare again with some areas walked along their outlines by both.

    routers/bin/python benchmarks/causes.py Helsinki.osm.pbf

The environment is that of routers.py. Both read copies of the extract in which more and more areas are tagged
``area=no``, and those mapped as relations are left out: first those that OSRM does not cross, which are all but
pedestrian ones; then also lifts; then the squares that OSRM does not cross as they are mapped. At last nobody crosses
any area, and ways under construction are left out, which OSRM walks where they have a tag that lets people walk.

OSRM fails at a square if its walk between two of the square's entries is longer by more than 5 % and 1 m than the
straight line, where this lies inside, or than its own walk along the outline; or if more than 1 m of it lie where
nothing is walked.
"""

import argparse
import tempfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import osmium
import shapely
from areas import Ground, line_length, walks
from routers import Osrm, choose, lengths, report

from sidestep.network.osm import import_osm
from sidestep.network.tags import way_kind

ACROSS, ALONG = "across squares", "along outlines"
Number = tuple[str, int]
"""Whether something is a way ("w") or a relation ("r"), and its number."""


def without(extract: Path, copy: Path, areas: Collection[Number], *kinds: str) -> Path:
    """Copy an extract with some areas that are none any more, and without some kinds of ways and nodes."""
    with osmium.SimpleWriter(str(copy)) as writer:
        for thing in osmium.FileProcessor(str(extract)):
            tags: dict[str, str] = dict(thing.tags)
            left_out = tags.get("highway") in kinds
            if (thing.is_relation() and ("r", thing.id) in areas) or (left_out and not thing.is_node()):
                continue
            changed: Any = thing
            if left_out:
                changed = thing.replace(tags={key: value for key, value in tags.items() if key != "highway"})
            elif thing.is_way() and ("w", thing.id) in areas:
                changed = thing.replace(tags={**tags, "area": "no"})
            writer.add(changed)
    return copy


def listed(extract: Path) -> dict[Number, tuple[dict[str, str], frozenset[int]]]:
    """List closed ways and multipolygons of kinds that might be walked: their tags and their nodes."""
    ways: dict[int, frozenset[int]] = {}
    found: dict[Number, tuple[dict[str, str], frozenset[int]]] = {}
    relations = []
    for thing in osmium.FileProcessor(str(extract)):
        tags = dict(thing.tags)
        if thing.is_way():
            ways[thing.id] = frozenset(node.ref for node in thing.nodes)
            if way_kind(tags) is not None and thing.is_closed():
                found["w", thing.id] = tags, ways[thing.id]
        elif thing.is_relation() and tags.get("type") == "multipolygon" and way_kind(tags) is not None:
            relations.append((thing.id, tags, [member.ref for member in thing.members if member.type == "w"]))
    for number, tags, members in relations:
        found["r", number] = tags, frozenset().union(*(ways.get(way, frozenset()) for way in members))
    return found


def fails(ground: Ground, across: Osrm, along: Osrm, nodes: set[int], space: shapely.Geometry) -> bool:
    """Tell whether OSRM does not cross a square as it is mapped."""
    ids = ground.exact_entries(nodes, across)
    if len(ids) < 2:
        return False
    places = np.stack([ground.place[node] for node in ids])
    xy, outline = ground.plane.project(places), along.lengths(places)
    for one, two, line in walks(across, places):
        straight = shapely.LineString(xy[[one, two]])
        least = np.nanmin([straight.length if shapely.covers(space, straight) else np.inf, outline[one, two]])
        if line_length(line) > 1.05 * least + 1 or ground.outside([line], space)[0, 1] > 1:
            return True
    return False


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extract", type=Path)
    parser.add_argument("--merge", type=float, nargs="*", default=[0.0, 12.0], help="metres, several at once")
    parser.add_argument("--places", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        cases = copies(options.extract, Path(name))
        towns = [[import_osm(path, merge=merge)[0] for merge in options.merge] for *_, path in cases]
        engines = [
            Osrm(path, made(Path(name) / f"engine-{row}"), areas=reference == ACROSS)
            for row, (reference, _, path) in enumerate(cases)
        ]
        ids, places = choose([town for of in towns for town in of], engines, options.places, options.seed)
        print("\n| over OSRM | extract | merge | median | 5 to 95 % | within 5 % | beyond 15 % |")
        print("|---|---|---|---|---|---|---|")
        for (reference, title, _), of, engine in zip(cases, towns, engines, strict=True):
            found = engine.lengths(places)
            for merge, town in zip(options.merge, of, strict=True):
                report(f"{reference} | {title} | {merge:g} m", lengths(town, ids), found)


def copies(extract: Path, folder: Path) -> list[tuple[str, str, Path]]:
    """Write copies of the extract; list whether OSRM crosses squares there, what was changed, and the file."""
    across = Osrm(extract, made(folder / "across"), areas=True)
    along = Osrm(extract, made(folder / "along"))
    known, ground = listed(extract), Ground.read(extract)
    numbers = {nodes: number for number, (_, nodes) in known.items()}
    squares = {number for number, (tags, _) in known.items() if is_square(tags)}
    wrong = {
        numbers[frozenset(nodes)]
        for nodes, space in ground.areas
        if numbers.get(frozenset(nodes)) in squares and fails(ground, across, along, nodes, space)
    }
    print(f"OSRM does not cross {len(wrong)} of {len(squares)} squares as they are mapped:")
    print(", ".join(f"{'way' if kind == 'w' else 'relation'} {number}" for kind, number in sorted(wrong)))
    others = known.keys() - squares
    return [
        (ACROSS, "as mapped", extract),
        (ACROSS, "other areas along outlines", without(extract, folder / "1.osm.pbf", others)),
        (ACROSS, "and no lifts", without(extract, folder / "2.osm.pbf", others, "elevator")),
        (ACROSS, "and these squares", without(extract, folder / "3.osm.pbf", others | wrong, "elevator")),
        (
            ACROSS,
            "and nothing under construction",
            without(extract, folder / "4.osm.pbf", others | wrong, "elevator", "construction"),
        ),
        (ALONG, "as mapped", extract),
        (ALONG, "all areas along outlines", without(extract, folder / "6.osm.pbf", known.keys())),
        (ALONG, "and nothing under construction", without(extract, folder / "5.osm.pbf", known.keys(), "construction")),
    ]


def is_square(tags: dict[str, str]) -> bool:
    """Tell whether OSRM crosses an area with these tags."""
    return tags.get("highway") == "pedestrian" and (tags.get("type") == "multipolygon" or tags.get("area") == "yes")


def made(folder: Path) -> Path:
    """Make a folder."""
    folder.mkdir()
    return folder


if __name__ == "__main__":
    main()
