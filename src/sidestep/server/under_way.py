"""Walks under way as the API tells of them: begun, gone on with, and decided anew when crowds change."""

import secrets
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from sidestep.routing import live as walks
from sidestep.routing.directions import crowding_word
from sidestep.routing.plan import RoutePlan
from sidestep.routing.request import RouteRequest, at_fault, read_departure
from sidestep.routing.router import Router
from sidestep.routing.under_way import Ahead, Decision, WalkUnderWay
from sidestep.server import osrm, osrm_options
from sidestep.server.planning import walk_of
from sidestep.server.problems import ProblemError
from sidestep.server.store import LONGEST_WALK
from sidestep.server.town import FEW, ServedTown

DENSE = ("dense", "jammed")
"""Words of crowds that walkers are told of."""
MOST_WALKS = 10_000
"""Walks that are kept; anybody may begin some, and each takes some 20 kB for an hour."""
MOST_AHEAD = 16
"""Streets of which a walker may say what it sees."""

Pair = tuple[float, float]
Text = Annotated[str, Field(max_length=200)]
OPTIONS = osrm_options.RouteOptions(steps=True, geometries="geojson", overview="full")
"""How the routes of walks are told."""


class Begun(BaseModel):
    """A walk to begin; longitudes come before latitudes."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    origin: Pair
    destination: Pair
    depart_at: Text | None = None
    """Local time; by default now."""
    planner: Annotated[str, Field(pattern=osrm_options.PLANNER)] | None = None
    walker: Text | None = None
    objective: Text | None = None
    futures: Annotated[int, Field(ge=1, le=1000)] | None = None


class Seen(BaseModel):
    """A crowd on a street that leaves the crossing ahead."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    bearing: Annotated[float, Field(ge=-360, le=360)]
    """Degrees clockwise from north, in which it leaves the crossing."""
    density: Annotated[float, Field(ge=0, le=20)]
    """Persons/m²."""


