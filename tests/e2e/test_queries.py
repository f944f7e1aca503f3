"""The commands `when`, `isochrone`, `matrix` and `crowds`, and what is new in `route`, as users call them."""

import json
from importlib import resources

import pytest

FROM, TO, NOON = "60.1699,24.9384", "60.1665,24.9440", "Sat 12:30"


def test_files_and_pictures(sidestep, tmp_path) -> None:
    asked = {
        "isochrone": ("--from", FROM, "--depart", NOON, "--minutes", "3,6"),
        "crowds": ("--at", NOON),
        "route": ("--from", FROM, "--to", TO, "--depart", NOON, "--futures", "20", "--alternatives", "2"),
    }
    for command, words in asked.items():
        picture, shapes = tmp_path / f"{command}.png", tmp_path / f"made/{command}.geojson"
        for file in (picture, shapes):
            done = sidestep(command, "helsinki", *words, "--out", file)
            assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
        assert picture.read_bytes().startswith(b"\x89PNG")
        found = json.loads(shapes.read_text("utf-8"))
        assert (found["type"], found["attribution"][:1]) == ("FeatureCollection", "©")
        assert json.loads(sidestep(command, "helsinki", *words, "--json").stdout)["scenario"] == "helsinki"


def test_what_is_read_is_never_written_to(sidestep, tmp_path) -> None:
    town = resources.files("sidestep.network") / "helsinki.npz"
    (tmp_path / "town.npz").write_bytes(town.read_bytes())
    (tmp_path / "x.toml").write_text('[place]\nstreets = "town.npz"\ntimezone = "Europe/Helsinki"\n')
    for name in ("avoid", "live", "places"):
        (tmp_path / name).write_text(f"{FROM}\n{TO}\n")
    (tmp_path / "link").symlink_to("town.npz")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    ends = ("--from", FROM, "--to", TO)
    for command, words, outs in (
        ("route", (*ends, "--avoid", "avoid", "--live", "live"), ("x.toml", "town.npz", "link", "avoid", "live")),
        ("when", (*ends, "--avoid", "avoid", "--live", "live"), ("x.toml", "avoid", "live")),
        ("isochrone", ("--from", FROM, "--avoid", "avoid", "--live", "live"), ("town.npz", "avoid", "live")),
        ("crowds", ("--live", "live"), ("x.toml", "live")),
        ("matrix", ("--origins", "places", "--avoid", "avoid"), ("x.toml", "avoid", "places")),
        ("matrix", ("--from", "5", "--destinations", "places"), ("places",)),
    ):
        for out in outs:
            done = sidestep(command, "x.toml", *words, "--out", out, cwd=tmp_path)
            assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
            assert "--out" in done.stderr
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_many_walks(sidestep, tmp_path) -> None:
    (tmp_path / "places.csv").write_text(f"{FROM}\n{TO}\n")
    words = ("matrix", "helsinki", "--origins", tmp_path / "places.csv", "--from", "5", "--to", "7", "--depart", NOON)
    lines = sidestep(*words, "--format", "csv").stdout.splitlines()
    assert [line.count(",") for line in lines] == [2, 2, 3, 3]  # places in quotes
    assert lines[0] == "origin,destination,minutes"
    assert sidestep(*words, "--format", "png", "--out", tmp_path / "matrix.png").returncode == 0
    said = sidestep("when", "paper-congested", "--until", "20", "--step", "10", "--futures", "5").stdout
    assert said.count(" min after the start") == 4
    done = sidestep("when", "paper-congested", "--until", "20", "--format", "png", "--out", tmp_path / "when.png")
    assert done.returncode == 0


def test_a_deadline(sidestep) -> None:
    words = ("route", "paper-congested", "--arrive-by", "300", "--confidence", "0.5", "--futures", "5", "--json")
    found = json.loads(sidestep(*words).stdout)
    assert (found["deadline"], found["confidence"]) == ("300 min after the start", 0.5)
    assert found["departure_minutes"] + found["by_minutes"] == pytest.approx(300)


@pytest.mark.parametrize(
    "args",
    [
        "route helsinki --from 60.17 24.94",
        "route helsinki --from 60.17, 24.94",
        "route helsinki --to=60.17 24.94",
        "isochrone helsinki --from -36.85 174.76",
        "route helsinki --from 24.9384,60.1699",
        "route helsinki --depart 25:00",
        "route helsinki --depart Fritag",
        "route helsinki --avoid none.geojson",
        "route helsinki --alternatives 1.5",
        "route helsinki --arrive-by 2025-03-30T03:30",
        "route helsinki --arrive-by 18:00 --by 20",
        "isochrone helsinki --minutes five",
        "isochrone helsinki --minutes 5,,10",
        "isochrone helsinki --format png",
        "isochrone helsinki --planner darp",
        "isochrone paper-congested --format geojson",
        "crowds paper-congested --format png --out x.png",
        "crowds paper-congested --out x.png",
        "crowds helsinki --format png --out crowds.pdf",
        "matrix helsinki --from 5 --to 7 --out m.gpx",
        "crowds helsinki --at 2025-05-24",
        "matrix helsinki",
        "matrix helsinki --origins none.csv",
        "matrix helsinki --from 60.17",
        "when helsinki --step -5",
        "when helsinki --until 30",
        "when paper-congested --format csv",
    ],
)
def test_bad_input_gets_a_sentence(sidestep, tmp_path, args: str) -> None:
    done = sidestep(*args.split(), cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("sidestep: ")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", [["--out", ""], ["--out="], [""]])
def test_empty_arguments_are_no_folder(sidestep, option: list[str], tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = sidestep("train", "paper-congested", "--side", 3, "--rounds", 1, *option)
    assert (done.returncode, done.stdout, list(tmp_path.iterdir())) == (2, "", [])
    assert ("--out" if option != [""] else "argument") in done.stderr


def test_a_place_in_two_words_is_shown_in_one(sidestep) -> None:
    assert "60.17,24.94" in sidestep("route", "helsinki", "--from", "60.17", "24.94").stderr
    assert "-36.85,174.76" in sidestep("route", "helsinki", "--to", "-36.85", "174.76").stderr
