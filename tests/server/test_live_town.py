"""Counts, walks and the clock over HTTP, in a town with two ways from one end to the other."""

import math
import time
import warnings
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

import httpx
import pytest

from sidestep.crowds.counts import read_counts
from sidestep.server import under_way
from sidestep.server.app import make_app
from sidestep.server.replay import Client, ReplayError, hours_of, replay
from sidestep.server.settings import KEY_VARIABLE, Settings
from sidestep.server.variants import Variants

from .conftest import USUAL, at

MANY = 40_000.0  # persons/h
NOON = "2024-06-01T12:00:00"
KEY = "a-key-that-nobody-would-guess"
WRITES = {"authorization": f"Bearer {KEY}"}


WEST, EAST = at(0, 0), at(300, 0)
ROUTE = f"/route/v1/foot/{WEST[0]},{WEST[1]};{EAST[0]},{EAST[1]}?steps=true"


@pytest.fixture(scope="module")
def client(live_town: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it is to be asked for by another name
        from fastapi.testclient import TestClient
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sidestep.server.store.LOOKING", 0.25)
        patch.setenv(KEY_VARIABLE, KEY)
        settings = Settings(
            scenario=str(live_town), store=str(tmp_path_factory.mktemp("live") / "store.db"), requests_per_second=1e6
        )
        with TestClient(make_app(settings), base_url="http://127.0.0.1") as served:
            yield served


@pytest.fixture(autouse=True)
def noon(client: httpx.Client) -> None:
    """Before each test, it is noon on a Saturday."""
    assert client.put("/clock", json={"now": NOON, "speed": 0.001}, headers=WRITES).status_code == 200


@pytest.fixture
def post(client: httpx.Client) -> Callable[..., httpx.Response]:
    """Post counts, and wait until crowds go on from them."""

    def send(*rows: dict[str, Any], **headers: str) -> httpx.Response:
        answer = client.post("/counts", json=list(rows), headers=WRITES | headers)
        served = client.app.state.town
        version = served.store.version()
        for _ in range(600):
            if served.counting.version == version:
                return answer
            time.sleep(0.05)
        raise AssertionError("crowds did not go on from these counts")

    return send


def names(answer: httpx.Response) -> list[str]:
    """The streets of a route."""
    assert answer.status_code == 200, answer.text
    return [step["name"] for step in answer.json()["routes"][0]["legs"][0]["steps"][:-1]]


def long(count: float, time: str = "2024-06-01T11:00:00") -> dict[str, Any]:
    return {"sensor": "long", "time": time, "count": count}


def test_counts_change_routes_and_corrections_change_them_back(client: httpx.Client, post) -> None:
    assert names(client.get(ROUTE)) == ["Gate", "Long Street", "Quay"]
    assert post(long(MANY)).json() == {"accepted": 1, "new": 1, "unchanged": 0, "corrected": 0, "late": 0}
    assert names(client.get(ROUTE)) == ["Gate", "Back Road", "Quay"]
    crowded = client.get("/crowds?geometry=false").json()
    # Of 40,000 persons an hour each is on a metre of street for 1 / 1.34 s, on 2 m: 4.1 persons/m².
    assert crowded["density"][1] == pytest.approx(MANY / 3600 / 1.34 / 2, rel=0.1)
    assert client.get("/crowds?at=Sat 12:00&geometry=false").json()["density"][1] < 0.1
    assert post(long(MANY)).json()["unchanged"] == 1
    assert post(long(USUAL)).json()["corrected"] == 1
    assert names(client.get(ROUTE)) == ["Gate", "Long Street", "Quay"]


@pytest.mark.parametrize(
    "asked", ["walker=older", "objective=exposure=0.1", "walker=older&objective=exposure=0.1", "planner=snapshot"]
)
def test_counts_change_the_routes_of_all(client: httpx.Client, post, asked: str) -> None:
    """Of walkers whose router is made after the first counts, and is there before others; and by other objectives."""
    for count, street in ((MANY, "Back Road"), (USUAL, "Long Street")) * 2:
        post(long(count))
        assert names(client.get(f"{ROUTE}&{asked}")) == ["Gate", street, "Quay"]


def test_routers_begin_again_once_they_are_kept(client: httpx.Client) -> None:
    """Counts that come while one is made are handed to those that are kept."""
    kept: list[bool] = []
    variants = Variants(client.app.state.town.router, lambda router: kept.append(router in list(variants)))
    variants.router("older", "distance")
    assert kept == [False, True]


def test_routes_of_all_kinds_go_on_from_counts(client: httpx.Client, post) -> None:
    post(long(MANY))
    for more in ("", "&futures=20", "&planner=snapshot", "&objective=exposure=1"):
        assert names(client.get(ROUTE + more)) == ["Gate", "Back Road", "Quay"], more
    # In a week nobody knows of these counts.
    assert names(client.get(f"{ROUTE}&depart_at=2024-06-08T12:00")) == ["Gate", "Long Street", "Quay"]
    post(long(USUAL))


@pytest.mark.parametrize(
    ("asked", "field", "begins"),
    [
        ("depart_at=17:30", "departure", "2024-06-01T17:30:00"),
        ("depart_at=2024-06-05T17:30", "departure", "2024-06-05T17:30:00"),
        ("arrive_by=17:30&futures=20", "departure", "2024-06-01T17:2"),
        ("arrive_by=00:10&futures=20", "departure", "2024-06-02T00:0"),  # of the two of a day the one to come
        ("depart_at=23:30&arrive_by=00:10&futures=20", "departure", "2024-06-02T00:0"),
        ("depart_at=2024-06-05T12:00&arrive_by=14:00&futures=20", "departure", "2024-06-05T13:5"),
        ("depart_at=Tue 17:30", "departs", "Tuesday 17:30"),
        ("depart_at=Sat 12:00&arrive_by=14:00&futures=20", "departs", "Saturday 13:5"),
        ("depart_at=Sat 23:30&arrive_by=00:10&futures=20", "departs", "Sunday 00:0"),
    ],
)
def test_times_of_day(client: httpx.Client, asked: str, field: str, begins: str) -> None:
    answer = client.get(f"{ROUTE}&{asked}")
    assert answer.status_code == 200, answer.text
    assert answer.json()["routes"][0][field].startswith(begins)


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        ("planner=shortest-path&walker=custom,free_speed=0.1", "NoRoute"),  # through the crowd
        ("walker=custom,free_speed=0.1", "NoRoute"),  # round it, which takes longer than an hour
        ("arrive_by=2024-06-01T12:01&futures=20", "InvalidValue"),  # at noon
        ("arrive_by=2024-06-01T11:00&futures=20", "InvalidValue"),
    ],
)
def test_what_nobody_can_walk(client: httpx.Client, post, asked: str, code: str) -> None:
    post(long(MANY))
    answer = client.get(f"{ROUTE}&{asked}")
    post(long(USUAL))
    assert (answer.status_code, answer.json()["code"]) == (400, code), answer.text


