"""Walks under way as the API tells of them: begun, gone on with, and decided anew when crowds change."""

import secrets
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import to_json

from sidestep.crowds.live import AHEAD
from sidestep.crowds.wall_time import local_time
from sidestep.routing import live as walks
from sidestep.routing.request import Departure, RouteError, RouteRequest
from sidestep.routing.router import Router
from sidestep.routing.under_way import Ahead, CrowdAhead, Decision, WalkUnderWay
from sidestep.server import osrm, osrm_options
from sidestep.server.asking import Question, located
from sidestep.server.osrm_options import Pair, Text
from sidestep.server.planning import walk_of
from sidestep.server.problems import ProblemError
from sidestep.server.store import LONGEST_WALK
from sidestep.server.town import FEW, ServedTown

MOST_WALKS = 10_000
"""Walks that are kept; anybody may begin some, and each takes 20 to 40 kB for an hour, and its areas besides."""
LARGEST_AREA = 50_000
"""Bytes of the areas that a walk keeps out of."""
FORMAT = 1
"""Of what is kept of a walk; walks that a server with another one began are not gone on with."""
TRIES = 3
"""Of changing a walk that somebody else changes at the same time."""
MOST_AHEAD = 16
"""Streets of which a walker may say what it sees."""

OPTIONS = osrm_options.RouteOptions(steps=True, geometries="geojson", overview="full")
"""How the routes of walks are told."""


class Begun(Question):
    """A walk to begin."""

    destination: Pair
    futures: Annotated[int, Field(ge=1, le=1000)] | None = None


class Seen(BaseModel):
    """A crowd on a street that leaves the crossing ahead."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    bearing: Annotated[float, Field(ge=-360, le=360)]
    """Degrees clockwise from north, in which it leaves the crossing."""
    density: Annotated[float, Field(ge=0, le=20)]
    """Persons/m²."""


class Position(BaseModel):
    """Where a walker is, and what it sees."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

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
        503 where too many are kept; 413 for areas to avoid that are too large to keep.
    SidestepError
        What no route answers, with the parameter as its field.
    """
    if served.store.walks() >= MOST_WALKS:
        said = "too many walks are under way; begin later, or ask for a route"
        raise ProblemError(503, said, headers={"retry-after": "60"})
    if asked.avoid is not None and len(to_json(asked.avoid)) > LARGEST_AREA:
        said = f"areas to avoid may have {LARGEST_AREA:,} bytes at most in walks, which keep them; give fewer points"
        raise ProblemError(413, said, field="avoid")
    request = RouteRequest(
        origin=located("origin", asked.origin),
        destination=located("destination", asked.destination),
        depart=served.asked("depart_at", asked.depart_at),
        planner=asked.planner,
        futures=served.futures(asked.planner, asked.futures or FEW),
        avoid=asked.avoid,
    )
    version, own_time = served.counting.version, _is_own_time(served, request.depart)
    walk, decision = walks.begin(served.variants.router(asked.walker, asked.objective), request)
    walk_id = secrets.token_hex(16)
    expires = datetime.now(UTC) + LONGEST_WALK
    state = {
        "format": FORMAT,
        "dated": asked.depart_at is not None,
        "departs": served.clock.instant.replace(second=0, microsecond=0).isoformat(),
        "walker": asked.walker,
        "objective": asked.objective,
        "own_time": own_time,
        "version": version,
        "news": 0,
        "reported": None,
        "decided": None,
        **_state(served, walk_id, walk, decision, expires),
    }
    served.store.put_walk(walk_id, state, expires)
    found: dict[str, Any] = state["said"]
    return found


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
        Places outside the town, times before the last report, and times to come, with the parameter as its field.
    """
    place = located("location", position.location)
    asked = served.exactly("time", position.time)
    ahead = [Ahead(bearing=each.bearing, density=each.density) for each in position.ahead]

    def go(state: dict[str, Any]) -> dict[str, Any]:
        walk, router = _walk(served, state)
        # Now may be before the last report, whose time may be ahead of the server's clock.
        told = asked if position.time is not None else _later(served, asked, state["reported"])
        # What was reported before counts changed the plan, but comes after, is as of then.
        late = _later(served, told, state["reported"]) != told
        time = told if late else _later(served, told, state["decided"])
        when = 0.0 if time is None else time
        reported, decision = walks.report(router, walk, place, when, density=position.density, ahead=ahead)
        _check_time(served, state, walk.clock, reported.clock)
        expires = datetime.now(UTC) + LONGEST_WALK
        return {"reported": _wall(served, told), **_state(served, walk_id, reported, decision, expires)}

    said: dict[str, Any] = _changed(served, walk_id, go)["said"]
    return said


def decide_anew(served: ServedTown, walk_id: str) -> tuple[int, dict[str, Any]]:
    """Decide anew since crowds have changed.

    Parameters
    ----------
    served, walk_id
        The town, and the walk.

    Returns
    -------
    int, dict
        How often its plan has changed, or a crowd has formed on it, without a report; and the way to go.

    Raises
    ------
    ProblemError
        404 for walks that are not known, or no longer.
    """

    def anew(state: dict[str, Any]) -> dict[str, Any]:
        walk, router = _walk(served, state)
        if walk.arrived:
            return {}
        now = None if state["own_time"] else served.exactly("time", None)
        if isinstance(now, datetime) and state["reported"] is not None:
            now = _later(served, now, state["reported"])
        try:
            walk, decision = walks.replan(router, walk, time=now)
        except RouteError as error:
            if error.field != "time":
                raise
            # Another time is simulated than when the walk began.
            now, (walk, decision) = None, walks.replan(router, walk)
        found = _state(served, walk_id, walk, decision, datetime.fromisoformat(state["said"]["expires"]))
        if not decision.changed and (found["crowd"] is None or found["crowd"] == state["crowd"]):
            return {"crowd": found["crowd"]}
        return {**found, "news": state["news"] + 1, "decided": _wall(served, now)}

    state = _changed(served, walk_id, anew)
    return state["news"], state["said"]


