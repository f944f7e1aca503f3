"""Every fault of the Auckland counts, shown on a tiny table and on the real one."""

import numpy as np
import pytest

from sidestep.crowds import repairs as fix
from sidestep.crowds.counts import AUCKLAND_TIMEZONE, TEST, TRAIN, CountTable
from sidestep.crowds.wall_time import clock_changes

Published = tuple[np.ndarray, np.ndarray, np.ndarray]


def hours_from(start: str, count: int) -> np.ndarray:
    times: np.ndarray = np.datetime64(start, "h") + np.arange(count) * fix.HOUR
    return times


def row(table: CountTable, time: str) -> np.ndarray:
    counts: np.ndarray = table.counts[int((np.datetime64(time, "h") - table.times[0]).astype(int))]
    return counts


def hours_of(table: CountTable, kind: str, sensor: str | None = None) -> int:
    return sum(r.hours for r in table.repairs if (r.kind, r.sensor) == (kind, sensor))


def after_midnight(times: np.ndarray, series: np.ndarray) -> float:
    """Correlation of 23 h with the 0 h that follows."""
    value = dict(zip(times.tolist(), series.tolist(), strict=True))
    hour = np.timedelta64(1, "h").astype("timedelta64[h]").tolist()
    pairs = np.array([(v, value[t + hour]) for t, v in value.items() if t.hour == 23 and t + hour in value])
    return float(np.corrcoef(pairs[~np.isnan(pairs).any(axis=1)].T)[0, 1])


def test_operational_day_puts_the_night_on_the_next_calendar_day() -> None:
    friday = np.array(["2024-03-01"] * 3, dtype="datetime64[D]")
    times = fix.calendar_times(friday, np.array([6, 23, 5]))
    assert times.astype(str).tolist() == ["2024-03-01T06", "2024-03-01T23", "2024-03-02T05"]


def test_operational_day_of_the_real_counts(auckland: CountTable, published: Published) -> None:
    days, hours, series = published
    naive = days.astype("datetime64[D]") + hours * fix.HOUR
    assert after_midnight(naive, series) == pytest.approx(0.27, abs=0.01)
    assert after_midnight(auckland.times, auckland.series("45 Queen Street")) == pytest.approx(0.92, abs=0.01)
    assert hours_of(auckland, "operational day") == 15341


def test_wrong_dates_follow_the_order_of_the_rows() -> None:
    times = hours_from("2025-01-02T01", 5)
    wrong = times.copy()
    wrong[2] += 48 * fix.HOUR
    assert (fix.ordered_times(wrong) == times).all()
    absent = np.delete(times, 3)
    assert (fix.ordered_times(absent) == absent).all()


def test_wrong_dates_of_the_real_counts(auckland: CountTable, published: Published) -> None:
    days, hours, _ = published
    as_published = fix.calendar_times(days, hours)
    wrong = fix.ordered_times(as_published) != as_published
    days_wrong = days[wrong].astype("datetime64[D]").astype(str).tolist()
    assert days_wrong == ["2024-09-28", "2025-01-02", "2025-01-03", "2025-01-04", "2025-01-05", "2025-01-05"]
    assert hours_of(auckland, "wrong date") == 6


def test_every_hour_gets_a_row() -> None:
    times = hours_from("2024-01-01T00", 4)[[0, 1, 3]]
    every, counts, absent = fix.fill_hours(times, np.array([[1.0], [2.0], [4.0]]))
    assert every.astype(str).tolist() == ["2024-01-01T00", "2024-01-01T01", "2024-01-01T02", "2024-01-01T03"]
    np.testing.assert_array_equal(counts[:, 0], [1, 2, np.nan, 4])
    assert absent.tolist() == [False, False, True, False]


def test_the_real_table_is_hourly_without_gaps(auckland: CountTable) -> None:
    assert (np.diff(auckland.times).astype(int) == 1).all()
    assert (str(auckland.times[0]), str(auckland.times[-1])) == ("2019-01-01T06", "2026-01-01T05")
    assert auckland.counts.shape == (61368, 21)


