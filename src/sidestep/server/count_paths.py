"""Live counts: taken, shown, and told to those who listen."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent
from starlette.responses import Response

from sidestep.server import shapes
from sidestep.server.asking import geojson, only_known, room_to_listen, town_of
from sidestep.server.guard import writer
from sidestep.server.problems import GeoJsonResponse, JsonResponse

router = APIRouter(tags=["counts"], dependencies=[Depends(only_known)], responses=shapes.PROBLEMS)


@router.post("/counts", openapi_extra=shapes.COUNTS, responses=shapes.COUNTED)
async def post_counts(
    request: Request,
    seconds: Annotated[float, Query(ge=60, le=3600, description="Length of intervals that do not say theirs.")] = 3600,
) -> Response:
    """Take counts: JSON, CSV or NGSI-LD, one or many; all of them or none."""
    writer(request)
    served, body = town_of(request), await request.body()
    kind = request.headers.get("content-type", "")
    said = await asyncio.to_thread(served.counting.take, body, kind, seconds)
    return JsonResponse(said)


@router.get("/sensors", response_class=GeoJsonResponse, responses=shapes.SENSORS)
async def sensors(request: Request) -> Response:
    """What sensors counted in their last hour, beside what is expected, as GeoJSON."""
    served = town_of(request)
    return geojson(await asyncio.to_thread(served.counting.features))


@router.get("/events", dependencies=[Depends(room_to_listen)], response_class=EventSourceResponse)
async def follow_crowds(request: Request) -> AsyncIterator[ServerSentEvent]:
    """Tell when crowds change: server-sent events ``crowds`` and ``clock``."""
    async for kind, said in request.app.state.bus.listen():
        yield ServerSentEvent(event=kind, data=said)
