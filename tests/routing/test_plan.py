"""Walks through a small town of which everything is known: turn by turn, files, current counts, bad input."""

import json
import re
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree as ET

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.cli import app as cli
from sidestep.crowds.counts import CountTable, read_counts
from sidestep.crowds.crowd_table import save_crowd_table
from sidestep.crowds.table_reader import read_table
from sidestep.environment.types import RewardWeights
from sidestep.errors import SidestepError
from sidestep.network.formats import save_town
from sidestep.network.snap import Snapper
from sidestep.network.splice import splice
from sidestep.network.town import Town, metres_between
from sidestep.planners.learned import Learned
from sidestep.planners.reactive import Forecast
from sidestep.planners.shortest_path import distances_to
from sidestep.planners.time_dependent import Expected
from sidestep.routing.formats import route_geojson, route_gpx
from sidestep.routing.plan import Journey, _segment, travel
from sidestep.routing.request import Departure, Trip, prepare, read_departure, read_minutes, read_node, read_place
from sidestep.routing.serialise import itinerary
from sidestep.scenarios import model as catalogue
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import Scenario, Sensor, Traffic, Venue
from sidestep.walking.speed_laws import FREE_SPEED, Weidmann

NOON = "2025-05-24T12:30"  # a Saturday
DEGREE = 111_195.08  # m, on the equator in both directions
PLACES = [(0, 0), (200, 0), (300, 0), (0, 100), (200, 100), (300, -100), (0, 300), (100, 300)]
STREETS = [  # tail, head, one-way, kind, name, points between
    (0, 1, False, "footway", "Long Street", []),
    (1, 2, False, "footway", "Long Street", []),
    (1, 4, True, "residential", "Side Lane", []),
    (3, 4, False, "steps", "", []),
    (0, 3, False, "footway", "", []),
    (2, 5, False, "pedestrian", "Quay", []),
    (0, 1, False, "path", "Back Road", [(0, -50), (200, -50)]),
    (6, 7, False, "footway", "Island Street", []),
]
QUAY_COUNT = 4824  # persons/h: 0.5 persons/m² on 2 m


def at(x: float, y: float) -> tuple[float, float]:
    """Latitude and longitude of a place in metres."""
    return y / DEGREE, x / DEGREE


def small_town() -> Town:
    """See PLACES and STREETS.

    ::

        6 --- 7        (an island)

        3 ----- 4
        |       | one-way, up
        0 ----- 1 --- 2
        '-------'     |
                      5
    """
    courses = [np.array([PLACES[a], *inner, PLACES[b]], float) for a, b, *_, inner in STREETS]
    return Town(
        place=np.array(PLACES, float) / DEGREE,
        ids=np.arange(len(PLACES)),
        tail=np.array([street[0] for street in STREETS], np.int32),
        head=np.array([street[1] for street in STREETS], np.int32),
        one_way=np.array([street[2] for street in STREETS]),
        length=np.array([np.linalg.norm(np.diff(course, axis=0), axis=1).sum() for course in courses], np.float32),
        width=np.full(len(STREETS), 2, np.float32),
        kind=tuple(street[3] for street in STREETS),
        name=tuple(street[4] for street in STREETS),
        signals=np.zeros(len(STREETS), np.int16),
        crossings=np.zeros(len(STREETS), np.int16),
        points=np.concatenate(courses) / DEGREE,
        first=np.cumsum([0, *map(len, courses)]),
        attribution="© nobody & sons, ODbL 1.0",
    )


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    """Nobody on Back Road and always as many on the Quay, so that all times are known."""
    folder = tmp_path_factory.mktemp("tiny")
    save_town(small_town(), folder / "town.npz")
    first = datetime.fromisoformat("2024-01-01")
    hours = [(first + timedelta(hours=hour)).isoformat(timespec="minutes") for hour in range(8 * 168)]
    rows = "".join(f"{hour},0,{QUAY_COUNT - 1}\n" for hour in hours)
    (folder / "counts.csv").write_text(f"time,back road,the quay\n{rows}")
    venue = Venue(
        streets=str(folder / "town.npz"),
        counts=str(folder / "counts.csv"),
        sensors=(Sensor("back road", at(100, -50)), Sensor("the quay", at(300, -50))),
        reach=20.0,
        fitted=("2024-01-01", "2024-02-12"),
        tested=("2024-02-12", "2024-02-26"),
    )
    return Scenario(
        "tiny", "a small town", venue=venue, law="weidmann", horizon=1200.0, reward=RewardWeights(progress=0, bonus=0)
    )


