"""Live counts: which are taken, and what the latest of them say. All times are of a Saturday in May."""

import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.crowds.counts import CountTable, LatestCounts, latest_counts
from sidestep.crowds.live import LOOKBACK, LiveCount, LiveError, check_counts, is_late, latest

TOWN = "Europe/Helsinki"
SENSORS = ("bridge", "quay", "Market Square")
NOW = datetime.fromisoformat("2025-05-24T09:45Z")  # 12:45 in Helsinki


def at(clock: str) -> datetime:
    """In UTC."""
    return datetime.fromisoformat(f"2025-05-24T{clock}Z")


def count(sensor: str, begins: str, minutes: float, persons: float, **more: Any) -> LiveCount:
    return LiveCount(sensor, at(begins), 60.0 * minutes, float(persons), **more)


def found(counts: list[LiveCount], now: datetime = NOW, timezone: str | None = TOWN) -> LatestCounts:
    result = latest(counts, SENSORS, now, timezone)
    assert result is not None
    return result


# --- What is refused ------------------------------------------------------------------------------------------------

GOOD = count("bridge", "08:00", 60, 120)


@pytest.mark.parametrize(
    ("changed", "field"),
    [
        ({"sensor": "brigde"}, "sensor"),
        ({"sensor": ""}, "sensor"),
        ({"sensor": "x" * 10_000_000}, "sensor"),  # at once: no similar names are looked for
        ({"sensor": "\ud800"}, "sensor"),
        ({"begins": at("08:51")}, "time"),  # its hour is over at 9:51, and clocks may be 5 minutes apart
        ({"begins": NOW + timedelta(days=365)}, "time"),
        ({"begins": datetime.max.replace(tzinfo=UTC)}, "time"),
        ({"begins": NOW - timedelta(days=7, seconds=1)}, "time"),
        ({"begins": datetime.min.replace(tzinfo=UTC)}, "time"),
        ({"seconds": 59.0}, "seconds"),
        ({"seconds": 3601.0}, "seconds"),
        ({"seconds": -3600.0}, "seconds"),
        ({"seconds": math.nan}, "seconds"),
        ({"seconds": math.inf}, "seconds"),
        ({"persons": -1.0}, "count"),
        ({"persons": math.nan}, "count"),
        ({"persons": math.inf}, "count"),
        ({"persons": 1_000_001.0}, "count"),
        ({"persons": 16_667.0, "seconds": 60.0}, "count"),
        ({"towards": 120.0}, "count"),
        ({"away": 120.0}, "count"),
        ({"towards": 60.0, "away": 61.0}, "count"),
        ({"towards": -1.0, "away": 121.0}, "count"),
        ({"towards": math.nan, "away": 120.0}, "count"),
    ],
)
def test_wrong_counts(changed: dict[str, Any], field: str) -> None:
    wrong = replace(GOOD, **changed)
    with pytest.raises(LiveError) as caught:
        check_counts([wrong], SENSORS, NOW)
    assert (caught.value.field, caught.value.row) == (field, None)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300
    with pytest.raises(LiveError, match=r"^row 2: ") as caught:
        check_counts([count("quay", "08:00", 60, 1), wrong, wrong], SENSORS, NOW)
    assert (caught.value.field, caught.value.row) == (field, 2)


@pytest.mark.parametrize(
    "changed",
    [
        {"persons": 0.0},
        {"persons": 120.5},
        {"begins": at("08:50")},
        {"begins": at("09:49"), "seconds": 60.0},
        {"begins": NOW - timedelta(days=7)},
        {"seconds": 60.0, "persons": 16_666.0},
        {"towards": 0.1, "away": 119.9},
    ],
)
def test_good_counts(changed: dict[str, Any]) -> None:
    check_counts([replace(GOOD, **changed)], SENSORS, NOW)


def test_similar_names_are_told() -> None:
    for name in ("Brigde", "market"):
        with pytest.raises(LiveError, match=r"'bridge'|'Market Square'"):
            check_counts([replace(GOOD, sensor=name)], SENSORS, NOW)


