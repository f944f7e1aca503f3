"""Counts in the layouts of publishers: what is understood, what is summed, what is missing, what is refused."""

import gzip
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sidestep.crowds.counts import CountsError, CountTable, read_counts
from sidestep.crowds.layouts import Layout, read_columns
from sidestep.errors import SidestepError

Read = Callable[..., CountTable]
NAN = np.nan
FIVE = range(5)


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def read(text: str, **layout: Any) -> CountTable:
        (tmp_path / "quay.csv").write_text(text, encoding="utf-8")
        return read_counts(tmp_path / "quay.csv", Layout(**layout))

    return read


def rows(head: str, cells: Iterable[str]) -> str:
    return "\n".join([head, *cells, ""])


def series(table: CountTable) -> dict[str, list[float]]:
    return {name: table.series(name).tolist() for name in table.sensors}


def day(form: str, hours: Sequence[int] = FIVE, sep: str = ",") -> str:
    return rows(f"time{sep}a", (f"{form.format(hour=hour)}{sep}{hour}" for hour in hours))


# --- Times ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "form",
    [
        "2024-03-25T{hour:02}",
        "2024-03-25 {hour:02}:00:00.000",
        "2024/3/25 {hour}:00",
        "20240325T{hour:02}00",
        "20240325{hour:02}",
        "25/03/2024 {hour:02}:00",
        "25.3.2024 {hour}:00 Uhr",
        "Mon 25/03/2024 {hour}:00",
        "25-03-2024 {hour:02}.00",
        "03/25/2024 {hour:02}:00",
        "March 25, 2024 {hour:02}:00",
        "25 Mar 2024 {hour:02}:00",
        "Monday, 25. März 2024, {hour}:00",
        "2024-03-25 {hour:02}:00 - 24:00",
        "2024-03-25T{hour:02}:00+13:00",
    ],
)
def test_forms_of_times(read: Read, form: str) -> None:
    table = read(day(form, sep=";"))
    assert (str(table.times[0]), series(table)) == ("2024-03-25T00", {"a": [0, 1, 2, 3, 4]})
    assert read(day(form, sep=";"), timezone="Pacific/Auckland").counts.tolist() == table.counts.tolist()


def test_twelve_hours(read: Read) -> None:
    cells = [f"3/25/2024 {hour or 12}:00:00 {half},{hour}" for half in ("AM", "p.m.") for hour in range(12)]
    table = read(rows("time,a", cells))
    assert series(table)["a"] == [*range(12), *range(12)]


def test_midnight_may_be_a_date_alone(read: Read) -> None:  # as R writes it
    table = read(rows("time,a", ["2024-03-24 23:00:00,1", "2024-03-25,2", "2024-03-25 01:00:00,3"]))
    assert series(table) == {"a": [1, 2, 3]}


@pytest.mark.parametrize(
    ("hours", "first"),
    [
        ([f"{hour}" for hour in FIVE], 0),
        ([f"{hour:02}:00" for hour in FIVE], 0),
        ([f"{hour}:00-{hour}:59" for hour in FIVE], 0),
        ([f"{hour:02}00" for hour in FIVE], 0),
        ([f"{hour} am" for hour in range(1, 6)], 1),
        ([f"{hour}" for hour in range(20, 25)], 19),  # no hour 0: hours are numbered by their end
        ([f"{hour:02}:00" for hour in range(20, 25)], 19),
    ],
)
def test_date_and_hour_apart(read: Read, hours: list[str], first: int) -> None:
    table = read(rows("Date;Hour;a", (f"25.03.2024;{hour};7" for hour in hours)))
    assert table.times.astype(str).tolist() == [f"2024-03-25T{first + each:02}" for each in FIVE]
    assert read(rows("D;H;a", (f"25.03.2024;{hour};7" for hour in hours)), date="D", hour="H").sensors == ("a",)


def test_the_order_of_dates(read: Read) -> None:
    unclear = day("01/02/2024 {hour}:00")
    with pytest.raises(CountsError, match=r"1 February 2024 or 2 January 2024") as caught:
        read(unclear)
    assert (caught.value.field, caught.value.line) == ("time", 2)
    for said, first in (("day-first", "2024-02-01"), ("month-first", "2024-01-02"), ("%d/%m/%Y %H:%M", "2024-02-01")):
        assert str(read(unclear, date_format=said).times[0]) == f"{first}T00"
    # One date of the column tells.
    head, *lines = day("01/02/2024 {hour}:00", range(24)).splitlines()
    more = [line.replace("01/02", f"{date:02}/02") for date in range(2, 14) for line in lines]
    table = read(rows(head, lines + more))
    assert str(table.times[0]) == "2024-02-01T00"
    assert any("'13/02/2024 0:00' in line 290" in said for said in table.understood)


