"""Loops, parallel streets, and streets joined where only two meet, on towns small enough to work out by hand."""

import numpy as np
import pytest

FOOT = {"highway": "footway"}


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
    up = {"highway": "steps", "conveying": "forward"}
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
