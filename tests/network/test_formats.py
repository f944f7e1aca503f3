"""Towns in files: the same town comes back, osmnx's graphs are understood, and bad files are named."""

import json
import re
import zipfile
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sidestep.files import OutputError
from sidestep.network.formats import load_helsinki, load_town, save_town
from sidestep.network.town import Town, TownError, course_lengths

# An invented town, written by osmnx 2.1.1: graph_from_xml, simplified, save_graphml.
OSMNX = Path(__file__).parent / "osmnx.graphml"

FOOT = {"highway": "footway"}
NODES = {1: (0, 0), 2: (100, 0), 3: (250, 10), 4: (100, 80), 5: (40, 90), 6: (250, 90)}
WAYS = {
    1: ((1, 2, 3), {"highway": "residential", "name": 'Ann\'s <"Way"> & ☕'}),
    2: ((2, 4), {**FOOT, "oneway": "yes", "width": "12'"}),
    3: ((4, 5, 1), FOOT),
    4: ((4, 6, 3), {**FOOT, "name": "Long Walk"}),
}


@pytest.fixture
def town(build) -> Town:
    return build({**NODES, 5: (*NODES[5], {"highway": "crossing"})}, WAYS)[0]


def differences(one: Town, other: Town) -> list[str]:
    return [
        field.name
        for field in fields(Town)
        if not np.array_equal(getattr(one, field.name), getattr(other, field.name))
        or type(getattr(one, field.name)) is not type(getattr(other, field.name))
    ]


@pytest.mark.parametrize("suffix", [".npz", ".graphml"])
def test_the_same_town_comes_back_and_the_same_bytes_are_written(town, suffix: str, tmp_path) -> None:
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    save_town(town, first)
    again = load_town(first)
    assert differences(town, again) == []
    assert all(getattr(again, name).dtype == getattr(town, name).dtype for name in ("tail", "ids", "length", "signals"))
    save_town(again, second)
    assert first.read_bytes() == second.read_bytes()
    assert town.one_way.sum() == 1
    assert town.crossings.sum() == 1


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


def test_geojson_is_written_and_not_read(town, tmp_path) -> None:
    path = tmp_path / "t.geojson"
    save_town(town, path)
    found = json.loads(path.read_text(encoding="utf-8"))
    assert found["type"] == "FeatureCollection"
    assert "OpenStreetMap" in found["attribution"]
    assert len(found["features"]) == town.streets
    one = found["features"][0]
    assert one["geometry"]["type"] == "LineString"
    np.testing.assert_allclose(one["geometry"]["coordinates"], town.course(0), atol=1e-7)
    assert one["properties"]["kind"] == town.kind[0]
    with pytest.raises(TownError, match="GeoJSON does not say which streets meet"):
        load_town(path)


def test_other_endings_and_places_that_cannot_be_written(town, tmp_path) -> None:
    for path in (tmp_path / "t.csv", tmp_path / "t"):
        with pytest.raises(TownError, match=r"must end in \.npz"):
            save_town(town, path)
        with pytest.raises(TownError, match=r"must end in \.npz"):
            load_town(path)
    with pytest.raises(OutputError, match="nowhere"):
        save_town(town, tmp_path / "nowhere" / "t.npz")
    assert list(tmp_path.glob("*.npz")) == []


def test_crossings_with_the_same_number_have_no_graphml(town, tmp_path) -> None:
    with pytest.raises(TownError, match="same number"):
        save_town(replace(town, ids=np.zeros_like(town.ids)), tmp_path / "t.graphml")
    assert list(tmp_path.iterdir()) == [tmp_path / "town.osm"]  # nothing half-written


