"""Jobs on this machine: worker processes that stay from job to job, and are replaced where they are killed."""

import multiprocessing
import os
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidestep.compilation import SMALLEST, configure, keep_compiled
from sidestep.errors import SidestepError
from sidestep.files import OutputError

if TYPE_CHECKING:
    from sidestep.experiments.study import Job

RETRIES = 3
"""How often a job is begun again whose worker died."""


@dataclass(frozen=True)
class Ended:
    """A job that has come to its end."""

    job: "Job"
    result: dict[str, Any] | None
    """None where it failed."""
    error: str = ""
    """Why it failed, in one sentence."""


def start_worker() -> None:
    """Set this process up for jobs; it has not computed anything yet."""
    os.environ.setdefault("PJRT_NPROC", "1")  # one thread of XLA: workers share the processors
    # On a GPU the first worker would take most of the memory for itself.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    keep_compiled()
    configure(SMALLEST)


def run_locally(jobs: Sequence["Job"], out: Path, workers: int) -> Generator[Ended]:
    """Do jobs, several at a time.

    Parameters
    ----------
    jobs
        What to do, in this order.
    out
        Folder of the study.
    workers
        Number of processes.

    Yields
    ------
    Ended
        Each job as it ends.

    Raises
    ------
    OutputError
        A disk is full, or the folder can't be written to any more.
    """
    waiting, deaths = deque(jobs), Counter[str]()
    busy: dict[Connection, _Worker] = {}
    idle: list[_Worker] = []
    try:
        while waiting or busy:
            while waiting and len(busy) < workers:
                worker = idle.pop() if idle else _Worker(out)
                busy[worker.channel] = worker
                worker.begin(waiting.popleft())
            wait([*busy])
            for worker in [each for each in busy.values() if each.channel.poll()]:
                del busy[worker.channel]
                job = worker.job
                try:
                    result, error, full = worker.channel.recv()
                except (EOFError, OSError):
                    deaths[job.name] += 1
                    said = worker.end()
                    if deaths[job.name] <= RETRIES:
                        waiting.appendleft(job)
                    else:
                        yield Ended(job, None, f"its worker died {deaths[job.name]} times, at last {said}")
                    continue
                if full:
                    raise OutputError(error, field="out")
                idle.append(worker)
                yield Ended(job, result, error)
    finally:
        for worker in (*busy.values(), *idle):
            worker.end()


class _Worker:
    """A process that does jobs."""

    job: "Job"
    """The latest that it began."""

    def __init__(self, out: Path) -> None:
        context = multiprocessing.get_context("spawn")
        self.channel, other = context.Pipe()
        self._process = context.Process(target=_work, args=(other, out), daemon=True)
        with _without_interrupts():
            self._process.start()
        other.close()

    def begin(self, job: "Job") -> None:
        """Begin a job. A process that is dead closes its channel, which is noticed there."""
        self.job = job
        with suppress(OSError):
            self.channel.send(job)

    def end(self) -> str:
        """Kill the process, which leaves files whole, and say how it had ended before."""
        self._process.kill()
        self._process.join()
        self.channel.close()
        code = self._process.exitcode or 0
        return f"by signal {-code}" if code < 0 else f"with exit status {code}"


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Ctrl-C goes to all processes of a terminal: those started here, which this one ends, say nothing about it."""
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # which would let Ctrl-C in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(channel: Connection, out: Path) -> None:
    """Do one job after the other, until there is nobody who would ask for more."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    start_worker()
    from sidestep.experiments.jobs import run_job

    before = None
    while True:
        try:
            job: Job = channel.recv()
        except EOFError:
            return
        if before not in (None, (job.scenario, job.agent)):
            _forget_compiled()
        before = job.scenario, job.agent
        channel.send(_outcome(run_job, job, out))


def _outcome(
    run: Callable[["Job", Path], dict[str, Any]], job: "Job", out: Path
) -> tuple[dict[str, Any] | None, str, bool]:
    """The result of a job or its error, and whether that stops all others as well."""
    try:
        return run(job, out), "", False
    except OutputError as error:
        return None, str(error), True
    except Exception as error:  # noqa: BLE001 - of planners of one's own, or of a library; other jobs go on
        return None, in_words(error), False


def in_words(error: BaseException) -> str:
    """One sentence that says why a job failed."""
    return str(error) if isinstance(error, SidestepError) else f"{type(error).__name__}: {error}"


def _end_with_parent() -> None:
    """End this process, in the middle of whatever it does, when the one that started it is gone."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _forget_compiled() -> None:
    """Free what was compiled for jobs of another kind, which would take gigabytes in the end."""
    import jax

    from sidestep import programs

    jax.clear_caches()  # type: ignore[no-untyped-call]
    programs.clear_caches()
