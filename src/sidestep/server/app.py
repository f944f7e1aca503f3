"""The HTTP API: which paths there are, and who answers."""

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Annotated, Any, TypeVar

import numpy as np
from fastapi import FastAPI, Header, Query, Request
from fastapi.exceptions import RequestValidationError
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import BaseModel, ValidationError
from starlette.exceptions import HTTPException
from starlette.middleware.cors import CORSMiddleware
from starlette.responses import Response

from sidestep import __version__
from sidestep.errors import SidestepError
from sidestep.routing.directions import CROWDING
from sidestep.routing.request import read_departure
from sidestep.server import osrm, planning
from sidestep.server.guard import Guard
from sidestep.server.osrm import NearestOptions, RouteOptions, TableOptions, check_profile, read_coordinates
from sidestep.server.problems import JsonResponse, Problem, on_error, on_validation, refused
from sidestep.server.settings import SETTINGS_VARIABLE, Settings
from sidestep.server.town import ServedTown

M = TypeVar("M", bound=BaseModel)
MOST_MINUTES = 8
"""Limits of one isochrone."""
Place = Annotated[str, Query(max_length=80, description="Longitude and latitude, with a comma between them.")]
Time = Annotated[
    str | None, Query(max_length=40, description="Local time: ISO 8601, Fri 17:30 or 17:30; by default now.")
]
Word = Annotated[str | None, Query(max_length=200)]
Futures = Annotated[int | None, Query(ge=1, le=1000, description="Simulated futures.")]


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
    _add_osrm(app)
    _add_more(app)
    _add_operations(app)
    if chosen.origins:
        app.add_middleware(CORSMiddleware, allow_origins=chosen.origins, allow_methods=["*"], allow_headers=["*"])
    app.add_middleware(Guard, settings=chosen)
    return app


async def _on_http(request: Request, error: Exception) -> Response:
    status = getattr(error, "status_code", 500)
    said = "there is nothing at this address" if status == 404 else str(getattr(error, "detail", "this cannot be done"))
    return refused(request.url.path, Problem(status, said, headers=dict(getattr(error, "headers", None) or {})))


async def _on_exception(request: Request, _error: Exception) -> Response:
    return refused(request.url.path, Problem(500, "something went wrong in the server; its log says what"))


def _town(request: Request) -> ServedTown:
    served: ServedTown = request.app.state.town
    return served


