"""One job of a study: train, walk, and say how it went. Done again, or after a kill, it has the same result."""

import json
from pathlib import Path
from typing import Any

from sidestep.agent.checkpoint import CheckpointError, Model, checkpoints, load_model, read_metadata
from sidestep.agent.config import TrainConfig, differences
from sidestep.agent.metrics import read_metrics
from sidestep.agent.run_folders import holds_training
from sidestep.agent.runs import train
from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import Record
from sidestep.experiments.folders import JOB, RESULT
from sidestep.experiments.study import AGENT, Job, StudyError
from sidestep.files import output_folder, reason, remove_unfinished, write_text
from sidestep.planners.learned import trained_darp
from sidestep.planners.registry import PlannerFactory, choose_planners
from sidestep.scenarios.spec import shown

Result = dict[str, Any]
"""``records`` of walks by planner (:meth:`~sidestep.evaluation.metrics.Record.to_json`); what the training ``took``:
``rounds``, ``seconds`` and rates, as its metrics have them, and ``best_minutes``."""


def check_job(job: Job, out: Path) -> Result | None:
    """Read what a job has found so far, and make sure that it was begun with the same settings.

    Parameters
    ----------
    job
        The job.
    out
        Folder of the study; nothing is written to it.

    Returns
    -------
    Result or None
        None where there is no result. :func:`is_done` tells whether it has all that is asked for.

    Raises
    ------
    StudyError
        A job of this name was begun there that differs; its field is the setting. Or its folder has a training that
        is no job (field ``out``), or a file is damaged.
    """
    before = _read(out / job.name / JOB)
    if before is None and holds_training(out / job.name):
        said = f"{out / job.name} has a training that no sweep began; move it away, or choose another folder with --out"
        raise StudyError(said, field="out")
    changed = {} if before is None else differences(before, job.to_json())
    for name, (old, new) in changed.items():
        said = f"{out / job.name} has {name} {shown(old)}, not {shown(new)}"
        raise StudyError(f"{said}; ask for the same, or choose another folder with --out", field=name)
    path = out / job.name / RESULT
    found = _read(path)
    if found is not None and not isinstance(found.get("records"), dict):
        raise StudyError(f"cannot read {path}: it has no records of walks; remove it, and its job is done again")
    return found


def is_done(job: Job, result: Result | None) -> bool:
    """Whether a result has all that a job asks for: of planners' walks some may be missing."""
    return result is not None and result["records"].keys() >= set(job.planner_names)


def run_job(job: Job, out: Path) -> Result:
    """Do a job, or as much of it as is not done.

    Parameters
    ----------
    job
        The job.
    out
        Folder of the study. The job has a folder in it, in which the model is, and at last the result.

    Returns
    -------
    Result
        The same, but for what the training took, however often it was interrupted.

    Raises
    ------
    SidestepError
        What is asked for can't be trained or walked, or the folder can't be written to.
    """
    before = check_job(job, out)
    if before is not None and is_done(job, before):
        return before
    result = before or {"records": {}}
    folder = output_folder(out / job.name)
    remove_unfinished(folder, "*")
    write_text(folder / JOB, json.dumps(job.to_json()) + "\n")
    factories: dict[str, PlannerFactory] = {}
    if job.agent is None:
        factories = choose_planners(job.scenario, job.planners).factories
        factories = {name: factory for name, factory in factories.items() if name not in result["records"]}
    else:
        model = _trained(job, job.agent.config, folder)
        result["took"] = _took(model, folder)
        darp = trained_darp(model)
        factories[AGENT] = lambda *_: darp
    compared = compare(job.scenario, factories, maps=job.walked, walks=job.walks, seed=job.seed)
    result["records"] |= {name: record.to_json() for name, record in compared.records.items()}
    write_text(folder / RESULT, json.dumps(result) + "\n")
    # Megabytes, and nothing goes on from them. The latest goes last: after a kill it still says how the training ended.
    for path in reversed(checkpoints(folder)):
        path.unlink(missing_ok=True)
    return result


def _trained(job: Job, config: TrainConfig, folder: Path) -> Model:
    """The trained agent, from where it was left."""
    try:
        begun = read_metadata(folder) if read_metrics(folder) else None
    except CheckpointError:  # nothing there, or nothing of use
        begun = None
    if begun is not None and begun.finished:
        return load_model(folder)
    run = train(
        job.scenario,
        config,
        seed=job.seed,
        index=job.map,
        out=folder,
        resume=begun is not None,
        overwrite=begun is None,
    )
    return run.model


def _took(model: Model, folder: Path) -> dict[str, Any]:
    """What a training took, also if it was over in a process that was killed before it wrote a result."""
    latest = read_metrics(folder)[-1]
    return {
        "rounds": len(model.metadata.curve),
        "seconds": latest.seconds,
        "steps_per_second": latest.steps_per_second,
        "updates_per_second": latest.updates_per_second,
        "best_minutes": min(model.metadata.means),
    }


def _read(path: Path) -> Any:
    """What an object of JSON in a file says; None where there is no file."""
    try:
        found = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        said = reason(error) if isinstance(error, OSError) else "it is no JSON"
        raise StudyError(f"cannot read {path}: {said}; remove it, and its job is done again") from error
    if not isinstance(found, dict):
        raise StudyError(f"cannot read {path}: it is no object of JSON; remove it, and its job is done again")
    return found


def records_of(result: Result, label: str = AGENT) -> dict[str, Record]:
    """The walks of a result by planner; the agent under another name."""
    return {label if name == AGENT else name: Record.of_json(found) for name, found in result["records"].items()}
