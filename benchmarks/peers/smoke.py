"""Every peer that installs, and the examples that need one, for a few seconds each: ``make bench-smoke``.

It asserts nothing about time. Peers must run, report what they learned, and find a way across a small map.
"""

import os
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from campaign import Turn, installed, measure
from environments import HERE
from problem import CONGESTED, PAPER
from registry import NEVER, PEERS, RUNNING, Peer

from sidestep import scenario

SMALL = scenario("paper-congested", flows="forecast", side=4, crowded_nodes=2)
SHORT = replace(CONGESTED, transitions=25_600)
FEW = replace(PAPER, transitions=600, check_every=100)
PATIENCE = 600.0
"""Seconds that a run may take."""
ROOT = HERE.parents[1]
EXAMPLES = {"examples/own_maskable_ppo.py": "stable-baselines3"}
"""Examples that need a peer's environment."""


def checked(peer: Peer, python: Path) -> str:
    """Run a peer on a small map, and say what it learned.

    Raises
    ------
    AssertionError
        It did not learn, or did not report it.
    """
    state = "cold" if peer.jax else NEVER
    with tempfile.TemporaryDirectory() as folder:
        given = python, Path(folder), PATIENCE, SMALL
        (run,) = measure(Turn(peer, SHORT, state, 0, (0,)), *given)
        (again,) = measure(Turn(peer, SHORT, RUNNING, 0, (1, 0)), *given)
        for each in measure(Turn(peer, FEW, state, 0, (0,)), *given) if peer.paper_steps else []:
            check_sums(each)
    for each in (run, again):
        assert not each["out_of_time"], "it took too long"
        check_sums(each)
    least = max(min(over for *_, over in each["over_per_cent"]) for each in (run, again))
    assert least < 100, "it never found a good way across"
    return f"{least:.1f} % over the optimum at best"


def check_sums(run: dict[str, Any]) -> None:
    """What a run says of itself must be possible."""
    assert 0 < run["updates"] <= 4 * run["transitions"]
    assert run["transitions_per_second"] > 0
    assert run["updates_per_second"] >= 0
    assert run["peak_mib"] > 10
    assert run["versions"]
    looks = [transitions for transitions, *_ in run["over_per_cent"]]
    assert looks == sorted(set(looks))
    assert all(over > -0.1 for *_, over in run["over_per_cent"]), "nobody beats the optimum"


def example(file: str, python: Path) -> str:
    """Run an example, and return the end of what it prints."""
    environment = os.environ | {"PYTHONPATH": f"{ROOT / 'src'}"}
    command = [python, ROOT / file]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()[-200:]


def main() -> None:
    pythons, reasons = installed(list(PEERS))
    named = {peer.name: (peer.environment, partial(checked, peer)) for peer in PEERS}
    named |= {file: (environment, partial(example, file)) for file, environment in EXAMPLES.items()}
    counts = Counter[str]()
    for name, (environment, run) in named.items():
        if environment in reasons:
            outcome, words = "skipped", reasons[environment]
        else:
            try:
                outcome, words = "passed", run(pythons[environment])
            except (AssertionError, subprocess.SubprocessError) as error:
                outcome, words = "failed", getattr(error, "stderr", None) or f"{error}"
        counts[outcome] += 1
        print(f"{outcome:8} {name}: {words}", flush=True)
    print(f"{counts['passed']} passed, {counts['failed']} failed, {counts['skipped']} skipped")
    sys.exit(bool(counts["failed"]))


if __name__ == "__main__":
    main()