@pytest.mark.parametrize("suffix", [".npz", ".graphml"])
def test_files_cut_short(town, suffix: str, tmp_path) -> None:
    path = tmp_path / f"t{suffix}"
    save_town(town, path)
    whole = path.read_bytes()
    for size in (0, 1, 30, len(whole) // 2, len(whole) - 3):
        path.write_bytes(whole[:size])
        with pytest.raises(TownError, match=path.name):
            load_town(path)


@pytest.mark.parametrize("name", ["gone.npz", "gone.graphml", "folder.npz", "folder.graphml"])
def test_files_that_are_not_there(name: str, tmp_path) -> None:
    if name.startswith("folder"):
        (tmp_path / name).mkdir()
    with pytest.raises(TownError, match=f"cannot read .*{name}"):
        load_town(tmp_path / name)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (dict(format=np.array(99)), "format 99"),
        (dict(format=np.array([1, 1])), "format"),
        (dict(format=None), "not a Sidestep town"),
        (dict(tail=None), "damaged"),
        (dict(tail=np.array([0.5])), "tail is float64"),
        (dict(tail=np.array([[0]], np.int32)), "2 dimensions"),
        (dict(place=np.zeros((4, 3))), "3 columns"),
        (dict(kind=np.array([0, 1, 99, 0], np.int32)), "kind has a number without a text"),
        (dict(kinds=np.array([1, 2])), "kind is not text"),
        (dict(names=np.array([{"a": 1}], object)), "allow_pickle"),
        (dict(attribution=None), "damaged"),
    ],
)
def test_arrays_that_make_no_town(town, changes, says: str, tmp_path) -> None:
    path = tmp_path / "t.npz"
    save_town(town, path)
    with np.load(path) as found:
        columns = {key: found[key] for key in found.files} | changes
    np.savez(path, **{key: value for key, value in columns.items() if value is not None})
    with pytest.raises(TownError, match=says) as caught:
        load_town(path)
    assert str(path) in str(caught.value)


def test_a_zip_that_unpacks_to_too_much(tmp_path) -> None:
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed, packed.open("place.npy", "w") as entry:
        entry.write(bytes(1000))
    raw = path.read_bytes()
    at = raw.index(b"PK\x01\x02") + 24  # the size that the directory gives
    path.write_bytes(raw[:at] + (2**32 - 2).to_bytes(4, "little") + raw[at + 4 :])
    with pytest.raises(TownError, match="unpacks to more"):
        load_town(path)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('edgedefault="directed"', 'edgedefault="undirected"', "no direction"),
        (">epsg:4326<", ">epsg:3067<", "epsg:3067"),
        (">0.0008993<", ">nan<", "x of .* is nan"),
        (">0.0008993<", ">200<", "lies outside"),
        (">0.0008993<", ">east<", "no number"),
        (">99.99773879316534<", ">long<", "length of .* is long"),
        (">99.99773879316534<", ">-5<", "length -5.0 m"),
        (">99.99773879316534<", ">1e99<", "no number that can be used"),
        (">99.99773879316534<", ">0<", "length 0.0 m"),
        ("LINESTRING (0 0, 0", "POINT (0 0, 0", "no LINESTRING"),
        ("LINESTRING (0 0, 0", "LINESTRING (0 0 7, 0", "pairs of numbers"),
        ("LINESTRING (0 0, 0", "LINESTRING (0 900, 0", "latitude 900"),
        ('target="1"', 'target="77"', "no number"),  # a node without a place
        ("encoding='utf-8'", "encoding='utf-T'", "unknown encoding"),
        ("<graph ", "<graf ", "damaged|mismatched|holds no"),
        ("http://graphml.graphdrawing.org/xmlns", "http://else.where", "holds no town|not successfully read"),
    ],
)
def test_graphs_that_make_no_town(old: str, new: str, says: str, tmp_path) -> None:
    text = OSMNX.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "t.graphml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(TownError, match=says) as caught:
        load_town(path)
    assert str(path) in str(caught.value)


def test_types_that_are_left_out_are_text(tmp_path) -> None:
    text = OSMNX.read_text(encoding="utf-8").replace(' attr.type="string"', "")
    (tmp_path / "t.graphml").write_text(text, encoding="utf-8")
    assert load_town(tmp_path / "t.graphml").streets == 9


def test_nodes_called_by_name_are_numbered(tmp_path) -> None:
    text = OSMNX.read_text(encoding="utf-8").replace('"7"', '"tower"')
    (tmp_path / "t.graphml").write_text(text, encoding="utf-8")
    assert load_town(tmp_path / "t.graphml").streets == 9


def test_helsinki() -> None:
    town = load_helsinki()
    assert town is load_helsinki()
    assert "OpenStreetMap contributors" in town.attribution
    assert 900 < town.nodes < 1000
    assert 80 < town.kilometres < 100
    network = town.network()
    assert network.exits <= 10
    links = coo_array((np.ones(network.segments), (network.tail, network.head)), shape=(network.nodes,) * 2)
    assert connected_components(links, connection="strong")[0] == 1
    np.testing.assert_allclose(course_lengths(town.points, town.first), town.length, rtol=1e-5)
    straight = np.linalg.norm(
        np.asarray(network.position)[network.tail] - np.asarray(network.position)[network.head], axis=1
    )
    assert (straight <= 1.0005 * np.asarray(network.length)).all()
    # Mannerheimintie and Esplanadi run through the centre
    assert {"Mannerheimintie", "Pohjoisesplanadi"} <= set(town.name)
    assert (np.ptp(network.position, axis=0) > 900).all()
