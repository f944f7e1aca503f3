"""The same agent from several trainings, for the pages of the documentation: each on the map and the walks of its seed."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sidestep.agent.config import TrainConfig
from sidestep.agent.presets import preset_for
from sidestep.agent.runs import train
from sidestep.evaluation.compare import Comparison, compare
from sidestep.evaluation.metrics import Row, cells, percent
from sidestep.evaluation.trainings import mean_rows
from sidestep.files import write_text
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.builtin import BUILT_IN
from sidestep.scenarios.model import Scenario

DOCS = Path(__file__).parents[1] / "docs"
SEEDS = (1, 2, 3)
SEEDS_IN_WORDS = "1, 2 and 3"
TOOK = ("seconds", "steps_per_second", "updates_per_second")
COLUMNS = (
    "planner", "knows", "minutes", "median", "90 %", "difference", "difference 95 %", "gap", "arrive",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """Agents to train on a scenario, and the walks to compare them on: more where differences are small."""

    scenario: str
    levels: tuple[str, ...]
    walks: int  # on each map
    planners: tuple[str, ...]

    @property
    def problem(self) -> Scenario:
        """The scenario of that name."""
        return BUILT_IN[self.scenario]

    def models(self, folder: Path, seed: int) -> list[Path]:
        """Where this seed's agents are; they are called by these folders."""
        return [folder / f"seed-{seed}" / level for level in self.levels]

    def trained(self, folder: Path) -> dict[str, list[dict[str, Any]]]:
        """What the trainings took, by level and for each seed; those that are in the folder are not done again."""
        took: dict[str, list[dict[str, Any]]] = {level: [] for level in self.levels}
        for seed in SEEDS:
            for level, model in zip(self.levels, self.models(folder, seed), strict=True):
                found = trained(model, self.problem, preset_for(self.problem, "default", level), seed)  # type: ignore[arg-type]
                took[level].append({name: found[name] for name in TOOK})
                took[level][-1]["rounds"] = len(found["curve_minutes"])
        return took

    def compared(self, folder: Path, walks: int | None) -> list[Comparison]:
        """Walk with each seed's agents, and with the planners, on that seed's maps."""
        found = []
        for seed in SEEDS:
            chosen = choose_planners(self.problem, self.planners, models=self.models(folder, seed), seed=seed)
            maps = chosen.map_numbers()
            found.append(compare(self.problem, chosen.factories, maps=maps, walks=walks or self.walks, seed=seed))
        return found


def kept(target: Path, make: Callable[[], Any]) -> Any:
    """What is in a file of JSON, which is made if it is missing."""
    if not target.exists():
        write_text(target, json.dumps(make(), indent=2) + "\n")
    return json.loads(target.read_text(encoding="utf-8"))


def trained(folder: Path, scenario: Scenario, config: TrainConfig, seed: int) -> dict[str, Any]:
    """Train an agent on map 0 into a folder, unless it is there already; returns what ``train --json`` prints."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    return kept(
        folder / "trained.json", lambda: train(scenario, config, seed=seed, out=folder, overwrite=True).to_json()
    )


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


def costs(scenario: str, took: dict[str, list[dict[str, Any]]]) -> str:
    """What the trainings took, level by level."""
    text = ""
    for level, each in took.items():
        seconds, steps, updates = ([one[name] for one in each] for name in TOOK)
        text += (
            f"`sidestep train {scenario} --level {level} --seed {SEEDS[0]}`, and so on: {min(seconds):.0f} to "
            f"{max(seconds):.0f} s with compiling ({each[0]['rounds']} rounds; in the median {np.median(steps):,.0f} "
            f"transitions and {np.median(updates):,.0f} updates a second).\n\n"
        )
    return text
