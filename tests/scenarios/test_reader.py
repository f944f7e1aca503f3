"""Scenario files: where every field lands, and on which line what is wrong is said to be."""

import dataclasses
import json
import re
import tomllib
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent import checkpoint
from sidestep.agent.presets import preset_for
from sidestep.agent.train import fresh_network
from sidestep.crowds.counts import TEST, TRAIN
from sidestep.evaluation.compare import compare
from sidestep.files import OutputError
from sidestep.network.formats import load_helsinki, save_town
from sidestep.network.graph import road_network
from sidestep.planners.shortest_path import ShortestPath
from sidestep.scenarios.build import check_ways, crossings
from sidestep.scenarios.builtin import BUILT_IN, changed
from sidestep.scenarios.episodes import anywhere_to_anywhere, destinations_of, instances, sampler
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import Light, ScenarioError, Sensor, Traffic, Venue
from sidestep.scenarios.reader import _FIELDS, _TOP, find_scenario, load_scenario
from sidestep.scenarios.template import new_scenario
from sidestep.scenarios.toml_lines import line_of
from sidestep.walking.objective import Objective

HELSINKI = '[network]\nfile = "helsinki"\n'
TIMED = "[traffic.lights]\nGate = {{ at = {at}, cycle = 60, green = 20, offset = {offset} }}"


@pytest.fixture
def write(tmp_path):
    def make(text: str | bytes, name: str = "scenario.toml") -> Path:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return make


@pytest.fixture
def said(write):
    """The sentence with which a file is refused."""

    def sentence(text: str | bytes) -> str:
        path = write(text)
        with pytest.raises(ScenarioError) as caught:
            load_scenario(path)
        message = str(caught.value)
        assert message.startswith(f"{path}: ")
        assert "\n" not in message
        return message.removeprefix(f"{path}: ")

    return sentence


# --- Where fields land ----------------------------------------------------------------------------------------------


def test_every_field(write, tmp_path) -> None:
    save_town(load_helsinki(), tmp_path / "streets.npz")
    path = write("""\
name = "zoo"
summary = "a zoo on a Sunday"
[network]
file = "streets.npz"
[counts]
file = "auckland"
fitted = ["2024-02-01", 2024-12-01]
tested = [2025-03-10T00:00:00, "2025-06-01T06"]
pairing = 7
places = 1
[sensors]
"45 Queen Street" = [60.17, 24.94]
"59 High Street" = "paired"
[demand]
crowding = 3
reach = 99.5
days = ["sun", "Sat"]
hours = [9, 18]
[walking]
law = "power-capped"
rule = "entry"
horizon_minutes = 90
departures_minutes = [10, 30.5]
slot_minutes = 2.5
[walks]
origins = [17, [60.17, 24.94]]
destinations = [3]
count = 12
[agent]
level = "live"
""")
    found = load_scenario(path)
    venue = Venue(
        streets=str(tmp_path / "streets.npz"),
        counts="auckland",
        sensors=(Sensor("45 Queen Street", (60.17, 24.94)), Sensor("59 High Street")),
        pairing=7,
        crowding=3.0,
        reach=99.5,
        days=(5, 6),
        hours=(9, 18),
        fitted=("2024-02-01", "2024-12-01"),
        tested=("2025-03-10", "2025-06-01T06"),
        origins=(17, (60.17, 24.94)),
        destinations=(3,),
    )
    assert found.venue == venue
    assert found == dataclasses.replace(
        BUILT_IN["helsinki"],
        name="zoo",
        summary="a zoo on a Sunday",
        venue=venue,
        law="power-capped",
        rule="entry",
        horizon=5400.0,
        departures=(600.0, 1830.0),
        slot_seconds=150.0,
        walks=12,
        level="live",
    )


