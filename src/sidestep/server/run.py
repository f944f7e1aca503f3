"""Listening: sockets, processes, logs, and a graceful stop."""

import math
import os
import signal
import socket
import tempfile
from collections.abc import Callable
from typing import Any

import uvicorn
from uvicorn.config import STARTUP_FAILURE
from uvicorn.supervisors import Multiprocess

from sidestep.errors import SidestepError
from sidestep.scenarios.reader import find_scenario
from sidestep.server.connections import IDLE, Connection
from sidestep.server.settings import KEY_VARIABLE, SETTINGS_VARIABLE, Settings
from sidestep.server.town import venue_of

METRICS_VARIABLE = "PROMETHEUS_MULTIPROC_DIR"
"""The environment variable that tells the library where processes share their metrics."""
NOT_STARTED = "the server did not start; its log above says why"
STOPPING = 10
"""Seconds that requests under way have to end after Ctrl-C or SIGTERM."""


def run(settings: Settings, port: int, *, as_json: bool, said: Callable[[str], None]) -> None:
    """Listen until the process is told to stop.

    Parameters
    ----------
    settings, port
        Of the server; port 0 is any that is free.
    as_json
        Whether the log is JSON, a line for each request.
    said
        Takes what is to be printed for those who started it.

    Raises
    ------
    SidestepError
        A scenario that cannot be served, a key that cannot be used, an address that cannot be listened on (field
        ``port``).
    SystemExit
        After SIGTERM, with status 0.
    """
    venue_of(find_scenario(settings.scenario))
    key = settings.key()
    if key is not None:
        os.environ[KEY_VARIABLE] = key  # for worker processes; never on a command line
    listening = _listen(settings.host, port)
    os.environ[SETTINGS_VARIABLE] = settings.model_dump_json()
    config = uvicorn.Config(
        "sidestep.server.app:make_app",
        factory=True,
        workers=settings.workers,
        http=Connection,
        log_config=log_config(as_json=as_json),
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=STOPPING,
        timeout_keep_alive=math.ceil(IDLE),
        ws="none",
        lifespan="on",
        proxy_headers=False,
    )
    shown = f"[{settings.host}]" if ":" in settings.host else settings.host
    said(f"Serving {settings.scenario} at http://{shown}:{listening.getsockname()[1]}/ (stop with Ctrl-C)")
    if settings.workers > 1:
        _run_workers(config, listening)
        return
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


class _Workers(Multiprocess):
    """Several processes; their metrics are in files, so that any of them can tell the sum."""

    interrupted = False

    def handle_int(self) -> None:
        super().handle_int()
        self.interrupted = True


def _run_workers(config: uvicorn.Config, listening: socket.socket) -> None:
    with tempfile.TemporaryDirectory(prefix="sidestep-metrics-", ignore_cleanup_errors=True) as folder:
        os.environ[METRICS_VARIABLE] = folder
        workers = _Workers(config, sockets=[listening])
        workers.run()
    if any(each.exitcode == STARTUP_FAILURE for each in workers.processes):
        raise SidestepError(NOT_STARTED, field="serve")
    if workers.interrupted:
        raise KeyboardInterrupt


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((host, port))
        found.listen(2048)
    except (OSError, ValueError) as error:  # ValueError: what cannot be a name at all
        found.close()
        said = f"cannot listen on {host!r:.80}, port {port}: {getattr(error, 'strerror', None) or 'it is no address'}"
        raise SidestepError(f"{said}; choose another --port or --host", field="port") from error
    found.setblocking(False)
    return found


def log_config(*, as_json: bool) -> dict[str, Any]:
    """The log of the server: one line for each request, on standard error."""
    names = "asctime", "levelname", "name", "message"
    form = " ".join(f"%({name})s" for name in names)
    formatter: dict[str, Any] = {"()": "pythonjsonlogger.json.JsonFormatter", "fmt": form}
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
