"""What a server must not forget: live counts, walks under way, and the clock; in SQLite or PostgreSQL.

It stores, and decides nothing. All processes of a server share one store. Methods may be called from any thread. While
the database cannot be reached they raise `StoreError`, and once it is back they work again.
"""

import json
import os
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from threading import Lock
from typing import Any, Literal

from sqlalchemy import (
    BigInteger,
    Column,
    Connection,
    Double,
    Engine,
    Integer,
    MetaData,
    QueuePool,
    String,
    Table,
    Text,
    bindparam,
    create_engine,
    delete,
    event,
    func,
    insert,
    select,
    tuple_,
    update,
)
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as NoConnectionError

from sidestep.crowds.live import LiveCount
from sidestep.errors import SidestepError
from sidestep.files import OutputError, check_above, reason
from sidestep.server.notices import Listener, give_notice

Stored = Literal["new", "unchanged", "corrected"]
Failure = Literal["unreachable", "full", "busy", "unusable"]

SCHEMA = 1
"""Version of the tables; a store of a later one is refused."""
LONGEST_WALK = timedelta(hours=1)
"""A walk is kept for this long at most."""
KEPT = timedelta(days=14)
"""How long counts are kept after they were received."""

LOOKING = 0.25
"""Seconds after which a file is looked at again: it tells nobody when others write to it."""
ASKING = 1.0
"""Seconds after which PostgreSQL is asked again, whose notices may be lost: with a connection, or in a pool of them."""

_BUSY = 5.0  # seconds to wait for another writer, or for a connection
_AT_ONCE = 400  # keys in one query; SQLite takes 999 values in all
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_LOCK = 0x51DE57E9  # of PostgreSQL, while tables are made

_tables = MetaData()
_counts = Table(
    "sidestep_counts",
    _tables,
    Column("sensor", Text, primary_key=True),
    Column("begins", BigInteger, primary_key=True),  # times are microseconds since 1970
    Column("seconds", Double, nullable=False),
    Column("persons", Double, nullable=False),
    Column("towards", Double),
    Column("away", Double),
    Column("received", BigInteger, nullable=False, index=True),
    sqlite_with_rowid=False,
)
_VALUE = ("seconds", "persons", "towards", "away")
_walks = Table(
    "sidestep_walks",
    _tables,
    Column("id", String(64), primary_key=True),
    Column("state", Text, nullable=False),
    Column("expires", BigInteger, nullable=False, index=True),
)
# Tables of one row, which is number 0.
_clock = Table(
    "sidestep_clock",
    _tables,
    Column("row", Integer, primary_key=True, autoincrement=False),
    Column("now", BigInteger, nullable=False),
    Column("since", BigInteger, nullable=False),
    Column("speed", Double, nullable=False),
)
_state = Table(
    "sidestep_state",
    _tables,
    Column("row", Integer, primary_key=True, autoincrement=False),
    Column("schema", Integer, nullable=False),
    Column("changes", BigInteger, nullable=False),  # of counts and the clock
)


class StoreError(SidestepError):
    """A store that does not take or give anything at the moment, or that cannot be used at all.

    Parameters
    ----------
    message
        One sentence, without anything that strangers should not read unless ``failure`` is ``unusable``.
    failure
        ``unreachable``, ``full`` or ``busy``: it may pass; ``unusable``: it will not.
    """

    def __init__(self, message: str, *, failure: Failure = "unreachable") -> None:
        super().__init__(message, field="store")
        self.failure = failure


