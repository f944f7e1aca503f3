"""Crossings near each other, on towns small enough to work out by hand, and the lengths of walks across them."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from sidestep.network.town import Town

FOOT, STEPS = {"highway": "footway"}, {"highway": "steps"}
LIGHTS = {"highway": "traffic_signals"}

STAGGERED = (
    {1: (0, 0), 2: (100, 0), 3: (105, 0), 4: (200, 0), 5: (100, 50), 6: (105, -50)},
    {1: ((1, 2, 3, 4), FOOT), 2: ((2, 5), FOOT), 3: ((3, 6), FOOT)},
)


def distances(town: Town, numbers) -> np.ndarray:
    """Metres of the shortest walks between nodes, given by OpenStreetMap's numbers; no streets are parallel."""
    ends = np.concatenate([np.stack([town.tail, town.head]), np.stack([town.head, town.tail])], axis=1)
    graph = coo_array((np.tile(town.length.astype(float), 2), tuple(ends)), shape=(town.nodes,) * 2).tocsr()
    nodes = [town.ids.tolist().index(number) for number in numbers]
    return dijkstra(graph, indices=nodes)[:, nodes]


def test_a_bridge_does_not_meet_what_is_below(build, listed) -> None:
    # Nodes 5 and 6 are at the same place, one on the bridge and one below; the ways join far away.
    nodes = {
        1: (0, 0),
        2: (200, 0),
        3: (100, -100),
        4: (100, 100),
        5: (100, 0),
        6: (100, 0),
        7: (300, 0),
        8: (100, 200),
    }
    ways = {
        1: ((1, 5, 2), {**FOOT, "bridge": "yes", "layer": "1"}),
        2: ((3, 6, 4), FOOT),
        3: ((2, 4), FOOT),
        4: ((2, 7), FOOT),
        5: ((4, 8), FOOT),
    }
    town, _ = build(nodes, ways, merge=20)
    assert listed(town) == [(1, 2, 200), (2, 4, 141), (2, 7, 100), (3, 4, 200), (4, 8, 100)]


def test_crossings_near_each_other_merge(build, listed) -> None:
    town, report = build(*STAGGERED, merge=8)
    # Each street grows by 5/3 m: of the six walks across, the two that stay at 2 or at 3 become 10/3 m longer, the four
    # from 2 to 3 5/3 m shorter.
    assert listed(town) == [(1, 2, 102), (2, 4, 97), (2, 5, 52), (2, 6, 52)]
    np.testing.assert_allclose(sorted(town.length), [50 + 5 / 3, 50 + 5 / 3, 95 + 5 / 3, 100 + 5 / 3], atol=0.02)
    assert report.dropped == {"street: inside a merged crossing": 1}
    assert (report.nodes_before, report.streets_before, report.nodes, report.streets) == (6, 5, 5, 4)


def test_zero_merges_nothing(build, listed) -> None:
    town, _ = build(*STAGGERED, merge=0)
    assert listed(town) == [(1, 2, 100), (2, 3, 5), (2, 5, 50), (3, 4, 95), (3, 6, 50)]


def test_nodes_at_the_same_place_are_one_even_so(build, listed) -> None:
    nodes, ways = dict(STAGGERED[0]), STAGGERED[1]
    nodes[3] = nodes[2]
    town, _ = build(nodes, ways, merge=0)
    # 6 is 50.25 from there
    assert listed(town) == [(1, 2, 100), (2, 4, 100), (2, 5, 50), (2, 6, 50)]


def test_streets_of_no_length_join_with_a_width(build, listed) -> None:
    nodes = {1: (0, 0), 2: (50, 0), 3: (50, 0), 4: (50, 0), 5: (90, 0), 6: (50, 60)}
    ways = {1: ((1, 2), FOOT), 2: ((2, 3), FOOT), 3: ((3, 4), FOOT), 4: ((4, 5), FOOT), 5: ((2, 6), FOOT)}
    town, _ = build(nodes, ways)
    assert listed(town) == [(1, 2, 50), (2, 5, 40), (2, 6, 60)]
    np.testing.assert_allclose(town.width, 2)