@pytest.mark.parametrize(
    "asked",
    [
        "depart_at=23:30&until=00:30",
        "depart_at=Sat 12:00&until=14:00",
        "depart_at=2024-12-05T12:00&until=14:00",
        "depart_at=Sat 12:00&until=Sat 13:00&arrive_by=12:30",
        "depart_at=23:30&until=00:30&arrive_by=00:15",
    ],
)
def test_windows_end_after_they_begin(client: httpx.Client, asked: str) -> None:
    ends = f"origin={WEST[0]},{WEST[1]}&destination={EAST[0]},{EAST[1]}"
    answer = client.get(f"/when?{ends}&{asked}&step=15&futures=20")
    assert answer.status_code == 200, answer.text
    rows = answer.json()["departures"]
    assert len(rows) in (5, 9)
    if "arrive_by" in asked:
        assert (rows[0]["on_time"], rows[-1]["on_time"]) == (1.0, 0.0)


def test_what_sensors_counted(client: httpx.Client, post) -> None:
    post(long(MANY))
    sensors = {each["properties"]["sensor"]: each for each in client.get("/sensors").json()["features"]}
    assert sensors["long"]["properties"]["count"] == MANY
    assert sensors["long"]["properties"]["counted_from"] == "2024-06-01T11:00:00"
    assert sensors["long"]["geometry"]["coordinates"] == pytest.approx(at(150, 0), abs=1e-6)
    assert sensors["quay"]["properties"]["count"] is None
    # The mean of a lognormal number whose logarithm has the quartiles log(50) and log(200).
    sigma = math.log(4) / 1.349
    assert sensors["quay"]["properties"]["expected"] == pytest.approx(USUAL * math.exp(sigma**2 / 2), rel=0.1)
    post(long(USUAL))


