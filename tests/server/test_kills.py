"""The whole server killed while counts are posted: nothing that it acknowledged is missing when it is back."""

import random
import signal
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from threading import Event

import httpx
import pytest

from .processes import Server

CONNECTIONS, MINUTES = 4, 50
BEGIN = datetime.now(UTC).replace(second=0, microsecond=0) - timedelta(days=1)
Values = dict[tuple[str, datetime], float]


@dataclass
class Counter:
    """Posts counts of its own minutes on one connection, one to four at a time, each post with a larger number."""

    sensor: str
    begin: datetime
    acknowledged: Values = field(default_factory=dict)
    sent: Values = field(default_factory=dict)
    """What was not answered: it may be stored, but only as a whole."""
    number: int = 0

    def post(self, server: Server, begun: Event, refusals: set[int]) -> int:
        """Post until the server is gone; returns how many counts were acknowledged."""
        total = 0
        with httpx.Client(base_url=server.url, timeout=60) as client:
            while True:
                self.number += 1
                minutes = [(self.number * 7 + each) % MINUTES for each in range(1 + self.number % 4)]
                begins = [self.begin + timedelta(minutes=each) for each in minutes]
                self.sent = {(self.sensor, each): self.number / 100 for each in begins}
                rows = [
                    {"sensor": self.sensor, "time": each.isoformat(), "seconds": 60, "count": self.number / 100}
                    for each in begins
                ]
                try:
                    while (answer := client.post("/counts", json=rows)).status_code in refusals:
                        time.sleep(0.01)
                except httpx.TransportError:
                    return total
                assert (answer.status_code, answer.json()["accepted"]) == (200, len(rows)), answer.text
                self.acknowledged |= self.sent
                total += len(rows)
                begun.set()

    def check(self, stored: Values) -> None:
        """Compare with what is stored."""
        mine = {key: value for key, value in stored.items() if key[0] == self.sensor and key[1] in self}
        assert mine in (self.acknowledged, self.acknowledged | self.sent)
        self.acknowledged = mine

    def __contains__(self, time: datetime) -> bool:
        return self.begin <= time < self.begin + timedelta(minutes=MINUTES)


def kill_servers(
    database,
    start: Callable[..., Server],
    town: Path,
    kills: int,
    rng: random.Random,
    crash: Callable[[], object] | None = None,
) -> int:
    """Start a server, post and kill it, again and again; returns how many counts were acknowledged."""
    counters = [
        Counter(sensor, BEGIN + timedelta(hours=hour))
        for hour in range(CONNECTIONS // 2)
        for sensor in ("long", "quay")
    ]
    total, refusals = 0, {503} if crash else set()
    for kill in range(kills + 1):
        server = start("--store", database.url, "--rate", "1e6", scenario=town)
        store = database.open()
        stored = {(count.sensor, count.begins): count.persons for count in store.counts_since(BEGIN)}
        store.close()
        for counter in counters:
            counter.check(stored)
        if kill == kills:
            return total
        begun = Event()
        with ThreadPoolExecutor(CONNECTIONS) as threads:
            posting = [threads.submit(counter.post, server, begun, refusals) for counter in counters]
            assert begun.wait(30)  # it waits for nobody who was killed
            time.sleep(rng.choice([0.0, rng.uniform(0, 0.02), rng.uniform(0, 0.5)]))
            if crash:
                crash()
            server.kill()
        total += sum(each.result() for each in posting)
        assert "Traceback" not in server.log.read_text()
    raise AssertionError


def test_nothing_acknowledged_is_lost(database, start, live_town: Path) -> None:
    assert kill_servers(database, start, live_town, 5, random.Random(7)) >= 5


@pytest.mark.stress
def test_nothing_acknowledged_is_lost_in_a_hundred_kills(database, start, live_town: Path, request, capsys) -> None:
    rng = random.Random(request.config.getoption("--hypothesis-seed", None))
    total = kill_servers(database, start, live_town, 100, rng)
    with capsys.disabled():
        print(f"\n{database.kind}: 100 kills, {total:,} counts acknowledged, none lost")


@pytest.mark.stress
def test_nothing_acknowledged_is_lost_when_the_database_is_killed(database, start, live_town: Path, request) -> None:
    """PostgreSQL itself stops at once, without writing anything, and recovers what it said was on the disk."""
    if database.kind == "sqlite":
        pytest.skip("SQLite is in the process that is killed above")
    cluster = request.getfixturevalue("postgresql")

    def crash() -> None:
        cluster.stop(signal.SIGQUIT)
        cluster.start()

    assert kill_servers(database, start, live_town, 20, random.Random(7), crash) >= 20
