"""A whole study: all its jobs that are not done yet, on this machine or a cluster, and what they tell together."""

import secrets
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidestep.errors import SidestepError
from sidestep.evaluation.compare import Comparison
from sidestep.evaluation.trainings import over_trainings
from sidestep.experiments.folders import LOCK, study_folder
from sidestep.experiments.jobs import Result, check_job, is_done, records_of
from sidestep.experiments.pool import Ended, run_locally
from sidestep.experiments.study import Job, Study, StudyError, labels
from sidestep.files import append, only_one
from sidestep.planners.registry import BASELINE

if TYPE_CHECKING:
    from sidestep.evaluation.tables import WalkTable

Run = Callable[[Sequence[Job], Path, str], Generator[Ended]]
"""Does jobs in the folder of a study, whose lock file says something that no other folder's does."""


@dataclass(frozen=True)
class Swept:
    """What a study has found."""

    study: Study
    results: dict[str, Result]
    """By the name of each job that is done."""
    failed: dict[str, str] = field(default_factory=dict)
    """Why the other jobs failed, by their names."""

    @cached_property
    def labels(self) -> dict[str, str]:
        """What tables call the agent of each job."""
        return labels(self.study.jobs)

    @cached_property
    def comparisons(self) -> dict[str, list[Comparison]]:
        """By problem: the walks on each map and with each seed, wherever the planners' job is done."""
        found: dict[str, list[Comparison]] = {}
        for problem, jobs in _by_place(self._done()):
            if any(job.agent is None for job in jobs):
                each = [records_of(self.results[job.name], self.labels.get(job.name, "")) for job in jobs]
                job, records = jobs[0], dict(chain.from_iterable(one.items() for one in each))
                one = Comparison(job.scenario, job.walked, job.walks, job.seed, records)
                found.setdefault(problem, []).append(one)
        return found

    def to_json(self, baseline: str = BASELINE) -> dict[str, Any]:
        """Sum up in the shape of ``sweep --json``.

        Parameters
        ----------
        baseline
            The planner or agent that the others' minutes are set against; maps and seeds on which its job failed are
            left out.

        Returns
        -------
        dict
            Plain numbers and texts; ``problems`` has a row for each planner and agent of each scenario.
        """
        found = {
            problem: [each for each in compared if baseline in each.records]
            for problem, compared in self.comparisons.items()
        }
        problems = [
            {
                "problem": problem,
                "scenario": compared[0].scenario.name,
                "summary": compared[0].scenario.summary,
                "synthetic": compared[0].scenario.place.synthetic,
                "trainings": len(compared),
                "maps": compared[0].maps,
                "walks": compared[0].walks,
                "baseline": baseline,
                "planners": over_trainings(compared, baseline),
            }
            for problem, compared in found.items()
            if compared
        ]
        return {"study": self.study.name, "jobs": len(self.study.jobs), "failed": self.failed, "problems": problems}

    def to_frames(self) -> "Iterator[WalkTable]":
        """The walks of each map and seed, one row for each walk and planner.

        Yields
        ------
        pandas.DataFrame
            The columns of :meth:`Comparison.to_frame`; ``learned_map``, ``preset`` and ``variant`` (empty for planners
            that are not trained), and what the study has in lists.
        """
        for job in self._done():
            records = records_of(self.results[job.name], self.labels.get(job.name, ""))
            frame = Comparison(job.scenario, job.walked, job.walks, job.seed, records).to_frame()
            agent = {"preset": "", "variant": ""}
            if job.agent is not None:
                agent = {"preset": job.agent.preset, "variant": job.agent.variant, **dict(job.agent.settings)}
            yield frame.assign(learned_map=job.map, **dict(job.changes), **agent)

    def _done(self) -> list[Job]:
        return [job for job in self.study.jobs if job.name in self.results]


