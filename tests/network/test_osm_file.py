"""Files of all formats, in any order, damaged or not."""

import bz2
import gzip
from dataclasses import fields
from pathlib import Path

import numpy as np
import osmium
import pytest

from sidestep.network.osm import import_osm
from sidestep.network.osm_file import OsmError
from sidestep.network.town import Town

FOOT = {"highway": "footway"}


def same(one: Town, other: Town) -> bool:
    return all(np.array_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(Town))


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
        ("a.osm.bz2", b"hello", None),
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
    path.write_text(osm(*tee).replace('lat="0.0000000"', 'lat="95"', 1), encoding="utf-8")
    # Invalid coordinates count as missing: 1 goes, and with it 1-2.
    assert import_osm(path, merge=0)[0].streets == 1
