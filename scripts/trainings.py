"""The same agents from several trainings, for the pages of the documentation: sweeps of the studies in examples."""

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sidestep.evaluation.metrics import Row, cells, percent
from sidestep.evaluation.trainings import mean_rows
from sidestep.experiments.study import read_study
from sidestep.experiments.sweep import Swept, sweep
from sidestep.files import write_text

DOCS = Path(__file__).parents[1] / "docs"
STUDIES = Path(__file__).parents[1] / "examples" / "studies"
SEEDS = (1, 2, 3)
SEEDS_IN_WORDS = "1, 2 and 3"
TOOK = ("seconds", "steps_per_second", "updates_per_second")
COLUMNS = (
    "planner", "knows", "minutes", "median", "90 %", "difference", "difference 95 %", "gap", "arrive",
)  # fmt: skip


def swept(study: str, folder: Path) -> Swept:
    """All that a study of that name finds; what is in the folder already is not done again."""
    found = sweep(read_study(STUDIES / f"{study}.toml"), folder, workers=os.cpu_count() or 1)
    if found.failed:
        raise SystemExit("\n".join(f"{name}: {error}" for name, error in found.failed.items()))
    return found


def models(found: Swept, folder: Path, scenario: str, level: str) -> list[Path]:
    """Where a level's agents of a scenario are, one for each seed."""
    jobs = [job for job in found.study.jobs if job.agent is not None and job.scenario.name == scenario]
    return [folder / job.name for job in jobs if job.agent is not None and job.agent.config.level == level]


def kept(target: Path, make: Callable[[], Any]) -> Any:
    """What is in a file of JSON, which is made if it is missing."""
    if not target.exists():
        write_text(target, json.dumps(make(), indent=2) + "\n")
    return json.loads(target.read_text(encoding="utf-8"))


def planners_table(results: Sequence[dict[str, Any]]) -> str:
    """All planners, slowest first: means over the seeds' comparisons."""
    text = "| planner | level | minutes | median | 90 % in | over `expected` | 95 % | over the clairvoyant | arrive |\n"
    text += "|---|---|--:|--:|--:|--:|--:|--:|--:|\n"
    for name, row in sorted(mean_rows(results).items(), key=lambda item: -item[1]["mean_minutes"]):
        texts = cells(name, row, row["maps"], COLUMNS)
        if name.startswith("darp"):
            texts["planner"] = f"**{name}**"
        text += f"| {' | '.join(texts.values())} |\n"
    return text


def agents_table(results: Sequence[dict[str, Any]]) -> str:
    """Every training by itself, with intervals over its walks."""
    text = "| agent | seed | minutes | over `expected` | 95 % over its walks | over the clairvoyant | arrive |\n"
    text += "|---|--:|--:|--:|--:|--:|--:|\n"
    for name in (name for name in results[0]["planners"] if name.startswith("darp")):
        for found in results:
            row: Row = found["planners"][name]
            low, high = row["difference_ci95"]
            text += f"| {name} | {found['seed']} | {row['mean_minutes']:.1f} | {row['difference_minutes']:+.2f} | "
            text += f"{low:+.2f} to {high:+.2f} | {percent(row['gap'], 2)} | {percent(row['arrival_rate'], 2)} |\n"
    return text


def costs(found: Swept, scenario: str) -> str:
    """What the trainings on a scenario took, level by level."""
    took: dict[str, list[dict[str, Any]]] = {}
    for job in found.study.jobs:
        if job.agent is not None and job.scenario.name == scenario:
            took.setdefault(job.agent.config.level, []).append(found.results[job.name]["took"])
    text = ""
    for level, each in took.items():
        seconds, steps, updates = ([one[name] for one in each] for name in TOOK)
        text += (
            f"`sidestep train {scenario} --level {level} --seed {SEEDS[0]}`, and so on: {min(seconds):.0f} to "
            f"{max(seconds):.0f} s with compiling ({each[0]['rounds']} rounds; in the median {np.median(steps):,.0f} "
            f"transitions and {np.median(updates):,.0f} updates a second).\n\n"
        )
    return text
