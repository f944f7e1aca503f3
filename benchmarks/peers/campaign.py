"""All peers side by side: ``make bench``, and ``make bench-smoke`` for a small run without timings.

Cold and warm runs are a process for each map, running ones a process for all maps of a seed. Peers take turns: each of
them learns a map before any learns the next. What they have learned is walked afterwards by Sidestep's functional core,
so that nobody's time includes the judging.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from statistics import median
from typing import Any

from environments import HERE, NotInstalledError, python_of
from problem import CONGESTED, PAPER, Problem, Task
from problems import SCENARIO, Judge, on_map
from registry import ABSENT, NEVER, PEERS, PROJECT, RUNNING, Peer

from sidestep import Scenario

ENOUGH = 1.0
"""Per cent over the optimum that are good enough."""


Lines = list[dict[str, Any]]
"""What a process printed."""


@dataclass(frozen=True)
class Turn:
    """One process that is to be measured."""

    peer: Peer
    task: Task
    state: str
    """``cold``: nothing is compiled yet; ``warm``: this peer has run here before; ``none``: it never compiles;
    ``running``: the process has learned another map before."""
    seed: int
    maps: tuple[int, ...]
    """Numbers of the maps that the process learns; the first one of ``running`` is not measured."""


def run_peer(
    turn: Turn, python: Path, problems: list[Path], cache: Path, seconds: float, core: int | None = None
) -> Lines:
    """Start a process that learns, and collect what it prints.

    Raises
    ------
    subprocess.SubprocessError
        It failed, or did not end by itself long after its time.
    """
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    if turn.peer.environment == PROJECT and "PYTHONPATH" in os.environ:
        environment["PYTHONPATH"] = os.environ["PYTHONPATH"]
    for name in ("SIDESTEP_CACHE", "XLA_FLAGS", "PJRT_NPROC"):  # all peers run as they come
        environment.pop(name, None)
    environment |= {
        "XDG_CACHE_HOME": f"{cache}",
        "JAX_COMPILATION_CACHE_DIR": f"{cache / 'jax'}",
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        "JAX_PLATFORMS": "cpu",
        "PEER_SECONDS": f"{seconds}",
        "PEER_CORE": "" if core is None else f"{core}",
    }
    command = [python, HERE / "protocol.py", turn.peer.runner, turn.peer.algorithm, f"{turn.seed}", *problems]
    patience = 3 * seconds * len(problems) + 120
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=patience)
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith('{"event"')]


def summed_up(turn: Turn, problem: Problem, judge: Judge, lines: Lines, end: dict[str, Any]) -> dict[str, Any]:
    """Judge what a process learned of one map, and sum up how fast."""
    *checks, learned = lines
    began = learned["began"]
    checks = [check | {"seconds": check["seconds"] - began} for check in checks]
    walked = judge.minutes([check["exits"] for check in checks if check["exits"]])
    own = [check["minutes"] for check in checks if check["minutes"] is not None]
    over = [100 * (minutes / problem.optimum - 1) for minutes in walked or own]
    there = next((check for check, gap in zip(checks, over, strict=True) if gap <= ENOUGH), None)
    return {
        "peer": turn.peer.name,
        "task": turn.task.name,
        "state": turn.state,
        "seed": turn.seed,
        "map": problem.index,
        "seconds_to_enough": there and there["seconds"],
        "transitions_to_enough": there and there["transitions"],
        "final_over_per_cent": over[-1],
        **rates(checks),
        "seconds": learned["seconds"] - began,
        "peak_mib": end["peak_mib"],
        "out_of_time": learned["out_of_time"],
        "over_per_cent": [
            [check["transitions"], round(check["seconds"], 3), gap] for check, gap in zip(checks, over, strict=True)
        ],
        "python": end["python"],
        "versions": end["versions"],
    }


def rates(checks: Lines) -> dict[str, Any]:
    """How much was learned from, and how fast after the first look, which waits for the compiler."""
    first, last = checks[0], checks[-1]
    done = {name: last[name] for name in ("transitions", "updates")}
    spent = [
        (after["seconds"] - before["seconds"], after["transitions"] - before["transitions"])
        for before, after in pairwise(checks)
    ]
    if not spent:
        return done | dict.fromkeys(("transitions_per_second", "updates_per_second", "microseconds_a_step"))
    seconds = sum(took for took, _ in spent)
    per_second = {f"{name}_per_second": (last[name] - first[name]) / seconds for name in done}
    return done | per_second | {"microseconds_a_step": median(1e6 * took / steps for took, steps in spent)}


def turns(peers: list[Peer], options: argparse.Namespace) -> Iterator[Turn]:
    """All measurements, peers in turn."""
    maps = [*((index,) for index in range(options.maps)), (options.maps, *range(options.maps))]
    for seed, numbers, peer in product(range(options.seeds), maps, peers):
        for state in peer.states:
            if state in (*options.states, NEVER) and (state == RUNNING) == (len(numbers) > 1):
                yield Turn(peer, CONGESTED, state, seed, numbers)
    for number, peer in product(range(options.turns), peers):
        if peer.paper_steps:
            task = replace(PAPER, transitions=peer.paper_steps, check_every=peer.paper_steps // 6)
            yield Turn(peer, task, "warm" if peer.jax else NEVER, number, (0,))


def measure(turn: Turn, python: Path, folder: Path, limit: float, given: Scenario = SCENARIO) -> list[dict[str, Any]]:
    """Run one process, and judge what it learned of each map."""
    judged, paths = [on_map(turn.task, turn.seed, index, given) for index in turn.maps], []
    for problem, _ in judged:
        paths.append(folder / f"problem-{problem.index}.npz")
        problem.save(paths[-1])
    core = min(os.sched_getaffinity(0)) if turn.task.walkers == 1 else None
    kept = folder / "caches" / f"{turn.peer.runner}-{turn.peer.algorithm}-{turn.task.name}"
    with tempfile.TemporaryDirectory() as empty:
        cache = kept if turn.state == "warm" else Path(empty)
        if turn.state == "warm" and not kept.exists():
            kept.mkdir(parents=True)
            run_peer(turn, python, paths, cache, limit, core)
        *lines, end = run_peer(turn, python, paths, cache, limit, core)
    ends = [number for number, line in enumerate(lines) if line["event"] == "learned"]
    parts = [lines[after + 1 : until + 1] for after, until in pairwise([-1, *ends])]
    runs = [summed_up(turn, *each, part, end) for each, part in zip(judged, parts, strict=True)]
    return runs[turn.state == RUNNING :]


def installed(peers: list[Peer]) -> tuple[dict[str, Path], dict[str, str]]:
    """Make the environments of peers.

    Returns
    -------
    pythons, reasons
        The interpreter of each environment, and why there are no others.
    """
    pythons, reasons = {}, {}
    for environment in dict.fromkeys(peer.environment for peer in peers):
        try:
            pythons[environment] = python_of(environment)
        except NotInstalledError as error:
            reasons[environment] = f"{error}"
            print(f"SKIPPED: {environment} does not install: {error}", file=sys.stderr, flush=True)
    return pythons, reasons


def machine() -> dict[str, Any]:
    """What this machine is."""
    models = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "processor": models[0].partition(":")[2].strip() if models else platform.processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gib": round(memory / 2**30, 1),
        "system": platform.platform(),
        "load_before": os.getloadavg()[0],
    }


def chosen(names: list[str]) -> list[Peer]:
    """The peers whose names contain one of some words."""
    return [peer for peer in PEERS if not names or any(name.lower() in peer.name.lower() for name in names)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", nargs="+", default=[], help="words of their names; by default all")
    parser.add_argument("--maps", type=int, default=3, help="maps of each seed")
    parser.add_argument("--seeds", type=int, default=5, help="of maps and of learners")
    states = ["cold", "warm", RUNNING]
    parser.add_argument("--states", nargs="+", default=states, choices=states, help="in which maps are learned")
    parser.add_argument("--turns", type=int, default=3, help="at the paper's sizes")
    parser.add_argument("--limit", type=float, default=60, help="seconds after which a run is ended")
    parser.add_argument("--out", type=Path, default=HERE.parent / "peers.json")
    options = parser.parse_args()
    peers = chosen(options.peers)
    pythons, reasons = installed(peers)
    found: dict[str, Any] = {
        "command": " ".join(["python", "benchmarks/peers/campaign.py", *sys.argv[1:]]),
        "machine": machine(),
        "tasks": [asdict(CONGESTED), asdict(PAPER)],
        "limit_seconds": options.limit,
        "peers": [asdict(peer) for peer in peers if peer.environment in pythons],
        "skipped": {peer.name: reasons[peer.environment] for peer in peers if peer.environment in reasons},
        "absent": ABSENT,
        "failed": [],
        "runs": [],
    }
    planned = [turn for turn in turns(peers, options) if turn.peer.environment in pythons]
    with tempfile.TemporaryDirectory() as folder:
        for number, turn in enumerate(planned, 1):
            try:
                runs = measure(turn, pythons[turn.peer.environment], Path(folder), options.limit)
            except subprocess.SubprocessError as error:
                why = (getattr(error, "stderr", None) or f"{error}").strip().rpartition("\n")[2]
                found["failed"].append([turn.peer.name, turn.task.name, turn.state, turn.seed, turn.maps[-1], why])
                print(f"FAILED: {turn.peer.name}: {why}", file=sys.stderr, flush=True)
                continue
            found["runs"] += runs
            options.out.write_text(json.dumps(found, indent=1) + "\n")
            for run in runs:
                print(f"{number}/{len(planned)} {said(run)}", file=sys.stderr, flush=True)


def said(run: dict[str, Any]) -> str:
    """One line about a run."""
    there = run["seconds_to_enough"]
    reached = f"{there:.2f} s to {ENOUGH:g} %" if there else f"never within {ENOUGH:g} %"
    how = f"{run['microseconds_a_step']:.1f} µs a step" if run["task"] == PAPER.name else reached
    return f"{run['peer']}, {run['task']}, {run['state']}, seed {run['seed']}, map {run['map']}: {how}"


if __name__ == "__main__":
    main()