@pytest.mark.parametrize(
    ("second", "line"),
    [
        ("25/03/2024 01:00", 3),
        ("2024/03/25 01:00", 3),
        ("2024-03-25T01:00Z", 3),
        ("2024-03-25 01:00 AM", 3),
        ("25 March 2024 01:00", 3),
    ],
)
def test_two_formats_in_one_file(read: Read, second: str, line: int) -> None:
    with pytest.raises(CountsError) as caught:
        read(rows("time,a", ["2024-03-25 00:00,1", f"{second},2"]))
    assert (caught.value.field, caught.value.line) == ("time", line)
    with pytest.raises(CountsError) as caught:
        read(rows("time,a", ["25/03/2024 00:00,1", "03/25/2024 01:00,2"]))
    assert (caught.value.field, caught.value.line) == ("time", 3)


def test_day_and_month_may_be_the_same(read: Read) -> None:
    assert str(read(day("05/05/2024 {hour}:00")).times[0]) == "2024-05-05T00"


def test_formats_that_are_said(read: Read) -> None:
    for said in ("%d/%m/%y %H:%M", "day-first"):
        assert str(read(day("01/02/24 {hour}:00"), date_format=said).times[0]) == "2024-02-01T00"
    for form, said, field in (
        ("25/02/24 {hour}:00", "", "time"),
        ("25/02/2024 {hour}:00", "month-first", "time"),
        ("25/02/2024 {hour}:00", "%Y", "time"),
        ("25/02/2024 {hour}:00", "dd/mm", "date_format"),
        ("30/02/2024 {hour}:00", "", "time"),
        ("25/02/2024 {hour}:61", "", "time"),
        ("9999-12-31 {hour}:00", "", "time"),
        ("0024-12-31 {hour}:00", "", "time"),
        ("2024-12-31 {hour}:00+99:00", "", "time"),
        ("25 marraskuu 2024 {hour}:00", "", "time"),  # November, which is no March
    ):
        with pytest.raises(CountsError) as caught:
            read(day(form), date_format=said)
        assert caught.value.field == field


# --- Intervals ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("minutes", [1, 5, 10, 15, 20, 30])
def test_short_intervals_are_summed_and_said(read: Read, minutes: int) -> None:
    each = range(0, 60, minutes)
    table = read(rows("time,a", (f"2024-03-25T{hour:02}:{minute:02},{hour}" for hour in FIVE for minute in each)))
    assert series(table) == {"a": [hour * len(each) for hour in FIVE]}
    assert f"counts of {minutes} minutes summed to hours" in table.understood


def test_hours_that_were_not_counted_whole_are_missing(read: Read) -> None:
    each = [f"2024-03-25T{hour:02}:{minute:02}" for hour in FIVE for minute in (0, 15, 30, 45)]
    cells = [f"{time},1" for time in each if time[-5:] not in ("00:00", "02:30", "04:45")]
    cells[1] = cells[1].replace(",1", ",")  # 0:30
    table = read(rows("time,a", cells))
    # The first and the last hour are incomplete: they are left out.
    assert (str(table.times[0]), str(table.times[-1])) == ("2024-03-25T01", "2024-03-25T03")
    np.testing.assert_array_equal(table.series("a"), [4, NAN, 4])
    assert {repair.kind: repair.hours for repair in table.repairs} == {"incomplete hour": 3}
    table = read(rows("time,a", (f"2024-03-25T{hour:02}:00,{'' if hour == 2 else 1}" for hour in FIVE)))
    assert {repair.kind: repair.hours for repair in table.repairs} == {"missing": 1}


def test_intervals_named_by_their_end(read: Read) -> None:
    each = [(hour, minute) for hour in range(25) for minute in (0, 30) if 0 < hour + minute / 60 <= 24]
    table = read(rows("time,a", (f"2024-03-25 {hour:02}:{minute:02},1" for hour, minute in each)))
    assert (str(table.times[0]), series(table)) == ("2024-03-25T00", {"a": [2] * 24})


@pytest.mark.parametrize(
    ("times", "field"),
    [
        (["2024-03-25", "2024-03-26"], "time"),
        (["2024-03-25T00:00", "2024-03-26T00:00"], "time"),
        (["2024-03-25T00:00", "2024-04-01T00:00"], "time"),
        (["2024-03-25T00:00", "2024-03-25T02:00"], "time"),
        (["2024-03-25T00:00", "2024-03-25T00:07"], "time"),
        (["2024-03-25T00:00:00", "2024-03-25T00:00:30"], "time"),
        (["2024-03-25T00:30", "2024-03-25T01:30"], "time"),
    ],
)
def test_hours_are_needed(read: Read, times: list[str], field: str) -> None:
    with pytest.raises(CountsError) as caught:
        read(rows("time,a", (f"{time},5" for time in times)))
    assert caught.value.field == field


