"""Trainings on disk: found wherever they are, with what they are doing and their best result."""

import json
from pathlib import Path

import pytest

from sidestep.agent import checkpoint
from sidestep.agent.checkpoint import CheckpointError, Metadata
from sidestep.agent.config import differences
from sidestep.agent.metrics import RoundMetrics, open_metrics
from sidestep.agent.presets import PRESETS
from sidestep.agent.run_folders import find_runs, read_run
from sidestep.agent.runs import TrainingRun, train
from sidestep.scenarios.builtin import scenario

PROBLEM = scenario("paper-congested", side=3, crowded_nodes=1)
CONFIG = PRESETS["tabular-q"].changed(rounds=3, round_steps=640)


@pytest.fixture(scope="module")
def trainings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished one, one that was interrupted after its second round, and what is none of them."""
    folder = tmp_path_factory.mktemp("trainings")
    (folder / "below").mkdir()
    train(PROBLEM, CONFIG, out=folder / "done")

    def stop(run: TrainingRun) -> None:
        if len(run.metadata.curve) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(PROBLEM, CONFIG.changed(alpha=0.5), seed=3, index=1, out=folder / "below" / "half", on_round=stop)
    for other in (".hidden", "none"):
        (folder / other).mkdir()
    (folder / ".hidden" / "metrics.jsonl").touch()
    return folder


def test_trainings_are_found_and_told(trainings: Path) -> None:
    half, done = find_runs(trainings)
    assert (half.path, done.path) == (trainings / "below" / "half", trainings / "done")
    assert (half.state, done.state) == ("interrupted", "finished")
    told = half.to_json()
    # What can go on is the checkpoint of round 1, not the metrics, which have two rounds.
    assert (told["rounds"], told["rounds_total"], len(half.metrics)) == (1, 3, 2)
    assert (told["scenario"], told["map"], told["seed"], told["level"]) == ("paper-congested", 1, 3, "position")
    means = checkpoint.read_metadata(done.path).means
    told = done.to_json()
    assert (told["rounds"], told["best_minutes"], told["latest_minutes"]) == (3, min(means), means[-1])
    assert means[told["best_round"] - 1] == min(means)
    assert told["seconds"] == done.metrics[-1].seconds
    assert json.loads(json.dumps(told)) == told


def test_a_running_training_is_as_far_as_its_metrics(tmp_path: Path) -> None:
    seen = []

    def look(run: TrainingRun) -> None:
        found = read_run(tmp_path)
        seen.append((found.state, len(found.minutes), found.minutes == run.metadata.means))

    train(PROBLEM, CONFIG, out=tmp_path, on_round=look)
    assert seen == [("running", 1, True), ("running", 2, True), ("running", 3, True)]
    assert read_run(tmp_path).state == "finished"


def test_a_training_that_has_saved_nothing_yet(tmp_path: Path) -> None:
    with open_metrics(tmp_path):
        found = read_run(tmp_path)
        assert (found.state, found.metadata, found.to_json()["best_minutes"]) == ("running", None, None)
    assert read_run(tmp_path).state == "interrupted"


def test_the_gap_is_that_of_the_best_round(tmp_path: Path) -> None:
    for number, (minutes, gap) in enumerate([(9.0, 0.5), (6.0, 0.0), (7.5, 0.25)], 1):
        with open_metrics(tmp_path) as file:
            file.append(
                RoundMetrics(
                    round=number, steps=1, seconds=1.0, loss=1.0, td_error=1.0, q=1.0, epsilon=0.1, minutes=minutes,
                    gap=gap, arrival_rate=1.0, steps_per_second=1.0, updates_per_second=1.0,
                )
            )  # fmt: skip
    with open_metrics(tmp_path):
        told = read_run(tmp_path).to_json()
    assert (told["best_round"], told["best_minutes"], told["best_gap"], told["latest_minutes"]) == (2, 6.0, 0.0, 7.5)


def test_a_model_without_its_checkpoints(trainings: Path, tmp_path: Path) -> None:
    (tmp_path / "model.eqx").write_bytes((trainings / "done" / "model.eqx").read_bytes())
    found = read_run(tmp_path)
    assert (found.state, found.to_json()["rounds"], found.to_json()["seconds"]) == ("finished", 3, None)


def test_a_training_whose_checkpoints_are_gone_says_that_it_is_over(trainings: Path, tmp_path: Path) -> None:
    (tmp_path / "model.eqx").write_bytes((trainings / "done" / "model.eqx").read_bytes())
    with pytest.raises(CheckpointError, match="over after 3 rounds") as caught:
        train(PROBLEM, CONFIG, out=tmp_path, resume=True)
    assert caught.value.field == "checkpoint"


@pytest.mark.parametrize("left", ["header", "half", "all but a byte", "one byte more"])
def test_a_training_is_not_finished_by_a_checkpoint_that_is_cut_short(
    trainings: Path, tmp_path: Path, left: str
) -> None:
    for file in (trainings / "done").glob("*.eqx"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    latest, before = checkpoint.checkpoints(tmp_path)
    whole = latest.read_bytes()
    sizes = {"header": whole.index(b"\n") + 1, "half": len(whole) // 2, "all but a byte": len(whole) - 1}
    latest.write_bytes(whole[: sizes[left]] if left in sizes else whole + b"\0")
    found = read_run(tmp_path)
    assert (found.state, found.to_json()["rounds"]) == ("interrupted", 1)
    before.unlink()
    assert read_run(tmp_path).state == "unreadable"


def test_a_damaged_training_hides_no_other(trainings: Path, tmp_path: Path) -> None:
    (tmp_path / "checkpoint-1.eqx").write_bytes(b"{")
    (tmp_path / "other").symlink_to(trainings / "done")
    (found,) = find_runs(tmp_path)
    assert found.state == "unreadable"
    assert str(tmp_path / "checkpoint-1.eqx") in (found.error or "")


def test_where_there_is_no_training(trainings: Path) -> None:
    assert find_runs(trainings / "none") == []
    for read, folder in ((read_run, "none"), (read_run, "nowhere"), (find_runs, "nowhere")):
        with pytest.raises(CheckpointError) as caught:
            read(trainings / folder)
        assert caught.value.field == "folder"


def test_settings_that_differ() -> None:
    def told(**changes: object) -> dict[str, object]:
        fields = {"scenario": PROBLEM, "seed": 0, "map": 0, "config": CONFIG, "fingerprint": ""}
        return Metadata.model_validate(fields | changes).settings

    assert told() == told(curve=((1.0,),), fingerprint="other")
    changed = told(scenario=PROBLEM.changed(walks=7), seed=5, config=CONFIG.changed(rounds=9))
    found = {"scenario.walks": (PROBLEM.walks, 7), "seed": (0, 5), "rounds": (3, 9)}
    assert differences(told(), changed) == found
    rush = differences(told(), told(scenario=scenario("helsinki")))
    assert rush["scenario.place.side"] == (3, None)
    assert rush["scenario.place.streets"] == (None, "helsinki")


def test_what_cannot_be_read_is_said(trainings: Path, tmp_path: Path) -> None:
    (tmp_path / "one" / "metrics.jsonl").mkdir(parents=True)
    (tmp_path / "one" / "model.eqx").write_bytes((trainings / "done" / "model.eqx").read_bytes())
    (found,) = find_runs(tmp_path)
    assert found.state == "unreadable"
    assert str(tmp_path / "one") in (found.error or "")
