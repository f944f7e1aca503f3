"""The nearest street: by hand on a town of three, by looking at every leg on any town, and places outside."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.network.snap import FARTHEST, Snapper
from sidestep.network.town import Town, TownError

DEGREE = 111_195.08  # m, on the equator in both directions


def town_of(places: np.ndarray, courses: list[tuple[int, int, np.ndarray]]) -> Town:
    """Crossings and bends in metres about the equator; each course is a tail, a head and the bends between them."""
    points = [np.concatenate([places[[tail]], bends.reshape(-1, 2), places[[head]]]) for tail, head, bends in courses]
    number = len(courses)
    return Town(
        place=places / DEGREE,
        ids=np.arange(len(places)),
        tail=np.array([tail for tail, _, _ in courses], np.int32),
        head=np.array([head for _, head, _ in courses], np.int32),
        one_way=np.zeros(number, bool),
        length=np.ones(number, np.float32),
        width=np.ones(number, np.float32),
        kind=("footway",) * number,
        name=("",) * number,
        signals=np.zeros(number, np.int16),
        crossings=np.zeros(number, np.int16),
        points=np.concatenate(points) / DEGREE,
        first=np.cumsum([0, *map(len, points)]),
        attribution="nobody",
    )


@pytest.fixture(scope="module")
def snapper() -> Snapper:
    """Street 0 goes 300 m east, then 100 m north; 1 from its end west to (0, 100); 2 from there to where 0 begins.

    (0, 100) ---1--- (300, 100)
       2                 |
    (0, 0)  ----0----  bend
    """
    places = np.array([[0.0, 0], [300, 100], [0, 100]])
    bend = np.array([[300.0, 0]])
    return Snapper(town_of(places, [(0, 1, bend), (1, 2, np.zeros((0, 2))), (2, 0, np.zeros((0, 2)))]))


def nearest(snapper: Snapper, x: float, y: float, **options: float):
    return snapper.nearest(y / DEGREE, x / DEGREE, **options)


def close(snapped, street: int, part: float, away: float, x: float, y: float) -> None:
    assert snapped.street == street
    assert snapped.part == pytest.approx(part, abs=1e-4)
    assert snapped.away == pytest.approx(away, abs=0.02)
    assert snapped.place == pytest.approx((y / DEGREE, x / DEGREE), abs=1e-7)


def test_beside_a_street(snapper) -> None:
    # 90 of 300 + 100 m, 20 m to the south
    close(nearest(snapper, 90, -20), 0, 0.225, 20, 90, 0)
    # on the second leg: 300 + 30 of 400 m
    close(nearest(snapper, 310, 30), 0, 0.825, 10, 300, 30)
    # street 1 goes west
    close(nearest(snapper, 210, 96), 1, 0.3, 4, 210, 100)
    close(nearest(snapper, -7, 25), 2, 0.75, 7, 0, 25)


def test_beyond_a_bend(snapper) -> None:
    # 3, 4, 5; the bend is at 300 of 400 m
    close(nearest(snapper, 303, -4), 0, 0.75, 5, 300, 0)


def test_on_a_crossing(snapper) -> None:
    # Two streets are as near: it is the end of one of them.
    for x, y, ends in ((0, 0, {(0, 0), (2, 1)}), (300, 100, {(0, 1), (1, 0)}), (0, 100, {(1, 1), (2, 0)})):
        found = nearest(snapper, x, y)
        assert (found.street, round(found.part, 6)) in ends
        assert found.away == pytest.approx(0, abs=1e-3)
        assert found.place == pytest.approx((y / DEGREE, x / DEGREE), abs=1e-9)


def test_too_far_away(snapper) -> None:
    with pytest.raises(TownError) as caught:
        nearest(snapper, 100, -3000)
    assert "is 3,000 m from the nearest street, so it is not in this town" in str(caught.value)
    assert "(latitude 0.0000 to 0.0009, longitude 0.0000 to 0.0027)" in str(caught.value)
    assert FARTHEST == 250
    assert nearest(snapper, 100, -249).away == pytest.approx(249, abs=0.1)
    with pytest.raises(TownError, match="is 251 m from"):
        nearest(snapper, 100, -251)
    with pytest.raises(TownError, match="is 21 m from"):
        nearest(snapper, 100, -21, farthest=20)
    assert nearest(snapper, 100, -3000, farthest=4000).street == 0


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(91, 0), (-90.5, 0), (0, 181), (0, -200), (float("nan"), 0), (0, float("nan"))]
)
def test_coordinates_that_are_none(snapper, latitude: float, longitude: float) -> None:
    with pytest.raises(TownError, match="is no place: give degrees of latitude"):
        snapper.nearest(latitude, longitude)


metres = st.integers(-1000, 1000).map(float)
spot = st.tuples(metres, metres)


# Crossings, then streets: where one begins, how many crossings further on it ends, and its bends.
crossings = st.lists(spot, min_size=3, max_size=6, unique=True)
streets = st.lists(st.tuples(st.integers(0, 2), st.integers(1, 2), st.lists(spot, max_size=3)), min_size=1, max_size=6)


@settings(max_examples=50)
@given(crossings, streets, spot)
def test_no_street_is_nearer(places: list, courses: list, here: tuple[float, float]) -> None:
    town = town_of(
        np.array(places),
        [(tail, (tail + on) % 3, np.array(bends, float).reshape(-1, 2)) for tail, on, bends in courses],
    )
    found = nearest(Snapper(town), *here, farthest=1e6)
    asked = town.project(np.array(here) / DEGREE)
    least = np.inf
    for street in range(town.streets):
        course = town.project(town.course(street))
        for start, end in pairwise(course):
            along = end - start
            share = 0.0 if not along.any() else float(np.clip((asked - start) @ along / (along @ along), 0, 1))
            least = min(least, float(np.hypot(*(start + share * along - asked))))
    assert found.away == pytest.approx(least, abs=1e-3)
    # The place is as far as it says, and where it says on the course of its street.
    latitude, longitude = found.place
    place = town.project(np.array([longitude, latitude]))
    assert float(np.hypot(*(place - asked))) == pytest.approx(least, abs=1e-3)
    course = town.project(town.course(found.street))
    walked = np.append(0, np.cumsum(np.hypot(*np.diff(course, axis=0).T)))
    assert 0 <= found.part <= 1
    there = [np.interp(found.part * walked[-1], walked, course[:, axis]) for axis in (0, 1)]
    np.testing.assert_allclose(there, place, atol=1e-2)
