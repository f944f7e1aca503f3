"""`sidestep import-osm` as people use it."""

import json
from functools import partial

import pytest

from sidestep.cli import app as cli
from sidestep.errors import SidestepError
from sidestep.network.formats import load_town

TOWN = """<osm version="0.6">
<node id="1" lat="60.1" lon="24.9"/><node id="2" lat="60.101" lon="24.9"/><node id="3" lat="60.102" lon="24.9"/>
<node id="4" lat="60.101" lon="24.902"/><node id="5" lat="60.10102" lon="24.9"/>
<node id="6" lat="60.10102" lon="24.898"/>
<way id="1"><nd ref="1"/><nd ref="2"/><nd ref="5"/><nd ref="3"/><tag k="highway" v="residential"/></way>
<way id="2"><nd ref="2"/><nd ref="4"/><tag k="highway" v="footway"/></way>
<way id="3"><nd ref="5"/><nd ref="6"/><tag k="highway" v="path"/></way>
<way id="4"><nd ref="4"/><nd ref="6"/><tag k="highway" v="motorway"/></way>
</osm>
"""


@pytest.fixture
def import_osm(sidestep, tmp_path):
    (tmp_path / "town.osm").write_text(TOWN)
    return partial(sidestep, "import-osm", cwd=tmp_path)


def test_an_extract_becomes_a_town(import_osm, tmp_path) -> None:
    done = import_osm("town.osm", "--out", "made/town.npz", "--width", "footway=2.5", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["ways"], found["walkable"], found["nodes"], found["streets"]) == (4, 3, 5, 4)
    assert found["dropped"] == {"way: not a walkable kind": 1, "street: inside a merged crossing": 1}
    assert (found["out"], found["most_exits"]) == ("made/town.npz", 4)
    town = load_town(tmp_path / "made" / "town.npz")
    assert (town.nodes, town.streets) == (5, 4)
    assert sorted(town.width.tolist()) == [1.5, 2.5, 4, 4]


def test_people_are_told_what_was_dropped(import_osm, tmp_path) -> None:
    mine = "© The town, CC BY 4.0"
    done = import_osm("town.osm", "--out", "town.graphml", "--merge", 0, "--attribution", mine)
    assert done.returncode == 0, done.stderr
    for said in ("3 of 4 highways", "not a walkable kind", "town.graphml", mine):
        assert said in done.stdout
    town = load_town(tmp_path / "town.graphml")
    assert (town.streets, town.attribution) == (5, mine)


def test_a_damaged_file_is_one_sentence(import_osm, tmp_path) -> None:
    (tmp_path / "cut.osm").write_text(TOWN[:-100])
    done = import_osm("cut.osm", "--out", "town.npz")
    assert done.returncode == 2
    assert done.stderr.startswith("sidestep: cut.osm is damaged")
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "town.npz").exists()


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (("town.osm", "--out", "town.csv"), "must end in"),
        (("nowhere.osm", "--out", "town.csv"), "town.csv"),  # before the file is even looked at
        (("nowhere.osm", "--out", "town.npz"), "cannot read nowhere.osm"),
        (("town.osm", "--out", "town.npz", "--merge", "-1"), "not -1"),
        (("town.osm", "--out", "town.npz", "--merge", "nan"), "nan"),
        (("town.osm", "--out", "town.npz", "--width", "alley=2"), "alley"),
        (("town.osm", "--out", "town.npz", "--width", "footway"), "KIND=METRES"),
        (("town.osm", "--out", "town.npz", "--width", "footway=-1"), "0.3 to 100"),
        (("town.osm", "--out", "town.npz", "--attribution", " "), "attribution"),
        (("town.osm", "--out", "town.osm/town.npz"), "cannot write"),
    ],
)
def test_bad_requests(args, says: str, tmp_path, monkeypatch) -> None:
    """In this process: each takes a second elsewhere."""
    (tmp_path / "town.osm").write_text(TOWN)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SidestepError) as caught:
        cli.app(["import-osm", *args], exit_on_error=False, print_error=False)
    assert says in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["town.osm"]
