"""Listening: sockets, processes, logs, and a graceful stop."""

import logging.config
import math
import os
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple, cast

import uvicorn
from fastapi import FastAPI
from pythonjsonlogger.core import RESERVED_ATTRS
from uvicorn.config import STARTUP_FAILURE
from uvicorn.supervisors import Multiprocess

from sidestep.errors import SidestepError
from sidestep.server.app import make_app
from sidestep.server.connections import IDLE, Connection
from sidestep.server.settings import KEY_VARIABLE, SETTINGS_VARIABLE, Settings
from sidestep.server.town import ServedTown

METRICS_VARIABLE = "PROMETHEUS_MULTIPROC_DIR"
"""The environment variable that tells the library where processes share their metrics."""
NOT_STARTED = "the server did not start; its log above says why"
SPREADS = sys.platform == "linux"
"""Whether the system spreads connections over several sockets of one address."""
STOPPING = 10
"""Seconds that requests under way have to end after Ctrl-C or SIGTERM."""
ENDING = STOPPING + 2
"""Seconds after which workers are ended that have not ended themselves: those that hang never would."""
HANGING = 60
"""Seconds after which a worker that says nothing is ended, and another begun: on a busy machine imports take long."""
_log = logging.getLogger("sidestep.server")


def run(settings: Settings, port: int, *, as_json: bool, said: Callable[[str], None]) -> None:
    """Listen until the process is told to stop.

    Parameters
    ----------
    settings, port
        Of the server; port 0 is any that is free.
    as_json
        Whether all that is said is JSON: the address, and a line for each request.
    said
        Takes the address for those who started it, where it is not JSON.

    Raises
    ------
    SidestepError
        A scenario that cannot be served, a key that cannot be used, an address that cannot be listened on (field
        ``port``).
    SystemExit
        After SIGTERM, with status 0; instead of the error above, where all that is said is JSON, with status 2.
    """
    if not as_json:
        _listen_until_told(settings, port, as_json=False, said=said)
        return
    logging.config.dictConfig(log_config(as_json=True))
    try:
        _listen_until_told(settings, port, as_json=True, said=said)
    except SidestepError as error:
        _log.error(str(error), extra={"field": error.field})
        raise SystemExit(2) from None


def _listen_until_told(settings: Settings, port: int, *, as_json: bool, said: Callable[[str], None]) -> None:
    key = settings.key()
    with suppress(KeyboardInterrupt), _listen(settings.host, port) as listening:
        shown = f"[{settings.host}]" if ":" in settings.host else settings.host
        address = f"http://{shown}:{listening.getsockname()[1]}/"

        def ready() -> None:
            if as_json:
                _log.info("serving", extra={"scenario": settings.scenario, "address": address})
            else:
                said(f"Serving {settings.scenario} at {address} (stop with Ctrl-C)")

        if settings.workers == 1:
            config = _config(settings, make_app(settings, _loaded(settings)), as_json=as_json)
            ready()
            _run(config, listening)
        else:
            _loaded(settings).close()  # each process has its own
            os.environ[SETTINGS_VARIABLE] = settings.model_dump_json()
            if key is not None:
                os.environ[KEY_VARIABLE] = key  # never on a command line
            config = _config(settings, "sidestep.server.app:make_app", as_json=as_json)
            _run_workers(config, listening, ready)


def _loaded(settings: Settings) -> ServedTown:
    """The town, loaded before anything is printed, since most of what can be wrong is found then."""
    # In a thread: JAX swallows a Ctrl-C that comes while it is called back in the main one.
    return ThreadPoolExecutor(1).submit(ServedTown, settings).result()


def _config(settings: Settings, app: FastAPI | str, *, as_json: bool) -> uvicorn.Config:
    """The framework's settings, for an app or the name of the function that makes it."""
    return uvicorn.Config(
        app,
        factory=isinstance(app, str),
        workers=settings.workers,
        http=Connection,
        log_config=log_config(as_json=as_json),
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=STOPPING,
        timeout_worker_healthcheck=HANGING,
        timeout_keep_alive=math.ceil(IDLE),
        ws="none",
        lifespan="on",
        proxy_headers=False,  # the app has its own
    )


def _run(config: uvicorn.Config, listening: socket.socket) -> None:
    server = uvicorn.Server(config)

    def stop(*_: object) -> None:
        # uvicorn sends itself the signal again that it was stopped by; after a graceful stop that is no failure.
        if not server.should_exit:
            raise SystemExit(0)

    signal.signal(signal.SIGTERM, stop)
    try:
        server.run(sockets=[listening])
    except SystemExit as ended:
        if ended.code == STARTUP_FAILURE:
            raise SidestepError(NOT_STARTED, field="serve") from None
        raise


