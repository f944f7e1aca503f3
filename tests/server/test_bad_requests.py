"""Requests that no server should have to bear: each is answered with a sentence, and nobody else waits for it."""

import asyncio
import json
import threading
import time
from collections.abc import Callable
from urllib.parse import quote

import httpx
import pytest

from sidestep.server import variants
from sidestep.server.bus import MOST_LISTENERS
from sidestep.server.desk import CLIENT, Desk
from sidestep.server.effort import SIZES
from sidestep.server.problems import ProblemError

from .conftest import ENDS

ROUTE, TABLE, NEAREST = (f"/{service}/v1/foot/{ENDS}" for service in ("route", "table", "nearest"))
ORIGIN, DESTINATION = "origin=0.0001,0.0001", "destination=0.0026,0.0026"
WHEN, ISOCHRONE = f"/when?{ORIGIN}&{DESTINATION}", f"/isochrone?{ORIGIN}"
DEEP = "[" * 50_000


@pytest.fixture
def refused(served: httpx.Client) -> Callable[..., httpx.Response]:
    """Ask for what is refused; what is wrong is said in the right shape, and nothing of the code."""

    def ask(path: str, method: str = "GET", **options: object) -> httpx.Response:
        answer = served.request(method, path, **options)
        assert 400 <= answer.status_code < 500, f"{path}: {answer.status_code} {answer.text[:200]}"
        said = answer.json()
        if answer.headers["content-type"] == "application/json":
            assert set(said) == {"code", "message"}
            sentence = said["message"]
        else:
            assert answer.headers["content-type"] == "application/problem+json"
            assert set(said) == {"type", "title", "status", "detail", "field"}
            assert said["status"] == answer.status_code
            sentence = said["detail"]
        assert 0 < len(sentence) < 600
        for trace in ("Traceback", ".py", "/src/", "sidestep.", "Error(", "should ", "Field required", "unable to"):
            assert trace not in sentence
        return answer

    return ask


# Places

NOWHERE = [
    "nan,nan", "inf,0", "-inf,0", "1e999,0", "0,91", "181,0", "1e308,1e308", "30,30", "", ",", "0", "0,0,0", "0;0",
    "a,b", "0x1,0x1", "1_0,1_0", "٠,٠", "0,0\0", "%", "NaN,NaN", "--1,0", "1e,0", "+,+",
]  # fmt: skip


@pytest.mark.parametrize("place", NOWHERE)
def test_places_that_are_none(refused, place: str) -> None:
    quoted = quote(place, safe=",;")
    for path in (f"/route/v1/foot/{quoted};0,0", f"/table/v1/foot/{quoted};0,0", f"/nearest/v1/foot/{quoted}"):
        refused(path)
    for name in ("origin", "destination"):
        asked = {"origin": "0.0001,0.0001", "destination": "0.0026,0.0026", name: place}
        assert refused("/when", params=asked).json()["field"] == name


@pytest.mark.parametrize(
    "place", [["nan", 0], [None, 0], [True, False], [0], [0, 0, 0], [1e308, 0], [[0], 0], {}, "x", 0]
)
def test_places_that_are_none_as_json(refused, place: object) -> None:
    for service in ("route", "table", "nearest"):
        refused(f"/{service}/v1/foot", "POST", json={"coordinates": [place, [0, 0]]})
    refused("/walks", "POST", json={"origin": place, "destination": [0, 0]})


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "1" + "0" * 400])
def test_numbers_that_json_does_not_have(refused, number: str) -> None:
    kind = {"content-type": "application/json"}
    body = f'{{"coordinates": [[{number}, 0], [0, 0]]}}'
    for service in ("route", "table", "nearest"):
        refused(f"/{service}/v1/foot", "POST", content=body, headers=kind)
    refused("/walks", "POST", content=f'{{"origin": [0, 0], "destination": [0, {number}]}}', headers=kind)
    refused("/clock", "PUT", content=f'{{"now": "2026-01-01T00:00:00", "speed": {number}}}', headers=kind)


