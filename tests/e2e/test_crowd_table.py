"""Tables of crowds as people use them: imported by the command line, walked through at a venue."""

import json
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent.presets import preset_for
from sidestep.crowds.crowd_table import load_crowd_table, save_crowd_table
from sidestep.crowds.table_flow import TableFlow
from sidestep.crowds.table_reader import read_table
from sidestep.evaluation.compare import compare
from sidestep.network.formats import load_town, save_town
from sidestep.network.town import Town
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import CrowdTable, Venue
from sidestep.scenarios.reader import load_scenario
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.table_crowds import import_table

SIDE = 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A town of 4 x 4 crossings, 111 m apart."""
    path = tmp_path_factory.mktemp("town")
    place = np.array([[x / 1000, y / 1000] for y in range(SIDE) for x in range(SIDE)], float)
    across = [(i, i + 1) for i in range(SIDE**2) if (i + 1) % SIDE]
    ends = np.array([*across, *((i, i + SIDE) for i in range(SIDE**2 - SIDE))], np.int32)
    streets = len(ends)
    town = Town(
        place=place,
        ids=np.arange(SIDE**2) + 100,
        tail=ends[:, 0],
        head=ends[:, 1],
        one_way=np.zeros(streets, bool),
        length=np.full(streets, 111.2, np.float32),
        width=np.full(streets, 3, np.float32),
        kind=("footway",) * streets,
        name=("",) * streets,
        signals=np.zeros(streets, np.int16),
        crossings=np.zeros(streets, np.int16),
        opening=("",) * streets,
        restricted=np.zeros(streets, bool),
        incline=np.full(streets, np.nan, np.float32),
        kerb=np.zeros(streets, np.float32),
        points=place[ends.ravel()],
        first=np.arange(0, 2 * streets + 2, 2),
        attribution="",
    )
    save_town(town, path / "town.npz")
    rows = [
        f"{street},2025-05-24T{12 + hour}:00,{0.2 + 1.3 * ((street + hour) % 3 == 0)}"
        for hour in range(4)
        for street in range(streets)
    ]
    (path / "crowds.csv").write_text("\n".join(["street,time,speed", *rows]))
    save_crowd_table(read_table(path / "crowds.csv", town), path / "made.npz")
    return path


@pytest.fixture
def run(sidestep, folder: Path) -> Callable:
    return lambda *args: sidestep("counts", "import", *args, "--network", "town.npz", cwd=folder)


def test_a_table_becomes_crowds(run, folder: Path) -> None:
    done = run("crowds.csv", "--out", "new/crowds.npz", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["rows"], found["segments"], found["mentioned"], found["slots"]) == (96, 48, 48, 4)
    assert (found["begins"], found["ends"]) == ("2025-05-24T12:00:00", "2025-05-24T16:00:00")
    # Weidmann's law at .2 m/s is 1.34 (1 - exp(-1.913 (1/p - 1/5.4))): 1/p = .269681
    assert found["largest_density"] == pytest.approx(3.70808, rel=1e-4)
    assert (found["share_above_1"], found["share_above_4"]) == (pytest.approx(2 / 3), 0)
    assert (found["filled"], found["law"], found["slower_than_law"]) == ({}, "weidmann", 0)
    assert (folder / "new" / "crowds.npz").read_bytes() == (folder / "made.npz").read_bytes()


def test_people_are_told_what_was_filled(run, folder: Path) -> None:
    (folder / "gap.csv").write_text("from,to,slot,volume,seen\n100,101,0,400,a\n100,101,2,800,b\n")
    done = run("gap.csv", "--out", "gap.npz", "--slot", "2")
    assert done.returncode == 0, done.stderr
    for said in (
        "2 rows",
        "1 of 48 segments in 3 slots of 2 min",
        "gap",
        "not mentioned",
        "here: seen",
        "2.40",
    ):
        assert said in done.stdout
    assert load_crowd_table(folder / "gap.npz").value.tolist() == [[400], [600], [800]]


def test_speeds_below_the_lowest_of_a_law_are_counted(run, folder: Path) -> None:
    (folder / "slow.csv").write_text("segment,slot,speed\n0,0,0.01\n1,0,0.1\n2,0,0.2\n")
    done = run("slow.csv", "--out", "slow.npz", "--law", "power-capped")
    assert "power-capped, 2 below" in done.stdout
    # The lowest speeds are .05 and 1.34 12^-.8 = .184.
    town = load_town(folder / "town.npz")
    for law, slower in (("weidmann", 1), ("power-capped", 2)):
        _, report = import_table(folder / "slow.csv", town, law=law)
        assert (report.law, report.slower_than_law) == (law, slower)


@pytest.mark.parametrize(
    ("text", "args", "said"),
    [
        ("segment,slot,volume\n0,0,1\n0,1,-1\n", (), "bad.csv: line 3"),
        ("segment,slot,volume\n0,0,1\n", ("--slot", "0"), "--slot"),
        ("segment,slot,volume\n0,0,1\n", ("--out", "bad.csv"), ".npz"),
    ],
)
def test_bad_input_is_one_sentence(run, folder: Path, text: str, args: tuple[str, ...], said: str) -> None:
    (folder / "bad.csv").write_text(text)
    done = run("bad.csv", *(() if "--out" in args else ("--out", "bad.npz")), *args)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert said in done.stderr
    assert not (folder / "bad.npz").exists()


def test_what_is_read_is_never_written_to(run, sidestep, folder: Path) -> None:
    (folder / "s.toml").write_text(
        '[place]\nstreets = "town.npz"\ndays = "Sat"\nhours = [12, 15]\n'
        '[place.crowd_source]\nkind = "crowd_table"\nfile = "made.npz"\n'
    )
    (folder / "link.npz").hardlink_to(folder / "town.npz")
    (folder / "curve.png").symlink_to(folder / "s.toml")
    before = {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}
    asked = [
        run("crowds.csv", "--out", "town.npz"),
        run("crowds.csv", "--out", "link.npz"),
        sidestep("crowds", "s.toml", "--out", "made.npz", cwd=folder),
        sidestep("trade-off", "s.toml", "--out", "curve.png", cwd=folder),
    ]
    assert [(done.returncode, "--out" in done.stderr, done.stdout) for done in asked] == [(2, True, "")] * 4
    assert {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()} == before


def at_table(folder: Path, file: str = "made.npz", **changes: object) -> Scenario:
    venue = Venue(
        streets=str(folder / "town.npz"), crowd_source=CrowdTable(file=str(folder / file)), days=(5,), hours=(12, 15)
    )
    return scenario("helsinki").changed(name="table", place=venue, **changes)


def test_a_scenario_file_names_a_table(folder: Path) -> None:
    file = folder / "tabled.toml"
    text = """
