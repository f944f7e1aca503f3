"""The part of a town in which every crossing can be reached from every other."""

import numpy as np

FOOT = {"highway": "footway"}


def test_streets_that_cannot_be_walked_both_ways_need_a_way_back(build, listed) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (200, 0), 4: (100, -300), 5: (300, 0)}
    ways = {
        1: ((1, 2), {**FOOT, "oneway": "yes"}),
        2: ((3, 2), {**FOOT, "oneway": "-1"}),
        3: ((1, 4, 3), FOOT),
        4: ((3, 5), {"highway": "steps", "conveying": "forward"}),  # nobody comes back from 5
    }
    town, report = build(nodes, ways)
    # 1 > 2 > 3 is joined, since both lead on; two sides of 316.23 m lead back.
    assert listed(town) == [(1, 3, 200), (1, 3, 632)]
    assert town.one_way.tolist().count(True) == 1
    assert report.dropped == {"street: outside the largest connected part": 1}
    single = int(np.argmax(town.one_way))
    assert (town.ids[town.tail[single]], town.ids[town.head[single]]) == (1, 3)
    assert town.network().segments == 3
