"""What a town promises, and every town that cannot be."""

from dataclasses import fields, replace

import numpy as np
import pytest

from sidestep.network.town import Town, TownError, _check


@pytest.fixture
def town() -> Town:
    """0 - 1 both ways with a bend, 1 > 2 one way, 2 - 0."""
    place = np.array([[24.90, 60.10], [24.91, 60.10], [24.91, 60.12]])
    return Town(
        place=place,
        ids=np.array([10, 20, 30]),
        tail=np.array([0, 1, 2], np.int32),
        head=np.array([1, 2, 0], np.int32),
        one_way=np.array([False, True, False]),
        length=np.array([600, 2224, 2293], np.float32),
        width=np.array([2, 3, 4], np.float32),
        kind=("footway", "steps", "path"),
        name=("", "Stairs", ""),
        signals=np.array([0, 0, 1], np.int16),
        crossings=np.array([2, 0, 0], np.int16),
        points=np.concatenate([place[[0]], [[24.905, 60.101]], place[[1, 1, 2, 2, 0]]]),
        first=np.array([0, 3, 5, 7]),
        attribution="nobody",
    )


def test_segments_are_streets_and_then_those_walked_back(town) -> None:
    network = town.network()
    assert (town.nodes, town.streets, network.nodes, network.segments) == (3, 3, 3, 5)
    assert network.tail.tolist() == [0, 1, 2, 1, 0]
    assert network.head.tolist() == [1, 2, 0, 0, 2]
    assert network.length.tolist() == [600, 2224, 2293, 600, 2293]
    assert network.width.tolist() == [2, 3, 4, 2, 4]
    street, backwards = town.street_of_segment()
    assert street.tolist() == [0, 1, 2, 0, 2]
    assert backwards.tolist() == [False, False, False, True, True]
    assert town.kilometres == pytest.approx(5.117)


def test_metres_from_the_middle(town) -> None:
    # A hundredth of a degree is 1111.95 m; to the east that times cos 60.11 deg = 0.49834.
    np.testing.assert_allclose(
        town.project(town.place), [[-277.06, -1111.95], [277.06, -1111.95], [277.06, 1111.95]], atol=0.1
    )
    np.testing.assert_allclose(town.project(np.array([24.905, 60.11])), [0, 0], atol=1e-6)
    np.testing.assert_allclose(town.network().position, town.project(town.place), rtol=1e-6)


def test_arrays_cannot_be_changed(town) -> None:
    arrays = [getattr(town, field.name) for field in fields(Town)]
    for array in (array for array in arrays if isinstance(array, np.ndarray)):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (dict(name=("", "")), "name is given for 2"),
        (dict(place=np.array([[24.90, 60.10], [np.nan, 60.10], [24.91, 60.12]])), "crossing 1 is at longitude nan"),
        (dict(place=np.array([[24.90, 60.10], [24.91, 60.10], [24.91, 91]])), "latitude 91"),
        (dict(tail=np.array([0, 1, 3], np.int32)), "street 2 has tail 3, but there are 3 crossings"),
        (dict(head=np.array([1, -1, 0], np.int32)), "street 1 has head -1"),
        (dict(head=np.array([1, 1, 0], np.int32)), "street 1 begins and ends at crossing 1"),
        (dict(length=np.array([600, 0, 1], np.float32)), "street 1 has length 0.0 m; it must be positive"),
        (dict(width=np.array([np.inf, 1, 1], np.float32)), "street 0 has width inf m"),
        (dict(width=np.array([1, 1, np.nan], np.float32)), "street 2 has width nan m"),
        (dict(signals=np.array([0, -1, 0], np.int16)), "street 1 has -1 signals"),
        (dict(first=np.array([0, 3, 5])), "do not add up"),
        (dict(first=np.array([0, 3, 4, 7])), "do not add up"),
        (dict(first=np.array([0, 3, 5, 8])), "do not add up"),
        (dict(tail=np.array([2, 1, 2], np.int32)), "course of street 0 begins elsewhere than at crossing 2"),
    ],
)
def test_towns_that_cannot_be(town, changes, says: str) -> None:
    with pytest.raises(TownError, match=says):
        replace(town, **changes)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("tail", np.zeros(0, np.int32), "at least one street"),
        ("ids", np.array([1, 2]), "2 crossings, but 3 places"),
        ("head", np.array([1], np.int32), "3 streets, but head is given for 1"),
    ],
)
def test_arrays_that_do_not_belong_together(town, name: str, value, says: str) -> None:
    # The types that the tests check at run time would speak first.
    object.__setattr__(town, name, value)
    with pytest.raises(TownError, match=says):
        _check(town)
