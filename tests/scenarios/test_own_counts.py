"""Scenarios of one's own streets and counts: sensors where the counts know that they stand, layouts, timezones."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from sidestep.crowds.counts import CountsError
from sidestep.crowds.layouts import Layout
from sidestep.errors import SidestepError
from sidestep.network.formats import save_town
from sidestep.network.osm import import_osm
from sidestep.routing.locate import Circumstances, locator
from sidestep.routing.places import AskedPlace
from sidestep.scenarios.builtin import AUCKLAND_SENSORS, scenario
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.places import Counters
from sidestep.scenarios.reader import load_scenario
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.template import begin, new_scenario

ROWS, COLUMNS, SOUTH, WEST, STEP = 7, 5, -36.8505, 174.7638, 0.0012


@pytest.fixture(scope="module")
def streets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lattice of footways over the lower half of Queen Street."""
    folder = tmp_path_factory.mktemp("streets")
    nodes = [
        f'<node id="{1 + COLUMNS * row + column}" lat="{SOUTH + STEP * row:.5f}" lon="{WEST + STEP * column:.5f}"/>'
        for row in range(ROWS)
        for column in range(COLUMNS)
    ]
    number = np.arange(1, ROWS * COLUMNS + 1).reshape(ROWS, COLUMNS)
    lines = [*number.tolist(), *number.T.tolist()]
    refs = ["".join(f"<nd ref='{node}'/>" for node in line) for line in lines]
    ways = [f'<way id="{way}">{each}<tag k="highway" v="footway"/></way>' for way, each in enumerate(refs, 1)]
    (folder / "lattice.osm").write_text(f'<osm version="0.6">{"".join(nodes + ways)}</osm>')
    town, _ = import_osm(folder / "lattice.osm")
    save_town(town, folder / "lattice.npz")
    return folder / "lattice.npz"


def test_counts_that_know_where_their_sensors_stand(streets: Path, tmp_path: Path) -> None:
    beginning = begin(str(streets), "auckland")
    assert 6 <= beginning.standing < beginning.counted == len(AUCKLAND_SENSORS)
    assert beginning.timezone == "Pacific/Auckland"
    made = new_scenario(tmp_path, "auckland", beginning)
    assert "SYNTHETIC" not in made.read_text()
    found = load_scenario(made)
    sensors = found.place.crowd_source.sensors
    assert (len(sensors), found.place.synthetic, found.place.timezone) == (beginning.standing, "", "Pacific/Auckland")
    assert {sensor.name for sensor in sensors} <= {sensor.name for sensor in AUCKLAND_SENSORS}
    assert {sensor.name: sensor.place for sensor in sensors}["45 Queen Street"] == (-36.845001, 174.766266)
    drawn = draw_map(found.changed(horizon=600.0), 0)
    assert drawn.sensors == tuple(sensor.name for sensor in sensors)
    # Elsewhere, and on several streets each, sensors are paired.
    assert begin("helsinki", "auckland").standing == 0
    text = made.read_text()
    made.write_text(text.replace("streets_per_sensor = 1", "streets_per_sensor = 2"))
    assert load_scenario(made).place.crowd_source.sensors == AUCKLAND_SENSORS
    made.write_text('[place]\nstreets = "helsinki"\n')
    assert load_scenario(made).place.crowd_source.sensors == AUCKLAND_SENSORS


@pytest.fixture
def counts(tmp_path: Path) -> Path:
    """Nine weeks in quarters of an hour, day first, in columns whose names nobody knows."""
    times = np.datetime64("2024-03-06T00:00") + np.arange(9 * 168 * 4) * np.timedelta64(15, "m")
    cells = [f"{time:%d/%m/%y %H:%M};{5 + time.hour},5;2" for time in times.tolist()]
    (tmp_path / "quays.csv").write_text("\n".join(["When;North Quay;Old Quay", *cells, ""]))
    return tmp_path / "quays.csv"


COLUMNS_TABLE = """
[place]
streets = '{streets}'
timezone = "Pacific/Auckland"
[place.crowd_source]
file = "quays.csv"
fitted = [2024-03-06, 2024-04-15]
tested = [2024-04-15, 2024-05-06]
date_format = "%d/%m/%y %H:%M"
[place.crowd_source.columns]
time = "When"
{more}
"""


@pytest.mark.usefixtures("counts")
def test_columns_are_named_in_the_scenario(streets: Path, tmp_path: Path) -> None:
    file = tmp_path / "scenario.toml"
    file.write_text(COLUMNS_TABLE.format(streets=streets, more="ignore = 'Old Quay'"))
    found = load_scenario(file)
    place = found.place
    assert place.layout == Layout(
        time="When", ignore=("Old Quay",), date_format="%d/%m/%y %H:%M", timezone="Pacific/Auckland"
    )
    drawn = draw_map(found.changed(horizon=600.0), 0)
    assert drawn.sensors == ("North Quay",)
    # Four quarters of an hour of 5.5 more than the hour, at noon on a Monday.
    assert float(np.expm1(drawn.flow.model.expected[12, 0])) == pytest.approx(4 * 17.5, rel=1e-4)
    # A positions file beside the counts: nothing is synthetic any more.
    assert place.synthetic != ""
    (tmp_path / "quays.positions.csv").write_text(
        f"sensor,latitude,longitude\nNorth Quay,{SOUTH + STEP},{WEST + STEP}\n"
    )
    placed = load_scenario(file).place
    assert [sensor.place for sensor in placed.crowd_source.sensors] == [(SOUTH + STEP, WEST + STEP)]
    assert placed.synthetic == ""


