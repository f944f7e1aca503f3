"""The file that `sidestep new` makes."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from sidestep.crowds.layouts import COLUMNS, Layout
from sidestep.files import OutputError
from sidestep.scenarios.builtin import BUILT_IN
from sidestep.scenarios.model import ObjectiveSpec, RewardSpec
from sidestep.scenarios.places import CountColumns, Light, Traffic
from sidestep.scenarios.reader import CountersFile, CrowdTableFile, ScenarioFile, TrafficFile, VenueFile, load_scenario
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.template import Beginning, new_scenario
from sidestep.scenarios.walkers import WALKERS, Custom

# Some tables are there to be uncommented.
COMMENTED = re.compile(r'(?m)^# (?=(\[[\w.]+\]|\w+ = .*#.*|\w+ = [\d.]+|\w+ = "\w+[\w.]*"|"\w+" = {.*)$)')


@pytest.fixture
def made(tmp_path) -> Path:
    return new_scenario(tmp_path, "my-town")


def test_it_is_an_ordinary_day_in_helsinki(made, tmp_path) -> None:
    assert made == tmp_path / "my-town" / "scenario.toml"
    found, helsinki = load_scenario(made), BUILT_IN["helsinki"]
    assert (found.name, found.place.crowding) == ("my-town", 1)
    event = dict(crowding=120.0, uneven=0.5, reach=40.0, streets_per_sensor=10)
    assert found.changed(name="helsinki", summary=helsinki.summary, **event) == helsinki
    # The file says so itself, and what is synthetic.
    text = made.read_text()
    for value in ("crowding = 120", "uneven = 0.5", "reach = 40", "streets_per_sensor = 10", "INVENTED", "SYNTHETIC"):
        assert value in text


def test_its_values_are_the_defaults(made) -> None:
    found = load_scenario(made)
    made.write_text('[place]\nstreets = "helsinki"\n')
    assert load_scenario(made) == found.changed(summary="")


def test_it_names_every_field(made) -> None:
    table = made.read_text().split("# [place.crowd_source]")
    whole = COMMENTED.sub("", table[0] + table[1].partition("\n\n")[2])
    values = tomllib.loads(whole)

    def fields(kind, *others: str) -> set[str]:
        return {field.alias or name for name, field in kind.model_fields.items()} - set(others)

    assert set(values) == fields(ScenarioFile)
    place = values["place"]
    assert set(place) == fields(VenueFile, "kind")
    assert set(place["crowd_source"]) == fields(CountersFile)
    assert set(place["crowd_source"]["columns"]) == fields(CountColumns)
    assert set(place["traffic"]) == fields(TrafficFile)
    assert set(place["traffic"]["lights"]["Kaivokatu"]) == fields(Light, "name")
    assert set(values["objective"]) == fields(ObjectiveSpec)
    assert set(values["reward"]) == fields(RewardSpec)
    assert set(values["walker"]) == fields(Custom)
    commented = COMMENTED.sub("", table[1].partition("\n\n")[0])
    assert set(tomllib.loads(commented)) == fields(CrowdTableFile)
    # And what is commented out may be said.
    made.write_text(whole)
    found = load_scenario(made)
    light = Light(name="Kaivokatu", place=(60.1705, 24.9415), cycle=80.0, green=25.0, offset=10.0)
    assert found.place.traffic == Traffic(lights=(light,))
    assert found.objective == ObjectiveSpec(exposure=0.5, max_density=4.0)
    assert found.reward == BUILT_IN["helsinki"].reward
    numbers = dict(free_speed=1.2, stairs_up=0.5, stairs_down=0.6, highest_kerb=0.2, steepest=0.2)
    assert found.walker == Custom(law="weidmann", **numbers)


def test_the_page_names_every_field() -> None:
    page = (Path(__file__).parents[2] / "docs" / "scenarios.md").read_text("utf-8")
    for kind in (
        ScenarioFile,
        VenueFile,
        CountersFile,
        CountColumns,
        CrowdTableFile,
        Traffic,
        ObjectiveSpec,
        RewardSpec,
    ):
        for name, field in kind.model_fields.items():
            assert re.search(rf"[`.\[]{field.alias or name}\b", page), name
    page = (Path(__file__).parents[2] / "docs" / "walkers.md").read_text("utf-8")
    for name in (*Custom.model_fields, *WALKERS):
        assert f"`{name}`" in page, name


def test_what_counts_do_not_say_is_in_the_file(tmp_path) -> None:
    said = Layout(
        time='The "time"', sensor="Wo", count=("In", "Out"), latitude="y", longitude="x", date_format="%d.%m.%y %H",
        decimal=",", timezone="Europe/Berlin",
    )  # fmt: skip
    (tmp_path / "c.csv").write_text("")
    beginning = Beginning(counts=str(tmp_path / "c.csv"), layout=said, timezone=said.timezone)
    found = tomllib.loads(new_scenario(tmp_path, "town", beginning).read_text("utf-8"))["place"]
    source = found["crowd_source"]
    assert (source["date_format"], source["decimal"], found["timezone"]) == ("%d.%m.%y %H", ",", "Europe/Berlin")
    assert source["columns"] == {
        "time": 'The "time"', "sensor": "Wo", "count": ["In", "Out"], "latitude": "y", "longitude": "x",
    }  # fmt: skip
    beginning = Beginning(
        counts=beginning.counts, layout=replace(said, date="D", hour="H", direction="To", ignore=("Rain",))
    )
    found = tomllib.loads(new_scenario(tmp_path, "every", beginning).read_text("utf-8"))["place"]["crowd_source"]
    assert found["columns"].keys() == set(COLUMNS)


def test_what_is_there_is_left_alone(tmp_path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(OutputError, match="there exists already"):
        new_scenario(tmp_path, "there")
    with pytest.raises(OutputError, match=r"cannot make the folder .*: no such file"):
        new_scenario(tmp_path / "nowhere", "town")
    for name in ("", ".", "..", "a/b", "-x", "a b", "x" * 65, "ä", "a\n", "rush-16"):
        with pytest.raises(ScenarioError) as caught:
            new_scenario(tmp_path, name)
        assert caught.value.field == "name"
    assert [each.name for each in tmp_path.iterdir()] == ["there"]
