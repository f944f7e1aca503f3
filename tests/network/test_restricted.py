"""Restricted areas by hand, and that every walk in a connected town can be walked without passing through one."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from sidestep.network.graph import ABSENT, SHUT, RoadNetwork, disjoint_union
from sidestep.network.snapping import StreetPoint, split_streets
from sidestep.network.town import Town, TownError

# 0, 1 and 2 are joined by open streets; 3 and 4 lie between 0 and 1, 5 and 6 behind 2.
ENDS = [(0, 1), (1, 2), (2, 0), (0, 3), (3, 4), (4, 1), (2, 5), (5, 6)]
XY = [(0, 0), (100, 0), (50, 100), (30, -50), (70, -50), (50, 200), (50, 300)]


@pytest.fixture(scope="module")
def town(make_town) -> Town:
    return make_town(XY, ENDS, restricted=np.arange(8) >= 3)


def refused(network: RoadNetwork, destination: int) -> set[tuple[int, int]]:
    """Ends of the segments that walks to a destination may not take."""
    found = ~np.asarray(network.may_take(jnp.int32(destination)))
    return {(int(tail), int(head)) for tail, head in zip(network.tail[found], network.head[found], strict=True)}


def test_areas_by_hand(town) -> None:
    network = town.network()
    assert network.area.tolist() == [-1, -1, -1, 0, 0, 1, 1]
    assert refused(network, 2) == {(0, 3), (1, 4), (2, 5)}
    assert refused(network, 4) == {(2, 5)}
    assert refused(network, 6) == {(0, 3), (1, 4)}
    # To one of several nodes, and as exits.
    either = np.asarray(network.exits_to(jnp.isin(jnp.arange(7), jnp.array([3, 6]))))
    np.testing.assert_array_equal(either, network.valid)
    for end in range(7):
        exits = np.asarray(network.exits_to(jnp.int32(end)))
        np.testing.assert_array_equal(exits, network.exits_to(jnp.arange(7) == end))
        np.testing.assert_array_equal(exits[2], network.exits_to(jnp.int32(end), jnp.int32(2)))
        closed = np.asarray(network.valid) & ~exits
        found = zip(np.nonzero(closed)[0].tolist(), np.asarray(network.exit_node)[closed].tolist(), strict=True)
        assert set(found) == refused(network, end)


def test_without_restricted_streets_there_are_no_areas(block, make_town) -> None:
    network = block().network()
    assert network.area is network.enters is None
    np.testing.assert_array_equal(network.exits_to(jnp.int32(3)), network.valid)
    np.testing.assert_array_equal(network.exits_from(jnp.int32(3)), network.valid)
    assert np.asarray(network.may_take(jnp.int32(3))).all()
    # Where all are restricted, everybody is inside.
    inside = make_town(XY, ENDS, restricted=np.ones(8, bool)).network()
    assert set(inside.area.tolist()) == {0}
    assert np.asarray(inside.may_take(jnp.int32(3))).all()


def test_a_restricted_street_between_open_ones_is_never_on_the_way(block) -> None:
    network = block(restricted=True).network()
    assert set(network.area.tolist()) == {-1}
    assert all(refused(network, end) == {(5, 10), (10, 5)} for end in range(16))


def test_open_streets_behind_restricted_ones_belong_to_the_area(make_town) -> None:
    # 0 and 1 are the town; 2 to 3 restricted, and 3 to 4 open but with no other way in.
    ends = [(0, 1), (1, 2), (2, 0), (2, 3), (3, 4)]
    network = make_town(XY[:5], ends, restricted=np.arange(5) == 3).network()
    assert network.area.tolist() == [-1, -1, -1, 0, 0]
    assert refused(network, 4) == set()
    assert refused(network, 0) == {(2, 3)}


def test_a_point_in_a_restricted_street_is_inside(block) -> None:
    town = block(restricted=True)
    middle = StreetPoint(24, 0.5, 0.0, tuple((town.course(24).mean(axis=0)[::-1]).tolist()))
    streets = split_streets(town, [middle, 0])
    network, node = streets.network, streets.nodes[0]
    assert (int(network.area[node]), node) == (0, 16)
    assert refused(network, node) == set()
    # Who begins there may leave by both ends, but nobody comes by.
    assert refused(network, 10) == {(5, 16), (10, 16)}


def test_points_on_streets_within_an_area(town) -> None:
    here = StreetPoint(4, 0.5, 0.0, tuple((town.course(4).mean(axis=0)[::-1]).tolist()))
    there = StreetPoint(0, 0.5, 0.0, tuple((town.course(0).mean(axis=0)[::-1]).tolist()))
    network = split_streets(town, [here, there]).network
    assert network.area.tolist() == [-1, -1, -1, 0, 0, 1, 1, 0, -1]
    assert refused(network, 7) == {(2, 5)}
    assert refused(network, 8) == {(0, 3), (1, 4), (2, 5)}


def test_streets_that_are_never_open_are_not_walked(make_town) -> None:
    town = make_town(XY, ENDS, opening=("off", *[""] * 6, "22:00-06:00"))
    network = town.network()
    assert town.never_open.tolist() == [True, *[False] * 7]
    assert np.asarray(network.enters)[[0, 8]].tolist() == [SHUT, SHUT]
    assert set(np.asarray(network.area).tolist()) == {ABSENT}
    assert all(refused(network, end) == {(0, 1), (1, 0)} for end in range(7))
    middle = StreetPoint(0, 0.5, 0.0, tuple((town.course(0).mean(axis=0)[::-1]).tolist()))
    assert len(refused(split_streets(town, [middle]).network, 7)) == 4


def test_opening_times_that_cannot_be_read(block) -> None:
    with pytest.raises(TownError) as caught:
        block("whenever")
    assert caught.value.field == "opening"


def test_side_by_side_areas_stay_apart(town, block) -> None:
    one, plain = town.network(), block().network()
    both = disjoint_union([one, plain, one])
    np.testing.assert_array_equal(both.area[:7], one.area)
    assert np.asarray(both.area)[7:23].tolist() == [-1] * 16
    assert np.asarray(both.area)[23:].tolist() == [-1, -1, -1, 2, 2, 3, 3]
    assert refused(both, 23 + 6) == {(0, 3), (1, 4), (2, 5), (23, 26), (24, 27)}
    assert disjoint_union([plain, plain]).enters is None


NODES = 9
pairs = st.tuples(st.integers(0, NODES - 1), st.integers(0, NODES - 1)).filter(lambda ends: ends[0] != ends[1])


@settings(max_examples=60)
@given(st.lists(st.tuples(pairs, st.booleans(), st.booleans()), min_size=4, max_size=24))
def test_every_walk_in_a_connected_town_can_be_walked(make_town, streets) -> None:
    used, ends = np.unique([pair for pair, _, _ in streets], return_inverse=True)
    ends = ends.reshape(-1, 2)
    one_way, restricted = (np.array([street[number] for street in streets]) for number in (1, 2))
    nodes = len(used)
    xy = np.stack([10.0 * np.arange(nodes), 100.0 * np.sin(np.arange(nodes))], axis=1)
    network = make_town(xy, ends.tolist(), one_way=one_way, restricted=restricted).network()
    tail, head = np.asarray(network.tail), np.asarray(network.head)

    def graph(kept: np.ndarray) -> coo_array:
        return coo_array((np.ones(kept.sum()), (tail[kept], head[kept])), shape=(nodes, nodes)).tocsr()

    if connected_components(graph(np.ones(len(tail), bool)), connection="strong")[0] > 1:
        return
    reached = {origin: breadth_first_order(graph(_from(network, origin)), origin)[0] for origin in range(nodes)}
    for destination in range(nodes):
        allowed = np.asarray(network.may_take(jnp.int32(destination)))
        home = breadth_first_order(graph(allowed).T.tocsr(), destination, return_predecessors=False)
        assert len(home) == nodes
        # Nobody leaves an area that was entered and does not hold the destination.
        if network.enters is not None and network.area[destination] == ABSENT:
            assert (np.asarray(network.enters)[allowed] == ABSENT).all()
    assert all(len(found) == nodes for found in reached.values())


def _from(network: RoadNetwork, origin: int) -> np.ndarray:
    valid = np.asarray(network.exits_from(jnp.int32(origin)))
    return np.isin(np.arange(network.segments), np.asarray(network.exit_segment)[valid])
