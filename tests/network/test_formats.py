"""Towns in files: the same town comes back, and bad files are named."""

import json
import zipfile
from dataclasses import fields

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sidestep.files import OutputError
from sidestep.network.formats import load_helsinki, load_town, save_town
from sidestep.network.geodesy import course_lengths
from sidestep.network.town import Town, TownError


def differences(one: Town, other: Town) -> list[str]:
    def same(name: str) -> bool:
        values = getattr(one, name), getattr(other, name)
        return type(values[0]) is type(values[1]) and np.array_equal(*values, equal_nan=name == "incline")

    return [field.name for field in fields(Town) if not same(field.name)]


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
    with pytest.raises(TownError, match="GeoJSON"):
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
    ("changes", "field"),
    [
        (dict(format=np.array(99)), "format"),
        (dict(format=np.array([1, 1])), "format"),
        (dict(format=None), "format"),
        (dict(tail=None), None),
        (dict(tail=np.array([0.5])), "tail"),
        (dict(tail=np.array([[0]], np.int32)), "tail"),
        (dict(place=np.zeros((4, 3))), "place"),
        (dict(kind=np.array([0, 1, 99, 0], np.int32)), "kind"),
        (dict(kinds=np.array([1, 2])), "kind"),
        (dict(names=np.array([{"a": 1}], object)), None),
        (dict(attribution=None), None),
    ],
)
def test_arrays_that_make_no_town(town, changes, field: str | None, tmp_path) -> None:
    path = tmp_path / "t.npz"
    save_town(town, path)
    with np.load(path) as found:
        columns = {key: found[key] for key in found.files} | changes
    np.savez(path, **{key: value for key, value in columns.items() if value is not None})
    with pytest.raises(TownError) as caught:
        load_town(path)
    assert str(caught.value).startswith(str(path))
    assert caught.value.field == field


def test_a_zip_that_unpacks_to_too_much(tmp_path) -> None:
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed, packed.open("place.npy", "w") as entry:
        entry.write(bytes(1000))
    raw = path.read_bytes()
    at = raw.index(b"PK\x01\x02") + 24  # the size that the directory gives
    path.write_bytes(raw[:at] + (2**32 - 2).to_bytes(4, "little") + raw[at + 4 :])
    with pytest.raises(TownError, match="unpacks to more"):
        load_town(path)


def test_helsinki() -> None:
    town = load_helsinki()
    assert town is load_helsinki()
    assert "OpenStreetMap contributors" in town.attribution
    assert 900 < town.nodes < 1600
    assert 100 < town.kilometres < 120
    network = town.network()
    assert network.exits <= 14  # across squares
    links = coo_array((np.ones(network.segments), (network.tail, network.head)), shape=(network.nodes,) * 2)
    assert connected_components(links, connection="strong")[0] == 1
    # Parts of merged crossings count as well, so streets are not exactly as long as they are drawn.
    assert abs(course_lengths(town.points, town.first).sum() / town.length.sum() - 1) < 0.03
    # Mannerheimintie and Esplanadi run through the centre
    assert {"Mannerheimintie", "Pohjoisesplanadi"} <= set(town.name)
    assert (np.ptp(network.position, axis=0) > 900).all()
