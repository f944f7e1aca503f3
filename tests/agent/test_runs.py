"""One training run: it reports, saves, resumes to the bit, and compiles nothing after its first round."""

import logging
import math
import shutil
import time
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest

from sidestep import programs
from sidestep.agent import checkpoint, problem, runs
from sidestep.agent.checkpoint import CheckpointError
from sidestep.agent.config import TrainConfig, TrainConfigError
from sidestep.agent.metrics import METRICS, is_running, read_metrics
from sidestep.agent.presets import preset
from sidestep.agent.runs import TrainingRun, train
from sidestep.errors import SidestepWarning
from sidestep.planners.time_dependent import least_minutes
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.maps import draw_training_map
from sidestep.scenarios.spec import ScenarioError

PROBLEM = scenario("rush-16", side=3, crowded_nodes=1, horizon=3600.0)
CONFIG = preset("default", "local").changed(
    rounds=4, round_steps=64, walkers=16, batch=16, capacity=64, hidden=(8,), places=2, n_step=3, futures=5,
    fresh_futures=2, test_walks=2,
)  # fmt: skip


def whole(run: TrainingRun) -> list[np.ndarray]:
    """All numbers of a run's state, on the host."""
    return [np.array(leaf) for leaf in jax.tree.leaves(run.state)]


class Straight:
    """A run from beginning to end, saved after each of its rounds."""

    def __init__(self, folder: Path) -> None:
        self.folders, self.curves, self.states, self.lines = [], [], [], []

        def on_round(run: TrainingRun) -> None:
            self.folders.append(folder / str(len(run.metadata.curve)))
            self.folders[-1].mkdir()
            checkpoint.save(run, self.folders[-1])
            self.curves.append(run.metadata.curve)
            self.states.append(whole(run))
            self.lines.append(run.metrics)

        self.run = train(
            PROBLEM, CONFIG, seed=4, index=2, out=folder / "out", on_round=on_round, least_minutes=least_minutes
        )


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> Straight:
    return Straight(tmp_path_factory.mktemp("models"))


def test_reports_every_round(straight: Straight) -> None:
    assert [len(curve) for curve in straight.curves] == [1, 2, 3, 4]
    run = straight.run
    assert run.metadata.curve == straight.curves[-1]
    assert run.test_minutes.tolist() == list(run.metadata.curve[-1])
    assert run.best_minutes == pytest.approx(min(np.mean(walks) for walks in run.metadata.curve))
    assert (run.metadata.scenario, run.metadata.seed, run.metadata.map) == (PROBLEM, 4, 2)
    assert run.metadata.config == CONFIG
    assert run.metadata.fingerprint == draw_training_map(PROBLEM, 4, 2).fingerprint
    assert run.seconds > 0
    assert run.metrics.steps_per_second == pytest.approx(16 * run.metrics.updates_per_second)


def test_metrics_have_a_line_for_every_round(straight: Straight) -> None:
    lines, means = straight.lines, straight.run.metadata.means
    assert read_metrics(straight.run.folder) == lines
    assert straight.run.metrics == lines[-1]
    assert [(line.round, line.steps, line.minutes) for line in lines] == [
        (1, 64, means[0]), (2, 128, means[1]), (3, 192, means[2]), (4, 256, means[3]),
    ]  # fmt: skip
    fall = CONFIG.epsilon_end - CONFIG.epsilon  # over the first half
    assert [line.epsilon for line in lines] == pytest.approx(
        [CONFIG.epsilon + fall / 2, *[CONFIG.epsilon_end] * 3], rel=1e-6
    )
    horizon = PROBLEM.horizon / 60
    for line, walks in zip(lines, straight.curves[-1], strict=True):
        assert line.arrival_rate == np.mean([minutes < horizon for minutes in walks])
        assert 0 < line.td_error**2 <= line.loss  # without priorities all weights are 1
        assert line.q < 0  # time is lost until the end
        assert line.gap >= -1e-6  # nobody is faster than the clairvoyant
    # The bound is the same in every round.
    assert [line.minutes / (1 + line.gap) for line in lines] == pytest.approx(
        [lines[0].minutes / (1 + lines[0].gap)] * 4
    )
    seconds = [line.seconds for line in lines]
    assert 0 < seconds[0] < seconds[1] < seconds[2] < seconds[3] == straight.run.seconds


