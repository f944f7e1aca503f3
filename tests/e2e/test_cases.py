"""Whole cases by the command line: an extract, counts and a question; streets of other programs."""

import json
import math
from datetime import datetime, timedelta
from pathlib import Path

import pytest

BANKS = """<osm version="0.6">
<node id="1" lat="60.1716188" lon="24.9460000"/><node id="2" lat="60.1716188" lon="24.9486781"/>
<node id="3" lat="60.1719785" lon="24.9486781"/><node id="4" lat="60.1719785" lon="24.9559099"/>
<node id="5" lat="{south}" lon="24.9486781"/><node id="6" lat="{south}" lon="24.9559099"/>
<node id="7" lat="60.1716188" lon="24.9559099"/><node id="8" lat="60.1716188" lon="24.9580794"/>
<way id="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="footway"/><tag k="name" v="West"/></way>
<way id="2"><nd ref="2"/><nd ref="3"/><nd ref="4"/><nd ref="7"/>
  <tag k="highway" v="footway"/><tag k="name" v="North Bank"/></way>
<way id="3"><nd ref="2"/><nd ref="5"/><nd ref="6"/><nd ref="7"/>
  <tag k="highway" v="footway"/><tag k="name" v="South Bank"/></way>
<way id="4"><nd ref="7"/><nd ref="8"/><tag k="highway" v="footway"/><tag k="name" v="East"/></way>
</osm>"""

GRAPH = """<graphml xmlns="http://graphml.graphdrawing.org/xmlns">
<key id="y" for="node" attr.name="y" attr.type="string"/><key id="x" for="node" attr.name="x" attr.type="string"/>
<key id="h" for="edge" attr.name="highway" attr.type="string"/>
<graph edgedefault="directed">{nodes}{edges}</graph></graphml>"""


def counts(folder: Path) -> None:
    """Six weeks in which many walk on the northern bank in the afternoon, and hardly anybody on the southern one."""
    first = datetime.fromisoformat("2024-03-04")
    rows = []
    for hour in range(6 * 168):
        day = max(0.0, math.sin((hour % 24 - 6) / 16 * math.pi)) * (1 + 0.1 * math.sin(hour))
        rows.append(f"{(first + timedelta(hours=hour)).isoformat()},{round(9000 * day)},{round(50 * day)}")
    (folder / "banks.csv").write_text("\n".join(["time,North,South", *rows]))


@pytest.mark.parametrize("south", [60.1712590, 60.1712186])  # as long as the other bank, and 9 m longer
def test_the_empty_bank_of_a_river_is_walked(sidestep, tmp_path, south: float) -> None:
    (tmp_path / "banks.osm").write_text(BANKS.format(south=south))
    counts(tmp_path)
    (tmp_path / "banks.toml").write_text(
        '[place]\nstreets = "banks.npz"\n[place.crowd_source]\nfile = "banks.csv"\nreach = 60\n'
        'fitted = ["2024-03-04", "2024-04-01"]\ntested = ["2024-04-01", "2024-04-15"]\n'
        "[place.crowd_source.sensors]\nNorth = [60.1719785, 24.9522]\nSouth = [60.1712594, 24.9522]\n"
    )
    done = sidestep("import-osm", tmp_path / "banks.osm", "--out", tmp_path / "banks.npz")
    assert done.returncode == 0, done.stderr
    ends = ("--from", "60.1716188,24.9460000", "--to", "60.1716188,24.9580794", "--depart", "Mon 14:00")
    done = sidestep("route", tmp_path / "banks.toml", *ends, "--futures", "20", "--json")
    assert done.returncode == 0, done.stderr
    assert [leg["name"] for leg in json.loads(done.stdout)["legs"]] == ["West", "South Bank", "East"]


@pytest.fixture(scope="module")
def two_parts(tmp_path_factory) -> Path:
    """0 and 1 both ways, from 1 to 2 one way only, and 3 and 4 apart from these."""
    folder = tmp_path_factory.mktemp("parts")
    places = [(0, 0), (1, 0), (1, 1), (4, 0), (5, 0)]
    nodes = "".join(
        f'<node id="{number}"><data key="y">{60.17 + y / 1000}</data><data key="x">{24.94 + x / 500}</data></node>'
        for number, (y, x) in enumerate(places)
    )
    edges = "".join(
        f'<edge source="{tail}" target="{head}"><data key="h">footway</data></edge>'
        for tail, head in ((0, 1), (1, 0), (1, 2), (2, 2), (3, 4), (4, 3))
    )
    (folder / "parts.graphml").write_text(GRAPH.format(nodes=nodes, edges=edges))
    file = folder / "parts.toml"
    file.write_text('[place]\nstreets = "parts.graphml"\n')
    return file


@pytest.mark.parametrize("planner", ["expected", "random-walk"])
def test_connected_ends_in_streets_that_are_not(sidestep, two_parts, planner: str) -> None:
    # Nobody strays to 2, from where nothing leads on, unless the walk ends there.
    for ends, nodes in (((0, 1), [0, 1]), ((0, 2), [0, 1, 2]), ((3, 4), [3, 4])):
        words = ("--from", ends[0], "--to", ends[1], "--planner", planner, "--futures", "3", "--json")
        done = sidestep("route", two_parts, *words)
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        assert (set(found["nodes"]), found["arrival_rate"]) == (set(nodes), 1)


def test_ends_that_are_not_connected(sidestep, two_parts) -> None:
    for ends in ((2, 0), (0, 4)):
        done = sidestep("route", two_parts, "--from", ends[0], "--to", ends[1])
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    done = sidestep("matrix", two_parts, "--from", "0", "--from", "2", "--from", "3", "--json")
    reached = [[minutes is not None for minutes in row] for row in json.loads(done.stdout)["minutes"]]
    assert reached == [[True, True, False], [False, True, False], [False, False, True]]
    done = sidestep("compare", two_parts, "--walks", "2")  # walks from anywhere to anywhere
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
