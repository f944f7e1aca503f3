"""Servers of a town with sensors: events, a model, a full disk, and several whose database goes and comes back."""

import contextlib
import itertools
import json
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest

from sidestep.agent.presets import preset
from sidestep.agent.runs import train
from sidestep.cli import app as cli
from sidestep.crowds.live import LiveCount
from sidestep.scenarios.reader import find_scenario
from sidestep.server.store import Store

from .conftest import USUAL, at
from .processes import Server, connections, interruptible, workers_of

MANY = 40_000.0  # persons/h
NOON, MIDNIGHT = "2024-06-01T12:00:00", datetime.fromisoformat("2024-06-01T00:00Z")
WALK = {"origin": at(0, 0), "destination": at(300, 0), "planner": "expected"}
ROUTE = f"/route/v1/foot/0,0;{at(300, 0)[0]},0?steps=true"
LISTENERS, HEARTBEAT = 4, 0.3  # s
PATIENCE = 60  # s
EAGER = f"""
from fastapi import routing
from sidestep.server import bus
from sidestep.cli.app import main
routing._PING_INTERVAL, bus.MOST_LISTENERS = {HEARTBEAT}, {LISTENERS}
main()
"""

NOTICES = """
from sidestep.server import store
from sidestep.cli.app import main
store.ASKING = 3600
main()
"""
"""A program that asks PostgreSQL only when it has told something."""


class Listener:
    """Who listens on a connection of its own."""

    def __init__(self, server: Server, path: str) -> None:
        self._client = httpx.Client(base_url=server.url, timeout=PATIENCE)
        self.answer = self._client.send(self._client.build_request("GET", path), stream=True)
        self.lines = self.answer.iter_lines()

    def next(self, kind: str) -> dict[str, Any]:
        """What the next event says, which must be of a kind."""
        until = time.monotonic() + PATIENCE
        for line in self.lines:
            if line.startswith("event: "):
                assert line == f"event: {kind}"
                return json.loads(next(self.lines).removeprefix("data: "))
            assert time.monotonic() < until
        raise AssertionError

    def close(self) -> None:
        self.answer.close()
        self._client.close()


@pytest.fixture
def listen() -> Iterator[Callable[..., Listener]]:
    with contextlib.ExitStack() as stack:

        def run(server: Server, path: str) -> Listener:
            return stack.enter_context(contextlib.closing(Listener(server, path)))

        yield run


@pytest.fixture(scope="module")
def server(start, live_town: Path, tmp_path_factory: pytest.TempPathFactory) -> Server:
    """With a model, at noon on a Saturday."""
    model = tmp_path_factory.mktemp("model") / "model"
    tiny = preset("default", "map").changed(rounds=1, round_steps=64, walkers=8, batch=16, capacity=64, hidden=(4,))
    tiny = tiny.changed(places=0, test_walks=2, futures=2, fresh_futures=0)  # without places it walks to anywhere
    train(find_scenario(str(live_town)), tiny, out=model)
    running = start("--model", str(model), "--rate", "1e6", program=("-c", EAGER), scenario=live_town)
    set_clock(running)
    return running


def set_clock(server: Server) -> None:
    assert server.request("PUT", "/clock", json={"now": NOON, "speed": 0.001}).status_code == 200


def post(server: Server, count: float) -> httpx.Response:
    row = {"sensor": "long", "time": "2024-06-01T11:00:00", "count": count}
    return server.request("POST", "/counts", json=row)


def post_twice(server: Server, count: float) -> None:
    """Post a count that is new or corrected, and at the same time once more, as who got no answer in time would."""
    with ThreadPoolExecutor() as threads:
        answers = list(threads.map(lambda _: post(server, count).json(), range(2)))
    assert sorted(each["unchanged"] for each in answers) == [0, 1]


def check_without_store(server: Server, path: str) -> None:
    """Routes go on by the crowds that were known; the rest is refused, by all processes."""
    for _ in range(8):
        answer = post(server, MANY)
        assert (answer.status_code, answer.json()["field"]) == (503, "store")
        assert server.request("GET", path).status_code == 503
        route = server.request("GET", ROUTE).json()
        assert streets({"route": route["routes"][0]}) == ["Gate", "Long Street", "Quay"]
        assert server.request("GET", "/readyz").json()["field"] == "store"
        assert server.request("GET", "/healthz").status_code == 200


