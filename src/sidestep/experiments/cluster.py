"""Jobs on a cluster: through a scheduler of Dask distributed. The only module that imports it."""

import asyncio
import logging
import ssl
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import sidestep
from sidestep.errors import SidestepError
from sidestep.experiments.folders import JOB, LOCK, RESULT
from sidestep.experiments.jobs import Result, run_job
from sidestep.experiments.pool import Ended, in_words, start_worker
from sidestep.experiments.study import Job
from sidestep.files import OutputError, only_one, output_folder, reason, whole_file

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 10.0
"""Time in which a scheduler has to answer, s."""
Files = dict[str, bytes]
"""A job's files by name: first what was asked for, last the result."""


@contextmanager
def connected(address: str) -> "Iterator[Client]":
    """Reach a scheduler.

    Parameters
    ----------
    address
        Of the scheduler, such as tcp://host:8786; for tls:// Dask's own configuration has the certificates.

    Yields
    ------
    distributed.Client
        For :func:`run_on_cluster`.

    Raises
    ------
    SidestepError
        The scheduler does not answer, its certificates do not fit, or there is no Dask here (field ``scheduler``).
    """
    try:
        from distributed import Client
        from distributed.utils import LoopRunner
    except ImportError as error:
        said = "--scheduler takes Dask distributed: pip install 'sidestep[cluster]'"
        raise SidestepError(said, field="scheduler") from error
    for name in ("core", "client"):  # what goes wrong is said below, in one sentence
        logging.getLogger(f"distributed.{name}").setLevel(logging.CRITICAL)
    try:
        # As the client does, also where a loop runs already, such as in notebooks.
        LoopRunner().run_sync(_answers, address)  # type: ignore[no-untyped-call]
        client = Client(address, timeout=PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TypeError, RuntimeError, ImportError, MemoryError) as error:
        raise SidestepError(f"--scheduler {address!r:.80}: {_why_not(address, error)}", field="scheduler") from error
    with client:
        yield client


def run_on_cluster(client: "Client", jobs: Sequence[Job], out: Path, token: str) -> Generator[Ended]:
    """Do jobs on the workers of a scheduler.

    Where a worker has the study's folder itself, it does the job there, and goes on with what it finds. Elsewhere it
    does the job in a folder of its own, and its files are sent here.

    Parameters
    ----------
    client
        Of the scheduler.
    jobs
        What to do.
    out
        Folder of the study.
    token
        What the study's lock file says: another folder of the same name says something else.

    Yields
    ------
    Ended
        Each job as it ends.

    Raises
    ------
    SidestepError
        The scheduler is gone (field ``scheduler``).
    OutputError
        The folder can't be written to any more.
    """
    from distributed import as_completed

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
            said = "the scheduler is gone; the same command goes on with what is not done"
            raise SidestepError(said, field="scheduler") from error
        except Exception as error:  # noqa: BLE001 - whatever happened there; other jobs go on
            yield Ended(job, None, in_words(error))
            continue
        _write(files, out / job.name)
        future.release()
        yield Ended(job, result)


async def _answers(address: str) -> None:
    """Wait for a greeting: Dask's own patience ends with a connection, which also a process that hangs takes."""
    from distributed import Security
    from distributed.comm.core import connect

    arguments = Security().get_connection_args("client")  # type: ignore[no-untyped-call]
    connecting = connect(address, timeout=PATIENCE, **arguments)  # type: ignore[no-untyped-call]
    try:
        comm = await asyncio.wait_for(connecting, PATIENCE + 1)  # later than it gives up connecting by itself
    except TimeoutError as error:
        raise TimeoutError(f"connected, but nothing came in {PATIENCE:g} s") from error
    comm.abort()


def _why_not(address: str, error: Exception) -> str:
    """Why there is no connection, in Sidestep's words where it is for the lack of the right certificates."""
    from distributed import Security

    asked: Any = Security()  # type: ignore[no-untyped-call]
    if address.startswith("tls://"):
        why = _certificates_fault(asked, error)
    elif asked.require_encryption:
        why = "distributed.comm.require-encryption is on here, so the address must begin with tls://"
    elif isinstance(error.__cause__, ConnectionResetError):
        why = "no scheduler answers there without certificates; one that has them has an address with tls://"
    elif isinstance(error, MemoryError):
        why = "what answers there is no scheduler, but perhaps a web server"  # whose words were read as a length
    else:
        why = None
    return why or f"no scheduler answers there: {' '.join(str(error).split()) or type(error).__name__:.200}"


def _certificates_fault(asked: Any, error: Exception) -> str | None:
    """What is wrong with the certificates that are asked for, here or there; None where it is not they."""
    from distributed.comm.core import FatalCommClosedError

    ca, cert, key = (f"distributed.comm.tls.{name}" for name in ("ca-file", "client.cert", "client.key"))
    files = {ca: asked.tls_ca_file, cert: asked.tls_client_cert, key: asked.tls_client_key}
    if unread := _unreadable(files, {ca, cert}):
        return unread
    if isinstance(error, ssl.SSLError):
        return f"{ca}, {cert} and {key} must name files of PEM, the last two a pair ({error.reason or error})"
    if isinstance(error.__cause__, ssl.SSLCertVerificationError):
        said = error.__cause__.verify_message
        return f"the scheduler's certificate is not of the authority in {files[ca]}, {ca}, or is out of date ({said})"
    if isinstance(error, FatalCommClosedError) or isinstance(error.__cause__, ssl.SSLError):
        return f"the scheduler has no certificate, or not the authority of {files[cert]}, {cert}"
    return None


def _unreadable(files: dict[str, str | None], needed: set[str]) -> str | None:
    """What keeps files from being read, by the settings of Dask that name them."""
    for name, file in files.items():
        if file is None and name in needed:  # a key may be in its certificate's file
            variable = "DASK_" + name.replace(".", "__").replace("-", "_").upper()
            return f"tls:// takes certificates: Dask's configuration must name a file as {name} (or {variable})"
        try:
            if file is not None and "\n" not in file:  # what it would hold may stand there itself
                Path(file).open("rb").close()
        except OSError as error:
            return f"cannot read {file}, {name} ({reason(error)}); relative paths are from the working folder"
    return None


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
