"""Squares of 100 m with the corners 1 to 4, to two of which streets of 50 m lead."""

import numpy as np
import pytest

from sidestep.network.osm import OsmError

FOOT = {"highway": "footway"}
SQUARE = {"highway": "pedestrian", "area": "yes", "name": "Market"}
NODES = {1: (0, 0), 2: (100, 0), 3: (100, 100), 4: (0, 100), 5: (0, -50), 6: (100, 150)}
ENTRIES = {20: ((5, 1), FOOT), 21: ((3, 6), FOOT)}
RING = (1, 2, 3, 4, 1)
HOLE = {11: (40, 40), 12: (60, 40), 13: (60, 60), 14: (40, 60)}
ACROSS = 141  # m, the diagonal
BOTH_SIDES = [(1, 3, 200), (1, 3, 200), (1, 5, 50), (3, 6, 50)]
AROUND = 2 * np.hypot(60, 40)  # round a corner of the hole


def across(town, *, by: str = "kind") -> dict[tuple[int, int], str]:
    """Name the ends and the kind, or another column, of the streets that are not among the entries."""
    streets = zip(town.ids[town.tail].tolist(), town.ids[town.head].tolist(), getattr(town, by), strict=True)
    return {(min(ends), max(ends)): value for *ends, value in streets if not {5, 6} & set(ends)}


@pytest.fixture
def square(build):
    """Import the square as a closed way with its tags, and further nodes and ways."""

    def make(tags=SQUARE, nodes=(), ways=(), relations=(), ring=RING):
        areas = {10: (ring, tags)} if ring else {}
        return build({**NODES, **dict(nodes)}, {**areas, **ENTRIES, **dict(ways)}, relations)

    return make


@pytest.mark.parametrize(
    "tags",
    [
        SQUARE,
        {"highway": "footway", "area": "yes"},
        {"highway": "pedestrian", "place": "square"},
        {"highway": "platform"},
        {"railway": "platform"},
        {"public_transport": "platform"},
        {"man_made": "pier"},
        {"highway": "service", "area": "yes"},
    ],
)
def test_a_closed_way_is_crossed(square, listed, tags) -> None:
    town, report = square(tags)
    assert listed(town) == [(5, 6, 50 + ACROSS + 50)]
    assert (report.areas, report.walkable) == (1, 3)


@pytest.mark.parametrize(
    "tags",
    [FOOT, {**SQUARE, "area": "no"}, {"railway": "platform", "area": "no"}, {"highway": "pedestrian"}],
)
def test_closed_ways_that_are_no_areas_are_walked_around(square, listed, tags) -> None:
    town, report = square(tags)
    assert listed(town) == BOTH_SIDES
    assert report.areas == 0


@pytest.mark.parametrize("tags", [{"access": "private"}, {"foot": "no"}, {"highway": "construction"}])
def test_areas_have_the_access_rules_of_ways(square, listed, tags) -> None:
    town, report = square({**SQUARE, **tags}, ways={22: ((1, 4, 3), FOOT)})
    assert listed(town) == [(5, 6, 300)]
    assert report.areas == 0


def test_lines_have_the_name_and_the_width_of_the_area(square) -> None:
    # A way round the square keeps its corners from being joined with the way across.
    town, _ = square({**SQUARE, "access": "destination"}, ways={22: ((1, 4, 3), FOOT)})
    line = next(i for i in range(town.streets) if town.kind[i] == "area")
    assert (town.name[line], bool(town.restricted[line])) == ("Market", True)
    assert town.width[line] == pytest.approx(50, abs=0.1)  # twice the area by the perimeter


@pytest.mark.parametrize(
    "pieces",
    [
        {30: RING},
        {30: (1, 2, 3), 31: (3, 4, 1)},
        {30: (3, 2, 1), 31: (3, 4, 1)},
        {30: (4, 1), 31: (2, 3), 32: (2, 1), 33: (3, 4)},
    ],
)
@pytest.mark.parametrize("tagged", [{}, {"name": "outer"}])
def test_a_multipolygon_is_crossed(square, listed, pieces, tagged) -> None:
    ways = {number: (refs, tagged) for number, refs in pieces.items()}
    town, report = square(ring=None, ways=ways, relations=[([(number, "outer") for number in pieces], SQUARE)])
    assert listed(town) == [(5, 6, 50 + ACROSS + 50)]
    assert (report.areas, report.ways) == (1, 3)


