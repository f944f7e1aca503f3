"""The importer against towns small enough to work out by hand; lengths in metres on the equator."""

import bz2
import gzip
import json
from dataclasses import asdict, fields

import numpy as np
import osmium
import pytest

from sidestep.network.osm import OsmError, import_osm
from sidestep.network.tags import WidthError
from sidestep.network.town import Town, course_lengths, metres_between

FOOT = {"highway": "footway"}
CROSSING, LIGHTS = {"highway": "crossing"}, {"highway": "traffic_signals"}

# A T: 1 --100-- 2 --150-- 3, and 4 is 80 above 2.
T_NODES = {1: (0, 0), 2: (100, 0), 3: (250, 0), 4: (100, 80)}
T_WAYS = {
    10: ((1, 2, 3), {"highway": "residential", "name": "High Street", "width": "9"}),
    11: ((2, 4), {"highway": "path", "width": "1.8 m"}),
}


def same(one: Town, other: Town) -> bool:
    return all(np.array_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(Town))


def test_ways_are_split_where_they_meet(build, listed) -> None:
    town, report = build(T_NODES, T_WAYS)
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


def test_the_network_has_each_direction(build) -> None:
    town, _ = build(T_NODES, T_WAYS)
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
    assert report.repaired == {"way: cut where the file lacks nodes": 1, "crossing: only two streets met, joined": 3}


def test_one_node_alone_between_absent_ones_is_no_street(build, listed) -> None:
    town, _ = build({1: (0, 0), 2: (50, 0), 3: (150, 0)}, {10: ((1, 2), FOOT), 11: ((98, 3, 99), FOOT)})
    assert listed(town) == [(1, 2, 50)]


def test_an_area_is_walked_along_its_outline(build, listed) -> None:
    # A square of 100 m, entered at 1 and 2: 100 m on one side, 300 m round the other.
    nodes = {1: (0, 0), 2: (100, 0), 3: (100, 100), 4: (0, 100), 5: (0, -50), 6: (100, -50)}
    square = {"highway": "pedestrian", "area": "yes"}
    town, _ = build(nodes, {1: ((3, 4, 1, 2, 3), square), 2: ((1, 5), FOOT), 3: ((2, 6), FOOT)})
    assert listed(town) == [(1, 2, 100), (1, 2, 300), (1, 5, 50), (2, 6, 50)]


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


STAGGERED = (
    {1: (0, 0), 2: (100, 0), 3: (105, 0), 4: (200, 0), 5: (100, 50), 6: (105, -50)},
    {1: ((1, 2, 3, 4), FOOT), 2: ((2, 5), FOOT), 3: ((3, 6), FOOT)},
)


def test_crossings_near_each_other_merge(build, listed) -> None:
    town, report = build(*STAGGERED, merge=8)
    # 2 stands for both: 3-4 becomes 5 + 95 m, 3-6 becomes 5 + 50 m.
    assert listed(town) == [(1, 2, 100), (2, 4, 100), (2, 5, 50), (2, 6, 55)]
    assert report.dropped == {"street: within a merged crossing": 1}
    assert (report.nodes_before, report.streets_before, report.nodes, report.streets) == (6, 5, 5, 4)
    led_on = town.course(int(np.argmin(np.abs(town.length - 55))))
    assert len(led_on) == 3


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
    assert report.dropped == {"street: apart from the largest part": 1}
    single = int(np.argmax(town.one_way))
    assert (town.ids[town.tail[single]], town.ids[town.head[single]]) == (1, 3)
    assert town.network().segments == 3


def test_streets_against_the_way_as_drawn_have_their_course_turned(build) -> None:
    nodes = {1: (0, 0), 2: (50, 20), 3: (100, 0), 4: (50, -80)}
    town, _ = build(nodes, {1: ((1, 2, 3), {**FOOT, "oneway:foot": "-1"}), 2: ((1, 4, 3), FOOT)})
    single = int(np.argmax(town.one_way))
    assert town.ids[[town.tail[single], town.head[single]]].tolist() == [3, 1]
    np.testing.assert_array_equal(town.course(single)[[0, -1]], town.place[[town.tail[single], town.head[single]]])


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
    assert report.repaired == {"crossing: only two streets met, joined": 1}


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
    assert report.dropped.get("street: hardly longer than a parallel one", 0) == 2 - kept
    assert town.streets == (4 if kept == 2 else 1)  # with one, all four are joined