class Store:
    """Counts, walks and the clock in a database, which is made where it is missing.

    Every method raises a StoreError where the database cannot be reached, is busy or full; nothing is then stored.

    Parameters
    ----------
    url
        ``sqlite:///FILE``, or ``postgresql://USER:PASSWORD@HOST/DATABASE``.
    kept
        How long counts are kept after they were received.

    Raises
    ------
    StoreError
        A database that cannot be reached, or used.
    """

    def __init__(self, url: str, *, kept: timedelta = KEPT) -> None:
        self._kept = kept
        where = _parsed(url)
        self._file = _File(where) if where.get_backend_name() == "sqlite" else None
        self._engine = _postgresql(where) if self._file is None else self._file.engine()
        self._watching = Lock()
        self._seen, self._number = -1, 0
        self._tell: Callable[[], object] = _nobody
        self._listener: Listener | None = None
        named = where.render_as_string(hide_password=True)
        try:
            _prepare(self._engine)
        except (SQLAlchemyError, sqlite3.Error, OSError) as error:
            self.close()
            raise StoreError(f"cannot use the store {named}: {_said(error)}", failure="unusable") from error
        except StoreError as error:
            self.close()
            raise StoreError(f"cannot use the store {named}: {error}", failure="unusable") from error

    def put_counts(self, counts: Sequence[LiveCount], received: datetime) -> list[Stored]:
        """Store counts, all or none; they are on the disk when this returns.

        Parameters
        ----------
        counts
            Of several for one sensor and begin the last stands.
        received
            Now, by the clock of the computer.

        Returns
        -------
        list
            What each of them was. Where there is a StoreError instead, nothing is stored; or everything, if the
            connection broke at the last moment: counts may be put again.
        """
        if not counts:
            return []
        rows = [_row_of(count) for count in counts]
        with self._transaction(writes=True) as connection:
            connection.execute(select(_state.c.changes).with_for_update()).one()  # one writer at a time
            before = _stored(connection, list(dict.fromkeys(map(_key, rows))))
            known, done = dict(before), list[Stored]()
            for row in rows:
                old, new = known.get(_key(row)), _value(row)
                done.append("new" if old is None else "unchanged" if old == new else "corrected")
                known[_key(row)] = new
            last = {_key(row): row | {"received": _number(received)} for row in rows}
            fresh = [row for key, row in last.items() if key not in before]
            other = [row for key, row in last.items() if key in before and before[key] != _value(row)]
            if fresh:
                connection.execute(insert(_counts), fresh)
            if other:
                # Names of parameters must not be those of columns.
                renamed = [{**row, "of_sensor": row["sensor"], "from": row["begins"]} for row in other]
                mine = (_counts.c.sensor == bindparam("of_sensor")) & (_counts.c.begins == bindparam("from"))
                changed: dict[str, Any] = {name: bindparam(name) for name in (*_VALUE, "received")}
                connection.execute(update(_counts).where(mine).values(changed), renamed)
            if fresh or other:
                _count_change(connection)
        if fresh or other:
            self._tell()
        return done

    def counts_since(self, begins: datetime) -> list[LiveCount]:
        """The counts of intervals that began then or later, in the order of their begins."""
        return self.counts_between(begins, None)

    def counts_between(self, begins: datetime, end: datetime | None) -> list[LiveCount]:
        """The counts of intervals that began from one time on, and before another if there is one; in this order."""
        wanted = select(_counts).where(_counts.c.begins >= _number(begins)).order_by(_counts.c.begins, _counts.c.sensor)
        if end is not None:
            wanted = wanted.where(_counts.c.begins < _number(end))
        with self._transaction() as connection:
            return [_count_of(row) for row in connection.execute(wanted).mappings()]

    def version(self) -> int:
        """A number that changes whenever a process stores new or corrected counts, or sets the clock; quickly told."""
        if self._file is None:
            return self._changes()
        with self._watching:
            self._check_file()
            with _failing():
                seen = self._file.data_version()
            if seen != self._seen:
                self._number = self._changes() + (self._file.replaced << 40)
                self._seen = seen
            return self._number

    def watch(self, tell: Callable[[], object]) -> float:
        """Call something as soon as :meth:`version` may have changed: here or, if the database tells, in any process.

        Parameters
        ----------
        tell
            Is called in other threads, until the store is closed; also when nothing has changed.

        Returns
        -------
        float
            Seconds after which to look at the version although nothing was told.
        """
        self._tell = tell
        if self._file is not None:
            return LOOKING
        self._listener = Listener(self._engine, tell)
        return ASKING

    def put_walk(self, id: str, state: dict[str, Any], expires: datetime) -> None:  # noqa: A002 - that of a walk
        """Store a walk, or what has become of it.

        Parameters
        ----------
        id, state
            Its name, and all about it that JSON can say.
        expires
            By the clock of the computer; at most an hour from now counts.
        """
        until = min(expires, datetime.now(UTC) + LONGEST_WALK)
        row = {"state": json.dumps(state), "expires": _number(until)}
        with self._transaction(writes=True) as connection:
            if not connection.execute(update(_walks).where(_walks.c.id == id).values(row)).rowcount:
                connection.execute(insert(_walks).values(id=id, **row))

    def change_walk(
        self,
        id: str,  # noqa: A002 - that of a walk
        before: dict[str, Any],
        state: dict[str, Any],
        expires: datetime,
    ) -> bool:
        """Store what has become of a walk, unless it was changed or deleted meanwhile.

        Parameters
        ----------
        id, before
            Its name, and what :meth:`get_walk` said of it.
        state, expires
            As for :meth:`put_walk`.

        Returns
        -------
        bool
            Whether it was stored.
        """
        until = min(expires, datetime.now(UTC) + LONGEST_WALK)
        mine = (_walks.c.id == id) & (_walks.c.state == json.dumps(before))
        row = {"state": json.dumps(state), "expires": _number(until)}
        with self._transaction(writes=True) as connection:
            return connection.execute(update(_walks).where(mine).values(row)).rowcount > 0

    def get_walk(self, id: str, now: datetime) -> dict[str, Any] | None:  # noqa: A002 - that of a walk
        """What was stored of a walk; None where it is not there, or has expired by the clock of the computer."""
        wanted = select(_walks.c.state).where(_walks.c.id == id, _walks.c.expires > _number(now))
        with self._transaction() as connection:
            found = connection.execute(wanted).scalar_one_or_none()
        return None if found is None else json.loads(found)

    def delete_walk(self, id: str) -> bool:  # noqa: A002 - that of a walk
        """Forget a walk, and say whether it was there."""
        with self._transaction(writes=True) as connection:
            return connection.execute(delete(_walks).where(_walks.c.id == id)).rowcount > 0

    def walks(self) -> int:
        """How many walks are kept."""
        with self._transaction() as connection:
            return int(connection.execute(select(func.count()).select_from(_walks)).scalar_one())

    def forget(self, now: datetime) -> int:
        """Delete walks that have expired, and counts that were received too long ago.

        Parameters
        ----------
        now
            By the clock of the computer.

        Returns
        -------
        int
            How many there were.
        """
        with self._transaction(writes=True) as connection:
            gone = connection.execute(delete(_walks).where(_walks.c.expires <= _number(now))).rowcount
            gone += connection.execute(delete(_counts).where(_counts.c.received < _number(now - self._kept))).rowcount
        if self._file is not None:
            with self._watching, suppress(sqlite3.Error):  # where others are reading, the next time will do
                self._file.empty_log()
        return gone

    def clock(self) -> tuple[datetime, datetime, float] | None:
        """The simulated time, the time of the computer at which that was set, and how many times as fast it goes."""
        with self._transaction() as connection:
            found = connection.execute(select(_clock)).mappings().one_or_none()
        return None if found is None else (_time(found["now"]), _time(found["since"]), float(found["speed"]))

    def set_clock(self, now: datetime, since: datetime, speed: float) -> None:
        """Simulate a time.

        Parameters
        ----------
        now
            The simulated time.
        since
            The time of the computer.
        speed
            How many times as fast it goes.
        """
        row = {"row": 0, "now": _number(now), "since": _number(since), "speed": speed}
        with self._transaction(writes=True) as connection:
            _count_change(connection)  # first, so that no other process writes the row
            connection.execute(delete(_clock))
            connection.execute(insert(_clock).values(row))
        self._tell()

    def clear_clock(self) -> None:
        """Go by the clock of the computer again."""
        with self._transaction(writes=True) as connection:
            _count_change(connection)
            connection.execute(delete(_clock))
        self._tell()

    def ping(self) -> None:
        """Do nothing if the store can be read."""
        self._changes()

    def close(self) -> None:
        """Give back the connections, and tell nobody any more."""
        self._tell = _nobody
        if self._listener is not None:
            self._listener.close()
        self._engine.dispose()
        if self._file is not None:
            self._file.close()

    def _changes(self) -> int:
        with self._transaction() as connection:
            return int(connection.execute(select(_state.c.changes)).scalar_one())

    @contextmanager
    def _transaction(self, *, writes: bool = False) -> Iterator[Connection]:
        """A transaction, which is on the disk at the end; whatever the database says becomes a StoreError."""
        self._check_file()
        with _failing(), self._engine.connect() as connection:
            connection.execution_options(sidestep_writes=writes)
            with connection.begin():
                yield connection

    def _check_file(self) -> None:
        """Refuse to go on in a file that was deleted, which the system would allow; take another in its place."""
        if self._file is None:
            return
        try:
            if not self._file.is_another():
                return
        except OSError as error:
            self._engine.dispose()
            raise StoreError("the file of the store is gone; put it back, or start again") from error
        self._engine.dispose()
        with _failing():
            _prepare(self._engine)
        self._file.take()
        self._seen = -1