@pytest.mark.parametrize(
    ("counts", "field", "row"),
    [
        ([GOOD, count("quay", "08:00", 60, 7), replace(GOOD, persons=121.0)], "time", 3),
        ([GOOD, replace(GOOD, towards=60.0, away=60.0)], "time", 2),
        # Counts of five minutes, of which nobody said so.
        ([count("bridge", "08:05", 60, 9), count("bridge", "08:00", 60, 8)], "seconds", 1),
    ],
)
def test_counts_that_contradict_each_other(counts: list[LiveCount], field: str, row: int) -> None:
    with pytest.raises(LiveError) as caught:
        check_counts(counts, SENSORS, NOW)
    assert (caught.value.field, caught.value.row) == (field, row)


def test_the_same_count_twice_is_one() -> None:
    check_counts([GOOD, count("bridge", "07:00", 60, 7), GOOD], SENSORS, NOW)
    check_counts([], SENSORS, NOW)


def test_late_counts_say_nothing_of_now() -> None:
    assert not is_late(count("bridge", "07:16", 60, 120), NOW)
    assert is_late(count("bridge", "07:15", 60, 120), NOW)


# --- The latest -----------------------------------------------------------------------------------------------------


def test_whole_hours_are_as_in_a_file() -> None:
    hour = np.datetime64("2025-05-24T11", "h")
    table = CountTable(np.array([hour]), ("quay", "bridge"), np.array([[77.0, 120.0]]), None, (), "live.csv")
    file = latest_counts(table, SENSORS, datetime.fromisoformat("2025-05-24T12:45"))
    posted = found([count("bridge", "08:00", 60, 120), count("quay", "08:00", 60, 77)])
    np.testing.assert_array_equal(posted.counts, file.counts)
    assert posted.counts.tolist() == [120, 77, pytest.approx(math.nan, nan_ok=True)]
    assert (posted.hour[:2] == file.hour).all()
    assert posted.since[:2].tolist() == [file.since] * 2 == [1.25, 1.25]
    assert posted.known == 2


@pytest.mark.parametrize(
    ("counts", "rate", "begins", "since"),
    [
        # Three quarters, and one that is before the last hour.
        ([("08:30", 15, 9), ("09:00", 15, 30), ("09:15", 15, 20), ("09:30", 15, 50)], 400 / 3, "11:52:30", 0.375),
        # The hour from 8:15 to 9:15 has 3/4 of the first interval, and one quarter.
        ([("08:00", 60, 100), ("09:00", 15, 40)], 75 + 40, "11:15", 1.0),
        # A gap: 8:40 to 9:00 and 9:20 to 9:40, 15 + 25 persons, the middle of both is 9:10.
        ([("08:40", 20, 15), ("09:20", 20, 25)], 60, "11:40", 35 / 60),
        # Where intervals overlap, the one that begins later: 30 min of 60 an hour, 15 min of 240, 15 min of 60.
        ([("08:00", 60, 60), ("08:30", 15, 60)], 30 + 60 + 15, "11:00", 1.25),
        # Just enough, and an hour and a half ago, nearly.
        ([("08:01", 15, 30)], 120, "10:38:30", 96.5 / 60),
        # Up to 5 minutes ahead, and no further.
        ([("09:30", 20, 20), ("09:50", 1, 999)], 60, "12:10", 5 / 60),
    ],
)
def test_rates(counts: list[tuple[str, float, float]], rate: float, begins: str, since: float) -> None:
    posted = found([count("quay", *each) for each in counts])
    assert posted.counts[1] == pytest.approx(rate, rel=1e-12)
    assert posted.hour[1] == np.datetime64(f"2025-05-24T{begins}")
    assert posted.since[1] == pytest.approx(since, abs=1e-9)
    assert posted.known == 1


@pytest.mark.parametrize(
    "counts",
    [
        [],
        [count("fountain", "08:00", 60, 7)],
        [count("bridge", "07:15", 60, 7)],  # silent for 90 minutes
        [count("bridge", "09:00", 14, 7)],
        [count("bridge", "09:00", 7, 7), count("bridge", "07:59", 15, 7)],  # 14 minutes of that hour
        [count("bridge", "09:40", 11, 7)],
        [count("bridge", "08:18", 1, 7), count("bridge", "07:20", 14, 7)],  # most of it more than two hours ago
    ],
)
def test_nothing_is_known(counts: list[LiveCount]) -> None:
    assert latest(counts, SENSORS, NOW, TOWN) is None


