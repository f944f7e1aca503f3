"""Streets as people map them, on a grid of footways with one more way across: how far it is from corner to corner."""

import bz2
import gzip
import json
import re

import numpy as np
import pytest
from scipy.sparse.csgraph import csgraph_from_dense, dijkstra

from sidestep.network.formats import save_town
from sidestep.network.opening_hours import open_minutes
from sidestep.network.osm import ImportReport, OsmError, import_osm
from sidestep.network.snapping import Snapper
from sidestep.network.town import Town

SIDE = 120.0  # m
ACROSS, AROUND = 170, 240  # m from 1005 to 1010: by the way across a block, and round it
DAY, NIGHT = 12 * 60, 23 * 60 + 30
"""Minutes of Monday."""


def grid_nodes(middle: dict[str, str] | None = None) -> dict:
    """4 × 4 crossings, and the middle of the way across, which has tags."""
    nodes = {1000 + x + 4 * y: (SIDE * x, SIDE * y) for x in range(4) for y in range(4)}
    return {**nodes, 1016: (1.5 * SIDE, 1.5 * SIDE, middle or {})}


def grid_ways(across: dict[str, str], refs: tuple[int, ...] = (1005, 1016, 1010)) -> dict:
    rows = {1 + y: (tuple(1000 + x + 4 * y for x in range(4)), {"highway": "footway"}) for y in range(4)}
    columns = {5 + x: (tuple(1000 + x + 4 * y for y in range(4)), {"highway": "footway"}) for x in range(4)}
    return {**rows, **columns, 9: (refs, {"name": "Test", **across})}


def metres(town: Town, minute: int = DAY, *, one: int = 1005, other: int = 1010, through: bool = True) -> float:
    """Walk from one crossing to another along streets that are open at a minute of the week, restricted ones or not."""
    opens = {text: open_minutes(text) for text in set(town.opening)}
    usable = np.array([opens[text][minute] for text in town.opening]) & (through | ~town.restricted)
    street, backwards = town.street_of_segment()
    kept = usable[street]
    tail = np.where(backwards, town.head[street], town.tail[street])[kept]
    head = np.where(backwards, town.tail[street], town.head[street])[kept]
    links = np.full((town.nodes,) * 2, np.inf)
    np.minimum.at(links, (tail, head), town.length[street][kept])
    begin, end = (int(np.flatnonzero(town.ids == number)[0]) for number in (one, other))
    return round(float(dijkstra(csgraph_from_dense(links, null_value=np.inf), indices=begin)[end]))


@pytest.fixture
def across(build):
    """Import the grid with the tags of the way across a block, and of the node in its middle."""

    def make(way: dict[str, str] | None = None, middle: dict[str, str] | None = None) -> tuple[Town, ImportReport]:
        return build(grid_nodes(middle), grid_ways({"highway": "footway"} if way is None else way))

    return make


def said(text: str) -> dict[str, str]:
    return dict(pair.split("=", 1) for pair in text.split(" | "))


@pytest.mark.parametrize(
    "way",
    [
        "highway=footway",
        "highway=primary",
        "highway=primary | motorroad=yes | foot=yes",
        "highway=busway | foot=yes",
        "highway=track | access=agricultural | foot=permissive",
        "highway=footway | access=unheard-of",
        "highway=footway | access=agricultural;forestry;yes",
        "highway=elevator | level=0;1",
        "highway=platform",
        "railway=platform",
        "public_transport=platform",
        "man_made=pier",
        "highway=footway | access:conditional=no @ (22:00-06:00) | foot=yes",  # foot outranks
        "highway=footway | foot:conditional=no @ (wet)",
        "highway=footway | opening_hours=sunrise-sunset",
        "highway=pedestrian | amenity=marketplace | opening_hours=Sa 08:00-13:00",
    ],
)
def test_ways_that_are_walked(across, way: str) -> None:
    town, _ = across(said(way))
    assert metres(town) == metres(town, NIGHT) == metres(town, through=False) == ACROSS