def test_totals_of_days_say_that_hours_are_needed(read: Read) -> None:
    for form in ("2024-03-{:02}", "2024-03-{:02}T00:00", "{}/3/2024"):
        with pytest.raises(CountsError, match="hours are needed"):
            read(rows("time,North,South", (f"{form.format(day)},14,39" for day in range(4, 30))))


@pytest.mark.parametrize(
    "form", ["{}", "{:02}:00", "h{}", "Hour {}", "hour_{:02}", "{:02}:00-{:02}:59", "Stunde {}", "{:02}00"]
)
def test_hours_side_by_side_are_not_called_totals(read: Read, form: str) -> None:
    names = ",".join(form.format(hour, hour) for hour in range(24))
    cells = ",".join(map(str, range(24)))
    for head, row in ((f"date,{names}", "2024-03-{:02},"), (f"sensor,date,{names},total", "a,2024-03-{:02},")):
        with pytest.raises(CountsError, match="hours of the day side by side") as caught:
            read(rows(head, (f"{row.format(day)}{cells}" + ",276" * head.endswith("total") for day in range(1, 30))))
        assert caught.value.field == "date"
    few = ",".join(f"sensor {number}" for number in range(24))
    with pytest.raises(CountsError, match="totals"):
        read(rows(f"date,{few}", (f"2024-03-{day:02},{cells}" for day in range(1, 30))))


# --- Clock changes --------------------------------------------------------------------------------------------------


def test_the_doubled_hour_is_missing(read: Read) -> None:
    hours = (0, 1, 2, 2, 3)
    wide = rows("time,a,b", (f"2024-10-27T{hour:02}:00,5,6" for hour in hours))
    long = rows("time,sensor,count", (f"2024-10-27T{hour:02}:00,{each},5" for hour in hours for each in "ab"))
    short = rows("time,a", (f"2024-10-27T{hour:02}:{minute:02},5" for hour in hours for minute in (0, 15, 30, 45)))
    offset = [f"2024-10-27T{hour:02}:00+0{2 - (number > 2)}:00,5" for number, hour in enumerate(hours)]
    for text in (wide, long, short, rows("time,a", offset)):
        for timezone in (None, "Europe/Berlin"):
            table = read(text, timezone=timezone)
            assert np.isnan(table.counts).all(axis=1).tolist() == [False, False, True, False]
            assert [(each.kind, each.hours) for each in table.repairs] == [("clock back", 1)]


def test_where_the_timezone_is_known_its_clock_counts(read: Read) -> None:
    once = rows("time,a", (f"2024-10-27T{hour:02}:00,5" for hour in FIVE))
    np.testing.assert_array_equal(read(once).series("a"), [5, 5, 5, 5, 5])
    table = read(once, timezone="Europe/Berlin")
    np.testing.assert_array_equal(table.series("a"), [5, 5, NAN, 5, 5])
    utc = rows("time,a", (f"2024-10-27T{hour:02}:00Z,{hour}" for hour in FIVE))
    table = read(utc, timezone="Europe/Berlin")
    assert str(table.times[0]) == "2024-10-27T02"
    np.testing.assert_array_equal(table.series("a"), [NAN, 2, 3, 4])
    with pytest.raises(CountsError) as caught:
        read(utc)
    assert (caught.value.field, caught.value.line) == ("time", 2)


@pytest.mark.parametrize(
    ("timezone", "first", "found"),
    [
        ("Asia/Kolkata", "2024-04-06T21", [2] * 7),
        ("Australia/Lord_Howe", "2024-04-07T02", [2] * 7),  # after the clock went back half an hour
        ("Australia/Adelaide", "2024-04-07T01", [2, NAN, 2, 2, 2, 2, 2]),  # back from 3:00 to 2:00
    ],
)
def test_clocks_at_half_hours_of_utc(read: Read, timezone: str, first: str, found: list[float]) -> None:
    begin = np.datetime64("2024-04-06T13:30")
    text = rows("time,a", (f"{begin + np.timedelta64(30 * step, 'm')}Z,1" for step in range(24)))
    table = read(text, timezone=timezone)
    hours = table.times.astype(str).tolist()
    np.testing.assert_array_equal(table.series("a")[hours.index(first) :][:7], found[: len(hours) - hours.index(first)])