def _run_workers(config: uvicorn.Config, listening: socket.socket, ready: Callable[[], None]) -> None:
    with tempfile.TemporaryDirectory(prefix="sidestep-metrics-", ignore_cleanup_errors=True) as folder:
        os.environ[METRICS_VARIABLE] = folder
        workers = _Workers(config, listening, ready)
        workers.run()
    if any(each.exitcode == STARTUP_FAILURE for each in workers.processes):
        raise SidestepError(NOT_STARTED, field="serve")


class _Workers(Multiprocess):
    """Several processes; their metrics are in files, so that any of them can tell the sum."""

    def __init__(self, config: uvicorn.Config, listening: socket.socket, ready: Callable[[], None]) -> None:
        self._ready: Callable[[], None] | None = ready
        if SPREADS:
            host, port = listening.getsockname()[:2]
            listening.close()
            self._reserved = _reserved(host, port)
            listening = cast("socket.socket", _OwnSocket(host, port))
        super().__init__(config, [listening])
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._stop)

    def init_processes(self) -> None:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # they inherit it; until they are told how to stop
        super().init_processes()
        signal.signal(signal.SIGINT, before)

    def keep_subprocess_alive(self) -> None:
        super().keep_subprocess_alive()
        if self._ready is not None and any(each.is_ready() for each in self.processes):
            self._ready()
            self._ready = None

    def _stop(self, *_: object) -> None:
        threading.Thread(target=self._end, name="ending", daemon=True).start()

    def _end(self) -> None:
        self.should_exit.set()
        for each in self.processes:
            with suppress(OSError, TypeError):  # closed already, or just now
                each.child_conn.send(False)  # for one that hangs, for whose answer the main thread may be waiting
        time.sleep(ENDING)
        for each in self.processes:
            each.process.kill()


class _OwnSocket(NamedTuple):
    """Becomes a socket in the process that it is sent to; the system spreads connections over those of one address.

    Of a socket that processes share, the first to wake takes all connections that wait, and keeps them.
    """

    host: str
    port: int

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(_bind, share=True), (self.host, self.port)


def _listen(host: str, port: int) -> socket.socket:
    """A socket that listens at an address, which nobody else has."""
    found = _bind(host, port)
    try:
        found.listen()
    except OSError as error:
        found.close()
        raise _taken(host, port, error) from error
    return found


def _reserved(host: str, port: int) -> socket.socket:
    """A socket that keeps an address for those that share it, and listens to nobody."""
    try:
        return _bind(host, port, share=True, reuse=False)
    except SidestepError:  # connections of an earlier server are ending, and anybody may have the address meanwhile
        return _bind(host, port, share=True)


def _bind(host: str, port: int, *, share: bool = False, reuse: bool = True) -> socket.socket:
    """A socket at an address, which others may have as well that ``share`` it."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, reuse)
    if share:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    try:
        found.bind((host, port))
    except (OSError, ValueError) as error:  # ValueError: what cannot be a name at all
        found.close()
        raise _taken(host, port, error) from error
    found.setblocking(False)
    return found


def _taken(host: str, port: int, error: Exception) -> SidestepError:
    said = f"cannot listen on {host!r:.80}, port {port}: {getattr(error, 'strerror', None) or 'it is no address'}"
    return SidestepError(f"{said}; choose another --port or --host", field="port")


def log_config(*, as_json: bool) -> dict[str, Any]:
    """The log of the server: one line for each request, on standard error."""
    names = "asctime", "levelname", "name", "message"
    form = " ".join(f"%({name})s" for name in names)
    formatter: dict[str, Any] = {
        "()": "pythonjsonlogger.json.JsonFormatter",
        "fmt": form,
        "reserved_attrs": [*RESERVED_ATTRS, "color_message"],  # uvicorn's, with colours of a terminal
    }
    access = formatter
    if not as_json:
        formatter = {"format": "%(levelname)s: %(message)s"}
        access = {"format": "%(asctime)s %(method)s %(route)s %(status)s %(milliseconds)s ms"}
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "formatters": {"plain": formatter, "access": access},
        "handlers": {
            name: {"class": "logging.StreamHandler", "formatter": name, "stream": "ext://sys.stderr"}
            for name in ("plain", "access")
        },
        "loggers": {
            "uvicorn": {"handlers": ["plain"], "level": "WARNING" if not as_json else "INFO", "propagate": False},
            "sidestep": {"handlers": ["plain"], "level": "INFO", "propagate": False},
            "sidestep.access": {"handlers": ["access"], "level": "INFO", "propagate": False},
        },
    }
