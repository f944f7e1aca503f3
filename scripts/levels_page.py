"""Train an agent at every level, compare it with the planners that know as much, and write docs/levels.md.

Usage: python scripts/levels_page.py FOLDER

The trainings are those of examples/studies/levels.toml. What is in FOLDER already is neither trained nor walked again.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from trainings import DOCS, SEEDS, SEEDS_IN_WORDS, agents_table, costs, kept, models, planners_table, swept

from sidestep.agent.checkpoint import load_model
from sidestep.evaluation.compare import Comparison, compare
from sidestep.evaluation.metrics import cells
from sidestep.evaluation.trainings import mean_rows
from sidestep.experiments.sweep import Swept
from sidestep.files import write_text
from sidestep.planners.learned import trained_darp
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.builtin import BUILT_IN

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


TOWN = "helsinki"
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


def main(folder: Path) -> None:
    """Train, compare, write."""
    found = swept("levels", folder)
    write_page(found, kept(folder / "margins.json", partial(margins, found, folder)))


def margins(found: Swept, folder: Path) -> dict[str, Any]:
    """The agents of a town, deployed with and without their margins: comparisons by level, one for each seed."""
    problem, results = BUILT_IN[TOWN], {}
    for level, untrained in MARGINS.items():
        results[level] = []
        for seed, where in zip(SEEDS, models(found, folder, TOWN, level), strict=True):
            model = load_model(where)
            agents = {name: trained_darp(model.changed(**changes)) for name, changes in DEPLOYED.items()}
            factories = choose_planners(problem, [untrained]).factories
            factories |= {name: lambda *_, agent=agent: agent for name, agent in agents.items()}
            compared = compare(problem, factories, maps=[0], walks=MARGIN_WALKS, seed=seed)
            margin = {"margin": model.metadata.config.correction_margin_seconds}
            results[level].append(compared.to_json(baseline="darp") | margin)
    return results


def judged(goal: Goal, compared: Sequence[Comparison]) -> dict[str, Any]:
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


def write_page(found: Swept, deployed: dict[str, Any]) -> None:
    """docs/levels.md from what the study found."""
    page = PAGE.format(seeds=SEEDS_IN_WORDS, freedom=len(SEEDS) - 1)
    page += "| scenario | agent | goal | measured | |\n|---|---|---|---|---|\n"
    every = {name: compared for name, compared in found.comparisons.items() if name != TOWN}
    for scenario, compared in every.items():
        for goal in (goal for goal in GOALS if goal.scenario == scenario):
            judgement = judged(goal, compared)
            page += verdict(scenario, goal.row, goal.text, judgement["found"], judgement["met"])
        for name in (name for name in compared[0].records if name.startswith("darp")):
            rates = [float(each.records[name].arrived.mean()) for each in compared]
            text = ", ".join(f"{rate:.4f}" for rate in rates)
            page += verdict(scenario, name, "arrival at least 0.999", text, [rate >= 0.999 for rate in rates])
        trained = [job for job in found.study.jobs if job.agent is not None and job.scenario.name == scenario]
        seconds = [found.results[job.name]["took"]["seconds"] for job in trained]
        text = f"at most {max(seconds):.0f} s"
        page += verdict(scenario, "all", "trained within 120 s", text, [each <= 120 for each in seconds])
    page += "\n## Results\n"
    for scenario in every:
        page += section(found, scenario)
    write_text(DOCS / "levels.md", page + margins_section(deployed))


def verdict(case: str, row: str, goal: str, found: str, met: Sequence[bool]) -> str:
    """One line of the table of goals."""
    missed = f"**missed** by {met.count(False)} of {len(met)}"
    return f"| {case} | {row} | {goal} | {found} | {'met' if all(met) else missed} |\n"


def section(found: Swept, scenario: str) -> str:
    """One scenario's tables."""
    results = [each.to_json() for each in found.comparisons[scenario]]
    maps, walks, summary = (results[0][name] for name in ("maps", "walks", "summary"))
    text = f"\n### {scenario}\n\n{summary[0].upper()}{summary[1:]}. "
    text += f"For each seed {maps} map{'s' * (maps > 1)}, {walks:,} walks{' on each' * (maps > 1)}.\n\n"
    return text + costs(found, scenario) + planners_table(results) + "\n" + agents_table(results)


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
    main(Path(sys.argv[1]))