def test_the_skipped_hour(read: Read) -> None:
    for cells in ([5, 5, 0, 5], [5, 5, "", 5], [5, 5, None, 5]):
        table = read(
            rows("time,a", (f"2024-03-31T{hour:02}:00,{n}" for hour, n in enumerate(cells) if n is not None)),
            timezone="Europe/Berlin",
        )
        np.testing.assert_array_equal(table.series("a"), [5, 5, NAN, 5])
        assert [(each.kind, each.hours) for each in table.repairs] == [("clock forward", 1)]
    people = rows("time,a", (f"2024-03-31T{hour:02}:00,5" for hour in FIVE))
    with pytest.raises(CountsError, match="does not exist") as caught:
        read(people, timezone="Europe/Berlin")
    assert (caught.value.field, caught.value.line) == ("time", 4)
    assert not np.isnan(read(people).counts).any()


@pytest.mark.parametrize(
    ("text", "timezone", "line"),
    [
        (rows("time,a", (f"2024-10-28T{hour:02}:00,5" for hour in (0, 1, 1, 2))), None, 4),
        (rows("time,a", (f"2024-10-27T{hour:02}:00,5" for hour in (0, 1, 2, 2, 2))), None, 5),
        (rows("time,a", (f"2024-10-27T{hour:02}:00,5" for hour in (0, 1, 2, 2, 3))), "Europe/Helsinki", 5),
        (rows("time,sensor,count", ["2024-10-28T00,a,5", "2024-10-28T01,a,5", "2024-10-28T01,a,6"]), None, 4),
    ],
)
def test_other_times_must_not_come_twice(read: Read, text: str, timezone: str | None, line: int) -> None:
    with pytest.raises(CountsError) as caught:
        read(text, timezone=timezone)
    assert (caught.value.field, caught.value.line) == ("time", line)


def test_rows_in_order(read: Read) -> None:
    assert series(read(day("2024-03-25T{hour:02}", (4, 3, 2, 1)))) == {"a": [1, 2, 3, 4]}  # the newest first
    with pytest.raises(CountsError) as caught:
        read(day("2024-03-25T{hour:02}", (1, 2, 4, 3)))
    assert (caught.value.field, caught.value.line) == ("time", 5)


# --- Columns --------------------------------------------------------------------------------------------------------

LONG = rows(
    "Date_Time,Sensor_ID,Sensor_Name,Hourly_Counts",
    (
        f"March 04, 2024 {hour:02}:00:00 PM,{number},{name},{hour + number}"
        for hour in range(1, 6)
        for number, name in ((4, "Hall"), (5, "Quay, N"))
    ),
)


def test_a_long_table(read: Read) -> None:
    found = {"Hall": [5, 6, 7, 8, 9], "Quay, N": [6, 7, 8, 9, 10]}
    quoted = LONG.replace("Quay, N", '"Quay, N"')
    table = read(quoted)
    assert (str(table.times[0]), series(table)) == ("2024-03-04T13", found)
    assert series(read(quoted.replace("March 04, 2024", '"March 04, 2024').replace(" PM", ' PM"'))) == found
    assert (
        series(read(LONG.replace("Quay, N", "Quay").replace(",", ";").replace("04; ", "04, ")))["Hall"] == found["Hall"]
    )
    strange = quoted.replace("Date_Time,Sensor_ID,Sensor_Name,Hourly_Counts", "Wann,Nr,Wo,Wie viele")
    with pytest.raises(CountsError) as caught:
        read(strange)
    assert caught.value.field == "Wann"
    assert series(read(strange, **read_columns(["time=Wann,sensor=Wo", "count=Wie viele"]))) == found
    assert series(read(strange, **read_columns(["time=Wann,sensor=Nr,count=Wie viele"]))) == dict(
        zip("45", found.values(), strict=True)
    )


def test_rows_of_a_long_table_in_any_order_and_number(read: Read) -> None:
    head, *lines = LONG.replace("Quay, N", "Quay").splitlines()
    table = read(rows(head, lines[:0:-1]))  # without the Hall at 13 h
    np.testing.assert_array_equal(table.series("Hall"), [NAN, 6, 7, 8, 9])
    assert [(each.kind, each.sensor, each.hours) for each in table.repairs] == [("missing", "Hall", 1)]


def test_sensors_are_told_apart_by_their_numbers(read: Read) -> None:
    cells = [f"2024-03-04 {hour:02}:00,{id_},Quay,{id_}" for hour in FIVE for id_ in (7, 8)]
    assert series(read(rows("time,sensor_id,sensor,count", cells))) == {"Quay (7)": [7] * 5, "Quay (8)": [8] * 5}
    renamed = [f"2024-03-04 {hour:02}:00,7,Quay{hour // 3},{hour}" for hour in FIVE]
    assert series(read(rows("time,sensor_id,sensor,count", renamed))) == {"Quay1": [0, 1, 2, 3, 4]}


