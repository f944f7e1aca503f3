"""Whose crossings of vehicle traffic are, loops, parallel streets, and streets joined where only two meet, on towns
small enough to work out by hand.
"""

import pytest

FOOT, STEPS = {"highway": "footway"}, {"highway": "steps"}
CROSSING = {"highway": "crossing"}


def test_a_crossing_where_streets_meet_counts_for_one(build) -> None:
    # A footway over a road at 2; its shorter arm, 2-4 of 10 m, gets the crossing.
    nodes = {1: (0, 0), 2: (5, 0, CROSSING), 3: (250, 0), 4: (5, 10), 5: (5, -20)}
    road = {"highway": "residential"}
    town, _ = build(nodes, {1: ((1, 2, 3), road), 2: ((4, 2, 5), FOOT)})
    counted = {round(float(length)): int(n) for length, n in zip(town.length, town.crossings, strict=True)}
    assert counted == {5: 0, 245: 0, 10: 1, 20: 0}


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


@pytest.mark.parametrize(
    ("bend", "kept"),
    [
        (((100, 4),), 1),  # 4 m beside it and 0.2 m longer
        (((50, 4.9), (100, 0), (150, 4.9)), 1),
        (((100, 17.4),), 2),  # 3 m longer, but 17 m away
        (((0, 40), (200, 40)), 2),  # the other bank of a river
        (tuple((10 * i, 4.5 * (-1) ** i) for i in range(1, 20)), 2),  # 4.5 m beside it, but much longer
    ],
)
def test_parallel_streets_go_only_if_they_are_beside_and_hardly_longer(build, bend, kept: int) -> None:
    nodes = {1: (0, 0), 2: (200, 0), 4: (-50, 0), 5: (250, 0)} | {10 + i: at for i, at in enumerate(bend)}
    through = (1, *(10 + i for i in range(len(bend))), 2)
    ways = {1: ((1, 2), FOOT), 2: (through, FOOT), 3: ((4, 1), FOOT), 4: ((2, 5), FOOT)}
    town, report = build(nodes, ways, merge=8)
    assert report.dropped.get("street: parallel to a shorter one", 0) == 2 - kept
    assert town.streets == (4 if kept == 2 else 1)  # with one, all four are joined


@pytest.mark.parametrize("merge", [0, 8])
@pytest.mark.parametrize("longer", [0, 9])
def test_both_banks_stay(build, listed, longer: int, merge: float) -> None:
    # 40 + 400 + 40 m on the north bank, and on the south bank as long or 9 m longer.
    south = -40 - longer / 2
    nodes = {
        1: (0, 0),
        2: (400, 0),
        3: (0, 40),
        4: (400, 40),
        5: (0, south),
        6: (400, south),
        7: (-90, 0),
        8: (490, 0),
    }
    ways = {1: ((1, 3, 4, 2), FOOT), 2: ((1, 5, 6, 2), FOOT), 3: ((7, 1), FOOT), 4: ((2, 8), FOOT)}
    assert listed(build(nodes, ways, merge=merge)[0]) == [(1, 2, 480), (1, 2, 480 + longer), (1, 7, 90), (2, 8, 90)]


def test_a_ramp_beside_steps_stays(build, listed) -> None:
    nodes = {1: (0, 0), 2: (30, 0), 3: (-50, 0), 4: (90, 0), 5: (15, 3), 6: (-50, 50), 7: (90, 50)}
    ways = {
        1: ((1, 2), STEPS),
        2: ((1, 5, 2), FOOT),
        3: ((3, 1), FOOT),
        4: ((2, 4), FOOT),
        5: ((6, 1), FOOT),
        6: ((7, 2), FOOT),
    }
    town = build(nodes, ways, merge=8)[0]
    between = [row for row in listed(town) if row[:2] == (1, 2)]
    assert between == [(1, 2, 30), (1, 2, 31)]
    assert sorted(town.kind) == ["footway"] * 5 + ["steps"]


def test_steps_are_not_joined_with_level_ways(build, listed) -> None:
    nodes = {1: (0, 0), 2: (90, 0), 3: (110, 0), 4: (125, 0), 5: (200, 0)}
    town = build(nodes, {1: ((1, 2), FOOT), 2: ((2, 3, 4), STEPS), 3: ((4, 5), FOOT)}, merge=8)[0]
    assert listed(town) == [(1, 2, 90), (2, 4, 35), (4, 5, 75)]


def test_a_street_drawn_twice_is_one(build, listed, tee) -> None:
    town, _ = build(tee[0], {**tee[1], 12: ((3, 2), {"highway": "cycleway", "foot": "yes"})})
    assert listed(town) == [(1, 2, 100), (2, 3, 150), (2, 4, 80)]