@pytest.mark.parametrize("as_published", [[4, 3, 0, 1, 8], [4, 3, np.nan, 1, 8]])
def test_the_skipped_hour_is_missing_not_empty(as_published: list[float]) -> None:
    times = hours_from("2024-09-29T00", 5)
    counts, moved = fix.repair_clock_forward(times, np.array(as_published, dtype=float)[:, None], times[2])
    np.testing.assert_array_equal(counts[:, 0], [4, 3, np.nan, 1, 8])
    assert moved == 0


def test_hours_pasted_an_hour_too_early_move_back() -> None:
    times = hours_from("2023-09-24T00", 7)
    as_published = np.array([[4.0], [3.0], [1.0], [8.0], [9.0], [np.nan], [7.0]])
    counts, moved = fix.repair_clock_forward(times, as_published, times[2])
    np.testing.assert_array_equal(counts[:, 0], [4, 3, np.nan, 1, 8, 9, 7])
    assert moved == 3
    complete = np.ones((7, 1))  # nothing is missing anywhere: nothing can be said
    assert fix.repair_clock_forward(times, complete, times[2])[1] == 0
    assert fix.repair_clock_forward(times, complete, times[0] - fix.HOUR)[1] == 0


@pytest.mark.parametrize(("year", "hours"), [("2023", 171), ("2025", 75)])
def test_shifted_hours_of_the_real_counts(auckland: CountTable, published: Published, year: str, hours: int) -> None:
    """Monday after the clock change: it looks like other Mondays, but one hour later than it was published."""
    monday = np.datetime64({"2023": "2023-09-25T06", "2025": "2025-09-29T06"}[year], "h")
    days, hour, series = published
    raw = dict(zip(fix.ordered_times(fix.calendar_times(days, hour)).tolist(), series.tolist(), strict=True))
    fixed = dict(zip(auckland.times.tolist(), auckland.series("45 Queen Street").tolist(), strict=True))

    def day(values: dict[object, float], weeks: int = 0) -> np.ndarray:
        times = monday + (np.arange(18) + 168 * weeks) * fix.HOUR
        return np.log1p([values[time] for time in times.tolist()])

    others = np.mean([day(fixed, weeks) for weeks in (-3, -2, 2, 3)], axis=0)
    assert np.corrcoef(day(raw), others)[0, 1] < 0.95
    assert np.corrcoef(day(fixed), others)[0, 1] > 0.97
    moved = [r.hours for r in auckland.repairs if r.kind == "shifted hours" and year in r.detail]
    assert moved == [hours]


def test_clock_hours_of_the_real_counts_are_missing(auckland: CountTable) -> None:
    skipped, twice = clock_changes(AUCKLAND_TIMEZONE, auckland.times)
    assert (len(skipped), len(twice)) == (7, 7)
    for time in (*skipped, *twice):
        assert np.isnan(row(auckland, str(time))).all()
    assert hours_of(auckland, "clock forward") == hours_of(auckland, "clock back") == 7


def test_dead_runs_spare_true_nights() -> None:
    times = hours_from("2024-01-01T00", 10 * 24)
    hour = np.arange(len(times)) % 24
    series = np.where(hour < 6, 0.0, 50.0)
    series[hour == 5] = 3.0
    assert len(fix.zero_runs(series)) == 10
    assert len(fix.dead_runs(times, series)) == 0
    series[3 * 24 : 4 * 24] = 0.0  # 18 hours in which 900 persons usually pass, and the nights around them
    assert fix.dead_runs(times, series).tolist() == [[3 * 24, 4 * 24 + 5]]
    assert fix.dead_runs(times, np.zeros(len(times))).shape == (0, 2)  # nothing to compare with
    assert fix.zero_runs(np.array([0.0, np.nan, 0.0])).tolist() == [[0, 1], [2, 3]]


