"""When: the times that people give, in seconds since clock 0, and clocks in the words of people."""

import math
from dataclasses import dataclass, replace
from datetime import MAXYEAR, datetime, time, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

from sidestep.crowds.base import FlowModel
from sidestep.crowds.profile import HOURS_OF_WEEK, day_and_time, time_of_week
from sidestep.crowds.wall_time import DAYS, later_time, local_time, seconds_between
from sidestep.routing.request import Departure, RouteError, TimeOfWeek, at_fault, called
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import Venue
from sidestep.walking.waits import DAY_HOURS, HOUR


@dataclass(frozen=True)
class GridClock:
    """Minutes after the scenario's start."""

    horizon: float
    """Seconds from which on nobody sets out."""

    @property
    def hour(self) -> float:
        """Hour of the week at clock 0, of which crowds of grids know nothing."""
        return 0.0

    def clock(self, given: Departure | None, field: str) -> float:
        """Seconds since the start of a time that somebody gives.

        Parameters
        ----------
        given, field
            Minutes, and the parameter that they are of.

        Returns
        -------
        float
            0 if nothing is given.

        Raises
        ------
        RouteError
            Anything but minutes before the horizon.
        """
        minutes = 0.0 if given is None else given
        if not isinstance(minutes, (int, float)) or not 0 <= 60 * minutes < self.horizon:
            said = f"{called(field)} must be minutes between 0 and {self.horizon / 60:g}"
            raise RouteError(f"{said}, not {minutes}", field=field)
        return 60.0 * minutes

    def earliest(self, given: Departure, deadline: float) -> float:
        """Seconds since the start of the earliest departure; RouteError where it is after the deadline."""
        if (clock := self.clock(given, "depart")) > deadline:
            raise RouteError(f"the earliest departure, {given} min, is after the arrival", field="depart")
        return clock

    def due(self, given: Departure, field: str) -> float:
        """Seconds since the start of a deadline; as :meth:`clock`."""
        return self.clock(given, field)

    @staticmethod
    def facts(clock: float) -> dict[str, Any]:
        """What :class:`~sidestep.routing.facts.SceneFacts` say of a clock."""
        return {"departs": f"{clock / 60:g} min after the start", "departure_minutes": clock / 60}


