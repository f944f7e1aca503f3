"""The HTTP API: which paths there are, and who answers."""

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.middleware.cors import CORSMiddleware
from starlette.responses import Response

from sidestep import __version__
from sidestep.errors import SidestepError
from sidestep.server import crowd_paths, operation_paths, osrm_paths
from sidestep.server.guard import Guard
from sidestep.server.problems import JsonResponse, ProblemError, on_error, on_validation, refused
from sidestep.server.settings import SETTINGS_VARIABLE, Settings
from sidestep.server.town import ServedTown


def make_app(settings: Settings | None = None) -> FastAPI:
    """Make the app.

    Parameters
    ----------
    settings
        Of the server; by default those in the environment, where worker processes find them.

    Returns
    -------
    FastAPI
        It loads its town as it starts.
    """
    chosen = settings or Settings.model_validate_json(os.environ.get(SETTINGS_VARIABLE, "{}"))

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        app.state.town = await asyncio.to_thread(ServedTown, chosen)
        await asyncio.to_thread(app.state.town.warm)
        app.state.ready = True
        yield
        app.state.ready = False

    app = FastAPI(
        title="Sidestep",
        version=__version__,
        summary="Walks through crowds: routes, tables, isochrones, and live counts.",
        lifespan=lifespan,
        docs_url=None,  # these pages load scripts from other hosts
        redoc_url=None,
        default_response_class=JsonResponse,
    )
    app.state.ready = False
    app.add_exception_handler(SidestepError, on_error)
    app.add_exception_handler(RequestValidationError, on_validation)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(Exception, _on_exception)
    for paths in (osrm_paths, crowd_paths, operation_paths):
        app.include_router(paths.router)
    if chosen.origins:
        app.add_middleware(CORSMiddleware, allow_origins=chosen.origins, allow_methods=["*"], allow_headers=["*"])
    app.add_middleware(Guard, settings=chosen)
    return app


async def _on_http(request: Request, error: Exception) -> Response:
    status = getattr(error, "status_code", 500)
    said = "there is nothing at this address" if status == 404 else str(getattr(error, "detail", "this cannot be done"))
    return refused(request.url.path, ProblemError(status, said, headers=dict(getattr(error, "headers", None) or {})))


async def _on_exception(request: Request, _error: Exception) -> Response:
    return refused(request.url.path, ProblemError(500, "something went wrong in the server; its log says what"))
