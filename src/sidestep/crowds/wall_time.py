"""Local wall time: what a clock on the street shows, by IANA timezone, and when clocks change.

Departures, opening hours, counts and "now" are all local wall times without an offset. This is the only module that
knows timezones; `tzdata` brings their rules where the system has none.
"""

from datetime import UTC, datetime, timedelta
from functools import cache
from zoneinfo import ZoneInfo, available_timezones

import numpy as np
from jaxtyping import Int, Shaped

from sidestep.errors import SidestepError, hint

DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")
Hours = Shaped[np.ndarray, " hour"]
"""``datetime64[h]``."""

_DAY = np.timedelta64(24, "h")
_HALVES = (timedelta(0), timedelta(minutes=30))  # clocks of Lord Howe Island change by half an hour


class TimezoneError(SidestepError):
    """A timezone that is not known, or a time that it does not have."""


def timezone_of(name: str) -> ZoneInfo:
    """The timezone of an IANA name.

    Parameters
    ----------
    name
        Such as Europe/Helsinki.

    Returns
    -------
    timezone
        Its rules.

    Raises
    ------
    TimezoneError
        A name that is not known.
    """
    if name not in _names():
        meant = hint(name, sorted(_names()), "another such as Europe/Helsinki")
        raise TimezoneError(f"timezone must be an IANA name, not {name!r:.60}{meant}", field="timezone")
    return ZoneInfo(name)


@cache
def _names() -> frozenset[str]:
    return frozenset(available_timezones())


def local_time(time: datetime, timezone: str | None) -> datetime:
    """Turn any time into local wall time.

    Parameters
    ----------
    time
        With an offset, or without one: then it is local wall time already. Where the clock shows an hour twice in
        autumn, the first is meant.
    timezone
        IANA name of the place's timezone; None: not known.

    Returns
    -------
    datetime
        Without an offset.

    Raises
    ------
    TimezoneError
        A time with an offset where no timezone is known; a time that the clock skips in spring; an unknown timezone.

    Examples
    --------
    >>> from datetime import datetime
    >>> from sidestep.crowds.wall_time import local_time
    >>> local_time(datetime.fromisoformat("2025-05-24T09:30Z"), "Europe/Helsinki")
    datetime.datetime(2025, 5, 24, 12, 30)
    """
    if timezone is None:
        if time.tzinfo is not None:
            said = f"{time.isoformat()} has a UTC offset, but no timezone is known"
            raise TimezoneError(f"{said}; give the local time without an offset, or set place.timezone", field="time")
        return time
    zone = timezone_of(timezone)
    if time.tzinfo is not None:
        try:
            return time.astimezone(zone).replace(tzinfo=None, fold=0)
        except OverflowError as error:
            raise TimezoneError(f"{time.isoformat()} is out of range", field="time") from error
    if turned(time, zone) > 0:
        said = f"{time.isoformat(timespec='minutes')} does not exist in {timezone}: clocks go forward over it"
        raise TimezoneError(f"{said}; give a time before or after", field="time")
    return time.replace(fold=0)


def instant(time: datetime, timezone: str | None) -> datetime:
    """Turn a time that something happened at into UTC.

    Parameters
    ----------
    time
        With an offset; or without one: then it is local wall time.
    timezone
        IANA name of the place's timezone; None: not known, and its clocks are taken to show UTC.

    Returns
    -------
    datetime
        In UTC.

    Raises
    ------
    TimezoneError
        A time with an offset where no timezone is known; a time without one that the clock skips in spring or shows
        twice in autumn, since nobody knows which of the two is meant; an unknown timezone.

    Examples
    --------
    >>> from datetime import datetime
    >>> from sidestep.crowds.wall_time import instant
    >>> instant(datetime.fromisoformat("2025-05-24T12:30"), "Europe/Helsinki").isoformat()
    '2025-05-24T09:30:00+00:00'
    """
    if time.tzinfo is None and timezone is not None:
        zone = timezone_of(timezone)
        if turned(time, zone) < 0:
            said = f"{time.isoformat(timespec='minutes')} is twice in {timezone}: clocks go back over it"
            raise TimezoneError(f"{said}; give the time with its UTC offset, or in UTC", field="time")
        time = local_time(time, timezone).replace(tzinfo=zone)
    elif time.tzinfo is None or timezone is None:
        return local_time(time, timezone).replace(tzinfo=UTC)
    try:
        return time.astimezone(UTC)
    except OverflowError as error:
        raise TimezoneError(f"{time.isoformat()} is out of range", field="time") from error


