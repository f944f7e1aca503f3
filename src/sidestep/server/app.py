"""The HTTP API: which paths there are, and who answers."""

import asyncio
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime
from types import FrameType
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import Response
from starlette.routing import Match, Route
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from sidestep import __version__
from sidestep.errors import SidestepError
from sidestep.server import (
    clock_paths,
    count_paths,
    crowd_paths,
    operation_paths,
    osrm_paths,
    page_paths,
    walk_paths,
)
from sidestep.server.bus import Bus
from sidestep.server.guard import Guard, where
from sidestep.server.problems import JsonResponse, ProblemError, is_osrm, on_error, on_validation, refused
from sidestep.server.settings import SETTINGS_VARIABLE, Settings
from sidestep.server.store import StoreError
from sidestep.server.town import ServedTown

PATHS = (osrm_paths, crowd_paths, count_paths, walk_paths, clock_paths, operation_paths, page_paths)
SWITCHING = 0.0005
"""Seconds after which a thread lets others go on: quick answers come from one, those that take long from others."""
COMPRESSED = 50_000
"""Bytes from which answers are compressed, such as all streets; routes have fewer."""
LONGEST_PAUSE = 0.5
"""Seconds at most that crowds rest after they went on from counts; otherwise as long as that took."""
FORGETTING = 60.0
"""Seconds after which what is too old is deleted."""
_CORS: dict[str, Any] = {
    "allow_methods": ["GET", "POST", "PUT", "DELETE"],
    "allow_headers": ["authorization", "content-type", "if-none-match"],
    "expose_headers": ["etag", "retry-after"],
    "max_age": 600,
}
_log = logging.getLogger("sidestep.server")


def make_app(settings: Settings | None = None, town: ServedTown | None = None) -> FastAPI:
    """Make the app.

    Parameters
    ----------
    settings
        Of the server; by default those in the environment, where worker processes find them.
    town
        What is served; by default it is loaded as the app starts.

    Returns
    -------
    FastAPI
        The app, which closes the town as it stops.
    """
    chosen = settings or Settings.model_validate_json(os.environ.get(SETTINGS_VARIABLE, "{}"))

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        try:
            served = await asyncio.to_thread(ServedTown, chosen) if town is None else town
            app.state.town = served
            await asyncio.to_thread(served.warm)
        except SidestepError as error:
            app.state.failure = str(error)
            raise
        bus = app.state.bus = Bus()
        _end_at_signals(bus)
        preparing = app.state.preparing = asyncio.create_task(_prepare(served))
        keeping = asyncio.create_task(_keep_fresh(served, bus))
        app.state.ready = True
        sys.setswitchinterval(SWITCHING)
        yield
        app.state.ready = False
        preparing.cancel()
        keeping.cancel()
        served.close()

    app = FastAPI(
        title="Sidestep",
        version=__version__,
        summary="Walks through crowds: routes, tables, isochrones, and live counts.",
        lifespan=lifespan,
        docs_url=None,  # these pages load scripts from other hosts
        redoc_url=None,
        redirect_slashes=False,  # redirects would go to whatever host the client says
        default_response_class=JsonResponse,
    )
    app.state.ready, app.state.settings, app.state.key = False, chosen, chosen.key()
    app.add_exception_handler(SidestepError, on_error)
    app.add_exception_handler(RequestValidationError, on_validation)
    app.add_exception_handler(HTTPException, _on_http)
    routers = [each.router for each in PATHS]
    for router in routers:
        app.include_router(router)
    app.state.routes = [route for router in routers for route in router.routes if isinstance(route, Route)]
    if chosen.origins:
        app.add_middleware(CORSMiddleware, **_CORS, allow_origins=chosen.origins)
    app.add_middleware(GZipMiddleware, minimum_size=COMPRESSED)
    app.add_middleware(Guard, settings=chosen)
    if chosen.proxies:  # around the guard, which counts the requests of each client
        app.add_middleware(ProxyHeadersMiddleware, trusted_hosts=list(chosen.proxies))
    return app


async def _on_http(request: Request, error: Exception) -> Response:
    status = getattr(error, "status_code", 500)
    path, said = request.url.path, str(getattr(error, "detail", "this cannot be done"))
    headers = {name.lower(): value for name, value in (getattr(error, "headers", None) or {}).items()}
    if status == 405 and request.method == "GET" and is_osrm(path):
        status = 404  # what is only sent in a body has no address to get
    if status == 404:
        said = "there is nothing at this address"
    elif status == 405:
        matching = [each for each in request.app.state.routes if each.matches(request.scope)[0] != Match.NONE]
        headers["allow"] = ", ".join(sorted({method for each in matching for method in each.methods}))
        said = f"this address takes {headers['allow']}"
    return refused(path, ProblemError(status, said, headers=headers))


def _end_at_signals(bus: Bus) -> None:
    """Let listeners go as soon as the process is told to stop, which otherwise waits for them."""
    if threading.current_thread() is not threading.main_thread():
        return
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        before = signal.getsignal(number)

        def stop(number: int, frame: FrameType | None, before: Any = before) -> None:
            loop.call_soon_threadsafe(bus.end)
            if callable(before):
                before(number, frame)

        signal.signal(number, stop)


async def _prepare(served: ServedTown) -> None:
    """Compile in a thread, step by step: a server that stops waits for one step at most."""
    steps = served.prepare()
    while step := await asyncio.to_thread(next, steps, None):
        await asyncio.to_thread(step)


async def _keep_fresh(served: ServedTown, bus: Bus) -> None:
    """Let crowds go on from the latest counts, also those that other processes store; forget what is too old."""
    forgotten, told = 0.0, served.clock.setting
    loop, news = asyncio.get_running_loop(), asyncio.Event()

    def tell() -> None:
        with suppress(RuntimeError):  # the server has stopped
            loop.call_soon_threadsafe(news.set)

    seconds = served.store.watch(tell)
    while True:
        begun = time.monotonic()
        try:
            if await asyncio.to_thread(served.refresh):
                bus.tell("crowds", served.counting.news)
            if served.clock.setting != told:  # also where another process has set it, or it has lapsed
                told = served.clock.setting
                bus.tell("clock", served.clock.facts)
            if time.monotonic() - forgotten > FORGETTING:
                forgotten = time.monotonic()
                await asyncio.to_thread(served.store.forget, datetime.now(UTC))
        except StoreError as error:
            _log.warning("the store cannot be used: %s", error)
        except SidestepError as error:
            _log.warning("counts cannot be used: %s", error)
        except Exception as error:  # noqa: BLE001 - the next turn may go well, and without turns counts change nothing
            _log.error("error while counts were taken up: %s", where(error))
        # However often somebody posts, routes have their turn.
        await asyncio.sleep(min(time.monotonic() - begun, LONGEST_PAUSE))
        with suppress(TimeoutError):
            await asyncio.wait_for(news.wait(), seconds)
        news.clear()
