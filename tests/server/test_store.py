"""The store, in SQLite and PostgreSQL: what was put is there, whole, and told apart from what was there before."""

import json
import os
import queue
import re
import resource
import sqlite3
import stat
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import psycopg
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sidestep.crowds.live import LiveCount
from sidestep.server.store import LONGEST_WALK, Store, StoreError

NOON = datetime.fromisoformat("2025-05-24T12:00Z")
NOW = datetime.now(UTC)
PATIENCE = 60  # s
GOOD = LiveCount("Mannerheimintie 13 a, länsi", NOON, 900.0, 30.0, 10.5, 19.5)


def minute(number: int, persons: float = 1.0, sensor: str = "bridge") -> LiveCount:
    return LiveCount(sensor, NOON + timedelta(minutes=number), 60.0, persons)


# --- Counts ---------------------------------------------------------------------------------------------------------


def test_what_was_put_is_there_after_a_restart(database) -> None:
    exact = replace(
        GOOD, sensor="quay", begins=NOON + timedelta(microseconds=1), persons=1 / 3, towards=None, away=None
    )
    first = database.open()
    assert first.counts_since(NOON) == []
    assert first.put_counts([exact, GOOD], NOW) == ["new", "new"]
    first.close()
    second = database.open()
    assert second.counts_since(NOON) == [GOOD, exact]
    assert second.counts_since(NOON + timedelta(microseconds=1)) == [exact]
    assert second.put_counts([], NOW) == []


@pytest.mark.parametrize(
    "changed",
    [{"persons": 31.0}, {"seconds": 600.0}, {"towards": 11.5, "away": 18.5}, {"towards": None, "away": None}],
)
def test_corrections(store: Store, changed: dict) -> None:
    corrected = replace(GOOD, **changed)
    assert store.put_counts([GOOD], NOW) == ["new"]
    assert store.put_counts([GOOD, minute(1)], NOW) == ["unchanged", "new"]
    assert store.put_counts([corrected, minute(1)], NOW) == ["corrected", "unchanged"]
    assert store.put_counts([corrected], NOW) == ["unchanged"]
    assert store.counts_since(NOON) == [corrected, minute(1)]


def test_several_for_one_begin(store: Store) -> None:
    several = [GOOD, GOOD, replace(GOOD, persons=31.0), minute(1), replace(GOOD, persons=32.0)]
    assert store.put_counts(several, NOW) == ["new", "unchanged", "corrected", "new", "corrected"]
    back = [replace(GOOD, persons=33.0), replace(GOOD, persons=32.0)]
    assert store.put_counts(back, NOW) == ["corrected", "corrected"]
    assert store.counts_since(NOON) == [replace(GOOD, persons=32.0), minute(1)]


def test_many_at_once(store: Store) -> None:
    many = [minute(number, number, sensor) for number in range(2500) for sensor in ("bridge", "quay")]
    assert store.put_counts(many, NOW) == ["new"] * 5000
    changed = [replace(each, persons=each.persons + (each.begins.minute == 7)) for each in many]
    assert store.put_counts(changed, NOW) == ["corrected" if each.begins.minute == 7 else "unchanged" for each in many]
    assert store.counts_since(NOON) == changed


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
@given(
    st.lists(st.lists(st.tuples(st.integers(0, 3), st.sampled_from("ab"), st.integers(0, 2)), max_size=6), max_size=6)
)
def test_the_last_received_stands(store: Store, posts: list[list[tuple[int, str, int]]]) -> None:
    with store._transaction(writes=True) as connection:
        connection.exec_driver_sql("DELETE FROM sidestep_counts")
    known: dict[tuple[str, datetime], LiveCount] = {}
    for post in posts:
        counts = [minute(number, persons, sensor) for number, sensor, persons in post]
        expected = []
        for count in counts:
            old = known.get((count.sensor, count.begins))
            expected.append("new" if old is None else "unchanged" if old == count else "corrected")
            known[count.sensor, count.begins] = count
        assert store.put_counts(counts, NOW) == expected
    assert store.counts_since(NOON) == sorted(known.values(), key=lambda count: (count.begins, count.sensor))


