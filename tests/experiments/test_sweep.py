"""Sweeps: nothing is lost, done twice or left running, whatever is killed."""

import json
import os
import random
import signal
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sidestep.agent.checkpoint import load_model
from sidestep.cli import app as cli
from sidestep.errors import SidestepError
from sidestep.evaluation.compare import compare
from sidestep.evaluation.trainings import student_interval
from sidestep.experiments import pool
from sidestep.experiments.folders import JOB, LOCK
from sidestep.experiments.jobs import check_job
from sidestep.experiments.study import StudyError, read_study
from sidestep.experiments.sweep import Swept, check_baseline, sweep
from sidestep.files import only_one
from sidestep.planners.learned import trained_darp
from sidestep.planners.registry import choose_planners

from .processes import alive, children, until, walks_of

ROUNDS = 1500  # so many that a training can be killed
SEEDS = "seeds = [0, 1]"
OWN = """
import os
from sidestep.planners.random import RandomProgress

class Failing(RandomProgress):
    name = "failing"
    def plan(self, params, instances):
        raise RuntimeError("on purpose")

class Deadly(RandomProgress):
    name = "deadly"
    def plan(self, params, instances):
        with open("deaths", "a") as file:
            file.write("x")
        os.kill(os.getpid(), 9)
"""


@pytest.fixture(scope="module")
def whole(small, tmp_path_factory) -> Swept:
    """A sweep of two seeds that nobody disturbs."""
    folder = tmp_path_factory.mktemp("whole")
    found = sweep(read_study(small(folder, SEEDS, rounds=ROUNDS)), folder / "out", workers=2)
    assert not found.failed
    return found


@pytest.fixture
def own(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Planners of one's own in the current folder."""
    (tmp_path / "own.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


def walked(found: Swept) -> dict[str, dict]:
    return {name: result["records"] for name, result in found.results.items()}


def test_jobs_walk_what_one_comparison_walks(whole, tmp_path_factory) -> None:
    *_, job = whole.study.jobs
    out = next(tmp_path_factory.getbasetemp().glob("whole*")) / "out"
    darp = trained_darp(load_model(out / job.name))
    factories = choose_planners(job.scenario, []).factories | {"darp": lambda *_: darp}
    together = compare(job.scenario, factories, maps=[job.map], walks=job.walks, seed=job.seed)
    apart = whole.comparisons[job.problem][job.seed]
    assert apart.records.keys() == together.records.keys()
    for name, record in together.records.items():
        np.testing.assert_array_equal(apart.records[name].minutes, record.minutes)


def test_sums_over_trainings_and_single_walks(whole) -> None:
    (problem,) = whole.to_json()["problems"]
    frame = pd.concat(whole.to_frames())
    assert len(frame) == 2 * 4 * 5
    means = frame[frame["planner"] == "darp"].groupby("seed")["minutes"].mean()
    row = problem["planners"]["darp"]
    assert row["ci95"] == pytest.approx(student_interval(means))
    assert set(frame["preset"]) == {"", "default"}


def test_a_worker_that_is_killed_loses_nothing(whole, small, start, tmp_path) -> None:
    file = small(tmp_path, SEEDS, rounds=ROUNDS)
    process = start("sweep", file, "--workers", 2, "--out", "out")
    until(lambda: list(tmp_path.glob("out/*default/checkpoint*")))
    time.sleep(random.uniform(0, 0.5))
    os.kill(random.choice(children(process.pid)), signal.SIGKILL)
    stdout, stderr = process.communicate(timeout=120)
    assert (process.returncode, stderr) == (0, ""), stdout
    assert walks_of(tmp_path / "out") == walked(whole)
    assert not list(tmp_path.glob("out/*/checkpoint*"))


def test_a_sweep_that_is_killed_leaves_no_process_and_goes_on(whole, small, start, tmp_path) -> None:
    file, out = small(tmp_path, SEEDS, rounds=ROUNDS), tmp_path / "out"
    process = start("sweep", file, "--workers", 2, "--out", "out")
    until(lambda: list(out.glob("*default/checkpoint*")))
    workers = children(process.pid)
    process.kill()
    process.wait()
    until(lambda: not any(map(alive, workers)), 10)
    before = {done: done.stat().st_mtime_ns for done in out.glob("*/result.json")}
    assert 0 < len(before) < len(whole.study.jobs)
    again = start("sweep", file, "--workers", 1, "--out", "out")
    assert again.wait(120) == 0
    assert walks_of(out) == walked(whole)
    assert {done: done.stat().st_mtime_ns for done in before} == before


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_sweep_that_is_stopped_ends_its_workers(small, start, tmp_path, number) -> None:
    process = start("sweep", small(tmp_path, SEEDS, rounds=10**6), "--workers", 2, "--out", "out")
    until(lambda: len(list(tmp_path.glob("out/*default/checkpoint*"))) == 2)
    workers = children(process.pid)
    os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
    began = time.monotonic()
    _, stderr = process.communicate(timeout=20)
    assert time.monotonic() - began < 5
    assert process.returncode == cli.INTERRUPTED
    assert len(stderr.splitlines()) == 1
    assert not any(map(alive, workers))
    assert len(walks_of(tmp_path / "out")) == 2  # of the planners


def test_only_one_sweep_has_a_folder(small, tmp_path) -> None:
    study = read_study(small(tmp_path))
    (tmp_path / "out").mkdir()
    with only_one(tmp_path / "out" / LOCK, SidestepError("")), pytest.raises(StudyError) as error:
        sweep(study, tmp_path / "out")
    assert error.value.field == "out"
    assert [file.name for file in (tmp_path / "out").iterdir()] == [LOCK]


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (("gamma = 0.5", "gamma = 0.4"), "gamma"),
        (("side = 3", "side = 4"), "scenario.place.side"),
        (("walks = 5", "walks = 6"), "walks"),
    ],
)
def test_a_job_with_other_settings_is_refused(small, tmp_path, change, field) -> None:
    file, out = small(tmp_path, settings="gamma = 0.5"), tmp_path / "out"
    *_, job = read_study(file).jobs
    (out / job.name).mkdir(parents=True)
    (out / job.name / "job.json").write_text(json.dumps(job.to_json()))
    file.write_text(file.read_text().replace(*change))
    with pytest.raises(StudyError) as error:
        sweep(read_study(file), out)
    assert error.value.field == field