@pytest.mark.parametrize(
    ("head", "cells", "layout", "found"),
    [
        ("time,Quay in,Quay out,Hall", "1,2,5", {}, {"Quay": 3, "Hall": 5}),
        ("time,Quay (Northbound),Quay (Southbound)", "1,2", {}, {"Quay": 3}),
        ("time,Quay,Quay IN,Quay OUT", "9,4,5", {}, {"Quay": 9}),
        ("time,Quay In,Quay Out,Quay Total,Hall", "1,2,4,5", {}, {"Quay": 4, "Hall": 5}),
        ("time,Quay In,Quay Out,Quay Total,Quay Sum", "1,2,4,5", {}, {"Quay": 4}),
        ("time,In,Out,Total", "1,2,4", {}, {"quay": 4}),
        ("time,Quay,Hall,Total", "1,2,3", {}, {"Quay": 1, "Hall": 2}),
        ("time,Total,Rain", "3,9", {}, {"Total": 3}),
        ("time,in,out", "1,2", {}, {"quay": 3}),
        ("time,sensor,Direction_1,Direction_2", "Quay,1,2", {}, {"Quay": 3}),
        ("time,sensor,in,out,total", "Quay,1,2,3", {}, {"Quay": 3}),
        ("time,sensor,left,right", "Quay,1,2", {"count": ("left+right",)}, {"Quay": 3}),
        ("time,sensor,left,right", "Quay,1,2", {"count": ("left", "right")}, {"Quay": 3}),
        ("time,left,right,rain", "1,2,9", {"count": ("left+right",)}, {"quay": 3}),
        ("time,a+b,b", "1,2", {"count": ("a+b",)}, {"quay": 1}),
        # Compass words may be names of sensors.
        ("time,Quay North,Quay South", "1,2", {}, {"Quay North": 1, "Quay South": 2}),
        ("time,North,South", "1,2", {}, {"North": 1, "South": 2}),
        ("time,Quay in,Hall out", "1,2", {}, {"Quay in": 1, "Hall out": 2}),
    ],
)  # fmt: skip
def test_directions_in_columns(
    read: Read, head: str, cells: str, layout: dict[str, Any], found: dict[str, float]
) -> None:
    table = read(rows(head, (f"2024-03-04T{hour:02}:00,{cells}" for hour in FIVE)), **layout)
    assert series(table) == {name: [count] * 5 for name, count in found.items()}
    summed = (
        len(found) < cells.count(",") + 1 - cells.count("Quay") and "IN" not in head and "total" not in head.lower()
    )
    assert any("directions summed" in said for said in table.understood) == (summed and head != "time,a+b,b")


def test_directions_in_rows(read: Read) -> None:
    cells = [f"2024-03-04T{hour:02}:00,Quay,{way},{hour}" for hour in FIVE for way in "NS" if (hour, way) != (3, "S")]
    for head, layout in (("time,sensor,direction,count", {}), ("time,sensor,way,count", {"direction": "way"})):
        table = read(rows(head, cells), **layout)
        np.testing.assert_array_equal(table.series("Quay"), [0, 2, 4, NAN, 8])  # one direction alone is no count
        assert any("directions summed" in said for said in table.understood)
    with pytest.raises(CountsError) as caught:
        read(rows("time,sensor,way,count", cells))
    assert (caught.value.field, caught.value.line) == ("time", 3)


def test_columns_that_are_left_out_are_said(read: Read) -> None:
    cells = [f"{hour},2024-03-04T{hour:02}:00,Mon,5,rain" for hour in FIVE]
    table = read(rows("id,time,weekday,Quay,weather", cells), ignore=("weather",))
    assert series(table) == {"Quay": [5] * 5}
    assert "columns left out: 'id', 'weekday', 'weather'" in table.understood
    with pytest.raises(CountsError) as caught:
        read(rows("id,time,weekday,Quay,weather", cells))
    assert (caught.value.field, caught.value.line) == ("weather", 2)


@pytest.mark.parametrize(
    ("layout", "field"),
    [
        ({"sensor": "Ort"}, "Ort"),
        ({"time": "When"}, "When"),
        ({"count": ("a+x",)}, "x"),
        ({"time": "time", "sensor": "time"}, "time"),
        ({"date": "time"}, "time"),
        ({"time": "a", "date": "time", "hour": "b"}, "time"),
        ({"sensor": "b"}, "count"),
        ({"time": "a"}, "a"),
        ({"timezone": "Europe/Helsinky"}, "timezone"),
        ({"time": "time+a"}, "time"),
        ({"time": "time + b", "sensor": "a"}, "time"),
        ({"date": "time+a", "hour": "b"}, "date"),
        ({"date": "time", "hour": "a+b"}, "hour"),
        ({"sensor": "a+b"}, "sensor"),
        ({"sensor": "a", "direction": "a+b"}, "direction"),
        ({"latitude": "a+b", "longitude": "a"}, "latitude"),
        ({"latitude": "a", "longitude": "a+b"}, "longitude"),
    ],
)
def test_columns_that_do_not_exist(read: Read, layout: dict[str, Any], field: str) -> None:
    with pytest.raises(SidestepError) as caught:
        read(rows("time,a,b", ["2024-03-04T00,1,2"]), **layout)
    assert caught.value.field == field
    assert "\n" not in str(caught.value)


