"""Walks under way: begun, reported on, and followed."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent
from starlette.responses import Response

from sidestep.errors import SidestepError
from sidestep.server import shapes, under_way
from sidestep.server.asking import body_of, only_known, room_to_listen, takes, town_of
from sidestep.server.problems import WALK_ID, JsonResponse, ProblemError
from sidestep.server.under_way import Begun, Position

router = APIRouter(prefix="/walks", tags=["walks"], dependencies=[Depends(only_known)], responses=shapes.PROBLEMS)
ASKED_AGAIN = 5
"""Times that a walk is decided anew where the server has too much to do, each twice as late as the one before."""
WalkId = Annotated[str, Path(pattern=WALK_ID, description="As the walk was named when it began.")]


@router.post("", status_code=201, openapi_extra=takes(Begun), responses={201: shapes.WALK[200]})
async def begin_walk(request: Request) -> Response:
    """Begin a walk; who knows its name may go on with it."""
    served, asked = town_of(request), await body_of(request, Begun)
    said = await served.heavily(lambda: under_way.begin(served, asked))
    # Beside this address, wherever a proxy has it.
    return JsonResponse(said, 201, {"location": f"walks/{said['id']}"})


@router.get("/{walk_id}", responses=shapes.WALK)
async def get_walk(request: Request, walk_id: WalkId) -> Response:
    """What the walker was told last."""
    served = town_of(request)
    return JsonResponse(await served.stored(lambda: under_way.tell(served, walk_id)))


@router.post("/{walk_id}/position", openapi_extra=takes(Position), responses=shapes.WALK)
async def report_position(request: Request, walk_id: WalkId) -> Response:
    """Say where the walker is and what crowds it sees, and be told how to go on."""
    served, position = town_of(request), await body_of(request, Position)
    return JsonResponse(await served.heavily(lambda: under_way.go_on(served, walk_id, position)))


@router.delete("/{walk_id}", status_code=204)
async def delete_walk(request: Request, walk_id: WalkId) -> Response:
    """Forget a walk."""
    served = town_of(request)
    if not await served.stored(lambda: served.store.delete_walk(walk_id)):
        raise ProblemError(404, "no such walk: it has ended, or its hour is over", field="id")
    return Response(status_code=204)


async def heard(request: Request, walk_id: WalkId) -> tuple[int, bool]:
    """How often counts have changed a walk so far, of which those who listen are told, and whether others have come."""
    served = town_of(request)
    return await served.stored(lambda: under_way.heard(served, walk_id))


@router.get("/{walk_id}/events", dependencies=[Depends(room_to_listen)], response_class=EventSourceResponse)
async def follow_walk(
    request: Request, walk_id: WalkId, state: Annotated[tuple[int, bool], Depends(heard)]
) -> AsyncIterator[ServerSentEvent]:
    """Tell when crowds change the plan, or a crowd forms ahead: server-sent events ``plan``."""
    served, (news, others) = town_of(request), state
    # Counts that came when nobody listened are told now.
    async for kind, _ in request.app.state.bus.listen(*([("crowds", {})] if others else [])):
        if kind != "crowds":
            continue
        for turn in range(ASKED_AGAIN):
            try:
                after, said = await served.heavily(lambda: under_way.decide_anew(served, walk_id))
            except ProblemError as problem:
                if problem.status == 404:
                    return
                await asyncio.sleep(2.0**turn)  # too much to do at the moment, or no store
            except SidestepError:
                break  # crowds are not known at this time
            else:
                if after != news:
                    news = after
                    yield ServerSentEvent(event="plan", data=said)
                break