def test_metrics_go_on_as_if_there_had_been_no_interruption(straight: Straight, tmp_path: Path) -> None:
    folder = shutil.copytree(straight.run.folder, tmp_path / "m")
    (folder / "checkpoint-4.eqx").unlink()
    with (folder / "metrics.jsonl").open("ab") as file:
        file.write(b'{"round":5,"st')  # torn
    assert read_metrics(folder) == straight.lines
    train(PROBLEM, CONFIG, seed=4, index=2, out=folder, resume=True, least_minutes=least_minutes)
    found = read_metrics(folder)
    assert found[0] == straight.lines[0]
    timeless = {"seconds", "steps_per_second", "updates_per_second"}
    assert [line.model_dump(exclude=timeless) for line in found] == [
        line.model_dump(exclude=timeless) for line in straight.lines
    ]
    assert found[1].seconds > found[0].seconds
    # Lines of another training are no part of this one.
    other = train(PROBLEM, CONFIG, seed=5, out=folder, overwrite=True)
    assert [line.round for line in read_metrics(folder)] == [1, 2, 3, 4]
    assert read_metrics(folder)[-1] == other.metrics
    assert other.metrics.gap is None
    (folder / "checkpoint-4.eqx").unlink()
    shutil.copy(straight.run.folder / "checkpoint-1.eqx", folder)
    train(PROBLEM, CONFIG, seed=4, index=2, out=folder, resume=True)
    assert [line.round for line in read_metrics(folder)] == [2, 3, 4]


def test_a_second_training_into_a_folder_is_refused(tmp_path: Path) -> None:
    refused: list[str | None] = []

    def second(_run: TrainingRun) -> None:
        assert is_running(tmp_path)
        for flags in ({"resume": True}, {"overwrite": True}):
            with pytest.raises(CheckpointError) as caught:
                train(PROBLEM, CONFIG, out=tmp_path, **flags)
            refused.append(caught.value.field)

    assert not is_running(tmp_path)
    run = train(PROBLEM, CONFIG, out=tmp_path, on_round=second)
    assert not is_running(tmp_path)
    assert refused == ["out"] * 8
    assert checkpoint.load(tmp_path).metadata == run.metadata
    assert len(read_metrics(tmp_path)) == 4


def test_what_a_killed_training_had_half_written_is_cleared_away(tmp_path: Path) -> None:
    for name in (".checkpoint-7.eqx.4711.part", ".model.eqx.4711.part"):
        (tmp_path / name).write_bytes(b"half")
    train(PROBLEM, CONFIG, out=tmp_path)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_json_is_what_the_command_line_prints(straight: Straight) -> None:
    found = straight.run.to_json()
    assert list(found) == [
        "scenario", "seed", "map", "synthetic", "level", "config", "seconds", "steps_per_second", "updates_per_second",
        "curve_minutes", "best_minutes", "model",
    ]  # fmt: skip
    assert (found["scenario"]["name"], found["seed"], found["map"], found["level"]) == ("rush-16", 4, 2, "local")
    assert found["synthetic"] == PROBLEM.place.synthetic != ""
    assert found["config"]["hidden"] == [8]
    assert found["curve_minutes"] == pytest.approx([np.mean(walks) for walks in straight.curves[-1]])
    assert found["model"] == str(straight.run.folder)


def test_the_last_round_is_saved(straight: Straight) -> None:
    assert straight.run.folder is not None
    assert sorted(file.name for file in straight.run.folder.iterdir()) == [
        "checkpoint-1.eqx", "checkpoint-4.eqx", "metrics.jsonl", "model.eqx",
    ]  # fmt: skip
    model = checkpoint.load_model(straight.run.folder)
    assert model.metadata == straight.run.metadata
    assert eqx.tree_equal(model.q_network, straight.run.model.q_network)
    assert model.policy.q_network is model.q_network