[place]
streets = "town.npz"
days = ["Sat"]
hours = [12, 15]
[place.crowd_source]
kind = "crowd_table"
file = "made.npz"
noise = [0.5, 0.1]
"""
    file.write_text(text)
    problem = load_scenario(file)
    assert problem.place == at_table(folder, noise=(0.5, 0.1)).place
    assert not problem.place.interpolated
    assert isinstance(draw_map(problem, 0).flow, TableFlow)
    # Of 16 crossings one is where a walk begins and one is spared.
    assert preset_for(problem, "default").destinations == 14
    for wrong, line, field in (
        (text + "streets_per_sensor = 3", 10, "place.crowd_source.streets_per_sensor"),
        (text.replace("made.npz", "town.npz"), 8, "place.crowd_source.file"),
    ):
        file.write_text(wrong)
        with pytest.raises(ScenarioError) as caught:
            load_scenario(file)
        assert (caught.value.line, caught.value.field) == (line, field)


def test_walks_through_a_table(folder: Path) -> None:
    problem = at_table(folder)
    place = draw_map(problem, 0)
    assert isinstance(place.flow, TableFlow)
    assert place.test_flow is place.flow
    assert place.sensors == ()
    hours = jnp.array([132.0, 133.0])
    first, second = np.asarray(place.flow.expected(hours, 2).density(place.network))[:, 0, :3]
    assert first == pytest.approx([0, 3.70808, 3.70808], rel=1e-4)
    assert second == pytest.approx([3.70808, 3.70808, 0], rel=1e-4)
    chosen = choose_planners(problem, ["snapshot", "forecast"]).factories
    rows = compare(problem, chosen, maps=[0], walks=12).to_json()["planners"]
    assert all(row["arrival_rate"] == 1 for row in rows.values())
    # without noise crowds come as expected
    bound = rows["clairvoyant"]["mean_minutes"]
    assert rows["expected"]["mean_minutes"] == pytest.approx(bound, rel=1e-4)
    assert rows["shortest-path"]["mean_minutes"] > 1.02 * bound


def test_venues_that_do_not_fit_their_table(folder: Path) -> None:
    for changes, field in (
        (dict(days=(0, 5), hours=(10, 15)), "place.hours"),  # it covers four hours of Saturday
        (dict(slot_seconds=7200.0), "slot_seconds"),  # its own are of an hour
    ):
        with pytest.raises(ScenarioError) as caught:
            draw_map(at_table(folder, **changes), 0)
        assert caught.value.field == field
    with pytest.raises(ScenarioError) as caught:
        at_table(folder, law="power")
    assert caught.value.field == "law"
    with pytest.raises(ValueError, match="a town of 48 segments, but this one has 5038"):
        draw_map(at_table(folder, streets="helsinki"), 0)
