"""What times people give, and where on the clock they lie."""

from datetime import date, datetime, time

import pytest

from sidestep.crowds.profile import time_of_week
from sidestep.routing.clocks import GridClock, TownClock, next_after, time_given
from sidestep.routing.request import RouteError, TimeOfWeek, read_departure

SATURDAY = TownClock(5 * 24 + 17.5, 0, datetime.fromisoformat("2025-05-24T17:30"))
ANY = TownClock(5 * 24 + 17.5, 0)


@pytest.mark.parametrize(
    ("text", "day", "clock"),
    [
        ("17:30", None, time(17, 30)),
        ("7:30", None, time(7, 30)),
        ("07:30:15", None, time(7, 30, 15)),
        ("Fri 17:30", 4, time(17, 30)),
        ("friday 17:30", 4, time(17, 30)),
        ("Thurs. 0:00", 3, time(0)),
        ("SUN 23:59", 6, time(23, 59)),
    ],
)
def test_times_of_the_week(text: str, day: int | None, clock: time) -> None:
    assert read_departure(text) == TimeOfWeek(clock, day)


@pytest.mark.parametrize("text", ["24:00", "17:60", "Fre 17:30", "Fr 17:30", "Friday", "5 pm", "17:30+02:00", ":30"])
@pytest.mark.parametrize("field", ["depart", "arrive_by", "until", "at"])
def test_other_text_is_no_time(text: str, field: str) -> None:
    with pytest.raises(RouteError) as caught:
        read_departure(text, field)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("start", "text", "seconds"),
    [
        (ANY, "17:30", 0),
        (ANY, "Sat 18:00", 1800),
        (ANY, "4:30", 11 * 3600),  # the next day
        (ANY, "Mon 17:30", 2 * 24 * 3600),
        (ANY, "2025-05-25T17:30", 24 * 3600),
        (SATURDAY, "2025-05-24T18:00", 1800),
        (SATURDAY, "18:00", 1800),
    ],
)
def test_seconds_to_the_next_such_time(start: TownClock, text: str, seconds: float) -> None:
    assert start.clock(read_departure(text), "until") == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("18:00", 9000), ("15:00", 0), ("Sat 18:00", 9000), ("2025-05-24T18:00", 9000), ("2025-05-23T18:00", 0)],
)
def test_the_earliest_departure_before_a_deadline(text: str, seconds: float) -> None:
    start = SATURDAY.earlier(2 * 3600.0)  # 15:30; the deadline is 18:30
    assert start.earliest(read_departure(text), 3 * 3600.0) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("text", "start", "found"),
    [
        ("18:00", "2025-05-24T17:30", "2025-05-24T18:00"),
        ("17:30", "2025-05-24T17:30", "2025-05-24T17:30"),
        ("9:00", "2025-05-24T17:30", "2025-05-25T09:00"),
        ("9:00", "2025-05-24T22:30+00:00", "2025-05-25T09:00"),  # 1:30 in Helsinki
        ("9:00", "Sun 17:30", "Mon 9:00"),
        ("18:00", "Sun 17:30", "Sun 18:00"),
        ("Sat 9:00", "2025-05-24T17:30", "Sat 9:00"),
        ("2025-05-23T09:00", "2025-05-24T17:30", "2025-05-23T09:00"),
        ("9:00", "17:30", "9:00"),
        ("9:00", None, "9:00"),
    ],
)
def test_deadlines_without_a_day_come_after_the_departure(text: str, start: str | None, found: str) -> None:
    assert next_after(read_departure(text), read_departure(start), "Europe/Helsinki") == read_departure(found)


def test_a_deadline_may_be_the_next_morning() -> None:
    assert SATURDAY.due(read_departure("9:00"), "arrive_by") == 15.5 * 3600
    with pytest.raises(RouteError):
        SATURDAY.clock(read_departure("9:00"), "until")


@pytest.mark.parametrize(
    ("text", "found"), [("7:30", datetime.fromisoformat("2025-05-24T07:30")), ("Fri 7:30", TimeOfWeek(time(7, 30), 4))]
)
def test_times_without_a_day_are_of_today_where_that_is_given(text: str, found: object) -> None:
    assert read_departure(text, "at", date(2025, 5, 24)) == found