def test_each_sensor_has_an_hour_of_its_own() -> None:
    minutes = [count("quay", f"09:{minute:02}", 1, minute) for minute in range(45)]
    posted = found([*minutes, count("bridge", "08:00", 60, 120)])
    assert posted.counts[:2].tolist() == [120, pytest.approx(22 * 60)]
    # The third is not known: its hour is the one of clocks whose middle was the last.
    clocks = ("11:00", "11:52:30", "12:00")
    assert posted.hour.tolist() == [datetime.fromisoformat(f"2025-05-24T{clock}") for clock in clocks]
    assert posted.since.tolist() == [1.25, 0.375, 0.25]


def test_hours_are_those_of_the_town() -> None:
    counts = [count("bridge", "08:00", 60, 120)]
    for timezone, hour in ((TOWN, 11), ("Asia/Kathmandu", 13.75), (None, 8)):
        assert found(counts, timezone=timezone).hour[0] == np.datetime64("2025-05-24") + np.timedelta64(
            int(60 * hour), "m"
        )
    # In spring the hour from 3:00 on is left out, but an hour is an hour.
    spring = LiveCount("bridge", datetime.fromisoformat("2025-03-30T00:30Z"), 3600.0, 5.0)
    posted = found([spring], datetime.fromisoformat("2025-03-30T01:30Z"))
    assert (posted.hour[0], posted.since[0]) == (np.datetime64("2025-03-30T03:30"), 0.5)


# --- Whatever the order ---------------------------------------------------------------------------------------------

MINUTES = st.integers(-400, 2)
POSTED = st.lists(
    st.builds(
        lambda sensor, begins, length, persons: LiveCount(
            sensor, NOW + timedelta(minutes=begins), 60.0 * length, float(persons)
        ),
        st.sampled_from(SENSORS), MINUTES, st.integers(1, 60), st.integers(0, 500),
    ),
    max_size=30,
    unique_by=lambda each: (each.sensor, each.begins),
)  # fmt: skip


def same(one: LatestCounts | None, other: LatestCounts | None) -> bool:
    if one is None or other is None:
        return one is other
    return all(
        np.array_equal(mine, yours, equal_nan=mine.dtype.kind == "f")
        for mine, yours in ((one.counts, other.counts), (one.hour, other.hour), (one.since, other.since))
    )


@given(POSTED, st.data())
def test_order_and_repetition_do_not_matter(counts: list[LiveCount], data: st.DataObject) -> None:
    again = data.draw(st.lists(st.sampled_from(counts), max_size=5)) if counts else []
    shuffled = data.draw(st.permutations([*counts, *again]))
    expected = latest(counts, SENSORS, NOW, TOWN)
    assert same(latest(shuffled, SENSORS, NOW, TOWN), expected)
    assert same(latest([each for each in counts if each.begins >= NOW - LOOKBACK], SENSORS, NOW, TOWN), expected)


@given(POSTED, st.data())
def test_the_last_correction_stands(counts: list[LiveCount], data: st.DataObject) -> None:
    wrong = [replace(each, persons=each.persons + data.draw(st.integers(1, 9))) for each in counts]
    corrected = latest([*wrong, *counts], SENSORS, NOW, TOWN)
    assert same(corrected, latest(counts, SENSORS, NOW, TOWN))


@given(POSTED)
def test_rates_are_within_those_of_the_counts(counts: list[LiveCount]) -> None:
    posted = latest(counts, SENSORS, NOW, TOWN)
    for number, sensor in enumerate(SENSORS if posted is not None else ()):
        if np.isfinite(posted.counts[number]):
            rates = [each.persons * 3600 / each.seconds for each in counts if each.sensor == sensor]
            assert min(rates) * (1 - 1e-9) <= posted.counts[number] <= max(rates) * (1 + 1e-9)
            assert -0.1 < posted.since[number] < 2
