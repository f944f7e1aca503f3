"""The services of OSRM in a town of which everything is known."""

import json
import math
import warnings
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import polyline
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sidestep.crowds.crowd_table import save_crowd_table
from sidestep.crowds.table_reader import read_table
from sidestep.network.formats import save_town
from sidestep.network.snapping import Snapper, StreetPoint
from sidestep.network.town import Town
from sidestep.routing.directions import Leg
from sidestep.server.app import make_app
from sidestep.server.hints import Hinter
from sidestep.server.osrm import Stretch, modifier
from sidestep.server.osrm_options import read_coordinates
from sidestep.server.problems import ProblemError
from sidestep.server.settings import Settings

DEGREE = 111_195.08  # m, on the equator in both directions
PLACES = [(0, 0), (200, 0), (300, 0), (0, 100), (200, 100), (300, -100), (0, 300), (100, 300)]
STREETS = [  # tail, head, one-way, kind, name
    (0, 1, False, "footway", "Long Street"),
    (1, 2, False, "footway", "Long Street"),
    (1, 4, True, "residential", "Side Lane"),
    (3, 4, False, "steps", ""),
    (0, 3, False, "footway", ""),
    (2, 5, False, "pedestrian", "Quay"),
    (6, 7, False, "footway", "Island Street"),
]
CROWD = 0.5  # persons/m² on the Quay, nobody anywhere else
FREE = 1.34  # m/s, Weidmann
ON_QUAY = FREE * (1 - math.exp(-1.913 * (1 / CROWD - 1 / 5.4)))


def at(x: float, y: float) -> str:
    """Longitude and latitude of a place in metres."""
    return f"{x / DEGREE:.7f},{y / DEGREE:.7f}"


WEST, CORNER, QUAY, ISLAND, NORTH = at(50, 4), at(300, 0), at(300, -50), at(50, 300), at(100, 100)


@pytest.fixture(scope="module")
def town(make_town) -> Town:
    """See PLACES and STREETS.

    ::

        6 --- 7        (an island)

        3 ----- 4
        |       | one-way, up
        0 ----- 1 --- 2
                      |
                      5
    """
    tail, head, one_way, kind, name = zip(*STREETS, strict=True)
    ends = list(zip(tail, head, strict=True))
    return make_town(PLACES, ends, one_way=np.array(one_way), kind=kind, name=name)


