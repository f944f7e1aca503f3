"""Train an agent at every level, compare it with the planners that know as much, and write docs/levels.md.

Usage: python scripts/levels_page.py FOLDER [SCENARIO ...]

Models that are in FOLDER already are not trained again, and comparisons that are there are not walked again. The page
is written when all scenarios have been compared.
"""

import argparse
import json
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import Row, cells
from sidestep.files import write_text
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.builtin import BUILT_IN

DOCS = Path(__file__).parents[1] / "docs"


@dataclass(frozen=True)
class Case:
    """Agents to train on a scenario, and the walks to compare them on: more where differences are small."""

    scenario: str
    levels: tuple[str, ...]
    walks: int  # on each map


CASES = {
    "paper-unblocked": Case("paper-unblocked", ("local",), 1_000),
    "paper-congested": Case("paper-congested", ("local",), 1_000),
    "rush-16": Case("rush-16", ("local", "map", "live"), 1_600),
    "rush-32": Case("rush-32", ("live",), 500),
    "shifting-crowds": Case("shifting-crowds", ("local",), 600),
    "unseen-maps": Case("unseen-maps", ("map",), 100),
}
PLANNERS = (
    "shortest-path", "greedy-local", "expected", "greedy-map", "snapshot", "forecast", "clairvoyant",
)  # fmt: skip
COLUMNS = (
    "planner", "knows", "minutes", "median", "90 %", "difference", "difference 95 %", "gap", "arrive",
)  # fmt: skip
PAGE = """# Four levels of knowledge

```sh
python scripts/levels_page.py levels   # trains all agents (folder levels/), walks all comparisons, writes this page
```

One algorithm at four levels. Every planner states what it knows and is set beside those that know as much.

| level | the walker sees (`sidestep.environment.types.Observation`) | estimates the time to its destination as | planners of the level |
|---|---|---|---|
| `position` | its crossing, x and y in metres, which exits there are | not at all | `random-walk`, `random-progress` |
| `local` | + the clock, s; where the destination lies, m; of each street that leaves: length, m, the time to cross it at the speed and with the lights seen on it now, s, where it leads, m; how long ago each next crossing was left (it remembers eight) | the time to cross each street as seen now, and a straight line at free speed | `greedy-local` |
| `map` | + the usual time to cross each street now, s; the expected time to go from each next crossing at the time of reaching it, s | the time to cross as seen now, and the fastest way through the expected crowds | `shortest-path`, `expected`, `greedy-map` |
| `live` | + the time over each street if all crowds stay as counted now, and if they go on as forecast from the counts, s | the forecast | `snapshot`, `forecast` |
| hindsight | the future | | `clairvoyant`, the bound |

Beyond `position` the network scores street by street: Q(street) = -estimate + V(state) + A(street) - mean A, with one
small network for all streets of all crossings. The last layers begin at zero, so an untrained agent walks exactly like
`greedy-local`, `greedy-map` or `forecast` (a test holds that): what is learned is what is gained over them. Where the
map is always the same, the agents of the levels `local` and `map` also remember four to eight numbers for each crossing
and quarter of an hour; then they can walk that map only. `live` and everything that is trained on several maps
remembers none, and can walk any map.

Times to go are time-dependent potentials ([`environment/potentials.py`](../src/sidestep/environment/potentials.py)):
one pass by decreasing time for all origins and departures. They are linear within slots of five minutes;
[the benchmark](../benchmarks/README.md) says how far that is from exact search, and how long the live feed takes.

Agents train on crowds of their own. Those of the walks below come from another random stream (`learn` and `test` are
part of every key), and the maps of `unseen-maps` from another stream than those trained on. Differences are paired walk
by walk; intervals are 95 % bootstraps over walks, or over maps where there are several. Walks that have not arrived by
the horizon count as the horizon. The live feed (snapshots and forecasts of every slot) is worked out before the walks.

## Goals

"Not slower" is met where the interval does not lie above zero, "faster" where all of it lies below. All settings were
chosen by walks on the map of seed 0; the agents here were trained and walked with seed {seed}, on another map.

"""
SEED = 1
HEAD = "| planner | knows | minutes | median | 90 % in | over `expected` | 95 % | over the clairvoyant | arrive |\n"
HEAD += "|---|---|--:|--:|--:|--:|--:|--:|--:|\n"


@dataclass(frozen=True)
class Goal:
    """What was aimed at: a row that is to be faster than another, or part of the way from one to the next."""

    scenario: str
    row: str
    text: str
    baseline: str
    towards: str = ""  # a share of the way from `baseline` to here
    share: float = 0.0
    strictly: bool = True  # the whole interval below zero, or only not above


GOALS = [
    Goal("paper-unblocked", "darp", "not slower than `expected`", "expected", strictly=False),
    Goal("paper-unblocked", "darp", "aim: half of the way from `expected` to `forecast`", "expected", "forecast", 0.5),
    Goal("paper-congested", "darp", "not slower than `expected`", "expected", strictly=False),
    Goal("paper-congested", "darp", "aim: half of the way from `expected` to `forecast`", "expected", "forecast", 0.5),
    Goal("rush-16", "darp-local", "faster than `expected`", "expected"),
    Goal("rush-16", "darp-local", "aim: not slower than `snapshot`", "snapshot", strictly=False),
    Goal("rush-16", "darp-map", "faster than `expected`", "expected"),
    Goal("rush-16", "darp-map", "faster than untrained (`greedy-map`)", "greedy-map"),
    Goal("rush-16", "darp-live", "not slower than `forecast`", "forecast", strictly=False),
    Goal("rush-16", "darp-live", "aim: faster than `forecast`", "forecast"),
    Goal("rush-32", "darp", "not slower than `forecast`", "forecast", strictly=False),
    Goal("rush-32", "darp", "aim: faster than `forecast`", "forecast"),
    Goal(
        "shifting-crowds", "darp", "half of the way from `greedy-local` to `snapshot`", "greedy-local", "snapshot", 0.5
    ),
    Goal("unseen-maps", "darp", "faster than `expected`", "expected"),
]


