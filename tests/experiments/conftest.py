"""The smallest studies, and their sweeps as processes that can be killed."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

SMALL = """
scenarios = "paper-congested"
changes = {{ side = 3, crowded_nodes = 1, horizon = 3600.0 }}
walks = 5
{keys}
[settings]
rounds = {rounds}
round_steps = 64
walkers = 8
batch = 16
capacity = 64
{settings}
"""


@pytest.fixture(scope="session")
def small() -> Callable[..., Path]:
    """Write a small study into a folder, with keys and settings of its own."""

    def write(folder: Path, keys: str = "", settings: str = "", rounds: int = 2) -> Path:
        file = folder / "small.toml"
        file.write_text(SMALL.format(keys=keys, settings=settings, rounds=rounds))
        return file

    return write


@pytest.fixture
def start(tmp_path) -> Iterator[Callable[..., subprocess.Popen]]:
    """Start commands as processes, which are killed in the end."""
    begun = []

    def run(*args: object, program: tuple[str, ...] = ("-m", "sidestep"), **more: str) -> subprocess.Popen:
        environ = {**os.environ, "COLUMNS": "200", **more}
        command = [sys.executable, *program, *map(str, args)]
        pipe = subprocess.PIPE
        before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run in the background
        try:
            begun.append(
                subprocess.Popen(
                    command, env=environ, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True, start_new_session=True
                )
            )
        finally:
            signal.signal(signal.SIGINT, before)
        return begun[-1]

    yield run
    for process in begun:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
