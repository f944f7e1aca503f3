"""The server as a process: what slow, greedy and careless clients do to it, how it stops, and how it does not start."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from sidestep.cli import app as cli
from sidestep.errors import SidestepError
from sidestep.server import run
from sidestep.server.settings import KEY_VARIABLE

from .conftest import ENDS
from .processes import Server, connections, read_all, workers_of

POST = b"POST /route/v1/foot HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\n"
CHUNKED, LONG_BODY = b"transfer-encoding: chunked\r\n\r\n", b"content-length: 999\r\n\r\n"
ROUTE = f"/route/v1/foot/{ENDS}"
LONG = "/when?origin=0.0001,0.0001&destination=0.0026,0.0026&step=0.5&futures=200"
WAITING = 1.0  # s, instead of IDLE and UNREAD
CONNECTIONS = 30
PATIENT = """
import sys
from sidestep.server import connections, guard
from sidestep.cli.app import main
connections.IDLE = connections.UNREAD = float(sys.argv[1])
connections.LOOK, connections.MOST_CONNECTIONS, guard.BODY_SECONDS = 0.1, int(sys.argv[2]), float(sys.argv[1]) / 2
del sys.argv[1:3]
main()
"""


@pytest.fixture(scope="module")
def server(start) -> Server:
    """One that loses its patience soon."""
    return start("--rate", "100000", program=("-c", PATIENT, str(WAITING), str(CONNECTIONS)))


@pytest.fixture(autouse=True)
def still_there(request: pytest.FixtureRequest) -> Iterator[None]:
    """Whatever a test of the shared server does to it: it answers, and has nothing to say of its own code."""
    yield
    if "server" in request.fixturenames:
        found = request.getfixturevalue("server")
        assert httpx.get(f"{found.url}{ROUTE}").json()["code"] == "Ok"
        assert "Traceback" not in found.log.read_text()


# Slow clients


def trickle(made: socket.socket, part: bytes, every: float) -> float:
    """Send a part again and again until the server has had enough; how long that took."""
    begun = time.monotonic()
    made.settimeout(every)
    while time.monotonic() - begun < 20:
        try:
            made.sendall(part)
            if made.recv(2**16) == b"":
                break
        except TimeoutError:
            continue
        except ConnectionError:
            break
    return time.monotonic() - begun


@pytest.mark.parametrize("begun", [b"", b"GET /healthz HT", b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nx: "])
def test_headers_that_do_not_end(server, begun: bytes) -> None:
    with server.connect(begun) as made:
        before = time.monotonic()
        assert read_all(made) == b""
        assert WAITING / 2 < time.monotonic() - before < WAITING + 2


@pytest.mark.parametrize(
    ("begun", "part"),
    [(b"GET /healthz HTTP/1.1\r\nx: ", b"x"), (b"GET /healthz HTTP/1.1\r\n", b"a: b\r\n"), (b"", b"\r\n")],
)
def test_headers_that_come_slowly(server, begun: bytes, part: bytes) -> None:
    with server.connect(begun) as made:
        assert trickle(made, part, 0.1) < WAITING + 2


def test_idle_connections_are_closed(server) -> None:
    with server.connect(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n") as made:
        before = time.monotonic()
        assert b'{"status":"ok"}' in read_all(made)
        assert time.monotonic() - before < WAITING + 2


def test_bodies_that_come_slowly(server) -> None:
    with server.connect(POST + LONG_BODY) as made:
        answer = read_all(made)
    assert answer.startswith(b"HTTP/1.1 408")
    assert b"x-content-type-options" in answer


def test_bodies_of_requests_that_need_none(server) -> None:
    with server.connect(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\ntransfer-encoding: chunked\r\n\r\n") as made:
        assert trickle(made, b"1\r\nx\r\n", 0.1) < WAITING + 2


def test_answers_that_are_not_taken(server) -> None:
    """Each waits in memory until its client takes it."""
    with socket.socket() as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        made.connect(("127.0.0.1", server.port))
        made.settimeout(20)
        made.sendall(b"GET /openapi.json HTTP/1.1\r\nhost: localhost\r\n\r\n" * 90)
        time.sleep(WAITING + 2)
        assert read_all(made).count(b"HTTP/1.1 200") < 90


# Greedy clients


def test_headers_without_end(server) -> None:
    with server.connect(b"GET /healthz HTTP/1.1\r\nx: ") as made, contextlib.suppress(ConnectionError):
        for _ in range(100):
            made.sendall(b"x" * 65536)
        pytest.fail("ten megabytes of headers were read")


def test_long_headers(server) -> None:
    for line in (b"x: " + b"x" * 70_000, b"\r\n".join([b"a: b"] * 20_000)):
        answer = server.ask(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\n" + line + b"\r\nconnection: close\r\n\r\n")
        assert answer.startswith(b"HTTP/1.1 431") or answer == b""


def test_trailers_without_end(server) -> None:
    with server.connect(POST + CHUNKED + b"0\r\n") as made, contextlib.suppress(ConnectionError):
        for _ in range(100):
            made.sendall(b"a: b\r\n" * 10_000)
        pytest.fail("six megabytes of trailers were read")


def test_bodies_without_end(server) -> None:
    with server.connect(POST + CHUNKED) as made:
        with contextlib.suppress(ConnectionError):
            for _ in range(200):
                made.sendall(b"10000\r\n" + b"x" * 65536 + b"\r\n")
        assert read_all(made)[:12] in {b"HTTP/1.1 413", b""}  # the answer may be lost with the connection


def test_more_connections_than_there_may_be(server) -> None:
    """Those that wait longest make room."""
    opened = [server.connect(b"GET /he") for _ in range(3 * CONNECTIONS)]
    try:
        begun = time.monotonic()
        assert httpx.get(f"{server.url}/healthz").status_code == 200
        assert time.monotonic() - begun < WAITING / 2
    finally:
        for each in opened:
            each.close()


def test_slow_bodies_make_room_as_well(server) -> None:
    opened = [server.connect(POST + LONG_BODY) for _ in range(2 * CONNECTIONS)]
    try:
        begun = time.monotonic()
        assert httpx.get(f"{server.url}/healthz").status_code == 200
        assert time.monotonic() - begun < WAITING / 4
    finally:
        for each in opened:
            each.close()


def test_more_work_than_there_are_connections(server) -> None:
    """Nobody waits who could make room: those who come last are refused."""
    listening = b"GET /events HTTP/1.1\r\nhost: localhost\r\n\r\n"
    opened = [server.connect(listening) for _ in range(CONNECTIONS)]
    try:
        for each in opened:
            assert each.recv(12) == b"HTTP/1.1 200"
        answer = server.ask(b"")
        assert answer.startswith(b"HTTP/1.1 503")
        assert b"retry-after" in answer
    finally:
        for each in opened:
            each.close()
    time.sleep(0.2)


def test_requests_one_after_the_other_on_one_connection(server) -> None:
    paths = ["/healthz", ROUTE, "/nowhere", "/clock", ROUTE]
    head = "".join(f"GET {path} HTTP/1.1\r\nhost: localhost\r\n\r\n" for path in paths)
    answers = server.ask(head.encode())
    assert re.findall(rb"HTTP/1\.1 (\d+)", answers) == [b"200", b"200", b"404", b"200", b"200"]


def test_many_requests_at_once_on_one_connection(server) -> None:
    answers = server.ask(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n" * 5000)
    assert answers.count(b"HTTP/1.1 200") < 5000


# What is no request


@pytest.mark.parametrize(
    "sent",
    [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(200),  # TLS
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"hello\r\n\r\n",
        b"GET  HTTP/1.1\r\n\r\n",
        b"GET /\xff\xfe HTTP/1.1\r\nhost: localhost\r\n\r\n",
        b"GET /healthz HTTP/9.9\r\nhost: localhost\r\n\r\n",
        b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nx\x00y: z\r\n\r\n",
        b"POST /counts HTTP/1.1\r\nhost: localhost\r\ncontent-length: -1\r\n\r\n",
        b"POST /counts HTTP/1.1\r\nhost: localhost\r\ncontent-length: 1" + b"0" * 30 + b"\r\n\r\n",
        b"POST /counts HTTP/1.1\r\nhost: localhost\r\ncontent-length: 3\r\ntransfer-encoding: chunked\r\n\r\n0\r\n\r\n",
        b"POST /counts HTTP/1.1\r\nhost: localhost\r\ntransfer-encoding: chunked\r\n\r\nxyz\r\n",
    ],
)
def test_what_is_no_request(server, sent: bytes) -> None:
    answer = server.ask(sent)
    assert answer == b"" or (answer.startswith(b"HTTP/1.1 4") and b"content-security-policy" in answer)


@pytest.mark.parametrize(
    ("first", "status"),
    [
        (b"OPTIONS * HTTP/1.1", 404),
        (b"TRACE /healthz HTTP/1.1", 405),
        (b"CONNECT localhost:1 HTTP/1.1", 404),
        (b"GET http://evil.example/healthz HTTP/1.1", 200),  # what proxies are asked; only the path counts
        (b"GET /healthz HTTP/1.1\r\nupgrade: websocket\r\nconnection: upgrade", 200),
        (b"GET /healthz HTTP/1.1\r\nupgrade: h2c\r\nconnection: upgrade", 200),
        (b"GET /healthz HTTP/1.1\r\nx-http-method-override: DELETE", 200),
        (b"GET /healthz HTTP/1.0", 200),
        (b"GET /%00%ff/%2e%2e/etc/passwd HTTP/1.1", 404),
    ],
)
def test_requests_of_other_kinds(server, first: bytes, status: int) -> None:
    answer = server.ask(first + b"\r\nhost: localhost\r\n\r\n")
    assert answer.startswith(b"HTTP/1.1 %d" % status) or (status == 404 and answer.startswith(b"HTTP/1.1 400"))
    assert b"etc/passwd" not in answer


def test_bodies_that_are_cut_off(server) -> None:
    server.connect(POST + LONG_BODY + b"{").close()


def test_the_log_has_no_places(server) -> None:
    """Nor names of walks, keys, or what was searched for."""
    walk = "f" * 32
    for path in (
        ROUTE,
        "/route/v1/foot/24.9414,60.1719;24.948,60.166",
        f"/walks/{walk}",
        "/search?q=secretlane",
        "/24.9414",
    ):
        httpx.get(f"{server.url}{path}")
    httpx.put(f"{server.url}/clock", content="24.9414", headers={"authorization": "Bearer secretkey"})
    httpx.post(
        f"{server.url}/walks", json={"origin": [24.9414, 60.17], "destination": [24.95, 60.17], "planner": "x:y"}
    )
    server.ask(b"GET /24.9414 HTTP/1.1\r\nnonsense\r\n\r\n")
    log = server.log.read_text()
    assert "GET /route/v1/{profile}/{coordinates:path} 200" in log
    for secret in ("24.94", "0.0001", walk, "secret"):
        assert secret not in log


# How it stops


def test_requests_under_way_end_when_it_stops(start) -> None:
    server = start()
    answers: list[httpx.Response] = []
    asking = threading.Thread(target=lambda: answers.append(httpx.get(f"{server.url}{LONG}", timeout=60)))
    listening = server.connect(b"GET /events HTTP/1.1\r\nhost: localhost\r\n\r\n")
    asking.start()
    time.sleep(0.3)
    assert server.stop() == 0
    asking.join()
    assert [each.status_code for each in answers] == [200]
    assert read_all(listening).startswith(b"HTTP/1.1 200")
    listening.close()
    log = server.log.read_text()
    assert "Traceback" not in log
    assert "ERROR" not in log


def test_ctrl_c(start) -> None:
    server = start("--logs", "json")
    httpx.get(f"{server.url}{ROUTE}")
    assert server.stop(signal.SIGINT) == 0
    lines = server.log.read_text().splitlines()
    assert not any("Traceback" in line for line in lines)
    assert not any("\\u001b" in line for line in lines)  # colours of a terminal
    logged = [json.loads(line) for line in lines]
    assert [each["address"] for each in logged if "address" in each] == [f"{server.url}/"]
    assert {"method": "GET", "route": "/route/v1/{profile}/{coordinates:path}", "status": 200}.items() <= next(
        each for each in logged if each.get("route", "").startswith("/route")
    ).items()


def test_workers(start, tmp_path: Path) -> None:
    server = start("--workers", "2", "--rate", "100000", TMPDIR=str(tmp_path), **{KEY_VARIABLE: "0123456789abcdef"})
    workers = workers_of(server)
    assert len(workers) == 2
    with contextlib.ExitStack() as stack:  # connections that come at once are spread over the processes
        asked = [stack.enter_context(httpx.Client(base_url=server.url)) for _ in range(CONNECTIONS)]
        assert [each.get(ROUTE).status_code for each in asked] == [200] * CONNECTIONS
        taken = [connections(server, each) for each in workers]
    assert min(taken) >= 4
    metrics = httpx.get(f"{server.url}/metrics").text
    (told,) = re.findall(r'sidestep_requests_total\{.*coordinates.*status="200"\} (\S+)', metrics)
    assert float(told) == CONNECTIONS
    assert httpx.put(f"{server.url}/clock", json={"now": "2026-01-01T00:00:00"}).status_code == 401
    os.kill(workers[1], signal.SIGSTOP)  # it hangs: nothing tells whether it would ever go on
    while b"State:\tT" not in Path(f"/proc/{workers[1]}/status").read_bytes():
        time.sleep(0.01)
    time.sleep(1)  # by now the first process waits for its answer
    os.killpg(server.process.pid, signal.SIGINT)  # a terminal tells all of them
    assert server.process.wait(30) == 0
    assert not any(Path(f"/proc/{each}").exists() for each in workers)
    assert not list(tmp_path.glob("sidestep-metrics-*"))
    assert "Traceback" not in server.log.read_text()
    assert "sidestep:" not in server.log.read_text()  # what is said of errors


# How it does not start


@pytest.fixture
def refused(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, small_town) -> Callable[..., str]:
    """Start a server in this process that refuses to: its sentence."""
    monkeypatch.delenv(KEY_VARIABLE, raising=False)

    def run(*options: str, scenario: str = str(small_town)) -> str:
        assert cli.run(["serve", scenario, *options]) == cli.BAD_INPUT
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert said.startswith("sidestep: ")
        return said

    return run


@pytest.mark.parametrize(
    "options",
    [
        ["--port", "-1"],
        ["--port", "65536"],
        ["--rate", "0"],
        ["--rate", "nan"],
        ["--rate", "inf"],
        ["--workers", "0"],
        ["--workers", "65"],
        ["--cors", "*"],
        ["--cors", "https://map.example/"],
        ["--cors", "map.example"],
        ["--name", "http://walks.example"],
        ["--name", "walks.example:80"],
        ["--proxy", "*"],
        ["--proxy", "proxy.example"],
        ["--proxy", "10.1.0.1/16"],
        ["--logs", "xml"],
        ["--host", "256.256.256.256"],
        ["--host", "a..b"],
        ["--host", "x" * 300],
        ["--host", ""],
        ["--api-key-file", "nowhere"],
        ["--api-key", "0123456789abcdef"],  # never on the command line
    ],
)
def test_options_that_no_server_has(refused, options: list[str]) -> None:
    refused(*options)


@pytest.mark.parametrize("scenario", ["nowhere", "rush-16", "paper-congested", "missing.toml"])
def test_scenarios_that_cannot_be_served(refused, scenario: str) -> None:
    refused(scenario=scenario)


def test_ports_in_use(refused) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert "port" in refused("--port", str(taken.getsockname()[1]))


def test_ports_are_kept_while_a_server_starts() -> None:
    with run._listen("127.0.0.1", 0) as first:
        port = first.getsockname()[1]
        with pytest.raises(SidestepError) as raised:
            run._listen("127.0.0.1", port)
        assert raised.value.field == "port"
    with run._reserved("127.0.0.1", port), pytest.raises(SidestepError):  # its processes do not listen yet
        run._listen("127.0.0.1", port)


def test_short_keys(refused, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(KEY_VARIABLE, "short")
    refused()
    (tmp_path / "key").write_text("secret")
    assert "secret" not in refused("--api-key-file", str(tmp_path / "key"))


@pytest.mark.parametrize("package", ["fastapi", "uvicorn", "httptools", "sqlalchemy", "prometheus_client", "polyline"])
def test_packages_that_are_missing(package: str) -> None:
    code = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "from sidestep.cli.app import run\nsys.exit(run(['serve', 'helsinki']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == cli.BAD_INPUT
    assert done.stderr.count("\n") == 1
    assert "sidestep[serve]" in done.stderr


def test_json_logs_say_why_a_server_does_not_start(small_town) -> None:
    """In a process of its own, whose logs are set up for good."""
    command = [sys.executable, "-m", "sidestep", "serve", str(small_town), "--logs", "json", "--port", "0"]
    done = subprocess.run([*command, "--store", "mysql://a/b"], capture_output=True, text=True)
    (line,) = done.stderr.splitlines()
    said = json.loads(line)
    assert (done.returncode, said["levelname"], said["field"]) == (cli.BAD_INPUT, "ERROR", "store")


@pytest.mark.parametrize("workers", ["1", "2"])
def test_stores_and_models_that_are_none(refused, workers: str, tmp_path: Path) -> None:
    (tmp_path / "text.db").write_text("no database " * 1000)
    for options in (["--store", str(tmp_path / "text.db")], ["--store", "mysql://a/b"], ["--model", str(tmp_path)]):
        refused(*options, "--workers", workers, "--port", "0")
