"""The time by which the server goes: the computer's, or one that a replay has set."""

import threading
from datetime import UTC, datetime, timedelta
from typing import Any
from zoneinfo import ZoneInfo

from sidestep.crowds.profile import time_of_week
from sidestep.crowds.wall_time import instant
from sidestep.routing.request import at_fault
from sidestep.server.problems import ProblemError
from sidestep.server.store import Store

FIRST_YEAR, LAST_YEAR = 1971, 2200
"""Of simulated times."""
LAPSES = timedelta(hours=1)
"""After which a simulated time no longer counts, unless it is set anew: a replay may have been killed."""


class ServerClock:
    """Local time of a town, the same in all processes of a server.

    Parameters
    ----------
    timezone
        IANA name of the town's timezone; None: not known, and its clocks are taken to show UTC.
    store
        Where a simulated time is kept.
    """

    def __init__(self, timezone: str | None, store: Store) -> None:
        self.timezone, self._store = timezone, store
        self._zone = UTC if timezone is None else ZoneInfo(timezone)
        self._clock: tuple[datetime, datetime, float] | None = None
        self._lock = threading.Lock()

    def now(self) -> datetime:
        """Local time."""
        real, clock = datetime.now(self._zone), self.setting
        if clock is None:
            return real
        simulated, since, speed = clock
        return (simulated + (real - since) * speed).astimezone(self._zone)

    @property
    def instant(self) -> datetime:
        """The same in UTC."""
        return self.now().astimezone(UTC)

    @property
    def wall(self) -> datetime:
        """Now as routers take it: without an offset, since some towns have no timezone."""
        return self.now().replace(tzinfo=None)

    def local(self, time: datetime) -> datetime:
        """A time to the second in local time."""
        return time.astimezone(self._zone).replace(microsecond=0)

    def read(self) -> None:
        """Go by what the store says; StoreError where it says nothing at the moment."""
        with self._lock:  # or an older time, read before, might take the place of one that is set
            self._clock = self._store.clock()

    def set(self, now: datetime, speed: float) -> None:
        """Go by a simulated time, in all processes.

        Parameters
        ----------
        now
            Local time where it has no offset.
        speed
            Seconds of it in each second.

        Raises
        ------
        SidestepError
            An hour that clocks leave out or repeat, given without an offset (field ``now``).
        ProblemError
            Times long ago, or far ahead (field ``now``).
        StoreError
            A store that takes nothing at the moment.
        """
        with at_fault("now"):
            there, since = instant(now, self.timezone), datetime.now(UTC)
        if not FIRST_YEAR <= there.year <= LAST_YEAR:
            said = f"the simulated time must be in the years {FIRST_YEAR} to {LAST_YEAR}, not {there.year}"
            raise ProblemError(422, said, field="now")
        with self._lock:
            self._store.set_clock(there, since, speed)
            self._clock = there, since, speed

    def reset(self) -> None:
        """Go by the time of the computer again."""
        with self._lock:
            self._store.clear_clock()
            self._clock = None

    @property
    def facts(self) -> dict[str, Any]:
        """What is told of it."""
        now, clock = self.now(), self.setting
        speed = 1.0 if clock is None else clock[2]
        said = {"now": now.isoformat(timespec="seconds"), "speed": speed, "simulated": clock is not None}
        return {**said, "hour_of_week": round(time_of_week(now), 4)}

    @property
    def setting(self) -> tuple[datetime, datetime, float] | None:
        """What a replay has set: its time, the computer's time then, and its speed; None where none is set."""
        clock = self._clock
        return None if clock is None or datetime.now(UTC) - clock[1] > LAPSES else clock