def test_a_name_may_have_a_plus_in_it(read: Read) -> None:
    assert series(read(rows("time + date,a", [f"2024-03-04T{hour:02},1" for hour in FIVE]), time="time + date"))


@pytest.mark.parametrize(
    "options", [["time"], ["time="], ["when=a"], ["time=a,time=b"], ["time=a", "time=b"], ["=a"], [""]]
)
def test_options_that_name_no_columns(options: list[str]) -> None:
    with pytest.raises(SidestepError) as caught:
        read_columns(options)
    assert caught.value.field == "columns"
    assert read_columns(["time=When, then,sensor= Where ", "count=a+b"]) == {
        "time": "When, then",
        "sensor": "Where",
        "count": ("a+b",),
    }


# --- Cells ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sep", [",", ";", "\t", "|"])
def test_separators_preambles_and_what_follows(read: Read, sep: str) -> None:
    table = f"Time{sep}Quay{sep}Hall{sep}\n" + "".join(
        f"2024-03-04 {hour:02}:00{sep}{hour}{sep}7{sep}\n" for hour in FIVE
    )
    for above in (
        "",
        "City of X\nExported 2024-05-01\n\n",
        f"City of X{sep * 3}\nPeriod{sep}March 2024{sep * 2}\n{sep * 3}\n",
    ):
        for text in (above + table, (above + table).replace(f"{sep}\n", "\n")):
            assert series(read(text)) == {"Quay": [0, 1, 2, 3, 4], "Hall": [7] * 5}


@pytest.mark.parametrize(
    ("cells", "sep", "decimal", "found"),
    [
        (["12,5", "7"], ";", "", [12.5, 7]),
        (["12,5", "7"], "\t", "", [12.5, 7]),
        (["1.234,5", "7"], ";", "", [1234.5, 7]),
        (["1,234.5", "7"], ";", "", [1234.5, 7]),
        (['"1,234"', "7"], ",", "", [1234, 7]),
        (['"12,5"', "7"], ",", "", [12.5, 7]),
        (["1.234", "7"], ",", "", [1.234, 7]),
        (["1,234", "1234"], ";", "", [1.234, 1234]),
        (["0,234", "1"], ";", "", [0.234, 1]),
        (["1.234", "2,5"], ";", "", [1234, 2.5]),
        (["1,234", "7"], ";", ",", [1.234, 7]),
        (["1,234", "7"], ";", ".", [1234, 7]),
        (["1.234", "7"], ";", ",", [1234, 7]),
        (["1'234", "1\u00a0234"], ";", "", [1234, 1234]),
        (["1e3", "+5"], ",", "", [1000, 5]),
        (["NA", "n/a"], ",", "", [NAN, NAN]),
        (["#N/A", "5"], ";", "", [NAN, 5]),
        (["", "-"], ",", "", [NAN, NAN]),
    ],
)
def test_numbers(read: Read, cells: list[str], sep: str, decimal: str, found: list[float]) -> None:
    text = rows(f"time{sep}a", (f"2024-03-04T{hour:02}:00{sep}{cell}" for hour, cell in enumerate(["1", *cells])))
    np.testing.assert_array_equal(read(text, decimal=decimal).series("a"), [1, *found])


@pytest.mark.parametrize(
    ("cell", "sep", "line"),
    [
        ("-1", ",", 4),
        ("1000001", ",", 4),
        ("1e999", ",", 4),
        ("2e6", ",", 4),
        ("inf", ",", 4),
        ("0x10", ",", 4),
        ("1_0", ",", 4),
        ("1.2.3", ",", 4),
        ("many", ",", 4),
        ("1,234", ";", None),  # 1234 or 1.234
        ("1.234", ";", None),
        ("1,5", ";", None),  # beside 2.5
    ],
)
def test_numbers_that_are_none(read: Read, cell: str, sep: str, line: int | None) -> None:
    other = "2.5" if cell == "1,5" else "2"
    text = rows(f"time{sep}a", (f"2024-03-04T{hour:02}:00{sep}{each}" for hour, each in enumerate([other, "3", cell])))
    with pytest.raises(CountsError) as caught:
        read(text)
    assert (caught.value.field, caught.value.line) == ("a", line)


# --- Lines that are no rows -----------------------------------------------------------------------------------------

WIDE = [f"2024-03-04T{hour:02}:00;1;2" for hour in FIVE]