@pytest.mark.parametrize(
    "way",
    [
        "highway=primary | motorroad=yes",
        "highway=busway",
        "highway=footway | foot=use_sidepath",
        *(f"highway=track | access={value}" for value in ("no", "private", "agricultural", "forestry", "military")),
        *(f"highway=service | access={value}" for value in ("delivery", "employees", "permit", "emergency")),
        "highway=service | access=agricultural;forestry",
        "highway=footway | access=yes | foot=no",
        "highway=footway | access=no | foot:conditional=yes @ (sunrise-sunset)",
        "highway=footway | foot:forward=no | foot:backward=no",
        "highway=footway | oneway:foot=yes | foot:forward=no",
        "highway=footway | opening_hours=off",
        "route=ferry | foot=yes",
        "railway=tram",
    ],
)
def test_ways_that_are_not_walked(across, way: str) -> None:
    town, _ = across(said(way))
    assert metres(town) == AROUND


@pytest.mark.parametrize(
    "way",
    [
        "highway=footway | access=customers",
        "highway=footway | access=destination",
        "highway=service | access=no | foot=destination",
        "highway=cycleway | foot=destination",
        "highway=service | access=delivery;destination",
    ],
)
def test_ways_for_destinations_only(across, way: str) -> None:
    town, report = across(said(way))
    assert (metres(town), metres(town, through=False)) == (ACROSS, AROUND)
    assert report.limited == {"way: for destinations only": 1}
    assert town.restricted.sum() == 1


@pytest.mark.parametrize(
    ("way", "opening"),
    [
        ("highway=footway | foot:conditional=no @ (22:00-06:00)", "06:00-22:00"),
        ("highway=footway | access=no | foot:conditional=yes @ (06:00-22:00)", "06:00-22:00"),
        ("highway=footway | access:conditional=private @ (22:00-06:00)", "06:00-22:00"),
        ("highway=footway | opening_hours=Mo-Fr 06:00-22:00; PH off", "Mo-Fr 06:00-22:00"),
        ("highway=cycleway | foot:conditional=yes @ (06:00-22:00) | access=no", "06:00-22:00"),
        (
            "highway=footway | opening_hours=06:00-22:00 | foot:conditional=no @ (08:00-09:00)",
            "06:00-08:00,09:00-22:00",
        ),
        (
            "highway=footway | foot:conditional=no @ (22:00-06:00); yes @ (Sa 22:00-24:00)",
            "Mo-Fr,Su 06:00-22:00; Sa 06:00-24:00",
        ),
        ("highway=footway | access=destination | foot:conditional=yes @ (06:00-22:00)", "06:00-22:00"),
    ],
)
def test_ways_with_opening_times(across, way: str, opening: str) -> None:
    town, report = across(said(way))
    assert (metres(town, DAY), metres(town, NIGHT)) == (ACROSS, AROUND)
    assert report.limited == {"way: opening times": 1}
    assert set(town.opening) == {"", opening}


@pytest.mark.parametrize(
    ("way", "there", "back"),
    [
        ("foot:backward=no", ACROSS, AROUND),
        ("foot:forward=private", AROUND, ACROSS),
        ("access:backward=no", ACROSS, AROUND),
        ("access=no | foot:forward=yes", ACROSS, AROUND),
        ("foot:backward:conditional=no @ (10:00-14:00)", ACROSS, AROUND),
        ("foot:forward:conditional=no @ (22:00-06:00) | foot:backward=no", ACROSS, AROUND),
        ("oneway:foot=-1", AROUND, ACROSS),
    ],
)
def test_directions_of_ways(across, way: str, there: int, back: int) -> None:
    town, _ = across({"highway": "path", **said(way)})
    assert (metres(town), metres(town, one=1010, other=1005)) == (there, back)


def test_ways_with_opening_times_in_one_direction_are_not_cut_at_every_node(build) -> None:
    refs = (1005, *range(1020, 1030), 1010)
    nodes = grid_nodes() | {1020 + i: (SIDE + 10 * i + 10, SIDE + 10 * i + 10) for i in range(10)}
    town, _ = build(nodes, grid_ways({"highway": "path", "foot:forward:conditional": "no @ (22:00-06:00)"}, refs))
    assert (metres(town), metres(town, NIGHT)) == (ACROSS, AROUND)
    assert metres(town, NIGHT, one=1010, other=1005) == ACROSS
    assert sorted(zip(town.opening, town.one_way.tolist(), strict=True))[-2:] == [("", True), ("06:00-22:00", True)]


