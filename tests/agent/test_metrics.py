"""The metrics of a training on disk: whole lines only, cut where a training goes on, and kept from other trainings."""

import fcntl
import json
import threading
from pathlib import Path

import pytest

from sidestep import files
from sidestep.agent.checkpoint import CheckpointError
from sidestep.agent.metrics import RoundMetrics, is_running, open_metrics, read_metrics
from sidestep.files import OutputError


def line(number: int, **changes: object) -> RoundMetrics:
    fields = {
        "round": number, "steps": 64 * number, "seconds": 0.5 * number, "loss": 1.0, "td_error": 0.5, "q": -3.0,
        "epsilon": 0.1, "minutes": 10.0 / number, "gap": None, "arrival_rate": 1.0, "steps_per_second": 9.0,
        "updates_per_second": 1.0,
    }  # fmt: skip
    return RoundMetrics.model_validate(fields | changes)


def test_lines_are_read_as_they_were_written(tmp_path: Path) -> None:
    assert read_metrics(tmp_path / "nowhere") == []
    written = [line(1), line(2, gap=0.125), line(3, loss=float("nan"), q=float("-inf"))]
    with open_metrics(tmp_path) as file:
        for each in written:
            file.append(each)
            assert read_metrics(tmp_path)[-1].round == each.round  # while it is open
    # JSON has no word for what is not finite.
    assert read_metrics(tmp_path) == [*written[:2], line(3, loss=None, q=None)]
    found = [
        json.loads(text, parse_constant=pytest.fail) for text in (tmp_path / "metrics.jsonl").read_text().splitlines()
    ]
    assert [one["gap"] for one in found] == [None, 0.125, None]


@pytest.mark.parametrize(
    "torn", [b'{"round":4', b'{"round":4}\n', b"\0\0\0\0", b"\xff\n", line(4).model_dump_json().encode()]
)
def test_a_torn_line_counts_for_nothing(tmp_path: Path, torn: bytes) -> None:
    with open_metrics(tmp_path) as file:
        for number in (1, 2, 3):
            file.append(line(number))
    path = tmp_path / "metrics.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole + torn)
    assert read_metrics(tmp_path) == [line(1), line(2), line(3)]
    with open_metrics(tmp_path) as file:
        assert file.cut([10 / number for number in (1, 2, 3, 4)]) == [line(1), line(2), line(3)]
        assert path.read_bytes() == whole
        file.append(line(4))
    assert read_metrics(tmp_path) == [line(1), line(2), line(3), line(4)]


def test_lines_of_later_rounds_and_of_other_trainings_are_cut(tmp_path: Path) -> None:
    with open_metrics(tmp_path) as file:
        for number in (1, 2, 3):
            file.append(line(number))
        assert file.cut([10.0, 5.0]) == [line(1), line(2)]
        assert file.cut([10.0, 4.0]) == [line(1)]
        assert file.cut([]) == []
    assert (tmp_path / "metrics.jsonl").read_bytes() == b""


def test_one_training_at_a_time(tmp_path: Path) -> None:
    assert not is_running(tmp_path)
    with open_metrics(tmp_path):
        assert is_running(tmp_path)
        with pytest.raises(CheckpointError) as caught, open_metrics(tmp_path):
            pass
        assert caught.value.field == "out"
    assert not is_running(tmp_path)
    with open_metrics(tmp_path):
        pass


def test_who_only_looks_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_PATIENCE", 60.0)
    (tmp_path / "metrics.jsonl").touch()
    with (tmp_path / "metrics.jsonl").open("rb") as looking:
        fcntl.flock(looking, fcntl.LOCK_SH)
        timer = threading.Timer(0.2, fcntl.flock, (looking, fcntl.LOCK_UN))
        timer.start()
        with open_metrics(tmp_path):
            assert timer.finished.is_set()
        timer.join()


def test_a_place_that_takes_no_file(tmp_path: Path) -> None:
    (tmp_path / "metrics.jsonl").mkdir()
    with pytest.raises(OutputError) as caught, open_metrics(tmp_path):
        pass
    assert caught.value.field == "out"


def test_a_full_disk(tmp_path: Path) -> None:
    (tmp_path / "metrics.jsonl").symlink_to("/dev/full")
    with open_metrics(tmp_path) as file, pytest.raises(OutputError) as caught:
        file.append(line(1))
    assert caught.value.field == "out"
