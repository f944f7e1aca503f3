"""Listening: sockets, processes, logs, and a graceful stop."""

import os
import socket
import tempfile
from collections.abc import Callable
from typing import Any

import uvicorn

from sidestep.errors import SidestepError
from sidestep.scenarios.reader import find_scenario
from sidestep.server.settings import KEY_VARIABLE, SETTINGS_VARIABLE, Settings
from sidestep.server.town import venue_of

STOPPING = 10
"""Seconds that requests under way have to end after Ctrl-C or SIGTERM."""
IDLE = 20
"""Seconds after which connections without a request are closed."""
MOST_CONNECTIONS = 1000
"""Connections and tasks of one process; more are answered with 503."""


def run(settings: Settings, port: int, *, as_json: bool, said: Callable[[str], None]) -> None:
    """Listen until the process is told to stop.

    Parameters
    ----------
    settings, port
        Of the server; port 0 is any that is free.
    as_json
        Whether the log is JSON, a line for each request.
    said
        Takes what is to be printed for whoever started it.

    Raises
    ------
    SidestepError
        A scenario that cannot be served, a key that cannot be used, an address that cannot be listened on (field
        ``port``).
    """
    venue_of(find_scenario(settings.scenario))
    key = settings.key()
    if key is not None:
        os.environ[KEY_VARIABLE] = key  # for worker processes; never on a command line
    listening = _listen(settings.host, port)
    os.environ[SETTINGS_VARIABLE] = settings.model_dump_json()
    if settings.workers > 1:
        os.environ.setdefault("PROMETHEUS_MULTIPROC_DIR", tempfile.mkdtemp(prefix="sidestep-metrics-"))
    config = uvicorn.Config(
        "sidestep.server.app:make_app",
        factory=True,
        workers=settings.workers,
        log_config=log_config(as_json=as_json),
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=STOPPING,
        timeout_keep_alive=IDLE,
        limit_concurrency=MOST_CONNECTIONS,
        ws="none",
        lifespan="on",
        proxy_headers=False,
    )
    shown = f"[{settings.host}]" if ":" in settings.host else settings.host
    said(f"Serving {settings.scenario} at http://{shown}:{listening.getsockname()[1]}/ (stop with Ctrl-C)")
    server = uvicorn.Server(config)
    if settings.workers > 1:
        from uvicorn.supervisors import Multiprocess

        Multiprocess(config, sockets=[listening]).run()
    else:
        server.run(sockets=[listening])
    if not server.started and settings.workers == 1:
        raise SidestepError("the server did not start; its log above says why", field="serve")


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((host, port))
    except OSError as error:
        found.close()
        said = f"cannot listen on {host}, port {port}: {error.strerror or error}"
        raise SidestepError(f"{said}; choose another --port or --host", field="port") from error
    found.listen(2048)
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