def ask(server: Server, method: str, path: str, **more: object) -> dict[str, Any]:
    """Ask again while a busy computer compiles for longer than the server lets anybody wait."""
    until = time.monotonic() + 5 * PATIENCE
    while (answer := server.request(method, path, **more)).status_code == 503:
        assert time.monotonic() < until
    assert answer.is_success, answer.text
    return answer.json()


def begin(server: Server, **more: object) -> dict[str, Any]:
    return ask(server, "POST", "/walks", json=WALK | more)


def streets(said: dict[str, Any]) -> list[str]:
    return [step["name"] for step in said["route"]["legs"][0]["steps"][:-1]]


def until(said: Callable[[], object], seconds: float) -> None:
    """Wait until something is true."""
    begun = time.monotonic()
    while not said():
        assert time.monotonic() - begun < seconds
        time.sleep(0.02)


def test_counts_change_a_plan(server, listen) -> None:
    walk = begin(server)
    assert streets(walk) == ["Gate", "Long Street", "Quay"]
    listener = listen(server, f"/walks/{walk['id']}/events")
    assert listener.answer.headers["content-type"].startswith("text/event-stream")
    assert post(server, MANY).json()["accepted"] == 1
    begun = time.monotonic()
    said = listener.next("plan")
    print(f"the plan changed {time.monotonic() - begun:.2f} s after the count")
    assert (said["id"], streets(said), said["changed"]) == (walk["id"], ["Gate", "Back Road", "Quay"], True)
    assert server.request("GET", f"/walks/{walk['id']}").json() == said
    post(server, USUAL)
    assert streets(listener.next("plan")) == ["Gate", "Long Street", "Quay"]


def test_counts_change_a_plan_before_somebody_listens(server, listen) -> None:
    walk = begin(server)
    crowds = listen(server, "/events")
    post(server, MANY)
    crowds.next("crowds")
    listener = listen(server, f"/walks/{walk['id']}/events")
    assert streets(listener.next("plan")) == ["Gate", "Back Road", "Quay"]
    post(server, USUAL)
    assert streets(listener.next("plan")) == ["Gate", "Long Street", "Quay"]


def test_nothing_happens(server, listen) -> None:
    """Every now and then the server says that it is there."""
    listener = listen(server, "/events")
    begun = time.monotonic()
    assert len(list(itertools.islice((line for line in listener.lines if line.startswith(":")), 3))) == 3
    assert 2 * HEARTBEAT < time.monotonic() - begun < 20 * HEARTBEAT