@pytest.mark.parametrize("rounds", [1, 3])
def test_a_run_resumes_to_the_bit(straight: Straight, tmp_path: Path, rounds: int) -> None:
    folder, curves = shutil.copytree(straight.folders[rounds - 1], tmp_path / "m"), []
    run = train(
        PROBLEM, CONFIG, seed=4, index=2, out=folder, resume=True,
        on_round=lambda run: curves.append(run.metadata.curve),
    )  # fmt: skip
    assert curves == straight.curves[rounds:]
    for resumed, expected in zip(whole(run), straight.states[-1], strict=True):
        np.testing.assert_array_equal(resumed, expected)


def test_the_same_run_again_compiles_nothing(straight: Straight, caplog: pytest.LogCaptureFixture) -> None:
    def compiled() -> list[str]:
        found = [record.getMessage() for record in caplog.records if record.getMessage().startswith("Compiling ")]
        caplog.clear()
        return found

    after_each: list[list[str]] = []
    # Without its compiled programs, so that the first round has to compile, as in a new process.
    jax.clear_caches()
    programs.clear_caches()
    with caplog.at_level(logging.WARNING), jax.log_compiles():
        run = train(PROBLEM, CONFIG, seed=4, index=2, on_round=lambda _: after_each.append(compiled()))
        assert after_each[0]  # or nothing is seen
        assert after_each[1:] == [[]] * 3
        compiled()
        train(PROBLEM, CONFIG, seed=5)
        assert compiled() == []
    assert run.metadata.curve == straight.curves[-1]


def test_fresh_futures_are_met(straight: Straight, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(problem, "replace_futures", lambda params, *_, **__: params)
    stale = []
    train(PROBLEM, CONFIG, seed=4, index=2, on_round=lambda run: stale.append(whole(run)))

    def same(one: list[np.ndarray], other: list[np.ndarray]) -> bool:
        return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))

    # From the second round on walkers meet others.
    assert [same(*pair) for pair in zip(stale, straight.states, strict=True)] == [True, False, False, False]


OTHERWISE = {
    "rounds": 3, "walkers": 8, "round_steps": 128, "batch": 8, "capacity": 128, "alpha": 0.5, "beta": 0.5,
    "priority_floor": 0.1, "gamma": 0.9, "double": False, "hidden": (4,), "one_hot": True, "unit": 1.0,
    "target_period": 2, "target_rate": 0.5, "optimiser": "sgd", "learning_rate": 0.1, "learning_rate_end": 0.1,
    "decay": 0.5, "damping": 0.1, "epsilon": 0.9, "epsilon_end": 0.1, "epsilon_share": 0.9, "random_origins": 1.0,
    "keep": "best", "temperature": 1.0, "table": True, "dueling": False, "potential": False, "places": 3, "n_step": 2,
    "futures": 6, "futures_reach": 1.0, "fresh_futures": 1, "destinations": 2, "huber": 1.0, "test_walks": 3,
    "patience": 1, "correction_margin_seconds": 1.0, "estimate_when_revisiting": True,
}  # fmt: skip
"""Another value of every setting but the level."""


def test_another_value_of_every_setting() -> None:
    assert {"level", *OTHERWISE} == TrainConfig.model_fields.keys()
    assert [name for name, value in OTHERWISE.items() if getattr(CONFIG, name) == value] == []


# --- What is refused ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"scenario": scenario("paper-congested", side=3, crowded_nodes=1)}, "scenario.name"),
        ({"scenario": PROBLEM.changed(walks=7)}, "scenario.walks"),
        ({"scenario": scenario("rush-16", side=4, crowded_nodes=1, horizon=3600.0)}, "scenario.place.side"),
        ({"seed": 5}, "seed"),
        ({"index": 0}, "map"),
        ({"config": CONFIG.changed(level="map")}, "level"),
        ({"out": None}, "out"),
        *(({"config": CONFIG.changed(**{name: value})}, name) for name, value in OTHERWISE.items()),
    ],
)
def test_only_the_same_run_goes_on(straight: Straight, changes: dict[str, Any], field: str) -> None:
    same = {"scenario": PROBLEM, "config": CONFIG, "seed": 4, "index": 2, "out": straight.folders[1]}
    with pytest.raises(CheckpointError) as caught:
        train(**(same | changes), resume=True)
    assert caught.value.field == field