@pytest.fixture(scope="module")
def scenario(town, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its file."""
    folder = tmp_path_factory.mktemp("tiny")
    save_town(town, folder / "town.npz")
    (folder / "crowds.csv").write_text(f"street,slot,density\n5,0,{CROWD}\n5,1,{CROWD}\n")
    save_crowd_table(read_table(folder / "crowds.csv", town), folder / "crowds.npz")
    (folder / "tiny.toml").write_text(
        'law = "weidmann"\nhorizon_minutes = 60\n[place]\nstreets = "town.npz"\n'
        '[place.crowd_source]\nkind = "crowd_table"\nfile = "crowds.npz"\nnoise = [0.9, 0.0]\n'
    )
    return folder / "tiny.toml"


@pytest.fixture(scope="module")
def client(scenario, prepared) -> Iterator[httpx.Client]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it is to be asked for by another name
        from fastapi.testclient import TestClient
    store = str(scenario.with_name("store.db"))
    settings = Settings(scenario=str(scenario), store=store, requests_per_second=1e6)
    with TestClient(make_app(settings), base_url="http://127.0.0.1") as served:
        prepared(served)
        yield served


@pytest.fixture(scope="module")
def get(client) -> Callable[..., Any]:
    """Answers that are as they should be."""

    def ask(path: str) -> Any:
        answer = client.get(path)
        assert answer.status_code == 200, answer.text
        assert answer.json()["code"] == "Ok"
        return answer.json()

    return ask


@pytest.fixture(scope="module")
def code(client) -> Callable[..., str]:
    """OSRM's word for what is wrong with a request."""

    def ask(path: str, body: Any = None) -> str:
        answer = client.get(path) if body is None else client.post(path, json=body)
        assert answer.status_code == 400, answer.text
        assert set(answer.json()) == {"code", "message"}
        assert answer.json()["message"]
        return answer.json()["code"]

    return ask


# Golden answers


def test_a_route_turn_by_turn(get) -> None:
    answer = get(f"/route/v1/foot/{WEST};{QUAY}?steps=true&annotations=true&overview=full&geometries=geojson")
    (route,) = answer["routes"]
    (leg,) = route["legs"]
    first, second, last = leg["steps"]
    line = [[0.00045, 0], [0.001799, 0], [0.002698, 0], [0.002698, -0.00045]]
    assert route["geometry"] == {"type": "LineString", "coordinates": line}
    assert [each["geometry"]["coordinates"] for each in leg["steps"]] == [line[:3], line[2:], [line[3]] * 2]
    assert [each["name"] for each in leg["steps"]] == ["Long Street", "Quay", "Quay"]
    kinds = [(each["maneuver"]["type"], each["maneuver"]["modifier"]) for each in leg["steps"]]
    assert kinds == [("depart", "straight"), ("turn", "right"), ("arrive", "straight")]
    turns = [(each["maneuver"]["bearing_before"], each["maneuver"]["bearing_after"]) for each in leg["steps"]]
    assert turns == [(0, 90), (90, 180), (180, 0)]
    assert [each["maneuver"]["location"] for each in leg["steps"]] == [line[0], line[2], line[3]]
    assert [each["distance"] for each in leg["steps"]] == [250, 50, 0]
    seconds = [250 / FREE, 50 / ON_QUAY, 0]
    assert [each["duration"] for each in leg["steps"]] == pytest.approx(seconds, abs=0.06)
    assert (leg["distance"], leg["summary"]) == (300, "Long Street, Quay")
    assert leg["duration"] == route["duration"] == route["weight"] == pytest.approx(sum(seconds), abs=0.06)
    assert route["weight_name"] == "duration"
    assert route["people_met"] == pytest.approx(CROWD * 50 / ON_QUAY, abs=0.06)
    assert second["intersections"] == [
        {"location": line[2], "bearings": [180, 270], "entry": [True, False], "in": 1, "out": 0}
    ]
    assert {(step["mode"], step["driving_side"]) for step in (first, second, last)} == {("walking", "right")}
    annotation = leg["annotation"]
    assert annotation["congestion"] == ["low", "low", "moderate"]
    assert annotation["congestion_numeric"] == [0, 0, 9]  # 0.5 of 5.4 persons/m²
    assert annotation["distance"] == pytest.approx([150, 100, 50], abs=0.01)
    assert annotation["speed"] == pytest.approx([FREE, FREE, ON_QUAY], abs=1e-3)
    assert annotation["datasources"] == [0, 0, 0]
    assert annotation["metadata"] == {"datasource_names": ["expected crowds"]}
    assert [each["name"] for each in answer["waypoints"]] == ["Long Street", "Quay"]
    assert [each["location"] for each in answer["waypoints"]] == [line[0], line[3]]
    assert answer["waypoints"][0]["distance"] == pytest.approx(4, abs=0.01)


def test_one_way_streets_and_steps_that_are_excluded(get, code) -> None:
    up, down = f"{CORNER};{at(200, 100)}", f"{at(200, 100)};{CORNER}"
    ways = [get(f"/route/v1/foot/{ends}")["routes"][0]["distance"] for ends in (up, down)]
    assert ways == [200, 600]
    assert code(f"/route/v1/foot/{down}?exclude=steps") == "NoRoute"
    assert get(f"/route/v1/foot/{down}?exclude=none")["routes"][0]["distance"] == 600


def test_stops_and_places_on_the_way(get) -> None:
    ends = f"{WEST};{CORNER};{QUAY}"
    over = get(f"/route/v1/foot/{ends}?steps=true")
    assert [leg["distance"] for leg in over["routes"][0]["legs"]] == [250, 50]
    (leg,) = get(f"/route/v1/foot/{ends}?steps=true&waypoints=0;2")["routes"][0]["legs"]
    assert [step["name"] for step in leg["steps"]] == ["Long Street", "Quay", "Quay"]
    assert "waypoints" not in get(f"/route/v1/foot/{ends}?skip_waypoints=true")
    assert get(f"/route/v1/foot/{ends}?alternatives=true") == get(f"/route/v1/foot/{ends}")  # as in OSRM


def test_the_side_on_which_the_destination_is(get) -> None:
    def side(place: str) -> str:
        (leg,) = get(f"/route/v1/foot/{at(20, 0)};{place}?steps=true")["routes"][0]["legs"]
        return leg["steps"][-1]["maneuver"]["modifier"]

    assert [side(place) for place in (at(100, 20), at(100, -20), at(100, 2), at(320, 0))] == [
        "left", "right", "straight", "straight",
    ]  # fmt: skip


@pytest.mark.parametrize("steps", ["true", "false"])
def test_a_route_to_where_it_begins(get, steps: str) -> None:
    answer = get(f"/route/v1/foot/{WEST};{WEST}?steps={steps}&annotations=true&geometries=geojson")
    (route,) = answer["routes"]
    (leg,) = route["legs"]
    assert route["distance"] == route["duration"] == 0
    assert [step["maneuver"]["type"] for step in leg["steps"]] == ["depart", "arrive"] * (steps == "true")
    assert route["geometry"]["coordinates"] == [answer["waypoints"][0]["location"]] * 2
    assert leg["annotation"]["congestion"] == ["unknown"]


def test_overviews_and_geometries(get) -> None:
    ends = f"/route/v1/foot/{WEST};{QUAY}"
    line = get(f"{ends}?overview=full&geometries=geojson")["routes"][0]["geometry"]["coordinates"]
    for form, digits in ("polyline", 5), ("polyline6", 6):
        text = get(f"{ends}?overview=full&geometries={form}")["routes"][0]["geometry"]
        assert polyline.decode(text, digits, geojson=True) == [tuple(round(x, digits) for x in each) for each in line]
    assert get(f"{ends}?geometries=geojson")["routes"][0]["geometry"]["coordinates"] == [line[0], *line[2:]]
    assert "geometry" not in get(f"{ends}?overview=false")["routes"][0]


def test_tables(get) -> None:
    table = get(f"/table/v1/foot/{WEST};{QUAY};{CORNER}.json?annotations=duration,distance&sources=0;1")
    assert table["distances"] == [[0, 300, 250], [300, 0, 50]]
    seconds = [250 / FREE + 50 / ON_QUAY, 250 / FREE, 50 / ON_QUAY]
    assert table["durations"][0] == pytest.approx([0, *seconds[:2]], abs=0.06)
    assert table["durations"][1] == pytest.approx([seconds[0], 0, seconds[2]], abs=0.06)
    assert [len(table[name]) for name in ("sources", "destinations")] == [2, 3]
    plain = get(f"/table/v1/foot/{WEST};{QUAY}?skip_waypoints=true")
    assert plain == {"code": "Ok", "durations": [row[:2] for row in table["durations"]]}
    scaled = get(f"/table/v1/foot/{WEST};{QUAY}?scale_factor=2")
    assert scaled["durations"][0][1] == pytest.approx(2 * seconds[0], abs=0.06)


def test_tables_without_a_path(get) -> None:
    path = f"/table/v1/foot/{WEST};{ISLAND}?annotations=duration,distance"
    assert get(path)["durations"] == get(path)["distances"] == [[0, None], [None, 0]]
    for kind, metres in ("input", 296), ("snapped", 300):
        table = get(f"{path}&fallback_speed=2&fallback_coordinate={kind}")
        assert table["distances"][0][1] == pytest.approx(metres, abs=0.1)
        assert table["durations"][1][0] == pytest.approx(metres / 2, abs=0.1)
        assert table["fallback_speed_cells"] == [[0, 1], [1, 0]]


def test_nearest_streets(get) -> None:
    several = get(f"/nearest/v1/foot/{at(290, -20)}?number=3")["waypoints"]
    assert [each["name"] for each in several] == ["Quay", "Long Street", "Long Street"]
    assert several[0]["nodes"] == [1002, 1005]
    assert [each["distance"] for each in several] == sorted(each["distance"] for each in several)
    (one,) = get(f"/nearest/v1/foot/{at(290, -20)}.json")["waypoints"]
    assert one == several[0]
    (near,) = get(f"/nearest/v1/foot/{at(290, -20)}?number=3&radiuses=15")["waypoints"]
    assert near == several[0]


@pytest.mark.parametrize(
    ("bearing", "name"),
    [
        ("90,10", "Long Street"), ("270,10", "Long Street"), ("0,45", "Quay"), ("180,0", "Quay"), ("360,5", "Quay"),
        ("", "Quay"), ("135,180", "Quay"),
    ],
)  # fmt: skip
def test_bearings_say_which_street(get, bearing: str, name: str) -> None:
    assert get(f"/nearest/v1/foot/{at(290, -20)}?bearings={bearing}")["waypoints"][0]["name"] == name
    route = get(f"/route/v1/foot/{at(290, -20)};{WEST}?bearings={bearing};")
    assert route["waypoints"][0]["name"] == name


def test_nobody_walks_up_a_one_way_street_that_leads_down(get) -> None:
    path = f"/nearest/v1/foot/{at(201, 50)}"
    assert get(f"{path}?bearings=0,10")["waypoints"][0]["name"] == "Side Lane"
    assert get(f"{path}?bearings=180,10")["waypoints"][0]["name"] == "Quay"


# What is refused


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        (f"/route/v2/foot/{WEST};{QUAY}", "InvalidVersion"),
        (f"/route/v0/foot/{WEST};{QUAY}", "InvalidVersion"),
        (f"/table/v11/foot/{WEST};{QUAY}", "InvalidVersion"),
        (f"/match/v1/foot/{WEST};{QUAY}", "InvalidService"),
        (f"/trip/v1/foot/{WEST};{QUAY}", "InvalidService"),
        ("/tile/v1/foot/tile(1310,3166,13).mvt", "InvalidService"),
        (f"/walk/v1/foot/{WEST};{QUAY}", "InvalidService"),
        (f"/route/one/foot/{WEST};{QUAY}", "InvalidUrl"),
        ("/route/v1/foot", "InvalidUrl"),
        ("/route/v1", "InvalidUrl"),
        ("/nearest", "InvalidUrl"),
        (f"/route/v1/car/{WEST};{QUAY}", "InvalidValue"),
        (f"/route/v1/foot/{WEST}", "InvalidOptions"),
        (f"/table/v1/foot/{WEST}", "InvalidOptions"),
        (f"/nearest/v1/foot/{WEST};{QUAY}", "InvalidOptions"),
        (f"/route/v1/foot/{WEST};{QUAY}.flatbuffers", "NotImplemented"),
        ("/route/v1/foot/1,2;3", "InvalidQuery"),
        ("/route/v1/foot/1,2;3,x", "InvalidQuery"),
        ("/route/v1/foot/nan,2;3,4", "InvalidQuery"),
        ("/route/v1/foot/", "InvalidQuery"),
        ("/route/v1/foot/polyline(_p~iF)", "InvalidQuery"),
        ("/route/v1/foot/200,2;3,4", "InvalidValue"),
        (f"/route/v1/foot/{';'.join([WEST] * 101)}", "TooBig"),
        (f"/route/v1/foot/{WEST};20,10", "NoSegment"),
        (f"/route/v1/foot/{WEST};{ISLAND}", "NoRoute"),
    ],
)
def test_paths(code, path: str, expected: str) -> None:
    assert code(path) == expected


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("nothing=1", "InvalidQuery"),
        ("steps=maybe", "InvalidQuery"),
        ("overview=some", "InvalidQuery"),
        ("geometries=wkt", "InvalidQuery"),
        ("alternatives=few", "InvalidQuery"),
        ("alternatives=-1", "InvalidOptions"),
        ("alternatives=4", "TooBig"),
        ("annotations=height", "InvalidQuery"),
        ("annotations=nodes", "NotImplemented"),
        ("radiuses=5", "InvalidOptions"),
        ("radiuses=5;x", "InvalidQuery"),
        ("radiuses=5;-1", "InvalidOptions"),
        ("radiuses=5;nan", "InvalidOptions"),
        ("radiuses=unlimited;0", "NoSegment"),
        ("hints=;;", "InvalidOptions"),
        ("bearings=90,10", "InvalidOptions"),
        ("bearings=90,10;361,10", "InvalidOptions"),
        ("bearings=90,10;0,181", "InvalidOptions"),
        ("bearings=90;", "InvalidQuery"),
        ("bearings=east,10;", "InvalidQuery"),
        ("bearings=45,5;", "NoSegment"),
        ("approaches=curb", "InvalidOptions"),
        ("approaches=curb;door", "InvalidQuery"),
        ("waypoints=0", "InvalidValue"),
        ("waypoints=1;0", "InvalidValue"),
        ("waypoints=0;2", "InvalidOptions"),
        ("waypoints=0;x", "InvalidQuery"),
        ("exclude=motorway", "InvalidValue"),
        ("snapping=all", "InvalidQuery"),
        ("continue_straight=often", "InvalidQuery"),
        ("planner=somebody", "InvalidValue"),
        ("walker=nobody", "InvalidValue"),
        ("futures=0", "InvalidOptions"),
        ("confidence=2", "InvalidOptions"),
    ],
)
def test_options_of_routes(code, query: str, expected: str) -> None:
    assert code(f"/route/v1/foot/{at(50, 40)};{at(300, -50)}?{query}") == expected


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("sources=0;2", "InvalidOptions"),
        ("sources=0;0;0", "InvalidOptions"),
        ("destinations=x", "InvalidQuery"),
        ("annotations=speed", "InvalidQuery"),
        ("scale_factor=0", "InvalidOptions"),
        ("fallback_speed=0", "InvalidOptions"),
        ("fallback_coordinate=some", "InvalidQuery"),
        ("steps=true", "InvalidQuery"),
    ],
)
def test_options_of_tables(code, query: str, expected: str) -> None:
    assert code(f"/table/v1/foot/{WEST};{QUAY}?{query}") == expected