def test_defaults_are_those_of_helsinki_without_the_event(write, tmp_path) -> None:
    found = load_scenario(write(HELSINKI))
    assert found.venue == dataclasses.replace(
        BUILT_IN["helsinki"].venue, crowding=1.0, uneven=0.0, reach=150.0, places=1
    )
    assert (found.venue.fitted, found.venue.tested) == (TRAIN, TEST)
    expected = dataclasses.replace(BUILT_IN["helsinki"], name=tmp_path.name, summary="", venue=found.venue)
    assert found == expected
    assert load_scenario(write(HELSINKI, "park.toml")).name == "park"


def test_the_template_is_helsinki_and_names_every_field(tmp_path) -> None:
    file = new_scenario(tmp_path, "my-town")
    assert file == tmp_path / "my-town" / "scenario.toml"
    found, helsinki = load_scenario(file), BUILT_IN["helsinki"]
    assert (found.name, found.venue) == ("my-town", helsinki.venue)
    assert dataclasses.replace(found, name="helsinki", summary=helsinki.summary) == helsinki
    # Some tables are there to be uncommented.
    whole = re.sub(r'(?m)^# (?=(\[[\w.]+\]|\w+ = .*#.*|\w+ = [\d.]+|"\w+" = {.*)$)', "", file.read_text())
    values = tomllib.loads(whole)
    assert set(values) == {*_TOP, *_FIELDS}
    for table, fields in _FIELDS.items():
        assert table == "sensors" or set(values[table]) == set(fields)
    text = re.sub(r"#.*", "", file.read_text())
    file.write_text(whole)
    found = load_scenario(file)
    light = Light("Kaivokatu", (60.1705, 24.9415), 80.0, 25.0, 10.0)
    assert found.venue == dataclasses.replace(helsinki.venue, traffic=Traffic(lights=(light,)))
    assert found.objective == Objective(exposure=0.5, max_density=4.0)
    ours = re.compile(r'^(crowding|uneven|reach|places) =|= "paired"')
    bare = "\n".join(line for line in text.splitlines() if not ours.search(line))
    # What it says the defaults are, they are.
    file.write_text(bare)
    defaults = load_scenario(file)
    file.write_text(HELSINKI)
    assert dataclasses.replace(defaults, summary="") == load_scenario(file)


def test_an_objective_of_time_alone_is_none(write) -> None:
    assert load_scenario(write(HELSINKI + "[objective]\ntime = 1")).objective is None
    both = load_scenario(write(HELSINKI + "[objective]\ntime = 0\ndistance = 2"))
    assert both.objective == Objective(time=0.0, distance=2.0)
    assert find_scenario("helsinki", objective="time").objective is None
    assert find_scenario("helsinki", objective="exposure=0.5, max_density=4").objective == Objective(
        exposure=0.5, max_density=4.0
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("speed", "objective must be time, distance, exposure, or weights of time, distance, exposure, max_density"),
        ("", "objective must be time, distance, exposure, or weights"),
        ("exposure=x", "objective: exposure must be a number, not 'x'"),
        ("exposure=1,exposure=2", "objective must be"),
        ("time=0", "time or distance needs a weight"),
        ("time=nan", "time must have a weight between 0 and 100, not nan"),
        ("exposure=101", "exposure must have a weight between 0 and 100, not 101"),
        ("max_density=-1", "max_density must be a positive number of persons/m², not -1"),
    ],
)
def test_objectives_that_cannot_be(text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=re.escape(message)):
        find_scenario("helsinki", objective=text)


