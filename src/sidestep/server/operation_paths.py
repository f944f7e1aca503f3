"""What those who run the server ask."""

import os

from fastapi import APIRouter, Depends, Request
from prometheus_client import CONTENT_TYPE_LATEST, REGISTRY, CollectorRegistry, generate_latest
from prometheus_client.multiprocess import MultiProcessCollector
from starlette.responses import PlainTextResponse, Response

from sidestep.server import shapes
from sidestep.server.asking import only_known, town_of
from sidestep.server.problems import JsonResponse, ProblemError
from sidestep.server.store import StoreError

router = APIRouter(tags=["operations"], dependencies=[Depends(only_known)], responses=shapes.PROBLEMS)


@router.get("/healthz", responses=shapes.HEALTH)
async def check_health() -> Response:
    """Whether the process answers."""
    return JsonResponse({"status": "ok"})


@router.get("/readyz", responses=shapes.READY)
async def check_readiness(request: Request) -> Response:
    """Whether the town is loaded, routes are planned, and counts and walks can be stored."""
    if not request.app.state.ready:
        raise ProblemError(503, "the town is not loaded yet", headers={"retry-after": "1"})
    served = town_of(request)
    try:
        await served.stored(served.store.ping)
    except StoreError as error:
        raise ProblemError(503, str(error), field="store", headers={"retry-after": "5"}) from error
    # What is asked less often is compiled while others are answered already.
    return JsonResponse({"status": "ready", "prepared": request.app.state.preparing.done()})


@router.get("/metrics", response_class=PlainTextResponse, responses=shapes.METRICS)
async def metrics() -> Response:
    """Numbers of requests and their times, for Prometheus; of all processes of this server."""
    registry = REGISTRY
    if "PROMETHEUS_MULTIPROC_DIR" in os.environ:
        registry = CollectorRegistry()
        MultiProcessCollector(registry)  # type: ignore[no-untyped-call]
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)