@pytest.mark.parametrize(
    ("row", "field", "status"),
    [
        ({"sensor": "lomg", "time": NOON, "count": 1}, "sensor", 422),
        (long(1, "2023-06-01T11:00"), "time", 422),
        (long(1, "2024-06-01T13:00"), "time", 422),
        (long(-1), "count", 422),
        ({"sensor": "long", "time": NOON, "count": "12"}, "count", 422),
        ({"sensor": "long", "time": NOON, "count": True}, "count", 422),
        ({"sensor": "long", "time": NOON, "count": 1, "colour": 2}, "colour", 422),
    ],
)
def test_counts_that_cannot_be_are_refused_whole(client: httpx.Client, row, field: str, status: int) -> None:
    before = client.app.state.town.store.version()
    answer = client.post("/counts", json=[long(5, "2024-06-01T09:00"), row], headers=WRITES)
    assert (answer.status_code, answer.json()["field"]) == (status, field), answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert client.app.state.town.store.version() == before


@pytest.mark.parametrize("key", [None, "", "Bearer", "Bearer wrong", f"Bearer {KEY}x", KEY[:-1]])
@pytest.mark.parametrize(("method", "path"), [("POST", "/counts"), ("PUT", "/clock"), ("DELETE", "/clock")])
def test_writes_need_the_key(client: httpx.Client, method: str, path: str, key: str | None) -> None:
    headers = {} if key is None else {"authorization": key}
    answer = client.request(method, path, json=[long(1)], headers=headers)
    assert (answer.status_code, answer.json()["field"]) == (401, "authorization")


def test_counts_as_csv_and_ngsi_ld(client: httpx.Client) -> None:
    rows = "time,sensor,direction_1,direction_2\n2024-06-01T11:58,long,3,4\n2024-06-01T11:59,long,5,6\n"
    said = client.post("/counts?seconds=60", content=rows, headers=WRITES | {"content-type": "text/csv"})
    assert said.json()["accepted"] == 2, said.text
    entity = {
        "id": "urn:ngsi-ld:CrowdFlowObserved:quay", "type": "CrowdFlowObserved",
        "dateObserved": {"type": "Property", "value": {"@type": "DateTime", "@value": "2024-06-01T11:00:00Z"}},
        "peopleCountTowards": {"type": "Property", "value": 30}, "peopleCountAway": {"type": "Property", "value": 12},
    }  # fmt: skip
    notification = {"type": "Notification", "data": [entity]}
    said = client.post("/counts", json=notification, headers=WRITES)
    assert said.json()["new"] == 1, said.text
    stored = client.app.state.town.store.counts_since(datetime.fromisoformat("2024-06-01T10:00:00+00:00"))
    assert [(each.sensor, each.persons, each.towards) for each in stored if each.sensor == "quay"] == [("quay", 42, 30)]


def test_a_store_that_is_gone_and_comes_back(client: httpx.Client, post) -> None:
    """Routes go on, counts are refused with 503, and are taken once the store is back."""
    file = Path(client.app.state.town.store._file._path)
    aside = file.with_suffix(".aside")
    file.rename(aside)
    answer = client.post("/counts", json=[long(7, "2024-06-01T08:00")], headers=WRITES)
    assert (answer.status_code, answer.json()["field"]) == (503, "store")
    assert str(file) not in answer.text
    assert names(client.get(ROUTE)) == ["Gate", "Long Street", "Quay"]
    answer = client.get("/readyz")
    assert (answer.status_code, answer.json()["field"]) == (503, "store")
    assert str(file) not in answer.text
    aside.rename(file)
    assert client.get("/readyz").json()["status"] == "ready"
    assert post(long(7, "2024-06-01T08:00")).json()["new"] == 1