def main() -> None:
    """Train, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenarios", nargs="*", default=list(CASES))
    options = parser.parse_args()
    for name in options.scenarios:
        run(name, CASES[name], options.folder)
    if all((options.folder / f"{name}.json").exists() for name in CASES):
        write_page(options.folder)


def run(name: str, case: Case, folder: Path) -> None:
    """One scenario: its models, then one comparison of all."""
    target = folder / f"{name}.json"
    if target.exists():
        return
    models, seconds = [], {}
    for level in case.levels:
        model = folder / name / level
        if not (model / "trained.json").exists():
            command = [
                sys.executable,
                "-m",
                "sidestep",
                *training(case, level),
                "--seed",
                str(SEED),
                "--out",
                str(model),
                "--json",
            ]
            began = perf_counter()
            trained = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            trained["process_seconds"] = perf_counter() - began
            write_text(model / "trained.json", json.dumps(trained))
        trained = json.loads((model / "trained.json").read_text(encoding="utf-8"))
        seconds[level] = {key: trained[key] for key in ("process_seconds", "steps_per_second", "updates_per_second")}
        seconds[level]["rounds"] = len(trained["curve_minutes"])
        models.append(model)
    problem = BUILT_IN[case.scenario]
    chosen = choose_planners(problem, PLANNERS, models=models, seed=SEED)
    compared = compare(problem, chosen.factories, maps=chosen.map_numbers(), walks=case.walks, seed=SEED)
    results = {"trained": seconds, **compared.to_json()}
    results["goals"] = [{**asdict(goal), **judged(goal, compared)} for goal in GOALS if goal.scenario == name]
    write_text(target, json.dumps(results, indent=2) + "\n")


def training(case: Case, level: str) -> list[str]:
    """The command, without its output."""
    return ["train", case.scenario, "--level", level]


def judged(goal: Goal, compared: object) -> dict[str, object]:
    """The paired difference that a goal is about, and whether it is met."""
    rows = compared.to_json(baseline=goal.baseline)["planners"]
    row = rows[goal.row]
    less, more = row["difference_ci95"]
    difference = row["difference_minutes"]
    if goal.towards:
        share = difference / rows[goal.towards]["difference_minutes"]
        return {"found": f"{100 * share:.0f} % of the way", "met": share >= goal.share}
    met = more < 0 if goal.strictly else less <= 0
    return {"found": f"{difference:+.2f} min ({less:+.2f} to {more:+.2f})", "met": met}


def write_page(folder: Path) -> None:
    """docs/levels.md from the numbers in the folder."""
    page = PAGE.replace("{seed}", str(SEED))
    results = {name: json.loads((folder / f"{name}.json").read_text(encoding="utf-8")) for name in CASES}
    page += "| scenario | agent | goal | measured | |\n|---|---|---|---|---|\n"
    for name, found in results.items():
        for goal in found["goals"]:
            page += verdict(name, goal["row"], goal["text"], goal["found"], met=goal["met"])
        for row, measured in found["planners"].items():
            if row.startswith("darp"):
                rate = measured["arrival_rate"]
                page += verdict(name, row, "arrival at least 0.999", f"{rate:.4f}", met=rate >= 0.999)
        slowest = max(cost["process_seconds"] for cost in found["trained"].values())
        page += verdict(name, "all", "trained within 120 s", f"at most {slowest:.0f} s", met=slowest <= 120)
    page += "\n## Results\n"
    for name, found in results.items():
        page += section(name, found)
    write_text(DOCS / "levels.md", page)


def verdict(case: str, row: str, goal: str, found: str, *, met: bool) -> str:
    """One line of the table of goals."""
    return f"| {case} | {row} | {goal} | {found} | {'met' if met else '**missed**'} |\n"


def section(name: str, found: dict[str, object]) -> str:
    """One scenario's table."""
    maps, walks = found["maps"], found["walks"]
    case, summary = CASES[name], BUILT_IN[CASES[name].scenario].summary
    text = f"\n### {name}\n\n{summary[0].upper()}{summary[1:]}. "
    text += f"{maps} map{'s' * (maps > 1)}, {walks} walks{' on each' * (maps > 1)}.\n\n"
    for level, cost in found["trained"].items():
        text += (
            f"`sidestep {' '.join(training(case, level))} --seed {SEED}`: {cost['process_seconds']:.0f} s from process start "
            f"({cost['rounds']} rounds, {cost['steps_per_second']:,.0f} transitions and "
            f"{cost['updates_per_second']:,.0f} updates a second).\n\n"
        )
    text += HEAD
    rows: dict[str, Row] = found["planners"]
    for planner, row in sorted(rows.items(), key=lambda item: -item[1]["mean_minutes"]):
        texts = cells(planner, row, maps, COLUMNS)
        if planner.startswith("darp"):
            texts["planner"] = f"**{planner}**"
        text += f"| {' | '.join(texts.values())} |\n"
    return text


if __name__ == "__main__":
    main()