def test_new_leaves_alone_what_is_there(tmp_path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(OutputError, match="there is there already"):
        new_scenario(tmp_path, "there")
    with pytest.raises(OutputError, match=r"cannot make the folder .*: no such file"):
        new_scenario(tmp_path / "nowhere", "town")
    for name in ("", ".", "..", "a/b", "-x", "a b", "x" * 65, "ä", "a\n"):
        with pytest.raises(ScenarioError, match="a scenario's name is made of letters"):
            new_scenario(tmp_path, name)
    with pytest.raises(ScenarioError, match="rush-16 is the name of a built-in scenario"):
        new_scenario(tmp_path, "rush-16")
    assert [each.name for each in tmp_path.iterdir()] == ["there"]


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
    assert load_scenario(write(f"{HELSINKI}[demand]\ndays = {days}")).venue.days == numbers


# --- Names and files ------------------------------------------------------------------------------------------------


def test_names_and_files(write, monkeypatch) -> None:
    path = write(HELSINKI)
    (path.parent / "plain").write_text(HELSINKI)
    assert find_scenario("rush-16", law="weidmann") == dataclasses.replace(BUILT_IN["rush-16"], law="weidmann")
    assert find_scenario(path, law="power-capped").law == "power-capped"
    monkeypatch.chdir(path.parent)
    assert find_scenario("scenario.toml") == load_scenario(path)
    assert find_scenario("plain").name == "plain"
    for name in ("helsinky", "x\0y", "x" * 5000):
        with pytest.raises(ScenarioError, match=r"unknown scenario .*; or name a file, such as my-town/scenario.toml"):
            find_scenario(name)
    for name in ("no.toml", "no/such", "\0.toml", "y" * 5000 + ".toml"):
        with pytest.raises(ScenarioError, match="cannot read the scenario"):
            find_scenario(name)
    with pytest.raises(ScenarioError, match=r"is a folder; name the file in it, such as .*scenario.toml"):
        find_scenario(path.parent)


def test_changes_that_mean_nothing_are_refused(write) -> None:
    helsinki = find_scenario("helsinki", crowding=2.5)
    assert helsinki.venue == dataclasses.replace(BUILT_IN["helsinki"].venue, crowding=2.5)
    with pytest.raises(ScenarioError, match="rush-16 is no real place where something was counted"):
        find_scenario("rush-16", crowding=2.0)
    with pytest.raises(ScenarioError, match="crowding must be a positive number, not -1"):
        find_scenario("helsinki", crowding=-1.0)
    with pytest.raises(
        ScenarioError, match="helsinki is a real place, not a grid: it has no crowded_nodes and no side"
    ):
        find_scenario("helsinki", side=3, crowded_nodes=1)
    with pytest.raises(ScenarioError, match="not a grid: it has no side"):
        find_scenario(write(HELSINKI), side=3)


# --- What is wrong, and where ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        (" \n\t\n", "the file is empty"),
        (b'a = 1\nb = "\xff"', "line 2: not a text file (UTF-8)"),
        ("x" * 70_000, "more than 64 KiB or 2,000 lines are no scenario"),
        ("\n" * 2_001, "more than 64 KiB or 2,000 lines are no scenario"),
        ("# nothing", 'line 1: network.file is needed: a file of streets, or "helsinki"'),
        ("\n[network]\n", 'line 2: network.file is needed: a file of streets, or "helsinki"'),
        # TOML itself
        ("a = 1\n\nb = ", "line 3: not TOML: invalid value"),
        ("a = [1,\n2\n", "line 2: not TOML: unclosed array"),
        ("a = 1\na = 2", "line 2: not TOML: cannot overwrite a value"),
        ("a = " + "9" * 5000, "not TOML: Exceeds the limit"),
        ("a = " + "[" * 20000, "brackets are nested too deeply"),
        # unknown names
        (HELSINKI + "[walk]\n", "line 3: unknown table or field 'walk'; did you mean walks?"),
        (HELSINKI + "[zoo]\n", "line 3: unknown table or field 'zoo'; there are network, counts, sensors, demand,"),
        ("nmae = 'x'\n" + HELSINKI, "line 1: unknown table or field 'nmae'; did you mean name?"),
        (HELSINKI + "[demand]\n\ncrowd = 2", "line 5: unknown field 'crowd' in [demand]; did you mean crowding?"),
        (HELSINKI + "[agent]\nxyz = 2", "line 4: unknown field 'xyz' in [agent]; there are level"),
        (HELSINKI + '[sensors]\n"Gate" = "paired"', "line 4: sensors.Gate: "),
        (HELSINKI + '[sensors]\n"45 Queen St" = "paired"', "did you mean one of '45 Queen Street'"),
        # wrong kinds
        ("network = 3", "line 1: network must be a table, [network], not 3"),
        ("[[network]]\nfile = 'x'", "line 1: network must be a table, [network], not a list"),
        ("[name]\nx = 1\n" + HELSINKI, "line 1: name must be a value, not a table"),
        ("name = 5\n" + HELSINKI, "line 1: name must be a line of text in quotes, not 5"),
        ("name = ' '\n" + HELSINKI, "line 1: name must be a line of text in quotes, not ' '"),
        ('name = "a\\nb"\n' + HELSINKI, "line 1: name must be a line of text in quotes"),
        ("[network]\nfile = true", "line 2: network.file must be a line of text in quotes, not true"),
        (HELSINKI + "[demand]\nreach = '9'", "line 4: demand.reach must be a number, not '9'"),
        (HELSINKI + "[demand]\nreach = true", "line 4: demand.reach must be a number, not true"),
        (HELSINKI + "[demand]\nreach = 1" + "0" * 400, "line 4: demand.reach must be a smaller number"),
        (HELSINKI + "[counts]\npairing = 1.0", "line 4: counts.pairing must be a whole number, not 1.0"),
        (HELSINKI + "[walks]\ncount = 1.5", "line 4: walks.count must be a whole number, not 1.5"),
        (HELSINKI + "[walks]\norigins = 5", "line 4: walks.origins must be a list of crossings, not 5"),
        (HELSINKI + "[walks]\norigins = [1, 'x']", "walks.origins must be numbers of crossings or [latitude, lon"),
        (HELSINKI + "[walks]\norigins = [true]", "must be numbers of crossings or [latitude, longitude], not true"),
        (HELSINKI + "[demand]\nhours = 10", "line 4: demand.hours must be two hours in brackets, not 10"),
        (HELSINKI + "[demand]\nhours = [10, 20.5]", "line 4: demand.hours must be a whole number, not 20.5"),
        (HELSINKI + "[sensors]\n'45 Queen Street' = 'near'", "line 4: sensor '45 Queen Street' must be [latitude,"),
        (HELSINKI + "[sensors]\na.b = 'paired'", "not a table; a name with a dot in it needs quotes"),
        # values out of range
        (HELSINKI + "[demand]\ncrowding = 0", "line 4: demand.crowding must be a positive number, not 0"),
        (HELSINKI + "[demand]\nreach = nan", "line 4: demand.reach must be a positive number, not nan"),
        (HELSINKI + "[demand]\nhours = [20, 10]", "line 4: demand.hours must be two of 0 to 24 in order"),
        (HELSINKI + "[demand]\ndays = 'Mo-Fr'", "line 4: demand.days must be weekdays, Mon, Tue, Wed"),
        (HELSINKI + "[demand]\ndays = []", "line 4: demand.days must be a list of weekdays, or a span"),
        (HELSINKI + "[demand]\ndays = ['Mon', 'Monday']", "must all be different, but Monday is there twice"),
        (HELSINKI + "[counts]\npairing = -1", "line 4: counts.pairing must be a seed of 0 or more, not -1"),
        (HELSINKI + "[counts]\nfitted = ['2024', '2025']", "line 4: counts.fitted must be days such as 2025-03-10"),
        (HELSINKI + "[counts]\nfitted = [2024-05-01, 2024-05-01]", "must be the first day and the one past the last"),
        (HELSINKI + "[counts]\nfitted = [2024-01-01T00:30:00, 2025-01-01]", "must be days or hours of local wall time"),
        (HELSINKI + "[counts]\nfitted = [2024-01-01T00:00:00Z, 2025-01-01]", "wall time without an offset"),
        (HELSINKI + "[counts]\n#\ntested = [1999-01-01, 1999-03-01]", "line 5: counts.tested: "),
        (
            HELSINKI + "[counts]\nfitted = [2025-01-01, 2025-05-01]\ntested = [2025-04-30T23:00:00, 2025-06-01]",
            "line 5: counts.tested must not overlap fitted, but 2025-04-30T23 to 2025-06-01 and 2025-01-01 to 2025-05",
        ),
        (HELSINKI + "[counts]\nfitted = [2025-01-01, 2025-04-01]", "line 4: counts.fitted: tested must not overlap"),
        (HELSINKI + "[walking]\nlaw = 'aoki'", "line 4: walking.law must be one of power-capped, weidmann, not"),
        (HELSINKI + "[walking]\nrule = 1", "line 4: walking.rule must be one of integrated, entry, not 1"),
        (HELSINKI + "[walking]\nrule = []", "line 4: walking.rule must be one of integrated, entry, not a list"),
        (HELSINKI + "[walking]\nhorizon_minutes = -5", "line 4: walking.horizon_minutes must be a positive number"),
        (HELSINKI + "[walking]\nhorizon_minutes = 1e9", "walking.horizon_minutes makes 200,000,012 slots; at most"),
        (HELSINKI + "[walking]\nhorizon_minutes = 1e300\nslot_minutes = 1e-300", "line 5: walking.slot_minutes"),
        (HELSINKI + "[walking]\nslot_minutes = 5\ndepartures_minutes = [0, 1e6]", "line 5: walking.departures_minutes"),
        (HELSINKI + "[walking]\nslot_minutes = 1e-9", "line 4: walking.slot_minutes makes"),
        (HELSINKI + "[walking]\ndepartures_minutes = [9, 3]", "numbers of minutes in order, from 0 on, not 9 and 3"),
        (HELSINKI + "[counts]\nplaces = 0", "line 4: counts.places must be between 1 and 100, not 0"),
        (HELSINKI + "[counts]\nplaces = 2\n[sensors]\n'45 Queen Street' = [60.17, 24.94]", "counts.places must be 1"),
        (HELSINKI + "[walks]\ncount = 0", "line 4: walks.count must be between 1 and 1,000,000, not 0"),
        (HELSINKI + "[walks]\norigins = [1, 1]", "line 4: walks.origins must all be different, but 1 is"),
        (HELSINKI + "[walks]\norigins = [-1]", "origins must be crossings, numbered from 0, not -1"),
        (HELSINKI + "[walks]\norigins = [[99, 24.9]]", "origins must be degrees of latitude (-90 to 90), then"),
        (HELSINKI + "[walks]\norigins = [1000000]", "there is no crossing 1000000; they are numbered 0 to"),
        (HELSINKI + "[walks]\ndestinations = [[48.2, 16.4]]", "line 4: walks.destinations: 48.2, 16.4"),
        (HELSINKI + "[walks]\norigins = [5]\ndestinations = [5]", "line 5: walks.destinations: crossing 5 is the only"),
        (HELSINKI + "[agent]\nlevel = 'position'", "line 4: agent.level must be one of local, map, live, not 'posi"),
        (HELSINKI + "[traffic]\ncycle = 60\ngreen = 61", "line 5: traffic.green must be seconds of the 60 of a"),
        (HELSINKI + "[traffic]\ncycle = 20", "line 3: traffic: green must be seconds of the 20 of a"),
        (HELSINKI + "[traffic]\nvehicles = 1e9", "line 4: traffic.vehicles must be between 0 and 1,800 an"),
        (HELSINKI + "[traffic]\ncritical_gap = 0", "line 4: traffic.critical_gap must be seconds above 0"),
        (HELSINKI + "[traffic]\ncycle = nan", "line 4: traffic.cycle must be seconds above 0 and up to 600, not nan"),
        (HELSINKI + "[traffic]\nseed = -1", "line 4: traffic.seed must be a seed of 0 or more, not -1"),
        (HELSINKI + "[traffic]\nlights = 3", "line 4: traffic.lights must be a table, [traffic.lights], not 3"),
        (HELSINKI + "[traffic.lights]\na = 3", "line 3: traffic.lights 'a' must be { at = […, …], cycle = …, green"),
        (HELSINKI + TIMED.format(at=0, offset=9), "traffic.lights 'Gate': must be two numbers of degrees in brackets"),
        (HELSINKI + TIMED.format(at=[60.17, 24.94], offset=60), "'Gate': offset must be seconds of the 60 of a cycle"),
        (HELSINKI + TIMED.format(at=[48.2, 16.4], offset=9), "traffic.lights: light 'Gate': 48.2, 16.4"),
        (HELSINKI + "[objective]\nexposure = -1", "line 4: objective.exposure must have a weight between 0"),
        (HELSINKI + "[objective]\ntime = 0", "line 4: objective.time or distance needs a weight"),
        (HELSINKI + "[objective]\ntime = '1'", "line 4: objective.time must be a number, not '1'"),
        (HELSINKI + "[objective]\nmax_density = 0", "line 4: objective.max_density must be a positive number"),
        (HELSINKI + "[objective]\nsafety = 1", "line 4: unknown field 'safety' in [objective]; there are time"),
        (HELSINKI + "[sensors]\n'45 Queen Street' = [24.94, 60.17]", "line 4: sensors.45 Queen Street: sensor"),
        (HELSINKI + "[sensors]\n'45 Queen Street' = [240, 60.17]", "240, 60.17 is no place"),
        # files
        ("[network]\nfile = 'no.npz'", "line 2: network.file: there is no file /"),
        ("[network]\nfile = '.'", "is a folder, not a file"),
        ("[network]\nfile = 'scenario.toml'", "scenario.toml names no format for streets"),
        ('[network]\nfile = "a\\u0000b"', "line 2: network.file must be a line of text"),
        ("[network]\nfile = '" + "n" * 5000 + "'", "line 2: network.file: there is no file"),
        (HELSINKI + "[counts]\nfile = 'no.csv'", "line 4: counts.file: there is no file /"),
        (HELSINKI + "[counts]\nfile = 'scenario.toml'", "line 4: counts.file: "),
    ],
)  # fmt: skip
def test_what_is_wrong_and_where(said, text: str | bytes, message: str) -> None:
    assert message in said(text)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("\n\nnetwork.file = 'helsinki'\n\ndemand.reach = -1\n", 5),
        ("network = {file = 'helsinki'}\ndemand = {crowding = 2,  reach = -1}", 2),
        ("[network]\nfile='helsinki'\n[ 'demand' ] # [\n#reach = 1\n\"reach\" = -1", 5),
        ("network.file='helsinki'\nwalks.origins = [ # [\n  1,\n\n  [60.17, 24.94],\n]\n[demand]\nreach = -1\n", 8),
        ('summary = """\n[demand]\nreach = 2"""\n[network]\nfile="helsinki"\n[demand]\nreach = -1', 1),
        ("network.file='helsinki'\r\n\r\n[demand]\r\n  reach\t=-1\r\n", 4),
        ("\ufeffnetwork.file='helsinki'\n[demand]\nreach = -1", 3),
        ("[demand]\ncrowding = 3\nreach = -1\n[network]\nfile = 'helsinki'\n[walks]\norigins = [1]", 3),
    ],
)
def test_lines_counted_by_hand(said, text: str, line: int) -> None:
    assert said(text).startswith(f"line {line}: ")