def test_more_rounds_go_on_where_the_last_ones_ended(straight: Straight, tmp_path: Path) -> None:
    shutil.copytree(straight.folders[-1], tmp_path / "m")
    longer, seen = CONFIG.changed(rounds=6), []
    run = train(
        PROBLEM, longer, seed=4, index=2, out=tmp_path / "m", resume=True,
        on_round=lambda run: seen.append((run.metadata.curve, int(run.state.iteration))),
    )  # fmt: skip
    assert [len(curve) for curve, _ in seen] == [5, 6]
    assert [steps for _, steps in seen] == [5 * 4, 6 * 4]
    assert run.metadata.curve[:4] == straight.curves[-1]
    assert checkpoint.load_model(tmp_path / "m").metadata.config == run.metadata.config == longer
    # The new total is the total: an interruption changes nothing.
    folder = tmp_path / "again"
    folder.mkdir()
    (folder / "checkpoint-4.eqx").write_bytes((straight.folders[-1] / "checkpoint-4.eqx").read_bytes())

    def stop(_run: TrainingRun) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(PROBLEM, longer, seed=4, index=2, out=folder, resume=True, on_round=stop)
    again = train(PROBLEM, longer, seed=4, index=2, out=folder, resume=True)
    for one, other in zip(whole(again), whole(run), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_finished_run_does_not_go_on(straight: Straight) -> None:
    with pytest.raises(CheckpointError) as caught:
        train(PROBLEM, CONFIG, seed=4, index=2, out=straight.folders[-1], resume=True)
    assert caught.value.field == "rounds"


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({}, "out"),
        ({"config": CONFIG.changed(rounds=5)}, "out"),  # also another training than the one that is there
        ({"resume": True, "overwrite": True}, "overwrite"),
        ({"overwrite": True, "out": None}, "out"),
    ],
)
@pytest.mark.parametrize("rounds", [1, 4])  # unfinished and finished
def test_a_model_is_not_lost(straight: Straight, changes: dict[str, Any], field: str, rounds: int) -> None:
    folder = straight.folders[rounds - 1]
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    started = []
    with pytest.raises(CheckpointError) as caught:
        train(**{"scenario": PROBLEM, "config": CONFIG, "out": folder, "on_round": started.append} | changes)
    assert (caught.value.field, started) == (field, [])
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


