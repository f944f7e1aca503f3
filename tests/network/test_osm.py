"""The importer against towns small enough to work out by hand, lengths in metres on the equator; files of all formats,
in any order, damaged or not.
"""

import bz2
import gzip
import json
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
import osmium
import pytest

from sidestep.network.measures import WidthError
from sidestep.network.osm import OsmError, import_osm
from sidestep.network.town import Town

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


def same(one: Town, other: Town) -> bool:
    return all(
        np.array_equal(getattr(one, field.name), getattr(other, field.name), equal_nan=field.name == "incline")
        for field in fields(Town)
    )


def test_negative_numbers_large_numbers_and_any_order(build, listed, osm, tee, tmp_path) -> None:
    far = {1: -1, 2: -2, 3: 2**62, 4: 4}
    nodes = {far[number]: at for number, at in tee[0].items()}
    ways = {number: (tuple(far[ref] for ref in refs), tags) for number, (refs, tags) in tee[1].items()}
    assert listed(build(nodes, ways)[0]) == sorted([(-2, -1, 100), (-2, 2**62, 150), (-2, 4, 80)])
    lines = osm(*tee).splitlines()
    path = tmp_path / "backwards.osm"
    path.write_text("\n".join([*lines[:2], *lines[-2:1:-1], lines[-1]]), encoding="utf-8")
    assert listed(import_osm(path, merge=0)[0]) == [(1, 2, 100), (2, 3, 150), (2, 4, 80)]


def test_a_way_given_twice_counts_once(osm, tee, tmp_path) -> None:
    lines = osm(*tee).splitlines()
    path = tmp_path / "twice.osm"
    path.write_text("\n".join([*lines[:-1], lines[-2], lines[-1]]), encoding="utf-8")
    town, report = import_osm(path)
    assert town.streets == 3
    assert report.dropped == {"way: repeated number": 1}


def test_names_hold_nothing_that_cannot_be_printed(build) -> None:
    ways = {1: ((1, 2), {**FOOT, "name": " Kungs\u200bgatan\u2028 ☕ " + "x" * 400})}
    (name,) = build({1: (0, 0), 2: (50, 0)}, ways)[0].name
    assert name.startswith("Kungsgatan ☕ xxx")
    assert len(name) == 255


@pytest.fixture
def every_format(osm, tee, tmp_path):
    """The same file in all formats."""
    plain = tmp_path / "t.osm"
    plain.write_text(osm(*tee), encoding="utf-8")
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
    ("name", "content", "line"),
    [
        ("a.osm", b"", None),
        ("a.osm.gz", b"", None),
        ("a.osm.pbf", b"", None),
        ("a.osm", b"hello", 1),
        ("a.osm", b'<osm version="0.6">\n<node id="1" lat="0"\n</osm>', 3),
        ("a.osm.pbf", b"hello, hello", None),
        ("a.osm.gz", b"hello", 1),
        ("a.osm.bz2", b"hello", 1),
        ("a.osm", b"<gpx></gpx>", None),
        ("a.osm", b'<osm version="0.5"></osm>', None),
        ("a.osm", b'<osm version="0.6"></osm>', None),
        ("a.osm", b'<osm version="0.6"><node id="x" lat="0" lon="0"/></osm>', None),
        ("a.csv", b"1,2", None),
        ("osm", b"1,2", None),
    ],
)
def test_files_that_hold_no_streets(tmp_path, name: str, content: bytes, line: int | None) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(OsmError) as caught:
        import_osm(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert caught.value.line == line


def test_missing_files(tmp_path) -> None:
    (tmp_path / "folder.osm").mkdir()
    # An address is not fetched: it is the name of a file that is missing.
    for path in (tmp_path / "missing.osm", tmp_path / "folder.osm", "http://localhost/x.osm"):
        with pytest.raises(OsmError, match=f"cannot read {Path(path)}"):
            import_osm(path)


def test_unreadable_and_invalid_coordinates(osm, tee, tmp_path) -> None:
    path = tmp_path / "t.osm"
    path.write_text(osm(*tee).replace('lat="0.0000000"', 'lat="north"', 1), encoding="utf-8")
    with pytest.raises(OsmError, match="damaged") as caught:
        import_osm(path)
    assert str(caught.value).startswith(str(path))
    path.write_text(osm(*tee).replace('<nd ref="1"/>', '<nd ref="1" lat="0" lon="east"/>'), encoding="utf-8")
    with pytest.raises(OsmError, match="damaged"):
        import_osm(path)
    path.write_text(osm(*tee).replace('lat="0.0000000"', 'lat="95"', 1), encoding="utf-8")
    # Invalid coordinates count as missing: 1 goes, and with it 1-2.
    assert import_osm(path, merge=0)[0].streets == 1
