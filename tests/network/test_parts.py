"""What is left of a town without some of its streets, by hand."""

import numpy as np
import pytest

from sidestep.network.parts import largest_part
from sidestep.network.town import Town, TownError

# A square 0-1-2-3, with a tail 3-4-5 and a one-way street from 0 to 2.
ENDS = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (3, 4), (4, 5)])
PLACES = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 2), (0, 3)], float) / 1000
ONE_WAY = np.array([False, False, False, False, True, False, False])


@pytest.fixture(scope="module")
def town() -> Town:
    return Town.of_streets(
        ENDS,
        place=PLACES,
        ids=np.arange(6) + 100,
        one_way=ONE_WAY,
        length=np.arange(7) + 10.0,
        width=np.full(7, 2.0),
        kind=tuple("abcdefg"),
        name=tuple("ABCDEFG"),
        signals=np.zeros(7),
        crossings=np.zeros(7),
        points=PLACES[ENDS].reshape(-1, 2),
        first=np.arange(8) * 2,
        attribution="nobody",
    )


def without(town: Town, *streets: int):
    return largest_part(town, ~np.isin(np.arange(town.streets), streets))


def test_all_of_it_is_the_town_itself(town) -> None:
    part = without(town)
    assert part.town is town
    assert (part.left_out, part.crossings.tolist()) == (0, [0, 1, 2, 3, 4, 5])
    assert part.segments().tolist() == list(range(13))


def test_crossings_keep_their_numbers(town) -> None:
    # Without 3-0 and 3-4 all of the square is left, but the end of the tail is cut off.
    part = without(town, 3, 5)
    assert part.street.tolist() == [0, 1, 2, 4]
    assert (part.left_out, part.crossings.tolist(), part.town.nodes) == (3, [0, 1, 2, 3], 6)
    assert part.town.kind == ("a", "b", "c", "e")
    assert part.town.length.tolist() == [10, 11, 12, 14]
    assert part.town.tail.tolist() == [0, 1, 2, 0]
    np.testing.assert_array_equal(part.town.course(3), town.course(4))
    np.testing.assert_array_equal(part.town.network().position, town.network().position)
    # Segments: the streets from tail to head, then those that are walked back: in the town 7 to 12, without street 4.
    assert part.segments().tolist() == [0, 1, 2, 4, 7, 8, 9]
    whole, left = town.network(), part.town.network()
    np.testing.assert_array_equal(left.tail, np.asarray(whole.tail)[part.segments()])
    np.testing.assert_array_equal(left.length, np.asarray(whole.length)[part.segments()])
    assert np.flatnonzero(~np.asarray(left.valid).any(axis=1)).tolist() == [4, 5]


def test_streets_that_lead_nowhere_and_back_go_too(town) -> None:
    # Without 0-1 and 3-0 nobody gets back to 0, where the one-way street begins.
    part = without(town, 0, 3)
    assert part.street.tolist() == [1, 2, 5, 6]
    assert part.crossings.tolist() == [1, 2, 3, 4, 5]


def test_of_two_parts_the_larger_one_is_left(town) -> None:
    assert without(town, 5).street.tolist() == [0, 1, 2, 3, 4]


def test_nothing_is_left(town) -> None:
    for streets in (range(7), (0, 1, 2, 3, 5, 6)):  # a one-way street alone is no part either
        with pytest.raises(TownError) as caught:
            without(town, *streets)
        assert caught.value.field == "walked"
