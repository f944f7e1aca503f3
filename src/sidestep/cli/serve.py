"""The commands ``serve`` and ``replay``."""

import math
import re
import signal
import sys
from datetime import datetime
from ipaddress import ip_network
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sidestep.cli import options
from sidestep.errors import SidestepError

FASTEST = 10_000
"""Seconds that a replay may last in each second at most."""
MOST_WORKERS = 64
_HOST = re.compile(r"[a-z0-9]([a-z0-9.-]*[a-z0-9])?")
_ORIGIN = re.compile(rf"https?://({_HOST.pattern}|\[[0-9a-f:]+\])(:\d{{1,5}})?")
_Logs = Literal["text", "json"]


def serve(
    scenario: Annotated[
        str, Parameter(help="Name of a scenario with real streets (see sidestep scenarios), or a scenario file.")
    ] = "helsinki",
    /,
    *,
    model: Annotated[Path | None, Parameter(help="Folder of a trained model, for the planner darp.")] = None,
    host: str = "127.0.0.1",
    port: options.Whole = 8000,
    store: str | None = None,
    api_key_file: Path | None = None,
    cors: Annotated[list[str] | None, Parameter(negative=())] = None,
    name: Annotated[list[str] | None, Parameter(negative=())] = None,
    proxy: Annotated[list[str] | None, Parameter(negative=())] = None,
    rate: float = 1000.0,
    workers: options.Whole = 1,
    logs: _Logs = "text",
) -> None:
    """Serve routes, crowds and a map over HTTP until Ctrl-C or SIGTERM.

    Parameters
    ----------
    host
        Address to listen on; others than this machine's own take counts only with an API key.
    port
        Port to listen on; 0 for any that is free.
    store
        Where counts and walks are kept: a file, or a URL such as postgresql://user@host/name; by default your own file.
    api_key_file
        File with the API key that writes need; by default the key is in the environment, as SIDESTEP_API_KEY.
    cors
        Origin whose pages may ask, such as https://example.org. Repeatable.
    name
        Name by which browsers reach this server, besides localhost and addresses. Repeatable.
    proxy
        Address or network of a proxy whose header X-Forwarded-For is believed, such as 127.0.0.1. Repeatable.
    rate
        Most requests a second of one address.
    workers
        Processes that answer; they share counts and walks through the store.
    logs
        How requests are logged.

    Raises
    ------
    SidestepError
        Options that no server can have, with the option as its field; packages that are not installed.
    ModuleNotFoundError
        Never of packages that may be missing.
    """
    options.check_least(workers=workers)
    _check(host, port, rate, workers)
    _check_others(cors or [], name or [], proxy or [])
    options.start_jax()
    try:
        from sidestep.server.run import run
        from sidestep.server.settings import Settings
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("sidestep"):
            raise
        said = f"the server needs {error.name}, which is not installed"
        raise SidestepError(f"{said}: pip install 'sidestep[serve]'", field="serve") from error
    settings = Settings(
        scenario=scenario,
        model=None if model is None else str(model),
        host=host,
        store=store,
        key_file=None if api_key_file is None else str(api_key_file),
        origins=tuple(cors or ()),
        hosts=tuple(name or ()),
        proxies=tuple(proxy or ()),
        requests_per_second=rate,
        workers=workers,
    )
    run(settings, port, as_json=logs == "json", said=lambda line: print(line, file=sys.stderr, flush=True))


def _check(host: str, port: int, rate: float, workers: int) -> None:
    """Refuse options that no server can have."""
    if workers > MOST_WORKERS:
        raise SidestepError(f"--workers must be {MOST_WORKERS} at most, not {workers}", field="workers")
    if not 0 <= port <= 65535:
        raise SidestepError(f"--port must be 0 to 65535, not {port}", field="port")
    if not host:
        raise SidestepError("--host must be an address or a name, such as 127.0.0.1, not ''", field="host")
    if not 0 < rate < math.inf:
        raise SidestepError(f"--rate must be a positive number, not {rate}", field="rate")


def _check_others(cors: list[str], name: list[str], proxy: list[str]) -> None:
    """Refuse what cannot be an origin, a name of this server, or a proxy."""
    for each in cors:
        if not _ORIGIN.fullmatch(each):
            said = "--cors must be an origin, such as https://example.org, without a path"
            raise SidestepError(f"{said}, not {each!r:.80}", field="cors")
    for each in name:
        if not _HOST.fullmatch(each):
            said = "--name must be a name in lower case, such as walks.example.org, without a port"
            raise SidestepError(f"{said}, not {each!r:.80}", field="name")
    for each in proxy:
        try:
            ip_network(each)
        except ValueError as error:
            said = "--proxy must be an address or a network, such as 127.0.0.1 or 10.1.0.0/16"
            raise SidestepError(f"{said}, not {each!r:.80}", field="proxy") from error


def replay(
    file: Annotated[Path, Parameter(help="Counts in a layout of docs/counts.md.")],
    /,
    *,
    speed: float = 60.0,
    url: str = "http://127.0.0.1:8000",
    begin: str | None = None,
    api_key_file: Path | None = None,
    reading: options.Reading = options.AS_FOUND,
) -> None:
    """Post a file of counts to a server as if they were counted now, hour by hour, until Ctrl-C.

    The server's clock then shows the time of the file, and after the replay, however it ends, its own again.

    Parameters
    ----------
    speed
        Seconds of the file in each second.
    url
        Address of the server.
    begin
        Local time to begin with, such as 2025-05-23T16:00; by default the first of the file.
    api_key_file
        File with the server's API key; by default the key is in the environment, as SIDESTEP_API_KEY.

    Raises
    ------
    SidestepError
        Options that mean nothing, files that cannot be read, and a server that refuses; with its field.
    KeyboardInterrupt
        After Ctrl-C and SIGTERM.
    """
    from sidestep.crowds.counts import read_counts
    from sidestep.routing.request import read_departure
    from sidestep.server.replay import Client
    from sidestep.server.replay import replay as post
    from sidestep.server.settings import Settings

    if not 0 < speed <= FASTEST:
        raise SidestepError(f"--speed must be above 0 and at most {FASTEST:,}, not {speed:g}", field="speed")
    first = read_departure(begin, "begin") if begin is not None else None
    if first is not None and not isinstance(first, datetime):
        raise SidestepError(f"--begin must be a day and a time, such as 2025-05-23T16:00, not {begin}", field="begin")
    key = Settings(key_file=None if api_key_file is None else str(api_key_file)).key()
    table = read_counts(file, reading.layout())
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        post(Client(url, key), table, speed, first, lambda line: print(line, flush=True))
    except KeyboardInterrupt:
        raise KeyboardInterrupt("stopped; the server goes by its own clock again") from None
    finally:
        signal.signal(signal.SIGTERM, before)