def test_places_that_are_shut_are_not_dead() -> None:
    times = hours_from("2024-01-01T00", 8 * 168)
    hour = np.arange(len(times))
    open_at = (hour % 24 >= 8) & (hour % 24 < 20) & (hour % 168 >= 24)  # never on Mondays
    series = np.where(open_at, 100.0, 0.0)
    assert len(fix.dead_runs(times, series)) == 0
    series[3 * 168 + 48 : 3 * 168 + 72] = 0.0  # a Wednesday, on which 1,200 persons usually come
    assert fix.dead_runs(times, series).tolist() == [[3 * 168 + 44, 3 * 168 + 80]]


def test_spikes_stand_alone() -> None:
    series = 100 + 50 * np.sin(np.arange(400.0) * 2 * np.pi / 24)
    assert not fix.spikes(series).any()
    for first, hours, neighbour, found in (
        (200, 1, None, True),
        (200, 2, None, True),
        (200, 3, None, False),  # three hours in a row are an event
        (200, 1, 700.0, False),  # crowds come and go
        (200, 1, np.nan, True),  # all that was missed in an outage at once
        (399, 1, None, True),
    ):
        spiked = series.copy()
        spiked[first : first + hours] = 5000.0
        if neighbour is not None:
            spiked[first - 1] = neighbour
        assert np.flatnonzero(fix.spikes(spiked)).tolist() == list(range(first, first + hours)) * found
    assert not fix.spikes(np.where(np.arange(100) == 50, 5000.0, 100.0)).any()  # too short to tell


def test_repaired_counts_have_nothing_left_to_repair() -> None:
    # The second spike shows only without the first ones, which raise what counts as usual.
    series = np.full((8 * 168, 1), 10.0)
    series[50 : 50 + 13 * 90 : 90, 0] = 10_000.0
    series[600] = 90.0
    times = np.datetime64("2024-03-04T00", "h") + np.arange(len(series))
    none = np.zeros(len(series), bool)
    once, found = fix.repair_sensors(times, series, ["a"], none)
    assert [(each.kind, each.hours) for each in found] == [("spike", 14)]
    twice, _ = fix.repair_sensors(times, once, ["a"], none)
    np.testing.assert_array_equal(twice, once)


def test_the_real_counts_have_no_spikes(auckland: CountTable) -> None:
    assert [repair for repair in auckland.repairs if repair.kind == "spike"] == []


def test_dead_sensors_of_the_real_counts(auckland: CountTable) -> None:
    quay = auckland.between("2019-04-02", "2022-03-01").series("107 Quay Street")
    assert np.isnan(quay).all()
    assert hours_of(auckland, "dead sensor", "107 Quay Street") == 25554
    assert hours_of(auckland, "dead sensor", "1 Courthouse Lane") == 715 + 281
    assert hours_of(auckland, "dead sensor", "297 Queen Street") >= 455 + 67
    assert hours_of(auckland, "dead sensor", "2 High Street") == 0


def test_true_zeros_and_lockdowns_survive(auckland: CountTable) -> None:
    assert (auckland.series("2 High Street") == 0).sum() > 800  # nights
    lockdown = auckland.between("2020-04-01", "2020-04-20").series("45 Queen Street")
    assert not np.isnan(lockdown[24 : 4 * 24]).any()
    assert np.nanmean(lockdown) < 0.2 * np.nanmean(auckland.between(*TRAIN).series("45 Queen Street"))


def test_half_missing_sensors_stay_missing_and_are_reported(auckland: CountTable) -> None:
    for side in ("EW", "NS"):
        sensor = f"188 Quay Street Lower Albert ({side})"
        assert np.isnan(auckland.series(sensor)).mean() == pytest.approx(0.52, abs=0.01)
        assert hours_of(auckland, "missing", sensor) == 32129


def test_level_shifts_are_named_and_the_training_year_avoids_them(auckland: CountTable) -> None:
    shifted = {r.sensor for r in auckland.repairs if r.kind == "level shift"}
    assert shifted == {None, *(f"{n} Queen Street" for n in (30, 205, 210, 261, 297))}
    assert TRAIN == ("2024-01-01", "2025-01-01")
    assert TEST[0] > "2025-03-05"