@pytest.mark.parametrize("name", [checkpoint.MODEL, "checkpoint-1.eqx"])
def test_half_a_model_is_not_lost_either(straight: Straight, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes((straight.folders[0] / name).read_bytes())
    with pytest.raises(CheckpointError) as caught:
        train(PROBLEM, CONFIG, out=tmp_path)
    assert caught.value.field == "out"


def test_a_model_is_overwritten_once_there_is_something_to_save(straight: Straight, tmp_path: Path) -> None:
    shutil.copytree(straight.folders[-1], tmp_path, dirs_exist_ok=True)
    with pytest.raises(ScenarioError):
        train(PROBLEM, CONFIG.changed(destinations=9, futures=64), out=tmp_path, overwrite=True)
    assert checkpoint.load_model(tmp_path).metadata.curve == straight.curves[-1]
    run = train(PROBLEM, CONFIG, seed=5, out=tmp_path, overwrite=True)
    assert checkpoint.load_model(tmp_path).metadata == checkpoint.load(tmp_path).metadata == run.metadata
    assert run.metadata.seed == 5
    assert len(checkpoint.checkpoints(tmp_path)) == 2


def test_what_cannot_be_learned_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    out = tmp_path / "model"
    with pytest.raises(ScenarioError):
        train(PROBLEM, CONFIG.changed(destinations=9, futures=64), out=out)
    with pytest.raises(TrainConfigError):
        train(PROBLEM, CONFIG, seed=-1, out=out)
    with pytest.raises(TrainConfigError):
        train(PROBLEM, CONFIG.changed(rounds=0), out=out)
    assert not out.exists()


@pytest.mark.parametrize(
    ("curve", "patience", "finished"),
    [
        ([1.0, 1.0, 1.0], 2, True),
        ([1.0, 1.0, 1.0], 3, False),  # too few rounds
        ([2.0, 1.0, 1.0], 2, False),
        ([1.0, 1.0, 1.0], 0, False),  # never early
        ([60.0, 60.0, 60.0], 2, False),  # an hour is the horizon: it did not arrive
        ([4.0, 3.0, 2.0, 1.0], 0, True),  # all rounds
    ],
)
def test_training_is_over_when_walks_have_settled(curve: list[float], patience: int, finished: bool) -> None:
    walks = tuple((minutes, 1.0) for minutes in curve)
    told = checkpoint.Metadata(
        scenario=PROBLEM, seed=0, map=0, config=CONFIG.changed(patience=patience), curve=walks, fingerprint=""
    )
    assert told.finished == finished


def test_training_ends_early_and_does_not_go_on(tmp_path: Path) -> None:
    certain = scenario("paper-congested", side=3, crowded_nodes=1, flows="forecast")
    config = preset("default").changed(rounds=40, round_steps=160, walkers=16, batch=16, capacity=640)
    run = train(certain, config.changed(patience=3), out=tmp_path / "out")
    assert len(run.metadata.curve) < 40
    assert len(set(run.metadata.curve[-4:])) == 1
    assert len(checkpoint.load(tmp_path / "out").metadata.curve) == len(run.metadata.curve)
    with pytest.raises(CheckpointError) as error:
        train(certain, config.changed(patience=3), out=tmp_path / "out", resume=True)
    assert error.value.field == "rounds"


def test_a_large_state_is_saved_less_often(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saved: list[int] = []

    def slowly(run: TrainingRun, *_: object) -> None:
        saved.append(len(run.metadata.curve))
        time.sleep(0.1)

    monkeypatch.setattr(runs, "save", slowly)
    monkeypatch.setattr(runs, "SAVE_SECONDS", 0.0)
    for share, expected in ((math.inf, [1, 2, 3, 4]), (1e-4, [1, 2, 4])):
        saved.clear()
        monkeypatch.setattr(runs, "SAVE_SHARE", share)
        train(PROBLEM, CONFIG, seed=4, index=2, out=tmp_path)
        assert saved == expected


def test_a_training_that_saved_nothing_begins_again(straight: Straight, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError) as error:
        train(PROBLEM, CONFIG, seed=4, index=2, out=tmp_path, resume=True)
    assert error.value.field == "model.eqx"
    (tmp_path / METRICS).touch()  # killed in its first round
    run = train(PROBLEM, CONFIG, seed=4, index=2, out=tmp_path, resume=True)
    for begun, expected in zip(whole(run), straight.states[-1], strict=True):
        np.testing.assert_array_equal(begun, expected)


@pytest.mark.parametrize("rounds", [3, 4])  # unfinished and finished
def test_the_latest_checkpoint_may_be_damaged(straight: Straight, tmp_path: Path, rounds: int) -> None:
    for folder in (straight.folders[0], straight.folders[rounds - 1]):
        shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    latest = tmp_path / f"checkpoint-{rounds}.eqx"
    latest.write_bytes(latest.read_bytes()[:-1])
    with pytest.warns(SidestepWarning, match="round 1"):
        run = train(PROBLEM, CONFIG, seed=4, index=2, out=tmp_path, resume=True)
    for resumed, expected in zip(whole(run), straight.states[-1], strict=True):
        np.testing.assert_array_equal(resumed, expected)
