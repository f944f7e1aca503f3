"""Clients of OSRM that others wrote, against a server that runs as users start it."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx
import polyline
import pytest
import routingpy
from routingpy.exceptions import RouterApiError

from .processes import serving

BIN = Path(sys.executable).parent
CLIENTS = Path(__file__).parent / "clients"
CACHE = Path(__file__).parents[2] / ".cache"
FETCHED = CACHE / "npm-clients"
STATION, PARK, SQUARE = (24.9414, 60.1710), (24.9457, 60.1675), (24.9525, 60.1690)  # longitude and latitude
OUTSIDE = (24.9, 61.0)
FRIDAY = "Fri 17:30"
CONGESTION = {"low": 1, "moderate": 34, "heavy": 77, "severe": 100}  # levels of maplibre-gl-directions
CLOSE = 1e-5 + 1e-9  # degrees


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a server of Helsinki."""
    folder = tmp_path_factory.mktemp("served")
    environ = {**os.environ, "SIDESTEP_CACHE": str(CACHE / "served")}  # its numbers are those of users
    with serving(folder, "helsinki", environ=environ) as server:
        yield server.url


@pytest.fixture(scope="module")
def node(base: str, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Any], Any]:
    """Run one of the scripts with the packages of the lock, which are fetched once."""
    lock = (CLIENTS / "package-lock.json").read_bytes()
    packages = FETCHED / hashlib.sha256(lock).hexdigest()[:16]
    if not packages.is_dir():
        FETCHED.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=FETCHED) as drawer:
            for name in ("package.json", "package-lock.json", ".npmrc"):
                shutil.copy(CLIENTS / name, drawer)
            fetch = [BIN / "npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund"]
            done = subprocess.run(fetch, cwd=drawer, capture_output=True, text=True, timeout=300)
            if done.returncode:
                said = f"npm cannot fetch the clients: {done.stderr[-500:]}"
                pytest.fail(said) if os.environ.get("CI") else pytest.skip(said)
            Path(drawer).rename(packages)
            Path(drawer).mkdir()
    folder = tmp_path_factory.mktemp("clients")
    (folder / "node_modules").symlink_to(packages / "node_modules")
    for script in CLIENTS.glob("*.mjs"):
        shutil.copy(script, folder)

    def run(script: str, given: object) -> Any:
        command = [BIN / "node", folder / script, base, json.dumps(given)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


def swapped(*places: tuple[float, float]) -> list[tuple[float, float]]:
    """Latitudes before longitudes."""
    return [place[::-1] for place in places]


def near(one: Any, other: Any) -> bool:
    return max(abs(a - b) for a, b in zip(one, other, strict=True)) <= CLOSE


# routingpy


@pytest.fixture(scope="module")
def osrm(base: str) -> routingpy.OSRM:
    return routingpy.OSRM(base_url=base, timeout=60)


@pytest.mark.parametrize("form", [None, "polyline", "polyline6", "geojson"])
def test_routingpy_reads_routes(osrm, form: str | None) -> None:
    found = osrm.directions([STATION, PARK, SQUARE], "foot", geometries=form, overview="full", depart_at=FRIDAY)
    raw = found.raw["routes"][0]
    assert (found.distance, found.duration) == (int(raw["distance"]), int(raw["duration"]))
    assert 1000 < found.distance < 1300
    assert 0.8 < found.distance / found.duration < 1.5
    for waypoint in found.raw["waypoints"]:
        assert any(near(waypoint["location"], point) for point in found.geometry)
    assert near(found.geometry[0], found.raw["waypoints"][0]["location"])
    assert near(found.geometry[-1], found.raw["waypoints"][-1]["location"])


def test_routingpy_reads_alternatives(osrm) -> None:
    found = osrm.directions([STATION, SQUARE], "foot", alternatives=2, depart_at=FRIDAY)
    assert 1 <= len(found) <= 3
    durations = [each.duration for each in found]
    assert durations == sorted(durations)
    assert all(each.geometry[0] == found[0].geometry[0] for each in found)


def test_routingpy_sends_all_that_it_can(osrm) -> None:
    found = osrm.directions(
        [STATION, SQUARE],
        "foot",
        radiuses=[100, 100],
        bearings=[[90, 60], [0, 180]],
        alternatives=False,
        steps=True,
        continue_straight=True,
        annotations=True,
        geometries="geojson",
        overview="full",
        generate_hints="false",
        exclude="steps",
        depart_at=FRIDAY,
    )
    (leg,) = found.raw["routes"][0]["legs"]
    assert leg["steps"]
    assert len(leg["annotation"]["congestion"]) == len(found.geometry) - 1
    assert all("hint" not in each for each in found.raw["waypoints"])


def test_routingpy_reads_tables(osrm) -> None:
    places = [STATION, PARK, SQUARE]
    table = osrm.matrix(places, "foot", sources=[0, 1], destinations=[0, 2], depart_at=FRIDAY)
    assert [len(row) for row in table.durations] == [2, 2]
    assert table.durations[0][0] == table.distances[0][0] == 0
    for row, origin in enumerate(places[:2]):
        route = osrm.directions([origin, SQUARE], "foot", depart_at=FRIDAY).raw["routes"][0]
        assert table.durations[row][1] == pytest.approx(route["duration"], abs=0.11)
        assert table.distances[row][1] == pytest.approx(route["distance"], abs=0.11)
    assert osrm.matrix(places, "foot", annotations=["distance"]).durations is None


def test_routingpy_says_what_is_wrong(osrm) -> None:
    for profile, places, code in [
        ("foot", [STATION, OUTSIDE], "NoSegment"),
        ("foot", [STATION], "InvalidOptions"),
        ("foot", [STATION, SQUARE] * 51, "TooBig"),
        ("driving", [STATION, SQUARE], "InvalidValue"),
    ]:
        with pytest.raises(RouterApiError) as caught:
            osrm.directions(places, profile)
        assert caught.value.args[0] == 400
        assert json.loads(caught.value.args[1])["code"] == code


# Leaflet Routing Machine


@pytest.fixture(scope="module")
def leaflet(node) -> Any:
    walks = [swapped(STATION, SQUARE), swapped(STATION, PARK, SQUARE)]
    outside = swapped(STATION, OUTSIDE)
    return node("leaflet.mjs", {"walks": walks, "outside": outside, "parameters": {"depart_at": FRIDAY}})


def test_leaflet_routes(leaflet) -> None:
    direct, over = leaflet["found"]
    assert len(direct["routes"]) in {1, 2}
    assert len(over["routes"]) == 1  # OSRM has no alternatives over other places either
    for route in direct["routes"] + over["routes"]:
        assert route["name"]
        assert 500 < route["summary"]["totalDistance"] < 1500
        instructions, coordinates = route["instructions"], route["coordinates"]
        assert sum(each["distance"] for each in instructions) == pytest.approx(route["summary"]["totalDistance"], abs=2)
        assert sum(each["time"] for each in instructions) == pytest.approx(route["summary"]["totalTime"], abs=2)
        assert [each["type"] for each in instructions][:: len(instructions) - 1] == ["Head", "DestinationReached"]
        assert all(each["modifier"] and each["icon"] and each["said"] for each in instructions)
        assert len(route["waypointIndices"]) == len(route["waypoints"])
        for index, waypoint in zip(route["waypointIndices"], route["waypoints"], strict=True):
            assert near(coordinates[index], waypoint)
    (route,) = over["routes"]
    assert "WaypointReached" in [each["type"] for each in route["instructions"]]
    assert "1st destination" in " ".join(each["text"] for each in route["instructions"])


def test_leaflet_sends_the_hints_that_it_was_given(leaflet) -> None:
    first, over, again, line, *_ = leaflet["asked"]
    assert "hints=;&" in first
    assert re.search(r"hints=[\w-]{32};;[\w-]{32}&", over)
    assert re.search(r"hints=[\w-]{32};[\w-]{32}&", again)
    assert "overview=full" in line
    assert "continue_straight=false" in line
    assert leaflet["again"] == leaflet["found"][0]
    assert leaflet["line"]["routes"][0]["coordinates"] == leaflet["found"][0]["routes"][0]["coordinates"]


def test_leaflet_draws_routes_and_lists_their_turns(leaflet) -> None:
    instructions = leaflet["found"][0]["routes"][0]["instructions"]
    rows = leaflet["control"]["rows"]
    assert len(rows) == len(instructions)
    assert all(each["said"] in row for each, row in zip(instructions, rows, strict=True))
    assert leaflet["control"]["lines"] >= 3


def test_leaflet_reports_what_is_refused(leaflet) -> None:
    assert "routes" not in leaflet["refused"]
    assert leaflet["refused"]["error"]["status"] == -1


# osrm-text-instructions


def test_every_step_has_words(node) -> None:
    asked = f"?steps=true&overview=full&depart_at={FRIDAY.replace(' ', '%20')}"
    pairs = [(STATION, SQUARE), (SQUARE, STATION), (PARK, STATION), (STATION, PARK, SQUARE), (PARK, PARK)]
    paths = [f"/route/v1/foot/{';'.join(f'{x},{y}' for x, y in places)}{asked}" for places in pairs]
    routes = node("instructions.mjs", paths)
    assert len(routes) == len(pairs)
    kinds = {step["type"] for route in routes for step in route["steps"]}
    assert {"depart", "turn", "arrive"} <= kinds <= {"depart", "turn", "new name", "continue", "arrive"}
    for route in routes:
        line = [tuple(point) for point in route["line"]]
        joined = [tuple(point) for step in route["steps"] for point in step["line"]]
        assert [point for number, point in enumerate(joined) if joined[number - 1] != point] == [
            point for number, point in enumerate(line) if line[number - 1] != point
        ]
        for step in route["steps"]:
            assert near(step["line"][0], step["location"][::-1])
            for language in ("en", "de", "fi"):
                assert step[language]
                assert "{" not in step[language]
            # Words for people on foot: where to turn, and onto what.
            assert not step["name"] or step["name"] in step["en"] or step["type"] == "arrive"
        assert route["steps"][0]["en"].startswith("Head ")
        assert route["steps"][-1]["en"].startswith("You have arrived")


# maplibre-gl-directions


@pytest.fixture(scope="module")
def maplibre(node) -> Any:
    over = [STATION, PARK, SQUARE]
    every = {"overview": "full", "depart_at": FRIDAY}
    asked: list[tuple[Any, dict[str, str], Any]] = [
        (over, {"annotations": "congestion", "alternatives": "true"}, None),
        (over, {"annotations": "congestion", "geometries": "polyline6"}, None),
        (over, {"annotations": "congestion_numeric", "geometries": "geojson"}, None),
        ([STATION, SQUARE], {"annotations": "congestion", "alternatives": "true", "geometries": "geojson"}, None),
        ([STATION, SQUARE], {"geometries": "geojson"}, [(90, 60), None]),
    ]
    given = [
        {
            "waypoints": waypoints,
            "bearings": bearings,
            "configuration": {"requestOptions": every | options, "bearings": bearings is not None},
        }
        for waypoints, options, bearings in asked
    ]
    return node("maplibre.mjs", given)


def drawn(found: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    """Features of a type; those of routes have none."""
    return [each for each in found["features"] if each["properties"].get("type", "ROUTE") == kind]


def test_maplibre_finds_waypoints_on_the_route(maplibre) -> None:
    for found in maplibre:
        answer = found["answer"]
        assert answer["code"] == "Ok"
        snapped = [each["geometry"]["coordinates"] for each in drawn(found, "SNAPPOINT")]
        assert snapped == [each["location"] for each in answer["waypoints"]]
        assert len(drawn(found, "SNAPLINE")) == len(snapped)
        # Of every leg, the line begins and ends at the waypoints: it has been cut where they are.
        for number in range(len(answer["routes"])):
            route = [each for each in drawn(found, "ROUTE") if each["properties"]["routeIndex"] == number]
            assert {each["properties"]["legIndex"] for each in route} == set(range(len(snapped) - 1))
            for leg in range(len(snapped) - 1):
                lines = [each["geometry"]["coordinates"] for each in route if each["properties"]["legIndex"] == leg]
                assert near(lines[-1][-1], snapped[leg + 1])
                assert leg or near(lines[0][0], snapped[0])


def test_maplibre_colours_routes_by_congestion(maplibre) -> None:
    for found, exact in zip(maplibre[:4], (False, False, True, False), strict=True):
        for number, route in enumerate(found["answer"]["routes"]):
            wanted = []
            for leg in route["legs"]:
                numbers = leg["annotation"]["congestion_numeric" if exact else "congestion"]
                wanted.append(numbers if exact else [CONGESTION[word] for word in numbers])
            for leg, levels in enumerate(wanted):
                lines = [
                    each["properties"]["congestion"]
                    for each in drawn(found, "ROUTE")
                    if (each["properties"]["routeIndex"], each["properties"]["legIndex"]) == (number, leg)
                ]
                changes = [level for at, level in enumerate(levels) if at == 0 or levels[at - 1] != level]
                # What the client draws last has no number: it counts points, of which there is one more.
                assert [level for level in lines if level] == [level for level in changes if level]
    (busy,) = maplibre[2]["answer"]["routes"]
    assert max(number for leg in busy["legs"] for number in leg["annotation"]["congestion_numeric"]) > 0


def test_maplibre_asks_for_bearings(maplibre) -> None:
    plain, turned = maplibre[3], maplibre[4]
    assert "bearings=90%2C60%3B" in turned["asked"]
    assert plain["answer"]["waypoints"][0]["location"] != turned["answer"]["waypoints"][0]["location"]
    assert plain["answer"]["waypoints"][1]["location"] == turned["answer"]["waypoints"][1]["location"]


# On the wire


@pytest.mark.parametrize("encoded", [True, False])
@pytest.mark.parametrize("digits", [5, 6])
def test_polylines_as_coordinates(base: str, encoded: bool, digits: int) -> None:
    text = polyline.encode(swapped(STATION, PARK, SQUARE), digits)
    name = "polyline" if digits == 5 else "polyline6"
    inner = "".join(f"%{ord(letter):02X}" for letter in text) if encoded else text
    assert "?" not in text
    one = httpx.get(f"{base}/route/v1/foot/{name}({inner})?depart_at={FRIDAY}").json()
    places = ";".join(f"{x},{y}" for x, y in (STATION, PARK, SQUARE))
    assert one == httpx.get(f"{base}/route/v1/foot/{places}.json?depart_at={FRIDAY}").json()