class _File:
    """A file of SQLite, and a connection of its own that tells when others have written to it."""

    def __init__(self, where: URL) -> None:
        if not where.database or where.database == ":memory:" or "\0" in where.database or where.query:
            said = "must name a file, as in sqlite:////var/lib/sidestep/store.db, and no options"
            raise StoreError(f"the store {said}", failure="unusable")
        self._path = Path(where.database).expanduser().absolute()
        try:
            check_above(self._path, "store")
            _make(self._path)
        except OutputError as error:
            raise StoreError(str(error), failure="unusable") from error
        except OSError as error:
            raise StoreError(f"cannot make the store {self._path}: {reason(error)}", failure="unusable") from error
        self._watch: sqlite3.Connection | None = None
        self._is = self._found()
        self.replaced = 0

    def engine(self) -> Engine:
        made = create_engine(
            "sqlite://", creator=self._open, poolclass=QueuePool, pool_timeout=_BUSY, pool_pre_ping=True
        )

        @event.listens_for(made, "begin")
        def begin(connection: Connection) -> None:
            # A writer waits for others before it reads; otherwise it may find that it read what has changed since.
            writes = connection.get_execution_options().get("sidestep_writes")
            connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

        return made

    def is_another(self) -> bool:
        """Whether another file has taken its place; OSError where there is none."""
        return self._found() != self._is

    def take(self) -> None:
        """Take the file that is there now."""
        self.close()
        self._is = self._found()
        self.replaced += 1

    def data_version(self) -> int:
        """A number that changes when anything is written to the file."""
        return int(self._watcher().execute("PRAGMA data_version").fetchone()[0])

    def empty_log(self) -> None:
        """Leave nothing of what was deleted in the write-ahead log."""
        self._watcher().execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    def close(self) -> None:
        if self._watch is not None:
            self._watch.close()
            self._watch = None

    def _watcher(self) -> sqlite3.Connection:
        if self._watch is None:
            self._watch = self._open()
        return self._watch

    def _found(self) -> tuple[int, int]:
        found = self._path.stat()
        return found.st_dev, found.st_ino

    def _open(self) -> sqlite3.Connection:
        # rw: a file that is gone is not made anew, empty.
        address = f"{self._path.as_uri()}?mode=rw"
        opened = sqlite3.connect(address, uri=True, timeout=_BUSY, isolation_level=None, check_same_thread=False)
        try:
            _with_patience(lambda: opened.execute("PRAGMA journal_mode=WAL").fetchall())
            # FULL: a commit waits for the disk. What is deleted is overwritten.
            for setting in ("synchronous=FULL", "secure_delete=ON", "journal_size_limit=16777216"):
                opened.execute(f"PRAGMA {setting}").fetchall()
        except BaseException:
            opened.close()
            raise
        return opened


