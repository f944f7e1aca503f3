"""Seconds until all workers of all servers go on from a count that is posted to one of them.

    python benchmarks/news.py --store postgresql://sidestep@127.0.0.1/town --servers 2 --workers 2

Every worker has listeners of ``/events``, which hear once its crowds have gone on: what is measured is the time from
the begin of the POST until the last of them has heard. Counts are posted to the servers in turn, at random times. Those
that are refused, since the database is away, are posted again, and measured from there. A listener that misses a count
ends the run.
"""

import argparse
import json
import queue
import sys
import threading
import time
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from itertools import count
from urllib.request import urlopen

import httpx
import numpy as np
from serving import free_port, server

LISTENERS = 8
"""Of each worker: the system deals them out by chance."""
PATIENCE = 60.0


def listen(port, heard):
    """Put down when each event comes."""
    with urlopen(f"http://127.0.0.1:{port}/events", timeout=PATIENCE) as answer:
        kind = ""
        for line in answer:
            if line.startswith(b"event: "):
                kind = line.decode().split()[1]
            elif line.startswith(b"data: ") and kind == "crowds":
                heard.put((json.loads(line[6:])["version"], time.perf_counter()))


def post(port, row):
    """Post a count until it is taken; when that began, for how long it took, and how often it was refused."""
    for refused in count():
        begun = time.perf_counter()
        answer = httpx.post(f"http://127.0.0.1:{port}/counts", json=row, timeout=PATIENCE)
        if answer.status_code != 503:
            answer.raise_for_status()
            return begun, time.perf_counter() - begun, refused
        time.sleep(0.05)
    raise AssertionError


def last_to_hear(listeners, known):
    """When the last listener has heard of crowds that none has heard of before, and their version."""
    heard = []
    for each in listeners:
        version, at = each.get(timeout=PATIENCE)
        while version <= known:
            version, at = each.get(timeout=PATIENCE)
        heard.append((version, at))
    assert len({version for version, _ in heard}) == 1
    return max(at for _, at in heard), heard[0][0]


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--store", required=True, help="an empty database, or a new file")
    options.add_argument("--scenario", default="helsinki")
    options.add_argument("--servers", type=int, default=2)
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--posts", type=int, default=40)
    given = options.parse_args()
    rng, known, waited, took = np.random.default_rng(1), -1, [], []
    with ExitStack() as stack:
        ports, listeners = [], []
        for _ in range(given.servers):
            ports.append(free_port())
            command = [sys.executable, "-m", "sidestep", "serve", given.scenario, "--port", str(ports[-1])]
            command += ["--store", given.store, "--workers", str(given.workers), "--rate", "1e6"]
            stack.enter_context(server(command, ports[-1]))
        with urlopen(f"http://127.0.0.1:{ports[0]}/sensors", timeout=PATIENCE) as answer:
            sensor = json.load(answer)["features"][0]["properties"]["sensor"]
        for port in ports * given.workers * LISTENERS:
            listeners.append(queue.SimpleQueue())
            threading.Thread(target=listen, args=(port, listeners[-1]), daemon=True).start()
        begins = datetime.now(UTC).replace(minute=0, second=0, microsecond=0) - timedelta(hours=1)
        for number in range(given.posts + 2):
            time.sleep(rng.uniform(0.5, 2.0))
            row = {"sensor": sensor, "time": begins.isoformat(), "count": 100 + number}
            begun, seconds, refused = post(ports[number % len(ports)], row)
            last, known = last_to_hear(listeners, known)
            if refused:
                print(
                    f"post {number} was refused {refused} times; then all heard within {last - begun:.2f} s", flush=True
                )
            if number >= 2:  # the first go on from counts for the first time
                waited.append(last - begun)
                took.append(seconds)
    for name, times in (("POST /counts answered", took), (f"all {len(listeners)} listeners told", waited)):
        low, half, high, worst = np.quantile(times, (0.05, 0.5, 0.95, 1.0))
        print(f"{name:30s} 5 % {low:.3f}  half {half:.3f}  95 % {high:.3f}  worst {worst:.3f} s")


if __name__ == "__main__":
    main()
