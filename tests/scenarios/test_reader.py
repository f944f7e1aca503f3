"""Scenario files: where every field lands, and on which line mistakes are said to be."""

from pathlib import Path

import numpy as np
import pytest

from sidestep.crowds.counts import TEST, TRAIN
from sidestep.network.formats import load_helsinki, save_town
from sidestep.scenarios.builtin import BUILT_IN
from sidestep.scenarios.model import ObjectiveSpec, RewardSpec
from sidestep.scenarios.places import Counters, CrowdTable, Sensor, Traffic, Venue
from sidestep.scenarios.reader import find_scenario, load_scenario
from sidestep.scenarios.spec import ScenarioError

HELSINKI = '[place]\nstreets = "helsinki"\n'
SOURCE = HELSINKI + "[place.crowd_source]\n"
SENSORS = HELSINKI + "[place.crowd_source.sensors]\n"
FILES = Path(__file__).parent / "files"


@pytest.fixture
def write(tmp_path):
    def make(text: str | bytes, name: str = "scenario.toml") -> Path:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return make


@pytest.fixture
def refused(write):
    """The mistakes of a file: the error, and lines and fields of all."""

    def mistakes(text: str | bytes) -> tuple[ScenarioError, list[tuple[int | None, str | None]]]:
        path = write(text)
        with pytest.raises(ScenarioError) as caught:
            load_scenario(path)
        every = (caught.value, *caught.value.others)
        for error in every:
            where = f"{path}: " if error.line is None else f"{path}: line {error.line}: "
            assert str(error).startswith(where)
            assert "\n" not in str(error)
        return caught.value, [(error.line, error.field) for error in every]

    return mistakes


# --- Where fields land ----------------------------------------------------------------------------------------------


def test_every_field(write, tmp_path) -> None:
    save_town(load_helsinki(), tmp_path / "streets.npz")
    path = write("""\
name = "zoo"
summary = "a zoo on a Sunday"
law = "power-capped"
rule = "entry"
flows = "forecast"
horizon_minutes = 90
departures_minutes = [10, 30.5]
slot_minutes = 2.5
level = "live"
maps = 2
walks = 12
[place]
streets = "streets.npz"
crowding = 3
days = ["sun", "Sat"]
hours = [9, 18]
origins = [17, [60.17, 24.94]]
destinations = [3]
[place.crowd_source]
kind = "counters"
file = "auckland"
fitted = ["2024-02-01", 2024-12-01]
tested = [2025-03-10T00:00:00, "2025-06-01T06"]
pairing = 7
streets_per_sensor = 1
uneven = 0.25
reach = 99.5
[place.crowd_source.sensors]
"45 Queen Street" = [60.17, 24.94]
"59 High Street" = "paired"
[place.traffic]
cycle = 80
[objective]
time = 0
distance = 2
[reward]
bonus = 1
progress = 0.5
""")
    found = load_scenario(path)
    venue = Venue(
        streets=str(tmp_path / "streets.npz"),
        crowd_source=Counters(
            sensors=(Sensor(name="45 Queen Street", place=(60.17, 24.94)), Sensor(name="59 High Street")),
            pairing=7,
            uneven=0.25,
            reach=99.5,
            fitted=("2024-02-01", "2024-12-01"),
            tested=("2025-03-10", "2025-06-01T06"),
        ),
        crowding=3.0,
        days=(5, 6),
        hours=(9, 18),
        origins=(17, (60.17, 24.94)),
        destinations=(3,),
        traffic=Traffic(cycle=80.0),
    )
    assert found.place == venue
    assert found == BUILT_IN["helsinki"].changed(
        name="zoo",
        summary="a zoo on a Sunday",
        place=venue,
        law="power-capped",
        rule="entry",
        flows="forecast",
        horizon=5400.0,
        departures=(600.0, 1830.0),
        slot_seconds=150.0,
        maps=2,
        walks=12,
        level="live",
        objective=ObjectiveSpec(time=0.0, distance=2.0),
        reward=RewardSpec(bonus=1.0, progress=0.5),
    )