@pytest.mark.usefixtures("own")
def test_jobs_that_fail_hold_up_no_others(small, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(pool, "RETRIES", 1)
    file = small(tmp_path, "planners = 'own:Failing'")
    found = sweep(read_study(file), tmp_path / "out")
    (error,) = found.failed.values()
    assert "on purpose" in error
    assert [name.rpartition("_")[2] for name in found.results] == ["default"]
    found = sweep(read_study(small(tmp_path, "planners = 'own:Deadly'")), tmp_path / "out")
    assert [name.rpartition("_")[2] for name in found.failed] == ["planners"]
    assert (tmp_path / "deaths").read_text() == "x" * 2
    assert cli.run(["sweep", str(file), "--out", str(tmp_path / "out")]) == 1


def test_planners_that_are_added_walk_alone(small, tmp_path) -> None:
    first = sweep(read_study(small(tmp_path)), tmp_path / "out")
    more = sweep(read_study(small(tmp_path, "planners = 'random-progress'")), tmp_path / "out")
    name = more.study.jobs[0].name
    before, after = (each.results[name]["records"] for each in (first, more))
    assert after.keys() - before.keys() == {"random-progress"}
    assert {planner: after[planner] for planner in before} == before


def test_a_full_disk(small, start, tmp_path) -> None:
    limited = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, -1)); "
        "from sidestep.cli.app import main; main()"
    )
    file, out = small(tmp_path), tmp_path / "out"
    file.write_text(file.read_text().replace("walks = 5", "walks = 100"))  # more than that
    # JAX's cache is off, which a full disk would leave damaged.
    process = start(
        "sweep", file, "--workers", 1, "--out", "out", program=("-c", limited), JAX_ENABLE_COMPILATION_CACHE="0"
    )
    _, stderr = process.communicate(timeout=120)
    assert (process.returncode, len(stderr.splitlines())) == (cli.BAD_INPUT, 1), stderr
    assert stderr.startswith("sidestep: cannot write")
    assert [path.name for path in out.glob("*/*")] == ["job.json"]
    assert start("sweep", file, "--workers", 1, "--out", "out").wait(120) == 0
    assert len(walks_of(out)) == 2