@pytest.mark.parametrize("role", ["inner", ""])
def test_holes_are_walked_round(square, role: str) -> None:
    ways = {30: (RING, {}), 31: ((11, 12, 13, 14, 11), {})}
    town, _ = square(nodes=HOLE, ring=None, ways=ways, relations=[([(30, "outer"), (31, role)], SQUARE)])
    assert float(town.length.max()) == pytest.approx(100 + AROUND, abs=0.1)


def test_a_relation_and_its_outer_way_are_one_area(square) -> None:
    ways = {31: ((11, 12, 13, 14, 11), {})}
    town, report = square(nodes=HOLE, ways=ways, relations=[([(10, "outer"), (31, "inner")], SQUARE)])
    assert float(town.length.max()) == pytest.approx(100 + AROUND, abs=0.1)
    assert report.areas == 1
    assert report.dropped == {"area: mapped by a relation as well": 1}


def test_a_relation_that_nobody_walks_leaves_its_outer_way_an_area(square) -> None:
    said = {**SQUARE, "oneway:foot": "yes", "foot:forward": "no"}
    _, report = square(relations=[([(10, "outer")], said)])
    assert (report.areas, report.dropped) == (1, {"way: contradicting directions": 1})


@pytest.mark.parametrize(("more", "holes"), [({}, True), ({"source": "survey"}, True), ({"building": "yes"}, False)])
def test_a_relation_without_tags_has_those_of_its_outer_way(square, more, holes: bool) -> None:
    ways = {31: ((11, 12, 13, 14, 11), {})}
    town, report = square(nodes=HOLE, ways=ways, relations=[([(10, "outer"), (31, "inner")], more)])
    assert float(town.length.max()) == pytest.approx(100 + (AROUND if holes else np.hypot(100, 100)), abs=0.1)
    assert (report.areas, report.walkable) == (1, 3)
    assert set(town.name) <= {"", "Market"}


def test_an_outer_way_that_is_a_way_stays_one(square) -> None:
    town, _ = square(ring=None, ways={30: (RING, FOOT)}, relations=[([(30, "outer")], SQUARE)])
    sides = dict.fromkeys([(1, 2), (2, 3), (3, 4), (1, 4)], "footway")
    assert across(town) == {**sides, (1, 3): "area", (2, 4): "area"}


@pytest.mark.parametrize(
    ("ways", "members", "reason", "sides"),
    [
        ({30: ((1, 2, 3), {})}, [(30, "outer")], "open ring", 1),
        ({30: (RING, {})}, [(30, "outer"), (99, "inner")], "open ring", 2),
        ({30: (RING, {}), 31: ((11, 12), {})}, [(30, "outer"), (31, "inner")], "open ring", 2),
        ({30: ((1, 2, 3, 98, 1), {})}, [(30, "outer")], "missing nodes", 1),
        ({30: ((1, 2, 3, 2, 1), {})}, [(30, "outer")], "no area within its rings", 1),
    ],
)
def test_what_cannot_be_crossed_is_walked_along(square, listed, ways, members, reason, sides: int) -> None:
    town, report = square(nodes=HOLE, ring=None, ways=ways, relations=[(members, SQUARE)])
    assert report.areas == 0
    assert report.repaired[f"area: walked along its outline, {reason}"] == 1
    assert listed(town) == ([(5, 6, 300)] if sides == 1 else BOTH_SIDES)


def test_rings_that_cross_are_repaired(square) -> None:
    # The corners 3 and 4 are swapped; a street joins the two triangles outside.
    town, report = square(ring=(1, 2, 4, 3, 1), ways={22: ((2, 3), FOOT)})
    assert report.repaired["area: rings that cross or overlap"] == 1
    assert report.areas == 1
    assert float(town.length.sum()) == pytest.approx(50 + 100 + 100 + 50, abs=0.1)


def test_adjacent_areas_are_crossed_from_one_to_the_next(build, listed) -> None:
    nodes = {**NODES, 7: (200, 0), 8: (200, 100), 9: (250, 0)}
    ways = {
        10: (RING, SQUARE),
        11: ((2, 7, 8, 3, 2), SQUARE),
        20: ((5, 1), FOOT),
        21: ((8, 6), FOOT),
        22: ((7, 9), FOOT),
    }
    town, report = build(nodes, ways)
    assert report.areas == 2
    assert (1, 2, 100) in listed(town) or (2, 5, 150) in listed(town)


