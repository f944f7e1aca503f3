"""What a town promises, and invalid towns."""

from dataclasses import fields, replace

import numpy as np
import pytest

from sidestep.network.town import Town, TownError


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
        opening=("", "", "Mo-Fr 08:00-18:00"),
        restricted=np.array([True, False, False]),
        incline=np.array([np.nan, 0.5, -0.25], np.float32),
        kerb=np.array([0, 0, 0.12], np.float32),
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
    ("changes", "field", "item"),
    [
        (dict(name=("", "")), "name", "given for 2"),
        (dict(place=np.array([[24.90, 60.10], [np.nan, 60.10], [24.91, 60.12]])), "place", "crossing 1"),
        (dict(place=np.array([[24.90, 60.10], [24.91, 60.10], [24.91, 91]])), "place", "crossing 2"),
        (dict(tail=np.array([0, 1, 3], np.int32)), "tail", "street 2 is 3"),
        (dict(head=np.array([1, -1, 0], np.int32)), "head", "street 1 is -1"),
        (dict(head=np.array([1, 1, 0], np.int32)), "head", "street 1 is 1"),  # a loop
        (dict(length=np.array([600, 0, 1], np.float32)), "length", "street 1 is 0.0"),
        (dict(width=np.array([np.inf, 1, 1], np.float32)), "width", "street 0 is inf"),
        (dict(width=np.array([1, 1, np.nan], np.float32)), "width", "street 2 is nan"),
        (dict(signals=np.array([0, -1, 0], np.int16)), "signals", "street 1 is -1"),
        (dict(crossings=np.array([0, 0, -2], np.int16)), "crossings", "street 2 is -2"),
        (dict(first=np.array([0, 3, 5])), "first", "3 streets"),
        (dict(first=np.array([0, 3, 4, 7])), "first", "3 streets"),
        (dict(first=np.array([0, 3, 5, 8])), "first", "7 points"),
        (dict(tail=np.array([2, 1, 2], np.int32)), "tail", "street 0 is 2"),  # whose course begins elsewhere
        (dict(head=np.array([1, 0, 0], np.int32)), "head", "street 1 is 0"),  # whose course ends elsewhere
    ],
)
def test_invalid_towns(town, changes, field: str, item: str) -> None:
    with pytest.raises(TownError, match=item) as caught:
        replace(town, **changes)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("field", "value", "blamed"),
    [
        ("tail", np.zeros(0, np.int32), "tail"),
        ("ids", np.array([1, 2]), "place"),
        ("head", np.array([1], np.int32), "head"),
    ],
)
def test_arrays_that_do_not_belong_together(town, field: str, value, blamed: str) -> None:
    # The types that the tests check at run time would object first.
    object.__setattr__(town, field, value)
    with pytest.raises(TownError) as caught:
        town.__post_init__()
    assert caught.value.field == blamed