@pytest.mark.parametrize(
    "query",
    [
        "radiuses=unlimited;50", "radiuses=;", "hints=;", "hints=", "hints=abc;def", "approaches=curb;unrestricted",
        "approaches=;opposite", "bearings=;", "bearings=90,180;", "generate_hints=false", "snapping=any",
        "continue_straight=default", "continue_straight=false", "annotations=false", "alternatives=false",
        "alternatives=0", "exclude=none", "waypoints=0;1",
    ],
)  # fmt: skip
def test_options_that_change_nothing(get, query: str) -> None:
    path = f"/route/v1/foot/{WEST};{QUAY}"
    assert get(f"{path}?{query}")["routes"] == get(path)["routes"]


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ({}, "InvalidQuery"),
        ([], "InvalidQuery"),
        ({"coordinates": 5}, "InvalidQuery"),
        ({"coordinates": [[0, 0]]}, "InvalidOptions"),
        ({"coordinates": [[0, 0], [0, "0"]]}, "InvalidQuery"),
        ({"coordinates": [[0, 0], [0, 0, 0]]}, "InvalidQuery"),
        ({"coordinates": [[0, 0], [0, 100]]}, "InvalidValue"),
        ({"coordinates": [[0, 0]] * 101}, "TooBig"),
        ({"coordinates": "polyline(_p~iF)"}, "InvalidQuery"),
        *(
            ({"coordinates": [[0, 0], [0.001, 0]], **options}, expected)
            for options, expected in [
                ({"steps": "true"}, "InvalidQuery"),
                ({"alternatives": "some"}, "InvalidQuery"),
                ({"alternatives": {}}, "InvalidQuery"),
                ({"alternatives": 10}, "TooBig"),
                ({"radiuses": 5}, "InvalidQuery"),
                ({"radiuses": [{}, []]}, "InvalidQuery"),
                ({"radiuses": [-1, None]}, "InvalidOptions"),
                ({"bearings": [90, 10]}, "InvalidQuery"),
                ({"bearings": [[90.5, 10], None]}, "InvalidQuery"),
                ({"hints": {}}, "InvalidQuery"),
                ({"waypoints": ["0", "1"]}, "InvalidQuery"),
                ({"waypoints": [0] * 200}, "InvalidOptions"),
                ({"exclude": {"steps": True}}, "InvalidQuery"),
                ({"format": "flatbuffers"}, "InvalidQuery"),
                ({"annotations": [1]}, "InvalidQuery"),
                ({"avoid": 3}, "InvalidQuery"),
            ]
        ),
    ],
)
def test_bodies(code, body: Any, expected: str) -> None:
    assert code("/route/v1/foot", body) == expected


