"""Golden results of the whole program, to hold against while its code is moved about.

    python golden/golden.py write [NAME ...]    # run the commands and keep what they print
    python golden/golden.py check [NAME ...]    # run them again and say what differs

``HELSINKI_PBF`` names the extract of scripts/make_helsinki.py, for ``import-osm``. Times of day's work are left out.
"""

import hashlib
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
SEARCH = "random-walk,random-progress,shortest-path,expected,clairvoyant,greedy-local,greedy-map,snapshot,forecast"
ROUTE = ["route", "helsinki", "--from", "60.1719,24.9414", "--to", "60.1640,24.9480", "--depart", "2025-05-24T17:30"]
COMMANDS: dict[str, list[str]] = {
    **{
        f"compare-{name}": ["compare", name, "--planners", SEARCH, "--by", "60", "--json"]
        for name in ("paper-congested", "rush-16", "helsinki", "helsinki-signals")
    },
    "compare-exposure": [
        "compare", "helsinki", "--planners", "shortest-path,expected,greedy-map,snapshot,clairvoyant",
        "--objective", "exposure=0.5,max_density=4", "--walks", "20", "--json",
    ],
    "compare-shifting": ["compare", "shifting-crowds", "--planners", "greedy-local,snapshot", "--walks", "100", "--json"],
    "compare-unseen": ["compare", "unseen-maps", "--planners", "greedy-map", "--walks", "50", "--maps", "2", "--json"],
    "route-helsinki": [*ROUTE, "--by", "30", "--json"],
    "route-helsinki-snapshot": [*ROUTE, "--planner", "snapshot", "--json"],
    "route-helsinki-exposure": [*ROUTE, "--objective", "exposure=1", "--json"],
    "route-helsinki-text": ROUTE,
    "route-helsinki-geojson": [*ROUTE, "--format", "geojson"],
    "route-helsinki-gpx": [*ROUTE, "--format", "gpx"],
    "route-rush-16": ["route", "rush-16", "--depart", "30", "--by", "210", "--json"],
    "route-paper-text": ["route", "paper-congested"],
    "train-paper": ["train", "paper-congested", "--preset", "paper", "--rounds", "3", "--json"],
    "train-position": ["train", "paper-congested", "--rounds", "6", "--json"],
    **{
        f"train-{level}": ["train", "rush-16", "--level", level, "--rounds", "3", "--json"]
        for level in ("local", "map", "live")
    },
    **{
        f"train-helsinki-{level}": ["train", "helsinki", "--level", level, "--rounds", "2", "--json"]
        for level in ("map", "live")
    },
    "trade-off": ["trade-off", "helsinki", "--weights", "0,1", "--walks", "5", "--json", "--out", "{tmp}/picture.png"],
    "counts": ["counts", "--json"],
    "reproduce": ["reproduce", "--quick", "--out", "{tmp}/reproduction", "--json"],
    "import-osm": ["import-osm", "{pbf}", "--merge", "12", "--out", "{tmp}/town.npz", "--json"],
}  # fmt: skip
# What varies from run to run or from place to place.
LEFT_OUT = {
    "crowds",  # words alone
    "decision_us",
    "seconds",
    "steps_per_second",
    "updates_per_second",
    "model",
    "out",
    "picture",
    "source",
    "µs",
}
NEAR = 1e-6
# What was renamed, and what is new, since the results were written.
RENAMED = {"others": "baselines", "regret": "gap", "regret_ci95": "gap_ci95", "rival": "baseline"}
NEW = {
    "departure_minutes", "expected_crowds", "first_leg", "label", "minutes", "node", "segment", "synthetic",
    *("attribution", "baselines", "counted_sensors", "crowding", "crowds", "departs", "departure", "destination"),
    *("exposure", "hour_of_week", "legs", "mean_density", "objective", "origin", "scenario", "sensors", "steps"),
    "too_dense",
}  # fmt: skip
REWORDED = (
    r"─+|^\d+ streets, |, departing 0 min after the start|, paired with these streets by a seed \(synthetic\)"
    r"|\. Synthetic: [^.]*|that are (usual|expected) at|\.$"
)


def run(name: str) -> object:
    """What a command prints."""
    with tempfile.TemporaryDirectory() as folder:
        words = [
            word.format(tmp=folder, pbf=os.environ.get("HELSINKI_PBF", "")) if "{" in word else word
            for word in COMMANDS[name]
        ]
        done = subprocess.run(
            [sys.executable, "-m", "sidestep", *words], capture_output=True, text=True, check=False, timeout=3000
        )
        if done.returncode:
            raise SystemExit(f"{name}: exit {done.returncode}: {done.stderr.strip()}")
        try:
            found = json.loads(done.stdout)
        except ValueError:
            found = done.stdout.splitlines()
        if name == "import-osm":
            found["sha256"] = hashlib.sha256((Path(folder) / "town.npz").read_bytes()).hexdigest()
        return found


def plain(value: object) -> object:
    """Without what varies."""
    if isinstance(value, dict):
        return {RENAMED.get(key, key): plain(item) for key, item in value.items() if key not in LEFT_OUT}
    return [plain(item) for item in value] if isinstance(value, list) else value


def words(line: str) -> str:
    """A line of text without its layout, and without what is said otherwise."""
    return " ".join(re.sub(REWORDED, "", line.strip()).split())


def differences(old: object, new: object, where: str = "") -> list[str]:
    """Where two results differ by more than rounding."""
    if isinstance(old, dict) and isinstance(new, dict):
        lines = [f"{where}: gone: {key} (was {old[key]!s:.80})" for key in old.keys() - new.keys()]
        lines += [f"{where}: new: {key} = {new[key]!s:.80}" for key in new.keys() - old.keys() - NEW]
        return lines + [line for key in old if key in new for line in differences(old[key], new[key], f"{where}/{key}")]
    if isinstance(old, list) and all(isinstance(line, str) for line in old):
        text = "\n".join(map(words, new))
        return [f"{where}: no longer there: {line}" for line in map(words, old) if line not in text]
    if isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            return [f"{where}: {len(old)} items, now {len(new)}"]
        return [
            line for n, pair in enumerate(zip(old, new, strict=True)) for line in differences(*pair, f"{where}[{n}]")
        ]
    numbers = isinstance(old, int | float) and isinstance(new, int | float)
    if old == new or (numbers and math.isclose(old, new, rel_tol=NEAR)):
        return []
    return [f"{where}: {old!r} -> {new!r}"]


def main() -> None:
    """Write or check."""
    what, *names = sys.argv[1:]
    for name in names or COMMANDS:
        file = HERE / f"{name}.json"
        found = plain(run(name))
        if what == "write":
            file.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
            print(f"{name}: written", flush=True)
            continue
        found = differences(plain(json.loads(file.read_text(encoding="utf-8"))), found)
        other = sum(": new: " not in line for line in found)
        print(
            f"{name}: {f'{other} differences' if other else 'the same, and new keys' if found else 'the same'}",
            flush=True,
        )
        for line in found[:40]:
            print(f"    {line}", flush=True)


main()