def asked(tiny: Scenario, origin, destination, depart: str | None = NOON, counts: CountTable | None = None) -> Trip:
    return prepare(tiny, draw_map(tiny, 0), origin, destination, read_departure(depart, tiny.venue), counts)


@pytest.fixture(scope="module")
def journey(tiny) -> Journey:
    """From the middle of Long Street to the middle of the Quay."""
    return travel(asked(tiny, at(50, 4), at(300, -50)), Expected(), futures=7)


def test_turn_by_turn(journey) -> None:
    found = itinerary(journey, by=10.0)
    quay = 50 / float(Weidmann().speed(jnp.float32(0.5))) / 60
    free = 250 / FREE_SPEED / 60
    assert [(step["turn"], step["street"], step["crowding"]) for step in found["steps"]] == [
        ("head east", "Long Street", "free"),
        ("turn right", "Quay", "busy"),
    ]
    assert [step["metres"] for step in found["steps"]] == pytest.approx([250, 50], abs=0.1)
    assert [step["minutes"] for step in found["steps"]] == pytest.approx([free, quay], rel=2e-3)
    assert [step["density"] for step in found["steps"]] == pytest.approx([0, 0.5], abs=0.01)
    # the partial streets are legs of their own, in between whole ones
    assert [leg["metres"] for leg in found["legs"]] == pytest.approx([150, 100, 50], abs=0.1)
    assert sum(leg["minutes"] for leg in found["legs"]) == pytest.approx(found["expected_minutes"])
    assert found["metres"] == pytest.approx(300, abs=0.1)
    assert found["mean_density"] == pytest.approx(0.5 * quay / (free + quay), abs=0.01)
    assert (found["arrives"], found["arrival_rate"], found["arrive_by"], found["futures"]) == (True, 1, 1, 7)
    # counts hardly vary, so every future is as expected
    for minutes in ("median_minutes", "p90_minutes"):
        assert found[minutes] == pytest.approx(found["expected_minutes"], rel=1e-4)
    assert (found["departs"], found["hour_of_week"]) == ("Saturday 2025-05-24 12:30", 5 * 24 + 12.5)
    assert found["origin"]["metres_away"] == pytest.approx(4, abs=0.01)
    assert found["crowds"].startswith("counts of ")
    assert "synthetic" not in found["crowds"]


def test_the_others_walk_the_same_futures(journey) -> None:
    others = itinerary(journey)["others"]
    assert list(others) == ["shortest-path", "snapshot"]
    for other in others.values():
        assert (other["futures"], other["arrival_rate"]) == (7, 1)
        assert other["mean_difference_minutes"] == pytest.approx(0, abs=1e-3)


def test_geojson(journey) -> None:
    found = json.loads(route_geojson(journey, by=10.0))
    assert (found["type"], found["attribution"]) == ("FeatureCollection", "© nobody & sons, ODbL 1.0")
    assert "crs" not in found
    kinds = [(feature["properties"]["part"], feature["geometry"]["type"]) for feature in found["features"]]
    assert kinds == [
        ("route", "LineString"), ("leg", "LineString"), ("leg", "LineString"), ("leg", "LineString"),
        ("origin", "Point"), ("destination", "Point"),
    ]  # fmt: skip
    assert all(set(feature) == {"type", "properties", "geometry"} for feature in found["features"])
    route, *legs, origin, destination = (feature["geometry"]["coordinates"] for feature in found["features"])
    # longitude first
    assert np.array(origin) * DEGREE == pytest.approx([50, 0], abs=0.02)
    assert np.array(destination) * DEGREE == pytest.approx([300, -50], abs=0.02)
    assert np.array(route) * DEGREE == pytest.approx(np.array([[50, 0], [200, 0], [300, 0], [300, -50]]), abs=0.02)
    assert [leg[-1] for leg in legs[:-1]] == [leg[0] for leg in legs[1:]]
    assert all(number == round(number, 7) for place in route for number in place)
    whole = found["features"][0]["properties"]
    assert whole["metres"] == pytest.approx(300, abs=0.1)
    assert (whole["by_minutes"], whole["arrive_by"]) == (10, 1)
    assert [found["features"][leg]["properties"]["street"] for leg in (1, 2, 3)] == [
        "Long Street",
        "Long Street",
        "Quay",
    ]