@pytest.mark.parametrize(
    ("above", "below"),
    [
        ([";persons/h;persons/h"], []),
        (["[local]; ; [1/h]"], []),
        ([], ["Total;5;10"]),
        ([], ["", "Grand total: ;5;1.234,5", "Mean;1,0;2,0"]),
        ([], ["Source: the city"]),
        (["ISO 8601;number;number"], ["Summe;5;10", "# end", "Licence: CC BY"]),
    ],
)
def test_units_totals_and_remarks_are_skipped_and_said(read: Read, above: list[str], below: list[str]) -> None:
    table = read(rows("time;a;b", [*above, *WIDE, *below]))
    assert series(table) == {"a": [1] * 5, "b": [2] * 5}
    number = len(above) + sum(map(bool, below))
    assert f"lines of units, totals and remarks skipped: {number}" in table.understood


@pytest.mark.parametrize(
    ("head", "cells"),
    [
        (",a", "{time},{hour}"),  # as pandas writes an index, of times or numbers
        (",time,a", "{hour},{time},{hour}"),
        (",time,a", "45 Queen Street,{time},{hour}"),  # whose name is like a date
        ("Unnamed: 0,time,a", "{hour},{time},{hour}"),
        ("start,end,a", "{time},2024-03-05T00:00,{hour}"),
    ],
)
def test_columns_beside_counts(read: Read, head: str, cells: str) -> None:
    table = read(rows(head, (cells.format(time=f"2024-03-04 {hour:02}:00", hour=hour) for hour in FIVE)))
    assert series(table) == {"a": [*FIVE]}


def test_a_sensor_may_be_called_total(read: Read) -> None:
    cells = [f"{name},2024-03-04T{hour:02}:00,5" for hour in FIVE for name in ("Quay", "Total")]
    assert series(read(rows("sensor,time,count", cells))) == {"Quay": [5] * 5, "Total": [5] * 5}


@pytest.mark.parametrize(
    ("cells", "line"),
    [
        ([*WIDE[:2], "Total;5;10", *WIDE[2:]], 4),  # in the middle
        ([*WIDE[:2], "Source: the city", *WIDE[2:]], 4),
        ([*WIDE, ";5;10"], 7),
        ([*WIDE, "yesterday;5;10"], 7),
        ([*WIDE, "2024-03-04T05:00;5"], 7),  # cut short
        (["yesterday;5;10", *WIDE], 2),
    ],
)
def test_rows_without_a_time_are_none(read: Read, cells: list[str], line: int) -> None:
    with pytest.raises(CountsError) as caught:
        read(rows("time;a;b", cells))
    assert caught.value.line == line


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (gzip.compress(b"time,a", mtime=0), "gzip"),
        (b"PK\x03\x04xl/workbook.xml", "Excel"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1", "Excel"),
        (b"PAR1\x15\x04", "Parquet"),
        (b"<!DOCTYPE html><html/>", "web page"),
        (b'[{"time": "2024-03-04T00:00", "a": 5}]', "JSON"),
    ],
)
def test_other_files_are_named_for_what_they_are(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "c.csv").write_bytes(content)
    with pytest.raises(CountsError, match=said):
        read_counts(tmp_path / "c.csv")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "c.csv"
    path.write_text(rows("time;Straße", (f"2024-03-04T{hour:02}:00;1" for hour in FIVE)), encoding=encoding)
    assert read_counts(path).sensors == ("Straße",)
    path.write_text(path.read_text(encoding), encoding="latin-1", errors="replace")
    with pytest.raises(CountsError, match="UTF-8"):
        read_counts(path)


# --- Faults ---------------------------------------------------------------------------------------------------------


def test_faults_are_repaired_as_in_the_bundled_counts(read: Read) -> None:
    times = np.datetime64("2024-03-04T00", "h") + np.arange(12 * 168)
    hour = np.arange(len(times)) % 24
    usual = np.where(hour < 6, 10.0, 200.0)
    dead, spiked = usual.copy(), usual.copy()
    dead[24 * 28 : 24 * 38] = 0
    spiked[[500, 900]] = 60_000
    table = read(rows("time,dead,spiked", map("{},{:g},{:g}".format, times, dead, spiked)))
    assert [(each.kind, each.sensor, each.hours) for each in table.repairs] == [
        ("dead sensor", "dead", 240),
        ("spike", "spiked", 2),
    ]
    assert np.flatnonzero(np.isnan(table.series("spiked"))).tolist() == [500, 900]
    assert np.isnan(table.series("dead")[24 * 28 : 24 * 38]).all()


