"""GraphML: what osmnx casts, what osmnx wrote, and graphs that make no town."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sidestep.network.formats import load_town, save_town
from sidestep.network.geodesy import course_lengths
from sidestep.network.town import TownError

# An invented town, written by osmnx 2.1.1: graph_from_xml, simplified, save_graphml.
OSMNX = Path(__file__).parent / "osmnx.graphml"


def test_graphml_has_what_osmnx_casts(town, tmp_path) -> None:
    save_town(town, tmp_path / "t.graphml")
    text = (tmp_path / "t.graphml").read_text(encoding="utf-8")
    keys = set(re.findall(r'attr.name="(\w+)"', text))
    assert keys >= {
        "crs", "simplified", "x", "y", "osmid", "length", "name", "highway", "oneway", "width", "geometry", "reversed"
    }  # fmt: skip
    assert set(re.findall(r'attr.type="(\w+)"', text)) == {"string"}
    assert text.count("<edge ") == 2 * town.streets - 1


def test_what_osmnx_wrote(listed) -> None:
    town = load_town(OSMNX)
    assert listed(town) == sorted([
        (1, 2, 100), (1, 4, 180), (1, 4, 194), (2, 3, 150), (2, 4, 80), (2, 7, 60),
        (3, 6, 80),  # one-way
        (4, 6, 150), (4, 6, 250),
    ])  # fmt: skip
    assert town.one_way.sum() == 1
    by_length = {round(float(length)): street for street, length in enumerate(town.length)}
    assert town.width[by_length[100]] == 4  # `width` 7 of a residential road is the carriageway's
    lane = by_length[150]
    mill = next(i for i in range(town.streets) if "Mill" in town.name[i])
    assert town.name[mill] == "Mill Path / Mill Lane"
    assert town.kind[mill] in ("path", "footway")
    assert town.width[mill] == 2.5
    assert round(float(town.length[mill])) == round(float(town.length[lane])) == 150
    assert len(town.course(mill)) == 3
    assert town.name[by_length[250]] == "Ann's Way"
    np.testing.assert_allclose(course_lengths(town.points, town.first), town.length, rtol=1e-3)
    assert town.network().segments == 17


def test_osmnx_edges_without_an_edge_back_are_one_way(tmp_path) -> None:
    text = OSMNX.read_text(encoding="utf-8")
    edge = re.search(r'    <edge source="2" target="1".*?</edge>\n', text, re.DOTALL)
    assert edge is not None
    (tmp_path / "t.graphml").write_text(text.replace(edge.group(), ""), encoding="utf-8")
    town = load_town(tmp_path / "t.graphml")
    assert town.streets == 9
    assert town.one_way.sum() == 2


def test_crossings_with_the_same_number_have_no_graphml(town, tmp_path) -> None:
    with pytest.raises(TownError) as caught:
        save_town(replace(town, ids=np.zeros_like(town.ids)), tmp_path / "t.graphml")
    assert caught.value.field == "ids"
    assert list(tmp_path.iterdir()) == [tmp_path / "town.osm"]  # nothing half-written


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ('edgedefault="directed"', 'edgedefault="undirected"', "edgedefault"),
        (">epsg:4326<", ">epsg:3067<", "crs"),
        (">0.0008993<", ">nan<", "x"),
        (">0.0008993<", ">200<", "x"),
        (">0.0008993<", ">east<", "x"),
        (">0.0007195<", ">-91<", "y"),
        ('target="1"', 'target="77"', "x"),  # a node without a place
        (">99.99773879316534<", ">long<", "length"),
        (">99.99773879316534<", ">-5<", "length"),
        (">99.99773879316534<", ">1e99<", "length"),
        (">99.99773879316534<", ">0<", "length"),
        ("LINESTRING (0 0, 0", "POINT (0 0, 0", "geometry"),
        ("LINESTRING (0 0, 0", "LINESTRING (0 0 east, 0", "geometry"),
        ("LINESTRING (0 0, 0", "LINESTRING EMPTY (0 0, 0", "geometry"),
        ("LINESTRING (0 0, 0", "LINESTRING (0 nan, 0", "points"),
        ("LINESTRING (0 0, 0", "LINESTRING (0 900, 0", "points"),
        ("encoding='utf-8'", "encoding='utf-T'", None),
        ("<graph ", "<graf ", None),
        ("http://graphml.graphdrawing.org/xmlns", "http://else.where", None),
    ],
)
def test_graphs_that_make_no_town(old: str, new: str, field: str | None, tmp_path) -> None:
    text = OSMNX.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "t.graphml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(TownError) as caught:
        load_town(path)
    assert str(caught.value).startswith(str(path))
    assert caught.value.field == field


@pytest.mark.parametrize(("count", "works"), [("3", True), ("-1", False), ("40000", False), ("many", False)])
def test_counts_of_crossings(town, count: str, works: bool, tmp_path) -> None:
    path = tmp_path / "t.graphml"
    save_town(town, path)
    key = re.search(r'<key id="(\w+)" for="edge" attr.name="signals"', path.read_text(encoding="utf-8"))
    assert key is not None
    text = path.read_text(encoding="utf-8").replace(f'<data key="{key[1]}">0<', f'<data key="{key[1]}">{count}<')
    path.write_text(text, encoding="utf-8")
    if works:
        assert set(load_town(path).signals.tolist()) == {3}
        return
    with pytest.raises(TownError) as caught:
        load_town(path)
    assert caught.value.field == "signals"


def test_a_damaged_graph_is_blamed_by_line(tmp_path) -> None:
    lines = OSMNX.read_text(encoding="utf-8").splitlines()
    (tmp_path / "t.graphml").write_text("\n".join([*lines[:20], "<", *lines[20:]]), encoding="utf-8")
    with pytest.raises(TownError) as caught:
        load_town(tmp_path / "t.graphml")
    assert caught.value.line in (21, 22)


def test_types_that_are_left_out_are_text(tmp_path) -> None:
    text = OSMNX.read_text(encoding="utf-8").replace(' attr.type="string"', "")
    (tmp_path / "t.graphml").write_text(text, encoding="utf-8")
    assert load_town(tmp_path / "t.graphml").streets == 9


def test_nodes_called_by_name_are_numbered(tmp_path) -> None:
    text = OSMNX.read_text(encoding="utf-8").replace('"7"', '"tower"')
    (tmp_path / "t.graphml").write_text(text, encoding="utf-8")
    assert load_town(tmp_path / "t.graphml").streets == 9