GPX = "{http://www.topografix.com/GPX/1/1}"
ORDER = {  # of the schema; what is not listed may not occur
    "gpx": ("metadata", "wpt", "rte", "trk", "extensions"),
    "metadata": ("name", "desc", "author", "copyright", "link", "time", "keywords", "bounds", "extensions"),
    "copyright": ("year", "license"),
    "rte": ("name", "cmt", "desc", "src", "link", "number", "type", "extensions", "rtept"),
    "trk": ("name", "cmt", "desc", "src", "link", "number", "type", "extensions", "trkseg"),
    "trkseg": ("trkpt", "extensions"),
    "rtept": ("ele", "time", "magvar", "geoidheight", "name", "cmt", "desc"),
    "trkpt": ("ele", "time", "magvar", "geoidheight", "name", "cmt", "desc"),
}


def check_order(element: ET.Element) -> None:
    tag = element.tag.removeprefix(GPX)
    children = [child.tag.removeprefix(GPX) for child in element]
    assert [*children] == sorted(children, key=ORDER.get(tag, ()).index)
    for child in element:
        assert child.tag.startswith(GPX)
        check_order(child)


def test_gpx(journey) -> None:
    assert "probability" not in route_gpx(journey)
    text = route_gpx(journey, by=10.0)
    assert "if crowds are as expected. Arrives within 10 min with probability 1.00. Crowds: " in text
    root = ET.fromstring(text)  # noqa: S314
    check_order(root)
    assert (root.tag, root.get("version"), root.get("creator")) == (f"{GPX}gpx", "1.1", "Sidestep")
    copyright_ = root.find(f"{GPX}metadata/{GPX}copyright")
    assert copyright_.get("author") == "© nobody & sons, ODbL 1.0"
    assert copyright_.find(f"{GPX}license").text.startswith("https://opendatacommons.org/")
    bounds = root.find(f"{GPX}metadata/{GPX}bounds")
    assert float(bounds.get("minlat")) * DEGREE == pytest.approx(-50, abs=0.02)
    turns = root.findall(f"{GPX}rte/{GPX}rtept")
    assert [turn.find(f"{GPX}name").text for turn in turns] == ["head east: Long Street", "turn right: Quay", "arrive"]
    track = root.findall(f"{GPX}trk/{GPX}trkseg/{GPX}trkpt")
    places = np.array([[float(point.get("lon")), float(point.get("lat"))] for point in track])
    assert metres_between(places[:-1], places[1:]).sum() == pytest.approx(300, abs=0.1)
    times = [datetime.fromisoformat(point.find(f"{GPX}time").text) for point in track]
    assert times[0] == datetime.fromisoformat(NOON)
    assert times == sorted(times)
    assert (times[-1] - times[0]).total_seconds() == pytest.approx(journey.route.seconds, abs=1)
    assert re.search(r"local wall time", text)


def test_gpx_of_odd_names(journey) -> None:
    odd = replace(journey, legs=tuple(replace(leg, name="A<&>\x00\ud800\uffffB") for leg in journey.legs))
    root = ET.fromstring(route_gpx(odd).encode())  # noqa: S314
    assert root.find(f"{GPX}rte/{GPX}rtept/{GPX}name").text == "head east: A<&>B"


@pytest.mark.parametrize(
    ("origin", "destination", "metres"),
    [
        # the middle of a street is left by the nearer end, and entered by the nearer one
        (at(50, 0), at(0, 50), 100),
        (at(150, 0), at(250, 0), 100),
        # both on one street
        (at(50, 0), at(150, 0), 100),
        # and yet the way round may be shorter, or the only one: Side Lane leads up alone
        (at(0, -10), at(200, -10), 220),
        (at(200, 20), at(200, 80), 60),
        (at(200, 80), at(200, 20), 20 + 200 + 100 + 200 + 20),
        (4, at(200, 50), 200 + 100 + 200 + 50),
    ],
)
def test_either_end_of_a_street(tiny, origin, destination, metres: float) -> None:
    trip = asked(tiny, origin, destination)
    network = trip.streets.network
    away = distances_to(network, np.asarray(network.length), trip.destination.node)
    assert away[trip.origin.node] == pytest.approx(metres, abs=0.1)


