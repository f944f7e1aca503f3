"""How far a walker has come along its route, by positions that are off by some metres."""

import numpy as np
import pytest

from sidestep.routing.following import NEAR, cut, follow

# 100 m east, 100 m north, and 100 m back west: a street of 200 m of which 100 m are measured, and one as drawn.
LINES = [np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0]]), np.array([[100.0, 100.0], [0.0, 100.0]])]
LENGTHS = [400.0, 100.0]


def found(x: float, y: float, done: float = 0.0, seconds: float = 1000.0) -> float | None:
    there = follow(LINES, LENGTHS, np.array([x, y], float), done, seconds)
    return None if there is None else there.metres


def test_metres_are_those_of_the_street() -> None:
    assert found(50, 0) == pytest.approx(100)
    assert found(100, 50) == pytest.approx(300)
    assert found(40, 100) == pytest.approx(460)


def test_near_the_route_is_on_it() -> None:
    there = follow(LINES, LENGTHS, np.array([50.0, -NEAR]), 0.0, 1000.0)
    assert (there.metres, there.away) == pytest.approx((100, NEAR))
    assert found(50, -NEAR - 1) is None


def test_nobody_goes_back_by_a_few_metres() -> None:
    assert found(50, 0, done=110) == 110
    assert found(50, 0, done=119) == 119
    assert found(50, 0, done=121) is None  # has turned back


def test_a_route_is_followed_in_its_order() -> None:
    there_and_back = [np.array([[0.0, 0.0], [100.0, 0.0]]), np.array([[100.0, 0.0], [0.0, 0.0]])]

    def along(x: float, done: float, seconds: float) -> float:
        return follow(there_and_back, [100.0, 100.0], np.array([x, 0.0]), done, seconds).metres

    assert along(30, 10, 15) == pytest.approx(30)
    assert along(30, 120, 40) == pytest.approx(170)
    # Where positions were missed, the way back counts once the way there is behind the walker.
    assert along(10, 60, 5) == pytest.approx(190)


def test_the_rest_of_a_course() -> None:
    line = [[0.0, 0.0], [1.0, 0.0], [1.0, 3.0]]
    assert cut(line, 1.0) == line
    assert cut(line, 0.75) == [[1.0, 0.0], [1.0, 3.0]]
    assert cut(line, 0.5) == [[1.0, 1.0], [1.0, 3.0]]
    assert cut(line, 0.0) == [[1.0, 3.0]]
