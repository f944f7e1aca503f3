"""Commands killed at random moments: what was there before, or what was to be written, is there whole."""

import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.stress
KILLS = 12


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> random.Random:
    return random.Random(request.config.getoption("--hypothesis-seed", None))


@pytest.fixture
def killed(environ, rng) -> Callable[..., str]:
    """Start a command in a folder and kill it: anywhere in so many seconds, or while it writes."""

    def run(args: list[str], cwd: Path, seconds: float) -> str:
        if early := rng.random() < 0.3:
            patience, pause = 0.0, rng.uniform(0, seconds)
        else:
            patience, pause = 5 * seconds + 60, rng.choice([0, rng.uniform(0, 0.02), rng.uniform(0, 0.5)])
        command = [sys.executable, "-m", "sidestep", *args]
        process = subprocess.Popen(command, env=environ, cwd=cwd, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + patience
        old = set(cwd.rglob(".*.part"))
        while time.monotonic() < deadline and process.poll() is None and not set(cwd.rglob(".*.part")) - old:
            time.sleep(0.0005)
        time.sleep(pause)
        process.kill()
        process.wait()
        return f"killed {pause:.4f} s after {'the start' if early else 'it began to write'}: {' '.join(args)}"

    return run


def shown(folder: Path) -> dict[str, bytes]:
    """What people see there; a killed process cannot take its hidden files with it."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if not path.name.startswith(".")}


def square(side: int) -> str:
    """An extract of a square town."""
    lines = ['<osm version="0.6">']
    place = [(x, y) for y in range(side) for x in range(side)]
    lines += [f'<node id="{1 + x + side * y}" lat="{60 + y / 999}" lon="{25 + x / 500}"/>' for x, y in place]
    rows = [[1 + x + side * y for x in range(side)] for y in range(side)]
    for number, refs in enumerate([*rows, *zip(*rows, strict=True)], 1):
        through = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        lines.append(f'<way id="{number}">{through}<tag k="highway" v="footway"/></way>')
    return "\n".join([*lines, "</osm>"])


HELSINKI = ["route", "helsinki", "--from", "60.1699,24.9384", "--to", "60.1665,24.9440", "--futures", "5"]


WRITERS = {
    **{
        f"town{suffix}": (
            ["import-osm", "small.osm", "--out", f"town{suffix}"],
            ["import-osm", "large.osm", "--out", f"town{suffix}"],
        )
        for suffix in (".npz", ".graphml", ".geojson")
    },
    "counts.csv": (["counts", "some.csv", "--out", "counts.csv"], ["counts", "--out", "counts.csv"]),
    "route.geojson": (
        [*HELSINKI, "--json", "--out", "route.geojson"],
        [*HELSINKI, "--format", "geojson", "--out", "route.geojson"],
    ),
    "route.gpx": ([*HELSINKI, "--json", "--out", "route.gpx"], [*HELSINKI, "--format", "gpx", "--out", "route.gpx"]),
}


@pytest.mark.parametrize("written", WRITERS)
def test_written_whole_or_not_at_all(process, killed, tmp_path, written: str) -> None:
    before, after = WRITERS[written]
    inputs, ready, done = (tmp_path / name for name in ("inputs", "ready", "done"))
    inputs.mkdir()
    (inputs / "small.osm").write_text(square(3))
    (inputs / "large.osm").write_text(square(40))
    rows = [f"2024-01-{1 + hour // 24:02}T{hour % 24:02},{hour % 7}" for hour in range(600)]
    (inputs / "some.csv").write_text("\n".join(["time,a", *rows, ""]))
    took = []
    for folder, of, args in ((ready, inputs, before), (done, ready, after)):
        shutil.copytree(of, folder)
        began = time.monotonic()
        ended = process(*args, cwd=folder)
        took.append(time.monotonic() - began)
        assert ended.returncode == 0, ended.stderr
    old, new = shown(ready), shown(done)
    assert new[written] != old[written]
    for number in range(KILLS):
        # over what was there, and where nothing was
        folder, of = tmp_path / f"killed{number}", ready if number % 3 else inputs
        shutil.copytree(of, folder)
        how = killed(after, folder, took[1])
        there, was = shown(folder), shown(of)
        assert was.keys() <= there.keys() <= new.keys(), how
        assert all(content in (new[name], was.get(name)) for name, content in there.items()), how
    # What was left behind is in nobody's way.
    assert process(*after, cwd=folder).returncode == 0
    assert shown(folder) == new