@pytest.mark.parametrize(
    "middle",
    [
        "barrier=gate | access=private | locked=yes",
        "barrier=gate | access=private",
        "barrier=gate | locked=yes",
        "barrier=gate | access=yes | locked=yes",
        "barrier=gate | foot=no | access=yes",
        "barrier=lift_gate | access=agricultural",
        "barrier=bollard | foot=private",
        "barrier=gate | opening_hours=off",
        "entrance=service | access=private",
        "entrance=yes | access=no",
        "entrance=emergency",
        "door=hinged | access=private",
        "highway=elevator | access=private",
        *(f"barrier={kind}" for kind in ("wall", "fence", "hedge", "retaining_wall", "city_wall")),
    ],
)
def test_nodes_that_are_closed(across, middle: str) -> None:
    town, report = across(middle=said(middle))
    assert metres(town) == AROUND
    assert report.limited == {"node: closed": 1}
    # Each end has a node of its own, where one may walk to: 85 m from either side.
    invented = [number for number in town.ids.tolist() if number < 0]
    assert len(set(town.ids.tolist())) == town.nodes
    assert [metres(town, one=1005, other=number) for number in sorted(invented, reverse=True)] == [85, AROUND + 85]


@pytest.mark.parametrize(
    "middle",
    [
        "barrier=gate",
        "barrier=bollard",
        "barrier=kissing_gate",
        "barrier=stile",
        "barrier=unheard-of",
        "barrier=no | access=no",
        "barrier=gate | access=private | foot=yes",
        "barrier=gate | locked=yes | foot=designated",
        "barrier=wall | foot=permissive",
        "barrier=fence | gate=yes",
        "barrier=wall | stile=yes",
        "barrier=fence;gate",
        "barrier=hedge | entrance=yes",
        "barrier=gate | access=permissive",
        "barrier=gate | motor_vehicle=no",
        "barrier=gate | opening_hours=sunrise-sunset",
        "entrance=main",
        "highway=crossing | foot=no",  # about crossing the carriageway
        "amenity=parking_entrance | access=private",
    ],
)
def test_nodes_that_are_open(across, middle: str) -> None:
    town, report = across(middle=said(middle))
    assert metres(town) == metres(town, NIGHT) == metres(town, through=False) == ACROSS
    assert report.limited == {}


@pytest.mark.parametrize(
    "middle",
    [
        "barrier=gate | opening_hours=06:00-22:00",
        "barrier=gate | access=private | opening_hours=06:00-22:00 | foot=yes",
        "barrier=gate | access=no | foot:conditional=yes @ (06:00-22:00)",
        "barrier=gate | locked=yes | access:conditional=no @ (22:00-06:00)",
        "barrier=wall | foot:conditional=yes @ (06:00-22:00)",
        "entrance=yes | foot:conditional=no @ (22:00-06:00)",
    ],
)
def test_nodes_with_opening_times(across, middle: str) -> None:
    town, report = across(middle=said(middle))
    assert (metres(town, DAY), metres(town, NIGHT)) == (ACROSS, AROUND)
    assert report.limited == {"node: opening times": 1}
    assert set(town.opening) == {"", "06:00-22:00"}


def test_opening_times_are_those_of_the_parts_next_to_the_gate(build) -> None:
    gate = said("barrier=gate | opening_hours=06:00-22:00")
    nodes = {
        1: (0, 0),
        2: (100, 0),
        3: (110, 0, gate),
        4: (130, 0),
        5: (300, 0),
        6: (110, 50),
        7: (110, 90),
        8: (0, 400),
    }
    foot = {"highway": "footway"}
    town, _ = build(nodes, {1: ((1, 2, 3, 4, 5), foot), 2: ((3, 6, 7), foot), 3: ((7, 8, 1), foot), 4: ((8, 5), foot)})
    timed = [row for row, text in zip(_rows(town), town.opening, strict=True) if text]
    assert sorted(timed) == [(2, 3, 10), (3, 4, 20), (3, 6, 50)]  # of every way that meets there


def _rows(town: Town) -> list[tuple[int, int, int]]:
    ends = np.sort(town.ids[np.stack([town.tail, town.head], axis=1)], axis=1).tolist()
    return [(*pair, round(float(length))) for pair, length in zip(ends, town.length, strict=True)]


def test_a_gate_that_is_never_open_when_the_way_is_closes_it(across) -> None:
    way = said("highway=footway | foot:conditional=no @ (12:00-24:00)")
    town, report = across(way, said("barrier=gate | opening_hours=12:00-24:00"))
    assert metres(town) == AROUND
    assert report.dropped["street: never open"] == 2


