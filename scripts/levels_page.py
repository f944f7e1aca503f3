"""Train an agent at every level, compare it with the planners that know as much, and write docs/levels.md.

Usage: python scripts/levels_page.py FOLDER [SCENARIO ...] [--walks N]

Models that are in FOLDER already are not trained again, and comparisons that are there are not walked again. The page
is written when all scenarios have been compared. ``--walks`` takes fewer walks on each map, for a quick look.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from trainings import DOCS, SEEDS, SEEDS_IN_WORDS, Case, agents_table, costs, kept, planners_table

from sidestep.agent.checkpoint import load_model
from sidestep.evaluation.compare import Comparison, compare
from sidestep.evaluation.metrics import cells
from sidestep.evaluation.trainings import mean_rows
from sidestep.files import write_text
from sidestep.planners.learned import trained_darp
from sidestep.planners.registry import choose_planners

PLANNERS = (
    "shortest-path", "greedy-local", "expected", "greedy-map", "snapshot", "forecast", "clairvoyant",
)  # fmt: skip
CASES = [
    Case("paper-unblocked", ("local",), 1_000, PLANNERS),
    Case("paper-congested", ("local",), 1_000, PLANNERS),
    Case("rush-16", ("local", "map", "live"), 1_600, PLANNERS),
    Case("rush-32", ("live",), 250, PLANNERS),
    Case("shifting-crowds", ("local",), 300, PLANNERS),
    Case("unseen-maps", ("map",), 50, PLANNERS),
]
MARGIN_COLUMNS = ("planner", "minutes", "difference", "difference 95 %", "gap", "arrive")
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
| `local` | + the clock (s) and the way to the destination (m); for each segment that leaves: its length (m), the time to cross it in the crowd and with the gates and lights seen now (s), where it leads (m), how many steps ago its end was left (eight crossings are remembered) | each segment as seen now, then a straight line at free speed | `greedy-local`, `lrta-star` |
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
compared one by one with those of the baseline. A walk that does not arrive by the horizon counts as the horizon. Snapshots
and forecasts are worked out before the walks. The column *over the clairvoyant* is the *gap*: how much longer the planner
takes than the clairvoyant, in per cent.

Every agent was trained three times, with seeds {seeds}: each time on another map, through other crowds, on one core of two
while other trainings used the other. The first table of each scenario has means over the seeds, with 95 % intervals over the
seeds (Student's, with {freedom} degrees of freedom, hence wide): they cover chance in maps, crowds and trainings. The second
table has each training by itself, with 95 % bootstrap intervals over its walks, or over maps where there are several.

## Goals

A goal is met where every training meets it: "not slower" where the interval over its walks does not lie wholly above zero,
"faster" where it lies wholly below, a share of the way by the means. Lists of three are in the order of the seeds. All
settings were chosen by walks on the map of seed 0. The 120 s of a training were meant for two cores; these trainings had one.

"""


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
itself has no margins, so the agents below are the same network, deployed with and without them. `helsinki`, means over
the three trainings; differences are minutes over `darp` as deployed.