@dataclass(frozen=True)
class TownClock:
    """Local wall time, on a date, on a day of any week, or, for crowds without times, from their first slot on."""

    hour: float
    """Hour of the week at clock 0; 0 is Monday 0:00."""

    first_day: int
    """Day of the week, 0 is Monday, of times without a day."""

    date: datetime | None = None
    """Clock 0 as a date; None where no day was given."""

    timed: bool = True
    """Whether crowds depend on the hour of the week."""

    timezone: str | None = None
    """That of the place, an IANA name; None where it is not known."""

    def clock(self, given: Departure | None, field: str) -> float:
        """Seconds from clock 0 to the next such time.

        Parameters
        ----------
        given, field
            A local time, and the parameter that it is of.

        Returns
        -------
        float
            0 if nothing is given.

        Raises
        ------
        RouteError
            Anything but a local time, a date before clock 0, and crowds without times.
        """
        if given is None:
            return 0.0
        if not self.timed:
            raise RouteError(
                f"crowds of slots without times begin with the walk; leave out {called(field)}", field=field
            )
        ahead, every = self._ahead(given, field)
        if every is None and ahead < 0:
            before = f"{-ahead / 60:,.0f} minutes" if ahead < -90 else f"{math.ceil(-ahead)} seconds"
            said = f"{called(field)} is {before} before {self.date:%Y-%m-%d %H:%M}"
            raise RouteError(f"{said}; give a later time", field=field)
        if every is None:
            return ahead
        later = ahead % every
        # Windows go on over midnight, or into the next week, but not for most of a day or week.
        if later > every / 2 and self.hour * HOUR % every + later > every:
            said = f"{called(field)} is before the first, or {later / HOUR:g} hours after it"
            raise RouteError(f"{said}; swap them, or give both with dates", field=field)
        return later

    def due(self, given: Departure, field: str) -> float:
        """Seconds from clock 0 to a deadline; as :meth:`clock`, but one without a day may be the next morning."""
        return self.clock(next_after(given, self.given, self.timezone), field)

    def earliest(self, given: Departure, deadline: float) -> float:
        """Seconds since clock 0 of the earliest departure, 0 if it is before that.

        Parameters
        ----------
        given
            A local time; without a date it is the last such time before the deadline.
        deadline
            Seconds since clock 0.

        Returns
        -------
        float
            At most the deadline.

        Raises
        ------
        RouteError
            A departure after the deadline (field ``depart``).
        """
        ahead, every = self._ahead(given, "depart")
        back = deadline - ahead if every is None else (deadline - ahead) % every
        if back < 0 or (every is not None and back > every / 2):
            raise RouteError("the earliest departure is after the arrival; depart earlier", field="depart")
        return max(deadline - back, 0.0)

    def _ahead(self, given: Departure, field: str) -> tuple[float, float | None]:
        """Seconds from clock 0 to a time, and after how many seconds there is another such time."""
        hour, date = time_given(given, self.first_day, field, self.timezone)
        if date is not None and self.date is not None:
            return seconds_between(self.date, date, self.timezone), None
        every = DAY_HOURS if isinstance(given, time) or getattr(given, "day", 0) is None else HOURS_OF_WEEK
        return round((hour - self.hour) * HOUR, 3), every * HOUR

    def earlier(self, seconds: float) -> "TownClock":
        """Clock 0 some seconds before this one."""
        date = None if self.date is None else later_time(self.date, -seconds, self.timezone)
        return replace(self, hour=(self.hour - seconds / HOUR) % HOURS_OF_WEEK, date=date)

    @property
    def given(self) -> datetime | TimeOfWeek | None:
        """Clock 0 as a departure, to the second; None for crowds without times."""
        if not self.timed:
            return None
        if self.date is not None:
            date = (self.date + timedelta(seconds=0.5)).replace(microsecond=0, fold=self.date.fold)
            return date if self.timezone is None else date.replace(tzinfo=ZoneInfo(self.timezone))
        day, second = divmod(round(self.hour * HOUR) % round(HOURS_OF_WEEK * HOUR), round(DAY_HOURS * HOUR))
        return TimeOfWeek(time(second // 3600, second // 60 % 60, second % 60), day)

    def facts(self, clock: float) -> dict[str, Any]:
        """What :class:`~sidestep.routing.facts.SceneFacts` say of a clock."""
        if not self.timed:
            return {"departs": "as the table begins"}
        there = self.earlier(-clock)
        if there.date is None:
            return {"departs": day_and_time(there.hour), "hour_of_week": there.hour}
        departs = f"{DAYS[there.date.weekday()]} {there.date:%Y-%m-%d %H:%M}"
        return {"departs": departs, "hour_of_week": time_of_week(there.date), "departure": there.date.isoformat()}


Clock = GridClock | TownClock


def time_given(given: Departure, first_day: int, field: str, timezone: str | None) -> tuple[float, datetime | None]:
    """Read a local time.

    Parameters
    ----------
    given, field
        The time, and the parameter that it is of.
    first_day
        Day of the week, 0 is Monday, of times without a day.
    timezone
        That of the place, an IANA name; None where it is not known.

    Returns
    -------
    float, datetime or None
        Its hour of the week, and its date if it has one.

    Raises
    ------
    RouteError
        Minutes, and the last year of all.
    SidestepError
        Zones where that of the place is not known, and hours that clock changes leave out.
    """
    if isinstance(given, time):
        given = TimeOfWeek(given)
    if isinstance(given, TimeOfWeek) and given.time.tzinfo is None:
        day = first_day if given.day is None else given.day
        return time_of_week(datetime.combine(datetime(2024, 1, 1 + day), given.time)), None  # noqa: DTZ001 - a Monday
    if isinstance(given, datetime) and 1 < given.year < MAXYEAR:
        with at_fault(field):
            there = local_time(given, timezone)
        return time_of_week(there), there
    said = f"{called(field)} must be a local time, such as 2025-05-24T12:30 or Sat 12:30"
    raise RouteError(f"{said}, not {given}", field=field)


def next_after(given: Departure | None, start: Departure | None, timezone: str | None) -> Departure | None:
    """Give a time of day the day on which it is the next one from another time on.

    Parameters
    ----------
    given, start
        The two times.
    timezone
        That of the place, an IANA name; None where it is not known.

    Returns
    -------
    Departure or None
        The same where it has a day, or the other one has none.

    Raises
    ------
    SidestepError
        As :func:`time_given`.
    """
    if isinstance(given, time):
        given = TimeOfWeek(given)
    if not isinstance(given, TimeOfWeek) or given.day is not None:
        return given
    if isinstance(start, TimeOfWeek) and start.day is not None:
        return replace(given, day=(start.day + (given.time < start.time)) % len(DAYS))
    if isinstance(start, datetime):
        begins = local_time(start, timezone).replace(tzinfo=None)
        there = datetime.combine(begins, given.time)
        return there if there >= begins else there + timedelta(days=1)
    return given


def town_clock(venue: Venue, flow: FlowModel, depart: Departure | None, field: str = "depart") -> TownClock:
    """Let clock 0 be a departure.

    Parameters
    ----------
    venue, flow
        The place, and its crowds.
    depart, field
        The departure, and the parameter that it is of; by default the first hour at which people usually set out.

    Returns
    -------
    TownClock
        The clock.

    Raises
    ------
    RouteError
        A departure of which crowds know nothing.
    """
    usual, source = venue.departure_hours(1)[0], Path(venue.crowd_source.file).name
    if not flow.timed:
        if depart is None:
            return TownClock(usual, 0, timed=False)
        said = "has slots without times, so walks depart as it begins"
        raise RouteError(f"{source} {said}; leave out {called(field)}", field=field)
    first_day = min(venue.days)
    hour, date = (usual, None) if depart is None else time_given(depart, first_day, field, venue.timezone)
    clock = TownClock(hour, first_day, date, timezone=venue.timezone)
    check_known(venue, flow, clock, field)
    return clock


def check_known(venue: Venue, flow: FlowModel, clock: TownClock, field: str) -> None:
    """Refuse a clock 0 of which crowds know nothing.

    Parameters
    ----------
    venue, flow
        The place, and its crowds.
    clock, field
        The clock, and the parameter that it is of.

    Raises
    ------
    RouteError
        With the parameter as its field.
    """
    if not flow.covers(clock.hour):
        source, when = Path(venue.crowd_source.file).name, clock.facts(0.0)["departs"]
        raise RouteError(f"{source} covers {flow.coverage}, but {called(field)} is {when}", field=field)


def covered_before(clock: TownClock, flow: FlowModel, scenario: Scenario) -> float:
    """Seconds before clock 0, at most the horizon, from which on crowds are known without a gap."""
    steps = int(scenario.horizon // scenario.slot_seconds)
    for step in range(1, steps + 1):
        if not flow.covers(clock.earlier(step * scenario.slot_seconds).hour):
            return (step - 1) * scenario.slot_seconds
    return steps * scenario.slot_seconds