@pytest.mark.parametrize(("seconds", "name"), [(200.0, "Long Street"), (300.0, "Back Road")])
def test_parallel_streets_are_told_by_their_time(make_params, constant_field, seconds: float, name: str) -> None:
    town = small_town()
    streets = splice(town, [0, 1])
    params = make_params(streets.network, constant_field(streets.network, speed=1.0))
    assert town.name[streets.street[_segment(params, 0, 1, 60.0, 60.0 + seconds)]] == name


def live(tmp_path, *rows: str, header: str = "time,the quay") -> CountTable:
    file = tmp_path / "now.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return read_counts(file)


def test_current_counts_make_crowds(tiny, tmp_path) -> None:
    now = live(tmp_path, f"2025-05-24T11,{QUAY_COUNT}", f"2025-05-24T12,{3 * QUAY_COUNT}")
    trip = asked(tiny, at(50, 0), at(300, -50), counts=now)
    assert trip.counted == 1
    # back road was not counted; the quay has three times as many as usual, at 12:30 since this very moment
    assert np.isnan(float(trip.place.flow.current.residual[0]))
    assert float(trip.place.flow.current.residual[1]) == pytest.approx(np.log(3), abs=1e-3)
    assert float(trip.place.flow.current.since) == 0
    before = asked(tiny, at(50, 0), at(300, -50), counts=live(tmp_path, "2025-05-24T11,7"))
    assert float(before.place.flow.current.since) == 1
    later = asked(tiny, at(50, 0), at(300, -50), depart="2025-05-24T13:00", counts=now)
    assert float(later.place.flow.current.since) == 0.5


@pytest.mark.parametrize(
    ("header", "row", "says"),
    [
        (
            "time,the quay",
            "2025-05-24T10,5",
            "the last counts are of the hour from 2025-05-24T10:00, but the departure is",
        ),
        (
            "time,the quay",
            "2025-05-24T13,5",
            "departure is 2025-05-24T12:30; give counts of the hour of the departure or",
        ),
        ("time,the quey", "2025-05-24T12,5", "no sensor 'the quey'; did you mean 'the quay'?"),
        ("time,zoo", "2025-05-24T12,5", "no sensor 'zoo'; there are ['back road', 'the quay']"),
        ("time,the quay", "2025-05-24T12,", "nothing was counted in the last hour, from 2025-05-24T12:00"),
    ],
)
def test_counts_of_another_place_or_time(tiny, tmp_path, header: str, row: str, says: str) -> None:
    with pytest.raises(SidestepError, match=re.escape(says)) as caught:
        asked(tiny, 0, 1, counts=live(tmp_path, row, header=header))
    assert "\n" not in str(caught.value)


def test_counts_need_a_day(tiny, tmp_path) -> None:
    with pytest.raises(SidestepError, match="current counts need a departure with its day"):
        asked(tiny, 0, 1, depart=None, counts=live(tmp_path, "2025-05-24T12,5"))


@pytest.mark.parametrize(
    ("origin", "destination", "says"),
    [
        (at(50, 0), at(50.3, 0), "are the same place on these streets"),
        (3, at(0, 100), "crossing 3 and 0.00090,0.00000 are the same place"),
        (at(50, 300), at(0, 0), "no way leads from 0.00270,0.00045 to 0.00000,0.00000"),
        (9, 0, "there is no node 9 to be the origin; nodes are numbered 0 to 7"),
        (0, -1, "there is no node -1 to be the destination"),
        (at(5000, 0), 0, "m from the nearest street, so it is not in this town"),
        (0, (91.0, 0.0), "91, 0 is no place"),
    ],
)
def test_walks_that_cannot_be(tiny, origin, destination, says: str) -> None:
    with pytest.raises(SidestepError, match=re.escape(says)) as caught:
        asked(tiny, origin, destination)
    assert "\n" not in str(caught.value)


