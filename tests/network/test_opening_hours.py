"""Opening times: the common grammar, what is not read, and canonical texts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.network.opening_hours import (
    WEEK,
    conditional_values,
    names_special_days,
    open_minutes,
    opening_text,
)

DAYS = ("Mo", "Tu", "We", "Th", "Fr", "Sa", "Su")


def week(**spans: list[tuple[int, int]]) -> np.ndarray:
    """Open minutes from the hours of some days; an hour above 24 is on the next day."""
    minutes = np.zeros(WEEK, bool)
    for day, hours in spans.items():
        for begin, end in hours:
            at = (DAYS.index(day) * 1440 + np.arange(begin * 60, end * 60)) % WEEK
            minutes[at] = True
    return minutes


def daily(*hours: tuple[int, int]) -> np.ndarray:
    return week(**{day: list(hours) for day in DAYS})


WORKING = {day: [(8, 18)] for day in DAYS[:5]}


@pytest.mark.parametrize(
    ("text", "minutes", "canonical"),
    [
        ("", daily((0, 24)), ""),
        ("24/7", daily((0, 24)), ""),
        ("open", daily((0, 24)), ""),
        ("00:00-24:00", daily((0, 24)), ""),
        ("off", week(), "off"),
        ("closed", week(), "off"),
        ("8:00-18:00", daily((8, 18)), "08:00-18:00"),
        ("Mo-Fr 08:00-18:00; Sa,Su 10:00-16:00", week(**WORKING, Sa=[(10, 16)], Su=[(10, 16)]), None),
        ("mo-fr 08.00–18.00", week(**WORKING), "Mo-Fr 08:00-18:00"),
        ("Mon-Friday 08:00 - 18:00;", week(**WORKING), "Mo-Fr 08:00-18:00"),
        ('Mo-Fr: 08:00-18:00 open "by the sea"', week(**WORKING), "Mo-Fr 08:00-18:00"),
        ("22:00-06:00", daily((22, 30)), None),
        ("10:00-26:00", daily((10, 26)), "10:00-02:00"),
        ("Su 22:00-06:00", week(Su=[(22, 30)]), None),
        ("Sa-Mo 10:00-12:00,14:00-15:00", week(**{day: [(10, 12), (14, 15)] for day in ("Sa", "Su", "Mo")}), None),
        ("Mo-Fr", week(**{day: [(0, 24)] for day in DAYS[:5]}), "Mo-Fr 00:00-24:00"),
        # Later rules replace earlier ones on their days, with the spans that begin on these.
        ("08:00-18:00; Sa-Su off", week(**WORKING), "Mo-Fr 08:00-18:00"),
        ("Mo-Sa 08:00-18:00; Sa 22:00-26:00", week(**WORKING, Sa=[(22, 26)]), None),
        ("24/7; 22:00-06:00 off", daily((6, 22)), "06:00-22:00"),
        ("22:00-06:00; Tu off", week(**{day: [(22, 30)] for day in DAYS if day != "Tu"}), "Mo,We-Su 22:00-06:00"),
        # After a comma they add to them.
        ("Mo 10:00-12:00, Mo,Tu 14:00-15:00", week(Mo=[(10, 12), (14, 15)], Tu=[(14, 15)]), None),
        ("Mon,Tue 10:00-12:00", week(Mo=[(10, 12)], Tu=[(10, 12)]), "Mo,Tu 10:00-12:00"),
        # Holidays are ignored.
        ("Mo-Fr 08:00-18:00; PH off", week(**WORKING), "Mo-Fr 08:00-18:00"),
        ("Mo-Fr,PH 08:00-18:00; SH Mo 12:00-13:00", week(**WORKING), "Mo-Fr 08:00-18:00"),
        # So are single dates.
        ("Mo-Fr 08:00-18:00; Dec 25 off", week(**WORKING), "Mo-Fr 08:00-18:00"),
        ("Mo-Fr 08:00-18:00; Jan 1,Dec 24-26 off", week(**WORKING), None),
        ("Dec 24, 31 08:00-12:00; Mo-Fr 08:00-18:00, Dec 25-Jan 1 off; easter +1 day off", week(**WORKING), None),
        ('Mo-Fr 08:00-18:00 || closed "at weekends"', week(**WORKING), "Mo-Fr 08:00-18:00"),
    ],
)
def test_times_that_are_read(text: str, minutes: np.ndarray, canonical: str | None) -> None:
    read = open_minutes(text)
    assert read is not None
    np.testing.assert_array_equal(read, minutes)
    if canonical is not None:
        assert opening_text(read) == canonical


@pytest.mark.parametrize(
    "text",
    [
        "sunrise-sunset", "dawn-22:00", "Apr-Oct 08:00-20:00", "2026 Mo 10:00-12:00",
        "week 1-20 Mo 10:00-12:00", "Mo[1] 10:00-12:00", "08:00+", "Mo-Fr 08:00-18:00/01:30",
        'Mo-Fr 08:00-18:00 || "call"', 'Mo-Fr 08:00-18:00 "by appointment"', '"by appointment"', "unknown",
        "25:00-26:00", "10:70-11:00", "10:00", "8-18", "7am-9pm", "06:00-22:00 AND wet", "(22:00-06:00)",
        "24/7, 04:00-06:00 off", "PH off", "Su off", "PH 10:00-12:00",
        "Nov 1-Mar 31 off; 24/7", "Dec 24 off", "24/7; Jun 1-30 off", "24/7; Dec 1-Jan 15 off", "24/7; Dec 26-24 off",
        ";", ",", "-", "Mo-", "-Mo", "Mo,,Tu", "x" * 2000,
    ],
)  # fmt: skip
def test_times_that_are_not_read(text: str) -> None:
    assert open_minutes(text) is None


def test_special_days_are_noticed() -> None:
    assert names_special_days("Mo-Fr 08:00-18:00; PH off")
    assert names_special_days("no @ (sh 08:00-18:00)")
    assert names_special_days("24/7; Dec 25 off")
    assert not names_special_days("Mo-Fr 08:00-18:00")


@given(st.lists(st.tuples(st.integers(0, WEEK), st.integers(0, 3 * 1440)), max_size=6))
def test_canonical_texts_say_the_same(spans: list[tuple[int, int]]) -> None:
    minutes = np.zeros(WEEK, bool)
    for begin, length in spans:
        minutes[np.arange(begin, begin + length) % WEEK] ^= True
    text = opening_text(minutes)
    read = open_minutes(text)
    assert read is not None
    np.testing.assert_array_equal(read, minutes)
    assert opening_text(read) == text


@given(st.text(alphabet='MoTuPHSH0123456789:-,; "off/+[]()@', max_size=40) | st.text(max_size=20))
def test_any_text_is_read_or_not(text: str) -> None:
    minutes = open_minutes(text)
    assert minutes is None or minutes.shape == (WEEK,)
    conditional_values(text)
    names_special_days(text)


def test_conditional_values() -> None:
    clauses = conditional_values("no @ (22:00-06:00); Yes @ (Mo-Fr 08:00-18:00; PH off); destination @ Sa 10:00-12:00")
    assert clauses is not None
    assert [value for value, _ in clauses] == ["no", "yes", "destination"]
    for (_, minutes), expected in zip(clauses, (daily((22, 30)), week(**WORKING), week(Sa=[(10, 12)])), strict=True):
        np.testing.assert_array_equal(minutes, expected)


def test_conditions_that_hold_together() -> None:
    ((_, minutes),) = conditional_values("no @ (Mo-Fr AND 08:00-18:00)") or []
    np.testing.assert_array_equal(minutes, week(**WORKING))


@pytest.mark.parametrize("condition", ["wet", "22:00-06:00 AND wet", "weight>7.5", "", " ", "AND 08:00-18:00"])
def test_conditions_that_are_not_read(condition: str) -> None:
    assert conditional_values(f"no @ ({condition})") == [("no", None)]


@pytest.mark.parametrize("text", ["", "no", "@", "no @", "no @ (22:00-06:00", "no (22:00-06:00)", "no @ (a) yes"])
def test_conditional_texts_without_clauses(text: str) -> None:
    assert conditional_values(text) is None