def test_the_clock_that_a_replay_sets(client: httpx.Client) -> None:
    said = client.get("/clock").json()
    assert (said["now"], said["simulated"]) == ("2024-06-01T12:00:00+00:00", True)
    assert said["hour_of_week"] == pytest.approx(5 * 24 + 12, abs=0.01)
    assert client.delete("/clock", headers=WRITES).json()["simulated"] is False
    for wrong in ({"now": "noon"}, {"now": NOON, "speed": 0}, {"now": NOON, "speed": "60"}, {}, {"now": NOON, "x": 1}):
        assert client.put("/clock", json=wrong, headers=WRITES).status_code in (400, 422), wrong


# Walks under way


def begun(client: httpx.Client, **more: Any) -> dict[str, Any]:
    answer = client.post("/walks", json={"origin": WEST, "destination": EAST, **more})
    assert answer.status_code == 201, answer.text
    said = answer.json()
    behind = urljoin("https://walks.example/town/walks", answer.headers["location"])  # a proxy that has its own paths
    assert behind == f"https://walks.example/town/walks/{said['id']}"
    return said


def walked(said: dict[str, Any]) -> list[str]:
    return [step["name"] for step in said["route"]["legs"][0]["steps"][:-1]]


def test_a_walk_to_its_end(client: httpx.Client) -> None:
    said = begun(client)
    assert len(said["id"]) == 32
    assert walked(said) == ["Gate", "Long Street", "Quay"]
    assert said["p90"] >= said["p50"] == pytest.approx(300 / 1.34, rel=0.05)
    url = f"/walks/{said['id']}/position"
    for metres, minute in ((20, "12:00:15"), (120, "12:01:30"), (200, "12:02:30")):
        said = client.post(url, json={"location": at(metres, 2), "time": f"2024-06-01T{minute}"}).json()
        assert (said["changed"], said["why"], said["left_route"]) == (False, None, False)
        assert said["route"]["distance"] == pytest.approx(300 - metres, abs=1)
    assert said["next"]["name"] == "Quay"
    assert said["next"]["distance"] == pytest.approx(50, abs=1)
    assert said["next"]["location"] == pytest.approx(at(250, 0), abs=1e-5)
    assert said["next"]["ends"] == pytest.approx(EAST, abs=1e-5)
    assert client.get(f"/walks/{said['id']}").json() == said
    said = client.post(url, json={"location": EAST, "time": "2024-06-01T12:04"}).json()
    assert (said["arrived"], said["next"], said["route"]) == (True, None, None)
    assert client.delete(f"/walks/{said['id']}").status_code == 204
    assert client.get(f"/walks/{said['id']}").status_code == 404


def test_walks_that_an_older_server_began_have_ended(client: httpx.Client) -> None:
    said, store = begun(client), client.app.state.town.store
    state = store.get_walk(said["id"], datetime.now(UTC))
    del state["format"], state["own_time"]
    store.put_walk(said["id"], state, datetime.now(UTC) + timedelta(minutes=1))
    url = f"/walks/{said['id']}"
    for answer in (client.get(url), client.post(f"{url}/position", json={"location": WEST})):
        assert (answer.status_code, answer.json()["field"]) == (404, "id")


def test_a_crowd_that_is_seen_changes_the_plan(client: httpx.Client) -> None:
    said = begun(client)
    seen = {"location": at(40, 0), "time": "2024-06-01T12:00:30", "ahead": [{"bearing": 90.0, "density": 4.5}]}
    said = client.post(f"/walks/{said['id']}/position", json=seen).json()
    assert walked(said) == ["Gate", "Back Road", "Quay"]
    assert said["changed"]
    assert "Long Street" in said["why"]
    assert said["seen"]


def around(x: float, y: float) -> dict[str, Any]:
    """An area of 20 m by 20 m."""
    corners = [(x - 10, y - 10), (x + 10, y - 10), (x + 10, y + 10), (x - 10, y + 10), (x - 10, y - 10)]
    return {"type": "Polygon", "coordinates": [[at(*each) for each in corners]]}


