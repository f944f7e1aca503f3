"""Jobs on a cluster: through a scheduler of Dask distributed. The only module that imports it."""

import asyncio
import logging
from collections.abc import Generator, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from tempfile import TemporaryDirectory

import sidestep
from sidestep.errors import SidestepError
from sidestep.experiments.folders import JOB, LOCK, RESULT
from sidestep.experiments.jobs import Result, run_job
from sidestep.experiments.pool import Ended, in_words, start_worker
from sidestep.experiments.study import Job
from sidestep.files import OutputError, only_one, output_folder, whole_file

PATIENCE = 10.0
"""Time in which a scheduler has to answer, s."""
Files = dict[str, bytes]
"""A job's files by name: first what was asked for, last the result."""


def run_on_cluster(jobs: Sequence[Job], out: Path, address: str, token: str) -> Generator[Ended]:
    """Do jobs on the workers of a scheduler.

    Where a worker has the study's folder itself, it does the job there, and goes on with what it finds. Elsewhere it
    does the job in a folder of its own, and its files are sent here.

    Parameters
    ----------
    jobs
        What to do.
    out
        Folder of the study.
    address
        Of the scheduler, such as tcp://host:8786; for tls:// Dask's own configuration has the certificates.
    token
        What the study's lock file says: another folder of the same name says something else.

    Yields
    ------
    Ended
        Each job as it ends.

    Raises
    ------
    SidestepError
        The scheduler does not answer (field ``scheduler``), or is gone, or there is no Dask here.
    OutputError
        The folder can't be written to any more.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        said = "--scheduler takes Dask distributed: pip install 'sidestep[cluster]'"
        raise SidestepError(said, field="scheduler") from error
    for name in ("core", "client"):  # what goes wrong is said below, in one sentence
        logging.getLogger(f"distributed.{name}").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TypeError, RuntimeError, ImportError) as error:
        why = " ".join(str(error).split()) or type(error).__name__
        said = f"no scheduler answers at --scheduler {address!r:.80}: {why:.200}"
        raise SidestepError(said, field="scheduler") from error
    with client:
        if not client.scheduler_info()["workers"]:
            logging.getLogger(__name__).warning("the scheduler has no workers yet; jobs begin when one comes")
        here = out.resolve(), token, sidestep.__version__
        futures = {client.submit(_run_anywhere, job, *here, key=f"{job.name}-{token}"): job for job in jobs}
        for future in as_completed(futures, loop=client.loop):  # type: ignore[no-untyped-call]
            job = futures[future]
            try:
                result, files = future.result()
            except OutputError:
                raise
            except (CancelledError, asyncio.CancelledError) as error:
                said = f"the scheduler at {address} is gone; the same command goes on with what is not done"
                raise SidestepError(said, field="scheduler") from error
            except Exception as error:  # noqa: BLE001 - whatever happened there; other jobs go on
                yield Ended(job, None, in_words(error))
                continue
            _write(files, out / job.name)
            future.release()
            yield Ended(job, result)


def _run_anywhere(job: Job, out: Path, token: str, version: str) -> tuple[Result, Files]:
    """Do a job on a worker: its result, and its files where the study's folder is not the worker's as well."""
    if version != sidestep.__version__:
        raise SidestepError(f"a worker has version {sidestep.__version__} of sidestep, not {version}; install the same")
    start_worker()
    if _has(out, token):
        # One worker that was thought dead may still be at work.
        with only_one(output_folder(out / job.name) / LOCK):
            return run_job(job, out), {}
    with TemporaryDirectory() as folder:
        result = run_job(job, Path(folder))
        files = sorted((Path(folder) / job.name).iterdir(), key=lambda file: (file.name == RESULT, file.name != JOB))
        return result, {file.name: file.read_bytes() for file in files}


def _has(out: Path, token: str) -> bool:
    """Whether a folder of this name is the study's, as its lock file tells, and not another on another disk."""
    try:
        return (out / LOCK).read_text(encoding="utf-8") == token
    except OSError:
        return False


def _write(files: Files, folder: Path) -> None:
    """Write what a worker sent; the result comes last."""
    if files:
        output_folder(folder)
    for name, content in files.items():
        with whole_file(folder / name) as temporary:
            temporary.write_bytes(content)
