"""`sidestep route` on grids, through central Helsinki and through a town of one's own, and what it refuses."""

import json
import os
import re
import subprocess
import sys

import pytest
from cyclopts import CycloptsError

from sidestep.cli import app as cli
from sidestep.errors import SidestepError

ENDS = ("--from", "60.1699,24.9384", "--to", "60.1665,24.9440")
NOON = "2025-05-24T12:30"


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """In this process, which compiles once for all."""
    monkeypatch.setattr("sidestep.cli.options.start_jax", lambda: None)
    monkeypatch.chdir(tmp_path)

    def run(*args: str) -> str:
        with pytest.raises(SystemExit, match="0"):
            cli.app(["route", *args], exit_on_error=False, print_error=False)
        return capsys.readouterr().out

    return run


@pytest.fixture
def helsinki(command):
    return lambda *args: command("helsinki", *ENDS, "--futures", "20", *args)


def test_through_helsinki(helsinki) -> None:
    said = helsinki("--depart", NOON)
    assert "departing Saturday 2025-05-24 12:30" in said
    assert re.search(r"head \S+ +\S.* +\d+ +\d+\.\d +(free|busy|dense|jammed) ", said)
    assert "In 20 simulated futures" in said
    assert "shortest-path in the same futures" in said
    assert "snapshot in the same futures" in said
    assert "© OpenStreetMap contributors, ODbL 1.0" in said
    assert "Crowds: Auckland's counts (Heart of the City Auckland, CC BY 4.0). Synthetic: " in said
    assert said.endswith("; demand 120 × the counts (an invented event day).\n")


def test_current_counts_change_the_crowds(helsinki, tmp_path) -> None:
    usual = json.loads(helsinki("--depart", NOON, "--json"))
    assert (usual["counted_sensors"], usual["sensors"]) == (None, 16)
    assert usual["synthetic"].endswith("demand 120 × the counts (an invented event day)")
    sensors = [f"{name}" for name in ("45 Queen Street", "2 High Street", "59 High Street")]
    (tmp_path / "now.csv").write_text(f"time,{','.join(sensors)}\n2025-05-24T11,0,0,\n2025-05-24T12,1,1,\n")
    empty = json.loads(helsinki("--depart", NOON, "--json", "--live", "now.csv"))
    assert (empty["counted_sensors"], empty["arrives"]) == (2, True)
    assert "of 2 of 16 sensors" in empty["expected_crowds"]
    # with hardly anybody at two sensors no way through them takes longer
    assert empty["expected_minutes"] <= usual["expected_minutes"] + 0.01
    assert [file.name for file in tmp_path.iterdir()] == ["now.csv"]