def test_departures(tiny) -> None:
    assert read_departure("2025-05-26T00:00", tiny.venue).hour == 0
    assert read_departure("2025-06-01 23:59:30", tiny.venue).hour == pytest.approx(168 - 30 / 3600)
    assert read_departure(None, tiny.venue) == Departure(10.0)
    assert read_departure(None, tiny.venue).text == "Monday 10:00"
    assert Departure(168 - 1 / 3600).text == "Monday 00:00"
    for text in ("soon", "30", "2025-05-24", "2025-13-01T12:00", "", "2025-05-24T25:00", "9999-12-31T23:59"):
        with pytest.raises(SidestepError, match=r"--depart must be a local time such as 2025-05-24T12:30, not"):
            read_departure(text, tiny.venue)
    for text in ("2025-05-24T12:30Z", "2025-05-24T12:30+03:00"):
        with pytest.raises(SidestepError, match="without zone or offset"):
            read_departure(text, tiny.venue)


def test_places() -> None:
    assert read_place("--from", "60.17, 24.94") == (60.17, 24.94)
    assert read_place("--from", "-33,151.2") == (-33, 151.2)
    assert read_place("--from", "12") == read_node("--from", "12") == 12
    assert read_minutes("2.5") == 2.5
    for text in ("here", "60.17", "60.17;24.94", "1.2.3,4", "", "nan,2", "1,2,3", "٣,٤"):
        with pytest.raises(SidestepError, match="--to must be a node or LAT,LON"):
            read_place("--to", text)
    with pytest.raises(SidestepError, match="a grid has no latitudes"):
        read_node("--to", "1.5,2.5")


@pytest.fixture
def command(tiny, monkeypatch, tmp_path, capsys):
    """`sidestep route tiny` from the middle of Long Street to the middle of the Quay, in this process."""
    monkeypatch.setitem(catalogue.BUILT_IN, "tiny", tiny)
    monkeypatch.setattr(cli, "_start_jax", lambda: None)
    monkeypatch.chdir(tmp_path)
    ends = ["--from", "{:.7f},{:.7f}".format(*at(50, 4)), "--to", "{:.7f},{:.7f}".format(*at(300, -50))]

    def run(*args: str) -> str:
        with pytest.raises(SystemExit, match="0"):
            cli.app(["route", "tiny", *ends, "--futures", "7", *args], exit_on_error=False, print_error=False)
        return capsys.readouterr().out

    return run


def test_the_command_prints_directions(command) -> None:
    said = command("--depart", NOON, "--by", "9")
    lines = [" ".join(line.split()) for line in said.splitlines()]
    assert lines[0] == "expected (map), departing Saturday 2025-05-24 12:30, if crowds are as expected:"
    assert re.match(r"0.0000\d,0.0004\d is 4 m from the street", lines[1])
    assert "head east Long Street 250 3.1 free 0.00" in lines
    assert "turn right Quay 50 0.6 busy 0.50" in lines
    assert "arrive" in lines
    for part in (
        "300 m, 3.8 min; crowds on the way: free, 0.09 persons/m²",
        "In 7 simulated futures: median 3.8 min, 90 % within 3.8 min, 100.0 % arrive",
        "Arrives within 9 min with probability 1.00",
        "shortest-path in the same futures: median 3.8 min",
        "snapshot in the same futures",
        "whatever the date.",
        "Streets: © nobody & sons, ODbL 1.0. Crowds: counts of ",
    ):
        assert part in said