def test_writers_at_once_are_told_apart(database) -> None:
    stores = [database.open() for _ in range(3)]
    together = threading.Barrier(6)

    def put(number: int) -> list[str]:
        together.wait()
        store, told = stores[number % 3], list[str]()
        for each in range(20):
            told += store.put_counts([minute(each, number % 2), minute(100 + number)], NOW)
        return told

    with ThreadPoolExecutor(6) as threads:
        told = list(threads.map(put, range(6)))
    assert [each[1::2] for each in told] == [["new"] + ["unchanged"] * 19] * 6
    shared = [each[::2] for each in told]
    for number in range(20):
        assert [each[number] for each in shared].count("new") == 1
    # Every correction changed what somebody else had put: the last value has the parity of the corrections.
    final = {count.begins: count.persons for count in stores[0].counts_since(NOON)}
    for number in range(20):
        first = next(writer % 2 for writer in range(6) if shared[writer][number] == "new")
        corrections = [each[number] for each in shared].count("corrected")
        assert final[minute(number).begins] == (first + corrections) % 2


def test_counts_are_kept_for_a_bounded_time(database) -> None:
    store = database.open(kept=timedelta(days=2))
    store.put_counts([minute(1)], NOW - timedelta(days=2, seconds=1))
    store.put_counts([minute(2)], NOW - timedelta(days=2))
    store.put_counts([minute(3, 5)], NOW - timedelta(days=3))
    assert store.put_counts([minute(3, 6)], NOW) == ["corrected"]
    assert store.forget(NOW) == 1
    assert store.counts_since(NOON) == [minute(2), minute(3, 6)]
    assert store.forget(NOW) == 0


# --- Changes --------------------------------------------------------------------------------------------------------


def test_other_processes_see_what_changed(database) -> None:
    here, there = database.open(), database.open()
    seen = {there.version()}
    assert there.version() in seen

    def changed() -> bool:
        new = there.version() not in seen
        seen.add(there.version())
        assert there.version() == here.version()
        return new

    here.put_counts([GOOD], NOW)
    assert changed()
    here.put_counts([GOOD], NOW)
    here.put_walk("w", {}, NOW + timedelta(minutes=1))
    here.delete_walk("w")
    here.forget(NOW)
    assert not changed()
    there.put_counts([replace(GOOD, persons=31.0)], NOW)
    assert changed()
    here.set_clock(NOON, NOW, 60.0)
    assert changed()
    here.clear_clock()
    assert changed()


def test_who_watches_is_told(database) -> None:
    """Of all that changes the version and of nothing else; by a file of what its own process stores."""
    here, there, told = database.open(), database.open(), queue.SimpleQueue[str]()
    here.watch(lambda: told.put("here"))
    there.watch(lambda: told.put("there"))
    notices = database.kind == "postgresql"
    if notices:
        assert {told.get(timeout=PATIENCE) for _ in range(2)} == {"here", "there"}  # what came before they listened
    for number in range(10):
        changes = [
            lambda: here.set_clock(NOON, NOW, 60.0),
            here.clear_clock,
            lambda number=number: here.put_counts([minute(0, number)], NOW),
        ]
        changes[number % 3]()
        here.put_counts([], NOW)
        here.put_walk("w", {"at": number}, NOW + timedelta(minutes=1))
        here.forget(NOW)
        # Here it is told of its own doing, and of the notice.
        assert sorted(told.get(timeout=PATIENCE) for _ in range(3 if notices else 1)) == (
            ["here", "here", "there"] if notices else ["here"]
        )
    assert here.put_counts([minute(0, 8)], NOW) == ["unchanged"]
    if notices:
        with there._transaction(writes=True) as connection:
            connection.exec_driver_sql("SELECT pg_notify('sidestep_changes', '')")
        assert {told.get(timeout=PATIENCE) for _ in range(2)} == {"here", "there"}
    assert told.empty()


