"""Formats of answers, and files that must not be written to."""

from pathlib import Path
from typing import Literal

import pytest

from sidestep.cli.answers import FIRST_MAP, choose_format
from sidestep.errors import SidestepError

FORMATS = Literal["text", "geojson", "png"]


@pytest.mark.parametrize(
    ("output", "out", "as_json", "chosen"),
    [
        (None, None, False, "text"),
        (None, "r.png", False, "png"),
        (None, "R.PNG", False, "png"),
        (None, "r.geojson", False, "geojson"),
        (None, "r.json", False, "json"),
        (None, "r.json", True, "json"),
        ("text", "r.json", True, "json"),
        ("geojson", "r.json", False, "geojson"),
        ("geojson", None, False, "geojson"),
        ("geojson", "r", False, "geojson"),
        ("png", "r.part", False, "png"),
        (None, "r.txt", False, "text"),
        (None, "r", True, "json"),
    ],
)
def test_the_ending_says_the_format(output: str | None, out: str | None, as_json: bool, chosen: str) -> None:
    assert choose_format(output, None if out is None else Path(out), FORMATS, as_json=as_json) == chosen


@pytest.mark.parametrize(
    ("output", "out", "as_json", "field"),
    [
        ("png", "r.pdf", False, "out"),
        ("png", "r.geojson", False, "out"),
        ("png", "r.json", False, "out"),
        ("text", "r.png", False, "out"),
        ("geojson", "r.gpx", False, "out"),
        (None, "r.gpx", False, "out"),  # which this answer cannot be
        (None, "r.csv", False, "out"),
        (None, "r.svg", False, "out"),
        (None, "r.png", True, "out"),
        (None, "r.geojson", True, "out"),
        ("png", None, False, "out"),
        ("png", "r.png", True, "format"),
    ],
)
def test_formats_that_exclude_each_other(output: str | None, out: str | None, as_json: bool, field: str) -> None:
    with pytest.raises(SidestepError) as caught:
        choose_format(output, None if out is None else Path(out), FORMATS, as_json=as_json)
    assert caught.value.field == field


def test_files_of_a_scenario_are_not_written_to(tmp_path: Path) -> None:
    file = tmp_path / "quiet.toml"
    file.write_text('[place]\nstreets = "helsinki"\n')
    other = tmp_path / "live.csv"
    other.touch()
    for out in (file, other):
        with pytest.raises(SidestepError) as caught:
            FIRST_MAP.router(str(file), out, None, other)
        assert caught.value.field == "out"