def test_defaults_are_those_of_helsinki_without_the_event(write, tmp_path) -> None:
    found = load_scenario(write(HELSINKI))
    ordinary = dict(crowding=1.0, uneven=0.0, reach=150.0, streets_per_sensor=1)
    assert found == BUILT_IN["helsinki"].changed(name=tmp_path.name, summary="", **ordinary)
    assert (found.place.crowd_source.fitted, found.place.crowd_source.tested) == (TRAIN, TEST)
    assert load_scenario(write(HELSINKI, "park.toml")).name == "park"
    assert load_scenario(write(HELSINKI + "[objective]\ntime = 1")).objective.is_time
    assert load_scenario(write(HELSINKI + "[reward]\nunit_seconds = 30")).reward == RewardSpec(
        unit_seconds=30.0, progress=0.0, bonus=0.0
    )


@pytest.mark.parametrize(
    ("days", "numbers"),
    [
        ('"Mon-Sun"', (0, 1, 2, 3, 4, 5, 6)),
        ('"mon - fri"', (0, 1, 2, 3, 4)),
        ('"Fri-Mon"', (0, 4, 5, 6)),
        ('"Sat"', (5,)),
        ('["Wednesday", "TUE"]', (1, 2)),
    ],
)
def test_days(write, days: str, numbers: tuple) -> None:
    assert load_scenario(write(f"{HELSINKI}days = {days}")).place.days == numbers


def test_lights_by_name(write) -> None:
    gate = "Gate = { place = [60.17, 24.94], cycle = 60, green = 20, offset = 5 }"
    (light,) = load_scenario(write(f"{HELSINKI}[place.traffic.lights]\n{gate}")).place.traffic.lights
    assert (light.name, light.place, light.cycle, light.green, light.offset) == ("Gate", (60.17, 24.94), 60, 20, 5)


# --- Names and files ------------------------------------------------------------------------------------------------


def test_names_and_files(write, monkeypatch) -> None:
    path = write(HELSINKI)
    (path.parent / "plain").write_text(HELSINKI)
    assert find_scenario("rush-16", law="weidmann") == BUILT_IN["rush-16"].changed(law="weidmann")
    assert find_scenario(path, law="power-capped").law == "power-capped"
    monkeypatch.chdir(path.parent)
    assert find_scenario("scenario.toml") == load_scenario(path)
    assert find_scenario("plain").name == "plain"
    for name in ("helsinky", "x\0y", "x" * 5000):
        with pytest.raises(ScenarioError, match=r"unknown scenario .* or a file such as my-town/scenario.toml"):
            find_scenario(name)
    with pytest.raises(ScenarioError) as caught:
        find_scenario("\0.toml")
    assert caught.value.field == "path"
    for name in ("no.toml", "no/such", "y" * 5000 + ".toml"):
        with pytest.raises(ScenarioError, match="cannot read the scenario"):
            find_scenario(name)
    with pytest.raises(ScenarioError, match=r"is a folder; name the file in it, such as .*scenario.toml"):
        find_scenario(path.parent)


def test_changes_by_options(write) -> None:
    assert find_scenario("helsinki", crowding=2.5) == BUILT_IN["helsinki"].changed(crowding=2.5)
    exposed = find_scenario("rush-16", objective="exposure=0.5", side=3, crowded_nodes=1)
    assert (exposed.objective, exposed.place.side) == (ObjectiveSpec(exposure=0.5), 3)
    for name, changes, field in (
        ("rush-16", dict(crowding=2.0), "crowding"),
        ("helsinki", dict(crowding=-1.0), "crowding"),
        ("helsinki", dict(side=3), "side"),
        (write(HELSINKI), dict(crowded_nodes=3), "crowded_nodes"),
        ("helsinki", dict(objective="exposure=-1"), "exposure"),
    ):
        with pytest.raises(ScenarioError) as caught:
            find_scenario(name, **changes)
        assert caught.value.field == field


# --- What is wrong, and where ---------------------------------------------------------------------------------------


