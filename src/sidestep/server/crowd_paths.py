"""Crowds, and how far and when one walks through them: what OSRM does not have."""

from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Depends, Query, Request
from pydantic import Field
from starlette.responses import Response

from sidestep.planners.registry import BASELINE
from sidestep.routing.departures import MOST_DEPARTURES
from sidestep.routing.directions import crowding_word
from sidestep.routing.request import read_departure
from sidestep.server import shapes
from sidestep.server.asking import (
    Futures,
    Objective,
    Place,
    PlannerName,
    Question,
    Time,
    Walker,
    body_of,
    geojson,
    located,
    numbers_of,
    only_known,
    place_of,
    takes,
    town_of,
)
from sidestep.server.effort import most_walks
from sidestep.server.osrm_options import Pair, Text
from sidestep.server.problems import GeoJsonResponse, JsonResponse
from sidestep.server.town import FEW, ServedTown

router = APIRouter(tags=["crowds"], dependencies=[Depends(only_known)], responses=shapes.PROBLEMS)
Geometry = Annotated[bool, Query(description="false: no lines, but a list by number of the street.")]
MOST_MINUTES = 8
"""Limits of one isochrone."""


class Reach(Question):
    """How far one gets."""

    minutes: Annotated[list[float], Field(min_length=1, max_length=MOST_MINUTES)] = Field(default=[5.0, 10.0, 15.0])
    futures: Annotated[int, Field(ge=1, le=1000)] | None = None


class Window(Question):
    """Departures one after the other."""

    destination: Pair
    until: Text | None = None
    """The last departure, a local time."""
    step: Annotated[float, Field(ge=0.1, le=1440)] | None = None
    """Minutes between two departures."""
    arrive_by: Text | None = None
    """When to be there: each departure then has on_time."""
    futures: Annotated[int, Field(ge=1, le=1000)] = FEW


@router.get("/isochrone", response_class=GeoJsonResponse, responses=shapes.ISOCHRONE)
async def isochrone(
    request: Request,
    origin: Place,
    minutes: Annotated[str, Query(max_length=80, description="Limits, with commas between them.")] = "5,10,15",
    depart_at: Time = None,
    planner: PlannerName = None,
    walker: Walker = None,
    objective: Objective = None,
    futures: Futures = None,
) -> Response:
    """How far one gets in some minutes, as GeoJSON; with futures in half and in 90 % of them."""
    asked = Reach(
        origin=place_of("origin", origin)[::-1],
        minutes=numbers_of("minutes", minutes, MOST_MINUTES),
        depart_at=depart_at,
        planner=planner,
        walker=walker,
        objective=objective,
        futures=futures,
    )
    return await _reached(town_of(request), asked)


@router.post("/isochrone", response_class=GeoJsonResponse, openapi_extra=takes(Reach), responses=shapes.ISOCHRONE)
async def isochrone_by_post(request: Request) -> Response:
    """The same with a JSON body, which may have areas to avoid."""
    return await _reached(town_of(request), await body_of(request, Reach))


async def _reached(served: ServedTown, asked: Reach) -> Response:
    place = located("origin", asked.origin)

    def answer() -> dict[str, Any]:
        planner = served.planner_name(asked.planner or BASELINE)
        return (
            served.variants.router(asked.walker, asked.objective)
            .isochrone(
                place,
                minutes=asked.minutes,
                depart=served.asked("depart_at", asked.depart_at),
                planner=planner,
                futures=None if asked.futures is None else served.futures(planner, asked.futures),
                avoid=asked.avoid,
            )
            .to_geojson()
        )

    return geojson(await served.heavily(answer))


@router.get("/when", responses=shapes.WHEN)
async def when(
    request: Request,
    origin: Place,
    destination: Place,
    depart_at: Time = None,
    until: Annotated[str | None, Query(max_length=40, description="The last departure, a local time.")] = None,
    step: Annotated[float | None, Query(ge=0.1, le=1440, description="Minutes between two departures.")] = None,
    arrive_by: Annotated[
        str | None, Query(max_length=40, description="When to be there: each departure then has on_time.")
    ] = None,
    planner: PlannerName = None,
    walker: Walker = None,
    objective: Objective = None,
    futures: Annotated[int, Query(ge=1, le=1000, description="Simulated futures.")] = FEW,
) -> Response:
    """How long the walk takes at every departure of a window, by default of two hours."""
    asked = Window(
        origin=place_of("origin", origin)[::-1],
        destination=place_of("destination", destination)[::-1],
        depart_at=depart_at,
        until=until,
        step=step,
        arrive_by=arrive_by,
        planner=planner,
        walker=walker,
        objective=objective,
        futures=futures,
    )
    return await _departures(town_of(request), asked)


@router.post("/when", openapi_extra=takes(Window), responses=shapes.WHEN)
async def when_by_post(request: Request) -> Response:
    """The same with a JSON body, which may have areas to avoid."""
    return await _departures(town_of(request), await body_of(request, Window))


async def _departures(served: ServedTown, asked: Window) -> Response:
    ends = located("origin", asked.origin), located("destination", asked.destination)

    def answer() -> dict[str, Any]:
        number = served.futures(asked.planner, asked.futures)
        depart = served.asked("depart_at", asked.depart_at)
        most = min(MOST_DEPARTURES, most_walks(served.planner_name(asked.planner), number))
        return (
            served.variants.router(asked.walker, asked.objective)
            .when(
                *ends,
                depart=depart,
                until=read_departure(asked.until, "until", grids=False),
                step=asked.step,
                arrive_by=read_departure(asked.arrive_by, "arrive_by", grids=False),
                planner=asked.planner,
                futures=number,
                avoid=asked.avoid,
                most=most,
            )
            .to_json()
        )

    return JsonResponse(await served.heavily(answer))


@router.get("/crowds", response_class=GeoJsonResponse, responses=shapes.CROWDS)
async def crowds(request: Request, at: Time = None, *, geometry: Geometry = True) -> Response:
    """Expected persons/m² on all streets, as GeoJSON or, without geometry, as a list by number of the street."""
    served = town_of(request)

    def answer() -> Response:
        when_ = served.departs(at, "at")
        density = np.round(served.quick.crowds(when_).astype(np.float64), 3).tolist()
        said = {"at": None if when_.date is None else when_.date.isoformat(), **when_.facts(0.0)}
        if not geometry:
            return JsonResponse({**said, "density": density})
        features = [
            {**street, "properties": {**street["properties"], "density": persons, "crowding": crowding_word(persons)}}
            for street, persons in zip(served.streets["features"], density, strict=True)
        ]
        return geojson({**served.streets, **said, "features": features})

    return await served.briefly(answer)


@router.get("/streets", response_class=GeoJsonResponse, responses=shapes.STREETS)
async def streets(request: Request) -> Response:
    """All streets, as GeoJSON; they stay as they are until another scenario is served."""
    return town_of(request).streets_document.answer(request)


@router.get("/search", responses=shapes.FOUND)
async def search(
    request: Request,
    q: Annotated[str, Query(max_length=100, description="A part of the name.")],
    limit: Annotated[int, Query(ge=1, le=50, description="The most names.")] = 8,
) -> Response:
    """Streets by a part of their names."""
    found = town_of(request).names.search(q, limit)
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


@router.get("/town", responses=shapes.TOWN)
async def town(request: Request) -> Response:
    """What is served: the scenario, whose streets and counts they are, and what may be asked."""
    return JsonResponse(town_of(request).facts)
