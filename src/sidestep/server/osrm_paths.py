"""The services of OSRM, version 1."""

from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import Response

from sidestep.server import osrm_options, planning, shapes
from sidestep.server.asking import asks, body_of, query_of, takes, town_of
from sidestep.server.osrm_options import NearestOptions, RouteOptions, TableOptions, check_profile, read_coordinates
from sidestep.server.problems import JsonResponse
from sidestep.server.town import MOST_AT_ONCE

router = APIRouter(tags=["OSRM"], responses=shapes.OSRM_PROBLEMS)
MOST_BRIEFLY = 10
"""Places of a table that does not wait for questions that take longer."""


async def _planned(
    request: Request, coordinates: osrm_options.Coordinates, options: RouteOptions, avoid: dict[str, Any] | None
) -> Response:
    served = town_of(request)
    quick = planning.is_quick(served, options, avoid)
    # To find streets by their bearings all of them are looked at.
    if quick and not options.bearings and served.at_once(len(coordinates), options.walker, options.depart_at):
        return JsonResponse(planning.route(served, coordinates, options))
    aside = served.briefly if quick and served.variants.is_made(options.walker) else served.heavily
    return JsonResponse(await aside(lambda: planning.route(served, coordinates, options, avoid)))


async def _table(request: Request, places: osrm_options.Coordinates, options: TableOptions) -> Response:
    served = town_of(request)
    few = len(places) <= MOST_BRIEFLY and served.variants.is_made(options.walker)
    aside = served.briefly if few else served.heavily
    return JsonResponse(await aside(lambda: planning.table(served, places, options)))


async def _nearest(request: Request, coordinates: osrm_options.Coordinates, options: NearestOptions) -> Response:
    served = town_of(request)
    is_made = served.variants.is_made(options.walker)
    if is_made and options.number <= MOST_AT_ONCE and not options.bearings:
        return JsonResponse(planning.nearest(served, coordinates, options))
    aside = served.briefly if is_made else served.heavily
    return JsonResponse(await aside(lambda: planning.nearest(served, coordinates, options)))


@router.get("/route/v1/{profile}/{coordinates:path}", openapi_extra=asks(RouteOptions), responses=shapes.ROUTES)
async def route(request: Request, profile: str, coordinates: str) -> Response:
    """Plan a route through places, as OSRM does, by expected crowds."""
    check_profile(profile)
    return await _planned(request, read_coordinates(coordinates), query_of(request, RouteOptions), None)


@router.post("/route/v1/{profile}", openapi_extra=takes(osrm_options.RouteBody), responses=shapes.ROUTES)
async def route_by_post(request: Request, profile: str) -> Response:
    """The same with a JSON body, which may have areas to avoid."""
    check_profile(profile)
    body = await body_of(request, osrm_options.RouteBody)
    return await _planned(request, osrm_options.check_coordinates(body.coordinates), body, body.avoid)


@router.get("/table/v1/{profile}/{coordinates:path}", openapi_extra=asks(TableOptions), responses=shapes.TABLES)
async def table(request: Request, profile: str, coordinates: str) -> Response:
    """Times and lengths of the walks from many places to many others."""
    check_profile(profile)
    return await _table(request, read_coordinates(coordinates), query_of(request, TableOptions))


@router.post("/table/v1/{profile}", openapi_extra=takes(osrm_options.TableBody), responses=shapes.TABLES)
async def table_by_post(request: Request, profile: str) -> Response:
    """The same with a JSON body."""
    check_profile(profile)
    body = await body_of(request, osrm_options.TableBody)
    return await _table(request, osrm_options.check_coordinates(body.coordinates), body)


@router.get("/nearest/v1/{profile}/{coordinates:path}", openapi_extra=asks(NearestOptions), responses=shapes.NEAREST)
async def nearest(request: Request, profile: str, coordinates: str) -> Response:
    """The streets nearest to a place."""
    check_profile(profile)
    return await _nearest(request, read_coordinates(coordinates), query_of(request, NearestOptions))


@router.post("/nearest/v1/{profile}", openapi_extra=takes(osrm_options.NearestBody), responses=shapes.NEAREST)
async def nearest_by_post(request: Request, profile: str) -> Response:
    """The same with a JSON body."""
    check_profile(profile)
    body = await body_of(request, osrm_options.NearestBody)
    return await _nearest(request, osrm_options.check_coordinates(body.coordinates), body)
