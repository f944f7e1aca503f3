"""The scripts that write pages of the documentation, given the results of their studies."""

import json
import shutil
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from sidestep.evaluation.compare import Comparison
from sidestep.evaluation.metrics import Record
from sidestep.experiments.folders import JOB, RESULT
from sidestep.experiments.study import AGENT, Job, read_study
from sidestep.planners.registry import find_planner
from sidestep.scenarios.builtin import BUILT_IN

ROOT = Path(__file__).parents[2]
TOOK = {"rounds": 1, "seconds": 1.0, "steps_per_second": 2.0, "updates_per_second": 3.0, "best_minutes": 20.0}
RNG = np.random.default_rng(0)


def walks(level: str, maps: int = 1) -> Record:
    """Four walks on each map."""
    minutes = 20 + 5 * RNG.random((maps, 4))
    return Record(level, minutes, np.ones_like(minutes, bool), minutes)


def do(job: Job, out: Path) -> None:
    """Leave what a job leaves, with walks by chance: training all of it takes hours."""
    levels = {name: find_planner(planner).level for name, planner in zip(job.planner_names, job.planners, strict=True)}
    if job.agent is not None:
        levels = {AGENT: job.agent.config.level}
    records = {name: walks(level, len(job.walked)).to_json() for name, level in levels.items()}
    (out / job.name).mkdir(parents=True)
    (out / job.name / JOB).write_text(json.dumps(job.to_json()))
    (out / job.name / RESULT).write_text(
        json.dumps({"records": records} | ({} if job.agent is None else {"took": TOOK}))
    )


def margins(script: ModuleType) -> dict[str, list]:
    """What the page of levels compares beyond its study, in the same shape."""

    def compared(untrained: str, seed: int) -> dict:
        names = ("shortest-path", "expected", "clairvoyant", untrained, *script.DEPLOYED)
        records = {name: walks("map") for name in names}
        return Comparison(BUILT_IN[script.TOWN], (0,), 4, seed, records).to_json(baseline="darp") | {"margin": 1.0}

    return {level: [compared(untrained, seed) for seed in script.SEEDS] for level, untrained in script.MARGINS.items()}


def rows(page: Path) -> list[str]:
    """Headings, and what the lines of tables are of."""
    lines = page.read_text(encoding="utf-8").splitlines()
    return [
        line.split("|")[1].strip() if line.startswith("|") else line for line in lines if line.startswith(("#", "|"))
    ]


@pytest.mark.parametrize(
    ("study", "pages"), [("ablations", ["ablations"]), ("levels", ["levels"]), ("towns", ["towns", "traffic"])]
)
def test_a_page_has_the_same_rows_whatever_was_found(study: str, pages: list[str], monkeypatch, tmp_path) -> None:
    monkeypatch.syspath_prepend(ROOT / "scripts")
    script = __import__(f"{study}_page")
    monkeypatch.setattr(script, "DOCS", tmp_path)
    for page in pages:
        shutil.copy(ROOT / "docs" / f"{page}.md", tmp_path)
    out = tmp_path / "out"
    for job in read_study(ROOT / "examples" / "studies" / f"{study}.toml").jobs:
        do(job, out)
    if study == "towns":
        monkeypatch.setattr(sys, "argv", ["towns_page.py", str(out)])
        script.main()
    else:
        if study == "levels":
            (out / "margins.json").write_text(json.dumps(margins(script)))
        script.main(out)
    for page in pages:
        before, after = ROOT / "docs" / f"{page}.md", tmp_path / f"{page}.md"
        assert after.read_text() != before.read_text()
        assert sorted(rows(after)) == sorted(rows(before))  # tables are in the order of what was found
