"""Folders of sweeps and of other trainings keep apart."""

import pytest

from sidestep.agent.metrics import METRICS
from sidestep.cli import app as cli
from sidestep.errors import SidestepError
from sidestep.experiments.folders import JOB, LOCK, check_no_sweep
from sidestep.experiments.study import read_study
from sidestep.experiments.sweep import sweep


@pytest.mark.parametrize("name", [LOCK, JOB])
def test_a_training_into_a_folder_of_a_sweep_is_refused(tmp_path, capsys, name: str) -> None:
    (tmp_path / name).touch()
    with pytest.raises(SidestepError) as error:
        check_no_sweep(tmp_path)
    assert error.value.field == "out"
    for more in ([], ["--overwrite"], ["--resume"]):
        command = ["train", "paper-congested", "--side", "3", "--crowded-nodes", "1", "--rounds", "1", "--out"]
        assert cli.run([*command, str(tmp_path), *more]) == cli.BAD_INPUT
        assert str(error.value) in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_other_folders_take_trainings(tmp_path) -> None:
    (tmp_path / LOCK).touch()
    check_no_sweep(tmp_path / "below")
    check_no_sweep(tmp_path.parent)


def test_a_sweep_into_a_folder_of_a_training_is_refused(small, tmp_path) -> None:
    study, out = read_study(small(tmp_path)), tmp_path / "out"
    job = out / study.jobs[-1].name
    for folder in (out, job):
        folder.mkdir()
        (folder / METRICS).touch()
        with pytest.raises(SidestepError) as error:
            sweep(study, out)
        assert error.value.field == "out"
        assert [file.name for file in folder.iterdir()] == [METRICS]
        (folder / METRICS).unlink()
