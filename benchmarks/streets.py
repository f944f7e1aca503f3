"""Measure time and memory to import an OpenStreetMap extract, and time to load its streets.

    python benchmarks/streets.py            10⁶ nodes, invented
    python benchmarks/streets.py --side 50  fewer

The extract is a grid of crossings 80 m apart with eight bends in every street, and a square with two entries in each
twentieth block, each second of them with a hole.
"""

import argparse
import resource
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
import osmium
from osmium.osm.mutable import Node, Relation, Way

from sidestep.network.formats import load_town, save_town
from sidestep.network.osm import import_osm

BENDS, SPACING = 8, 80 / 111_195  # bends a street; degrees
KINDS = ("footway", "residential", "path")


def streets(side: int) -> Iterator[tuple[int, int, int, int]]:
    for y in range(side):
        for x in range(side):
            yield from ((x, y, x + dx, y + dy) for dx, dy in ((1, 0), (0, 1)) if x + dx < side and y + dy < side)


def write(path: Path, side: int) -> tuple[int, int]:
    rng = np.random.default_rng(0)

    def at(x: float, y: float) -> tuple[float, float]:
        return 25 + 2 * SPACING * x, 60 + SPACING * y

    number, ways = side * side, []
    with osmium.SimpleWriter(str(path), overwrite=True) as writer:
        for i in range(side * side):
            tags = {"highway": "crossing"} if i % 7 == 0 else {}
            writer.add_node(Node(id=1 + i, location=at(i % side, i // side), tags=tags))
        for x, y, to_x, to_y in streets(side):
            refs = [1 + y * side + x]
            for bend in range(1, BENDS + 1):
                part = bend / (BENDS + 1)
                dx, dy = rng.normal(0, 0.02, 2)
                number += 1
                writer.add_node(Node(id=number, location=at(x + (to_x - x) * part + dx, y + (to_y - y) * part + dy)))
                refs.append(number)
            ways.append([*refs, 1 + to_y * side + to_x])
        squares = write_corners(writer, side, number, at)
        for i, refs in enumerate(ways):
            tags = {"highway": KINDS[i % 3], "name": f"Street {i % 5000}", "width": "3"}
            writer.add_way(Way(id=1 + i, nodes=refs, tags=tags))
        write_squares(writer, squares, 1 + len(ways))
    return number + 6 * len(squares), len(ways) + 2 * len(squares)


def write_corners(writer, side: int, number: int, at) -> list[tuple[list[int], list[int]]]:
    squares = []
    for x, y in [(i % side, i // side) for i in range(0, side * (side - 1), 20) if i % side < side - 1]:
        corners = [(0.8, 0.2), (0.2, 0.8), (0.45, 0.45), (0.55, 0.45), (0.55, 0.55), (0.45, 0.55)]
        for dx, dy in corners:
            number += 1
            writer.add_node(Node(id=number, location=at(x + dx, y + dy)))
        one, other = 1 + y * side + x, 1 + (y + 1) * side + x + 1
        hole = range(number - 3, number + 1)
        squares.append(([one, number - 5, other, number - 4, one], [*hole, hole[0]]))
    return squares


def write_squares(writer, squares, first: int) -> None:
    square = {"highway": "pedestrian", "area": "yes", "name": "Square"}
    for i, rings in enumerate(squares):
        for j, refs in enumerate(rings):
            writer.add_way(Way(id=first + 2 * i + j, nodes=refs, tags={} if i % 2 or j else square))
    for i in range(1, len(squares), 2):
        members = [("w", first + 2 * i, "outer"), ("w", first + 2 * i + 1, "inner")]
        writer.add_relation(Relation(id=i, members=members, tags={"type": "multipolygon", **square}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=243)
    side = parser.parse_args().side
    with tempfile.TemporaryDirectory() as folder:
        extract, saved = Path(folder) / "grid.osm.pbf", Path(folder) / "grid.npz"
        nodes, ways = write(extract, side)
        # Writing is done, but counts towards the peak; it needs less than importing.
        began, used = perf_counter(), process_time()
        town, report = import_osm(extract)
        took, worked, peak = (
            perf_counter() - began,
            process_time() - used,
            resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
        )
        print(
            f"{nodes:,} nodes, {ways:,} ways, {report.areas:,} areas: imported in {took:.1f} s, of which the "
            f"processors worked {worked:.1f} s, at most {peak:.2f} GiB"
        )
        save_town(town, saved)
        import jax  # noqa: F401 - its import is not what is timed

        began = perf_counter()
        again = load_town(saved)
        loaded = perf_counter() - began
        network = again.network()
        network.length.block_until_ready()
        whole = perf_counter() - began
        print(f"{network.segments:,} segments: loaded in {loaded:.2f} s, with the network {whole:.2f} s")


if __name__ == "__main__":
    main()
