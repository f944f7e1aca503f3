"""The importer against towns small enough to work out by hand; lengths in metres on the equator."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from sidestep.network.osm_file import OsmError
from sidestep.network.tags import WidthError

FOOT = {"highway": "footway"}
CROSSING, LIGHTS = {"highway": "crossing"}, {"highway": "traffic_signals"}


def test_ways_are_split_where_they_meet(build, listed, tee) -> None:
    town, report = build(*tee)
    assert listed(town) == [(1, 2, 100), (2, 3, 150), (2, 4, 80)]
    np.testing.assert_allclose(sorted(town.length), [80, 100, 150], atol=0.02)
    by_length = np.argsort(town.length)
    assert [town.kind[i] for i in by_length] == ["path", "residential", "residential"]
    assert [town.name[i] for i in by_length] == ["", "High Street", "High Street"]
    np.testing.assert_allclose(town.width[by_length], [1.8, 4, 4])  # 9 m is the carriageway, 4 m the table's
    assert (report.ways, report.walkable, report.dropped, report.repaired) == (2, 2, {}, {})
    assert (report.nodes, report.streets, report.most_exits) == (4, 3, 3)
    assert report.kilometres == pytest.approx(0.33, abs=1e-4)
    assert "OpenStreetMap" in town.attribution


def test_bends_stay_in_the_course(build) -> None:
    # 3-4-5: 50 + 50 m
    town, _ = build({1: (0, 0), 2: (30, 40), 3: (60, 0)}, {1: ((1, 2, 3), FOOT)})
    assert town.streets == 1
    assert float(town.length[0]) == pytest.approx(100, abs=0.02)
    np.testing.assert_allclose(town.project(town.course(0)), [[-30, 0], [0, 40], [30, 0]], atol=0.02)


def test_the_network_has_each_direction(build, tee) -> None:
    town, _ = build(*tee)
    network = town.network()
    assert (network.nodes, network.segments, network.exits) == (4, 6, 3)
    street, backwards = town.street_of_segment()
    assert street.tolist() == [0, 1, 2, 0, 1, 2]
    assert backwards.tolist() == [False] * 3 + [True] * 3
    np.testing.assert_array_equal(network.tail, np.concatenate([town.tail, town.head]))
    np.testing.assert_allclose(
        network.position, [[-125, 0], [-25, 0], [125, 0], [-25, 80]] - np.array([0, 40]), atol=0.1
    )


def test_a_clipped_way_is_cut_where_nodes_are_absent(build, listed) -> None:
    nodes = {1: (0, 0), 2: (50, 0), 3: (150, 0), 4: (250, 0), 5: (100, 80)}
    ways = {10: ((1, 2, 99, 3, 4), FOOT), 11: ((2, 5), FOOT), 12: ((5, 3), FOOT)}
    town, report = build(nodes, ways)
    # no street from 2 to 3, though both are there: 1-2-5-3-4 is one street, of 50 + 94.34 + 94.34 + 100
    assert listed(town) == [(1, 4, 339)]
    assert report.repaired == {"way: split at missing nodes": 1, "crossing: two streets joined into one": 3}


def test_one_node_alone_between_absent_ones_is_no_street(build, listed) -> None:
    town, _ = build({1: (0, 0), 2: (50, 0), 3: (150, 0)}, {10: ((1, 2), FOOT), 11: ((98, 3, 99), FOOT)})
    assert listed(town) == [(1, 2, 50)]


def test_an_area_is_walked_along_its_outline(build, listed) -> None:
    # A square of 100 m, entered at 1 and 2: 100 m on one side, 300 m round the other.
    nodes = {1: (0, 0), 2: (100, 0), 3: (100, 100), 4: (0, 100), 5: (0, -50), 6: (100, -50)}
    square = {"highway": "pedestrian", "area": "yes"}
    town, _ = build(nodes, {1: ((3, 4, 1, 2, 3), square), 2: ((1, 5), FOOT), 3: ((2, 6), FOOT)})
    assert listed(town) == [(1, 2, 100), (1, 2, 300), (1, 5, 50), (2, 6, 50)]


def test_streets_against_the_way_as_drawn_have_their_course_turned(build) -> None:
    nodes = {1: (0, 0), 2: (50, 20), 3: (100, 0), 4: (50, -80)}
    town, _ = build(nodes, {1: ((1, 2, 3), {**FOOT, "oneway:foot": "-1"}), 2: ((1, 4, 3), FOOT)})
    single = int(np.argmax(town.one_way))
    assert town.ids[[town.tail[single], town.head[single]]].tolist() == [3, 1]
    np.testing.assert_array_equal(town.course(single)[[0, -1]], town.place[[town.tail[single], town.head[single]]])


def test_crossings_within_a_street(build) -> None:
    nodes = {
        1: (0, 0),
        2: (50, 0, CROSSING),
        3: (90, 0, {"crossing": "traffic_signals"}),
        4: (150, 0, LIGHTS),
        5: (200, 0),
    }
    town, _ = build(nodes, {1: ((1, 2, 3, 4, 5), FOOT)})
    assert (town.signals.tolist(), town.crossings.tolist()) == ([2], [1])


def test_width_tags_without_sense_are_counted(build) -> None:
    town, report = build({1: (0, 0), 2: (50, 0)}, {1: ((1, 2), {**FOOT, "width": "wide"})}, widths={"footway": 2.5})
    assert town.width.tolist() == [2.5]
    assert report.repaired == {"way: unreadable width ignored": 1}


def test_dropped_ways_are_counted_by_reason(build, tee) -> None:
    more = {
        20: ((1, 4), {"highway": "motorway"}),
        21: ((1, 4), {"highway": "footway", "access": "private"}),
        22: ((1, 4), {"highway": "primary", "sidewalk": "separate"}),
        23: ((1,), FOOT),
        24: ((1, 4), {"building": "yes"}),  # not a highway: not even counted
    }
    nodes, ways = tee
    _, report = build(nodes, {**ways, **more})
    assert (report.ways, report.walkable) == (6, 2)
    assert report.dropped == {
        "way: not a walkable kind": 1,
        "way: no access": 1,
        "way: pavements mapped separately": 1,
        "way: fewer than two nodes": 1,
    }
    assert json.loads(json.dumps(asdict(report)))["source"] == "town.osm"


@pytest.mark.parametrize(
    ("nodes", "ways", "says"),
    [
        ({1: (0, 0), 2: (50, 0)}, {}, "no highways"),
        ({1: (0, 0), 2: (50, 0)}, {1: ((1, 2), {"highway": "motorway"})}, "none of its 1 highways is walkable"),
        ({}, {1: ((1, 2), FOOT)}, "lacks the nodes"),
        ({1: (0, 0), 3: (50, 0)}, {1: ((1, 2, 3), FOOT)}, "lacks the nodes"),
        ({1: (0, 0), 2: (5, 0)}, {1: ((1, 2), FOOT)}, "no street between two crossings"),
        ({1: (0, 0), 2: (50, 0), 3: (0, 50)}, {1: ((1, 2, 3, 1), FOOT)}, "no street between two crossings"),
        ({1: (0, 0), 2: (0, 0)}, {1: ((1, 2), FOOT)}, "no street between two crossings"),
        ({1: (0, 0), 2: (50, 0)}, {1: ((1, 2), {**FOOT, "oneway": "yes"})}, "no street between two crossings"),
    ],
)
def test_towns_without_streets(build, nodes, ways, says: str) -> None:
    with pytest.raises(OsmError, match=says):
        build(nodes, ways, merge=8)


@pytest.mark.parametrize("merge", [-1, float("nan"), float("inf")])
def test_invalid_distances(build, tee, merge: float) -> None:
    with pytest.raises(OsmError) as caught:
        build(*tee, merge=merge)
    assert caught.value.field == "merge"


def test_invalid_widths(build, tee) -> None:
    with pytest.raises(WidthError) as caught:
        build(*tee, widths={"path": -1.0})
    assert caught.value.field == "widths.path"
