"""Time of training rounds on whatever device JAX chooses: environment steps and gradient steps a second.

Usage: python benchmarks/rounds.py [--case NAME] [--rounds N] [--json]; JAX_PLATFORMS=cpu keeps it from a GPU.
"""

import argparse
import json
import statistics
from contextlib import suppress
from itertools import pairwise
from time import perf_counter, process_time

import jax

from sidestep.agent.presets import preset
from sidestep.agent.runs import train
from sidestep.scenarios.builtin import scenario

CASES = {
    "default": ("paper-congested", "default", "position"),
    "paper": ("paper-congested", "paper", "position"),
    "local": ("rush-16", "default", "local"),
    "map": ("rush-16", "default", "map"),
}
"""Scenario, preset and level of each case."""


def timed(case, rounds):
    """Train for some rounds: seconds to the end of the first, and seconds of each later one."""
    name, chosen, level = CASES[case]
    problem = scenario(name)
    config = preset(chosen, level, nodes=problem.place.nodes)
    ends = []

    def on_round(_run):
        ends.append((perf_counter(), process_time()))
        if len(ends) > rounds:
            raise StopIteration

    began = perf_counter(), process_time()
    with suppress(StopIteration):
        train(problem, config, on_round=on_round)
    took, cpu = ([later[clock] - earlier[clock] for earlier, later in pairwise(ends)] for clock in (0, 1))
    return {
        "case": case,
        "first_round_s": ends[0][0] - began[0],
        "round_s": statistics.median(took),
        "round_cpu_s": statistics.median(cpu),
        "us_an_iteration": 1e6 * statistics.median(took) / config.iterations,
        "steps_per_s": config.round_steps / statistics.median(took),
        "updates_per_s": config.iterations / statistics.median(took),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", choices=CASES, action="append", help="by default all")
    parser.add_argument("--rounds", type=int, default=10, help="timed rounds after the first")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    device = jax.devices()[0]
    rows = [timed(case, options.rounds) for case in options.case or CASES]
    if options.json:
        print(json.dumps({"device": device.device_kind, "jax": jax.__version__, "cases": rows}, indent=1))
        return
    print(f"{device.device_kind}, JAX {jax.__version__}")
    print("case       first round, s   a round, s   us an iteration   steps/s     updates/s")
    for row in rows:
        print(
            f"{row['case']:10} {row['first_round_s']:14.2f} {row['round_s']:12.3f} {row['us_an_iteration']:17.0f} "
            f"{row['steps_per_s']:9,.0f} {row['updates_per_s']:13,.0f}"
        )


if __name__ == "__main__":
    main()
