"""How a peer is run: ``python protocol.py RUNNER ALGORITHM SEED PROBLEM...`` learns, and prints lines of JSON.

A runner is a module of ``runners/`` with a function ``learn(algorithm, problem, seed, on_check)``. It calls the latter
each time that it has looked at what is learned, and leaves judging to the campaign: nobody's time includes it. Seconds
count from the start of the process as the kernel knows it, so that the interpreter and all imports are part of them.
"""

import importlib
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
from problem import Problem, load_problem

SECONDS = float(os.environ.get("PEER_SECONDS", "120"))
"""After this time with one problem learning ends wherever it is."""
CORE = os.environ.get("PEER_CORE")
"""Number of the only core to be used, if any."""


class OutOfTimeError(Exception):
    """Ends a run."""


class OnCheck:
    """Prints what has been learned, and when."""

    def __init__(self, began: float) -> None:
        self.began, self.out_of_time = began, False

    def __call__(
        self,
        transitions: int,
        updates: int,
        exits: Sequence[int] | np.ndarray | None = None,
        minutes: float | None = None,
    ) -> None:
        """Report a look at what is learned.

        Parameters
        ----------
        transitions, updates
            Steps of all walkers, and gradient steps, so far.
        exits
            The exit that the greedy walker takes at each crossing.
        minutes
            Instead of these, the time of the greedy walk, where the learner walks it itself.
        """
        seconds = since_start()
        said = None if exits is None else [int(each) for each in exits]
        show(event="check", seconds=seconds, transitions=transitions, updates=updates, exits=said, minutes=minutes)
        if seconds - self.began > SECONDS:
            self.out_of_time = True
            raise OutOfTimeError


Learn = Callable[[str, Problem, int, OnCheck], None]


def since_start() -> float:
    """Seconds since this process started."""
    started = Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]  # field 22, in ticks since boot
    return time.clock_gettime(time.CLOCK_BOOTTIME) - int(started) / os.sysconf("SC_CLK_TCK")


def peak_mib() -> float:
    """The most memory that this process held, MiB; ``getrusage`` counts what its parent held when it started it."""
    return int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1024


def show(**values: object) -> None:
    """Print a line of JSON."""
    print(json.dumps(values), flush=True)


def main() -> None:
    runner, algorithm, seed, *paths = sys.argv[1:]
    if CORE:
        os.sched_setaffinity(0, {int(CORE)})  # before any library counts the cores
    learn: Learn | None = None
    for path in paths:
        began = since_start() if learn else 0.0  # imports are part of the first problem's time
        learn = learn or importlib.import_module(f"runners.{runner}").learn
        on_check = OnCheck(began)
        try:
            learn(algorithm, load_problem(Path(path)), int(seed), on_check)
        except Exception:
            if not on_check.out_of_time:  # compiled programs wrap what callbacks raise
                raise
        show(event="learned", began=began, seconds=since_start(), out_of_time=on_check.out_of_time)
    show(
        event="end",
        peak_mib=peak_mib(),
        python=sys.version.split()[0],
        versions={name: version(name) for name in importlib.import_module(f"runners.{runner}").PACKAGES},
    )


if __name__ == "__main__":
    main()