def later_time(time: datetime, seconds: float, timezone: str | None) -> datetime:
    """The wall time some seconds after another one, or before it.

    Parameters
    ----------
    time
        Wall time, without an offset; its ``fold`` tells which of two it is.
    seconds
        As a stopwatch counts them, whatever clocks do meanwhile; negative: before.
    timezone
        IANA name of the place's timezone; None: not known, and clocks do not change.

    Returns
    -------
    datetime
        Without an offset.

    Examples
    --------
    >>> from datetime import datetime
    >>> from sidestep.crowds.wall_time import later_time
    >>> later_time(datetime.fromisoformat("2025-03-30T04:10"), -1800, "Europe/Helsinki")
    datetime.datetime(2025, 3, 30, 2, 40)
    """
    if timezone is None:
        return time + timedelta(seconds=seconds)
    zone = timezone_of(timezone)
    there = time.replace(tzinfo=zone).astimezone(UTC) + timedelta(seconds=seconds)
    return there.astimezone(zone).replace(tzinfo=None)


def seconds_between(first: datetime, second: datetime, timezone: str | None) -> float:
    """Seconds from one wall time to another, as in :func:`later_time`; negative if the second one is before."""
    if timezone is None:
        return (second - first).total_seconds()
    zone = timezone_of(timezone)
    first, second = (each.replace(tzinfo=zone).astimezone(UTC) for each in (first, second))
    return (second - first).total_seconds()


def turned(time: datetime, zone: ZoneInfo) -> int:
    """How the clock changes over a wall time: 1 if it skips that, -1 if it shows it twice, otherwise 0."""
    first, second = (time.replace(tzinfo=zone, fold=fold).utcoffset() for fold in (0, 1))
    return 0 if first is None or second is None or first == second else 1 if first < second else -1


def clock_changes(timezone: str, times: Hours) -> tuple[Shaped[np.ndarray, " skipped"], Shaped[np.ndarray, " twice"]]:
    """The hours that a place's clock skips and repeats.

    Parameters
    ----------
    timezone
        IANA name.
    times
        Wall times of a span of hours, ``datetime64[h]``, ascending.

    Returns
    -------
    skipped, twice
        Wall times within the span, ``datetime64[h]``.
    """
    zone = timezone_of(timezone)
    skipped: list[np.datetime64] = []
    twice: list[np.datetime64] = []
    midnights = np.arange(times[0].astype("datetime64[D]"), times[-1] + 2 * _DAY, _DAY).astype("datetime64[s]").tolist()
    offset = [midnight.replace(tzinfo=zone).utcoffset() for midnight in midnights]
    for begins, before, after in zip(midnights, offset, offset[1:], strict=False):
        if before == after:
            continue
        for hour in (begins + timedelta(hours=step) for step in range(24)):
            change = {turned(hour + half, zone) for half in _HALVES} - {0}
            for one, found in ((1, skipped), (-1, twice)):
                if one in change and times[0] <= np.datetime64(hour, "h") <= times[-1]:
                    found.append(np.datetime64(hour, "h"))
    return np.array(skipped, "datetime64[h]"), np.array(twice, "datetime64[h]")


def timezones_going_back(hours: Hours) -> list[str]:
    """The timezones whose clocks show all these hours twice.

    Parameters
    ----------
    hours
        Wall times, ``datetime64[h]``.

    Returns
    -------
    list[str]
        IANA names in alphabetical order.
    """
    found = sorted(_names())
    for hour in hours.astype("datetime64[s]").tolist():
        found = [name for name in found if any(turned(hour + half, ZoneInfo(name)) < 0 for half in _HALVES)]
    return found


def wall_seconds(seconds: Int[np.ndarray, " time"], timezone: str) -> Int[np.ndarray, " time"]:
    """Wall times of instants.

    Parameters
    ----------
    seconds
        Since 1970 in UTC.
    timezone
        IANA name.

    Returns
    -------
    seconds
        Since 1970 as the clock shows them.
    """
    zone = timezone_of(timezone)
    distinct, number = np.unique(seconds, return_inverse=True)
    offset = [datetime.fromtimestamp(each, UTC).astimezone(zone).utcoffset() for each in distinct.tolist()]
    shift = np.array([0 if each is None else round(each.total_seconds()) for each in offset], np.int64)
    return seconds + shift[number]
