"""Requests: what people write, and what nobody can ask for."""

from datetime import datetime

import pytest

from sidestep.routing.request import RouteError, RouteRequest, read_departure, read_place


def test_places() -> None:
    assert read_place("origin", "60.17, 24.94") == (60.17, 24.94)
    assert read_place("origin", " -33,+151.2 ") == (-33, 151.2)
    assert read_place("origin", ".5,1.") == (0.5, 1)
    assert read_place("origin", "12") == 12
    assert read_place("origin", "-1") == -1
    for given in (None, 7, (60.17, 24.94)):
        assert read_place("origin", given) == given


@pytest.mark.parametrize("text", ["here", "60.17", "60.17;24.94", "1.2.3,4", "", "nan,2", "1,2,3", "٣,٤", ".,."])
def test_other_text_is_no_place(text: str) -> None:
    with pytest.raises(RouteError) as caught:
        read_place("destination", text)
    assert caught.value.field == "destination"


def test_departures() -> None:
    assert read_departure("2.5") == 2.5
    assert (
        read_departure(" 2025-05-24T12:30 ")
        == read_departure("2025-05-24 12:30")
        == datetime.fromisoformat("2025-05-24T12:30")
    )
    assert read_departure("2025-05-24T12:30Z").tzinfo is not None
    for given in (None, 30, datetime.fromisoformat("2025-05-24T00:00")):
        assert read_departure(given) == given


@pytest.mark.parametrize("text", ["soon", "2025-05-24", "2025-13-01T12:00", "", "2025-05-24T25:00"])
def test_other_text_is_no_departure(text: str) -> None:
    with pytest.raises(RouteError) as caught:
        read_departure(text)
    assert caught.value.field == "depart"


@pytest.mark.parametrize(
    ("field", "value"),
    [("by", 0), ("by", -5.0), ("by", float("nan")), ("by", float("inf")), ("futures", 0), ("futures", -3)],
)
def test_what_nobody_can_ask_for(field: str, value: float) -> None:
    with pytest.raises(RouteError) as caught:
        RouteRequest(**{field: value})
    assert caught.value.field == field