def test_where_a_list_stands_that_goes_over_lines(said) -> None:
    text = "network.file='helsinki'\n[walks]\n\norigins = [\n  1,\n  [60.17, 24.94],\n  [0, 0],\n]\ncount = 3\n"
    assert said(text).startswith("line 4: walks.origins: 0, 0 is")


def test_lines_of_deep_and_long_documents() -> None:
    deep = ".".join("a" * 300)
    assert line_of(f"x = 1\n[{deep}]\ny = 1\n", ("a",)) == 2
    assert line_of("x = 1\n[[a.b]]\nc = 1\n[[a.b]]\n", ("a", "b")) == 2
    long = "a = [\n" + "[1, 2],\n" * 1900 + "]\nb = 1\n"
    assert line_of(long, ("b",)) == 1903
    assert line_of("a = 1", ("b", "c")) == 1


def test_a_file_of_ones_own_counts_needs_its_own_days(said, tmp_path) -> None:
    hours = np.arange(np.datetime64("2030-01-01T00"), np.datetime64("2030-01-03T00"))
    (tmp_path / "counts.csv").write_text("time,Gate\n" + "\n".join(f"{hour},5" for hour in hours))
    sentence = said(HELSINKI + "[counts]\nfile = 'counts.csv'")
    assert sentence.startswith("line 3: counts.fitted: ")
    assert "counts run from 2030-01-01T00 to 2030-01-02T23" in sentence
    assert "give counts.fitted, since the default days are Auckland's" in sentence