@pytest.mark.parametrize("form", ["{}", "{}000", "{}.0"])
def test_seconds_since_1970(read: Read, form: str) -> None:
    begins = 1711368000  # 2024-03-25T12:00 in UTC, 25 hours after midnight in Auckland
    text = rows("timestamp,a", (f"{form.format(begins + 3600 * hour)},{hour}" for hour in FIVE))
    table = read(text, timezone="Pacific/Auckland")
    assert (str(table.times[0]), series(table)) == ("2024-03-26T01", {"a": [0, 1, 2, 3, 4]})
    assert any("since 1970" in said for said in table.understood)
    with pytest.raises(CountsError) as caught:
        read(text)
    assert (caught.value.field, caught.value.line) == ("timestamp", 2)
    mixed = text.replace(form.format(begins + 3600), "2024-03-25T13:00")
    with pytest.raises(CountsError) as caught:
        read(mixed, timezone="Pacific/Auckland")
    assert (caught.value.field, caught.value.line) == ("timestamp", 3)


# --- Places ---------------------------------------------------------------------------------------------------------

QUAY, HALL = (-36.84, 174.76), (-36.85, 174.77)


@pytest.mark.parametrize(
    ("head", "form"),
    [
        ("time,site,count,Latitude,Longitude", "{0},{1},{2},{3},{4}"),
        ("lon,lat,time,site,count", "{4},{3},{0},{1},{2}"),
        ("time,Sensor_Name,Location,count", '{0},{1},"{3}, {4}",{2}'),
        ("time,site,geo_point_2d,count", '{0},{1},"({3}, {4})",{2}'),
        ("time;site;count;lat;lon", "{0};{1};{2};{3};{4}"),
    ],
)
def test_columns_of_places(read: Read, head: str, form: str) -> None:
    cells = [
        form.format(f"2024-03-25T0{hour}:00", name, hour, *place)
        for hour in FIVE
        for name, place in (("Quay", QUAY), ("Hall", HALL))
    ]
    table = read(rows(head, cells))
    assert series(table) == {"Quay": [0, 1, 2, 3, 4], "Hall": [0, 1, 2, 3, 4]}
    assert table.positions is not None
    assert table.positions.tolist() == [list(QUAY), list(HALL)]
    assert any(said.startswith("positions of sensors in ") for said in table.understood)


def test_places_may_be_named_and_stand_in_some_rows(read: Read) -> None:
    text = "time,site,count,y,x\n2024-03-25T00,Quay,1,,\n2024-03-25T01,Quay,2,-36.84,174.76\n"
    table = read(text, latitude="y", longitude="x")
    assert table.positions is not None
    assert table.positions.tolist() == [list(QUAY)]
    assert read(text).positions is None
    empty = text.replace("-36.84,174.76", ",").replace(",y,x", ",lat,lon")
    assert read(empty).positions is None
    assert read_columns(["latitude=y,longitude=x"]) == {"latitude": "y", "longitude": "x"}


def test_a_wide_table_of_one_sensor_may_have_its_place(read: Read) -> None:
    text = rows("time,lat,lon,Quay", (f"2024-03-25T0{hour},-36.84,174.76,{hour}" for hour in FIVE))
    table = read(text)
    assert (series(table), table.positions is not None) == ({"Quay": [0, 1, 2, 3, 4]}, True)
    both = read(text.replace("lon,Quay", "lon,Quay,Hall").replace("174.76,", "174.76,1,"))
    assert (both.sensors, both.positions) == (("Quay", "Hall"), None)
    assert any("'lat', 'lon'" in said for said in both.understood)


@pytest.mark.parametrize(
    ("text", "layout", "field", "line"),
    [
        ("time,site,count,lat,lon\n2024-03-25T00,Quay,1,174.76,-36.84\n", {}, "lat", 2),  # swapped
        ("time,site,count,lat,lon\n2024-03-25T00,Quay,1,60,here\n", {}, "lon", 2),
        ("time,site,count,lat,lon\n2024-03-25T00,Quay,1,60,24\n2024-03-25T01,Quay,1,60.01,24\n", {}, "lat", 2),
        ("time,site,count,lat,lon\n2024-03-25T00,Quay,1,60,24\n2024-03-25T00,Hall,1,,\n", {}, "lat", None),
        ("time,site,count,lat,lon\n2024-03-25T00,Quay,1,60,24\n", {"latitude": "lat"}, "latitude", None),
        ("time,site,count,lat,lon\n2024-03-25T00,Quay,1,60,24\n", {"latitude": "y", "longitude": "lon"}, "y", None),
    ],
)
def test_places_that_are_none(read: Read, text: str, layout: dict[str, str], field: str, line: int | None) -> None:
    with pytest.raises(CountsError) as caught:
        read(text, **layout)
    assert (caught.value.field, caught.value.line) == (field, line)
    assert "\n" not in str(caught.value)
    if not layout:  # and what there is to do about it
        assert read(text, ignore=("lat", "lon")).positions is None