"""


def main() -> None:
    """Train, compare, write."""
    known = {case.scenario: partial(run, case) for case in CASES} | {"margins": margins}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenarios", nargs="*", default=[*known])
    parser.add_argument("--walks", type=int, help="on each map, instead of each scenario's own number")
    options = parser.parse_args()
    for name in options.scenarios:
        kept(options.folder / f"{name}.json", partial(known[name], options.folder, options.walks))
    if all((options.folder / f"{name}.json").exists() for name in known):
        write_page(options.folder)


def run(case: Case, folder: Path, walks: int | None) -> dict[str, Any]:
    """One scenario: its models, then one comparison of all for each seed."""
    took = case.trained(folder / case.scenario)
    compared = case.compared(folder / case.scenario, walks)
    goals = [{**asdict(goal), **judged(goal, compared)} for goal in GOALS if goal.scenario == case.scenario]
    return {"trained": took, "compared": [each.to_json() for each in compared], "goals": goals}


def margins(folder: Path, walks: int | None) -> dict[str, Any]:
    """The agents of a town, deployed with and without their margins: comparisons by level, one for each seed."""
    case, results = Case("helsinki", tuple(MARGINS), walks or MARGIN_WALKS, ()), {}
    case.trained(folder / case.scenario)
    for at, (level, untrained) in enumerate(MARGINS.items()):
        results[level] = []
        for seed in SEEDS:
            model = load_model(case.models(folder / case.scenario, seed)[at])
            agents = {name: trained_darp(model.changed(**changes)) for name, changes in DEPLOYED.items()}
            factories = choose_planners(case.problem, [untrained]).factories
            factories |= {name: lambda *_, agent=agent: agent for name, agent in agents.items()}
            compared = compare(case.problem, factories, maps=[0], walks=case.walks, seed=seed)
            margin = {"margin": model.metadata.config.correction_margin_seconds}
            results[level].append(compared.to_json(baseline="darp") | margin)
    return results


def judged(goal: Goal, compared: Sequence[Comparison]) -> dict[str, object]:
    """The paired differences that a goal is about, one for each seed, and which of them meet it."""
    found, met = [], []
    for rows in (each.to_json(baseline=goal.baseline)["planners"] for each in compared):
        row = rows[goal.row]
        less, more = row["difference_ci95"]
        difference = row["difference_minutes"]
        if goal.towards:
            whole = rows[goal.towards]["difference_minutes"]
            share = difference / whole
            found.append(f"{100 * share:.0f}")
            met.append(whole < 0 and share >= goal.share)
        else:
            found.append(f"{difference:+.2f} ({less:+.2f} to {more:+.2f})")
            met.append(more < 0 if goal.strictly else less <= 0)
    return {"found": f"{', '.join(found)} {'% of the way' if goal.towards else 'min'}", "met": met}


def write_page(folder: Path) -> None:
    """docs/levels.md from the numbers in the folder."""
    page = PAGE.format(seeds=SEEDS_IN_WORDS, freedom=len(SEEDS) - 1)
    results = {case: json.loads((folder / f"{case.scenario}.json").read_text(encoding="utf-8")) for case in CASES}
    page += "| scenario | agent | goal | measured | |\n|---|---|---|---|---|\n"
    for case, found in results.items():
        for goal in found["goals"]:
            page += verdict(case.scenario, goal["row"], goal["text"], goal["found"], goal["met"])
        for name in (name for name in found["compared"][0]["planners"] if name.startswith("darp")):
            rates = [each["planners"][name]["arrival_rate"] for each in found["compared"]]
            text = ", ".join(f"{rate:.4f}" for rate in rates)
            page += verdict(case.scenario, name, "arrival at least 0.999", text, [rate >= 0.999 for rate in rates])
        seconds = [one["seconds"] for each in found["trained"].values() for one in each]
        text = f"at most {max(seconds):.0f} s"
        page += verdict(case.scenario, "all", "trained within 120 s", text, [each <= 120 for each in seconds])
    page += "\n## Results\n"
    for case, found in results.items():
        page += section(case, found)
    page += margins_section(json.loads((folder / "margins.json").read_text(encoding="utf-8")))
    write_text(DOCS / "levels.md", page)


def verdict(case: str, row: str, goal: str, found: str, met: Sequence[bool]) -> str:
    """One line of the table of goals."""
    missed = f"**missed** by {met.count(False)} of {len(met)}"
    return f"| {case} | {row} | {goal} | {found} | {'met' if all(met) else missed} |\n"


def section(case: Case, found: dict[str, Any]) -> str:
    """One scenario's tables."""
    first = found["compared"][0]
    maps, walks = first["maps"], first["walks"]
    summary = case.problem.summary
    text = f"\n### {case.scenario}\n\n{summary[0].upper()}{summary[1:]}. "
    text += f"For each seed {maps} map{'s' * (maps > 1)}, {walks:,} walks{' on each' * (maps > 1)}.\n\n"
    text += costs(case.scenario, found["trained"])
    return text + planners_table(found["compared"]) + "\n" + agents_table(found["compared"])


def margins_section(found: dict[str, Any]) -> str:
    """What margins are worth."""
    text = MARGINS_TEXT.format(**{level: f"{each[0]['margin']:g}" for level, each in found.items()})
    text += "| level | walks | agent | minutes | difference | 95 % | over the clairvoyant | arrive |\n"
    text += "|---|--:|---|--:|--:|--:|--:|--:|\n"
    for level, each in found.items():
        rows = mean_rows(each)
        for name in (*DEPLOYED, MARGINS[level], "expected"):
            texts = cells(name, rows[name], 1, MARGIN_COLUMNS)
            text += f"| `{level}` | {len(each)} x {each[0]['walks']} | {' | '.join(texts.values())} |\n"
    return text


if __name__ == "__main__":
    main()
