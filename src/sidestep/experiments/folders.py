"""Folders of sweeps: what is in them, and how they and those of other trainings keep apart."""

from pathlib import Path

from sidestep.agent.run_folders import holds_training
from sidestep.errors import SidestepError
from sidestep.files import output_folder

LOCK = "sweep.lock"
"""Held by the sweep that has a study's folder and, on clusters, by the worker that does a job."""
JOB = "job.json"
"""What a job was asked for; written first."""
RESULT = "result.json"
"""Written last: its job is done."""


def check_no_sweep(folder: Path) -> None:
    """Refuse to train into a folder that a sweep has, or one of its jobs.

    Parameters
    ----------
    folder
        Where the model is to be; it need not be there.

    Raises
    ------
    SidestepError
        With the field ``out``.
    """
    whose = "job of a sweep" if (folder / JOB).exists() else "sweep" if (folder / LOCK).exists() else None
    if whose is not None:
        said = f"{folder} is the folder of a {whose}, which trains there by itself; choose another folder with --out"
        raise SidestepError(said, field="out")


def study_folder(path: Path) -> Path:
    """Make sure that a sweep can have a folder; it is made if only it is missing.

    Parameters
    ----------
    path
        The folder of the study.

    Returns
    -------
    Path
        The same folder.

    Raises
    ------
    SidestepError
        It has a training that is no job of a sweep (field ``out``).
    OutputError
        It can't be written to (field ``out``).
    """
    if holds_training(path):
        said = f"{path} is the folder of a training; a sweep needs another one: choose it with --out"
        raise SidestepError(said, field="out")
    return output_folder(path)
