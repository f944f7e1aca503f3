"""Servers as users start them: processes of their own."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

STARTING = 180.0  # s
PROGRAM = ("-m", "sidestep")
ESTABLISHED, LISTENS = "01", "0A"  # in /proc/net/tcp


@dataclass
class Server:
    """A running ``sidestep serve``."""

    process: subprocess.Popen
    log: Path
    port: int = 0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def connect(self, sent: bytes = b"") -> socket.socket:
        made = socket.create_connection(("127.0.0.1", self.port), timeout=20)
        made.sendall(sent)
        return made

    def ask(self, sent: bytes) -> bytes:
        """Send something, and read until the server closes the connection."""
        with self.connect(sent) as made:
            return read_all(made)

    def request(self, method: str, path: str, **more: object) -> httpx.Response:
        return httpx.request(method, f"{self.url}{path}", timeout=120, **more)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.process.wait(30)

    def kill(self) -> None:
        """End it and its workers at once."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()

    def wait_until(self, ready: Callable[[dict], object], seconds: float = STARTING) -> None:
        """Wait until ``/readyz`` says what is wanted."""
        until = time.monotonic() + seconds
        while time.monotonic() < until and self.process.poll() is None:
            if found := re.search(r"http://127\.0\.0\.1:(\d+)/", self.log.read_text()):
                self.port = int(found[1])
                with contextlib.suppress(httpx.TransportError):
                    answer = httpx.get(f"{self.url}/readyz")
                    if answer.status_code == 200 and ready(answer.json()):
                        return
            time.sleep(0.05)
        pytest.fail(self.log.read_text()[-4000:])


def workers_of(server: Server) -> list[int]:
    """The processes of a server of several, once all of them listen."""
    parent = server.process.pid
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    found = [int(each) for each in children if b"resource_tracker" not in Path(f"/proc/{each}/cmdline").read_bytes()]
    until = time.monotonic() + STARTING
    while len(_sockets(server, LISTENS)) < len(found):
        assert time.monotonic() < until
        time.sleep(0.05)
    return found


def connections(server: Server, worker: int) -> int:
    """How many connections of clients one of its processes has."""
    found, held = _sockets(server, ESTABLISHED), 0
    for file in Path(f"/proc/{worker}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed meanwhile
            held += str(file.readlink()) in found
    return held


def _sockets(server: Server, state: str) -> set[str]:
    """Those of its port that are in a state, as the system names them."""
    lines = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return {f"socket:[{line[9]}]" for line in lines if line[1].endswith(f":{server.port:04X}") and line[3] == state}


def read_all(made: socket.socket) -> bytes:
    found = b""
    with contextlib.suppress(ConnectionError):
        while part := made.recv(2**16):
            found += part
    return found


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Let processes take Ctrl-C as usual, also where these tests run in the background, in which shells ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def serving(
    folder: Path,
    scenario: str | Path,
    *options: str,
    program: tuple[str, ...] = PROGRAM,
    environ: dict[str, str] | None = None,
) -> Iterator[Server]:
    """A server on a free port, with a store in the folder unless the options name another.

    It is ended at once: tests that care about how it stops have stopped it before.
    """
    command = [sys.executable, *program, "serve", str(scenario), "--port", "0", *options]
    if "--store" not in options:
        command += ["--store", str(folder / "store.db")]
    log = folder / "log"
    with log.open("w") as file, interruptible():
        process = subprocess.Popen(
            command,
            stdout=file,
            stderr=file,
            cwd=folder,
            env=os.environ if environ is None else environ,
            start_new_session=True,
        )
    server = Server(process, log)
    try:
        server.wait_until(bool)
        yield server
    finally:
        server.kill()
