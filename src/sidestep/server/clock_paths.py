"""The clock of the town, which a replay may set."""

import asyncio
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, WithJsonSchema
from starlette.responses import Response

from sidestep.server import shapes
from sidestep.server.asking import body_of, only_known, takes, town_of
from sidestep.server.guard import writer
from sidestep.server.problems import JsonResponse

router = APIRouter(tags=["clock"], dependencies=[Depends(only_known)], responses=shapes.PROBLEMS)
FIRST_YEAR, LAST_YEAR = 1900, 2200


def _in_reach(time: datetime) -> datetime:
    """Refuse times from which a clock cannot go on, whatever its timezone."""
    if not FIRST_YEAR <= time.year < LAST_YEAR:
        raise ValueError(f"the year must be {FIRST_YEAR} or later, and before {LAST_YEAR}")
    return time


class SimulatedTime(BaseModel):
    """A time to go by."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    now: Annotated[datetime, AfterValidator(_in_reach), WithJsonSchema({"type": "string"})]
    """ISO 8601; local time where it has no offset."""
    speed: Annotated[float, Field(gt=0, le=10_000)] = 1.0
    """Seconds of it in each second."""


@router.get("/clock", responses=shapes.CLOCK)
async def get_clock(request: Request) -> Response:
    """The local time by which the server goes."""
    return JsonResponse(town_of(request).clock.facts)


@router.put("/clock", openapi_extra=takes(SimulatedTime), responses=shapes.CLOCK)
async def set_clock(request: Request) -> Response:
    """Go by a simulated time, as ``sidestep replay`` does."""
    writer(request)
    served, asked = town_of(request), await body_of(request, SimulatedTime)
    await asyncio.to_thread(served.clock.set, asked.now, asked.speed)
    return JsonResponse(served.clock.facts)


@router.delete("/clock", responses=shapes.CLOCK)
async def reset_clock(request: Request) -> Response:
    """Go by the time of the computer again."""
    writer(request)
    served = town_of(request)
    await asyncio.to_thread(served.clock.reset)
    return JsonResponse(served.clock.facts)