def test_a_gate_for_customers_restricts_the_parts_next_to_it(across) -> None:
    town, report = across(middle=said("barrier=gate | access=customers"))
    assert (metres(town), metres(town, through=False)) == (ACROSS, AROUND)
    assert report.limited == {"node: for destinations only": 1}


def test_every_way_is_cut_at_a_closed_node_where_several_meet(build) -> None:
    nodes, ways = grid_nodes(said("barrier=gate | access=private")), grid_ways({"highway": "footway"})
    town, _ = build(nodes, {**ways, 10: ((1006, 1016, 1009), {"highway": "path"})})
    assert metres(town) == metres(town, one=1006, other=1009) == AROUND
    assert sum(number < 0 for number in town.ids.tolist()) == 4


def test_invented_numbers_are_none_of_the_files(build) -> None:
    nodes = {1: (0, 0), -1: (100, 0, said("barrier=wall")), -2: (200, 0), 4: (0, 100)}
    ways = {1: ((1, -1, -2), {"highway": "path"}), 2: ((1, 4, -2), {"highway": "path"})}
    town, _ = build(nodes, ways)
    assert sorted(town.ids.tolist()) == [-4, -3]  # one street from one side of the wall round to the other


def test_public_streets_behind_restricted_ones_are_restricted_too(build) -> None:
    # 1-2-3-4 is public; 2-5 for destinations only, and behind it lie 5-6 and a loop; 3-7 and 7-8-4 are public.
    nodes = {1: (0, 0), 2: (100, 0), 3: (200, 0), 4: (300, 0), 5: (100, 100), 6: (100, 200), 7: (200, 90), 8: (300, 90)}
    nodes |= {9: (50, 150)}
    public, private = {"highway": "residential"}, {"highway": "service", "access": "destination"}
    ways = {1: ((1, 2, 3, 4), public), 2: ((2, 5), private), 3: ((5, 6, 9, 5), public), 4: ((3, 7, 8, 4), public)}
    town, report = build(nodes, ways)
    assert report.limited == {
        "way: for destinations only": 1,
        "street: public, but reached only through restricted ones": 2,
    }
    behind = {5, 6, 9}
    ends = town.ids[np.stack([town.tail, town.head], axis=1)].tolist()
    for pair, restricted in zip(ends, town.restricted, strict=True):
        assert bool(behind & set(pair)) == restricted


def test_a_town_of_restricted_streets_alone_stays(build) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (50, 90)}
    yard = {"highway": "service", "access": "customers"}
    town, _ = build(nodes, {1: ((1, 2), yard), 2: ((2, 3), yard)})
    assert town.restricted.all()


# Lifts, ferries.


def test_a_lift_at_a_node_joins_levels(build) -> None:
    lift = said("highway=elevator")
    nodes = {1: (0, 0), 2: (100, 0, lift), 3: (200, 0), 4: (100, 100), 5: (100, -100)}
    ground, above = {"highway": "footway"}, {"highway": "footway", "level": "1"}
    ways = {1: ((1, 2, 3), ground), 2: ((2, 4), above), 3: ((5, 2), ground), 4: ((1, 5, 3), ground)}
    town, _ = build(nodes, ways)
    assert town.kind.count("elevator") == 1
    ride = town.kind.index("elevator")
    ends = {int(town.ids[town.tail[ride]]), int(town.ids[town.head[ride]])}
    assert 2 in ends
    assert min(ends) < 0
    assert metres(town, one=5, other=2) == 100
    assert metres(town, one=5, other=min(ends)) == 100  # after the ride


def test_a_lift_between_ways_without_levels_joins_each_two(build) -> None:
    nodes = {1: (0, 0), 2: (100, 0, said("highway=elevator | opening_hours=06:00-22:00")), 3: (200, 0), 4: (100, 100)}
    foot = {"highway": "footway"}
    town, _ = build(nodes, {1: ((1, 2), foot), 2: ((3, 2), foot), 3: ((1, 4, 3), foot)})
    assert town.kind.count("elevator") == 1
    assert town.opening[town.kind.index("elevator")] == "06:00-22:00"


def test_ways_without_a_level_meet_those_of_level_0_at_a_lift(build) -> None:
    nodes = {1: (0, 0), 2: (100, 0, said("highway=elevator")), 3: (200, 0), 4: (100, 100), 5: (0, -100)}
    street, hall, below = ({"highway": "corridor", **level} for level in ({}, {"level": "0"}, {"level": "-1"}))
    ways = {1: ((5, 1, 2), street), 2: ((2, 3), hall), 3: ((2, 4), below), 4: ((1, 4), below)}
    town, _ = build(nodes, ways)
    assert town.kind.count("elevator") == 1
    assert metres(town, one=1, other=3) == 200  # without a ride


