"""The nearest street by hand and against every leg of any town; streets split at points, one-way streets included."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.network.geodesy import metres_between
from sidestep.network.snapping import FARTHEST, Snapper, SplitStreets, StreetPoint, split_streets
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
        opening=("",) * number,
        restricted=np.zeros(number, bool),
        incline=np.full(number, np.nan, np.float32),
        kerb=np.zeros(number, np.float32),
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


def close(point, street: int, fraction: float, distance: float, x: float, y: float) -> None:
    assert point.street == street
    assert point.fraction == pytest.approx(fraction, abs=1e-4)
    assert point.distance == pytest.approx(distance, abs=0.02)
    assert point.place == pytest.approx((y / DEGREE, x / DEGREE), abs=1e-7)


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


@pytest.mark.parametrize("here", [(50, 8), (0, 0), (130, 40), (-20, 3)])
def test_a_point_that_was_found_is_found_again(snapper, here: tuple[float, float]) -> None:
    longitude, latitude = snapper.town.projection.unproject(np.array(here, float)).tolist()
    for point in snapper.several(latitude, longitude, 3):
        again = snapper.at(point.street, point.fraction, latitude, longitude)
        assert (again.street, again.fraction) == (point.street, point.fraction)
        assert again.place == pytest.approx(point.place, abs=1e-9)
        assert again.distance == pytest.approx(point.distance, abs=1e-6)


def test_on_a_crossing(snapper) -> None:
    # Two streets are as near: it is the end of one of them.
    for x, y, ends in ((0, 0, {(0, 0), (2, 1)}), (300, 100, {(0, 1), (1, 0)}), (0, 100, {(1, 1), (2, 0)})):
        found = nearest(snapper, x, y)
        assert (found.street, round(found.fraction, 6)) in ends
        assert found.distance == pytest.approx(0, abs=1e-3)
        assert found.place == pytest.approx((y / DEGREE, x / DEGREE), abs=1e-9)


def test_too_far_away(snapper) -> None:
    assert FARTHEST == 250
    assert nearest(snapper, 100, -249).distance == pytest.approx(249, abs=0.1)
    assert nearest(snapper, 100, -3000, farthest=4000).street == 0
    for y, options, said in ((-3000, {}, "3,000 m"), (-251, {}, "251 m"), (-21, {"farthest": 20}, "21 m")):
        with pytest.raises(TownError, match=said) as caught:
            nearest(snapper, 100, y, **options)
        assert caught.value.field == "place"
        assert "latitude 0.0000 to 0.0009, longitude 0.0000 to 0.0027" in str(caught.value)


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(91, 0), (-90.5, 0), (0, 181), (0, -200), (float("nan"), 0), (0, float("nan"))]
)
def test_invalid_coordinates(snapper, latitude: float, longitude: float) -> None:
    with pytest.raises(TownError) as caught:
        snapper.nearest(latitude, longitude)
    assert caught.value.field == "place"


def test_a_street_without_extent() -> None:
    # Two crossings at one place: files of other programs hold such.
    town = town_of(np.array([[0.0, 0], [0, 0], [50, 0]]), [(0, 1, np.zeros((0, 2))), (1, 2, np.zeros((0, 2)))])
    found = nearest(Snapper(town), -3, 4)
    assert (found.street, found.fraction) == (0, 0)
    assert found.distance == pytest.approx(5, abs=1e-3)


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
    assert found.distance == pytest.approx(least, abs=1e-3)
    # The place is as far as it says, and where it says on the course of its street.
    latitude, longitude = found.place
    place = town.project(np.array([longitude, latitude]))
    assert float(np.hypot(*(place - asked))) == pytest.approx(least, abs=1e-3)
    course = town.project(town.course(found.street))
    walked = np.append(0, np.cumsum(np.hypot(*np.diff(course, axis=0).T)))
    assert 0 <= found.fraction <= 1
    there = [np.interp(found.fraction * walked[-1], walked, course[:, axis]) for axis in (0, 1)]
    np.testing.assert_allclose(there, place, atol=1e-2)


@pytest.fixture
def elbow() -> Town:
    """0 --200 m east--> 1 --100 m north--> 2, the second one-way; the first has a bend of its own."""
    place = np.array([[0.0, 0.0], [200.0, 0.0], [200.0, 100.0]]) / DEGREE
    points = np.array([[0, 0], [50, 0], [200, 0], [200, 0], [200, 100]]) / DEGREE
    return Town(
        place=place,
        ids=np.arange(3),
        tail=np.array([0, 1], np.int32),
        head=np.array([1, 2], np.int32),
        one_way=np.array([False, True]),
        length=np.array([200, 100], np.float32),
        width=np.array([2, 3], np.float32),
        kind=("footway", "residential"),
        name=("", "High Street"),
        signals=np.zeros(2, np.int16),
        crossings=np.zeros(2, np.int16),
        opening=("",) * 2,
        restricted=np.zeros(2, bool),
        incline=np.full(2, np.nan, np.float32),
        kerb=np.zeros(2, np.float32),
        points=points,
        first=np.array([0, 3, 5]),
        attribution="nobody",
    )


def segments(streets: SplitStreets) -> set[tuple[int, int, float]]:
    network = streets.network
    ends = zip(network.tail.tolist(), network.head.tolist(), np.round(network.length, 2).tolist(), strict=True)
    return set(ends)


def test_crossings_split_nothing(elbow) -> None:
    streets = split_streets(elbow, [0, 2])
    assert streets.nodes == (0, 2)
    assert segments(streets) == {(0, 1, 200), (1, 0, 200), (1, 2, 100)}
    assert streets.parent.tolist() == [0, 1, 2]


def test_a_street_is_left_by_either_end(elbow) -> None:
    streets = split_streets(elbow, [StreetPoint(0, 0.25, 0.0, (0.0, 50 / DEGREE)), 1])
    assert streets.nodes == (3, 1)
    assert segments(streets) == {(0, 3, 50), (3, 1, 150), (1, 3, 150), (3, 0, 50), (1, 2, 100)}
    assert np.asarray(streets.network.position)[3] == pytest.approx(elbow.project(np.array([50 / DEGREE, 0.0])))
    # the pieces have the widths, and so the crowds, of their street
    assert streets.street.tolist() == [0, 1, 0, 0, 0]
    assert np.asarray(streets.network.width).tolist() == [2, 3, 2, 2, 2]
    # the exits of the town's crossings stay
    assert np.asarray(streets.network.exit_segment)[1].tolist() == np.asarray(elbow.network().exit_segment)[1].tolist()


def test_one_way_streets_are_not_walked_back(elbow) -> None:
    streets = split_streets(elbow, [StreetPoint(1, 0.6, 0.0, (60 / DEGREE, 200 / DEGREE)), 0])
    assert segments(streets) == {(0, 1, 200), (1, 0, 200), (1, 3, 60), (3, 2, 40)}


def test_two_places_on_one_street(elbow) -> None:
    a, b = (StreetPoint(0, fraction, 0.0, (0.0, 200 * fraction / DEGREE)) for fraction in (0.75, 0.25))
    streets = split_streets(elbow, [a, b])
    assert streets.nodes == (3, 4)
    assert {(3, 4, 100), (4, 3, 100), (0, 4, 50), (4, 0, 50), (3, 1, 50), (1, 3, 50)} < segments(streets)
    # the same place, or half a metre from it, is one node
    again = split_streets(elbow, [a, replace(a, fraction=0.7525)])
    assert again.nodes == (3, 3)


@pytest.mark.parametrize(("fraction", "node"), [(0.0, 0), (0.004, 0), (0.996, 1), (1.0, 1)])
def test_what_is_near_a_crossing_is_there(elbow, fraction: float, node: int) -> None:
    streets = split_streets(elbow, [StreetPoint(0, fraction, 3.0, (0.0, 0.0)), 2])
    assert streets.nodes == (node, 2)
    assert streets.network.nodes == 3


def test_courses_lead_where_segments_do(elbow) -> None:
    streets = split_streets(
        elbow, [StreetPoint(0, 0.5, 0.0, (0.0, 100 / DEGREE)), StreetPoint(1, 0.5, 0.0, (50 / DEGREE, 200 / DEGREE))]
    )
    position = np.asarray(streets.network.position)
    for segment in range(streets.network.segments):
        course = streets.course(segment)
        ends = elbow.project(course[[0, -1]])
        assert ends[0] == pytest.approx(position[int(streets.network.tail[segment])], abs=0.01)
        assert ends[1] == pytest.approx(position[int(streets.network.head[segment])], abs=0.01)
        assert metres_between(course[:-1], course[1:]).sum() == pytest.approx(
            float(streets.network.length[segment]), abs=0.01
        )


def test_pieces_keep_the_bends_of_their_street(elbow) -> None:
    streets = split_streets(
        elbow, [StreetPoint(0, fraction, 0.0, (0.0, 200 * fraction / DEGREE)) for fraction in (0.1, 0.5)]
    )
    there = {(20, 100): [[20, 0], [50, 0], [100, 0]], (100, 20): [[100, 0], [50, 0], [20, 0]]}
    found = {tuple(np.rint(course[[0, -1], 0]).astype(int)): course for course in courses(streets)}
    for ends, course in there.items():
        assert found[ends] == pytest.approx(np.array(course), abs=1e-6)


def courses(streets: SplitStreets) -> list[np.ndarray]:
    """In metres."""
    return [streets.course(segment) * DEGREE for segment in range(streets.network.segments)]


def test_pieces_know_what_they_are_a_piece_of(elbow) -> None:
    streets = split_streets(elbow, [StreetPoint(0, 0.25, 0.0, (0.0, 50 / DEGREE))])
    # segments 0 (east) and 1 > 2 stay first; then street 0 westwards; then the second pieces of both directions
    assert streets.parent.tolist() == [0, 1, 2, 0, 2]
    assert streets.fraction.tolist() == [0.25, 1, 0.75, 0.75, 0.25]
    assert streets.begins_at_crossing.tolist() == [True, True, True, False, False]


def test_points_are_where_the_snapper_found_them(elbow) -> None:
    found = Snapper(elbow).nearest(10 / DEGREE, 120 / DEGREE)
    streets = split_streets(elbow, [found, 0])
    assert np.asarray(streets.network.position)[3] == pytest.approx(
        elbow.project(np.array([120 / DEGREE, 0])), abs=0.01
    )
