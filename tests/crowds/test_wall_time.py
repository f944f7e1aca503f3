"""Wall times: offsets, hours that clocks skip, and hours that they show twice."""

from datetime import UTC, datetime

import numpy as np
import pytest

from sidestep.crowds.wall_time import (
    TimezoneError,
    clock_changes,
    instant,
    local_time,
    timezone_of,
    timezones_going_back,
    wall_seconds,
)

HELSINKI = "Europe/Helsinki"


@pytest.mark.parametrize(
    ("time", "timezone", "local"),
    [
        ("2025-05-24T12:30", None, "2025-05-24T12:30"),
        ("2025-05-24T12:30", HELSINKI, "2025-05-24T12:30"),
        ("2025-05-24T12:30Z", HELSINKI, "2025-05-24T15:30"),
        ("2025-05-24T12:30+12:00", HELSINKI, "2025-05-24T03:30"),
        ("2025-01-01T23:30-05:00", "Pacific/Auckland", "2025-01-02T17:30"),
        ("2025-03-30T00:59Z", HELSINKI, "2025-03-30T02:59"),
        ("2025-03-30T01:00Z", HELSINKI, "2025-03-30T04:00"),  # 3:00 does not exist
        ("2025-10-26T03:30", HELSINKI, "2025-10-26T03:30"),  # comes twice
        ("2025-10-26T00:30Z", HELSINKI, "2025-10-26T03:30"),
        ("2025-10-26T01:30Z", HELSINKI, "2025-10-26T03:30"),
    ],
)
def test_local_times(time: str, timezone: str | None, local: str) -> None:
    found = local_time(datetime.fromisoformat(time), timezone)
    assert (found, found.fold, found.tzinfo) == (datetime.fromisoformat(local), 0, None)


@pytest.mark.parametrize(
    ("time", "timezone", "field"),
    [
        ("2025-05-24T12:30Z", None, "time"),
        ("2025-03-30T03:00", HELSINKI, "time"),
        ("2025-03-30T03:59:59", HELSINKI, "time"),
        ("9999-12-31T23:00Z", HELSINKI, "time"),
        ("2025-05-24T12:30", "Europe/Helsinky", "timezone"),
        ("2025-05-24T12:30", "../../etc/passwd", "timezone"),
        ("2025-05-24T12:30", "Europe", "timezone"),
        ("2025-05-24T12:30", "", "timezone"),
    ],
)
def test_times_that_are_none(time: str, timezone: str | None, field: str) -> None:
    with pytest.raises(TimezoneError) as caught:
        local_time(datetime.fromisoformat(time), timezone)
    assert caught.value.field == field
    assert "\n" not in str(caught.value)


def hours(first: str, number: int) -> np.ndarray:
    return np.datetime64(first, "h") + np.arange(number)


@pytest.mark.parametrize(
    ("timezone", "skipped", "twice"),
    [
        ("Pacific/Auckland", ["2024-09-29T02"], ["2024-04-07T02"]),
        (HELSINKI, ["2024-03-31T03"], ["2024-10-27T03"]),
        ("America/New_York", ["2024-03-10T02"], ["2024-11-03T01"]),
        ("America/Santiago", ["2024-09-08T00"], ["2024-04-06T23"]),  # around midnight
        ("Australia/Lord_Howe", ["2024-10-06T02"], ["2024-04-07T01"]),  # by half an hour
        ("Asia/Tokyo", [], []),
    ],
)
def test_clock_changes(timezone: str, skipped: list[str], twice: list[str]) -> None:
    found = clock_changes(timezone, hours("2024-01-01T00", 366 * 24))
    assert [list(map(str, each)) for each in found] == [skipped, twice]


def test_only_changes_within_the_span() -> None:
    for first, number, found in (("2024-10-27T03", 1, 1), ("2024-10-27T04", 9, 0), ("2024-10-26T20", 7, 0)):
        assert len(clock_changes(HELSINKI, hours(first, number))[1]) == found


def test_whose_clocks_go_back() -> None:
    assert HELSINKI in timezones_going_back(hours("2024-10-27T03", 1))
    both = timezones_going_back(np.array(["2024-10-27T02", "2023-10-29T02"], "datetime64[h]"))
    assert "Europe/Berlin" in both
    assert HELSINKI not in both
    assert timezones_going_back(hours("2024-10-28T02", 1)) == []
    assert timezones_going_back(np.array(["2024-10-27T02", "2024-11-03T01"], "datetime64[h]")) == []


def test_instants_as_the_clock_shows_them() -> None:
    utc = np.array(["2024-10-27T00", "2024-10-27T01", "2024-10-27T02"], "datetime64[s]").astype(np.int64)
    wall = wall_seconds(utc, HELSINKI).astype("datetime64[s]").astype("datetime64[h]")
    assert list(map(str, wall)) == ["2024-10-27T03", "2024-10-27T03", "2024-10-27T04"]


def test_names() -> None:
    assert timezone_of("Asia/Kolkata").key == "Asia/Kolkata"


@pytest.mark.parametrize(
    ("time", "timezone", "utc"),
    [
        ("2025-05-24T12:30", HELSINKI, "2025-05-24T09:30"),
        ("2025-05-24T12:30+02:00", HELSINKI, "2025-05-24T10:30"),
        ("2025-10-26T03:30+02:00", HELSINKI, "2025-10-26T01:30"),  # twice there, but this is one of them
        ("2025-05-24T12:30", None, "2025-05-24T12:30"),
    ],
)
def test_instants(time: str, timezone: str | None, utc: str) -> None:
    found = instant(datetime.fromisoformat(time), timezone)
    assert (found, found.tzinfo) == (datetime.fromisoformat(utc + "Z"), UTC)


@pytest.mark.parametrize(
    ("time", "timezone"),
    [
        ("2025-03-30T03:30", HELSINKI),  # skipped
        ("2025-10-26T03:30", HELSINKI),  # twice
        ("2025-05-24T12:30Z", None),
        ("0001-01-01T00:00+14:00", HELSINKI),
        ("0001-01-01T00:00", HELSINKI),
        ("9999-12-31T23:59", "Pacific/Honolulu"),
    ],
)
def test_instants_that_nobody_knows(time: str, timezone: str | None) -> None:
    with pytest.raises(TimezoneError) as caught:
        instant(datetime.fromisoformat(time), timezone)
    assert caught.value.field == "time"