@pytest.mark.parametrize(
    ("side", "expected"), [(300, "NoRoute"), (90, "NoRoute"), (1, "Ok"), (0, "InvalidValue")]
)  # all streets; the crossing on the way; a place without any; no area at all
def test_areas_in_the_way(client, side: float, expected: str) -> None:
    west, south = 200 - side / 2, -side / 2 + (side == 1) * 30
    ring = [(west, south), (west + side, south), (west + side, south + side), (west, south + side), (west, south)]
    area = {"type": "Polygon", "coordinates": [[[x / DEGREE, y / DEGREE] for x, y in ring]]}
    body = {"coordinates": [[50 / DEGREE, 0], [300 / DEGREE, 0]], "avoid": area}
    assert client.post("/route/v1/foot", json=body).json()["code"] == expected


def test_what_is_no_json_and_what_is_no_question(client) -> None:
    answer = client.post("/route/v1/foot", content=b"{", headers={"content-type": "application/json"})
    assert (answer.status_code, answer.json()["code"]) == (400, "InvalidQuery")
    answer = client.post("/route/v1/foot", content=b"a=1", headers={"content-type": "text/csv"})
    assert (answer.status_code, answer.json()["code"]) == (415, "InvalidQuery")
    assert client.put(f"/route/v1/foot/{WEST};{QUAY}").status_code == 405


