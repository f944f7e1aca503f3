"""Processes killed while they store counts: nothing that they acknowledged is missing, and the store goes on."""

import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

import pytest

from sidestep.crowds.live import LiveCount

BEGIN = datetime.fromisoformat("2025-05-24T00:00Z")
MINUTES = 50
# Two threads put counts of sensors of their own, each with a number that grows; what returned is said in one write.
WRITER = """
import itertools, os, sys, threading
from datetime import UTC, datetime, timedelta
from sidestep.crowds.live import LiveCount
from sidestep.server.store import Store

url, begin, minutes, first = sys.argv[1], datetime.fromisoformat(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
store = Store(url)

def write(sensor):
    for number in itertools.count(first):
        begins = [begin + timedelta(minutes=(number * 7 + each) % minutes) for each in range(1 + number % 4)]
        store.put_counts([LiveCount(sensor, each, 60.0, float(number)) for each in begins], datetime.now(UTC))
        os.write(1, "".join(f"{sensor} {each.isoformat()} {number}\\n" for each in begins).encode())

for sensor in ("bridge", "quay"):
    threading.Thread(target=write, args=(sensor,)).start()
"""


def kill_writers(database, kills: int, rng: random.Random, crash: Callable[[], None] = lambda: None) -> int:
    """Start a writer and kill it, again and again; returns how many counts were acknowledged."""
    acknowledged: dict[tuple[str, datetime], float] = {}
    total, first = 0, 1
    for _ in range(kills):
        command = [sys.executable, "-c", WRITER, database.url, BEGIN.isoformat(), str(MINUTES), str(first)]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            said = process.stdout.readline()  # it has begun
            pause = rng.choice([0.0, rng.uniform(0, 0.02), rng.uniform(0, 0.5)])
            time.sleep(pause)
            crash()
            process.kill()
            said += process.stdout.read()
        lines = [line.split() for line in said.decode().splitlines(keepends=True) if line.endswith("\n")]
        assert lines
        for sensor, begins, number in lines:
            key = sensor, datetime.fromisoformat(begins)
            acknowledged[key] = max(acknowledged.get(key, 0.0), float(number))
        total += len(lines)
        store = database.open()
        stored = {(count.sensor, count.begins): count.persons for count in store.counts_since(BEGIN)}
        # What was stored but not yet acknowledged is later, and at most one post of each sensor.
        lost = {key: (number, stored.get(key)) for key, number in acknowledged.items() if stored.get(key, 0.0) < number}
        assert not lost, f"killed {pause:.4f} s after the first: {lost}"
        later = [key for key, number in stored.items() if number > acknowledged.get(key, 0.0)]
        assert len(later) <= 2 * 4
        acknowledged |= stored
        first = int(max(stored.values())) + 1
        # The next writer waits for nobody.
        began = time.monotonic()
        told = store.put_counts([LiveCount("fountain", BEGIN + timedelta(minutes=first), 60.0, 1.0)], datetime.now(UTC))
        assert told == ["new"]
        assert time.monotonic() - began < 3
        acknowledged["fountain", BEGIN + timedelta(minutes=first)] = 1.0
        store.close()
    return total


def test_nothing_acknowledged_is_lost(database) -> None:
    assert kill_writers(database, 5, random.Random(7)) >= 5


@pytest.mark.stress
def test_nothing_acknowledged_is_lost_in_a_hundred_kills(database, request, capsys) -> None:
    rng = random.Random(request.config.getoption("--hypothesis-seed", None))
    total = kill_writers(database, 100, rng)
    with capsys.disabled():
        print(f"\n{database.kind}: 100 kills, {total:,} counts acknowledged, none lost")


@pytest.mark.stress
def test_nothing_acknowledged_is_lost_when_the_database_is_killed(database, request) -> None:
    """PostgreSQL itself stops at once, without writing anything, and recovers what it said was on the disk."""
    if database.kind == "sqlite":
        pytest.skip("SQLite is in the process that is killed above")
    cluster = request.getfixturevalue("postgresql")

    def crash() -> None:
        cluster.stop(signal.SIGQUIT)
        cluster.start()

    assert kill_writers(database, 20, random.Random(7), crash) >= 20
