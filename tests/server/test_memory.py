"""Memory of a server that is asked a lot: what it keeps is bounded."""

import asyncio
import os
import random
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from .processes import Server, serving

pytestmark = pytest.mark.stress
REQUESTS, CONNECTIONS, WARM = 100_000, 16, 20_000
MORE = 48 * 2**20  # bytes by which it may grow after the first requests
WEST, SOUTH, EAST, NORTH = 24.9380, 60.1655, 24.9520, 60.1780  # central Helsinki


def memory(server: Server) -> int:
    """Bytes of it that are in memory."""
    pages = Path(f"/proc/{server.process.pid}/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    """``sidestep serve`` of Helsinki, as users' computers compile it, and prepared."""
    environ = {each: value for each, value in os.environ.items() if each != "JAX_DISABLE_MOST_OPTIMIZATIONS"}
    with serving(tmp_path, "helsinki", "--rate", "1000000", environ=environ) as running:
        running.wait_until(lambda said: said["prepared"], 300)
        yield running


def place(rng: random.Random) -> str:
    return f"{rng.uniform(WEST, EAST):.5f},{rng.uniform(SOUTH, NORTH):.5f}"


async def ask(server: Server, paths: list[str]) -> list[int]:
    """Ask all, some at a time; the statuses."""
    statuses: list[int] = []
    left = iter(paths)

    async def client() -> None:
        async with httpx.AsyncClient(base_url=server.url, timeout=120) as asked:
            for path in left:
                statuses.append((await asked.get(path)).status_code)  # noqa: PERF401 - as they come

    await asyncio.gather(*(client() for _ in range(CONNECTIONS)))
    return statuses


def test_memory_is_flat_over_many_routes(server: Server) -> None:
    """Between random places at any hour of an evening; tables of these hours are worked out and kept first."""
    rng = random.Random(0)

    def routes(number: int) -> list[str]:
        return [
            f"/route/v1/foot/{place(rng)};{place(rng)}?steps=true&overview=full"
            f"&depart_at=Fri%20{rng.choice((16, 17, 18))}:{rng.randrange(60):02}"
            for _ in range(number)
        ]

    asyncio.run(ask(server, routes(WARM)))
    seen, begun = [memory(server)], time.monotonic()
    for _ in range(10):
        statuses = asyncio.run(ask(server, routes(REQUESTS // 10)))
        assert statuses.count(200) > 0.99 * len(statuses)
        seen.append(memory(server))
    print(f"{REQUESTS} routes in {time.monotonic() - begun:.0f} s; MiB: {[round(each / 2**20) for each in seen]}")
    assert seen[-1] - seen[0] < MORE


def test_memory_is_bounded_over_many_walkers(server: Server) -> None:
    """For each of them programs are compiled."""
    seen = []
    for number in range(64):
        path = f"/route/v1/foot/24.9414,60.1719;24.948,60.166?walker=older,free_speed={1 + number / 100}"
        assert httpx.get(f"{server.url}{path}", timeout=120).status_code == 200
        seen.append(memory(server))
    print(f"MiB after 16, 32, 48 and 64 walkers: {[round(each / 2**20) for each in seen[15::16]]}")
    assert max(seen[48:]) < max(seen[:32]) + MORE