def test_walks_keep_out_of_an_area(client: httpx.Client) -> None:
    """Whatever the crowd on the way round it, and where the walker leaves that way."""
    said = begun(client, avoid=around(150, 0))
    assert walked(said) == ["Gate", "Back Road", "Quay"]
    url = f"/walks/{said['id']}/position"
    seen = {"location": at(40, 0), "time": "2024-06-01T12:00:30", "ahead": [{"bearing": 180, "density": 4.5}]}
    said = client.post(url, json=seen).json()
    assert said["seen"]
    assert walked(said) == ["Gate", "Back Road", "Quay"]
    said = client.post(url, json={"location": at(100, 0), "time": "2024-06-01T12:01"}).json()
    assert said["left_route"]
    assert walked(said) == ["Long Street", "Back Road", "Quay"]
    answer = client.post(url, json={"location": at(150, 0), "time": "2024-06-01T12:02"})
    assert (answer.status_code, answer.json()["field"]) == (400, "location")


def test_departures_and_reach_keep_out_of_an_area(client: httpx.Client) -> None:
    ends, step = {"origin": WEST, "destination": EAST}, {"until": "12:30", "step": 30}
    text = {name: f"{place[0]},{place[1]}" for name, place in ends.items()}
    plain, same, round_it = (
        answer.json()["departures"][0]["expected_minutes"]
        for answer in (
            client.get("/when", params=text | step),
            client.post("/when", json=ends | step),
            client.post("/when", json=ends | step | {"avoid": around(150, 0)}),
        )
    )
    assert plain == same
    assert round_it - plain == pytest.approx(60 / 1.34 / 60, rel=0.1)  # 2 × 30 m more
    origin, minutes = {"origin": WEST}, [4.0]
    reached = [
        [each["properties"]["kilometres"] for each in answer.json()["features"] if each["properties"]["part"] == "area"]
        for answer in (
            client.get("/isochrone", params={"origin": text["origin"], "minutes": "4"}),
            client.post("/isochrone", json=origin | {"minutes": minutes}),
            client.post("/isochrone", json=origin | {"minutes": minutes, "avoid": around(150, 0)}),
        )
    ]
    assert reached[0] == reached[1]
    assert reached[2][0] < reached[0][0] - 0.2


def test_counts_change_the_plans_of_walks(client: httpx.Client, post) -> None:
    said, served = begun(client), client.app.state.town
    assert under_way.decide_anew(served, said["id"]) == (0, said)
    post(long(MANY))
    news, anew = under_way.decide_anew(served, said["id"])
    assert (news, walked(anew), anew["changed"]) == (1, ["Gate", "Back Road", "Quay"], True)
    assert client.get(f"/walks/{said['id']}").json() == anew
    assert anew["expires"] == said["expires"]
    assert under_way.decide_anew(served, said["id"])[0] == 1  # told once
    post(long(USUAL))


@pytest.mark.parametrize(("departs", "reported"), [("Thu 17:30", "Thu 17:32"), ("2024-05-28T17:30", "17:32")])
def test_walks_in_a_time_of_their_own_stay_in_it(client: httpx.Client, post, departs: str, reported: str) -> None:
    post(long(USUAL))
    said, served = begun(client, depart_at=departs), client.app.state.town
    assert under_way.heard(served, said["id"]) == (0, False)
    post(long(MANY))
    assert under_way.heard(served, said["id"]) == (0, True)
    assert under_way.decide_anew(served, said["id"]) == (0, said)  # nobody knows of these counts then
    assert under_way.heard(served, said["id"]) == (0, False)
    post(long(USUAL))
    report = {"location": at(60, 0), "time": reported}
    assert client.post(f"/walks/{said['id']}/position", json=report).status_code == 200


def test_reports_after_midnight(client: httpx.Client) -> None:
    said = begun(client, depart_at="23:58")
    for when, metres in (("23:59", 60), ("00:01", 200), ("2024-06-02T00:02", 250)):
        report = {"location": at(metres, 0), "time": when}
        answer = client.post(f"/walks/{said['id']}/position", json=report)
        assert answer.status_code == 200, answer.text
    assert answer.json()["arrival"].startswith("2024-06-02T00:0")