# In bodies all is as in URLs

PAIR = [[50 / DEGREE, 4 / DEGREE], [300 / DEGREE, -50 / DEGREE]]


@pytest.mark.parametrize(
    ("query", "options"),
    [
        ("", {}),
        (
            "steps=true&annotations=true&geometries=polyline6&overview=full",
            {"steps": True, "annotations": True, "geometries": "polyline6", "overview": "full"},
        ),
        (
            "annotations=duration,congestion&overview=false",
            {"annotations": ["duration", "congestion"], "overview": "false"},
        ),
        ("radiuses=unlimited;50", {"radiuses": ["unlimited", 50]}),
        ("radiuses=;50.5", {"radiuses": [None, 50.5]}),
        ("bearings=90,10;", {"bearings": [[90, 10], None]}),
        ("hints=;&approaches=curb;", {"hints": [None, ""], "approaches": ["curb", None]}),
        ("exclude=steps&snapping=any", {"exclude": ["steps"], "snapping": "any"}),
        ("generate_hints=false&skip_waypoints=true", {"generate_hints": False, "skip_waypoints": True}),
        ("waypoints=0;1&continue_straight=true", {"waypoints": [0, 1], "continue_straight": True}),
        ("", {"waypoints": [], "alternatives": False, "continue_straight": "default", "format": "json"}),
    ],
)
def test_bodies_of_routes_say_what_urls_say(client, get, query: str, options: dict[str, Any]) -> None:
    exact = ";".join(f"{x},{y}" for x, y in PAIR)
    answer = client.post("/route/v1/foot", json={"coordinates": PAIR, **options})
    assert answer.json() == get(f"/route/v1/foot/{exact}?{query}")