def test_files_of_a_route(helsinki, tmp_path) -> None:
    assert helsinki("--format", "geojson", "--out", "made/route.geojson") == ""
    whole = json.loads((tmp_path / "made/route.geojson").read_text("utf-8"))
    assert whole["type"] == "FeatureCollection"
    assert "demand 120 × the counts" in whole["synthetic"]
    gpx = helsinki("--format", "gpx")
    assert "demand 120 × the counts" in gpx
    assert "<time>" not in gpx  # on no day
    helsinki("--format", "gpx", "--out", "route.gpx")
    assert (tmp_path / "route.gpx").read_text("utf-8") == gpx
    assert helsinki("--format", "png", "--out", "walk.png") == ""
    assert (tmp_path / "walk.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["made", "route.gpx", "walk.png"]


def test_a_grid(command) -> None:
    args = ("paper-congested", "--depart", "5", "--from", "7", "--to", "9")
    found = json.loads(command(*args, "--by", "90", "--json"))
    assert (found["nodes"][0], found["nodes"][-1], found["by_minutes"]) == (7, 9, 90)
    said = command(*args)
    assert said.startswith("expected (map), departing 5 min after the start, if crowds are as expected:\n")
    assert "Synthetic: streets and crowds drawn from a seed." in said


def test_bad_input_ends_the_process_with_a_sentence(tmp_path) -> None:
    words = ("route", "helsinki", "--from", "0,0", "--to", "5", "--format", "gpx", "--out", "x/r.gpx")
    done = subprocess.run(
        [sys.executable, "-m", "sidestep", *words],
        cwd=tmp_path,
        env=os.environ,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(r"sidestep: latitude 0, longitude 0 is [\d,]+ m from the nearest street, .*\n", done.stderr)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("args", "field"),
    [
        ("helsinki --from here", "origin"),
        ("helsinki --to 60.17", "destination"),
        ("helsinki --from 99999", "origin"),
        ("helsinki --to -1", "destination"),
        ("helsinki --from -36.85,174.76", "origin"),
        ("helsinki --from 120,24", "origin"),
        ("helsinki --from 5 --to 5", "destination"),
        ("helsinki --depart 30", "depart"),
        ("helsinki --depart 2025-05-24", "depart"),
        ("helsinki --depart 2025-03-30T03:30", "depart"),  # clocks go forward
        ("helsinki --format png", "out"),
        ("helsinki --format gpx --json", "format"),
        (f"helsinki --live none.csv --depart {NOON}", "live"),
        ("helsinki --live none.csv", "depart"),
        ("helsinki --futures 0", "futures"),
        ("helsinki --planner astar", "planner"),
        ("helsinki --planner darp", "planner"),
        ("helsinki --model no/such/folder", "model"),
        ("paper-congested --from 1.5,2.5", "origin"),
        ("paper-congested --from 36", "origin"),
        ("paper-congested --from -1", "origin"),
        ("paper-congested --to -1", "destination"),
        ("paper-congested --to 36", "destination"),
        ("paper-congested --format gpx", "format"),
        ("paper-congested --live none.csv", "live"),
        ("paper-congested --depart soon", "depart"),
        ("paper-congested --depart nan", "depart"),
        ("paper-congested --depart -1", "depart"),
        ("paper-congested --depart 1440", "depart"),
        ("paper-congested --depart 2025-05-24T12:30", "depart"),
        ("paper-congested --by 0", "by"),
        ("paper-congested --by inf", "by"),
        ("paper-congested --by -5", "by"),
        ("paper-congested --futures -1", "futures"),
        ("paper-congested --planner astar", "planner"),
        ("paper-congested --planner darp", "planner"),
        ("paper-congested --model no/such/folder", "model"),
    ],
)
def test_bad_input_names_its_field(args: str, field: str, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr("sidestep.cli.options.start_jax", lambda: None)
    monkeypatch.chdir(tmp_path)
    words = args.split()
    for option, node in (("--from", "0"), ("--to", "5")):
        words += [option, node] * (words[0] == "helsinki" and option not in words)
    with pytest.raises(SidestepError) as caught:
        cli.app(["route", *words], exit_on_error=False, print_error=False)
    assert caught.value.field == field
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "args",
    ["helsinki --format pdf", "paper-congested --futures 2.5", "paper-congested --map -1", "paper-congested --seed -1"],
)
def test_options_that_cannot_be(args: str, monkeypatch) -> None:
    monkeypatch.setattr("sidestep.cli.options.start_jax", lambda: None)
    with pytest.raises((SidestepError, CycloptsError)) as caught:
        cli.app(["route", *args.split()], exit_on_error=False, print_error=False)
    assert args.split()[1] in str(caught.value)


@pytest.mark.parametrize(
    "row",
    [
        "2025-05-23T12,5",  # of the day before
        "2025-05-24T12,-5",
        "2025-05-24T12:30,5",
        "2025-05-24T12+05:00,5",  # of two hours before
        "2025-05-24T12,",
        "2025-05-24T12,5\n2025-05-24T12,6",
    ],
)
def test_counts_that_cannot_be_used(row: str, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr("sidestep.cli.options.start_jax", lambda: None)
    (tmp_path / "now.csv").write_text(f"time,45 Queen Street\n{row}\n")
    with pytest.raises(SidestepError) as caught:
        cli.app(
            ["route", "helsinki", *ENDS, "--depart", NOON, "--live", str(tmp_path / "now.csv")], exit_on_error=False
        )
    assert caught.value.field == "live"
    assert "now.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_place_that_cannot_be_written_to(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr("sidestep.cli.options.start_jax", lambda: None)
    (tmp_path / "file").write_text("here first")
    words = [
        "route",
        "helsinki",
        *ENDS,
        "--futures",
        "20",
        "--format",
        "gpx",
        "--out",
        str(tmp_path / "file" / "r.gpx"),
    ]
    with pytest.raises(SidestepError, match="cannot write to the output folder"):
        cli.app(words, exit_on_error=False)
    assert (tmp_path / "file").read_text() == "here first"
