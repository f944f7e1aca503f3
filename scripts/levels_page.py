"""Train an agent at every level, compare it with the planners that know as much, and write docs/levels.md.

Usage: python scripts/levels_page.py FOLDER [SCENARIO ...] [--walks N]

Models that are in FOLDER already are not trained again, and comparisons that are there are not walked again. The page
is written when all scenarios have been compared. ``--walks`` takes fewer walks on each map, for a quick look.
"""

import argparse
import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from keep_models import trained

from sidestep.agent.checkpoint import load_model
from sidestep.agent.presets import preset_for
from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import Row, cells
from sidestep.files import write_text
from sidestep.planners.learned import trained_darp
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
MARGIN_COLUMNS = ("planner", "minutes", "difference", "difference 95 %", "gap", "arrive")
COLUMNS = (
    "planner", "knows", "minutes", "median", "90 %", "difference", "difference 95 %", "gap", "arrive",
)  # fmt: skip
PAGE = """# Levels of knowledge

This page says what walkers know at each level of knowledge, and how much a trained agent gains over the planners that
know as much.

```sh
python scripts/levels_page.py levels   # trains all agents (folder levels/), walks all comparisons, writes this page
```

A *level* is what a planner may know. One algorithm, `darp`, learns at each of the four levels below hindsight; every
other planner states its level and is compared with those of the same level.

| level | what the walker observes (`sidestep.environment.types.Observation`) | its own estimate of the time to the destination | planners of the level |
|---|---|---|---|
| `position` | the crossing, x and y (m), the exits that may be taken | none | `random-walk`, `random-progress` |
| `local` | + the clock (s) and the way to the destination (m); for each segment that leaves: its length (m), the time to cross it in the crowd and with the gates and lights seen now (s), where it leads (m), how many steps ago its end was left (eight crossings are remembered) | each segment as seen now, then a straight line at free speed | `greedy-local` |
| `map` | + for each segment that leaves: its expected time now (s), and the expected time from its end to the destination (s) | each segment as seen now, then the path of least expected time | `shortest-path`, `expected`, `greedy-map` |
| `live` | + for each segment that leaves: the time to the destination if all crowds stay as counted now, and if they go on as forecast (s) | the forecast | `snapshot`, `forecast` |
| hindsight | the whole future | | `clairvoyant`, which nobody beats |

Beyond `position` the network scores each segment that leaves: Q = -estimate + V(state) + A(segment) - mean A, with one
small network for all segments of all crossings. Its last layers begin at zero, so an untrained agent walks exactly like
`greedy-local`, `greedy-map` or `forecast` (a test holds that), and what is learned is what is gained. Where the map is
always the same, agents of the levels `local` and `map` also learn four to eight numbers for each crossing and quarter of
an hour, and can walk that map only. Agents of level `live`, and all that are trained on several maps, can walk any grid.
[Towns](towns.md) whose crowds are interpolated between counters show walkers more, and need agents of their own.

Streets for those only whose walk begins or ends there ([streets](streets.md)) are no exits of other walks: at every level,
and in every search, a restricted area may be left, and entered only by walks that end in it. Walkers wait before streets
that are shut ([gates](traffic.md#gates)).

What is *expected* is the mean of the times to cross a street over futures that serve no other purpose, not the time in the mean
crowd: streets that jam in some futures take longer than that ([`scenarios/expectation.py`](../src/sidestep/scenarios/expectation.py)).
The plan of `expected` and the costs of the levels `map` and `live` are made of these times.

The time to the destination is worked out backwards in time, for all crossings and hours in one pass
([`environment/cost_to_go.py`](../src/sidestep/environment/cost_to_go.py)). It is linear within slots of five minutes;
[the benchmark](../benchmarks/README.md) says how far that is from exact search, and how long the live feed takes.

## How agents are trained and compared

Training goes in *rounds*: a fixed number of environment steps, followed by greedy test walks. Agents train on futures of
their own. The walks below meet other futures, and the maps of `unseen-maps` are others than those trained on. Walks are
compared one by one with those of the baseline; intervals are 95 % bootstrap intervals over walks, or over maps where
there are several. A walk that does not arrive by the horizon counts as the horizon. Snapshots and forecasts are worked
out before the walks. The column *over the clairvoyant* is the *gap*: how much longer the planner takes than the
clairvoyant, in per cent.

## Goals

"Not slower" is met where the interval does not lie above zero, "faster" where all of it lies below. All settings were
chosen by walks on the map of seed 0; the agents here were trained and walked with seed {seed}, on another map.

"""
SEED = 1
HEAD = "| planner | level | minutes | median | 90 % in | over `expected` | 95 % | over the clairvoyant | arrive |\n"
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