@pytest.mark.parametrize("begins", [{}, {"depart_at": NOON}])
def test_reports_of_times_to_come(client: httpx.Client, begins: dict[str, str]) -> None:
    """They are refused, and true ones go on; a walk that is begun with its departure may be played."""
    url = f"/walks/{begun(client, **begins)['id']}/position"
    for when in ("2024-06-01T13:30", "2024-06-02T12:00", "13:30", "Sun 12:00"):
        answer = client.post(url, json={"location": at(40, 0), "time": when})
        assert (answer.status_code, answer.json()["field"]) == (400, "time"), answer.text
    for metres, minute, status in ((40, "00:30", 200), (60, "04:59", 200), (80, "10:30", 200 if begins else 400)):
        report = {"location": at(metres, 0), "time": f"2024-06-01T12:{minute}"}
        assert client.post(url, json=report).status_code == status


def test_counts_after_the_last_report_change_plans_too(client: httpx.Client, post) -> None:
    said, served = begun(client), client.app.state.town
    client.put("/clock", json={"now": "2024-06-01T12:20:00", "speed": 0.001}, headers=WRITES)
    post({"sensor": "long", "time": "2024-06-01T12:05:00", "count": MANY / 4, "seconds": 900})
    news, anew = under_way.decide_anew(served, said["id"])
    assert (news, walked(anew)) == (1, ["Gate", "Back Road", "Quay"])
    # A report that was sent before, and comes after, is taken.
    late = {"location": at(20, 0), "time": "2024-06-01T12:19:59"}
    assert client.post(f"/walks/{said['id']}/position", json=late).status_code == 200
    post({"sensor": "long", "time": "2024-06-01T12:05:00", "count": USUAL / 4, "seconds": 900})


def test_changes_of_a_walk_at_the_same_time(client: httpx.Client, monkeypatch) -> None:
    said, served = begun(client), client.app.state.town
    url, decided = f"/walks/{said['id']}/position", under_way.walks.replan
    moves = [{"location": at(200, 0), "time": "2024-06-01T12:03:00"}]

    def while_somebody_reports(*asked: Any, **more: Any) -> Any:
        if moves:
            assert client.post(url, json=moves.pop()).status_code == 200
        return decided(*asked, **more)

    monkeypatch.setattr(under_way.walks, "replan", while_somebody_reports)
    under_way.decide_anew(served, said["id"])
    assert client.get(f"/walks/{said['id']}").json()["route"]["distance"] == pytest.approx(100, abs=1)
    # Who forgets a walk while it is reported on finds it forgotten.
    reported = under_way.walks.report

    def while_somebody_forgets(*asked: Any, **more: Any) -> Any:
        client.delete(f"/walks/{said['id']}")
        return reported(*asked, **more)

    monkeypatch.setattr(under_way.walks, "report", while_somebody_forgets)
    assert client.post(url, json={"location": at(220, 0), "time": "2024-06-01T12:04:00"}).status_code == 404
    assert client.get(f"/walks/{said['id']}").status_code == 404


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"location": at(9000, 9000)}, "location"),
        ({"location": [181, 0]}, "location"),
        ({"location": at(40, 0), "time": "yesterday"}, "time"),
        ({"location": at(40, 0), "time": "2024-06-01T11:00"}, "time"),
        ({"location": at(40, 0), "density": -1}, "density"),
        ({"location": at(40, 0), "ahead": [{"bearing": 90, "density": 99}]}, "ahead.0.density"),
        ({"location": at(40, 0), "ahead": [{"bearing": 90, "density": 1}] * 17}, "ahead"),
        ({"location": "here"}, "location"),
        ({"place": at(40, 0)}, "location"),
    ],
)
def test_positions_that_cannot_be(client: httpx.Client, body, field: str) -> None:
    answer = client.post(f"/walks/{begun(client)['id']}/position", json=body)
    assert answer.status_code in (400, 422)
    assert answer.json()["field"] == field, answer.text


def test_latitudes_before_longitudes(client: httpx.Client) -> None:
    """East is 300 m from the town then, and told apart from places that are nowhere near it."""
    for (longitude, latitude), is_swapped in ((EAST[::-1], True), (at(0, 2000), False)):
        place, here = f"{longitude},{latitude}", f"{WEST[0]},{WEST[1]}"
        paths = f"/route/v1/foot/{here};{place}", f"/nearest/v1/foot/{place}", f"/isochrone?origin={place}&minutes=5"
        answers = [client.get(path) for path in (*paths, f"/when?origin={here}&destination={place}")]
        answers.append(client.post("/walks", json={"origin": [longitude, latitude], "destination": WEST}))
        for answer in answers:
            assert (answer.status_code, "swap" in answer.text) == (400, is_swapped), answer.text