def test_merged_crossings_do_not_grow_without_end(build, listed) -> None:
    # Crossings 6 m apart, each with a side street; where two are merged, streets grow by 2 m and walks are off by 2.8 m
    # (root mean square). With three, they would grow by 4, 2 and 4 m and be off by sqrt(192 / 10) = 4.4 m.
    nodes = {i: (6 * i, 0) for i in range(6)} | {10 + i: (6 * i, 100 + 10 * i) for i in range(6)}
    ways = {1: (tuple(range(6)), FOOT)} | {10 + i: ((i, 10 + i), FOOT) for i in range(6)}
    town, _ = build(nodes, ways, merge=8)
    assert (1, 3, 2 + 6 + 2) in listed(town)
    assert town.nodes == 2 + 6
    assert sorted(np.bincount(np.concatenate([town.tail, town.head]))) == [1] * 6 + [4, 4]


def test_merged_crossings_do_not_get_ever_more_streets(build) -> None:
    # Two stars of 4 rays each, 5 m apart, would be one crossing with 8 neighbours; with 3 and 4 there are 7.
    def star(centre: int, rays: int) -> dict:
        return {100 * centre + i: (5 * centre + 60 * np.cos(i), (2 * centre - 3) * (20 + 10 * i)) for i in range(rays)}

    for rays, nodes_left in ((4, 10), (3, 8)):
        nodes = {1: (5, 0), 2: (10, 0), **star(1, rays), **star(2, 4)}
        ways = {ray: ((ray // 100, ray), FOOT) for ray in nodes if ray > 2} | {1: ((1, 2), FOOT)}
        town, report = build(nodes, ways, merge=8)
        assert town.nodes == nodes_left
        assert report.most_exits == (5 if rays == 4 else 7)


def test_crossings_of_merged_streets_are_handed_on(build) -> None:
    # As above, but the arm 2-4 of 6 m goes: the shortest street of the merged crossing takes its lights.
    nodes = {1: (-40, 0), 2: (5, 0, LIGHTS), 3: (250, 0), 4: (5, 6), 5: (5, -20), 6: (5, 60), 7: (50, 50)}
    road = {"highway": "residential"}
    town, _ = build(nodes, {1: ((1, 2, 3), road), 2: ((4, 2, 5), FOOT), 3: ((4, 6), FOOT), 4: ((4, 7), FOOT)}, merge=8)
    assert town.signals.sum() == 1
    # With three streets at 2 and two at 4, those grow by 1 m and these by 3 m.
    assert round(float(town.length[np.argmax(town.signals)])) == 21
    assert round(float(town.length.sum())) == 45 + 245 + 20 + 54 + 63 + 3 * 1 + 2 * 3


def test_dead_ends_keep_their_depth(build, listed) -> None:
    # 4 is 5 m off the crossing 2. Nobody walks across there, so nothing changes for those who pass.
    nodes = {1: (0, 0), 2: (100, 0), 3: (200, 0), 4: (100, 5), 5: (200, 5), 6: (200, 90), 7: (206, 5)}
    ways = {1: ((1, 2, 3), FOOT), 2: ((2, 4), FOOT), 3: ((3, 5, 6), FOOT), 4: ((5, 7), FOOT)}
    # Without 4 and 7, 1-2-3-5-6 is one street.
    assert listed(build(nodes, ways, merge=8)[0]) == [(1, 6, 290)]


def test_steps_never_vanish(build, listed) -> None:
    nodes, ways = STAGGERED
    ways = {1: ((1, 2), FOOT), 4: ((2, 3), STEPS), 5: ((3, 4), FOOT), 2: ways[2], 3: ways[3]}
    town = build(nodes, ways, merge=8)[0]
    assert listed(town) == [(1, 2, 100), (2, 3, 5), (2, 5, 50), (3, 4, 95), (3, 6, 50)]
    assert town.kind.count("steps") == 1


def test_one_way_streets_never_vanish(build, listed) -> None:
    nodes, ways = {**STAGGERED[0], 7: (130, 30)}, STAGGERED[1]
    up = {"highway": "footway", "oneway": "yes"}
    ways = {1: ((1, 2), FOOT), 4: ((2, 3), up), 5: ((3, 4), FOOT), 6: ((3, 7, 2), up), 2: ways[2], 3: ways[3]}
    assert (2, 3, 5) in listed(build(nodes, ways, merge=8)[0])


def test_courses_do_not_run_to_the_representative_and_back(build) -> None:
    # A path with a bend every 3 m along y = 0, crossed at (0, 0), and there 7 m beside it another crossing.
    bends = {100 + i: (3 * i, 0.3 * (-1) ** i) for i in range(-30, 31)}
    nodes = {**bends, 1: (0, 7), 2: (-80, 60), 3: (80, 60), 4: (0, -80)}
    ways = {1: (tuple(bends), FOOT), 2: ((100, 1), FOOT), 3: ((2, 1, 3), FOOT), 4: ((100, 4), FOOT)}
    town = build(nodes, ways, merge=8)[0]
    (middle,) = np.flatnonzero(np.bincount(np.concatenate([town.tail, town.head])) > 1)
    lines = {}
    for street in range(town.streets):
        line = town.project(town.course(street))
        lines[int(town.ids[town.tail[street] + town.head[street] - middle])] = (
            line if town.tail[street] == middle else line[::-1]
        )
    assert sorted(lines) == [2, 3, 4, 70, 130]
    # Straight on along the path, straight on along the other, and from one to the other.
    for one, other in ((70, 130), (2, 3), (4, 2), (4, 3), (4, 70), (4, 130), (70, 3), (2, 130)):
        steps = np.diff(np.concatenate([lines[one][::-1], lines[other][1:]]), axis=0)
        steps /= np.hypot(*steps.T)[:, None]
        turn = np.degrees(np.arccos(np.clip((steps[1:] * steps[:-1]).sum(axis=1), -1, 1)))
        assert turn.max() <= 100


@pytest.mark.parametrize("merge", [6, 10, 14])
def test_walks_through_a_town_of_pavements_keep_their_lengths(build, merge: float) -> None:
    # Blocks of 60 by 80 m with pavements along their four sides; zebra crossings of 4 to 9 m join their corners.
    rng = np.random.default_rng(0)
    number, nodes, ways = 0, {}, {}
    corner = {}
    for x in range(5):
        for y in range(5):
            inset = rng.uniform(2, 4.5, 4)
            for at, (dx, dy) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                number += 1
                corner[x, y, at] = number
                nodes[number] = (
                    60 * (x + dx) + (1 - 2 * dx) * inset[at],
                    80 * (y + dy) + (1 - 2 * dy) * inset[(at + 1) % 4],
                )
            ways[len(ways) + 1] = (tuple(corner[x, y, at] for at in (0, 1, 2, 3, 0)), FOOT)
    for x in range(5):
        for y in range(5):
            for here, there, dx, dy in ((1, 0, 1, 0), (2, 3, 1, 0), (3, 0, 0, 1), (2, 1, 0, 1)):
                if (x + dx, y + dy, there) in corner:
                    ways[len(ways) + 1] = ((corner[x, y, here], corner[x + dx, y + dy, there]), FOOT)
    exact, merged = build(nodes, ways)[0], build(nodes, ways, merge=merge)[0]
    assert merged.nodes < 0.9 * exact.nodes
    numbers = np.intersect1d(exact.ids, merged.ids)
    before, after = distances(exact, numbers), distances(merged, numbers)
    ratio = (after / np.where(before > 0, before, 1))[before > 100]
    assert abs(np.median(ratio) - 1) < 0.015
    assert (abs(ratio - 1) < 0.05).mean() > 0.9


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    gaps=st.lists(st.floats(0.5, 7.5), min_size=1, max_size=3),
    arms=st.lists(st.integers(1, 3), min_size=4, max_size=4),
)
def test_walks_across_one_crossing_are_as_long_as_before_in_the_mean(build, gaps, arms) -> None:
    # Crossings along a line, with one to three dead ends of 60 m and more at each.
    nodes = {i: (x, 0) for i, x in enumerate(np.cumsum([0, *gaps]).tolist(), start=1)}
    ways = {1: (tuple(nodes), FOOT)}
    ends = []
    for node, count in zip(list(nodes), arms, strict=False):
        for arm in range(count):
            end = 100 + len(ends)
            angle = 0.4 + 2.1 * arm + 0.3 * node
            nodes[end] = (nodes[node][0] + 60 * np.cos(angle), 60 * np.sin(angle))
            ways[end] = ((node, end), FOOT)
            ends.append(end)
    exact, merged = build(nodes, ways)[0], build(nodes, ways, merge=8)[0]
    if merged.nodes > len(ends) + 1 or len(ends) < 3:
        return  # more than one crossing is left, or none
    upper = np.triu_indices(len(ends), 1)
    change = (distances(merged, ends) - distances(exact, ends))[upper]
    assert np.sqrt((change**2).mean()) <= 4 + 0.01
    assert -0.01 <= change.mean() <= 1