def test_notices_of_a_database_that_was_away(postgresql) -> None:
    """What was stored meanwhile is told as soon as somebody listens again."""
    here, told = Store(postgresql.new_database()), queue.SimpleQueue[None]()
    here.watch(lambda: told.put(None))
    told.get(timeout=PATIENCE)
    postgresql.stop()
    postgresql.start()
    told.get(timeout=PATIENCE)
    other = Store(str(here._engine.url.render_as_string(hide_password=False)))
    other.put_counts([GOOD], NOW)
    told.get(timeout=PATIENCE)
    other.close()
    here.close()
    assert told.empty()
    assert not [each for each in threading.enumerate() if each.name == "notices"]


def test_the_clock(database) -> None:
    here, there = database.open(), database.open()
    assert there.clock() is None
    here.set_clock(NOON, NOW, 60.0)
    here.set_clock(NOON + timedelta(hours=1), NOW, 1.5)
    assert there.clock() == (NOON + timedelta(hours=1), NOW, 1.5)
    assert there.clock()[0].tzinfo is UTC
    there.clear_clock()
    assert here.clock() is None


# --- Walks ----------------------------------------------------------------------------------------------------------


def test_walks(database) -> None:
    here, there = database.open(), database.open()
    state = {"at": [24.94, 60.17], "path": [1, 2], "why": "täältä \ud800 \0", "left": None, "seconds": 1e-9}
    assert there.get_walk("a" * 32, NOW) is None
    here.put_walk("a" * 32, {}, NOW + timedelta(minutes=5))
    there.put_walk("a" * 32, state, NOW + timedelta(minutes=10))
    here.put_walk("b" * 32, {}, NOW + timedelta(minutes=10))
    assert here.get_walk("a" * 32, NOW) == state
    assert here.delete_walk("a" * 32)
    assert not there.delete_walk("a" * 32)
    assert there.get_walk("a" * 32, NOW) is None
    assert there.get_walk("b" * 32, NOW) == {}


def test_walks_expire(store: Store) -> None:
    store.put_walk("short", {}, NOW + timedelta(minutes=1))
    store.put_walk("long", {}, NOW + timedelta(days=1))
    assert store.get_walk("short", NOW + timedelta(seconds=59)) == {}
    assert store.get_walk("short", NOW + timedelta(seconds=60)) is None
    hour = datetime.now(UTC) + LONGEST_WALK
    assert store.get_walk("long", hour - timedelta(minutes=1)) == {}
    assert store.get_walk("long", hour) is None
    assert store.forget(NOW + timedelta(seconds=60)) == 1
    assert store.forget(hour) == 1
    assert store.forget(hour) == 0


def test_nothing_is_left_of_a_walk(tmp_path: Path) -> None:
    store = Store(f"sqlite:///{tmp_path / 'town.db'}")
    secret = {"at": "24.9414,60.1719"}
    for number in range(100):
        store.put_walk(f"w{number}", secret, NOW + timedelta(minutes=1))

    def left() -> bool:
        return any(b"24.9414" in file.read_bytes() for file in tmp_path.iterdir())

    assert left()
    assert store.forget(NOW + timedelta(minutes=1)) == 100
    assert not left()
    store.close()


# --- Files ----------------------------------------------------------------------------------------------------------


def test_only_its_user_may_read_the_file(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        store = Store(f"sqlite:///{tmp_path / 'town.db'}")
        store.put_counts([GOOD], NOW)
    finally:
        os.umask(before)
    modes = {file.name: stat.S_IMODE(file.stat().st_mode) for file in tmp_path.iterdir()}
    assert modes == dict.fromkeys(("town.db", "town.db-wal", "town.db-shm"), 0o600)
    store.close()


def test_commits_wait_for_the_disk(database) -> None:
    store = database.open()
    with store._transaction(writes=True) as connection:
        if database.kind == "sqlite":
            settings = [
                connection.exec_driver_sql(f"PRAGMA {name}").scalar() for name in ("journal_mode", "synchronous")
            ]
            assert settings == ["wal", 2]  # FULL
        else:
            assert connection.exec_driver_sql("SHOW synchronous_commit").scalar() == "on"


def test_a_lazy_server_is_made_to_wait_for_the_disk(postgresql) -> None:
    url = postgresql.new_database()
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f"ALTER DATABASE {url.rsplit('/', 1)[1]} SET synchronous_commit = off")
    store = Store(url)
    with store._transaction() as connection:
        assert connection.exec_driver_sql("SHOW synchronous_commit").scalar() == "on"
    store.close()