def test_listeners_that_go_make_room(server, listen) -> None:
    walk = f"/walks/{begin(server)['id']}/events"
    listening = [listen(server, path) for path in ("/events", walk) for _ in range(LISTENERS // 2)]
    assert [each.answer.status_code for each in listening] == [200] * LISTENERS
    for path in ("/events", walk):
        refused = listen(server, path).answer
        assert refused.status_code == 503
        assert refused.headers["retry-after"]
    for number, path in enumerate(("/events", walk)):
        listening[number].close()
        until(lambda path=path: listen(server, path).answer.status_code == 200, 5)


def test_a_model_walks(server) -> None:
    assert "darp" in server.request("GET", "/town").json()["planners"]
    answer = ask(server, "GET", f"{ROUTE}&planner=darp")
    assert (answer["code"], answer["routes"][0]["planner"]) == ("Ok", "darp")
    said, reports = begin(server, planner=None), 0
    assert said["route"]["planner"] == "darp"
    while not said["arrived"]:
        reports += 1
        assert reports < 20
        position = {"location": said["next"]["ends"], "density": 0.2}
        said = ask(server, "POST", f"/walks/{said['id']}/position", json=position)
        assert not said["left_route"]
    assert reports >= 2


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_replay_that_is_stopped(server, number: signal.Signals, tmp_path: Path) -> None:
    """It says at once what it does; then the clock is the computer's again."""
    (tmp_path / "day.csv").write_text("time,long\n2024-06-01T12:00,111\n2024-06-01T13:00,222\n")
    command = [sys.executable, "-m", "sidestep", "replay", str(tmp_path / "day.csv"), "--url", server.url]
    assert server.request("DELETE", "/clock").status_code == 200
    with interruptible():
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert "12:00" in process.stdout.readline()
        until(lambda: server.request("GET", "/clock").json()["simulated"], PATIENCE)
        process.send_signal(number)
        said = process.communicate(timeout=PATIENCE)[1]
    finally:
        process.kill()
    assert (process.returncode, said.count("\n")) == (cli.INTERRUPTED, 1)
    assert not server.request("GET", "/clock").json()["simulated"]
    set_clock(server)


def test_a_full_disk(server) -> None:
    """No file of the server may grow: counts are refused, routes go on, and nothing is lost."""
    store, taken = server.log.with_name("store.db"), {}

    def put(minute: int, rows: int = 1) -> int:
        begins = [MIDNIGHT + timedelta(minutes=minute + each) for each in range(rows)]
        counts = [LiveCount("quay", each, 60.0, float(minute)) for each in begins]
        body = [{"sensor": "quay", "time": each.isoformat(), "seconds": 60, "count": minute} for each in begins]
        answer = server.request("POST", "/counts", json=body)
        if answer.status_code == 200:
            taken.update((count.begins, count) for count in counts)
        else:
            assert answer.json()["field"] == "store"
            assert answer.headers["retry-after"]
        return answer.status_code

    # JAX would leave half of every program that is compiled on a full disk, for other tests to read.
    server.wait_until(lambda said: said["prepared"])
    assert put(0) == 200
    assert server.request("POST", "/walks", json=WALK).status_code == 201
    assert server.request("GET", ROUTE).json()["code"] == "Ok"
    limits = resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE)
    most = max(each.stat().st_size for each in store.parent.iterdir())
    resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, (most + 2**14, limits[1]))
    try:
        assert put(100, 500) == 503
        # The log of what was written may first be used again from its beginning.
        assert 503 in map(put, range(700, 1400))
        assert server.request("GET", ROUTE).json()["code"] == "Ok"
        assert server.request("POST", "/walks", json=WALK).status_code == 503
        assert server.request("GET", "/sensors").status_code == 200
    finally:
        resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, limits)
    assert put(60, 500) == 200
    assert put(41) == 200
    assert server.request("POST", "/walks", json=WALK).status_code == 201
    reader = Store(f"sqlite:///{store}")
    stored = {count.begins: count for count in reader.counts_since(min(taken)) if count.sensor == "quay"}
    reader.close()
    assert stored == taken
    assert "Traceback" not in server.log.read_text()


def test_servers_share_counts_and_walks(start, live_town: Path, database, listen) -> None:
    """The workers of one, and another on what might be another machine; also while their database is away."""
    server = start("--workers", "2", "--store", database.url, scenario=live_town)
    workers = workers_of(server)
    servers = [server]
    if database.kind == "postgresql":
        servers.append(start("--store", database.url, scenario=live_town, program=("-c", NOTICES)))
    set_clock(server)
    for each in servers:
        for _ in range(20):  # on connections of their own
            until(lambda each=each: httpx.get(f"{each.url}/clock").json()["simulated"], PATIENCE)
    walk = begin(server)
    path = f"/walks/{walk['id']}"
    listening = [listen(servers[-1], f"{path}/events")]
    while not all(connections(server, each) for each in workers):
        listening.append(listen(server, f"{path}/events"))
    for count, way, poster in ((MANY, "Back Road", servers[0]), (USUAL, "Long Street", servers[-1])):
        post_twice(poster, count)
        for each in listening:
            assert streets(each.next("plan")) == ["Gate", way, "Quay"]
    # Whichever takes it, a report is of the same walk, and the latest crowds.
    for metres in range(2, 20, 2):
        moment = datetime.fromisoformat(NOON) + timedelta(seconds=metres)
        position = {"location": at(metres, 0), "time": moment.isoformat()}
        said = servers[metres // 2 % len(servers)].request("POST", f"{path}/position", json=position).json()
        assert said["route"]["distance"] == pytest.approx(300 - metres, abs=1)
        assert server.request("GET", path).json() == said
    database.go()
    try:
        check_without_store(server, path)
    finally:
        database.come_back()
    assert server.request("GET", "/readyz").json()["status"] == "ready"
    assert post(server, MANY).json()["corrected"] == 1
    for each in listening:
        assert streets(each.next("plan"))[1] == "Back Road"
    begun = time.monotonic()
    assert server.stop() == 0
    assert time.monotonic() - begun < 5
    assert all(each.stop() == 0 for each in servers[1:])
    assert not any(Path(f"/proc/{each}").exists() for each in workers)
    for each in listening:
        assert not [line for line in each.lines if line and not line.startswith(":")]
    assert "Traceback" not in server.log.read_text()
