"""`sidestep route` through central Helsinki, and what it refuses."""

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
def route(monkeypatch, tmp_path, capsys):
    """In this process, which compiles once for all."""
    monkeypatch.setattr(cli, "_start_jax", lambda: None)
    monkeypatch.chdir(tmp_path)

    def run(*args: str) -> str:
        with pytest.raises(SystemExit, match="0"):
            cli.app(["route", "helsinki", *ENDS, *args], exit_on_error=False, print_error=False)
        return capsys.readouterr().out

    return run


def test_through_helsinki(route) -> None:
    said = route("--depart", NOON, "--futures", "20")
    assert "departing Saturday 2025-05-24 12:30" in said
    assert re.search(r"head \S+ +\S.* +\d+ +\d+\.\d +(free|busy|dense|jammed) ", said)
    assert "In 20 simulated futures" in said
    assert "shortest-path in the same futures" in said
    assert "snapshot in the same futures" in said
    assert "© OpenStreetMap contributors, ODbL 1.0" in said
    assert "Auckland's counts (Heart of the City Auckland, CC BY 4.0), paired with these streets by a seed" in said
    assert "(synthetic)." in said


def test_current_counts_change_the_crowds(route, tmp_path) -> None:
    usual = json.loads(route("--depart", NOON, "--futures", "20", "--json"))
    assert (usual["counted_sensors"], usual["sensors"]) == (None, 16)
    sensors = [f"{name}" for name in ("45 Queen Street", "2 High Street", "59 High Street")]
    (tmp_path / "now.csv").write_text(f"time,{','.join(sensors)}\n2025-05-24T11,0,0,\n2025-05-24T12,1,1,\n")
    empty = json.loads(route("--depart", NOON, "--futures", "20", "--json", "--live", "now.csv"))
    assert (empty["counted_sensors"], empty["arrives"]) == (2, True)
    # with hardly anybody at two sensors no way through them takes longer
    assert empty["expected_minutes"] <= usual["expected_minutes"] + 0.01
    assert [file.name for file in tmp_path.iterdir()] == ["now.csv"]


def test_a_picture_of_a_walk(route, tmp_path) -> None:
    assert route("--depart", NOON, "--futures", "20", "--format", "png", "--out", "walk.png") == ""
    assert (tmp_path / "walk.png").read_bytes().startswith(b"\x89PNG")
    assert [file.name for file in tmp_path.iterdir()] == ["walk.png"]


def test_bad_input_ends_the_process_with_a_sentence(tmp_path) -> None:
    command = [
        sys.executable,
        "-m",
        "sidestep",
        "route",
        "helsinki",
        "--from",
        "0,0",
        "--format",
        "gpx",
        "--out",
        "x/r.gpx",
    ]
    done = subprocess.run(command, cwd=tmp_path, env=os.environ, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(
        r"sidestep: 0, 0 is [\d,]+ m from the nearest street, so .* not in this town \(.*\)\n", done.stderr
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("args", "says"),
    [
        ("helsinki --from here", "--from must be a node or LAT,LON such as 60.1699,24.9384, not 'here'"),
        ("helsinki --to 60.17", "--to must be a node or LAT,LON such as 60.1699,24.9384, not '60.17'"),
        ("helsinki --from 99999", "there is no node 99999 to be the origin; nodes are numbered 0 to 945"),
        ("helsinki --to -1", "there is no node -1 to be the destination"),
        ("helsinki --from -36.85,174.76", "from the nearest street, so it is not in this town"),
        ("helsinki --from 120,24", "120, 24 is not a valid place"),
        ("helsinki --from 5 --to 5", "crossing 5 and crossing 5 are the same place"),
        ("helsinki --depart 30", "--depart must be a local time such as 2025-05-24T12:30, not '30'"),
        ("helsinki --depart 2025-05-24", "--depart must be a local time such as 2025-05-24T12:30, not '2025-05-24'"),
        ("helsinki --depart 2025-05-24T12:30+03:00", "--depart must be local wall time without zone or offset"),
        ("helsinki --format png", "--format png needs --out, the file for the picture"),
        ("helsinki --format pdf", "--format"),
        ("helsinki --format gpx --json", "--json and --format gpx cannot go together"),
        ("helsinki --live none.csv", "none.csv: cannot be read"),
        ("helsinki --futures 0", "--futures must be at least 1, not 0"),
        ("helsinki --planner astar", "unknown planner 'astar'"),
        ("helsinki --planner darp", "darp needs --model"),
        ("helsinki --model no/such/folder", "no model in no/such/folder"),
        ("paper-congested --from 1.5,2.5", "--from must be a node, not 1.5,2.5: a grid has no latitudes"),
        ("paper-congested --format gpx", "--format gpx needs a scenario with real streets, such as helsinki"),
        ("paper-congested --live none.csv", "--live needs a scenario with real streets"),
        ("paper-congested --depart soon", "--depart must be a number of minutes, not soon"),
    ],
)
def test_bad_input_is_refused(args: str, says: str, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(cli, "_start_jax", lambda: None)
    monkeypatch.chdir(tmp_path)
    with pytest.raises((SidestepError, CycloptsError)) as caught:
        cli.app(["route", *args.split()], exit_on_error=False, print_error=False)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value) or isinstance(caught.value, CycloptsError)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("row", "says"),
    [
        (
            "2025-05-23T12,5",
            "the last counts are of the hour from 2025-05-23T12:00, but the departure is 2025-05-24T12:30",
        ),
        ("2025-05-24T12,-5", "is negative"),
        ("2025-05-24T12:30,5", "is not on the hour"),
        ("2025-05-24T12+03:00,5", "has an offset"),
        ("2025-05-24T12,", "nothing was counted in the last hour"),
        ("2025-05-24T12,5\n2025-05-24T12,6", "does not come after"),
    ],
)
def test_counts_that_cannot_be_used(row: str, says: str, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(cli, "_start_jax", lambda: None)
    (tmp_path / "now.csv").write_text(f"time,45 Queen Street\n{row}\n")
    with pytest.raises(SidestepError, match=re.escape(says)) as caught:
        cli.app(["route", "helsinki", "--depart", NOON, "--live", str(tmp_path / "now.csv")], exit_on_error=False)
    assert "now.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_place_that_cannot_be_written_to(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(cli, "_start_jax", lambda: None)
    (tmp_path / "file").write_text("here first")
    with pytest.raises(SidestepError, match="cannot write to the output folder"):
        cli.app(
            ["route", "helsinki", "--format", "gpx", "--out", str(tmp_path / "file" / "r.gpx")], exit_on_error=False
        )
    assert (tmp_path / "file").read_text() == "here first"
