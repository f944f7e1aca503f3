"""A real terminal of a certain width."""

import fcntl
import os
import pty
import re
import struct
import sys
import termios
from collections.abc import Callable
from threading import Thread

import pytest


def _read(master: int, into: list[bytes]) -> None:
    try:
        while found := os.read(master, 65536):
            into.append(found)
    except OSError:  # nobody writes any more
        pass


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, Callable[[], object]], list[str]]:
    """Call a function whose output goes to a terminal so many columns wide; the lines there, without their styles."""

    def show(width: int, call: Callable[[], object]) -> list[str]:
        master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 50, width, 0, 0))
        written: list[bytes] = []
        reader = Thread(target=_read, args=(master, written))
        reader.start()
        before = os.dup(0)  # programs ask the standard streams how wide the terminal is
        os.dup2(slave, 0)
        try:
            with open(slave, "w", encoding="utf-8") as terminal, monkeypatch.context() as patch:  # noqa: PTH123
                patch.delenv("COLUMNS", raising=False)
                patch.setenv("TERM", "xterm-256color")
                for stream in ("stdout", "stderr"):
                    patch.setattr(sys, stream, terminal)
                call()
        finally:
            os.dup2(before, 0)
            os.close(before)
            reader.join()
            os.close(master)
        return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", b"".join(written).decode()).splitlines()

    return show
