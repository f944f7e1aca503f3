"""The time by which the server goes: the computer's, or one that a replay has set."""

from datetime import UTC, datetime, timedelta
from typing import Any
from zoneinfo import ZoneInfo

from sidestep.crowds.profile import time_of_week
from sidestep.crowds.wall_time import instant
from sidestep.routing.request import at_fault
from sidestep.server.store import Store

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

    def now(self) -> datetime:
        """Local time."""
        real, clock = datetime.now(self._zone), self._simulated
        if clock is None:
            return real
        simulated, since, speed = clock
        return (simulated + (real - since) * speed).astimezone(self._zone)

    @property
    def instant(self) -> datetime:
        """The same in UTC."""
        return self.now().astimezone(UTC)

    def local(self, time: datetime) -> datetime:
        """A time to the second in local time."""
        return time.astimezone(self._zone).replace(microsecond=0)

    def read(self) -> None:
        """Go by what the store says; StoreError where it says nothing at the moment."""
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
        StoreError
            A store that takes nothing at the moment.
        """
        with at_fault("now"):
            there, since = instant(now, self.timezone), datetime.now(UTC)
        self._store.set_clock(there, since, speed)
        self._clock = there, since, speed

    def reset(self) -> None:
        """Go by the time of the computer again."""
        self._store.clear_clock()
        self._clock = None

    @property
    def facts(self) -> dict[str, Any]:
        """What is told of it."""
        now, clock = self.now(), self._simulated
        speed = 1.0 if clock is None else clock[2]
        said = {"now": now.isoformat(timespec="seconds"), "speed": speed, "simulated": clock is not None}
        return {**said, "hour_of_week": round(time_of_week(now), 4)}

    @property
    def _simulated(self) -> tuple[datetime, datetime, float] | None:
        """The clock that a replay has set, as long as it sets it anew: it may have been killed."""
        clock = self._clock
        return None if clock is None or datetime.now(UTC) - clock[1] > LAPSES else clock