MARGINS = {"map": "greedy-map", "live": "forecast"}  # level: its planner without training
MARGIN_WALKS = 100
DEPLOYED: dict[str, dict[str, Any]] = {
    "darp": {},
    "without the margin": {"correction_margin_seconds": 0.0},
    "without the estimate when revisiting": {"estimate_when_revisiting": False},
    "without both": {"correction_margin_seconds": 0.0, "estimate_when_revisiting": False},
}
MARGINS_TEXT = """
## Margins in towns

Where crowds are interpolated between counters, streets are short and alike, and what is learned about them is small
against the walk. Deployed agents therefore leave the level's own estimate only for a correction that saves some seconds
(`correction_margin_seconds`: {map} s at level `map`, {live} s at level `live`, whose forecasts are nearly exact), and
follow the estimate where a walk comes back to a crossing (`estimate_when_revisiting`): estimates never lead in circles,
corrections may. Both are settings of [`TrainConfig`](../src/sidestep/agent/config.py) and options of `train`; training
itself has no margins, so the agents below are the same network, deployed with and without them. `helsinki`, map 0, seed
{seed}; differences are minutes over `darp` as deployed.

"""


def main() -> None:
    """Train, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenarios", nargs="*", default=[*CASES, "margins"])
    parser.add_argument("--walks", type=int, help="on each map, instead of each scenario's own number")
    options = parser.parse_args()
    for name in options.scenarios:
        target = options.folder / f"{name}.json"
        if not target.exists():
            make = margins if name == "margins" else partial(run, CASES[name])
            write_text(target, json.dumps(make(options.folder / name, options.walks), indent=2) + "\n")
    if all((options.folder / f"{name}.json").exists() for name in (*CASES, "margins")):
        write_page(options.folder)


def run(case: Case, folder: Path, walks: int | None) -> dict[str, Any]:
    """One scenario: its models, then one comparison of all."""
    problem, cost = BUILT_IN[case.scenario], {}
    for level in case.levels:
        found = trained(folder / level, problem, preset_for(problem, "default", level), SEED)
        cost[level] = {key: found[key] for key in ("seconds", "steps_per_second", "updates_per_second")}
        cost[level]["rounds"] = len(found["curve_minutes"])
    chosen = choose_planners(problem, PLANNERS, models=[folder / level for level in case.levels], seed=SEED)
    compared = compare(problem, chosen.factories, maps=chosen.map_numbers(), walks=walks or case.walks, seed=SEED)
    goals = [{**asdict(goal), **judged(goal, compared)} for goal in GOALS if goal.scenario == case.scenario]
    return {"trained": cost, **compared.to_json(), "goals": goals}


def margins(folder: Path, walks: int | None) -> dict[str, Any]:
    """The agents of a town, deployed with and without their margins."""
    problem, results = BUILT_IN["helsinki"], {}
    for level, untrained in MARGINS.items():
        trained(folder / level, problem, preset_for(problem, "default", level), SEED)
        model = load_model(folder / level)
        agents = {name: trained_darp(model.changed(**changes)) for name, changes in DEPLOYED.items()}
        factories = choose_planners(problem, [untrained]).factories
        factories |= {name: lambda *_, agent=agent: agent for name, agent in agents.items()}
        compared = compare(problem, factories, maps=[0], walks=walks or MARGIN_WALKS, seed=SEED)
        results[level] = compared.to_json(baseline="darp")
        results[level]["margin"] = model.metadata.config.correction_margin_seconds
    return results


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
        slowest = max(cost["seconds"] for cost in found["trained"].values())
        page += verdict(name, "all", "trained within 120 s", f"at most {slowest:.0f} s", met=slowest <= 120)
    page += "\n## Results\n"
    for name, found in results.items():
        page += section(name, found)
    page += margins_section(json.loads((folder / "margins.json").read_text(encoding="utf-8")))
    write_text(DOCS / "levels.md", page)


def verdict(case: str, row: str, goal: str, found: str, *, met: bool) -> str:
    """One line of the table of goals."""
    return f"| {case} | {row} | {goal} | {found} | {'met' if met else '**missed**'} |\n"


def section(name: str, found: dict[str, Any]) -> str:
    """One scenario's table."""
    maps, walks = found["maps"], found["walks"]
    summary = BUILT_IN[CASES[name].scenario].summary
    text = f"\n### {name}\n\n{summary[0].upper()}{summary[1:]}. "
    text += f"{maps} map{'s' * (maps > 1)}, {walks:,} walks{' on each' * (maps > 1)}.\n\n"
    for level, cost in found["trained"].items():
        text += (
            f"`sidestep train {CASES[name].scenario} --level {level} --seed {SEED}`: {cost['seconds']:.0f} s with "
            f"compiling ({cost['rounds']} rounds, {cost['steps_per_second']:,.0f} transitions and "
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


def margins_section(found: dict[str, Any]) -> str:
    """What margins are worth."""
    text = MARGINS_TEXT.format(seed=SEED, **{level: f"{each['margin']:g}" for level, each in found.items()})
    text += "| level | walks | agent | minutes | difference | 95 % | over the clairvoyant | arrive |\n"
    text += "|---|--:|---|--:|--:|--:|--:|--:|\n"
    for level, each in found.items():
        for name in (*DEPLOYED, MARGINS[level], "expected"):
            texts = cells(name, each["planners"][name], 1, MARGIN_COLUMNS)
            text += f"| `{level}` | {each['walks']} | {' | '.join(texts.values())} |\n"
    return text


if __name__ == "__main__":
    main()