def test_a_shorter_one_way_street_does_not_replace_the_way_back(build, listed) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (50, 10), 4: (-50, 0), 5: (150, 0)}
    up = {"highway": "footway", "oneway:foot": "yes"}
    ways = {1: ((1, 2), up), 2: ((1, 3, 2), FOOT), 3: ((4, 1), FOOT), 4: ((2, 5), FOOT)}
    town, _ = build(nodes, ways, merge=8)
    assert listed(town) == [(1, 2, 100), (1, 2, 102), (1, 4, 50), (2, 5, 50)]
    # but where the street for both ways is the shorter one, it is enough if the other runs beside it
    nodes[3] = (50, 3)
    ways[1], ways[2] = ((1, 2), FOOT), ((1, 3, 2), {**FOOT, "oneway": "yes"})
    assert listed(build(nodes, ways, merge=8)[0]) == [(4, 5, 200)]


@pytest.mark.parametrize(("side", "pieces"), [(12, 1), (12, 3), (13, 1), (13, 3), (150, 1), (150, 3)])
def test_short_loops_go_and_long_ones_are_two_streets(build, listed, tee, side: int, pieces: int) -> None:
    # A square loop at 3 with sides of 12, 13 or 150 m, drawn as one way or as three.
    nodes = {**tee[0], 5: (250 + side, 0), 6: (250 + side, side), 7: (250, side)}
    loop = (3, 5, 6, 7, 3)
    drawn = [loop] if pieces == 1 else [loop[:2], loop[1:4], loop[3:]]
    town, report = build(nodes, {**tee[1], **{20 + i: (refs, FOOT) for i, refs in enumerate(drawn)}}, merge=8)
    rest = [(1, 2, 100), (2, 3, 150), (2, 4, 80)]
    if side == 12:
        assert listed(town) == rest
        assert report.dropped == {"street: loop": 1}
    else:
        loop = sorted(set(listed(town)) - set(rest))
        assert len({row[:2] for row in loop}) == 1
        assert town.streets == 5
        assert float(town.length.sum()) == pytest.approx(330 + 4 * side, abs=0.1)


def test_a_narrow_loop_is_a_dead_end(build, listed, tee) -> None:
    # Out and back 3 m apart: to the far end of it is enough.
    nodes = {**tee[0], 5: (350, 0), 6: (350, 3), 7: (250, 3)}
    town = build(nodes, {**tee[1], 20: ((3, 5, 6, 7, 3), FOOT)}, merge=8)[0]
    assert len(set(listed(town))) == town.streets
    assert float(town.length.sum()) == pytest.approx(330 + 103, abs=4)


def test_an_out_and_back_way_is_a_dead_end(build, listed, tee) -> None:
    nodes = {**tee[0], 5: (300, 50)}
    town = build(nodes, {**tee[1], 20: ((3, 5, 3), FOOT)})[0]
    assert listed(town) == [(1, 2, 100), (2, 4, 80), (2, 5, 221)]


@pytest.mark.parametrize("merge", [0, 8])
def test_a_path_round_a_lake_stays(build, listed, merge: float) -> None:
    # One entry at 2, 558 m round; all of it can be reached.
    nodes = {1: (0, 0), 2: (100, 0), 3: (140, 80), 4: (240, 80), 5: (280, 0), 6: (240, -80), 7: (140, -80)}
    town, report = build(nodes, {1: ((1, 2), FOOT), 2: ((2, 3, 4, 5, 6, 7, 2), FOOT)}, merge=merge)
    assert listed(town) == [(1, 2, 100), (2, 5, 279), (2, 5, 279)]
    assert "street: loop" not in report.dropped


def test_a_long_loop_with_two_entries_near_each_other_stays(build, listed) -> None:
    # Merging 2 and 3 would make a loop of what is left: they stay two crossings.
    nodes = {1: (0, 0), 2: (100, 0), 3: (100, 6), 4: (200, 6), 5: (200, 0), 6: (0, 6)}
    ways = {1: ((1, 2, 5), FOOT), 2: ((6, 3, 4), FOOT), 3: ((2, 3), FOOT), 4: ((4, 5), FOOT)}
    assert (2, 3, 206) in listed(build(nodes, ways, merge=8)[0])


def test_a_ring_alone_stays(build) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (100, 100)}
    town, _ = build(nodes, {1: ((1, 2), FOOT), 2: ((2, 3), FOOT), 3: ((3, 1), FOOT)})
    assert (town.nodes, town.streets) == (3, 3)
