"""Crossings near each other, whose crossings of vehicle traffic are, loops, parallel streets, and streets joined where
only two meet, on towns small enough to work out by hand.
"""

import numpy as np
import pytest

FOOT = {"highway": "footway"}
CROSSING, LIGHTS = {"highway": "crossing"}, {"highway": "traffic_signals"}

STAGGERED = (
    {1: (0, 0), 2: (100, 0), 3: (105, 0), 4: (200, 0), 5: (100, 50), 6: (105, -50)},
    {1: ((1, 2, 3, 4), FOOT), 2: ((2, 5), FOOT), 3: ((3, 6), FOOT)},
)


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
    # 2 stands for both: 3-4 becomes 5 + 95 m, 3-6 becomes 5 + 50 m.
    assert listed(town) == [(1, 2, 100), (2, 4, 100), (2, 5, 50), (2, 6, 55)]
    assert report.dropped == {"street: inside a merged crossing": 1}
    assert (report.nodes_before, report.streets_before, report.nodes, report.streets) == (6, 5, 5, 4)
    extended = town.course(int(np.argmin(np.abs(town.length - 55))))
    assert len(extended) == 3


def test_zero_merges_nothing(build, listed) -> None:
    town, _ = build(*STAGGERED, merge=0)
    assert listed(town) == [(1, 2, 100), (2, 3, 5), (2, 5, 50), (3, 4, 95), (3, 6, 50)]


def test_nodes_at_the_same_place_are_one_even_so(build, listed) -> None:
    nodes, ways = dict(STAGGERED[0]), STAGGERED[1]
    nodes[3] = nodes[2]
    town, _ = build(nodes, ways, merge=0)
    # 6 is 50.25 from there
    assert listed(town) == [(1, 2, 100), (2, 4, 100), (2, 5, 50), (2, 6, 50)]


def test_merged_crossings_do_not_grow_without_end(build, listed) -> None:
    # Six crossings 6 m apart, each with a side street. Three fit in 16 m; the fourth would make it 18.
    nodes = {i: (6 * i, 0) for i in range(6)} | {10 + i: (6 * i, 100 + 10 * i) for i in range(6)}
    ways = {1: (tuple(range(6)), FOOT)} | {10 + i: ((i, 10 + i), FOOT) for i in range(6)}
    town, _ = build(nodes, ways, merge=8)
    assert (1, 4, 18) in listed(town)  # the middle of each stands for it
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


def test_a_crossing_where_streets_meet_counts_for_one(build) -> None:
    # A footway over a road at 2; its shorter arm, 2-4 of 10 m, gets the crossing.
    nodes = {1: (0, 0), 2: (5, 0, CROSSING), 3: (250, 0), 4: (5, 10), 5: (5, -20)}
    road = {"highway": "residential"}
    town, _ = build(nodes, {1: ((1, 2, 3), road), 2: ((4, 2, 5), FOOT)})
    counted = {round(float(length)): int(n) for length, n in zip(town.length, town.crossings, strict=True)}
    assert counted == {5: 0, 245: 0, 10: 1, 20: 0}


def test_crossings_of_merged_streets_are_handed_on(build) -> None:
    # As above, but the arm 2-4 of 6 m goes: the shortest street of the merged crossing takes its lights.
    nodes = {1: (-40, 0), 2: (5, 0, LIGHTS), 3: (250, 0), 4: (5, 6), 5: (5, -20), 6: (5, 60), 7: (50, 50)}
    road = {"highway": "residential"}
    town, _ = build(nodes, {1: ((1, 2, 3), road), 2: ((4, 2, 5), FOOT), 3: ((4, 6), FOOT), 4: ((4, 7), FOOT)}, merge=8)
    assert town.signals.sum() == 1
    assert round(float(town.length[np.argmax(town.signals)])) in (20, 26)


def test_joined_streets_take_the_greater_part(build) -> None:
    nodes = {1: (0, 0), 2: (90, 0), 3: (120, 0)}
    ways = {
        1: ((1, 2), {**FOOT, "width": "2", "name": "Long Walk"}),
        2: ((3, 2), {"highway": "path", "width": "4", "name": "Short Walk"}),
    }
    town, report = build(nodes, ways)
    assert (town.kind, town.name) == (("footway",), ("Long Walk",))
    assert float(town.width[0]) == pytest.approx((90 * 2 + 30 * 4) / 120, abs=1e-3)
    assert float(town.length[0]) == pytest.approx(120, abs=0.02)
    assert len(town.course(0)) == 3  # the point where they met is there once
    assert report.repaired == {"crossing: two streets joined into one": 1}


def test_a_one_way_street_is_not_joined_with_another(build, listed) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (200, 0), 4: (100, -300)}
    ways = {1: ((1, 2), {**FOOT, "oneway": "yes"}), 2: ((2, 3), FOOT), 3: ((1, 4, 3), FOOT)}
    assert listed(build(nodes, ways)[0]) == [(1, 2, 100), (1, 2, 732)]


@pytest.mark.parametrize(("detour", "kept"), [(3, 1), (20, 2)])
def test_parallel_streets_stay_only_if_much_longer(build, detour: int, kept: int) -> None:
    # 1 to 2 straight, 200 m, and by 3: 2 * hypot(100, y) = 200 + detour
    y = float(np.sqrt((100 + detour / 2) ** 2 - 100**2))
    nodes = {1: (0, 0), 2: (200, 0), 3: (100, y), 4: (-50, 0), 5: (250, 0)}
    ways = {1: ((1, 2), FOOT), 2: ((1, 3, 2), FOOT), 3: ((4, 1), FOOT), 4: ((2, 5), FOOT)}
    town, report = build(nodes, ways, merge=8)
    assert report.dropped.get("street: parallel to a shorter one", 0) == 2 - kept
    assert town.streets == (4 if kept == 2 else 1)  # with one, all four are joined


def test_a_street_drawn_twice_is_one(build, listed, tee) -> None:
    town, _ = build(tee[0], {**tee[1], 12: ((3, 2), {"highway": "cycleway", "foot": "yes"})})
    assert listed(town) == [(1, 2, 100), (2, 3, 150), (2, 4, 80)]


def test_a_shorter_one_way_street_does_not_replace_the_way_back(build, listed) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (50, 10), 4: (-50, 0), 5: (150, 0)}
    up = {"highway": "footway", "oneway:foot": "yes"}
    ways = {1: ((1, 2), up), 2: ((1, 3, 2), FOOT), 3: ((4, 1), FOOT), 4: ((2, 5), FOOT)}
    town, _ = build(nodes, ways, merge=8)
    assert listed(town) == [(1, 2, 100), (1, 2, 102), (1, 4, 50), (2, 5, 50)]
    # but where the street for both ways is the shorter one, it is enough
    ways[1], ways[2] = ((1, 2), FOOT), ((1, 3, 2), up)
    assert listed(build(nodes, ways, merge=8)[0]) == [(4, 5, 200)]


def test_loops_go(build, listed, tee) -> None:
    nodes = {**tee[0], 5: (300, 50), 6: (350, 0)}
    town, report = build(nodes, {**tee[1], 12: ((3, 5, 6, 3), FOOT)})
    assert listed(town) == [(1, 2, 100), (2, 3, 150), (2, 4, 80)]
    assert report.dropped == {"street: loop": 1}


def test_a_ring_alone_stays(build) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (100, 100)}
    town, _ = build(nodes, {1: ((1, 2), FOOT), 2: ((2, 3), FOOT), 3: ((3, 1), FOOT)})
    assert (town.nodes, town.streets) == (3, 3)