def test_a_street_drawn_twice_is_one(build, listed) -> None:
    town, _ = build(T_NODES, {**T_WAYS, 12: ((3, 2), {"highway": "cycleway", "foot": "yes"})})
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


def test_loops_go(build, listed) -> None:
    nodes = {**T_NODES, 5: (300, 50), 6: (350, 0)}
    town, report = build(nodes, {**T_WAYS, 12: ((3, 5, 6, 3), FOOT)})
    assert listed(town) == [(1, 2, 100), (2, 3, 150), (2, 4, 80)]
    assert report.dropped == {"street: begins and ends at one crossing": 1}


def test_a_ring_alone_stays(build) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (100, 100)}
    town, _ = build(nodes, {1: ((1, 2), FOOT), 2: ((2, 3), FOOT), 3: ((3, 1), FOOT)})
    assert (town.nodes, town.streets) == (3, 3)


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


def test_width_tags_without_sense_are_counted(build) -> None:
    town, report = build({1: (0, 0), 2: (50, 0)}, {1: ((1, 2), {**FOOT, "width": "wide"})}, widths={"footway": 2.5})
    assert town.width.tolist() == [2.5]
    assert report.repaired == {"way: width that makes no sense, passed over": 1}


def test_dropped_ways_are_counted_by_reason(build) -> None:
    more = {
        20: ((1, 4), {"highway": "motorway"}),
        21: ((1, 4), {"highway": "footway", "access": "private"}),
        22: ((1, 4), {"highway": "primary", "sidewalk": "separate"}),
        23: ((1,), FOOT),
        24: ((1, 4), {"building": "yes"}),  # not a highway: not even counted
    }
    _, report = build(T_NODES, {**T_WAYS, **more})
    assert (report.ways, report.walkable) == (6, 2)
    assert report.dropped == {
        "way: not a kind that is walked": 1,
        "way: no access": 1,
        "way: its pavements are ways of their own": 1,
        "way: fewer than two nodes": 1,
    }
    assert json.loads(json.dumps(asdict(report)))["source"] == "town.osm"


def test_negative_numbers_large_numbers_and_any_order(build, listed, osm, tmp_path) -> None:
    far = {1: -1, 2: -2, 3: 2**62, 4: 4}
    nodes = {far[number]: at for number, at in T_NODES.items()}
    ways = {number: (tuple(far[ref] for ref in refs), tags) for number, (refs, tags) in T_WAYS.items()}
    assert listed(build(nodes, ways)[0]) == sorted([(-2, -1, 100), (-2, 2**62, 150), (-2, 4, 80)])
    lines = osm(T_NODES, T_WAYS).splitlines()
    path = tmp_path / "backwards.osm"
    path.write_text("\n".join([*lines[:2], *lines[-2:1:-1], lines[-1]]), encoding="utf-8")
    assert listed(import_osm(path, merge=0)[0]) == [(1, 2, 100), (2, 3, 150), (2, 4, 80)]


def test_a_way_given_twice_counts_once(osm, tmp_path) -> None:
    lines = osm(T_NODES, T_WAYS).splitlines()
    path = tmp_path / "twice.osm"
    path.write_text("\n".join([*lines[:-1], lines[-2], lines[-1]]), encoding="utf-8")
    town, report = import_osm(path)
    assert town.streets == 3
    assert report.dropped == {"way: given twice": 1}


def test_names_hold_nothing_that_cannot_be_printed(build) -> None:
    ways = {1: ((1, 2), {**FOOT, "name": " Kungs\u200bgatan\u2028 ☕ " + "x" * 400})}
    (name,) = build({1: (0, 0), 2: (50, 0)}, ways)[0].name
    assert name.startswith("Kungsgatan ☕ xxx")
    assert len(name) == 255


@pytest.fixture
def every_format(osm, tmp_path):
    """The same file in all formats."""
    plain = tmp_path / "t.osm"
    plain.write_text(osm(*STAGGERED), encoding="utf-8")
    (tmp_path / "t.osm.gz").write_bytes(gzip.compress(plain.read_bytes()))
    (tmp_path / "t.osm.bz2").write_bytes(bz2.compress(plain.read_bytes()))
    with osmium.SimpleWriter(str(tmp_path / "t.osm.pbf")) as writer:
        for thing in osmium.FileProcessor(str(plain)):
            writer.add(thing)
    return [tmp_path / f"t{suffix}" for suffix in (".osm", ".osm.gz", ".osm.bz2", ".osm.pbf")]