@pytest.mark.parametrize("text", ["19:00", "Sat 19:00", "2025-05-24T19:00", "Sun 1:00"])
def test_departures_after_the_deadline(text: str) -> None:
    with pytest.raises(RouteError) as caught:
        SATURDAY.earlier(7200.0).earliest(read_departure(text), 3 * 3600.0)
    assert caught.value.field == "depart"


def test_clocks_in_words() -> None:
    assert SATURDAY.facts(1800.0) == {
        "departs": "Saturday 2025-05-24 18:00", "hour_of_week": 138.0, "departure": "2025-05-24T18:00:00",
    }  # fmt: skip
    assert ANY.facts(6.5 * 3600) == {"departs": "Sunday 00:00", "hour_of_week": 144.0}
    assert GridClock(3600.0).facts(150.0) == {"departs": "2.5 min after the start", "departure_minutes": 2.5}


def test_times_that_cannot_be() -> None:
    for start, given in ((SATURDAY, 30.0), (SATURDAY, datetime.fromisoformat("2025-05-24T17:00"))):
        with pytest.raises(RouteError) as caught:
            start.clock(given, "until")
        assert caught.value.field == "until"
    for given in (-1, 60, time(17, 30), float("nan")):
        with pytest.raises(RouteError):
            GridClock(3600.0).clock(given, "until")


@pytest.mark.parametrize(
    ("depart", "until", "hours"),
    [
        ("Fri 20:00", "Fri 17:00", None),
        ("20:00", "17:00", None),
        ("Sat 17:30", "17:00", None),
        ("22:00", "6:00", 8),
        ("Sun 23:00", "Mon 1:00", 2),
    ],
)
def test_windows_that_end_before_they_begin(depart: str, until: str, hours: float | None) -> None:
    hour, _ = time_given(read_departure(depart), 0, "depart", None)
    start = TownClock(hour, 0)
    if hours is None:
        with pytest.raises(RouteError) as caught:
            start.clock(read_departure(until), "until")
        assert caught.value.field == "until"
    else:
        assert start.clock(read_departure(until), "until") == hours * 3600


def test_clocks_that_go_forward_in_between() -> None:
    def at(text: str) -> TownClock:
        date = datetime.fromisoformat(text)
        return TownClock(time_of_week(date), 0, date, timezone="Europe/Helsinki")

    deadline = at("2025-03-30T04:10")
    start = deadline.earlier(3 * 3600.0)
    assert start.facts(0.0)["departure"] == "2025-03-30T00:10:00"
    assert start.facts(3 * 3600.0 - 1800)["departure"] == "2025-03-30T02:40:00"  # 03:40 does not exist
    assert start.facts(3 * 3600.0)["departure"] == "2025-03-30T04:10:00"
    # From ten to three to ten past four is 20 minutes.
    assert at("2025-03-30T02:50").clock(read_departure("2025-03-30T04:10"), "until") == 1200
    # In autumn an hour comes twice.
    twice = at("2025-10-26T04:10").earlier(3 * 3600.0)
    found = [twice.facts(3600.0 * hour)["departure"][11:16] for hour in range(4)]
    assert found == ["02:10", "03:10", "03:10", "04:10"]


NOON = "2025-05-24T12:30"


@pytest.mark.parametrize(
    ("clock", "given"),
    [
        (TownClock(132.5, 0), TimeOfWeek(time(12, 30), 5)),
        (TownClock(-1 / 3600 % 168, 0), TimeOfWeek(time(23, 59, 59), 6)),
        (TownClock(0.0, 0, timed=False), None),
        (TownClock(132.5, 0, datetime.fromisoformat(NOON)), datetime.fromisoformat(NOON)),
    ],
)
def test_clock_0_as_a_departure(clock: TownClock, given: object) -> None:
    assert clock.given == given


def test_clock_0_in_an_hour_that_comes_twice() -> None:
    twice = datetime.fromisoformat("2025-10-26T03:30")  # summer time ends at 4:00
    first, second = (TownClock(0.0, 0, twice.replace(fold=fold), timezone="Europe/Helsinki").given for fold in (0, 1))
    assert [each.isoformat()[-6:] for each in (first, second)] == ["+03:00", "+02:00"]
