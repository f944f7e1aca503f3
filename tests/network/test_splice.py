"""Streets split where people set out or arrive: what stays, what is new, one-way streets, two places on one street."""

import dataclasses

import numpy as np
import pytest

from sidestep.network.snap import Snapped, Snapper
from sidestep.network.splice import part_of_course, splice
from sidestep.network.town import Town, metres_between

DEGREE = 111_195.08  # m, on the equator in both directions


@pytest.fixture
def town() -> Town:
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
        points=points,
        first=np.array([0, 3, 5]),
        attribution="nobody",
    )


def segments(streets) -> set[tuple[int, int, float]]:
    network = streets.network
    ends = zip(network.tail.tolist(), network.head.tolist(), np.round(network.length, 2).tolist(), strict=True)
    return set(ends)


def test_crossings_split_nothing(town) -> None:
    streets = splice(town, [0, 2])
    assert streets.nodes == (0, 2)
    assert segments(streets) == {(0, 1, 200), (1, 0, 200), (1, 2, 100)}
    assert streets.parent.tolist() == [0, 1, 2]


def test_a_street_is_left_by_either_end(town) -> None:
    streets = splice(town, [Snapped(0, 0.25, 0.0, (0.0, 50 / DEGREE)), 1])
    assert streets.nodes == (3, 1)
    assert segments(streets) == {(0, 3, 50), (3, 1, 150), (1, 3, 150), (3, 0, 50), (1, 2, 100)}
    assert np.asarray(streets.network.position)[3] == pytest.approx(town.project(np.array([50 / DEGREE, 0.0])))
    # the pieces have the widths, and so the crowds, of their street
    assert streets.street.tolist() == [0, 1, 0, 0, 0]
    assert np.asarray(streets.network.width).tolist() == [2, 3, 2, 2, 2]
    # whoever was there keeps their exits
    assert np.asarray(streets.network.exit_segment)[1].tolist() == np.asarray(town.network().exit_segment)[1].tolist()


def test_one_way_streets_are_not_walked_back(town) -> None:
    streets = splice(town, [Snapped(1, 0.6, 0.0, (60 / DEGREE, 200 / DEGREE)), 0])
    assert segments(streets) == {(0, 1, 200), (1, 0, 200), (1, 3, 60), (3, 2, 40)}


def test_two_places_on_one_street(town) -> None:
    a, b = (Snapped(0, part, 0.0, (0.0, 200 * part / DEGREE)) for part in (0.75, 0.25))
    streets = splice(town, [a, b])
    assert streets.nodes == (3, 4)
    assert {(3, 4, 100), (4, 3, 100), (0, 4, 50), (4, 0, 50), (3, 1, 50), (1, 3, 50)} < segments(streets)
    # the same place, or half a metre from it, is one node
    again = splice(town, [a, dataclasses.replace(a, part=0.7525)])
    assert again.nodes == (3, 3)


@pytest.mark.parametrize(("part", "node"), [(0.0, 0), (0.004, 0), (0.996, 1), (1.0, 1)])
def test_what_is_near_a_crossing_is_there(town, part: float, node: int) -> None:
    streets = splice(town, [Snapped(0, part, 3.0, (0.0, 0.0)), 2])
    assert streets.nodes == (node, 2)
    assert streets.network.nodes == 3


def test_courses_lead_where_segments_do(town) -> None:
    streets = splice(
        town, [Snapped(0, 0.5, 0.0, (0.0, 100 / DEGREE)), Snapped(1, 0.5, 0.0, (50 / DEGREE, 200 / DEGREE))]
    )
    position = np.asarray(streets.network.position)
    for segment in range(streets.network.segments):
        course = streets.course(segment)
        ends = town.project(course[[0, -1]])
        assert ends[0] == pytest.approx(position[int(streets.network.tail[segment])], abs=0.01)
        assert ends[1] == pytest.approx(position[int(streets.network.head[segment])], abs=0.01)
        assert metres_between(course[:-1], course[1:]).sum() == pytest.approx(
            float(streets.network.length[segment]), abs=0.01
        )


def test_a_part_of_a_course_keeps_its_bends(town) -> None:
    piece = part_of_course(town, 0, 0.1, 0.5) * DEGREE
    assert piece == pytest.approx(np.array([[20, 0], [50, 0], [100, 0]]), abs=1e-6)


def test_snapped_places_are_where_they_were_snapped(town) -> None:
    snapped = Snapper(town).nearest(10 / DEGREE, 120 / DEGREE)
    streets = splice(town, [snapped, 0])
    assert np.asarray(streets.network.position)[3] == pytest.approx(town.project(np.array([120 / DEGREE, 0])), abs=0.01)