def test_many_places(refused) -> None:
    many = ";".join(["0,0"] * 10_000)
    assert refused(f"/route/v1/foot/{many}").status_code == 414
    assert refused(f"/route/v1/foot/{';'.join(['0,0'] * 101)}").json()["code"] == "TooBig"
    for service in ("route", "table", "nearest"):
        assert (
            refused(f"/{service}/v1/foot", "POST", json={"coordinates": [[0, 0]] * 10_000}).json()["code"] == "TooBig"
        )
    assert refused(f"/route/v1/foot/polyline({'_' * 10_000})").json()["code"] == "TooBig"
    refused(f"{ROUTE}?{'x' * 10_000}")  # of which not all is said again


# Parameters


@pytest.mark.parametrize(
    "path",
    [
        "/town?surprise=1", "/crowds?at=Fri%2017:30&at=Sat%2017:30", "/search?q=a&limit=0", "/search?q=a&limit=1e9",
        "/search?limit=3", f"/search?q={'x' * 101}", "/crowds?geometry=maybe", "/healthz?x", "/metrics?name[]=x",
        f"{ROUTE}?surprise=1", f"{ROUTE}?steps=perhaps", f"{ROUTE}?alternatives=-1", f"{ROUTE}?overview=all",
        f"{TABLE}?scale_factor=nan", f"{TABLE}?scale_factor=1e999", f"{TABLE}?sources=-1", f"{TABLE}?sources=7",
        f"{NEAREST}?number=1000000", "/nearest/v1/foot/0,0?number=1e9", f"{ROUTE}?radiuses=nan;nan",
        f"{ROUTE}?bearings=1;1", f"{ROUTE}?hints={'x;' * 200}", f"{ROUTE}?exclude={'x,' * 100}", f"{ROUTE}?exclude=x",
        f"{ROUTE}?walker={'x' * 300}", f"{ROUTE}?walker=%00", f"{ROUTE}?walker=adult,older", f"{ROUTE}?walker=giant",
        f"{ROUTE}?walker=custom,free_speed=1e300", f"{ROUTE}?walker=older,free_speed=nan", f"{ROUTE}?objective=joy",
        f"{ROUTE}?objective=exposure=nan", f"{ROUTE}?objective=exposure=1e999", f"{ROUTE}?objective=time=0",
        f"{ROUTE}?confidence=0.9", f"{ROUTE}?arrive_by=5&confidence=2", "/route/v1/car/0,0;0.001,0",
        "/route/v1/foot/0,0", "/route/v2/foot/0,0;0.001,0", "/trip/v1/foot/0,0;0.001,0",
    ],
)  # fmt: skip
def test_parameters_that_are_wrong(refused, path: str) -> None:
    refused(path)


@pytest.mark.parametrize(
    ("path", "method", "body", "name", "got"),
    [
        (f"{ROUTE}?steps=maybe", "GET", None, "steps", "maybe"),
        (f"{ROUTE}?overview=all", "GET", None, "overview", "all"),
        (f"{ROUTE}?bearings=1,2;361,3", "GET", None, "bearings.1.0", "361"),
        (f"{ROUTE}?continue_straight=often", "GET", None, "continue_straight", "often"),
        (f"{ROUTE}?hints={'x;' * 200}", "GET", None, "hints", "201"),
        (f"{ROUTE}?walker={'x' * 300}", "GET", None, "walker", "300"),
        (f"{ROUTE}?planner=a:b", "GET", None, "planner", "a:b"),
        ("/search?q=a&limit=many", "GET", None, "limit", "many"),
        ("/search", "GET", None, "q", "missing"),
        (f"{WHEN}&step=0", "GET", None, "step", "0"),
        ("/walks/short", "GET", None, "walk_id", "short"),
        ("/walks", "POST", [], "the body", "[]"),
        ("/walks", "POST", {"origin": "here", "destination": [0, 0]}, "origin", "here"),
        ("/walks", "POST", {"origin": [0], "destination": [0, 0]}, "origin.1", "missing"),
        ("/walks", "POST", {"origin": [0, 0], "destination": [0, 0], "futures": 2.5}, "futures", "2.5"),
        ("/isochrone", "POST", {"origin": [0, 0], "minutes": []}, "minutes", "0"),
        ("/isochrone", "POST", {"origin": [0, 0], "minutes": [None]}, "minutes.0", "null"),
        ("/clock", "PUT", {"now": "noon"}, "now", "noon"),
        ("/clock", "PUT", {"now": "1800-01-01T00:00"}, "now", "1900"),
        ("/route/v1/foot", "POST", {"coordinates": [[0, 0], [0, 0, 0]]}, "coordinates.1", "3"),
        ("/route/v1/foot", "POST", {"coordinates": [[0, 0]] * 2, "annotations": [1]}, "annotations.0", "1"),
        ("/route/v1/foot", "POST", {"coordinates": [[0, 0]] * 2, "avoid": True}, "avoid", "true"),
        ("/route/v1/foot", "POST", {"coordinates": [[0, 0]] * 2, "steps": "true"}, "steps", "'true'"),
        (f"/walks/{'0' * 32}/position", "POST", {"location": [0, 0], "ahead": [{"bearing": 1}]}, "ahead.0.density", ""),
    ],
)
def test_sentences_name_the_parameter_and_what_it_got(refused, path: str, method: str, body, name: str, got) -> None:
    said = refused(path, method, **({} if body is None else {"json": body})).json()
    sentence = said.get("message") or said["detail"]
    assert sentence.startswith((f"{name} ", f"{name}: "))
    assert got in sentence.removeprefix(name)