# --- Origins and destinations ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def somewhere():
    """Helsinki with three origins and two destinations, one of them an origin too."""
    helsinki = BUILT_IN["helsinki"]
    venue = dataclasses.replace(
        helsinki.venue, places=1, sensors=helsinki.venue.sensors[:2], origins=(5, 17, 200), destinations=(17, 300)
    )
    scenario = dataclasses.replace(helsinki, venue=venue, horizon=1800.0, departures=(0.0, 0.0))
    return scenario, draw_map(scenario, 0)


def test_walks_begin_and_end_where_the_venue_says(somewhere) -> None:
    scenario, place = somewhere
    assert (place.origins, place.ends) == ((5, 17, 200), (17, 300))
    destinations = anywhere_to_anywhere(place, 50, 0)
    assert sorted(destinations.ravel().tolist()) == [17, 300]
    params = make_environment(scenario, place, "test", 60)
    walks = instances(scenario, place, params, 60, destinations=destinations)
    pairs = set(zip(walks.origin.tolist(), walks.destination.tolist(), strict=True))
    assert pairs == {(5, 17), (200, 17), (5, 300), (17, 300), (200, 300)}
    assert walks.destination.tolist()[:4] == destinations.ravel().tolist() * 2
    draws = jnp.asarray(np.random.default_rng(0).random((300, 4)), jnp.float32)
    for anywhere in (True, False):
        drawn = jax.vmap(sampler(scenario, place, params, 60, destinations=destinations, anywhere=anywhere).sample)(
            draws
        )
        assert set(zip(drawn.origin.tolist(), drawn.destination.tolist(), strict=True)) == pairs
    # without being told where, they do not go from corner to corner either
    alone = instances(scenario, place, params, 20)
    assert set(alone.origin.tolist()) <= {5, 17, 200}
    assert len(set(alone.destination.tolist()) & {17, 300}) == 1