def _by_place(jobs: Sequence[Job]) -> Iterator[tuple[str, list[Job]]]:
    """The jobs of each problem, map and seed, the planners' first."""
    found: dict[tuple[str, int, int], list[Job]] = {}
    for job in jobs:
        found.setdefault((job.problem, job.map, job.seed), []).append(job)
    for (problem, *_), each in found.items():
        yield problem, each


def sweep(
    study: Study,
    out: Path,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    on_jobs: Callable[[int], Callable[[Ended], None]] = lambda _todo: lambda _ended: None,
) -> Swept:
    """Do all jobs of a study that are not done yet.

    Parameters
    ----------
    study
        What :func:`~sidestep.experiments.study.read_study` read.
    out
        Folder of the study, made if it is missing; one sweep at a time has it.
    workers
        Number of processes on this machine.
    scheduler
        Address of a scheduler of Dask distributed, whose workers do the jobs instead.
    on_jobs
        Called with the number of jobs to do before the first one; what it returns is called with each as it ends.

    Returns
    -------
    Swept
        All results, also those that were there before.

    Raises
    ------
    StudyError
        Another sweep has the folder (field ``out``), or a job was begun there with other settings.
    OutputError
        The folder can't be written to; what is done stays.
    SidestepError
        The scheduler does not answer (field ``scheduler``), or the folder is that of a training (field ``out``).
    """
    with machines(workers, scheduler) as run:
        return sweep_on(run, study, out, on_jobs)


@contextmanager
def machines(workers: int, scheduler: str | None) -> Iterator[Run]:
    """Those that do jobs; nothing need be written for a scheduler that does not answer.

    Parameters
    ----------
    workers, scheduler
        As for :func:`sweep`.

    Yields
    ------
    Run
        Does jobs on them.

    Raises
    ------
    SidestepError
        The scheduler does not answer (field ``scheduler``).
    """
    if scheduler is None:
        yield lambda jobs, out, _token: run_locally(jobs, out, workers)
        return
    from sidestep.experiments.cluster import connected, run_on_cluster

    with connected(scheduler) as client:
        yield partial(run_on_cluster, client)


def sweep_on(run: Run, study: Study, out: Path, on_jobs: Callable[[int], Callable[[Ended], None]]) -> Swept:
    """Do all jobs of a study that are not done yet.

    Parameters
    ----------
    run
        Does them: one of :func:`machines`.
    study, out, on_jobs
        As for :func:`sweep`, also the errors.

    Returns
    -------
    Swept
        All results, also those that were there before.
    """
    busy = StudyError(f"another sweep is at work in {out}; choose another folder with --out", field="out")
    with only_one(study_folder(out) / LOCK, busy) as lock:
        token = secrets.token_hex()
        lock.truncate(0)
        append(lock, token.encode())
        before = {job.name: check_job(job, out) for job in study.jobs}
        todo = [job for job in study.jobs if not is_done(job, before[job.name])]
        results = {name: result for name, result in before.items() if result is not None}
        failed: dict[str, str] = {}
        on_end = on_jobs(len(todo))
        with closing(run(todo, out, token)) as ending:
            for ended in ending:
                if ended.result is None:
                    failed[ended.job.name] = ended.error
                else:
                    results[ended.job.name] = ended.result
                on_end(ended)
    return Swept(study, results, failed)


def check_baseline(study: Study, baseline: str) -> None:
    """Refuse, before long work begins, a baseline that does not walk everywhere.

    Parameters
    ----------
    study
        The study.
    baseline
        A planner, or an agent by the name that tables give it.

    Raises
    ------
    SidestepError
        With the field ``against``.
    """
    named = labels(study.jobs)
    for problem in {job.problem for job in study.jobs}:
        jobs = [job for job in study.jobs if job.problem == problem]
        known = {name for job in jobs for name in (job.planner_names or [named[job.name]])}
        if baseline not in known:
            said = f"--against must be one of {', '.join(sorted(known))} in {problem}, not {baseline!r:.60}"
            raise SidestepError(said, field="against")
