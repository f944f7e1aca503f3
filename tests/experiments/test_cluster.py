"""Sweeps on a real scheduler of Dask with real workers, by the commands of examples/deploy/compose.yaml."""

import os
import signal
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from sidestep.cli import app as cli
from sidestep.errors import SidestepError
from sidestep.experiments import cluster
from sidestep.experiments.study import read_study
from sidestep.experiments.sweep import sweep

from .processes import alive, children, until, walks_of

SERVICES = yaml.safe_load((Path(__file__).parents[2] / "examples/deploy/compose.yaml").read_text())["services"]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


@pytest.fixture
def dask(start) -> Callable[..., tuple]:
    """The services as they stand in the file, but on this machine alone, the scheduler first."""

    def run(workers: int) -> tuple:
        port = free_port()

        def service(name: str):
            words = (
                SERVICES[name]["command"]
                .replace("--host 0.0.0.0", "--host 127.0.0.1")
                .replace("//scheduler", "//127.0.0.1")
            )
            command = words.replace("8786", str(port)).split()
            assert command[0] == "dask"
            return start(*command[1:], program=("-m", "dask"), **SERVICES[name].get("environment", {}))

        begun = [service("scheduler"), *(service("worker") for _ in range(workers))]
        return f"tcp://127.0.0.1:{port}", begun

    return run


def test_a_cluster_whose_worker_is_killed_finds_what_this_machine_finds(small, dask, start, tmp_path) -> None:
    file, out = small(tmp_path, "seeds = [0, 1]", rounds=1500), tmp_path / "out"
    address, (_, *workers) = dask(2)
    process = start("sweep", file, "--scheduler", address, "--out", "out")
    until(lambda: list(out.glob("*default/checkpoint*")))  # the workers have this folder as well
    (busy,) = children(workers[0].pid)  # of its nanny, which starts another
    os.kill(busy, signal.SIGKILL)
    stdout, stderr = process.communicate(timeout=120)
    assert process.returncode == 0, (stdout, stderr)
    assert not alive(busy)
    alone = sweep(read_study(file), tmp_path / "alone", workers=2)
    assert walks_of(out) == {name: result["records"] for name, result in alone.results.items()}


def test_a_scheduler_that_is_killed(small, dask, start, tmp_path) -> None:
    file, out = small(tmp_path, rounds=10**6), tmp_path / "out"
    address, (scheduler, _) = dask(1)
    process = start("sweep", file, "--scheduler", address, "--out", "out")
    until(lambda: list(out.glob("*default/checkpoint*")))
    scheduler.kill()
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == cli.BAD_INPUT
    assert len(stderr.splitlines()) == 1, stderr
    assert len(walks_of(out)) == 1


def test_workers_elsewhere_send_their_files(small, dask, monkeypatch, tmp_path) -> None:
    address, _ = dask(1)
    study = read_study(small(tmp_path))
    out = tmp_path / "out"
    run = cluster.run_on_cluster
    monkeypatch.setattr(cluster, "run_on_cluster", lambda jobs, out, address, _: run(jobs, out, address, "elsewhere"))
    found = sweep(study, out, scheduler=address)
    assert not found.failed
    *_, job = study.jobs
    assert {path.name for path in (out / job.name).iterdir()} >= {"job.json", "model.eqx", "result.json"}
    again = sweep(study, out)  # nothing is left to do
    assert again.results == found.results


def test_no_scheduler(small, monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    for address in (f"tcp://127.0.0.1:{free_port()}", "nowhere", "ftp://127.0.0.1:1", "tls://127.0.0.1:1"):
        with pytest.raises(SidestepError) as error:
            sweep(read_study(small(tmp_path)), tmp_path / "out", scheduler=address)
        assert error.value.field == "scheduler"
    command = ["sweep", str(small(tmp_path)), "--scheduler", "nowhere", "--out", str(tmp_path / "out")]
    assert cli.run(command) == cli.BAD_INPUT
    assert len(capsys.readouterr().err.splitlines()) == 1