async def _body(request: Request, model: type[M]) -> M:
    """The body of a request, strictly as JSON.

    Raises
    ------
    Problem
        Bodies of another type (415).
    RequestValidationError
        Anything that the model does not allow.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in {"application/json", ""}:
        raise Problem(415, f"the body must be application/json, not {kind!r:.60}", field="content-type")
    try:
        return model.model_validate_json(await request.body())
    except ValidationError as error:
        raise RequestValidationError(error.errors(include_url=False)) from error


def _add_osrm(app: FastAPI) -> None:
    """The services of OSRM, version 1."""

    async def planned(
        request: Request, coordinates: osrm.Coordinates, options: RouteOptions, avoid: dict[str, Any] | None
    ) -> Response:
        served = _town(request)
        if planning.is_quick(served, options, avoid):
            return JsonResponse(planning.route(served, coordinates, options))
        return JsonResponse(await served.heavily(lambda: planning.route(served, coordinates, options, avoid)))

    @app.get("/route/v1/{profile}/{coordinates:path}", tags=["OSRM"])
    async def route(
        request: Request, profile: str, coordinates: str, options: Annotated[RouteOptions, Query()]
    ) -> Response:
        """Plan a route through places, as OSRM does, by expected crowds."""
        check_profile(profile)
        return await planned(request, read_coordinates(coordinates), options, None)

    @app.post("/route/v1/{profile}", tags=["OSRM"], openapi_extra=_takes(osrm.RouteBody))
    async def route_of_body(request: Request, profile: str) -> Response:
        """The same with a JSON body, which may have areas to avoid."""
        check_profile(profile)
        body = await _body(request, osrm.RouteBody)
        return await planned(request, osrm.check_coordinates(body.coordinates), body, body.avoid)

    @app.get("/table/v1/{profile}/{coordinates:path}", tags=["OSRM"])
    async def table(
        request: Request, profile: str, coordinates: str, options: Annotated[TableOptions, Query()]
    ) -> Response:
        """Times and lengths of the walks from many places to many others."""
        check_profile(profile)
        served, places = _town(request), read_coordinates(coordinates)
        return JsonResponse(await served.heavily(lambda: planning.table(served, places, options)))

    @app.post("/table/v1/{profile}", tags=["OSRM"], openapi_extra=_takes(osrm.TableBody))
    async def table_of_body(request: Request, profile: str) -> Response:
        """The same with a JSON body."""
        check_profile(profile)
        served, body = _town(request), await _body(request, osrm.TableBody)
        places = osrm.check_coordinates(body.coordinates)
        return JsonResponse(await served.heavily(lambda: planning.table(served, places, body)))

    @app.get("/nearest/v1/{profile}/{coordinates:path}", tags=["OSRM"])
    async def nearest(
        request: Request, profile: str, coordinates: str, options: Annotated[NearestOptions, Query()]
    ) -> Response:
        """The streets nearest to a place."""
        check_profile(profile)
        return JsonResponse(planning.nearest(_town(request), read_coordinates(coordinates), options))

    @app.post("/nearest/v1/{profile}", tags=["OSRM"], openapi_extra=_takes(osrm.NearestBody))
    async def nearest_of_body(request: Request, profile: str) -> Response:
        """The same with a JSON body."""
        check_profile(profile)
        body = await _body(request, osrm.NearestBody)
        return JsonResponse(planning.nearest(_town(request), osrm.check_coordinates(body.coordinates), body))


def _takes(model: type[BaseModel]) -> dict[str, Any]:
    """What the OpenAPI document says of a body that is read here."""
    return {"requestBody": {"required": True, "content": {"application/json": {"schema": model.model_json_schema()}}}}


def _place(field: str, text: str) -> tuple[float, float]:
    """Latitude and longitude of a parameter, which has the longitude first."""
    try:
        ((longitude, latitude),) = read_coordinates(text, 1)
    except (Problem, ValueError) as error:
        said = f"{field} must be LONGITUDE,LATITUDE in degrees, such as 24.94,60.17, not {text!r:.60}"
        raise Problem(400, said, field=field) from error
    return latitude, longitude


def _numbers(field: str, text: str, most: int) -> list[float]:
    """Numbers with commas between them."""
    try:
        found = [float(each) for each in text.split(",")]
    except ValueError as error:
        raise Problem(400, f"{field} must be numbers with commas between them", field=field) from error
    if len(found) > most:
        raise Problem(400, f"{field} may be {most} numbers at most", field=field)
    return found


def _add_more(app: FastAPI) -> None:
    """What OSRM does not have."""

    @app.get("/isochrone", tags=["crowds"])
    async def isochrone(
        request: Request,
        origin: Place,
        minutes: Annotated[str, Query(max_length=80)] = "5,10,15",
        depart_at: Time = None,
        planner: Word = None,
        walker: Word = None,
        futures: Futures = None,
    ) -> Response:
        """How far one gets in some minutes, as GeoJSON; with futures in half and in 90 % of them."""
        served, place, limits = _town(request), _place("origin", origin), _numbers("minutes", minutes, MOST_MINUTES)

        def answer() -> dict[str, Any]:
            router = served.routers(walker, None)
            departs = served.asked("depart_at", depart_at)
            return router.isochrone(
                place, minutes=limits, depart=departs, planner=planner, futures=futures
            ).to_geojson()

        return _geojson(await served.heavily(answer))

    @app.get("/when", tags=["crowds"])
    async def when(
        request: Request,
        origin: Place,
        destination: Place,
        depart_at: Time = None,
        until: Time = None,
        step: Annotated[float | None, Query(gt=0, description="Minutes between two departures.")] = None,
        arrive_by: Annotated[
            str | None, Query(max_length=40, description="When to be there: each departure then has on_time.")
        ] = None,
        planner: Word = None,
        walker: Word = None,
        futures: Annotated[int, Query(ge=1, le=1000)] = 50,
    ) -> Response:
        """How long the walk takes at every departure of a window, by default of two hours."""
        served, ends = _town(request), (_place("origin", origin), _place("destination", destination))

        def answer() -> dict[str, Any]:
            router = served.routers(walker, None)
            return router.when(
                *ends,
                depart=served.asked("depart_at", depart_at),
                until=read_departure(until, "until"),
                step=step,
                arrive_by=read_departure(arrive_by, "arrive_by"),
                planner=planner,
                futures=futures,
            ).to_json()

        return JsonResponse(await served.heavily(answer))

    @app.get("/crowds", tags=["crowds"])
    async def crowds(request: Request, at: Time = None, *, geometry: bool = True) -> Response:
        """Expected persons/m² on all streets, as GeoJSON or, without geometry, as a list by number of the street."""
        served = _town(request)
        when_ = served.departs(at, "at")
        density = np.round(served.quick.crowds(when_).astype(np.float64), 3).tolist()
        said = {"at": None if when_.date is None else when_.date.isoformat(), **when_.facts(0.0)}
        if not geometry:
            return JsonResponse({**said, "density": density})
        words = [next(word for limit, word in CROWDING if persons < limit) for persons in density]
        features = [
            {**street, "properties": {**street["properties"], "density": persons, "crowding": word}}
            for street, persons, word in zip(served.streets["features"], density, words, strict=True)
        ]
        return _geojson({**served.streets, **said, "features": features})

    @app.get("/streets", tags=["crowds"])
    async def streets(request: Request, if_none_match: Annotated[str | None, Header()] = None) -> Response:
        """All streets, as GeoJSON; they stay as they are as long as the server runs."""
        content, tag = _town(request).streets_json
        headers = {"etag": tag, "cache-control": "max-age=3600"}
        if if_none_match == tag:
            return Response(status_code=304, headers=headers)
        return Response(content, headers=headers, media_type="application/geo+json")

    @app.get("/search", tags=["crowds"])
    async def search(
        request: Request,
        q: Annotated[str, Query(max_length=100)],
        limit: Annotated[int, Query(ge=1, le=50)] = 8,
    ) -> Response:
        """Streets by a part of their names."""
        found = _town(request).names.search(q, limit)
        rows = [
            {
                "name": each.name,
                "longitude": each.place[0],
                "latitude": each.place[1],
                "metres": round(each.metres),
                "streets": each.streets,
            }
            for each in found
        ]
        return JsonResponse(rows)

    @app.get("/town", tags=["crowds"])
    async def town(request: Request) -> Response:
        """What is served: the scenario, whose streets and counts they are, and what may be asked."""
        return JsonResponse(_town(request).facts)

    @app.get("/clock", tags=["crowds"])
    async def clock(request: Request) -> Response:
        """The local time by which the server goes."""
        return JsonResponse(_town(request).clock_facts)


def _geojson(content: dict[str, Any]) -> Response:
    return JsonResponse(content, media_type="application/geo+json")


def _add_operations(app: FastAPI) -> None:
    """What whoever runs the server asks."""

    @app.get("/healthz", tags=["operations"])
    async def healthz() -> Response:
        """Whether the process answers."""
        return JsonResponse({"status": "ok"})

    @app.get("/readyz", tags=["operations"])
    async def readyz(request: Request) -> Response:
        """Whether the town is loaded and routes are planned."""
        if not request.app.state.ready:
            raise Problem(503, "the town is not loaded yet", headers={"retry-after": "1"})
        return JsonResponse({"status": "ready"})

    @app.get("/metrics", tags=["operations"])
    async def metrics() -> Response:
        """Numbers of requests and their times, for Prometheus."""
        return Response(generate_latest(), media_type=CONTENT_TYPE_LATEST)
