"""Curves in plain characters stay within 80 columns, and put every value where it belongs."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.cli.curves import HEIGHT, plot

VALUES = st.lists(st.floats(0.01, 1e5), max_size=300)


def test_a_curve_by_hand() -> None:
    lines = plot({"": [16.0, 1.0, 4.0]}).splitlines()
    assert lines[0] == "     16.0|*"
    assert lines[HEIGHT - 1] == "      1.0| *"
    # Logarithmic: 4 is halfway between 1 and 16.
    assert [row for row, line in enumerate(lines[:HEIGHT]) if line.endswith("|  *")] in ([7], [8])
    assert lines[HEIGHT:] == ["         +---", "          1 round 3"]


def test_a_scale_that_is_not_logarithmic() -> None:
    lines = plot({"": [0.0, 10.0, 2.0]}).splitlines()
    assert [row for row, line in enumerate(lines[:HEIGHT]) if "*" in line] == [0, 12, 15]


def test_many_rounds_are_means() -> None:
    lines = plot({"": [1.0, 3.0] * 70}).splitlines()
    assert max(map(len, lines)) == 80
    assert sum(line.count("*") for line in lines) == 70
    assert {float(line.split("|")[0]) for line in lines[:HEIGHT] if line.split("|")[0].strip()} == {2.0, 3.0, 2.3, 2.7}


def test_two_curves_and_where_they_meet() -> None:
    lines = plot({"a": [1.0, 2.0], "b": [1.0, 1.0, 2.0]}).splitlines()
    assert lines[0] == "      2.0| *o"
    assert lines[HEIGHT - 1] == "      1.0|*o"
    assert lines[-2:] == ["          * a", "          o b"]


@pytest.mark.parametrize("curves", [{}, {"a": []}])
def test_nothing_to_draw(curves: dict[str, list[float]]) -> None:
    assert plot(curves) == ""


@given(VALUES, VALUES)
def test_every_curve_fits(one: list[float], other: list[float]) -> None:
    lines = plot({"a": one, "b": other}).splitlines()
    assert all(len(line) <= 80 for line in lines)
    points = [line.partition("|")[2] for line in lines[:HEIGHT]]
    for column in range(min(len(one), 70)):
        drawn = [row[column] for row in points if column < len(row)]
        assert drawn.count("*") <= 1
        assert drawn.count("o") <= 1
    if one or other:
        assert any("*" in row or "o" in row for row in points)
