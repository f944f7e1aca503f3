"""Measure one step with its gradient step: Sidestep's ``paper`` preset beside ``peers/plain_jax.py`` at the same sizes.

Both learn one congested 6 x 6 map in 64 futures: two inputs, two hidden layers of 50, dueling heads, batches of 32 from
the latest 10,000 steps, RMSProp, a target that is copied every 200 steps. The plain file does so with priorities, as
the preset does, and without. Each side is a process of its own, pinned to one core where the system can; they take
turns, so that whatever else runs meets all of them. Processor time stands beside wall time: it leaves waiting out.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time

STEPS = 10_000
PRIORITISED, UNIFORM, PRESET = "plain JAX file, prioritised", "plain JAX file, uniform", "Sidestep, preset paper"
SIDES = (PRIORITISED, UNIFORM, PRESET)


def save_map(path: Path) -> None:
    """Write the map in the arrays that the plain file reads."""
    import numpy as np

    from sidestep.scenarios.builtin import scenario
    from sidestep.scenarios.futures import make_environment
    from sidestep.scenarios.maps import draw_map

    problem = scenario("paper-congested")
    params = make_environment(problem, draw_map(problem, seed=0), "learn", 64)
    network, speeds, weights = params.network, params.futures.speeds, params.reward
    np.savez(
        path,
        exit_node=network.exit_node,
        exit_segment=network.exit_segment,
        length=np.asarray(network.length, float),
        speed=speeds.speed,
        position=np.asarray(network.position, float),
        slot_seconds=float(speeds.slot_seconds),
        origin=0,
        destination=network.nodes - 1,
        horizon=problem.horizon,
        unit_seconds=weights.unit_seconds,
        progress=weights.progress,
        bonus=weights.bonus,
        optimum=np.nan,
    )


def plain(path: Path, *, prioritised: bool) -> Callable[[], object]:
    """A function that takes so many steps of the plain file."""
    sys.path.insert(0, str(Path(__file__).parent / "peers"))
    import plain_jax

    settings = plain_jax.replace(plain_jax.PAPER, prioritised=prioritised)
    rounds = plain_jax.rounds(settings, plain_jax.read(path)[0], 0, STEPS)
    next(rounds)
    return lambda: next(rounds)


def preset() -> Callable[[], object]:
    """A function that takes so many steps of the preset, and one set of test walks."""
    import jax

    from sidestep.agent.presets import PRESETS
    from sidestep.agent.train import training_rounds
    from sidestep.scenarios.builtin import scenario
    from sidestep.scenarios.maps import draw_map

    problem = scenario("paper-congested")
    config = PRESETS["paper"].changed(rounds=10_000, round_steps=STEPS)
    rounds = training_rounds(config, problem, draw_map(problem, seed=0))
    return lambda: jax.block_until_ready(next(rounds)[1])


def serve(side: str, path: Path) -> None:
    """Take turns: for every line that comes in, print the microseconds of a step, wall and processor time."""
    turn = preset() if side == PRESET else plain(path, prioritised=side == PRIORITISED)
    turn()
    for _ in sys.stdin:
        wall, processor = perf_counter(), process_time()
        turn()
        print(
            json.dumps([1e6 * (perf_counter() - wall) / STEPS, 1e6 * (process_time() - processor) / STEPS]), flush=True
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=10, help="timed turns of each, 10,000 steps long")
    parser.add_argument("--core", type=int, default=0, help="the core to run on")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    parser.add_argument("--side", choices=SIDES, help=argparse.SUPPRESS)
    parser.add_argument("--map", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.side:
        serve(options.side, options.map)
        return
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {options.core})  # the processes below inherit it
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.npz"
        save_map(path)
        found = in_turns(path, options.repeats)
    if options.json:
        print(json.dumps(found, indent=1))
        return
    for side, row in found.items():
        wall, processor = (statistics.median(row[name]) for name in ("wall", "processor"))
        print(f"{side:28} {wall:6.1f} us a step, processor {min(row['processor']):6.1f} ({processor:.1f})", end="")
        print(f"   ratio {row['ratio']:.3f}, processor {row['processor_ratio']:.3f}")


def in_turns(path: Path, repeats: int) -> dict[str, dict]:
    """Times of all sides, and medians of their ratios to the prioritised plain file, turn by turn."""
    command = [sys.executable, __file__, "--map", str(path), "--side"]
    processes = {
        side: subprocess.Popen([*command, side], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for side in SIDES
    }
    times: dict[str, list[list[float]]] = {side: [] for side in SIDES}
    try:
        for _ in range(repeats):
            for side, process in processes.items():
                process.stdin.write("\n")
                process.stdin.flush()
                times[side].append(json.loads(process.stdout.readline()))
    finally:
        for process in processes.values():
            process.stdin.close()
            process.wait()
    rows = {
        side: dict(zip(("wall", "processor"), zip(*rows, strict=True), strict=True)) for side, rows in times.items()
    }
    for row in rows.values():
        for name, ratio in (("wall", "ratio"), ("processor", "processor_ratio")):
            pairs = zip(row[name], rows[PRIORITISED][name], strict=True)
            row[ratio] = statistics.median(one / other for one, other in pairs)
    return rows


if __name__ == "__main__":
    main()
