"""What tags measure: widths, lengths and inclines."""

import math

import pytest

from sidestep.network.measures import (
    STEPS_INCLINE,
    WidthError,
    incline,
    parse_length,
    parse_width,
    walkable_width,
    width_table,
)
from sidestep.network.tags import WIDTHS


def tags(text: str) -> dict[str, str]:
    return dict(pair.split("=", 1) for pair in text.split())


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("3", 3),
        ("3.5 m", 3.5),
        ("3,5", 3.5),
        (" 2.50 ", 2.5),
        ("4 metres", 4),
        ("12'", 3.6576),
        ("10 ft", 3.048),
        ("6'6\"", 1.9812),
        ("100", 100),
        ("0.3", 0.3),
    ],
)
def test_widths_that_make_sense(text: str, metres: float) -> None:
    assert parse_width(text) == pytest.approx(metres)


@pytest.mark.parametrize(
    "text", ["", "wide", "-2", "0", "0.1", "101", "1e9", "3;4", "3-4", "nan", "inf", "2 km", '3 m 6"', "9" * 500, "٣"]
)
def test_widths_that_make_none(text: str) -> None:
    assert parse_width(text) is None


@pytest.mark.parametrize(
    ("said", "metres", "ignored"),
    [
        ("highway=footway", 2, False),
        ("highway=footway width=3.5", 3.5, False),
        ("highway=footway est_width=4", 4, False),
        ("highway=footway width=3 est_width=4", 3, False),
        ("highway=footway width=wide", 2, True),
        ("highway=footway width=wide est_width=4", 4, True),
        ("highway=residential", 4, False),
        ("highway=residential width=8", 4, False),  # the carriageway's
        ("highway=residential sidewalk=left", 2, False),
        ("highway=residential sidewalk=no", 2, False),  # along one side of the road itself
        ("highway=residential sidewalk:width=1.5", 3, False),
        ("highway=residential sidewalk=right sidewalk:width=1.5", 1.5, False),
        ("highway=residential sidewalk:both:width=2.5", 5, False),
        ("highway=residential sidewalk:left:width=1 sidewalk:right:width=2.5", 3.5, False),
        ("highway=residential sidewalk:left:width=1", 3, False),  # the right from the table: 4 / 2
        ("highway=residential sidewalk:width=broad", 4, True),
        ("highway=secondary sidewalk:left=separate sidewalk:right=yes", 2.5, False),
    ],
)
def test_walkable_widths(said: str, metres: float, *, ignored: bool) -> None:
    assert walkable_width(tags(said)) == (pytest.approx(metres), ignored)


def test_widths_may_be_chosen() -> None:
    table = width_table({"footway": 2.5})
    assert walkable_width({"highway": "footway"}, table) == (2.5, False)
    assert walkable_width({"highway": "path"}, table) == (WIDTHS["path"], False)
    assert width_table(None) == dict(WIDTHS)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"alley": 2}, "widths"),
        ({"path": 0}, "widths.path"),
        ({"path": float("nan")}, "widths.path"),
        ({"steps": 1e3}, "widths.steps"),
    ],
)
def test_invalid_widths(changes, field: str) -> None:
    with pytest.raises(WidthError) as caught:
        width_table(changes)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("text", "metres"),
    [("0", 0), ("3 cm", 0.03), ("12cm", 0.12), ("40 mm", 0.04), ("0.12", 0.12), ("5 in", 0.127), ('5"', 0.127)],
)
def test_lengths(text: str, metres: float) -> None:
    assert parse_length(text) == pytest.approx(metres)


@pytest.mark.parametrize(
    ("said", "rise"),
    [
        ("highway=path incline=5%", 0.05),
        ("highway=path incline=-12,5%", -0.125),
        ("highway=path incline=+10%", 0.1),
        ("highway=path incline=10°", math.tan(math.radians(10))),
        ("highway=path incline=1:20", 0.05),
        ("highway=path incline=-1:8", -0.125),
        ("highway=steps incline=up", STEPS_INCLINE),
        ("highway=steps incline=down", -STEPS_INCLINE),
        ("highway=steps incline=40%", 0.4),
        ("highway=steps incline=0%", 0),
    ],
)
def test_inclines(said: str, rise: float) -> None:
    assert incline(tags(said)) == (pytest.approx(rise), False)


def test_inclines_that_nobody_tells() -> None:
    rise, ignored = incline(tags("highway=steps"))
    assert math.isnan(rise)
    assert not ignored


@pytest.mark.parametrize(
    "said",
    [
        "path incline=up",
        "path incline=steep",
        "path incline=10",
        "path incline=900%",
        "steps incline=89°",
        "path incline=1:0",
    ],
)
def test_inclines_without_a_number(said: str) -> None:
    rise, ignored = incline(tags(f"highway={said}"))
    assert math.isnan(rise)
    assert ignored
