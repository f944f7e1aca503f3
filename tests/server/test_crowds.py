"""What OSRM does not have: crowds, reach, departures, streets and their names, in the small town."""

import json
from pathlib import Path

import httpx
import pytest

from sidestep.routing.request import RouteRequest
from sidestep.routing.router import Router
from sidestep.scenarios.model import read_objective
from sidestep.scenarios.reader import find_scenario

A, B = (0.0001, 0.0001), (0.0026, 0.0026)
EAST = (0.0001, 0.0026)
"""Latitude and longitude of the south-eastern corner."""
CROWDED = 5
"""The street with 0.5 persons/m²."""


def answered(served: httpx.Client, path: str, **asked: object) -> dict:
    answer = served.get(path, params=asked)
    assert answer.status_code == 200, answer.text
    return answer.json()


def lonlat(place: tuple[float, float]) -> str:
    return f"{place[1]},{place[0]}"


@pytest.fixture(scope="module")
def router(small_town: Path) -> Router:
    return Router(find_scenario(str(small_town)))


@pytest.fixture(scope="module")
def calm(small_town: Path) -> Router:
    return Router(find_scenario(str(small_town)).changed(objective=read_objective("exposure=5")))


def test_crowds(served: httpx.Client) -> None:
    rows = answered(served, "/crowds")["features"]
    crowded = rows[CROWDED]["properties"]
    assert (crowded["name"], crowded["crowding"]) == ("Street 5", "busy")
    assert crowded["density"] == pytest.approx(0.5, rel=0.01)
    assert {row["properties"]["crowding"] for row in rows if row["properties"]["street"] != CROWDED} == {"free"}
    listed = answered(served, "/crowds", geometry="false")["density"]
    assert listed == [row["properties"]["density"] for row in rows]


@pytest.mark.parametrize("objective", [None, "exposure=5"])
def test_departures_are_those_of_the_router(served, router, calm, objective: str | None) -> None:
    asked = {} if objective is None else {"objective": objective}
    said = answered(served, "/when", origin=lonlat(A), destination=lonlat(EAST), futures=20, step=30, **asked)
    chosen = router if objective is None else calm
    assert said == json.loads(json.dumps(chosen.when(A, EAST, step=30, futures=20).to_json()))


@pytest.mark.parametrize("objective", [None, "exposure=5"])
def test_reach_is_that_of_the_router(served, router, calm, objective: str | None) -> None:
    asked = {} if objective is None else {"objective": objective}
    said = answered(served, "/isochrone", origin=lonlat(EAST), minutes="1,3", **asked)
    chosen = router if objective is None else calm
    assert said == json.loads(json.dumps(chosen.isochrone(EAST, minutes=[1, 3]).to_geojson()))


def test_planned_routes_are_those_of_the_router(served, calm) -> None:
    (route,) = answered(served, f"/route/v1/foot/{lonlat(A)};{lonlat(B)}", objective="exposure=5", futures=20)["routes"]
    plan = calm.answer(RouteRequest(A, B, planner="expected", futures=20))
    assert route["distance"] == pytest.approx(plan.metres, abs=0.1)
    assert route["p50"] == pytest.approx(60 * plan.median_minutes, abs=0.1)
    assert route["p90"] == pytest.approx(60 * plan.p90_minutes, abs=0.1)
    assert route["weight_name"] == "cost"


def test_streets_are_asked_for_again_only_when_others_are_served(served: httpx.Client) -> None:
    answer = served.get("/streets")
    assert len(answer.json()["features"]) == 24
    # Another scenario may be served at the same address a minute later.
    assert answer.headers["cache-control"] == "no-cache"
    again = served.get("/streets", headers={"if-none-match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_streets_by_name(served: httpx.Client) -> None:
    found = answered(served, "/search", q="street 23", limit=3)
    assert [each["name"] for each in found][:1] == ["Street 23"]
    assert found[0]["metres"] == 100
    assert answered(served, "/search", q="nowhere lane") == []


@pytest.mark.parametrize(
    ("path", "field"),
    [
        ("/isochrone?origin=30,0.0001", "origin"),
        ("/when?origin=0.0001,0.0001&destination=30,0.0001", "destination"),
        ("/when?origin=0.0001,0.0001&destination=0.0026,0.0026&objective=joy", "objective"),
        ("/isochrone?origin=0.0001,0.0001&objective=joy", "objective"),
    ],
)
def test_faults_are_named(served: httpx.Client, path: str, field: str) -> None:
    answer = served.get(path)
    assert (answer.status_code, answer.json()["field"]) == (400, field)