def test_a_training_that_was_killed_before_its_result_has_what_it_took(small, tmp_path) -> None:
    study, out = read_study(small(tmp_path)), tmp_path / "out"
    *_, job = study.jobs
    first = sweep(study, out)
    for left in ({"result.json"}, {"result.json", "metrics.jsonl"}):
        for name in left:
            (out / job.name / name).unlink()
        again = sweep(study, out)
        assert walked(again) == walked(first)
        took, before = (found.results[job.name]["took"] for found in (again, first))
        assert took.keys() == before.keys()
        assert (took == before) is (len(left) == 1)  # without metrics it is trained anew


def test_against_must_have_walked(small, tmp_path) -> None:
    study = read_study(small(tmp_path))
    check_baseline(study, "darp")
    with pytest.raises(SidestepError) as error:
        check_baseline(study, "snapshot")
    assert error.value.field == "against"


@pytest.mark.usefixtures("own")
def test_what_the_command_writes(small, tmp_path, capsys) -> None:
    file = small(tmp_path, SEEDS)
    assert cli.run(["sweep", str(file), "--walks-out", "walks.parquet", "--json", "--workers", "1"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said == json.loads((tmp_path / "small" / "results.json").read_text())
    assert list(said["problems"][0]["planners"]) == ["shortest-path", "expected", "clairvoyant", "darp"]
    assert len(pd.read_parquet("walks.parquet")) == 2 * 4 * 5
    assert cli.run(["sweep", str(file)]) == 0  # all is done
    assert "darp" in capsys.readouterr().out


@pytest.fixture
def town(tmp_path) -> tuple[Path, Path]:
    """A study of a town with counts of its own, and these."""
    counts = tmp_path / "counts.csv"
    hours = pd.date_range("2023-01-01", "2026-01-01", freq="h", tz="Europe/Helsinki").tz_localize(None).unique()
    pd.DataFrame({"time": hours, "Gate": 100 + hours.hour}).to_csv(counts, index=False)
    (tmp_path / "town.toml").write_text("[place]\nstreets = 'helsinki'\n[place.crowd_source]\nfile = 'counts.csv'\n")
    study = tmp_path / "study.toml"
    study.write_text("scenarios = 'town.toml'\nlevels = 'map'\n")
    return study, counts


def test_jobs_by_other_counts_of_the_same_name_are_refused(town, tmp_path) -> None:
    (study, counts), out = town, tmp_path / "out"
    job = read_study(study).jobs[0]
    (out / job.name).mkdir(parents=True)
    (out / job.name / JOB).write_text(json.dumps(job.to_json()))
    assert not check_job(job, out)
    counts.write_text(counts.read_text().replace(",100", ",101"))
    with pytest.raises(StudyError) as refused:
        check_job(job, out)
    assert refused.value.field == f"contents of {counts}"


def test_walks_are_not_written_over_the_counts_of_a_scenario(town, tmp_path, capsys) -> None:
    study, counts = town
    before = counts.read_bytes()
    assert cli.run(["sweep", str(study), "--walks-out", str(counts), "--out", str(tmp_path / "out")]) == cli.BAD_INPUT
    assert "counts.csv, which is read" in capsys.readouterr().err
    assert counts.read_bytes() == before
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("damaged", ["{}", "[]", "null", '{"records": 3}', "\0\0"])
def test_a_result_that_is_damaged_is_told(small, tmp_path, damaged: str) -> None:
    study = read_study(small(tmp_path))
    folder = tmp_path / "out" / study.jobs[0].name
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(damaged)
    with pytest.raises(StudyError, match="remove it"):
        sweep(study, tmp_path / "out")


@pytest.mark.usefixtures("own")
def test_a_bad_study_leaves_nothing(small, tmp_path) -> None:
    assert cli.run(["sweep", str(small(tmp_path, "seeds = []"))]) == cli.BAD_INPUT
    assert not (tmp_path / "small").exists()
