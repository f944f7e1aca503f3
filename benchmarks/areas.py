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
from collections.abc import Iterator
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
from sidestep.network.town import Town
from sidestep.network.visibility import AreaError, free_space

PARTS = (0, 5, 50, 95, 99, 100)
STRETCH = 1.02


class Ground:
    """What is walked of an extract: its streets, crossings not merged, and its areas."""

    def __init__(self, town: Town, extract: Extract) -> None:
        self.town, self.extract = town, extract
        self.place = dict(zip(town.ids.tolist(), town.place, strict=True))
        self.plane = Projection.of(extract.nodes.place[~np.isnan(extract.nodes.place[:, 0])])
        self.areas = list(self._areas())
        streets = shapely.linestrings(
            self.plane.project(town.points), indices=np.repeat(np.arange(town.streets), np.diff(town.first))
        )
        self.parts = shapely.buffer([*(space for _, space in self.areas), *streets], EXACT)
        self.tree = shapely.STRtree(self.parts)
        on_ways, shared = set(extract.ways.refs), Counter(node for nodes, _ in self.areas for node in nodes)
        self.entries = {node for node in self.place if node in on_ways or shared[node] > 1}

    @classmethod
    def read(cls, path: Path) -> "Ground":
        """Read an extract."""
        return cls(import_osm(path, merge=0)[0], read_extract(path, width_table(None)))

    def _areas(self) -> Iterator[tuple[set[int], shapely.Geometry]]:
        """Find the areas all of whose nodes the extract has: the nodes of the rings, and what lies between these."""
        rings, nodes = self.extract.areas, self.extract.nodes
        border = np.append(0, np.cumsum(rings.counts))
        rows: dict[int, list[int]] = {}
        for row, number in enumerate(rings.numbers):
            rows.setdefault(number, []).append(row)
        for own in rows.values():
            refs = [rings.refs[border[row] : border[row + 1]] for row in own]
            xy = [self.plane.project(nodes.place[nodes.indices(ring)]) for ring in refs]
            if any(np.isnan(ring).any() for ring in xy):
                continue
            sides: list[list[np.ndarray]] = [[], []]
            for row, ring in zip(own, xy, strict=True):
                sides[rings.inner[row]].append(ring[:-1])
            try:
                space = shapely.union_all(free_space(*sides)[0])
            except AreaError:
                space = shapely.Polygon()
            yield {node for ring in refs for node in ring}, space

    def exact_entries(self, nodes: set[int], router: Osrm) -> list[int]:
        """List the entries among the nodes of an area from which OSRM starts exactly there."""
        return sorted(node for node in nodes & self.entries if router.starts_at(node, self.place[node]))

    def outside(
        self, lines: list[Float[np.ndarray, "point 2"]], space: shapely.Geometry
    ) -> Float[np.ndarray, "line 2"]:
        """Tell how many metres of lines lead outside an area, and how many of these where no street or area is."""
        found = np.zeros((len(lines), 2))
        plans = np.array([shapely.LineString(self.plane.project(line)) for line in lines])
        outside = shapely.difference(plans, shapely.buffer(space, EXACT))
        found[:, 0] = shapely.length(outside)
        for line in np.flatnonzero(found[:, 0]).tolist():
            near = self.tree.query(outside[line], "intersects")
            found[line, 1] = outside[line].difference(shapely.union_all(self.parts[near])).length
        return found


def line_length(line: Float[np.ndarray, "point 2"]) -> float:
    """Measure a line in metres."""
    return float(course_lengths(line, np.array([0, len(line)]))[0])


def walks(
    router: Osrm, places: Float[np.ndarray, "place 2"]
) -> Iterator[tuple[int, int, Float[np.ndarray, "point 2"]]]:
    """Find OSRM's lines between all pairs of places, as far as they begin and end there."""
    for one, two in zip(*np.triu_indices(len(places), 1), strict=True):
        line = router.line(places[one], places[two])
        if len(line) and (metres_between(line[[0, -1]], places[[one, two]]) < EXACT).all():
            yield int(one), int(two), line


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extract", type=Path)
    parser.add_argument("--worst", type=int, default=10, help="pairs to list")
    options = parser.parse_args()
    ground = Ground.read(options.extract)
    rows: list[tuple[int, int, int, float, float, float, float]] = []
    pairs = 0
    with tempfile.TemporaryDirectory() as folder:
        router = Osrm(options.extract, Path(folder), areas=True)
        for number, (nodes, space) in enumerate(ground.areas):
            ids = ground.exact_entries(nodes, router)
            if len(ids) < 2:
                continue
            pairs += len(ids) * (len(ids) - 1) // 2
            ours = lengths(ground.town, np.array(ids))
            found = list(walks(router, np.stack([ground.place[node] for node in ids])))
            astray = ground.outside([line for *_, line in found], space).tolist()
            rows += [
                (number, ids[one], ids[two], float(ours[one, two]), line_length(line), *far)
                for (one, two, line), far in zip(found, astray, strict=True)
            ]
    length, other, outside, lost = np.array([row[3:] for row in rows]).T
    ratio = length / other
    longer = (ratio > STRETCH) & (length > other + EXACT)
    print(
        f"{len(rows):,} pairs of entries of {len({row[0] for row in rows})} areas; left out are {pairs - len(rows)} "
        "between which OSRM finds no walk, or one that begins or ends elsewhere\n"
    )
    print(f"| OSRM's line | pairs | {' | '.join(f'{part} %' for part in PARTS)} | longer |")
    print("|---|---|" + "---|" * (len(PARTS) + 1))
    for name, of in {
        "through the area only": outside == 0,
        "along other streets and areas, too": (outside > 0) & (lost == 0),
        "also where nothing is walked": lost > 0,
    }.items():
        parts = " | ".join(f"{at:.3f}" for at in np.percentile(ratio[of], PARTS))
        print(f"| {name} | {of.sum():,} | {parts} | {longer[of].sum()} |")
    for row in np.argsort(-ratio)[: options.worst].tolist():
        number, start, stop, *_ = rows[row]
        print(
            f"{ratio[row]:.3f}  {length[row]:.1f} m, OSRM {other[row]:.1f} m, {lost[row]:.1f} m of it where nothing is "
            f"walked, from node {start} to {stop} of area {number}"
        )


if __name__ == "__main__":
    main()