def test_what_ferries_would_reach_is_counted(build) -> None:
    foot = {"highway": "footway"}
    nodes = {1: (0, 0), 2: (100, 0), 3: (50, 90), 4: (900, 0), 5: (990, 0), 6: (0, 900), 7: (90, 900), 8: (500, 0)}
    ways = {
        1: ((1, 2, 3, 1), foot), 2: ((2, 8, 4), {"route": "ferry", "foot": "yes"}), 3: ((4, 5), foot),
        4: ((6, 7), foot), 5: ((3, 6), {"route": "ferry", "foot": "no"}), 6: ((1, 3), foot),
    }  # fmt: skip
    _, report = build(nodes, ways)
    assert report.dropped["way: ferry"] == 2
    assert report.dropped["street: reached only by ferry"] == 1
    assert report.dropped["street: outside the largest connected part"] == 1
    assert report.parts_left_out == 2


@pytest.mark.parametrize(
    ("own", "of", "ferries", "reached"),
    [
        ({}, {"route": "ferry"}, 1, 1),
        ({"seamark:type": "ferry_route"}, {"route": "ferry", "foot": "yes"}, 1, 1),
        ({}, {"route": "ferry", "foot": "no"}, 1, 0),
        ({"route": "ferry"}, {"route": "ferry"}, 1, 1),  # mapped twice
        ({}, {"route": "bus"}, 0, 0),
    ],
)
def test_ferries_mapped_as_relations_are_counted_too(
    build, own: dict[str, str], of: dict[str, str], ferries: int, reached: int
) -> None:
    foot = {"highway": "footway"}
    nodes = {1: (0, 0), 2: (100, 0), 3: (50, 90), 4: (900, 0), 5: (990, 0), 8: (500, 0)}
    ways = {1: ((1, 2, 3, 1), foot), 2: ((2, 8, 4), own), 3: ((4, 5), foot)}
    nodes |= {number: (number, 500) for number in (21, 22, 23)}
    ways[9] = ((21, 22, 23, 21), {"amenity": "ferry_terminal"})
    members = [(2, ""), (99, ""), (9, "platform")]
    _, report = build(nodes, ways, [(members, {"type": "route", **of})])
    assert report.ways == 2 + ferries
    assert report.dropped.get("way: ferry", 0) == ferries
    assert report.dropped.get("street: reached only by ferry", 0) == reached
    assert report.dropped.get("street: outside the largest connected part", 0) == 1 - reached


# Files.


def test_a_town_on_the_antimeridian(build, tmp_path) -> None:
    """The grid with its middle column of blocks at longitude 180°."""
    nodes, ways = grid_nodes(), grid_ways({"highway": "footway"})
    plain, _ = build(nodes, ways)
    path = tmp_path / "town.osm"
    shift = re.compile(r'lon="([^"]*)"')
    text = shift.sub(lambda lon: f'lon="{_east(float(lon[1]) + 180 - 1.5 * SIDE / 111_195.08):.7f}"', path.read_text())
    path.write_text(text)
    town, _ = import_osm(path, merge=0)
    assert (town.place[:, 0] < 0).any()
    np.testing.assert_allclose(town.length, plain.length, rtol=1e-4)
    np.testing.assert_allclose(town.project(town.place), plain.project(plain.place), atol=0.1)
    assert metres(town) == ACROSS
    longitude = _east(180 - 0.9 * SIDE / 111_195.08)
    for east in (longitude, -180.0, 180.0):
        assert Snapper(town).nearest(0.0, east).distance == pytest.approx(0, abs=0.1)
    assert np.ptp(Snapper(town).nearest(0.0001, 180.0).place[0]) == 0
    save_town(town, tmp_path / "town.geojson")
    lines = [line["geometry"] for line in json.loads((tmp_path / "town.geojson").read_text())["features"]]
    several = [line["coordinates"] for line in lines if line["type"] == "MultiLineString"]
    parts = [line["coordinates"] for line in lines if line["type"] == "LineString"] + [
        part for two in several for part in two
    ]
    assert several
    assert all(max(lon for lon, _ in part) - min(lon for lon, _ in part) < 1 for part in parts)