def test_goals_to_learn_and_to_compare(somewhere) -> None:
    scenario, place = somewhere
    assert sorted(destinations_of(place, 2).ravel().tolist()) == [17, 300]
    assert destinations_of(place, 1).tolist() == destinations_of(place, 2)[:1].tolist()
    with pytest.raises(ScenarioError, match="between 1 and 2 destinations, not 3"):
        destinations_of(place, 3)
    config = preset_for(scenario, "default")
    assert (config.destinations, config.futures, config.fresh_futures) == (2, 64, 32)
    venue = dataclasses.replace(scenario.venue, destinations=(1, 2, 3))
    for level in ("local", "map", "live"):
        config = preset_for(dataclasses.replace(scenario, venue=venue), "default", level)
        # at level live they are not renewed
        futures, fresh = (90, 0) if level == "live" else (60, 30)
        assert (config.destinations, config.futures, config.fresh_futures) == (3, futures, fresh)
    assert preset_for(BUILT_IN["helsinki"], "default").destinations == 32


def test_the_only_origin_is_nobodys_destination(somewhere) -> None:
    _, place = somewhere
    lone = dataclasses.replace(place, origins=(17,), ends=())
    nodes = place.network.nodes
    everywhere = destinations_of(lone, nodes - 2).ravel().tolist()
    assert len(set(everywhere)) == nodes - 2
    assert 17 not in everywhere
    assert 17 not in anywhere_to_anywhere(lone, nodes - 1, 0)