@pytest.mark.parametrize(
    "time",
    ["never", "\0", "9999-12-31T23:59", "0001-01-01T00:00", "1e999", "nan", "-inf", "Fri 24:00", "Fri 17:30:99",
     "2026-02-30T12:00", "2026-11-27T08:00+99:00", "x" * 41, "2026-W48-5", "17:30 Fri", "∞"],
)  # fmt: skip
def test_times_that_are_none(refused, time: str) -> None:
    for path, name in [(ROUTE, "depart_at"), (ROUTE, "arrive_by"), (TABLE, "depart_at"), (ISOCHRONE, "depart_at")]:
        refused(path, params={**dict(httpx.URL(path).params), name: time})
    for name in ("depart_at", "until", "arrive_by"):
        refused("/when", params={**dict(httpx.URL(WHEN).params), name: time})
    refused("/crowds", params={"at": time})
    refused("/clock", "PUT", json={"now": time})


@pytest.mark.parametrize(
    ("path", "field"),
    [
        (f"{ISOCHRONE}&minutes=nan", "minutes"), (f"{ISOCHRONE}&minutes=1e308", "minutes"),
        (f"{ISOCHRONE}&minutes=", "minutes"), (f"{ISOCHRONE}&minutes=-1", "minutes"),
        (f"{ISOCHRONE}&minutes=0", "minutes"),
        (f"{ISOCHRONE}&minutes=1_0", "minutes"), (f"{ISOCHRONE}&minutes=1,2,3,4,5,6,7,8,9", "minutes"),
        (f"{ISOCHRONE}&futures=0", "futures"), (f"{ISOCHRONE}&futures=1001", "futures"),
        (f"{ISOCHRONE}&futures=1.5", "futures"), (f"{ISOCHRONE}&planner=snapshot", "planner"),
        (f"{WHEN}&step=0.01", "step"), (f"{WHEN}&step=1e-320", "step"), (f"{WHEN}&step=nan", "step"),
        (f"{WHEN}&step=inf", "step"), (f"{WHEN}&step=-5", "step"), (f"{WHEN}&step=0.1", "step"),
        (f"{WHEN}&planner=forecast&futures=1000", "futures"), (f"{WHEN}&futures=1000&step=0.5", "step"),
    ],
)  # fmt: skip
def test_windows_and_numbers_that_are_too_large(refused, path: str, field: str) -> None:
    assert refused(path).json()["field"] == field


# Planners

NONE = [
    "os:abort",
    "os:getcwd",
    "sys:exit",
    "builtins:exit",
    "a" * 81,
    "expected:x",
    "",
    "..",
    "clairvoyant",
    "darp",
    "\0",
]


