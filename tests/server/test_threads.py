"""What the threads of a server share: many use it at once, and find what one alone finds."""

import asyncio
import random
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from sidestep.crowds.live import LiveCount, LiveCounts
from sidestep.routing import street_times
from sidestep.routing.router import Router
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.reader import find_scenario
from sidestep.server import variants
from sidestep.server.desk import CLIENT, Desk
from sidestep.server.problems import ProblemError
from sidestep.server.variants import Variants

T = TypeVar("T")
THREADS = 8
NOON = datetime.fromisoformat("2024-06-01T12:00")
HOURS = [NOON + timedelta(hours=number) for number in range(5)]
WALKERS = ["older", "older,free_speed=0.9", "older,free_speed=0.8"]
OTHER_END = 3  # of the town, by two ways


@pytest.fixture(scope="module")
def scenario(live_town: Path) -> Scenario:
    return find_scenario(str(live_town))


@pytest.fixture
def router(scenario: Scenario) -> Router:
    return Router(scenario)


@pytest.fixture(autouse=True)
def restless() -> Iterator[None]:
    """Threads take turns often, or few of them would meet."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


def at_once(work: Callable[[int], T]) -> list[T]:
    """Begin work in many threads at the same time, each with its number; what each returns."""
    together = threading.Barrier(THREADS)

    def begin(number: int) -> T:
        together.wait()
        return work(number)

    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(begin, range(THREADS)))


def walk(router: Router, departure: datetime = NOON) -> tuple[float, float]:
    """Seconds and metres from one end of the town to the other."""
    seconds, metres = router.quick.matrix([0], [OTHER_END], router.clock(departure))
    return seconds.item(), metres.item()


@pytest.mark.parametrize("kept", [2**28, 0])
def test_tables(router: Router, scenario: Scenario, monkeypatch: pytest.MonkeyPatch, kept: int) -> None:
    """Where there is room each is worked out once; without room some are forgotten while others are read."""
    alone = Router(scenario)
    expected = {departure: alone.quick.tables.at(alone.clock(departure)) for departure in HOURS}
    made, work_out = [], street_times.street_times
    monkeypatch.setattr(street_times, "KEPT", kept)
    monkeypatch.setattr(street_times, "street_times", lambda *asked: made.append(asked) or work_out(*asked))

    def ask(number: int) -> None:
        for departure in random.Random(number).choices(HOURS, k=12):
            table, clock = router.quick.tables.at(router.clock(departure))
            assert clock == expected[departure][1]
            np.testing.assert_array_equal(table.seconds, expected[departure][0].seconds)
            np.testing.assert_array_equal(table.density, expected[departure][0].density)

    at_once(ask)
    assert len(made) == len(HOURS) if kept else len(made) > len(HOURS)


def test_counts_that_come_while_routes_are_planned(router: Router) -> None:
    """A route goes by the crowds before, or those after, and never by some of each."""

    def count(*persons: float) -> None:
        begins = NOON.replace(tzinfo=UTC) - timedelta(hours=1)
        counts = zip(("long", "quay"), persons, strict=True)
        live = tuple(LiveCount(sensor, begins, 3600.0, number) for sensor, number in counts)
        router.go_on_from(LiveCounts(live, "UTC"), NOON)

    states = (40_000.0, 10_000.0), (100.0, 20_000.0)
    expected = {walk(router)}
    for persons in states:
        count(*persons)
        expected.add(walk(router))
    assert len(expected) == 3  # also without counts
    expected.remove(walk(Router(router.scenario)))
    ended = threading.Event()

    def ask(number: int) -> set[tuple[float, float]]:
        found = set()
        if number == 0:
            for persons in states * 6:
                count(*persons)
            ended.set()
        while not ended.is_set():
            found.add(walk(router))
        return found

    assert set().union(*at_once(ask)) == expected


def test_walkers(router: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer are kept than there are."""
    monkeypatch.setattr(variants, "MOST_VARIANTS", 2)
    alone, begun = Variants(router, id), Counter[int]()
    expected = {walker: walk(alone.router(walker, None)) for walker in WALKERS}
    assert len(set(expected.values())) == len(WALKERS)
    shared = Variants(router, lambda other: begun.update([id(other)]))

    def ask(number: int) -> None:
        for walker in random.Random(number).sample(WALKERS, k=len(WALKERS)):
            found = shared.router(walker, None)
            assert begun[id(found)]
            assert walk(found) == expected[walker]
            assert len(list(shared)) <= 1 + variants.MOST_VARIANTS

    at_once(ask)


def test_a_walker_is_made_once(router: Router) -> None:
    shared = Variants(router, id)
    assert len(set(map(id, at_once(lambda _: shared.router("older", None))))) == 1


def test_desks() -> None:
    """Questions of many clients, of which some fail and some are refused: no more at once than threads, all counted."""
    desk, rng, working, most, lock = Desk(4, 40, 6, 30), random.Random(7), set[int](), [], threading.Lock()

    def work(number: int) -> int:
        with lock:
            working.add(number)
            most.append(len(working))
        time.sleep(rng.random() / 500)
        with lock:
            working.remove(number)
        if number % 7 == 0:
            raise KeyError(number)
        return number

    async def ask(number: int) -> object:
        CLIENT.set(str(number % 10))
        try:
            return await desk.answer(lambda: work(number))
        except KeyError as error:
            return error.args[0]
        except ProblemError as problem:
            return problem.status

    async def all_of_them() -> list[object]:
        found: list[object] = []
        for first in range(1000, 1600, 60):
            found += await asyncio.gather(*map(ask, range(first, first + 60)))
            assert not desk._clients
        return found

    found = asyncio.run(all_of_them())
    desk.close()
    assert all(said in (number, 503) for number, said in enumerate(found, 1000))
    assert found.count(503) == 10 * (60 - 40)
    assert max(most) <= 4