def test_a_comparison_walks_between_the_venues_places(somewhere) -> None:
    scenario, _ = somewhere
    walked = compare(scenario, {"shortest-path": lambda *_: ShortestPath()}, maps=[0], walks=5).records["shortest-path"]
    assert walked.minutes.shape == (1, 5)
    assert (walked.minutes > 0).all()


def test_places_are_taken_to_the_nearest_crossing() -> None:
    town = load_helsinki()
    longitude, latitude = town.place[321].tolist()
    assert crossings(town, "origins", (4, (latitude, longitude))) == (4, 321)
    with pytest.raises(ScenarioError, match=r"must all be different, but 321 and \(.*\) are both crossing 321"):
        crossings(town, "origins", (321, (latitude, longitude)))


def one_way(*ways: tuple[int, int]):
    nodes = 1 + max(max(way) for way in ways)
    place = np.stack([np.arange(nodes), np.zeros(nodes)], axis=1)
    return road_network(place, [a for a, _ in ways], [b for _, b in ways], [1.0] * len(ways))


def test_ways_there_are_not() -> None:
    ring, sink = one_way((0, 1), (1, 2), (2, 0)), one_way((0, 1), (1, 0), (1, 2))
    check_ways(ring, (), ())
    check_ways(ring, (0,), (2, 1))
    with pytest.raises(ScenarioError, match="crossing 1 is the only origin"):
        check_ways(ring, (1,), (2, 1))
    check_ways(sink, (0,), (2,))
    # Who walks from 0 to 1 may stray to 2, from where nothing leads on.
    for origins, ends, message in (
        ((0,), (1,), "from crossing 2 to crossing 1"),
        ((), (0,), "from crossing 2 to crossing 0"),
        ((), (), "from crossing 2 to crossing 0"),
        ((0,), (), "from crossing 2 to crossing 0"),
    ):
        with pytest.raises(ScenarioError, match=message):
            check_ways(sink, origins, ends)
    islands = one_way((0, 1), (1, 0), (2, 3), (3, 2))
    check_ways(islands, (0,), (1,))
    with pytest.raises(ScenarioError, match="from crossing 0 to crossing 3"):
        check_ways(islands, (0,), (3,))
    with pytest.raises(ScenarioError, match="from crossing 0 to crossing 2"):
        check_ways(islands, (0, 1), ())