class Position(BaseModel):
    """Where a walker is, and what it sees."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    location: Pair
    time: Text | None = None
    """Local time; by default now."""
    density: Annotated[float, Field(ge=0, le=20)] | None = None
    """Persons/m² on the street that it is on."""
    ahead: Annotated[list[Seen], Field(max_length=MOST_AHEAD)] = Field(default_factory=list)


def begin(served: ServedTown, asked: Begun) -> dict[str, Any]:
    """Begin a walk, and keep it.

    Parameters
    ----------
    served, asked
        The town, and the walk.

    Returns
    -------
    dict
        Its name, and the way to go.

    Raises
    ------
    ProblemError
        503 where too many are kept.
    SidestepError
        What no route answers, with the parameter as its field.
    """
    if served.store.walks() >= MOST_WALKS:
        said = "too many walks are under way; begin later, or ask for a route"
        raise ProblemError(503, said, headers={"retry-after": "60"})
    for field, place in (("origin", asked.origin), ("destination", asked.destination)):
        with at_fault(field):
            osrm_options.check_coordinates([place])
    request = RouteRequest(
        origin=asked.origin[::-1],
        destination=asked.destination[::-1],
        depart=served.asked("depart_at", asked.depart_at),
        planner=asked.planner,
        futures=served.futures(asked.planner, asked.futures or FEW),
    )
    walk, decision = walks.begin(served.variants.router(asked.walker, asked.objective), request)
    walk_id = secrets.token_hex(16)
    return _kept(served, walk_id, walk, decision, asked.walker, asked.objective)


def go_on(served: ServedTown, walk_id: str, position: Position) -> dict[str, Any]:
    """Go on with a walk from where the walker is.

    Parameters
    ----------
    served, walk_id, position
        The town, the walk, and where and when the walker is.

    Returns
    -------
    dict
        The way to go.

    Raises
    ------
    ProblemError
        404 for walks that are not known, or no longer.
    SidestepError
        Places and times that cannot be, with the parameter as its field.
    """
    walk, router, state = _found(served, walk_id)
    with at_fault("location"):
        osrm_options.check_coordinates([position.location])
    time = read_departure(position.time, "time") if position.time is not None else served.asked("time", None)
    ahead = [Ahead(bearing=each.bearing, density=each.density) for each in position.ahead]
    walk, decision = walks.report(
        router, walk, position.location[::-1], 0.0 if time is None else time, density=position.density, ahead=ahead
    )
    return _kept(served, walk_id, walk, decision, state["walker"], state["objective"])


def decide_anew(served: ServedTown, walk_id: str) -> dict[str, Any] | None:
    """Decide anew since crowds have changed.

    Parameters
    ----------
    served, walk_id
        The town, and the walk.

    Returns
    -------
    dict or None
        The way to go; None where it is as before, and no crowd has formed on it.

    Raises
    ------
    ProblemError
        404 for walks that are not known, or no longer.
    """
    walk, router, state = _found(served, walk_id)
    if walk.arrived:
        return None
    walk, decision = walks.replan(router, walk)
    crowd = _crowd_ahead(decision.plan)
    if not decision.changed and (crowd is None or state["crowd"] == crowd["street"]):
        return None
    return _kept(served, walk_id, walk, decision, state["walker"], state["objective"])


def tell(served: ServedTown, walk_id: str) -> dict[str, Any]:
    """What was told last of a walk; ProblemError (404) for walks that are not known, or no longer."""
    _, _, state = _found(served, walk_id)
    said: dict[str, Any] = state["said"]
    return said


def _found(served: ServedTown, walk_id: str) -> tuple[WalkUnderWay, Router, dict[str, Any]]:
    state = served.store.get_walk(walk_id, datetime.now(UTC))
    if state is None:
        raise ProblemError(404, "no such walk: it has ended, or its hour is over; begin another", field="id")
    return WalkUnderWay.from_json(state["walk"]), served.variants.router(state["walker"], state["objective"]), state


def _kept(
    served: ServedTown, walk_id: str, walk: WalkUnderWay, decision: Decision, walker: str | None, objective: str | None
) -> dict[str, Any]:
    """Store a walk, and say where it goes on."""
    expires = datetime.now(UTC) + LONGEST_WALK
    crowd = _crowd_ahead(decision.plan)
    said = {"id": walk_id, **_said(served, decision, crowd), "expires": _seconds(expires)}
    state = {
        "walk": walk.to_json(),
        "walker": walker,
        "objective": objective,
        "crowd": None if crowd is None else crowd["street"],
        "said": said,
    }
    served.store.put_walk(walk_id, state, expires)
    return said


def _seconds(time: datetime) -> str:
    return (time + timedelta(microseconds=500_000)).isoformat(timespec="seconds")


def _said(served: ServedTown, decision: Decision, crowd: dict[str, Any] | None) -> dict[str, Any]:
    """A decision as JSON."""
    turn, plan = decision.next, decision.plan
    found: dict[str, Any] = {
        "next": None,
        "arrival": decision.arrives,
        "p50": round(decision.p50, 1),
        "p90": round(decision.p90, 1),
        "changed": decision.changed,
        "why": decision.why,
        "arrived": decision.arrived,
        "seen": decision.seen,
        "left_route": decision.left_route,
        "crowd_ahead": crowd,
        "route": None,
    }
    legs = [] if plan is None else plan.legs
    if turn is not None:
        found["next"] = {
            "instruction": turn.turn,
            "name": turn.street,
            "bearing": round(turn.bearing) % 360,
            "modifier": osrm.modifier(turn.bearing_before, turn.bearing),
            "distance": round(turn.metres, 1),
            "location": [turn.longitude, turn.latitude],
            "ends": next(
                (leg.coordinates[-1] for leg in legs if leg.segment == turn.segment and leg.coordinates), None
            ),
        }
    if plan is not None and legs:
        found["route"] = osrm.route(walk_of(plan), OPTIONS, served.town, ())
    return found


def _crowd_ahead(plan: RoutePlan | None) -> dict[str, Any] | None:
    """The first dense crowd on the rest of a route."""
    metres = 0.0
    for leg in [] if plan is None else plan.legs:
        if (word := crowding_word(leg.density)) in DENSE:
            said = {"name": leg.label, "street": leg.street, "density": round(leg.density, 2), "crowding": word}
            return {**said, "distance": round(metres, 1)}
        metres += leg.metres
    return None
