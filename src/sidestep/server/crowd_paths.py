"""Crowds, and how far and when one walks through them: what OSRM does not have."""

from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Depends, Query, Request
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
    Time,
    Walker,
    geojson,
    numbers_of,
    only_known,
    place_of,
    town_of,
)
from sidestep.server.effort import most_walks
from sidestep.server.problems import GeoJsonResponse, JsonResponse
from sidestep.server.town import FEW

router = APIRouter(tags=["crowds"], dependencies=[Depends(only_known)], responses=shapes.PROBLEMS)
Geometry = Annotated[bool, Query(description="false: no lines, but a list by number of the street.")]
MOST_MINUTES = 8
"""Limits of one isochrone."""


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
    served, place, limits = town_of(request), place_of("origin", origin), numbers_of("minutes", minutes, MOST_MINUTES)

    def answer() -> dict[str, Any]:
        router = served.variants.router(walker, objective)
        departs = served.asked("depart_at", depart_at)
        name = served.planner_name(planner or BASELINE)
        number = None if futures is None else served.futures(name, futures)
        return router.isochrone(place, minutes=limits, depart=departs, planner=name, futures=number).to_geojson()

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
    served, ends = town_of(request), (place_of("origin", origin), place_of("destination", destination))

    def answer() -> dict[str, Any]:
        number = served.futures(planner, futures)
        depart = served.asked("depart_at", depart_at)
        most = min(MOST_DEPARTURES, most_walks(served.planner_name(planner), number))
        return (
            served.variants.router(walker, objective)
            .when(
                *ends,
                depart=depart,
                until=read_departure(until, "until"),
                step=step,
                arrive_by=served.deadline(arrive_by, depart),
                planner=planner,
                futures=number,
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
