"""The command line in this process, and as a process of its own where the process is the point."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import pytest

from sidestep.cli import app as cli


@dataclass(frozen=True)
class Done:
    """A command that has ended."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture(autouse=True)
def little_memory(give_back: Callable[[], None]) -> Iterator[None]:
    """One command may compile so much that what the one before it needed for that must not be kept."""
    yield
    give_back()


@pytest.fixture(scope="session")
def environ() -> dict[str, str]:
    """For processes: a wide terminal, and the run's compiled programs."""
    return {**os.environ, "COLUMNS": "200"}


@pytest.fixture(scope="session")
def sidestep() -> Callable[..., Done]:
    """Run a command in this process, where compiled programs serve again."""

    def run(*args: object, cwd: Path | None = None) -> Done:
        out, err = StringIO(), StringIO()
        with redirect_stdout(out), redirect_stderr(err), chdir(cwd or Path.cwd()):
            status = cli.run([str(arg) for arg in args])
        return Done(status, out.getvalue(), err.getvalue())

    return run


@pytest.fixture(scope="session")
def process(environ) -> Callable[..., subprocess.CompletedProcess]:
    """Run a command as a process of its own."""

    def run(*args: object, cwd: Path | None = None) -> subprocess.CompletedProcess:
        command = [sys.executable, "-m", "sidestep", *map(str, args)]
        return subprocess.run(command, env=environ, cwd=cwd, capture_output=True, text=True, timeout=300)

    return run