def _east(degrees: float) -> float:
    return degrees - 360 if degrees > 180 else degrees


def test_what_editors_delete_is_not_there(osm, tmp_path) -> None:
    path = tmp_path / "edited.osm"
    text = osm(grid_nodes(), grid_ways({"highway": "footway"}))
    for way in ("<way id=\"9\" version='1' action='delete' visible='true'>", '<way id="9" action = "delete">'):
        path.write_text(text.replace('<way id="9">', way))
        assert metres(import_osm(path, merge=0)[0]) == AROUND
    path.write_text(text.replace('<node id="1016"', "<node id=\"1016\" action='delete'"))
    town, report = import_osm(path, merge=0)
    assert metres(town) == AROUND
    assert report.repaired["way: split at missing nodes"] == 1
    for packed in (gzip.compress, bz2.compress):
        file = tmp_path / f"edited.osm.{'gz' if packed is gzip.compress else 'bz2'}"
        file.write_bytes(packed(text.replace('<way id="9">', '<way id="9" action="delete">').encode()))
        assert metres(import_osm(file, merge=0)[0]) == AROUND
    path.write_text(text.replace('<way id="9">', '<way id="9" action="modify">'))
    assert metres(import_osm(path, merge=0)[0]) == ACROSS


def _way(version: int, *, tag: str = "footway", visible: str = "true", refs=(1005, 1016, 1010)) -> str:
    through = "".join(f'<nd ref="{ref}"/>' for ref in refs)
    return f'<way id="9" version="{version}" visible="{visible}">{through}<tag k="highway" v="{tag}"/></way>'


@pytest.mark.parametrize(
    ("versions", "length"),
    [
        ((_way(1), _way(2, tag="construction")), AROUND),
        ((_way(2, tag="construction"), _way(1)), AROUND),  # in any order
        ((_way(1, tag="construction"), _way(2)), ACROSS),
        ((_way(1), _way(2, visible="false")), AROUND),
        ((_way(1), '<way id="9" version="2" visible="false"/>'), AROUND),
        ((_way(1), '<way id="9" version="3" visible="false"/>', _way(2)), AROUND),
        ((_way(1), _way(2, visible="false"), _way(3)), ACROSS),
        ((_way(1), _way(10, refs=(1005, 1016))), AROUND),
        (
            (_way(1), '<way id="9" version="2"><nd ref="1005"/><nd ref="1010"/><tag k="building" v="yes"/></way>'),
            AROUND,
        ),
    ],
)
def test_the_latest_version_of_a_way_counts(osm, tmp_path, versions, length: int) -> None:
    ways = grid_ways({"highway": "footway"})
    del ways[9]
    path = tmp_path / "history.osm"
    path.write_text(osm(grid_nodes(), ways).replace("</osm>", "\n".join([*versions, "</osm>"])))
    town, report = import_osm(path, merge=0)
    assert metres(town) == length
    assert "way: repeated number" not in report.dropped


@pytest.mark.parametrize(
    ("versions", "length"),
    [
        (('version="1"', 'version="2"><tag k="barrier" v="wall"/></node>'), AROUND),
        (('version="2"', 'version="1"><tag k="barrier" v="wall"/></node>'), ACROSS),
        (('version="1"', 'version="2" visible="false"/>'), AROUND),
    ],
)
def test_the_latest_version_of_a_node_counts(osm, tmp_path, versions, length: int) -> None:
    path = tmp_path / "history.osm"
    text = osm(grid_nodes(), grid_ways({"highway": "footway"}))
    first, second = versions
    place = re.search(r'<node id="1016" (lon="[^"]*" lat="[^"]*")>', text)[1]
    again = second if "false" in second else f"{place} {second}"
    path.write_text(text.replace('<node id="1016"', f'<node id="1016" {again}\n<node id="1016" {first}'))
    assert metres(import_osm(path, merge=0)[0]) == length


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.osm", "<?xml version='1.0'?>\n<!-- new --><osmChange version='0.6'><create/></osmChange>"),
        ("a.osm", "<osmAugmentedDiff version='0.6'/>"),
        ("a.osm", "<osm version='0.6'><action type='create'><node id='1' lat='0' lon='0'/></action></osm>"),
        ("a.osc", "<osmChange version='0.6'/>"),
        ("a.osc.gz", ""),
        ("a.osm", "<html><body/></html>"),
    ],
)
def test_changes_are_no_extract(tmp_path, name: str, content: str) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(OsmError) as caught:
        import_osm(path)
    assert str(caught.value).startswith(str(path))
    packed = tmp_path / "packed.osm.gz"
    packed.write_bytes(gzip.compress(content.encode()))
    with pytest.raises(OsmError):
        import_osm(packed)


