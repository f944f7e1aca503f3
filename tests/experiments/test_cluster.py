"""Sweeps on a real scheduler of Dask with real workers, by the commands of examples/deploy/compose.yaml."""

import asyncio
import os
import re
import shutil
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml
from dask import config as settings

from sidestep.cli import app as cli
from sidestep.errors import SidestepError
from sidestep.experiments import cluster
from sidestep.experiments.study import Study, read_study
from sidestep.experiments.sweep import sweep

from .processes import alive, children, until, walks_of

DOCS = Path(__file__).parents[2] / "docs/sweeps.md"
SERVICES = yaml.safe_load((Path(__file__).parents[2] / "examples/deploy/compose.yaml").read_text())["services"]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


@pytest.fixture
def certificates(tmp_path, monkeypatch) -> Iterator[None]:
    """An authority and its certificates, by the commands of docs/sweeps.md, and those of another one in ``others``."""
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl")
    (commands,) = re.findall(r"```sh\n(openssl .*?)```", DOCS.read_text(), re.DOTALL)
    for folder in (tmp_path, tmp_path / "others"):
        folder.mkdir(exist_ok=True)
        subprocess.run(["sh", "-ec", commands], cwd=folder, check=True, capture_output=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION", "true")
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TLS__CA_FILE", "ca.pem")
    for who in ("scheduler", "worker", "client"):
        for what, file in (("CERT", f"{who}.pem"), ("KEY", f"{who}-key.pem")):
            monkeypatch.setenv(f"DASK_DISTRIBUTED__COMM__TLS__{who.upper()}__{what}", file)
    settings.refresh()
    yield
    monkeypatch.undo()
    settings.refresh()


@pytest.fixture
def dask(start) -> Callable[..., tuple]:
    """The services as they stand in the file, but on this machine alone, the scheduler first."""

    def run(workers: int, scheme: str = "tcp") -> tuple:
        port = free_port()

        def service(name: str):
            words = (
                SERVICES[name]["command"]
                .replace("--host 0.0.0.0", "--host 127.0.0.1")
                .replace("tcp://scheduler", f"{scheme}://127.0.0.1")
            )
            command = words.replace("8786", str(port)).split()
            assert command[0] == "dask"
            return start(*command[1:], program=("-m", "dask"), **SERVICES[name].get("environment", {}))

        begun = [service("scheduler"), *(service("worker") for _ in range(workers))]
        return f"{scheme}://127.0.0.1:{port}", begun

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


@pytest.mark.usefixtures("certificates")
def test_workers_elsewhere_send_their_files_over_tls(small, dask, monkeypatch, tmp_path) -> None:
    address, _ = dask(1, "tls")
    study = read_study(small(tmp_path))
    out = tmp_path / "out"
    run = cluster.run_on_cluster
    monkeypatch.setattr(cluster, "run_on_cluster", lambda client, jobs, out, _: run(client, jobs, out, "elsewhere"))
    found = sweep(study, out, scheduler=address)
    assert not found.failed
    *_, job = study.jobs
    assert {path.name for path in (out / job.name).iterdir()} >= {"job.json", "model.eqx", "result.json"}
    again = sweep(study, out)  # nothing is left to do
    assert again.results == found.results
    for wrong in (
        {"ca-file": "others/ca.pem"},
        {"client.cert": "others/client.pem", "client.key": "others/client-key.pem"},
    ):
        with settings.set({f"distributed.comm.tls.{name}": file for name, file in wrong.items()}):
            assert next(iter(wrong)) in refused(address, study, out)


def refused(address: str, study: Study, out: Path) -> str:
    """What is said about a scheduler."""
    with pytest.raises(SidestepError) as error:
        sweep(study, out, scheduler=address)
    assert error.value.field == "scheduler"
    return str(error.value)


@pytest.mark.usefixtures("certificates")
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"ca-file": None}, "ca-file"),
        ({"client.cert": None}, "client.cert"),
        ({"client.key": None}, "client.key"),  # nor is it in the certificate's file
        ({"client.key": "nowhere.pem"}, "nowhere.pem"),
        ({"client.key": "worker-key.pem"}, "a pair"),
        ({"ca-file": "small.toml"}, "PEM"),
    ],
)
def test_certificates_that_are_missing_or_wrong_are_named(small, tmp_path, wrong: dict, said: str) -> None:
    study = read_study(small(tmp_path))
    with settings.set({f"distributed.comm.tls.{name}": file for name, file in wrong.items()}):
        assert said in refused("tls://127.0.0.1:1", study, tmp_path / "out")
    assert "tls://" in refused("tcp://127.0.0.1:1", study, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_is_no_scheduler_is_said_to_be_none(small, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    study = read_study(small(tmp_path))

    def asked(server: socket.socket) -> str:
        return refused(f"tcp://127.0.0.1:{server.getsockname()[1]}", study, tmp_path / "out")

    def answer(server: socket.socket) -> None:
        with server.accept()[0] as connection:
            connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
            connection.recv(1)

    async def in_a_notebook(server: socket.socket) -> str:
        return asked(server)

    with socket.create_server(("127.0.0.1", 0)) as silent:
        assert "connected, but nothing came" in asked(silent)
        assert "connected, but nothing came" in asyncio.run(in_a_notebook(silent))
    with socket.create_server(("127.0.0.1", 0), backlog=0) as full, socket.create_connection(full.getsockname()):
        assert "connected" not in asked(full)  # as behind a firewall, nobody answers
    with socket.create_server(("127.0.0.1", 0)) as page:
        threading.Thread(target=answer, args=(page,)).start()
        assert "web server" in asked(page)
    assert not (tmp_path / "out").exists()


def test_no_scheduler(small, monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        for address in (
            f"tcp://127.0.0.1:{free_port()}",
            f"tcp://127.0.0.1:{silent.getsockname()[1]}",
            "ftp://nowhere",
        ):
            refused(address, read_study(small(tmp_path)), tmp_path / "out")
    for command in (["sweep", str(small(tmp_path))], ["reproduce", "--quick"]):
        assert cli.run([*command, "--scheduler", "nowhere", "--out", str(tmp_path / "out")]) == cli.BAD_INPUT
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "out").exists()