def _make(path: Path) -> None:
    """Make an empty file that only its user may read, where there is none."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600))
    except FileExistsError:
        return
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _with_patience(action: Callable[[], object]) -> None:
    """Try again while others write: SQLite does not wait when it changes how it writes."""
    until = time.monotonic() + _BUSY
    while True:
        try:
            action()
        except sqlite3.OperationalError as error:
            if "locked" not in str(error) or time.monotonic() > until:
                raise
            time.sleep(0.02)
        else:
            return


def _parsed(url: str) -> URL:
    """The parts of an address, which may have a password in it and is not repeated."""
    must = "the store must be sqlite:///FILE or postgresql://USER@HOST/DATABASE"
    try:
        where = make_url(url)
    except (ArgumentError, ValueError) as error:
        raise StoreError(must, failure="unusable") from error
    if where.drivername in ("postgresql", "postgres", "postgresql+psycopg"):
        return where.set(drivername="postgresql+psycopg")
    if where.drivername in ("sqlite", "sqlite+pysqlite"):
        return where
    raise StoreError(f"{must}, not {where.drivername!r:.40}", failure="unusable")


def _postgresql(where: URL) -> Engine:
    said = where.query.get("options", "")
    options = f"{said if isinstance(said, str) else ' '.join(said)} -c statement_timeout=10s -c lock_timeout={_BUSY:g}s"
    patience = {"connect_timeout": 5, "keepalives_idle": 10, "keepalives_interval": 5, "tcp_user_timeout": 10_000}
    # Prepared statements do not outlive a transaction in pools such as PgBouncer's.
    arguments = {"application_name": "sidestep", "prepare_threshold": None, **patience, "options": options.strip()}
    try:
        made = create_engine(where, pool_pre_ping=True, pool_timeout=_BUSY, connect_args=arguments)
    except ImportError as error:
        said = "stores in PostgreSQL need psycopg: pip install 'sidestep[postgresql]'"
        raise StoreError(said, failure="unusable") from error

    @event.listens_for(made, "connect")
    def wait_for_the_disk(connection: Any, _record: object) -> None:
        connection.autocommit = True
        with connection.cursor() as cursor:
            setting = "synchronous_commit"
            cursor.execute(f"SELECT set_config('{setting}', 'on', false) WHERE current_setting('{setting}') = 'off'")
        connection.autocommit = False

    return made


def _prepare(engine: Engine) -> None:
    """Make the tables where they are missing, and refuse those of a later version."""
    with engine.connect() as connection:
        connection.execution_options(sidestep_writes=True)
        with connection.begin():
            if engine.dialect.name == "postgresql":
                connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_LOCK})")
            _tables.create_all(connection)
            found = connection.execute(select(_state.c.schema)).scalar_one_or_none()
            if found is None:
                connection.execute(insert(_state).values(row=0, schema=SCHEMA, changes=0))
            elif found != SCHEMA:
                newer = f"its tables are of version {found}, this sidestep knows {SCHEMA}; update it, or use another"
                raise StoreError(newer, failure="unusable")


def _count_change(connection: Connection) -> None:
    connection.execute(update(_state).values(changes=_state.c.changes + 1))
    give_notice(connection)


def _nobody() -> None:
    """What is called where nobody watches the store."""


_Key = tuple[str, int]
_Value = tuple[float | None, ...]


def _stored(connection: Connection, keys: Sequence[_Key]) -> dict[_Key, _Value]:
    """What is stored of some counts."""
    found: dict[_Key, _Value] = {}
    for first in range(0, len(keys), _AT_ONCE):
        some = tuple_(_counts.c.sensor, _counts.c.begins).in_(keys[first : first + _AT_ONCE])
        found |= {_key(row): _value(row) for row in connection.execute(select(_counts).where(some)).mappings()}
    return found


def _row_of(count: LiveCount) -> dict[str, Any]:
    value = {name: getattr(count, name) for name in _VALUE}
    floats = {name: None if number is None else float(number) for name, number in value.items()}
    return {"sensor": count.sensor, "begins": _number(count.begins), **floats}


def _count_of(row: Mapping[Any, Any]) -> LiveCount:
    return LiveCount(row["sensor"], _time(row["begins"]), *(row[name] for name in _VALUE))


def _key(row: Mapping[Any, Any]) -> _Key:
    return row["sensor"], row["begins"]


def _value(row: Mapping[Any, Any]) -> _Value:
    return tuple(row[name] for name in _VALUE)


def _number(moment: datetime) -> int:
    return (moment - _EPOCH) // _MICROSECOND


def _time(number: int) -> datetime:
    return _EPOCH + number * _MICROSECOND


def _said(error: Exception) -> str:
    """What a database or the system says, in one line."""
    if isinstance(error, OSError):
        return reason(error)
    said = str(error.orig if isinstance(error, DBAPIError) else error)
    return " ".join(said.split())[:300]


@contextmanager
def _failing() -> Iterator[None]:
    """Whatever the database or the system says becomes a StoreError, which has it as its cause, for the log."""
    try:
        yield
    except (SQLAlchemyError, sqlite3.Error, OSError) as error:
        raise _failure(error) from error


def _failure(error: Exception) -> StoreError:
    """What to tell people when the database fails."""
    cause = error.orig if isinstance(error, DBAPIError) else error
    code = str(getattr(cause, "sqlite_errorname", None) or getattr(cause, "sqlstate", None) or "")
    if code in {"SQLITE_FULL", "53100"}:
        return StoreError("the disk of the store is full, so nothing was stored; try again later", failure="full")
    busy = code.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")) or code in ("55P03", "57014", "53300", "40P01", "40001")
    if busy or isinstance(error, NoConnectionError):
        return StoreError("the store is busy; try again", failure="busy")
    return StoreError("the store cannot be reached; try again later")