def test_a_file_full_of_mistakes() -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(FILES / "mistakes.toml")
    found = [f"{error.line} {error.field}" for error in (caught.value, *caught.value.others)]
    assert sorted(found) == sorted((FILES / "mistakes.txt").read_text().splitlines())
    assert f"({len(found) - 1} more mistakes in this file)" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", None),
        (" \n\t\n", None),
        (b'a = 1\nb = "\xff"', 2),
        ("x" * 70_000, None),
        ("\n" * 2_001, None),
        ("a = 1\n\nb = ", 3),
        ("a = [1,\n2\n", 2),
        ("a = 1\na = 2", 2),
        ("a = " + "9" * 5000, None),
        ("a = " + "[" * 20000, None),
    ],
)
def test_what_is_no_toml(refused, text: str | bytes, line: int | None) -> None:
    assert refused(text)[1] == [(line, None)]


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("# nothing", [(1, "place")]),
        ("\n[place]\n", [(2, "place.streets")]),
        ("place = 3", [(1, "place")]),
        ("[[place]]\nstreets = 'x'", [(1, "place")]),
        ("[place]\nstreets = true", [(2, "place.streets")]),
        ('[place]\nstreets = "a\\u0000b"', [(2, "place.streets")]),
        (HELSINKI + "hours = 10", [(3, "place.hours")]),
        (HELSINKI + "hours = [10]", [(3, "place.hours")]),
        (HELSINKI + "hours = [10, 20.5]", [(3, "place.hours")]),
        (HELSINKI + "days = []", [(3, "place.days")]),
        (HELSINKI + "days = ['Mon', 'Monday']", [(3, "place.days")]),
        (HELSINKI + "crowding = 1" + "0" * 400, [(3, "place.crowding")]),
        (HELSINKI + "origins = [true]", [(3, "place.origins")]),
        (HELSINKI + "origins = [1, 1]", [(3, "place.origins")]),
        (SOURCE + "kind = 'zoo'", [(4, "place.crowd_source.kind")]),
        (SOURCE + "fitted = [2024-05-01, 2024-05-01]", [(4, "place.crowd_source.fitted")]),
        (SOURCE + "fitted = [2024-01-01T00:00:00Z, 2025-01-01]", [(4, "place.crowd_source.fitted")]),
        (SOURCE + "fitted = [07:00:00, 2025-01-01]", [(4, "place.crowd_source.fitted")]),
        # A default that does not go with what the file says: the nearest line there is.
        (SOURCE + "fitted = [2025-01-01, 2025-04-01]", [(3, "place.crowd_source.tested")]),
        (HELSINKI + "[place.traffic]\ncycle = 20", [(3, "place.traffic.green")]),
        (HELSINKI + "[objective]\ntime = 0", [(3, "objective")]),
        ("horizon_minutes = 1e9\n" + HELSINKI, [(1, "slot_minutes")]),
        ("horizon_minutes = 1e300\nslot_minutes = 1e-300\n" + HELSINKI, [(2, "slot_minutes")]),
        ("horizon = 30\n" + HELSINKI, [(1, "horizon")]),
        (
            SOURCE + "streets_per_sensor = 2\n[place.crowd_source.sensors]\n'45 Queen Street' = [60.17, 24.94]",
            [(4, "place.crowd_source.streets_per_sensor")],
        ),
        (SOURCE + "kind = 'crowd_table'", [(3, "place.crowd_source.file")]),
        (
            SOURCE + "kind = 'crowd_table'\nfile = 'no.npz'\nreach = 3\nnoise = [1, 0]",
            [(5, "place.crowd_source.file"), (6, "place.crowd_source.reach"), (7, "place.crowd_source.noise")],
        ),
        ("[place]\nstreets = 'no.npz'", [(2, "place.streets")]),
        ("[place]\nstreets = '.'", [(2, "place.streets")]),
        ("[place]\nstreets = '" + "n" * 5000 + "'", [(2, "place.streets")]),
    ],
)
def test_what_is_wrong_with_values(refused, text: str, places: list) -> None:
    assert refused(text)[1] == places


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("[place]\nstreets = 'scenario.toml'", [(2, "place.streets")]),
        (SOURCE + "file = 'scenario.toml'", [(4, "place.crowd_source.file")]),
        (SOURCE + "kind = 'crowd_table'\nfile = 'scenario.toml'", [(5, "place.crowd_source.file")]),
        (SOURCE + "#\ntested = [1999-01-01, 1999-03-01]", [(5, "place.crowd_source.tested")]),
        (
            SENSORS + "'Gate' = 'paired'\n'45 Queen Street' = [24.94, 60.17]\n'45 Queen St' = 'paired'",
            [
                (4, "place.crowd_source.sensors.Gate"),
                (5, "place.crowd_source.sensors.45 Queen Street"),
                (6, "place.crowd_source.sensors.45 Queen St"),
            ],
        ),
        (HELSINKI + "origins = [1000000]", [(3, "place.origins")]),
        (
            HELSINKI + "origins = [3, 1000000]\ndestinations = [[48.2, 16.4]]",
            [(3, "place.origins"), (4, "place.destinations")],
        ),
        (HELSINKI + "origins = [5]\ndestinations = [5]", [(4, "place.destinations")]),
        (
            HELSINKI + "[place.traffic.lights]\nA = { place = [48.2, 16.4], cycle = 60, green = 20, offset = 0 }",
            [(4, "place.traffic.lights.A")],
        ),
    ],
)
def test_what_is_wrong_with_the_files_that_are_named(refused, text: str, places: list) -> None:
    assert refused(text)[1] == places


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        (HELSINKI + "[placc]\n", "did you mean place?"),
        ("nmae = 'x'\n" + HELSINKI, "did you mean name?"),
        ("horizon_minute = 3\n" + HELSINKI, "did you mean horizon_minutes?"),
        (HELSINKI + "crowd = 2", "did you mean crowding?"),
        (SOURCE + "reahc = 2", "did you mean reach?"),
        (HELSINKI + "[objective]\nsafety = 1", "choose from time, distance, exposure, max_density or"),
        (SENSORS + "'45 Queen St' = 'paired'", "did you mean '45 Queen Street'"),
        (SENSORS + "a.b = 'paired'", "a name with a dot in it needs quotes"),
        ("[place]\nstreets = 'helsinky'", 'or "helsinki"'),
    ],
)
def test_hints(refused, text: str, hint: str) -> None:
    assert hint in str(refused(text)[0])


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("\n\nplace.streets = 'helsinki'\n\nplace.crowding = -1\n", 5),
        ("place = {streets = 'helsinki',  crowding = -1}\nobjective = {time = 2}", 1),
        ("[place]\nstreets='helsinki'\n[ 'place' . crowd_source ] # [\n#reach = 1\n\"reach\" = -1", 5),
        ("place.streets='helsinki'\nplace.origins = [ # [\n  1,\n\n  [60.17, 24.94],\n]\n[objective]\ntime = -1\n", 8),
        ('summary = """\n[place]\ncrowding = 2"""\n[place]\nstreets="helsinki"\ncrowding = -1', 1),
        ("place.streets='helsinki'\r\n\r\n[objective]\r\n  time\t=-1\r\n", 4),
        ("\ufeffplace.streets='helsinki'\n[objective]\ntime = -1", 3),
    ],
)
def test_lines_counted_by_hand(refused, text: str, line: int) -> None:
    assert refused(text)[0].line == line