@pytest.mark.parametrize(
    ("more", "field"),
    [
        ("ignore = 'New Quay'", "place.crowd_source.file"),
        ("sensor = 'Where'", "place.crowd_source.file"),
        ("ignore = ['Old Quay', 7]", "place.crowd_source.columns.ignore"),
        ("sensors = 'Old Quay'", "place.crowd_source.columns.sensors"),
        ("count = 7", "place.crowd_source.columns.count"),
    ],
)
@pytest.mark.usefixtures("counts")
def test_columns_that_are_named_wrongly(streets: Path, tmp_path: Path, more: str, field: str) -> None:
    file = tmp_path / "scenario.toml"
    file.write_text(COLUMNS_TABLE.format(streets=streets, more=more))
    with pytest.raises(ScenarioError) as caught:
        load_scenario(file)
    assert caught.value.field == field
    file.write_text(COLUMNS_TABLE.format(streets=streets, more="").replace("Pacific/Auckland", "Auckland"))
    with pytest.raises(ScenarioError) as caught:
        load_scenario(file)
    assert (caught.value.field, caught.value.line) == ("place.timezone", 4)


def test_a_scenario_of_own_counts_begins_with_its_weeks(streets: Path, counts: Path, tmp_path: Path) -> None:
    with pytest.raises(CountsError) as caught:
        begin(str(streets), str(counts))
    assert caught.value.field == "When"
    text = counts.read_text().replace("When", "time")
    counts.write_text("\n".join(line.replace("/24 ", "/2024 ") for line in text.split("\n")))
    beginning = begin(str(streets), str(counts), Layout(timezone="Pacific/Auckland"))
    # Nine weeks from a Wednesday on, of which eight are from Monday to Sunday; a quarter of them is tested in.
    assert (beginning.fitted, beginning.tested) == (("2024-03-06", "2024-04-22"), ("2024-04-22", "2024-05-06"))
    found = load_scenario(new_scenario(tmp_path, "quays", beginning))
    assert [sensor.name for sensor in found.place.crowd_source.sensors] == ["North Quay", "Old Quay"]
    assert "paired" in found.place.synthetic
    counts.write_text("\n".join(counts.read_text().split("\n")[: 5 * 168 * 4]))
    with pytest.raises(CountsError):
        begin(str(streets), str(counts))


def test_latitudes_and_longitudes_that_are_swapped(tmp_path: Path) -> None:
    times = np.datetime64("2024-01-03T00:00") + np.arange(9 * 168) * np.timedelta64(1, "h")
    rows = [f"{time},Quay,{hour % 24},{{}}" for hour, time in enumerate(times)]
    text = "\n".join(["time,sensor,count,latitude,longitude", *rows, ""])
    file, counts = tmp_path / "scenario.toml", tmp_path / "c.csv"
    days = "fitted = [2024-01-03, 2024-02-12]\ntested = [2024-02-12, 2024-03-04]\n"
    file.write_text(f'[place]\nstreets = "helsinki"\n[place.crowd_source]\nfile = "c.csv"\n{days}')
    counts.write_text(text.replace("{}", "24.94,60.17"))
    with pytest.raises(CountsError) as caught:
        begin("helsinki", str(counts))
    assert caught.value.field == "latitude"
    with pytest.raises(ScenarioError) as wrong:
        load_scenario(file)
    assert (wrong.value.field, wrong.value.line) == ("place.crowd_source.file", 4)
    for place, standing in (("60.17,24.94", 1), ("-36.845,174.766", 0)):
        counts.write_text(text.replace("{}", place))
        assert begin("helsinki", str(counts)).standing == standing


@pytest.mark.parametrize(
    ("layout", "field"),
    [
        (Layout(time="When"), "columns"),
        (Layout(latitude="y"), "columns"),
        (Layout(date_format="day-first"), "date_format"),
        (Layout(decimal=","), "decimal"),
    ],
)
def test_the_bundled_counts_are_known(layout: Layout, field: str) -> None:
    with pytest.raises(SidestepError) as caught:
        begin("helsinki", "auckland", layout)
    assert caught.value.field == field


def test_departures_with_an_offset_are_turned_into_the_venues_time() -> None:
    problem = scenario("helsinki", horizon=600.0, streets_per_sensor=1, uneven=0.0)
    here = locator(problem, draw_map(problem, 0))

    def departure(time: str) -> str | None:
        given = Circumstances(depart=datetime.fromisoformat(time))
        return here.locate([AskedPlace("origin", 0), AskedPlace("destination", 1)], given).facts.departure

    assert departure("2025-05-24T12:30") == "2025-05-24T12:30:00"
    assert departure("2025-05-24T09:30Z") == "2025-05-24T12:30:00"
    assert departure("2025-01-24T12:30+12:00") == "2025-01-24T02:30:00"
    assert departure("2025-10-26T03:30") == "2025-10-26T03:30:00"  # the first of both
    with pytest.raises(ValueError, match="does not exist") as caught:
        departure("2025-03-30T03:30")
    assert caught.value.field == "depart"  # type: ignore[attr-defined]


def test_layouts_of_scenarios() -> None:
    assert Counters().layout("Asia/Tokyo") == Layout(timezone="Asia/Tokyo")
    with pytest.raises(ScenarioError) as caught:
        scenario("helsinki", timezone="Helsinki")
    assert caught.value.field == "timezone"
