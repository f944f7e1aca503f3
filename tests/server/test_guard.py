"""Who may do what: hosts, origins, keys, rates, sizes; and what every answer has."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterator

import httpx
import pytest
from fastapi import Request
from starlette.types import Message, Receive, Scope, Send

from sidestep.errors import SidestepError
from sidestep.server import guard
from sidestep.server.app import make_app
from sidestep.server.guard import Body, Guard, Rate, check_key, client_of
from sidestep.server.problems import ProblemError
from sidestep.server.settings import KEY_VARIABLE, Settings

from .conftest import ENDS

KEY = "0123456789abcdef"
OTHER = "https://map.example"


@pytest.fixture
def client(test_client) -> Callable[..., httpx.Client]:
    """A client of an app without a town: what is asked there never comes to it."""

    def make(base_url: str = "http://127.0.0.1", **settings: object) -> httpx.Client:
        return test_client(make_app(Settings(**settings)), base_url=base_url)

    return make


# What every answer has


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/healthz", 200),
        ("HEAD", "/healthz", 200),
        ("GET", "/nowhere", 404),
        ("TRACE", "/healthz", 405),
        ("GET", f"/town?{'x' * 20_000}", 414),
        ("GET", "/town?surprise=1", 400),
        ("GET", "/search", 422),
        ("GET", f"/route/v1/foot/{ENDS}", 200),
        ("GET", "/route/v1/foot/0,0;1", 400),
    ],
)
def test_security_headers(served, method: str, path: str, status: int) -> None:
    answer = served.request(method, path)
    assert answer.status_code == status
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["x-frame-options"] == "DENY"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert "access-control-allow-origin" not in answer.headers
    assert "server" not in answer.headers
    assert (method == "HEAD") == (not answer.content)


def test_what_stays_as_it_was_has_them_too(served) -> None:
    tag = served.get("/streets").headers["etag"]
    answer = served.get("/streets", headers={"if-none-match": tag})
    assert answer.status_code == 304
    assert not answer.content
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_errors_of_the_code_tell_nothing(caplog) -> None:
    app = make_app(Settings())

    @app.get("/faulty")
    async def faulty(request: Request) -> None:
        raise ValueError(str(request.url))

    transport = httpx.ASGITransport(app)

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as asked:
            return await asked.get("/faulty?place=24.9414,60.1719")

    with caplog.at_level(logging.INFO, logger="sidestep"):
        answer = asyncio.run(ask())
    assert answer.status_code == 500
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert "Value" not in answer.text
    assert "ValueError" in caplog.text
    assert "test_guard.py" in caplog.text
    assert "24.94" not in caplog.text


def test_errors_after_an_answer_has_begun_end_it() -> None:
    async def app(_scope: Scope, _receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        raise ValueError

    assert _sent(app) == ["http.response.start"]


def test_a_stop_that_has_waited_for_long_enough_is_answered() -> None:
    async def app(*_: object) -> None:
        raise asyncio.CancelledError

    assert _sent(app) == ["http.response.start", "http.response.body"]


def _sent(app: object) -> list[str]:
    sent: list[Message] = []

    async def send(message: Message) -> None:
        sent.append(message)

    async def receive() -> Message:
        return {"type": "http.request", "body": b"", "more_body": False}

    scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": []}
    asyncio.run(Guard(app, Settings())(scope, receive, send))
    return [each["type"] for each in sent]


# Host and Origin

WRITES = [("PUT", "/clock"), ("DELETE", "/clock"), ("POST", "/counts"), ("POST", "/route/v1/foot")]


@pytest.mark.parametrize("host", ["evil.example", "", "[", "[::1", "]", "localhost.evil.example", "\xff", "a:b@c"])
@pytest.mark.parametrize(("method", "path"), WRITES)
def test_writes_address_this_server(client, method: str, path: str, host: str) -> None:
    answer = client().request(method, path, headers={"host": host.encode("latin-1")})
    assert answer.status_code == 403


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost", "[::1]:8000", "192.0.2.7", "walks.example:443"])
def test_own_hosts(client, host: str) -> None:
    asked = client(hosts=("walks.example",), host="192.0.2.7")
    answer = asked.put("/clock", headers={"host": host})
    assert answer.json()["field"] == "authorization"  # it came to the check of the key


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://[", "http://127.0.0.1:1", "127.0.0.1", ""])
@pytest.mark.parametrize(("method", "path"), WRITES)
def test_writes_come_from_own_pages(client, method: str, path: str, origin: str) -> None:
    answer = client().request(method, path, headers={"origin": origin})
    assert answer.status_code == 403
    assert origin in answer.text


def test_own_and_allowed_pages_may_write(served, client) -> None:
    body = {"coordinates": [[0.0001, 0.0001], [0.0026, 0.0026]]}
    for origin in ("http://127.0.0.1", "https://127.0.0.1"):
        assert served.post("/route/v1/foot", json=body, headers={"origin": origin}).status_code == 200
    asked = client(origins=(OTHER,), host="192.0.2.7")
    assert asked.put("/clock", headers={"origin": OTHER}).json()["field"] == "authorization"


def test_cors_is_off(client) -> None:
    asked = {"origin": OTHER, "access-control-request-method": "POST"}
    answer = client().options("/counts", headers=asked)
    assert answer.status_code == 405
    assert "access-control-allow-origin" not in answer.headers


def test_cors_for_some(client) -> None:
    asked = client(origins=(OTHER,))
    answer = asked.get("/healthz", headers={"origin": OTHER})
    assert answer.headers["access-control-allow-origin"] == OTHER
    assert "access-control-allow-credentials" not in answer.headers
    preflight = {"origin": OTHER, "access-control-request-method": "POST"}
    assert asked.options("/counts", headers=preflight).status_code == 200
    others = {**preflight, "origin": "https://evil.example"}
    assert "access-control-allow-origin" not in asked.options("/counts", headers=others).headers
    assert (
        "access-control-allow-origin" not in asked.get("/healthz", headers={"origin": "https://evil.example"}).headers
    )


# Keys


@pytest.fixture
def with_key(monkeypatch: pytest.MonkeyPatch, client) -> httpx.Client:
    monkeypatch.setenv(KEY_VARIABLE, KEY)
    return client()


@pytest.mark.parametrize(("method", "path"), WRITES[:3])
@pytest.mark.parametrize(
    "given", [None, "", KEY, f"Basic {KEY}", "Bearer", "Bearer ", f"Bearer {KEY[:-1]}", f"Bearer {KEY}x", "Bearer é"]
)
def test_writes_need_the_key(with_key, method: str, path: str, given: str | None) -> None:
    headers = {} if given is None else {"authorization": given.encode("latin-1")}
    answer = with_key.request(method, path, headers=headers)
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    assert KEY not in answer.text


@pytest.mark.parametrize("given", [f"Bearer {KEY}", f"bearer  {KEY} "])
def test_the_key(given: str) -> None:
    check_key(given, KEY)


@pytest.mark.parametrize("name", ["forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-real-ip"])
def test_nothing_is_taken_through_a_proxy_without_a_key(client, name: str) -> None:
    answer = client().put("/clock", headers={name: "203.0.113.5"})
    assert answer.status_code == 403
    assert answer.json()["field"] == "authorization"


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.7", "::", "", "walks.example"])  # noqa: S104
@pytest.mark.parametrize(("method", "path"), WRITES[:3])
def test_nothing_is_taken_from_the_network_without_a_key(client, method: str, path: str, host: str) -> None:
    answer = client(host=host).request(method, path)
    assert answer.status_code == 403
    assert answer.json()["field"] == "authorization"


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_loopback_needs_no_key(host: str) -> None:
    assert Settings(host=host).on_loopback


@pytest.mark.parametrize("key", ["short", "  " + "x" * 15 + "\n", "naïve-" + "x" * 20, "with\x07bell-" + "x" * 20])
def test_keys_that_are_none(monkeypatch: pytest.MonkeyPatch, tmp_path, key: str) -> None:
    monkeypatch.setenv(KEY_VARIABLE, key)
    with pytest.raises(SidestepError) as raised:
        Settings().key()
    assert raised.value.field == "api_key_file"
    assert key.strip() not in str(raised.value)
    (tmp_path / "key").write_text(key)
    with pytest.raises(SidestepError):
        Settings(key_file=str(tmp_path / "key")).key()


def test_keys_in_files(tmp_path) -> None:
    (tmp_path / "key").write_text(f"{KEY}\n")
    assert Settings(key_file=str(tmp_path / "key")).key() == KEY
    with pytest.raises(SidestepError):
        Settings(key_file=str(tmp_path / "nowhere")).key()
    (tmp_path / "bytes").write_bytes(b"\xff" * 20)
    with pytest.raises(SidestepError):
        Settings(key_file=str(tmp_path / "bytes")).key()


def test_workers_do_not_get_the_key_with_the_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, KEY)
    assert KEY not in Settings().model_dump_json()


# Rates and sizes


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    now = [1000.0]
    monkeypatch.setattr(guard.time, "monotonic", lambda: now[0])
    return now


def test_rates(clock: list[float]) -> None:
    rate = Rate(10)
    assert [rate.allows("a") for _ in range(21)] == [True] * 20 + [False]
    assert rate.allows("b")
    clock[0] += 0.1
    assert [rate.allows("a") for _ in range(2)] == [True, False]
    clock[0] += 3600
    assert sum(rate.allows("a") for _ in range(100)) == 20


def test_slow_rates_allow_something(clock: list[float]) -> None:
    rate = Rate(0.1)
    assert [rate.allows("a"), rate.allows("a")] == [True, False]
    clock[0] += 10.001
    assert rate.allows("a")


def test_rates_forget_clients(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "MOST_CLIENTS", 5)
    rate = Rate(1)
    for number in range(20):
        rate.allows(str(number))
    assert len(rate._left) == 5


def test_who_is_a_client() -> None:
    assert client_of("192.0.2.7") == "192.0.2.7"
    assert client_of("2001:db8::1") == client_of("2001:db8::ffff:1") != client_of("2001:db8:0:1::1")
    assert client_of("::ffff:192.0.2.7") == "192.0.2.7"
    assert client_of("not:an:address") == "not:an:address"


def test_too_many_requests(client) -> None:
    asked = client(requests_per_second=2)
    statuses = [asked.get("/healthz").status_code for _ in range(6)]
    assert statuses[:4] == [200] * 4
    assert 429 in statuses
    assert asked.get("/route/v1/foot/0,0;1,1").headers["retry-after"] == "1"


@pytest.mark.parametrize(
    ("forwarded", "statuses"),
    [
        (["203.0.113.1", "203.0.113.2", "203.0.113.1"], [200, 200, 429]),
        (["192.0.2.1, 203.0.113.1", "192.0.2.2, 203.0.113.1"], [200, 429]),  # clients may make up what comes first
        (["203.0.113.1, 10.1.2.3", "203.0.113.2, 10.1.2.3"], [200, 200]),  # two proxies
    ],
)
def test_proxies_say_whom_they_ask_for(client, forwarded: list[str], statuses: list[int]) -> None:
    asked = client(requests_per_second=0.1, proxies=("testclient", "10.1.0.0/16"))
    assert [asked.get("/healthz", headers={"x-forwarded-for": each}).status_code for each in forwarded] == statuses


def test_strangers_do_not_say_whom_they_ask_for(client) -> None:
    for proxies in ((), ("10.1.2.3",)):
        asked = client(requests_per_second=0.1, proxies=proxies)
        statuses = [asked.get("/healthz", headers={"x-forwarded-for": each}).status_code for each in ("10.1.2.3", "a")]
        assert statuses == [200, 429]


def test_headers_are_bounded(client) -> None:
    answer = client().get("/healthz", headers={"x-long": "x" * 70_000})
    assert answer.status_code == 431


@pytest.mark.parametrize("length", ["2000000", "9" * 5000])
def test_bodies_that_say_that_they_are_too_large(client, length: str) -> None:
    answer = client().post("/counts", content=b"x", headers={"content-length": length})
    assert answer.status_code == 413
    assert answer.headers["connection"] == "close"


def test_bodies_that_turn_out_too_large(served) -> None:
    answer = served.post("/counts", content=iter([b"x" * 65536] * 20))
    assert answer.status_code == 413


def test_bodies_that_do_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "BODY_SECONDS", 0.05)

    async def receive() -> Message:
        await asyncio.sleep(0.02)
        return {"type": "http.request", "body": b"x", "more_body": True}

    async def read() -> None:
        body = Body({"headers": []}, receive)
        while True:
            await body.receive()

    begun = time.monotonic()
    with pytest.raises(ProblemError) as raised:
        asyncio.run(read())
    assert raised.value.status == 408
    assert time.monotonic() - begun < 1