def test_places_that_stand_with_the_ways_are_read(osm, tmp_path) -> None:
    text = osm(grid_nodes(), grid_ways({"highway": "footway"}))
    places = dict(re.findall(r'<node id="(\d+)" (lon="[^"]*" lat="[^"]*")', text))
    ways = "\n".join(line for line in text.splitlines() if "<node" not in line)
    path = tmp_path / "overpass.osm"
    path.write_text(text.replace('<way id="9">', '<way id="9">\n<center lat="0" lon="0"/>'))  # out center
    assert metres(import_osm(path, merge=0)[0]) == ACROSS
    relation = '<relation id="5"><member type="way" ref="9" role="outer">\n<nd lat="0" lon="0"/>\n</member></relation>'
    located = re.sub(r'<nd ref="(\d+)"/>', lambda nd: f'<nd ref="{nd[1]}" {places[nd[1]]}/>', ways)
    for content in (located, located.replace("</osm>", f"{relation}</osm>")):
        path.write_text(content)
        assert metres(import_osm(path, merge=0)[0]) == ACROSS
    # Where a node is there as well, it counts.
    wall = f'<node id="1016" {places["1016"]}><tag k="barrier" v="wall"/></node>'
    path.write_text(located.replace("</osm>", f"{wall}</osm>"))
    assert metres(import_osm(path, merge=0)[0]) == AROUND
    # Lines keep their numbers.
    path.write_text(located.replace("</osm>", f"{relation}\n<node/><</osm>"))
    with pytest.raises(OsmError) as caught:
        import_osm(path)
    assert caught.value.line == path.read_text().splitlines().index("<node/><</osm>") + 1


