"""Trainings killed at random moments, or on a full disk: they go on to the same weights, bit for bit."""

import random
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from sidestep.agent import checkpoint
from sidestep.agent.metrics import is_running, read_metrics

# The command itself, but it saves after every round, so that it is often killed while it writes.
SAVES_ALWAYS = """
from math import inf
from sidestep.agent import runs
from sidestep.cli.app import main
runs.SAVE_SECONDS, runs.SAVE_SHARE = 0.0, inf
main()
"""
# The same, on a disk that takes no more than so many bytes of each file.
ON_A_SMALL_DISK = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2)
"""
Straight = Callable[[list[str]], Path]
GRID = ["train", "paper-congested", "--side", "3", "--crowded-nodes", "1"]
# More rounds than are done between so many kills
TABLE = [*GRID, "--preset", "tabular-q", "--rounds", "700"]
LONG_TABLE = [*TABLE[:-1], "3000"]
NETWORK = [*GRID, "--rounds", "300"]
LOCAL = [*GRID, "--level", "local", "--rounds", "40", "--destinations", "2"]


@pytest.fixture(scope="module")
def straight(env: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Straight:
    """The folder of a training that nothing interrupted."""

    @cache
    def of(*args: str) -> Path:
        folder = tmp_path_factory.mktemp("straight") / "m"
        # The first checkpoint as well, however many a slow computer saves after it.
        done = trained(env, [*args, "--keep-checkpoints", "1000"], folder)
        assert done.returncode == 0, done.stderr
        return folder

    return lambda args: of(*args)


@pytest.fixture(scope="module")
def env(environ: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """With compiled programs of their own, which the first process of each training compiles.

    JAX's cache is off: a kill or a full disk may leave half of a program there, which it warns of ever after.
    """
    programs = str(tmp_path_factory.mktemp("programs"))
    return environ | {"SIDESTEP_CACHE": programs, "JAX_ENABLE_COMPILATION_CACHE": "0"}


def trained(env: dict[str, str], args: list[str], out: Path, code: str = "") -> "subprocess.CompletedProcess[str]":
    program = ["-c", code] if code else ["-m", "sidestep"]
    command = [sys.executable, *program, *args, "--out", str(out)]
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=600)


def killed(env: dict[str, str], args: list[str], out: Path, rng: random.Random) -> str:
    """Kill a training: anywhere in its first second, or once it has done a round, often as it writes."""
    command = [sys.executable, "-c", SAVES_ALWAYS, *args, "--out", str(out)]
    before = checkpoint.checkpoints(out)
    process = subprocess.Popen(command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    early = rng.random() < 0.5
    pause = rng.uniform(0, 1) if early else rng.uniform(0, 0.1)
    while not early and process.poll() is None and checkpoint.checkpoints(out) == before:
        time.sleep(0.001)
    time.sleep(pause)
    process.kill()
    _, said = process.communicate()
    assert process.returncode == -9, said
    return f"killed {pause:.4f} s after {'the start' if early else 'a round'}"


def timeless(folder: Path) -> list[dict[str, Any]]:
    took = {"seconds", "steps_per_second", "updates_per_second"}
    return [line.model_dump(exclude=took) for line in read_metrics(folder)]


@pytest.mark.parametrize(
    ("args", "kills"),
    [
        (TABLE, 20),
        pytest.param(LONG_TABLE, 100, marks=pytest.mark.stress),
        pytest.param(NETWORK, 40, marks=pytest.mark.stress),
        pytest.param(LOCAL, 20, marks=pytest.mark.stress),
    ],
)
def test_a_killed_training_ends_as_if_it_had_not_been(
    request: pytest.FixtureRequest, env: dict[str, str], tmp_path: Path, straight: Straight, args: list[str], kills: int
) -> None:
    rng = random.Random(request.config.getoption("--hypothesis-seed", None))
    expected, folder, how = straight(args), tmp_path / "killed", ""
    for _ in range(kills):
        onward = ["--resume"] if checkpoint.checkpoints(folder) else []
        how = killed(env, [*args, *onward], folder, rng)
        assert not is_running(folder), how
        if checkpoint.checkpoints(folder):
            at = len(checkpoint.load(folder).metadata.curve)
            assert timeless(folder)[:at] == timeless(expected)[:at], how
    done = trained(env, [*args, "--resume"], folder)
    assert done.returncode == 0, (how, done.stderr)
    assert done.stderr == ""
    rounds = int(args[args.index("--rounds") + 1])
    for name in ("model.eqx", f"checkpoint-{rounds}.eqx"):
        assert (folder / name).read_bytes() == (expected / name).read_bytes(), name
    assert timeless(folder) == timeless(expected)
    assert [line.round for line in read_metrics(folder)] == [*range(1, rounds + 1)]
    seconds = [line.seconds for line in read_metrics(folder)]
    assert seconds == sorted(seconds)
    # Nothing else is left of what was killed.
    others = {path.name for path in (*checkpoint.checkpoints(folder), folder / "learning-curve.png")}
    assert {path.name for path in folder.iterdir()} == {*others, "metrics.jsonl", "model.eqx"}


def test_a_full_disk_keeps_the_last_checkpoint(env: dict[str, str], tmp_path: Path, straight: Straight) -> None:
    expected, folder = straight(TABLE), tmp_path / "full"  # and whatever is to be compiled has been
    limit = (expected / "checkpoint-1.eqx").stat().st_size + 2_000  # a line of the curve takes 200
    done = trained(env, [str(limit), *TABLE], folder, ON_A_SMALL_DISK + SAVES_ALWAYS)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("sidestep: cannot write "), done.stderr
    assert len(done.stderr.splitlines()) == 1
    kept = len(checkpoint.load(folder).metadata.curve)
    assert 1 < kept < 100
    assert checkpoint.load_model(folder).metadata.curve == checkpoint.load(folder).metadata.curve
    assert [path for path in folder.iterdir() if path.name.startswith(".")] == []
    assert trained(env, [*TABLE, "--resume"], folder).returncode == 0
    assert (folder / "model.eqx").read_bytes() == (expected / "model.eqx").read_bytes()
