"""Crossings near each other, and whose crossings of vehicle traffic are, on towns small enough to work out by hand."""

import numpy as np

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