@pytest.mark.parametrize(
    "url",
    [
        "",
        "town.db",
        "sqlite://",
        "sqlite:///:memory:",
        "sqlite:///town.db?mode=ro",
        "mysql://me:secret@host/town",
        "postgresql+asyncpg://me:secret@host/town",
        "postgresql://me:secret@host:port/town",
        "postgresql://me:secret@127.0.0.1:1/town",
        "sqlite:////no/such/folder/town.db",
        "sqlite:////dev/null/town.db",
        "sqlite:////tmp",
        "sqlite:///a\0b",
    ],
)
def test_stores_that_are_none(url: str) -> None:
    with pytest.raises(StoreError) as caught:
        Store(url)
    assert (caught.value.field, caught.value.failure) == ("store", "unusable")
    assert "\n" not in str(caught.value)
    assert "secret" not in str(caught.value)


def test_files_that_are_no_stores(tmp_path: Path) -> None:
    (tmp_path / "counts.csv").write_text("time,bridge\n" * 1000)
    with pytest.raises(StoreError, match="not a database") as caught:
        Store(f"sqlite:///{tmp_path / 'counts.csv'}")
    assert caught.value.failure == "unusable"
    assert (tmp_path / "counts.csv").read_text() == "time,bridge\n" * 1000


def test_a_store_of_a_later_version(database) -> None:
    store = database.open()
    with store._transaction(writes=True) as connection:
        connection.exec_driver_sql("UPDATE sidestep_state SET schema = 2")
    with pytest.raises(StoreError, match="version 2") as caught:
        Store(database.url)
    assert caught.value.failure == "unusable"


def test_processes_may_start_at_once(database) -> None:
    with ThreadPoolExecutor(8) as threads:
        stores = list(threads.map(lambda _: database.open(), range(8)))
    assert [store.put_counts([GOOD], NOW) for store in stores] == [["new"]] + [["unchanged"]] * 7


# --- Faults ---------------------------------------------------------------------------------------------------------


def failing(store: Store, failure: str) -> None:
    """Nothing works, and the sentences have nothing in them that is not for strangers."""
    tries = [store.ping, store.version, store.clock]
    tries += [lambda: store.counts_since(NOON), lambda: store.put_counts([minute(9)], NOW)]
    tries += [lambda: store.get_walk("w", NOW), lambda: store.put_walk("w", {}, NOW), lambda: store.forget(NOW)]
    for attempt in tries:
        with pytest.raises(StoreError) as caught:
            attempt()
        assert (caught.value.field, caught.value.failure) == ("store", failure)
        assert not re.search(r"/|\n|127|sidestep|SELECT", str(caught.value))


def test_a_database_that_is_gone_and_comes_back(database) -> None:
    store = database.open()
    store.put_counts([GOOD], NOW)
    store.put_walk("w", {"at": 1}, NOW + timedelta(minutes=5))
    before = store.version()
    database.go()
    try:
        failing(store, "unreachable")
    finally:
        database.come_back()
    assert store.counts_since(NOON) == [GOOD]
    assert store.version() == before
    assert store.put_counts([GOOD, minute(9)], NOW) == ["unchanged", "new"]
    assert store.get_walk("w", NOW) == {"at": 1}
    assert store.version() != before


def test_another_file_in_its_place(tmp_path: Path) -> None:
    file, backup = tmp_path / "town.db", tmp_path / "backup.db"
    store = Store(f"sqlite:///{file}")
    store.put_counts([GOOD], NOW)
    before = store.version()
    other = Store(f"sqlite:///{backup}")
    other.put_counts([minute(7)], NOW)
    other.close()
    for ending in ("", "-wal", "-shm"):
        (tmp_path / f"town.db{ending}").unlink()
    failing(store, "unreachable")
    backup.rename(file)
    assert store.counts_since(NOON) == [minute(7)]
    assert store.version() != before
    assert store.put_counts([GOOD], NOW) == ["new"]
    store.close()
    again = Store(f"sqlite:///{file}")
    assert again.counts_since(NOON) == [GOOD, minute(7)]
    again.close()