def test_bodies_of_other_services(client, get) -> None:
    exact = ";".join(f"{x},{y}" for x, y in PAIR)
    body = {"coordinates": PAIR, "sources": [0], "destinations": [], "annotations": True, "scale_factor": 2}
    body |= {"fallback_speed": 1, "fallback_coordinate": "snapped"}
    assert client.post("/table/v1/foot", json=body).json() == get(
        f"/table/v1/foot/{exact}?sources=0&annotations=duration,distance&scale_factor=2"
        "&fallback_speed=1&fallback_coordinate=snapped"
    )
    nearest = client.post("/nearest/v1/foot", json={"coordinates": PAIR[:1], "number": 2}).json()
    assert nearest == get(f"/nearest/v1/foot/{exact.split(';')[0]}?number=2")
    text = f"polyline6({polyline.encode(PAIR, 6, geojson=True)})"
    assert client.post("/route/v1/foot", json={"coordinates": text}).json() == get(f"/route/v1/foot/{text}")


# Parts


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (None, 90, "straight"), (0, 0, "straight"), (350, 10, "straight"), (0, 20, "straight"), (0, 340, "straight"),
        (0, 21, "slight right"), (0, 339, "slight left"), (350, 40, "slight right"), (0, 61, "right"),
        (90, 180, "right"), (90, 0, "left"), (0, 240, "left"), (0, 121, "sharp right"), (10, 240, "sharp left"),
        (0, 166, "uturn"), (0, 180, "uturn"), (90, 270, "uturn"), (270, 85, "uturn"),
    ],
)  # fmt: skip
def test_modifiers(before: float | None, after: float, expected: str) -> None:
    assert modifier(before, after) == expected


