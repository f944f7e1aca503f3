"""Compare walks across squares with those of OSRM, which also crosses areas (foot_area.lua), on the same extract.

    routers/bin/python benchmarks/areas.py Helsinki.osm.pbf

The environment is that of routers.py. Compared are all pairs of entries of an area that are crossings here and from
which OSRM starts exactly there; crossings are not merged. Areas that the extract cuts are left out. OSRM's walks are
told apart by where their lines lead: through the area only, along other streets and areas too, or where neither is.
The first say whether an area is crossed as it should be. All lines are measured on the same sphere.
"""

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float
from routers import EXACT, Osrm, lengths

from sidestep.network.extract import Extract
from sidestep.network.geodesy import Projection, course_lengths, metres_between
from sidestep.network.measures import width_table
from sidestep.network.osm import import_osm
from sidestep.network.osm_reader import read_extract
from sidestep.network.visibility import AreaError, free_space

PARTS = (0, 5, 50, 95, 99, 100)
STRETCH = 1.02


def whole_areas(extract: Extract, plane: Projection) -> list[tuple[set[int], shapely.Geometry]]:
    """List the areas all of whose nodes the extract has: the nodes of the rings, and what lies between these."""
    rings = extract.areas
    border = np.append(0, np.cumsum(rings.counts))
    rows: dict[int, list[int]] = {}
    for row, number in enumerate(rings.numbers):
        rows.setdefault(number, []).append(row)
    found = []
    for own in rows.values():
        refs = [rings.refs[border[row] : border[row + 1]] for row in own]
        xy = [plane.project(extract.nodes.place[extract.nodes.indices(nodes)]) for nodes in refs]
        if any(np.isnan(ring).any() for ring in xy):
            continue
        sides = [[ring[:-1] for row, ring in zip(own, xy, strict=True) if rings.inner[row] == side] for side in (0, 1)]
        try:
            space = shapely.union_all(free_space(*sides)[0])
        except AreaError:
            space = shapely.Polygon()
        found.append(({node for nodes in refs for node in nodes}, space))
    return found


def metres_outside(
    lines: list[Float[np.ndarray, "point 2"]],
    space: shapely.Geometry,
    parts: np.ndarray,
    tree: shapely.STRtree,
) -> Float[np.ndarray, "line 2"]:
    """Tell how many metres of lines lead outside an area, and how many of these where no street or area is."""
    found = np.zeros((len(lines), 2))
    plans = np.array([shapely.LineString(line) for line in lines])
    outside = shapely.difference(plans, shapely.buffer(space, EXACT))
    found[:, 0] = shapely.length(outside)
    for line in np.flatnonzero(found[:, 0]).tolist():
        near = tree.query(outside[line], "intersects")
        found[line, 1] = outside[line].difference(shapely.union_all(parts[near])).length
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extract", type=Path)
    parser.add_argument("--worst", type=int, default=10, help="pairs to list")
    options = parser.parse_args()
    town, report = import_osm(options.extract, merge=0)
    place = dict(zip(town.ids.tolist(), town.place, strict=True))
    extract = read_extract(options.extract, width_table(None))
    plane = Projection.of(extract.nodes.place[~np.isnan(extract.nodes.place[:, 0])])
    areas = whole_areas(extract, plane)
    streets = shapely.linestrings(
        plane.project(town.points), indices=np.repeat(np.arange(town.streets), np.diff(town.first))
    )
    parts = shapely.buffer([*(space for _, space in areas), *streets], EXACT)
    everything = shapely.STRtree(parts)
    on_ways, shared = set(extract.ways.refs), Counter(node for nodes, _ in areas for node in nodes)
    entries = {node for node in place if node in on_ways or shared[node] > 1}
    ours, theirs, outside, found, elsewhere = [], [], [], [], 0
    with tempfile.TemporaryDirectory() as folder:
        router = Osrm(options.extract, Path(folder), areas=True)
        for number, (nodes, space) in enumerate(areas):
            ids = np.array(sorted(node for node in nodes & entries if router.starts_at(node, place[node])), np.int64)
            if len(ids) < 2:
                continue
            one, two = np.triu_indices(len(ids), 1)
            lines = [router.line(place[ids[i]], place[ids[j]]) for i, j in zip(one, two, strict=True)]
            ends = np.array([line[[0, -1]] if len(line) else np.full((2, 2), np.nan) for line in lines])
            right = np.stack([place[node] for node in ids.tolist()])[np.stack([one, two], axis=1)]
            there = (metres_between(ends.reshape(-1, 2), right.reshape(-1, 2)).reshape(-1, 2) < EXACT).all(axis=1)
            elsewhere += int((~there).sum())
            one, two, lines = one[there], two[there], [lines[i] for i in np.flatnonzero(there)]
            ours.append(lengths(town, ids)[one, two])
            theirs.append([float(course_lengths(line, np.array([0, len(line)]))[0]) for line in lines])
            outside.append(metres_outside([plane.project(line) for line in lines], space, parts, everything))
            found += [(number, a, b) for a, b in zip(ids[one].tolist(), ids[two].tolist(), strict=True)]
    length, other, astray = (np.concatenate(part) for part in (ours, theirs, outside))
    ratio = length / other
    longer = (ratio > STRETCH) & (length > other + EXACT)
    print(
        f"{report.areas} areas crossed; {len(found):,} pairs of entries of {len({row[0] for row in found})} areas; "
        f"left out are {elsewhere} between which OSRM finds no walk, or one that begins or ends elsewhere\n"
    )
    print(f"| OSRM's line | pairs | {' | '.join(f'{part} %' for part in PARTS)} | longer |")
    print("|---|---|" + "---|" * (len(PARTS) + 1))
    inside, known = (astray == 0).T
    for name, of in {
        "within the area": inside,
        "also along other streets and areas": known & ~inside,
        "also where neither is": ~known,
    }.items():
        parts = " | ".join(f"{at:.3f}" for at in np.percentile(ratio[of], PARTS))
        print(f"| {name} | {of.sum():,} | {parts} | {longer[of].sum()} |")
    for row in np.argsort(-ratio)[: options.worst].tolist():
        number, start, stop = found[row]
        print(
            f"{ratio[row]:.3f}  {length[row]:.1f} m, OSRM {other[row]:.1f} m, {astray[row, 1]:.1f} m of it astray, "
            f"from node {start} to {stop} of area {number}"
        )


if __name__ == "__main__":
    main()