def tell(served: ServedTown, walk_id: str) -> dict[str, Any]:
    """What was told last of a walk; ProblemError (404) where it is not known."""
    said: dict[str, Any] = _found(served, walk_id)["said"]
    return said


def heard(served: ServedTown, walk_id: str) -> tuple[int, bool]:
    """How often counts have changed a walk, and whether there are others since it was decided last; as :func:`tell`."""
    state = _found(served, walk_id)
    return state["news"], state["version"] != served.counting.version


def _found(served: ServedTown, walk_id: str) -> dict[str, Any]:
    state = served.store.get_walk(walk_id, datetime.now(UTC))
    if state is None:
        raise ProblemError(404, "no such walk: it has ended, or its hour is over; begin another", field="id")
    if state.get("format") != FORMAT:
        raise ProblemError(404, "another version of the server began this walk; begin another", field="id")
    return state


def _walk(served: ServedTown, state: dict[str, Any]) -> tuple[WalkUnderWay, Router]:
    return WalkUnderWay.from_json(state["walk"]), served.variants.router(state["walker"], state["objective"])


def _changed(served: ServedTown, walk_id: str, change: Callable[[dict[str, Any]], dict[str, Any]]) -> dict[str, Any]:
    """Change what is kept of a walk; where somebody else changed it meanwhile, that is done again from there."""
    for _ in range(TRIES):
        before, version = _found(served, walk_id), served.counting.version
        after = before | {"version": version} | change(before)
        expires = datetime.fromisoformat(after["said"]["expires"])
        if after == before or served.store.change_walk(walk_id, before, after, expires):
            return after
    raise ProblemError(503, "others report on this walk at the same time; send it again", headers={"retry-after": "1"})


def _state(
    served: ServedTown, walk_id: str, walk: WalkUnderWay, decision: Decision, expires: datetime
) -> dict[str, Any]:
    """What is kept of a decision."""
    crowd = decision.crowd_ahead
    said = {"id": walk_id, **_said(served, decision, crowd), "expires": _seconds(expires)}
    return {"walk": walk.to_json(), "crowd": None if crowd is None else crowd.leg.street, "said": said}


def _check_time(served: ServedTown, state: dict[str, Any], before: float, clock: float) -> None:
    """Refuse a report of a time to come, after which true ones would be earlier than the last.

    Parameters
    ----------
    served, state
        The town, and what is kept of the walk.
    before, clock
        Seconds from the departure to the last report, and to this one.

    Raises
    ------
    ProblemError
        With the field ``time``.
    """
    if state["dated"]:  # perhaps played, faster than in reality
        ahead, most, than = (
            clock - before,
            LONGEST_WALK,
            "that of the last report or, before there is one, the departure",
        )
    else:
        passed = (served.clock.instant - datetime.fromisoformat(state["departs"])).total_seconds()
        ahead, most, than = clock - passed, AHEAD, f"now, {served.clock.now():%Y-%m-%d %H:%M} by the server"
    if ahead > most.total_seconds():
        said = f"the time is {ahead / 60:,.0f} minutes after {than}, and may be {most // timedelta(minutes=1)}"
        raise ProblemError(400, f"{said}; correct it", field="time")


def _is_own_time(served: ServedTown, depart: Departure | None) -> bool:
    """Whether a walk is in a time of its own, such as one that is played on a map: crowds of now do not move it."""
    now, then = _wall(served, served.exactly("time", None)), _wall(served, depart)
    if now is None or depart is None:
        return False
    return then is None or abs(datetime.fromisoformat(now) - datetime.fromisoformat(then)) > LONGEST_WALK


def _later(served: ServedTown, time: Departure | None, other: str | None) -> Departure | None:
    """The later of two local times, where both are such."""
    wall = _wall(served, time)
    return datetime.fromisoformat(other) if wall is not None and other is not None and other > wall else time


def _wall(served: ServedTown, time: Departure | None) -> str | None:
    """A time as the clocks of the town show it, ISO 8601; None where it has no day."""
    if not isinstance(time, datetime):
        return None
    return local_time(time, served.venue.timezone).isoformat(timespec="microseconds")


def _seconds(time: datetime) -> str:
    return (time + timedelta(microseconds=500_000)).isoformat(timespec="seconds")


def _said(served: ServedTown, decision: Decision, crowd: CrowdAhead | None) -> dict[str, Any]:
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
        "crowd_ahead": None if crowd is None else _crowd(crowd),
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


def _crowd(crowd: CrowdAhead) -> dict[str, Any]:
    return {
        "name": crowd.leg.label,
        "street": crowd.leg.street,
        "density": round(crowd.leg.density, 2),
        "crowding": crowd.crowding,
        "distance": round(crowd.metres, 1),
    }