degrees = st.tuples(
    st.floats(-180, 180, allow_subnormal=False).map(lambda x: round(x, 6)),
    st.floats(-90, 90, allow_subnormal=False).map(lambda x: round(x, 6)),
)


@given(st.lists(degrees, min_size=1, max_size=5), st.sampled_from(["", ".json"]))
def test_coordinates_are_read_as_they_are_written(places: list[tuple[float, float]], suffix: str) -> None:
    assert read_coordinates(";".join(f"{x:.6f},{y:.6f}" for x, y in places) + suffix) == places
    for digits, name in (5, "polyline"), (6, "polyline6"):
        found = read_coordinates(f"{name}({polyline.encode(places, digits, geojson=True)}){suffix}")
        assert np.abs(np.array(found) - np.array(places)).max() <= 0.51 * 10**-digits


@given(st.one_of(st.text(), st.text("0123456789.,;-+eE"), st.text().map("polyline({})".format)))
@example("polyline(" + "~" * 1000 + "?)")
@example("1e999,1;1,1")
@example("²,1")
def test_other_coordinates_are_refused(text: str) -> None:
    found, refused = [], None
    try:
        found = read_coordinates(text)
    except ProblemError as problem:
        refused = problem.field, problem.code
    assert all(-180 <= x <= 180 and -90 <= y <= 90 for x, y in found)
    assert refused in {None, *(("coordinates", code) for code in ("InvalidQuery", "InvalidValue", "TooBig"))}


@given(st.integers(0, len(STREETS) - 1), st.floats(0, 1), degrees)
def test_hints_are_read_as_they_are_written(town: Town, street: int, fraction: float, place: Any) -> None:
    hinter = Hinter(Snapper(town))
    tail, head = (np.array(PLACES[end]) for end in STREETS[street][:2])
    x, y = (tail + fraction * (head - tail)) / DEGREE
    hint = hinter.hint(StreetPoint(street, fraction, 0.0, (y, x)), place)
    assert len(hint) == 32
    found = hinter.point(hint, *place)
    assert found is not None
    assert (found.street, found.fraction) == (street, fraction)
    assert found.place == pytest.approx((y, x), abs=1e-9)
    # Of another place they say nothing, or a waypoint that somebody has moved would stay where it was.
    assert hinter.point(hint, place[0] + 1e-5, place[1]) is None
    assert hinter.point(hint[:-1], *place) is None


@given(st.one_of(st.none(), st.text(), st.binary(max_size=40).map(lambda raw: raw.hex())))
def test_other_hints_are_ignored(town: Town, hint: str | None) -> None:
    assert Hinter(Snapper(town)).point(hint, 0.0, 0.0) is None


def test_hints_of_other_towns_are_ignored(town: Town, make_town) -> None:
    other = make_town([(0, 0), (100, 0)], [(0, 1)])
    hint = Hinter(Snapper(other)).hint(StreetPoint(0, 0.5, 0.0, (0.0, 50 / DEGREE)), (0.0, 0.0))
    assert Hinter(Snapper(other)).point(hint, 0.0, 0.0) is not None
    assert Hinter(Snapper(town)).point(hint, 0.0, 0.0) is None


def test_hints_spare_the_search(get) -> None:
    plain = get(f"/route/v1/foot/{at(290, -20)};{WEST}")
    hints = ";".join(each["hint"] for each in plain["waypoints"])
    assert get(f"/route/v1/foot/{at(290, -20)};{WEST}?hints={hints}") == plain
    (quay, long, *_) = get(f"/nearest/v1/foot/{at(290, -20)}?number=3")["waypoints"]
    assert quay["name"] == "Quay"
    hinted = get(f"/route/v1/foot/{at(290, -20)};{WEST}?hints={long['hint']};")
    assert hinted["waypoints"][0]["location"] == long["location"]


