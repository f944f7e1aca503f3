"""Notices of PostgreSQL, by which all processes hear of what one of them stores."""

import threading
from collections.abc import Callable
from contextlib import closing, suppress
from typing import Any

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import SQLAlchemyError

CHANNEL = "sidestep_changes"
"""On which processes tell each other that counts or the clock have changed."""
AGAIN = 0.5
"""Seconds after which a connection that failed is made again."""
LOOK = 0.5
"""Seconds after which a thread that hears nothing looks whether it is to end."""


def give_notice(connection: Connection) -> None:
    """Tell all processes, this one as well, once the transaction is on the disk; of SQLite nobody hears."""
    if connection.dialect.name == "postgresql":
        connection.exec_driver_sql(f"NOTIFY {CHANNEL}")


class Listener:
    """A thread that hears notices on a connection of its own, which it makes anew whenever that fails.

    Parameters
    ----------
    engine
        Of the database.
    tell
        Called after each notice, and after each new connection: there may have been notices before it.
    """

    def __init__(self, engine: Engine, tell: Callable[[], object]) -> None:
        self._engine, self._tell, self._ended = engine, tell, threading.Event()
        self._thread = threading.Thread(target=self._run, name="notices", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hear nothing more."""
        self._ended.set()
        self._thread.join(2 * LOOK)

    def _run(self) -> None:
        failures = (SQLAlchemyError, self._engine.dialect.loaded_dbapi.Error, OSError)
        while not self._ended.is_set():
            with suppress(*failures):  # requests that ask the database say what is wrong with it
                self._hear()
            self._ended.wait(AGAIN)

    def _hear(self) -> None:
        """Hear notices until the connection fails, or there is nobody to tell."""
        pooled = self._engine.raw_connection()
        connection: Any = pooled.driver_connection
        pooled.detach()  # never given back, since it listens
        with closing(connection):
            connection.autocommit = True
            connection.execute(f"LISTEN {CHANNEL}")
            self._tell()
            while not self._ended.is_set():
                if list(connection.notifies(timeout=LOOK, stop_after=1)):
                    self._tell()