def test_ways_that_stand_in_relations_alone_are_read(osm, tmp_path) -> None:
    # Overpass writes them so (out geom) where only the relation is asked for: a square from 1005 to 1010.
    ways = grid_ways({"highway": "footway"})
    del ways[9]
    square = [([(30, "outer"), (31, "outer"), (40, "inner")], {"highway": "pedestrian"})]
    text = osm(grid_nodes(), ways, square)
    places = dict(re.findall(r'<node id="(\d+)" (lon="[^"]*" lat="[^"]*")', text))
    corner = 1.5 * SIDE / 111_195.08
    hole = [(corner + x * 1e-5, corner + y * 1e-5) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    courses = {
        30: [places[ref] for ref in ("1005", "1006", "1010")],
        31: [places[ref] for ref in ("1010", "1009", "1005")],
        40: [f'lat="{y}" lon="{x}"' for x, y in hole],
    }
    for way, course in courses.items():
        inside = "".join(f"<nd {place}/>\n" for place in course)
        member = re.search(rf'<member type="way" ref="{way}" role="[a-z]+"/>', text)[0]
        text = text.replace(member, f"{member[:-2]}>{inside}</member>")
    path = tmp_path / "overpass.osm"
    path.write_text(text)
    town, report = import_osm(path, merge=0)
    assert (metres(town), report.areas) == (ACROSS, 1)
    assert "area: walked along its outline, open ring" not in report.repaired
    # A member that is cut is not there.
    path.write_text(text.replace(f"<nd {places['1009']}/>", "<nd/>"))
    assert import_osm(path, merge=0)[1].repaired["area: walked along its outline, open ring"] == 1


@pytest.mark.parametrize("elements", [True, False])
def test_what_overpass_did_not_finish_is_refused(osm, tmp_path, elements: bool) -> None:
    said = '<remark> runtime error: Query timed out in "query" at line 3 after 26 seconds. </remark></osm>'
    path = tmp_path / "overpass.osm"
    text = osm(grid_nodes(), grid_ways({"highway": "footway"})) if elements else '<osm version="0.6"></osm>'
    path.write_text(text.replace("</osm>", said))
    with pytest.raises(OsmError, match="timed out"):
        import_osm(path)
    path.write_text(text.replace("</osm>", "<remark>all well</remark></osm>"))
    if elements:
        assert metres(import_osm(path, merge=0)[0]) == ACROSS


def test_a_file_is_what_it_holds_and_not_what_it_is_called(osm, tmp_path) -> None:
    text = osm(grid_nodes(), grid_ways({"highway": "footway"})).encode()
    for name, content in (
        ("a.osm", gzip.compress(text)),
        ("a.osm", bz2.compress(text)),
        ("a.osm.gz", text),
        ("a.osm.bz2", gzip.compress(text)),
        ("a.osm.pbf", text),
        ("a.pbf", bz2.compress(text)),
    ):
        (tmp_path / name).write_bytes(content)
        assert metres(import_osm(tmp_path / name, merge=0)[0]) == ACROSS
    for name, content, said in (
        ("b.osm", b'{"version": 0.6, "elements": []}', "JSON"),
        ("b.osm.gz", gzip.compress(b' [{"type": "node"}]'), "JSON"),
        ("b.osm.gz", b"PK\x03\x04", "zip"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(OsmError, match=said):
            import_osm(tmp_path / name)


def test_latitude_and_longitude_swapped(tmp_path) -> None:
    nodes = "".join(f'<node id="{number}" lat="{174.76 + number / 1000}" lon="-36.85"/>' for number in (1, 2))
    way = '<way id="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="footway"/></way>'
    (tmp_path / "auckland.osm").write_text(f'<osm version="0.6">{nodes}{way}</osm>')
    with pytest.raises(OsmError, match="swapped"):
        import_osm(tmp_path / "auckland.osm")


# Kerbs and inclines.


@pytest.mark.parametrize(
    ("tags", "height"),
    [
        ("kerb=raised", 0.1),
        ("barrier=kerb", 0.1),
        ("barrier=kerb | kerb=flush", 0),
        ("kerb=lowered", 0.03),
        ("kerb=rolled", 0.05),
        ("kerb=raised | kerb:height=14 cm", 0.14),
        ("kerb:height=0.02", 0.02),
        ("kerb=lowered | kerb:height=high", 0.03),
    ],
)
def test_kerbs_on_a_way(across, tags: str, height: float) -> None:
    for town, report in (across(middle=said(tags)), across({"highway": "footway", **said(tags)})):
        assert max(town.kerb.tolist()) == pytest.approx(height)
        assert (town.kerb > 0).sum() == (height > 0)
        assert ("high" in tags) == any("kerb" in what for what in report.repaired)
        assert metres(town) == ACROSS


def test_a_kerb_where_streets_meet_is_that_of_the_crossing(build) -> None:
    # A pavement 1-2-3 with a kerb at 2, from which a crossing leads to the pavement 4-5-6.
    nodes = {1: (0, 0), 2: (100, 0, {"kerb": "raised"}), 3: (200, 0), 4: (0, 20), 5: (100, 20), 6: (200, 20)}
    foot = {"highway": "footway"}
    ways = {1: ((1, 2, 3), foot), 2: ((4, 5, 6), foot), 3: ((2, 5), {**foot, "footway": "crossing"})}
    for way in (ways[3], ((2, 5), foot)):  # tagged as one, or known by its end
        town, _ = build(nodes, {**ways, 3: way})
        assert {round(float(metres)): float(kerb) > 0 for metres, kerb in zip(town.length, town.kerb, strict=True)} == {
            100: False,
            20: True,
        }


def test_inclines_turn_with_the_way(build) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (100, 60)}
    steep = {"highway": "footway", "incline": "8%"}
    ways = {1: ((1, 2), {**steep, "oneway:foot": "-1"}), 2: ((1, 3, 2), {"highway": "steps", "incline": "up"})}
    town, _ = build(nodes, ways)
    rise = {round(float(metres)): float(incline) for metres, incline in zip(town.length, town.incline, strict=True)}
    assert rise == {100: pytest.approx(-0.08), 177: pytest.approx(0.5)}


def test_tags_that_nobody_understands_are_counted(across) -> None:
    way = said("highway=footway | access=unheard-of | foot=yes;no | foot:conditional=no @ (wet) | opening_hours=later")
    _, report = across({**way, "incline": "up"}, said("barrier=gate | access=yes | locked=yes | foot:forward=no"))
    counted = dict(report.repaired)
    counted.pop("crossing: two streets joined into one", None)
    assert counted == {
        "way: unknown access ignored": 1,
        "way: contradicting access": 1,
        "way: conditional access not understood": 1,
        "way: opening hours not understood": 1,
        "way: incline without a readable number ignored": 1,
        "node: contradicting access": 1,
    }