def test_all_formats_give_the_same_town(every_format) -> None:
    one, *others = [import_osm(path)[0] for path in every_format]
    assert all(same(one, other) for other in others)


def test_files_cut_short(every_format) -> None:
    for path in every_format:
        whole = path.read_bytes()
        for size in (1, len(whole) // 3, len(whole) - 5):
            path.write_bytes(whole[:size])
            with pytest.raises(OsmError, match=path.name):
                import_osm(path)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.osm", b"", "is empty"),
        ("a.osm.gz", b"", "is empty"),
        ("a.osm.pbf", b"", "is empty"),
        ("a.osm", b"hello", "damaged or not an OpenStreetMap file"),
        ("a.osm.pbf", b"hello, hello", "damaged or not"),
        ("a.osm.gz", b"hello", "damaged or not"),
        ("a.osm.bz2", b"hello", "damaged or not"),
        ("a.osm", b"<gpx></gpx>", "gpx"),
        ("a.osm", b'<osm version="0.5"></osm>', "version"),
        ("a.osm", b'<osm version="0.6"></osm>', "no highways"),
        ("a.osm", b'<osm version="0.6"><node id="x" lat="0" lon="0"/></osm>', "no highways"),
        ("a.csv", b"1,2", "must end in"),
        ("osm", b"1,2", "must end in"),
    ],
)
def test_files_that_are_none(tmp_path, name: str, content: bytes, says: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(OsmError, match=says) as caught:
        import_osm(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


@pytest.mark.parametrize(
    ("nodes", "ways", "says"),
    [
        (T_NODES, {}, "no highways"),
        (T_NODES, {1: ((1, 2), {"highway": "motorway"})}, "none of its 1 highways is walked"),
        ({}, T_WAYS, "lacks the nodes"),
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


def test_files_that_are_not_there(tmp_path) -> None:
    with pytest.raises(OsmError, match=r"cannot read .*missing\.osm: no such file"):
        import_osm(tmp_path / "missing.osm")
    (tmp_path / "folder.osm").mkdir()
    with pytest.raises(OsmError, match=r"folder\.osm: is a directory"):
        import_osm(tmp_path / "folder.osm")
    with pytest.raises(OsmError, match="http:/"):
        import_osm("http://localhost/x.osm")  # never fetched


@pytest.mark.parametrize("merge", [-1, float("nan"), float("inf")])
def test_distances_that_cannot_be(build, merge: float) -> None:
    with pytest.raises(OsmError, match="0 m or more"):
        build(T_NODES, T_WAYS, merge=merge)


def test_widths_that_cannot_be(build) -> None:
    with pytest.raises(WidthError, match="alley"):
        build(T_NODES, T_WAYS, widths={"alley": 2.0})


def test_bad_coordinates_name_the_file(osm, tmp_path) -> None:
    path = tmp_path / "t.osm"
    path.write_text(osm(T_NODES, T_WAYS).replace('lat="0.0000000"', 'lat="north"', 1), encoding="utf-8")
    with pytest.raises(OsmError, match=r"t\.osm is damaged"):
        import_osm(path)
    path.write_text(osm(T_NODES, T_WAYS).replace('lat="0.0000000"', 'lat="95"', 1), encoding="utf-8")
    # a place that is none is as good as absent: 1 goes, and with it 1-2
    assert import_osm(path, merge=0)[0].streets == 1


def test_distances_on_the_globe() -> None:
    # a quarter of the equator, and one of a meridian
    quarter = np.pi / 2 * 6_371_008.8
    found = metres_between(np.array([[0.0, 0], [10, 0]]), np.array([[90.0, 0], [10, 90]]))
    np.testing.assert_allclose(found, [quarter, quarter])
    np.testing.assert_allclose(
        course_lengths(np.array([[0.0, 0], [90, 0], [10, 0], [10, 90]]), np.array([0, 2, 4])), [quarter, quarter]
    )