def test_the_command_writes_files(command, tmp_path) -> None:
    assert command("--format", "geojson", "--out", "made/route.geojson") == ""
    assert json.loads((tmp_path / "made/route.geojson").read_text("utf-8"))["type"] == "FeatureCollection"
    gpx = command("--format", "gpx")
    assert "<time>" not in gpx  # on no day
    command("--format", "gpx", "--out", "route.gpx")
    assert (tmp_path / "route.gpx").read_text("utf-8") == gpx
    command("--format", "png", "--out", "route.png")
    assert (tmp_path / "route.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads(command("--json"))
    assert (found["departure"], found["departs"], found["counted_sensors"]) == (None, "Monday 10:00", None)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["made", "route.gpx", "route.png"]


def test_models_of_crossings_walk_between_crossings(command, monkeypatch) -> None:
    monkeypatch.setattr("sidestep.planners.learned.load_planners", lambda *_: Learned({}, 0, None))
    with pytest.raises(SidestepError, match="the model in m remembers crossings; give --from and --to as nodes"):
        command("--model", "m")


def test_the_command_says_that_counts_are_known(command, tmp_path) -> None:
    live(tmp_path, f"2025-05-24T12,{3 * QUAY_COUNT}")
    said = command("--depart", NOON, "--live", "now.csv")
    assert "and go on from current counts of 1 of 2 sensors." in said
    # three times as many, but what never varies is not expected to last: the next hour it is as usual
    assert float(re.search(r"Quay +50 +\d\.\d +\w+ +(\d\.\d\d)", said)[1]) == pytest.approx(1.45, abs=0.06)


# --- Crowds from a table --------------------------------------------------------------------------------------------

LONG, SLOW = 0, 2.0  # a street; persons/m² on Long Street from noon to one o'clock


def tabled(tiny: Scenario, rows: list[str], **changes: object) -> Scenario:
    """The small town with a table of densities on its streets beside its file."""
    folder = Path(tiny.venue.streets).parent
    with TemporaryDirectory() as drawer:
        table = Path(drawer) / "crowds.csv"
        table.write_text("\n".join(rows))
        save_crowd_table(read_table(table, small_town()), folder / "crowds.npz")
    venue = Venue(
        **{"streets": tiny.venue.streets, "counts": str(folder / "crowds.npz"), "days": (5,), "hours": (12, 14)}
        | changes
    )
    return replace(tiny, name="tabled", venue=venue)


def hours(tiny: Scenario, **changes: object) -> Scenario:
    """Saturday from noon to two: Long Street is slow in the first hour, and slower for who walks it to the west."""
    return tabled(
        tiny,
        [
            "street,direction,time,density",
            *(f"{LONG},forward,2025-05-24T{12 + hour}:00,{SLOW * (1 - hour)}" for hour in (0, 1)),
            *(f"{LONG},backward,2025-05-24T{12 + hour}:00,{2 * SLOW * (1 - hour)}" for hour in (0, 1)),
            *(f"5,,2025-05-24T{12 + hour}:00,0.5" for hour in (0, 1)),
        ],
        **changes,
    )


def test_pieces_are_as_dense_as_their_street(tiny) -> None:
    place = draw_map(hours(tiny), 0)
    streets = splice(small_town(), [Snapper(small_town()).nearest(*at(x, 0)) for x in (50, 120)])
    here = place.spliced(streets)
    lengths = np.asarray(here.network.length)
    assert lengths[np.flatnonzero(streets.parent == LONG)] == pytest.approx([50, 70, 80], abs=0.01)
    assert streets.share[np.flatnonzero(streets.parent == LONG)] == pytest.approx([0.25, 0.35, 0.4], abs=1e-4)
    assert (streets.share[: streets.town.streets][1:] == 1).all()
    for hour in (132.0, 133.0):
        before, after = (
            np.asarray(there.flow.expected(jnp.array([hour]), 3).density(there.network)[0]) for there in (place, here)
        )
        np.testing.assert_allclose(after, before[:, streets.parent], rtol=1e-5)
    # as many persons in all
    assert float(here.flow.volume.sum()) == pytest.approx(float(place.flow.volume.sum()))


@pytest.fixture(scope="module")
def slow(tiny) -> Journey:
    """The same walk as :func:`journey` while Long Street is slow, by forecasts from counts that surprise nobody."""
    return travel(asked(hours(tiny), at(50, 4), at(300, -50)), Forecast())


def test_turn_by_turn_through_a_table(slow) -> None:
    found = itinerary(slow, by=10.0)
    on = {density: float(Weidmann().speed(jnp.float32(density))) * 60 for density in (SLOW, 0.5)}
    assert [leg["density"] for leg in found["legs"]] == pytest.approx([SLOW, 0, 0.5], rel=1e-5)
    minutes = [150 / on[SLOW], 100 / FREE_SPEED / 60, 50 / on[0.5]]
    assert [leg["minutes"] for leg in found["legs"]] == pytest.approx(minutes, rel=2e-3)
    assert (found["sensors"], found["counted_sensors"], found["crowds"]) == (None, None, "table crowds.npz")
    assert (found["departs"], found["hour_of_week"]) == ("Saturday 2025-05-24 12:30", 132.5)
    # crowds come exactly as in the table: one future, and nothing to gain from counts
    assert (found["futures"], found["arrive_by"]) == (1, 1)
    assert found["median_minutes"] == pytest.approx(found["expected_minutes"])
    assert found["others"]["snapshot"]["mean_difference_minutes"] == pytest.approx(0, abs=1e-4)
    # in the picture Long Street is as crowded as in its worse direction
    assert slow.streets_density.tolist() == pytest.approx([2 * SLOW, 0, 0, 0, 0, 0.5, 0, 0], rel=1e-5)


def test_chance_or_lights_make_futures_differ(tiny) -> None:
    assert asked(hours(tiny), 0, 1).certain
    assert not asked(hours(tiny, noise=(0.5, 0.3)), 0, 1).certain
    assert not asked(hours(tiny, traffic=Traffic()), 0, 1).certain
    assert not asked(tiny, 0, 1).certain


@pytest.fixture
def by_command(monkeypatch, tmp_path, capsys):
    """`sidestep route tabled` in this process."""
    monkeypatch.setattr(cli, "_start_jax", lambda: None)
    monkeypatch.chdir(tmp_path)

    def run(problem: Scenario, *args: str) -> str:
        monkeypatch.setitem(catalogue.BUILT_IN, "tabled", problem)
        with pytest.raises(SystemExit, match="0"):
            cli.app(["route", "tabled", *args], exit_on_error=False, print_error=False)
        return capsys.readouterr().out

    return run


WALK = ("--from", "{:.7f},{:.7f}".format(*at(50, 4)), "--to", "{:.7f},{:.7f}".format(*at(300, -50)))
SLOTS = ["street,slot,density", f"{LONG},0,{SLOW}", f"{LONG},1,{SLOW}"]


def test_the_command_walks_through_a_table(by_command, tiny, tmp_path) -> None:
    said = by_command(hours(tiny), *WALK, "--depart", NOON)
    assert "departing Saturday 2025-05-24 12:30" in said
    assert "In 1 simulated future: median" in said
    assert "Crowds are those of the table at this hour of the week, whatever the date.\n" in said
    assert "Crowds: table crowds.npz." in said
    for kind in ("geojson", "gpx", "png"):
        assert by_command(hours(tiny), *WALK, "--format", kind, "--out", f"walk.{kind}") == ""
    assert json.loads((tmp_path / "walk.geojson").read_text("utf-8"))["crowds"] == "table crowds.npz"
    assert "departing Saturday 12:00: " in (tmp_path / "walk.gpx").read_text("utf-8")
    assert (tmp_path / "walk.png").read_bytes().startswith(b"\x89PNG")


def test_tables_without_times_begin_with_their_first_slot(by_command, tiny) -> None:
    problem = tabled(tiny, SLOTS)
    said = by_command(problem, *WALK)
    assert "departing as the table begins, if" in said
    assert "Crowds are those of the table from its first slot on.\n" in said
    found = json.loads(by_command(problem, *WALK, "--json"))
    assert (found["departure"], found["hour_of_week"], found["legs"][0]["density"]) == (None, None, pytest.approx(SLOW))
    assert "<time>" not in by_command(problem, *WALK, "--format", "gpx")


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (
            "--depart 2025-05-24T14:00",
            "crowds.npz covers 2 hours from Saturday 12:00 on, but the departure is Saturday 2025-05-24 14:00",
        ),
        ("--depart 2025-05-25T12:30", "but the departure is Sunday 2025-05-25 12:30"),
        ("--depart 30", "--depart must be a local time such as 2025-05-24T12:30, not '30'"),
        (
            f"--depart {NOON} --live now.csv",
            "--live takes counts of sensors, but the crowds of tabled come from a table",
        ),
        ("--live now.csv", "--live takes counts of sensors"),
    ],
)
def test_what_tables_cannot_answer(by_command, tiny, tmp_path, args: str, says: str) -> None:
    live(tmp_path, "2025-05-24T12,5")
    with pytest.raises(SidestepError, match=re.escape(says)) as caught:
        by_command(hours(tiny), *WALK, *args.split())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("depart", [NOON, "30"])
def test_tables_without_times_know_no_departures(by_command, tiny, depart: str) -> None:
    with pytest.raises(SidestepError, match=r"crowds.npz has slots without times, .*; leave out --depart$"):
        by_command(tabled(tiny, SLOTS), "--depart", depart)