def test_where_a_list_stands_that_goes_over_lines(refused) -> None:
    text = "walks = 3\n[place]\nstreets = 'helsinki'\norigins = [\n  1,\n  [60.17, 24.94],\n  [0, 0],\n]\n"
    assert refused(text)[1] == [(4, "place.origins")]


def test_a_file_of_ones_own_counts_needs_its_own_days(refused, tmp_path) -> None:
    hours = np.arange(np.datetime64("2030-01-01T00"), np.datetime64("2030-01-03T00"))
    (tmp_path / "counts.csv").write_text("time,Gate\n" + "\n".join(f"{hour},5" for hour in hours))
    error, places = refused(SOURCE + "file = 'counts.csv'")
    assert places == [(3, "place.crowd_source.fitted"), (3, "place.crowd_source.tested")]
    assert "counts run from 2030-01-01T00 to 2030-01-02T23" in str(error)


def test_tables_have_their_own_kind(write, tmp_path) -> None:
    assert CrowdTable(file="x.npz").kind == "crowd_table"
    (tmp_path / "crowds.npz").write_bytes(b"damaged")
    path = write(SOURCE + "kind = 'crowd_table'\nfile = 'crowds.npz'")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    assert (caught.value.line, caught.value.field) == (5, "place.crowd_source.file")