# --- Models of scenario files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BUILT_IN)
def test_scenarios_come_back_from_json(name: str) -> None:
    one = BUILT_IN[name]
    if one.venue is not None:
        sensors = (Sensor("a", (1.0, 2.0)), Sensor("b"))
        one = changed(one, venue=dataclasses.replace(one.venue, sensors=sensors, places=1, origins=(3, (60.0, 25.0))))
    assert checkpoint._revived(type(one), json.loads(json.dumps(dataclasses.asdict(one)))) == one


def test_what_cannot_be_revived() -> None:
    fields = dataclasses.asdict(BUILT_IN["helsinki"])
    for damage in ({"colour": "red"}, {"departures": [1.0]}, {"name": {"x": 1}}, {"horizon": [1]}):
        with pytest.raises((TypeError, ValueError)):
            checkpoint._revived(type(BUILT_IN["helsinki"]), fields | damage)


def test_a_model_needs_no_scenario_file_to_walk_elsewhere(tmp_path) -> None:
    venue = Venue(streets=str(tmp_path / "gone.npz"), counts=str(tmp_path / "gone.csv"), destinations=(3, (60.0, 25.0)))
    scenario = dataclasses.replace(BUILT_IN["helsinki"], venue=venue, horizon=600.0)
    config = dataclasses.replace(preset_for(BUILT_IN["helsinki"], "default"), hidden=(4,))
    network = fresh_network(config, scenario, one_way((0, 1), (1, 0)), jax.random.key(0))
    header = {
        "format": checkpoint.FORMAT,
        "scenario": dataclasses.asdict(scenario),
        "seed": 0,
        "index": 0,
        "config": dataclasses.asdict(config),
        "curve": [],
        "fingerprint": "",
    }
    with (tmp_path / checkpoint.MODEL).open("wb") as file:
        file.write(json.dumps(header).encode() + b"\n")
        eqx.tree_serialise_leaves(file, network)
    model = checkpoint.load_model(tmp_path)
    assert (model.scenario, model.config) == (scenario, config)
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), model.network, network))