def test_walks_that_nobody_began(client: httpx.Client) -> None:
    for path in (f"/walks/{'0' * 32}", f"/walks/{'0' * 32}/position"):
        answer = client.request("POST" if path.endswith("position") else "GET", path, json={"location": WEST})
        assert (answer.status_code, answer.json()["field"]) == (404, "id")
    assert client.get("/walks/short").status_code == 422


# Replaying files


class Direct(Client):
    """Asks the app without a network."""

    def __init__(self, client: httpx.Client) -> None:
        self.client, self.asked = client, []

    def ask(self, method: str, path: str, content: Any = None) -> Any:
        self.asked.append((method, path, content))
        answer = self.client.request(method, path, json=content, headers=WRITES)
        assert answer.status_code == 200, answer.text
        return answer.json()


def test_a_file_that_is_replayed(client: httpx.Client, tmp_path: Path) -> None:
    rows = ["2024-06-01T12:00,111,", "2024-06-01T13:00,222,33", "2024-06-01T14:00,333,44"]
    (tmp_path / "day.csv").write_text("\n".join(["time,long,quay", *rows]))
    table, direct, told = read_counts(tmp_path / "day.csv"), Direct(client), []
    with pytest.raises(ReplayError) as found:
        replay(direct, table, 10_000.0, None, told.append)
    assert (found.value.field, client.get("/clock").json()["now"], told) == ("url", f"{NOON}+00:00", [])
    client.delete("/clock", headers=WRITES)
    replay(direct, table, 10_000.0, datetime.fromisoformat("2024-06-01T13:00"), told.append)
    posted = [content for method, path, content in direct.asked if path == "/counts"]
    assert [[(row["sensor"], row["count"]) for row in each] for each in posted] == [
        [("long", 222), ("quay", 33)], [("long", 333), ("quay", 44)],
    ]  # fmt: skip
    assert len(told) == 3  # how long it takes, and each hour
    assert direct.asked[-1][:2] == ("DELETE", "/clock")
    assert client.get("/clock").json()["simulated"] is False
    for begin in ("2024-06-01T11:59", "2024-06-01T15:00"):
        with pytest.raises(ReplayError) as found:
            replay(direct, table, 60.0, datetime.fromisoformat(begin), told.append)
        assert found.value.field == "begin"
        assert all(hour in str(found.value) for hour in ("12:00", "15:00"))
    (tmp_path / "more.csv").write_text("time,elsewhere,long\n2024-06-01T12:00,1,2\n2024-06-01T13:00,1,2\n")
    told.clear()
    replay(direct, read_counts(tmp_path / "more.csv"), 10_000.0, None, told.append)
    assert "elsewhere" in told[0]
    (tmp_path / "other.csv").write_text("time,elsewhere\n2024-06-01T12:00,1\n2024-06-01T13:00,1\n")
    with pytest.raises(ReplayError) as found:
        replay(direct, read_counts(tmp_path / "other.csv"), 60.0, None, told.append)
    assert found.value.field == "file"


def test_hours_without_a_count_are_not_posted(tmp_path: Path) -> None:
    (tmp_path / "gaps.csv").write_text("time,a,b\n2024-06-01T12:00,1,\n2024-06-01T13:00,,\n2024-06-01T14:00,3,4\n")
    assert [(hour.hour, counts) for hour, counts in hours_of(read_counts(tmp_path / "gaps.csv"), None)] == [
        (12, {"a": 1.0}), (13, {}), (14, {"a": 3.0, "b": 4.0}),
    ]  # fmt: skip


def test_servers_that_do_not_answer() -> None:
    for url, field in (("ftp://here", "url"), ("here", "url"), ("http://127.0.0.1:9", "url")):
        with pytest.raises(ReplayError) as found:
            Client(url, None).ask("GET", "/town")
        assert found.value.field == field