@given(st.floats(0, 359), st.integers(0, len(STREETS) - 1), st.floats(0.01, 0.99))
def test_bearings_of_streets(town: Town, off: float, street: int, fraction: float) -> None:
    (west, south), (east, north) = (PLACES[end] for end in STREETS[street][:2])
    expected = math.degrees(math.atan2(east - west, north - south))
    found = Snapper(town).bearing(StreetPoint(street, fraction, 0.0, (0.0, 0.0)))
    assert (found - expected + off + 180) % 360 == pytest.approx((off + 180) % 360, abs=1e-3)


def test_a_course_has_points_at_which_segments_meet_once() -> None:
    common = dict(segment=0, density=0.0, exposure=0.0, too_dense=False)
    legs = [
        Leg(metres=2.0, minutes=1.0, coordinates=[[0.0, 0.0], [1.0, 0.0], [1.0, 1.00000001]], **common),
        Leg(metres=1.0, minutes=1.0, coordinates=[[1.0, 1.00000001], [2.0, 1.0]], **common),
    ]
    stretch = Stretch(legs, [], (0.0, 0.0))
    assert stretch.course == [[0, 0], [1, 0], [1, 1], [2, 1]]
    assert stretch.begins == [0, 2, 3]
    assert Stretch([], [], (1.23456789, 0.0)).course == [[1.234568, 0], [1.234568, 0]]


# Whatever is asked, all parts of an answer agree

spots = st.tuples(st.floats(-20, 320), st.floats(-120, 120))


@settings(max_examples=60)
@given(st.lists(spots, min_size=2, max_size=4), st.sampled_from(["geojson", "polyline6"]), st.booleans())
def test_the_parts_of_routes_agree(client, places: list[tuple[float, float]], form: str, silent: bool) -> None:
    def line(geometry: Any) -> list[list[float]]:
        if form == "geojson":
            return geometry["coordinates"]
        return [list(point) for point in polyline.decode(geometry, 6, geojson=True)]

    last = len(places) - 1
    query = f"steps=true&annotations=true&overview=full&geometries={form}" + f"&waypoints=0;{last}" * silent
    path = f"/route/v1/foot/{';'.join(at(*place) for place in places)}?{query}"
    answer = client.get(path).json()
    if answer["code"] != "Ok":
        assert answer["code"] in {"NoRoute", "NoSegment"}
        return
    (route,) = answer["routes"]
    whole, legs = line(route["geometry"]), route["legs"]
    stops = [0, last] if silent else range(last + 1)
    assert len(legs) == len(stops) - 1
    joined = [whole[0]]
    for (before, after), leg in zip(pairwise(stops), legs, strict=True):
        steps = leg["steps"]
        assert len(steps) >= 2
        for step in steps:
            points = line(step["geometry"])
            assert step["maneuver"]["location"] == step["intersections"][0]["location"] == points[0]
            assert joined[-1] == points[0]
            assert step["maneuver"]["modifier"]
            joined += points[1:]
        assert points == [joined[-1]] * 2
        joined.pop()  # the arrival has its point twice
        assert steps[0]["maneuver"]["type"] == "depart"
        assert [step["maneuver"]["type"] == "arrive" for step in steps] == [False] * (len(steps) - 1) + [True]
        assert line(steps[0]["geometry"])[0] == answer["waypoints"][before]["location"]
        assert points[0] == answer["waypoints"][after]["location"]
        rounding = 0.05 * (len(steps) + 1) + 1e-6
        for name in ("distance", "duration", "weight"):
            assert sum(step[name] for step in steps) == pytest.approx(leg[name], abs=rounding)
            numbers = leg["annotation"][name]
            assert sum(numbers) == pytest.approx(leg[name], abs=0.05 + 0.001 * len(numbers))
        assert set(leg["annotation"]["congestion"]) <= {"low", "moderate", "heavy", "severe", "unknown"}
    assert joined == whole
    rows = {name: sum(len(leg["annotation"][name]) for leg in legs) for name in legs[0]["annotation"]}
    assert set(rows.values()) - {rows["metadata"]} <= {len(whole) - 1}
    for name in ("distance", "duration"):
        assert sum(leg[name] for leg in legs) == pytest.approx(route[name], abs=0.05 * (len(legs) + 1) + 1e-6)
    assert json.dumps(route)
