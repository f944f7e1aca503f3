"""Compare walks across squares with those of OSRM, which also crosses areas (foot_area.lua), on the same extract.

    routers/bin/python benchmarks/areas.py Helsinki.osm.pbf

The environment is that of routers.py. Compared are all pairs of entries of an area that are crossings here and from
which OSRM starts exactly there. Areas that the extract cuts are left out, and pairs for which OSRM's walk is shorter
than the straight line. Crossings are not merged.
"""

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from routers import Osrm, lengths

from sidestep.network.geodesy import metres_between
from sidestep.network.measures import width_table
from sidestep.network.osm import import_osm
from sidestep.network.osm_reader import read_extract


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extract", type=Path)
    parser.add_argument("--worst", type=int, default=10, help="pairs to list")
    options = parser.parse_args()
    town, report = import_osm(options.extract, merge=0)
    place = dict(zip(town.ids.tolist(), town.place, strict=True))
    extract = read_extract(options.extract, width_table(None))
    rings, on_ways = extract.areas, set(extract.ways.refs)
    areas: dict[int, set[int]] = {}
    border = np.append(0, np.cumsum(rings.counts))
    for row, number in enumerate(rings.numbers):
        areas.setdefault(number, set()).update(rings.refs[border[row] : border[row + 1]])
    absent = set(extract.nodes.ids[np.isnan(extract.nodes.place[:, 0])].tolist())
    areas = {number: nodes for number, nodes in areas.items() if not nodes & absent}
    shared = Counter(node for nodes in areas.values() for node in nodes)
    entries = {node for node in place if node in on_ways or shared[node] > 1}
    with tempfile.TemporaryDirectory() as folder:
        router = Osrm(options.extract, Path(folder), areas=True)
        found, impossible = [], 0
        for number, nodes in areas.items():
            ids = np.array(sorted(node for node in nodes & entries if router.starts_at(node, place[node])), np.int64)
            if len(ids) < 2:
                continue
            ours, theirs = lengths(town, ids), router.lengths(np.array([place[node] for node in ids.tolist()]))
            where = np.array([place[node] for node in ids.tolist()])
            one, two = np.triu_indices(len(ids), 1)
            straight = metres_between(where[one], where[two])
            sound = theirs[one, two] >= 0.99 * straight
            impossible += int((~sound).sum())
            one, two = one[sound], two[sound]
            found += zip(ours[one, two] / theirs[one, two], ours[one, two], theirs[one, two],
                         ids[one], ids[two], [number] * len(one), strict=True)  # fmt: skip
    ratio = np.array([row[0] for row in found])
    print(
        f"{report.areas} areas crossed; {len(found):,} pairs of entries of {len({row[-1] for row in found})} areas; "
        f"{impossible} left out"
    )
    parts = zip(PARTS, np.percentile(ratio, PARTS), strict=True)
    print("ours over OSRM's: " + ", ".join(f"{part} % {at:.3f}" for part, at in parts))
    print(f"longer than 1.02 times: {(ratio > 1.02).sum()}, than 1.02 times and 1 m: "
          f"{sum(ours > max(1.02 * theirs, theirs + 1) for _, ours, theirs, *_ in found)}")  # fmt: skip
    for row in sorted(found, reverse=True)[: options.worst]:
        print("{:.3f}  {:.1f} m, OSRM {:.1f} m, from node {} to {} of area {}".format(*row))


PARTS = (0, 5, 50, 95, 99, 100)

if __name__ == "__main__":
    main()