def test_a_full_disk(database) -> None:
    store = database.open()
    store.put_counts([GOOD], NOW)
    many = [minute(number) for number in range(5000)]
    if database.kind == "sqlite":
        with store._transaction() as connection:
            pages = connection.exec_driver_sql("PRAGMA page_count").scalar()
        # The connection that was given back is the next to be taken.
        with store._engine.connect() as connection:
            connection.exec_driver_sql(f"PRAGMA max_page_count = {pages + 3}")
    else:
        trigger = "CREATE TRIGGER t AFTER INSERT ON sidestep_counts EXECUTE FUNCTION full_disk()"
        with store._transaction(writes=True) as connection:
            connection.exec_driver_sql(
                "CREATE FUNCTION full_disk() RETURNS trigger LANGUAGE plpgsql AS "
                "$$ BEGIN RAISE EXCEPTION USING ERRCODE = 'disk_full'; END $$"
            )
            connection.exec_driver_sql(trigger)
    with pytest.raises(StoreError) as caught:
        store.put_counts(many, NOW)
    assert caught.value.failure == "full"
    assert store.counts_since(NOON) == [GOOD]
    if database.kind == "sqlite":
        with store._engine.connect() as connection:
            connection.exec_driver_sql("PRAGMA max_page_count = 1000000")
    else:
        with store._transaction(writes=True) as connection:
            connection.exec_driver_sql("DROP TRIGGER t ON sidestep_counts")
    assert set(store.put_counts(many[1:], NOW)) == {"new"}


def test_a_file_that_may_not_grow(tmp_path: Path) -> None:
    store = Store(f"sqlite:///{tmp_path / 'town.db'}")
    store.put_counts([GOOD], NOW)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, ((tmp_path / "town.db-wal").stat().st_size + 8192, limits[1]))
    try:
        with pytest.raises(StoreError) as caught:
            store.put_counts([minute(number) for number in range(5000)], NOW)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert caught.value.failure in ("full", "unreachable")
    assert store.counts_since(NOON) == [GOOD]
    assert store.put_counts([GOOD, minute(1)], NOW) == ["unchanged", "new"]
    store.close()


def test_a_writer_that_never_ends(database, monkeypatch) -> None:
    monkeypatch.setattr("sidestep.server.store._BUSY", 0.2)
    here, there = database.open(), database.open()
    with there._transaction(writes=True) as connection:
        connection.exec_driver_sql("UPDATE sidestep_state SET changes = changes")
        begun = time.monotonic()
        with pytest.raises(StoreError) as caught:
            here.put_counts([GOOD], NOW)
        assert caught.value.failure == "busy"
        assert time.monotonic() - begun < 3
        assert here.counts_since(NOON) == []  # readers go on
        here.version()
    assert here.put_counts([GOOD], NOW) == ["new"]


def test_a_damaged_file(tmp_path: Path) -> None:
    file = tmp_path / "town.db"
    store = Store(f"sqlite:///{file}")
    store.put_counts([minute(number) for number in range(3000)], NOW)
    store.close()
    with file.open("r+b") as opened:
        opened.seek(4096)
        opened.write(b"\xff" * 40_000)
    with pytest.raises(StoreError):
        Store(f"sqlite:///{file}").counts_since(NOON)


def test_what_is_stored_is_plain(tmp_path: Path) -> None:
    """Other programs may read it: documented names, times in microseconds since 1970, JSON."""
    store = Store(f"sqlite:///{tmp_path / 'town.db'}")
    store.put_counts([GOOD], NOW)
    store.put_walk("w", {"at": [1, 2]}, NOW + timedelta(minutes=1))
    store.close()
    connection = sqlite3.connect(tmp_path / "town.db")
    row = connection.execute("SELECT sensor, begins, seconds, persons, towards, away FROM sidestep_counts").fetchone()
    assert row == (GOOD.sensor, 1_748_088_000_000_000, 900, 30, 10.5, 19.5)
    assert json.loads(connection.execute("SELECT state FROM sidestep_walks").fetchone()[0]) == {"at": [1, 2]}
    connection.close()