@pytest.mark.parametrize("name", NONE)
def test_planners_are_names(refused, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """On the command line MODULE:NAME is one, too, for which a module is imported and what is in it called."""
    monkeypatch.setattr("sidestep.planners.registry.import_module", lambda name: pytest.fail(f"{name} was imported"))
    refused(ROUTE, params={"planner": name, "futures": 1})
    refused("/when", params={**dict(httpx.URL(WHEN).params), "planner": name})
    refused("/isochrone", params={**dict(httpx.URL(ISOCHRONE).params), "planner": name})
    body = {"coordinates": [[0.0001, 0.0001], [0.0026, 0.0026]], "planner": name, "futures": 1}
    refused("/route/v1/foot", "POST", json=body)
    refused("/walks", "POST", json={"origin": [0.0001, 0.0001], "destination": [0.0026, 0.0026], "planner": name})


@pytest.mark.parametrize("more", ["", "&futures=1"])
def test_a_model_that_is_not_there(refused, more: str) -> None:
    """It is said how a server has one."""
    for path in (f"{ROUTE}?", f"{WHEN}&", f"{ISOCHRONE}&"):
        assert "sidestep serve --model DIR" in refused(f"{path}planner=darp{more}").text
    ends = {"origin": [0.0001, 0.0001], "destination": [0.0026, 0.0026]}
    assert refused("/walks", "POST", json={**ends, "planner": "darp"}).json()["field"] == "planner"


def test_every_planner_of_the_document_is_a_name(served) -> None:
    """Paths that are added later must not forget it."""
    found: list[dict] = []

    def look(value: object) -> None:
        if isinstance(value, dict):
            if value.get("name") == "planner" and "in" in value:
                found.append(value["schema"])
            if "requestBody" in value:
                found.extend(_members(value["requestBody"], "planner"))
            for each in value.values():
                look(each)
        elif isinstance(value, list):
            for each in value:
                look(each)

    look(served.get("/openapi.json").json())
    assert len(found) >= 5
    assert all('"pattern"' in json.dumps(each) for each in found)


def test_schemas_lead_nowhere_else(served: httpx.Client) -> None:
    assert "#/$defs/" not in served.get("/openapi.json").text


@pytest.mark.parametrize("name", ["depart_at", "steps", "alternatives"])
def test_parameters_given_twice(served: httpx.Client, name: str) -> None:
    answer = served.get(f"{ROUTE}?{name}=1&{name}=1")
    assert answer.status_code == 400
    assert answer.json()["message"] == f"{name} is given twice"


def _members(value: object, name: str) -> list[dict]:
    if isinstance(value, list):
        return [found for each in value for found in _members(each, name)]
    if not isinstance(value, dict):
        return []
    own = [value["properties"][name]] if name in value.get("properties", {}) else []
    return own + [found for each in value.values() for found in _members(each, name)]


# Bodies

BODIES = [
    ("/route/v1/foot", "POST"),
    ("/table/v1/foot", "POST"),
    ("/walks", "POST"),
    ("/when", "POST"),
    ("/isochrone", "POST"),
    ("/clock", "PUT"),
    ("/counts", "POST"),
]


@pytest.mark.parametrize(("path", "method"), BODIES)
@pytest.mark.parametrize(
    "body",
    [
        b"", b"null", b"0", b'""', b"[]", b"{}", b"{", b'{"a": 1}', b"\xff\xfe", b"\x00", DEEP.encode(),
        b'{"coordinates": ' + DEEP.encode(), b'{"coordinates": ' + b"9" * 5000 + b"}", b"\xef\xbb\xbf{}",
        b'{"now": 1, "origin": 1, "sensor": 1}', b'{"coordinates": [[0,0],[0,0]], "coordinates": 1}',
        b'{"coordinates": "\\ud800"}', b'"' + b"x" * 100_000 + b'"',
    ],
    ids=range(18),
)  # fmt: skip
def test_bodies_that_are_wrong(refused, path: str, method: str, body: bytes) -> None:
    refused(path, method, content=body, headers={"content-type": "application/json"})


@pytest.mark.parametrize(("path", "method"), BODIES[:-1])
@pytest.mark.parametrize(
    "kind", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data", "x", "\xff"]
)
def test_bodies_of_other_types(refused, path: str, method: str, kind: str) -> None:
    answer = refused(path, method, content=b"{}", headers={"content-type": kind.encode("latin-1")})
    assert answer.status_code == 415


@pytest.mark.parametrize(
    "avoid",
    [
        {}, {"type": "Point", "coordinates": [0, 0]}, {"type": "Polygon"}, {"type": "Polygon", "coordinates": []},
        {"type": "Polygon", "coordinates": [[[0, 0]]]}, {"type": "Polygon", "coordinates": [[["a", 0]] * 4]},
        {"type": "Polygon", "coordinates": [[[0, 0], [1e308, 0], [0, 1e308], [0, 0]]]},
        {"type": "FeatureCollection", "features": {}}, {"type": ["Polygon"]}, {"type": "Polygon", "coordinates": 5},
    ],
)  # fmt: skip
def test_areas_that_are_none(refused, avoid: dict) -> None:
    body = {"coordinates": [[0.0001, 0.0001], [0.0026, 0.0026]], "avoid": avoid}
    refused("/route/v1/foot", "POST", json=body)
    body = {"origin": [0.0001, 0.0001], "destination": [0.0026, 0.0026], "avoid": avoid}
    for path in ("/walks", "/when"):
        assert refused(path, "POST", json=body).json()["field"] == "avoid"
    del body["destination"]
    assert refused("/isochrone", "POST", json=body).json()["field"] == "avoid"


def test_areas_that_are_too_large_to_keep(refused) -> None:
    area = {"type": "Polygon", "coordinates": [[[0.0001, 0.0001 + number / 1e7] for number in range(3000)]]}
    body = {"origin": [0.0001, 0.0001], "destination": [0.0026, 0.0026], "avoid": area}
    assert refused("/walks", "POST", json=body).status_code == 413


def test_areas_that_contain_themselves(refused) -> None:
    deep = '{"type":"Feature","geometry":' * 5000 + "null" + "}" * 5000
    body = f'{{"coordinates": [[0.0001, 0.0001], [0.0026, 0.0026]], "avoid": {deep}}}'
    refused("/route/v1/foot", "POST", content=body, headers={"content-type": "application/json"})


# Addresses and methods


@pytest.mark.parametrize(
    "path", ["/nowhere", "/town/", "/%00", "/%ff", "/town%2f", "/.env", "/docs", "/redoc", "/assets/../app.py",
             "/assets/%2e%2e/server/app.py", "/walks/../../etc/passwd", "/openapi.json/"],
)  # fmt: skip
def test_there_is_nothing_else(refused, path: str) -> None:
    assert refused(path).status_code == 404


@pytest.mark.parametrize("walk", ["0", "G" * 32, "f" * 32, "f" * 33, "%00" * 32, "' OR 1=1 --"])
def test_walks_that_are_none(refused, walk: str) -> None:
    refused(f"/walks/{walk}")
    refused(f"/walks/{walk}", "DELETE")
    refused(f"/walks/{walk}/position", "POST", json={"location": [0, 0]})


@pytest.mark.parametrize(
    ("path", "allowed"),
    [("/clock", "DELETE, GET, PUT"), ("/counts", "POST"), ("/town", "GET"), ("/route/v1/foot", "POST")],
)
@pytest.mark.parametrize("method", ["PATCH", "TRACE", "OPTIONS", "FOO"])
def test_methods_that_are_none(refused, method: str, path: str, allowed: str) -> None:
    answer = refused(path, method)
    assert answer.status_code == 405
    assert answer.headers["allow"] == allowed


def test_methods_are_not_overridden(served) -> None:
    answer = served.get("/clock", headers={"x-http-method-override": "DELETE", "x-method-override": "DELETE"})
    assert answer.status_code == 200
    assert served.get("/healthz?_method=DELETE").status_code == 400


def test_head(served) -> None:
    for path in ("/healthz", "/streets", ROUTE):
        head, whole = served.head(path), served.get(path)
        assert (head.status_code, head.content) == (200, b"")
        assert head.headers["content-type"] == whole.headers["content-type"]


# What one question may cost


def test_futures_are_rounded_up(served, monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs are compiled for each number of them."""
    assert served.get(f"{ROUTE}?futures=20").status_code == 200
    walked: list[int] = []
    from sidestep.routing import router

    answer = router.Router.answer
    monkeypatch.setattr(
        router.Router, "answer", lambda self, request: walked.append(request.futures) or answer(self, request)
    )
    for number in range(2, 21, 3):
        assert served.get(f"{ROUTE}?futures={number}").status_code == 200
    assert set(walked) == {20}
    assert SIZES[-1] == 1000


def test_routers_are_kept_for_few_walkers(served, monkeypatch: pytest.MonkeyPatch) -> None:
    forgotten: list[bool] = []
    monkeypatch.setattr(variants, "forget_programs", lambda: forgotten.append(True))
    monkeypatch.setattr(variants, "MOST_MADE", 3)
    for number in range(6):
        assert served.get(f"{NEAREST.split(';')[0]}?walker=older,lift_wait={number}").status_code == 200
    kept = list(served.app.state.town.variants)
    assert len(kept) == 1 + variants.MOST_VARIANTS
    assert len(forgotten) == 2
    same = served.get(f"{NEAREST.split(';')[0]}?walker=%20older,%20lift_wait=5.0")
    assert same.status_code == 200
    assert list(served.app.state.town.variants) == kept


def test_few_may_listen(served) -> None:
    bus = served.app.state.bus
    before, bus._queues = bus._queues, {object() for _ in range(MOST_LISTENERS)}
    try:
        answer = served.get("/events")
    finally:
        bus._queues = before
    assert answer.status_code == 503
    assert answer.headers["retry-after"]


def at_desk(*work: tuple[str, Callable[[], object]], desk: Desk) -> list[object]:
    """Ask at a desk, each question by its client; answers and refusals."""

    async def ask(client: str, question: Callable[[], object]) -> object:
        CLIENT.set(client)
        return await desk.answer(question)

    async def all_of_them() -> list[object]:
        return await asyncio.gather(*(ask(*each) for each in work), return_exceptions=True)

    try:
        return asyncio.run(all_of_them())
    finally:
        desk.close()


def test_questions_that_take_long() -> None:
    def fail() -> None:
        raise TimeoutError

    assert at_desk(("a", lambda: 1), ("b", lambda: 2), desk=Desk(1, 2, 2, 5)) == [1, 2]
    (error,) = at_desk(("a", fail), desk=Desk(1, 2, 2, 5))
    assert type(error) is TimeoutError  # its own


def test_too_many_questions() -> None:
    hold = threading.Event()
    threading.Timer(0.3, hold.set).start()
    found = at_desk(*[("a", hold.wait)] * 3, ("b", hold.wait), *[("c", hold.wait)] * 2, desk=Desk(1, 4, 2, 5))
    assert [getattr(each, "status", each) for each in found] == [True, True, 503, True, True, 503]


def test_questions_that_take_too_long() -> None:
    """What has begun goes on, what waits does not begin."""
    hold, begun = threading.Event(), []
    started = time.monotonic()
    found = at_desk(("a", hold.wait), ("a", lambda: begun.append(1)), desk=Desk(1, 4, 4, 0.1))
    assert time.monotonic() - started < 2
    hold.set()
    assert [type(each) for each in found] == [ProblemError] * 2
    assert not begun


def test_desks_count_what_is_done() -> None:
    desk = Desk(2, 2, 2, 5)

    async def ask() -> int:
        for _ in range(20):
            await desk.answer(lambda: None)
        await asyncio.sleep(0.05)
        return desk._clients.total()

    assert asyncio.run(ask()) == 0
    desk.close()


def test_quick_routes_do_not_wait_for_long_answers(served) -> None:
    """Nor does the check whether the server is alive."""
    town, hold = served.app.state.town, threading.Event()
    asking = [
        threading.Thread(target=lambda: served.portal.call(town.heavily, lambda: hold.wait(20))) for _ in range(6)
    ]
    for each in asking:
        each.start()
    try:
        begun = time.monotonic()
        for path in (ROUTE, "/healthz", NEAREST.split(";")[0], "/streets", "/crowds"):
            assert served.get(path).status_code == 200
        assert time.monotonic() - begun < 5
    finally:
        hold.set()
        for each in asking:
            each.join()
