"""Event files for TensorBoard say what the metrics say, round by round, also where a training went on."""

import struct
from pathlib import Path

import pytest
from tensorboardX.crc32c import crc32c
from tensorboardX.proto.event_pb2 import Event

from sidestep.agent import tracking
from sidestep.agent.checkpoint import CheckpointError
from sidestep.agent.config import TrainConfigError
from sidestep.agent.metrics import RoundMetrics, read_metrics
from sidestep.agent.presets import preset
from sidestep.agent.runs import TrainingRun, train
from sidestep.agent.tracking import SCALARS, EventFile
from sidestep.files import OutputError
from sidestep.planners.time_dependent import least_minutes
from sidestep.scenarios.builtin import scenario

PROBLEM = scenario("paper-congested", side=3, crowded_nodes=1)
CONFIG = preset("tabular-q").changed(rounds=3, round_steps=640)


def events(folder: Path) -> list[Event]:
    """All events of the one event file in a folder (TFRecord: length, its checksum, the event, its checksum)."""
    (path,) = folder.glob("events.out.tfevents.*")
    found, data = [], path.read_bytes()
    while data:
        (length,) = struct.unpack("<Q", data[:8])
        body, (checksum,) = data[12 : 12 + length], struct.unpack("<I", data[12 + length : 16 + length])
        crc = crc32c(body)
        assert checksum == ((crc >> 15 | crc << 17) + 0xA282EAD8) % 2**32
        found.append(Event.FromString(body))
        data = data[16 + length :]
    assert found[0].file_version == "brain.Event:2"
    return found[1:]


def check(folder: Path) -> list[RoundMetrics]:
    found, lines = events(folder), read_metrics(folder)
    assert [event.step for event in found] == [line.round for line in lines]
    began = found[0].wall_time - lines[0].seconds
    for event, line in zip(found, lines, strict=True):
        said = {value.tag: value.simple_value for value in event.summary.value}
        known = {name: getattr(line, name) for name in SCALARS if getattr(line, name) is not None}
        assert said == pytest.approx(known, rel=1e-6)
        assert event.wall_time - began == pytest.approx(line.seconds, abs=1e-3)
    return lines


def test_event_files_go_on_with_the_training(tmp_path: Path) -> None:
    def stop(run: TrainingRun) -> None:
        assert len(events(tmp_path)) == len(run.metadata.curve)  # at once
        if len(run.metadata.curve) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(PROBLEM, CONFIG, out=tmp_path, track=True, least_minutes=least_minutes, on_round=stop)
    assert [line.gap is None for line in check(tmp_path)] == [False] * 2
    (before,) = tmp_path.glob("events*")
    before.rename(tmp_path / "events.out.tfevents.1.elsewhere")  # names are of the second in which they begin
    train(PROBLEM, CONFIG, out=tmp_path, track=True, resume=True)
    assert [line.gap is None for line in check(tmp_path)] == [False, True, True]  # the checkpoint is of round 1
    train(PROBLEM, CONFIG, out=tmp_path, track=True, overwrite=True)
    assert [line.round for line in check(tmp_path)] == [1, 2, 3]


def test_no_event_file_unless_asked(tmp_path: Path) -> None:
    train(PROBLEM, CONFIG, out=tmp_path, track=True)
    train(PROBLEM, CONFIG, out=tmp_path, overwrite=True)  # whose curve the first one's file would not be
    assert list(tmp_path.glob("events*")) == []


def test_tracking_takes_a_folder_and_tensorboardx(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(CheckpointError) as nowhere:
        train(PROBLEM, CONFIG, track=True)
    assert nowhere.value.field == "out"
    monkeypatch.setattr(tracking, "find_spec", lambda _name: None)
    with pytest.raises(TrainConfigError) as missing:
        train(PROBLEM, CONFIG, out=tmp_path / "m", track=True)
    assert missing.value.field == "track"
    assert not (tmp_path / "m").exists()


def test_a_place_that_takes_no_event_file(tmp_path: Path) -> None:
    with pytest.raises(OutputError) as caught:
        EventFile(tmp_path / "nowhere", [])
    assert caught.value.field == "out"