@pytest.mark.parametrize("merge", [0.0, 8.0])
def test_a_way_drawn_across_meets_the_square(build, listed, merge: float) -> None:
    # From below to above in the middle, without a node of the square: 1 to 3 and to where it leaves the square.
    nodes = {**NODES, 7: (50, -80), 8: (50, 180)}
    town, _ = build(nodes, {10: (RING, SQUARE), **ENTRIES, 22: ((7, 8), FOOT)}, merge=merge)
    lengths = sorted(row[2] for row in listed(town))
    assert 80 in lengths  # up to the outline
    assert round(np.hypot(50, 100)) in [length - 50 for length in lengths] or round(np.hypot(50, 100)) in lengths


def test_a_tunnel_below_does_not(build, listed) -> None:
    nodes = {**NODES, 7: (50, -80), 8: (50, 180)}
    ways = {10: (RING, SQUARE), **ENTRIES, 22: ((7, 8), {**FOOT, "tunnel": "yes", "layer": "-1"})}
    town, _ = build(nodes, ways)
    assert listed(town) == [(5, 6, 50 + ACROSS + 50)]  # the tunnel is not joined to it


def test_a_path_that_ends_in_the_square_is_joined(build) -> None:
    nodes = {**NODES, 7: (50, 20), 8: (50, 25)}
    town, _ = build(nodes, {10: (RING, SQUARE), **ENTRIES, 22: ((7, 8), FOOT)})
    assert {7, 8} & set(town.ids.tolist())


@pytest.mark.parametrize(("gate", "length"), [({}, ACROSS), ({"access": "private"}, None)])
def test_a_closed_gate_at_an_entry(build, gate, length) -> None:
    # Another street from 2 to 6, so that the square can be reached with the gate at 3 shut.
    nodes = {**NODES, 3: (100, 100, {"barrier": "gate", **gate})}
    ways = {10: (RING, SQUARE), **ENTRIES, 22: ((2, 6), FOOT)}
    town, report = build(nodes, ways)
    assert (3 in town.ids.tolist() or (5, 6) in across(town)) == (length is not None)
    assert report.limited.get("node: closed", 0) == (length is None)


def test_a_gate_with_opening_times_holds_for_its_own_entry_only(build) -> None:
    # The gate is the corner between the arms of an L, round which walks between the other entries lead.
    nodes = {1: (0, 0), 2: (100, 0), 3: (100, 20), 7: (20, 20, {"barrier": "gate", "opening_hours": "08:00-20:00"}),
             8: (20, 100), 9: (0, 100), 5: (150, 20), 6: (20, 150), 4: (60, 60)}  # fmt: skip
    ring = (1, 2, 3, 7, 8, 9, 1)
    town, _ = build(nodes, {10: (ring, SQUARE), 20: ((3, 5), FOOT), 21: ((8, 6), FOOT), 22: ((7, 4), FOOT)})
    timed = np.array([opening != "" for opening in town.opening])
    always = town.ids[np.unique(np.concatenate([town.tail[~timed], town.head[~timed]]))].tolist()
    assert {5, 6} <= set(always)
    assert float(town.length[~timed].sum()) == pytest.approx(50 + 80 + 80 + 50, abs=0.5)
    assert timed.any()


def test_one_area_alone_is_no_town(build) -> None:
    with pytest.raises(OsmError, match="nothing leads"):
        build(NODES, {10: (RING, SQUARE)})


def test_areas_alone_are_a_town(build, listed) -> None:
    nodes = {**NODES, 7: (200, 0), 8: (200, 100)}
    town, report = build(nodes, {10: (RING, SQUARE), 11: ((2, 7, 8, 3, 2), SQUARE)})
    assert listed(town) == [(2, 3, 100)]
    assert (report.areas, report.dropped["street: parallel to a shorter one"]) == (2, 1)


def test_too_many_corners_are_walked_along(build) -> None:
    angle = np.linspace(0, 2 * np.pi, 302)[:-1]
    nodes = {100 + i: (100 * np.cos(a), 100 * np.sin(a)) for i, a in enumerate(angle.tolist())}
    nodes |= {1000 + i: (110 * np.cos(a), 110 * np.sin(a)) for i, a in enumerate(angle.tolist())}
    spokes = {i: ((100 + i, 1000 + i), FOOT) for i in range(301)}
    town, report = build(nodes, {999: ((*range(100, 401), 100), SQUARE), **spokes})
    assert report.repaired["area: walked along its outline, too many corners"] == 1
    assert town.streets == 602
