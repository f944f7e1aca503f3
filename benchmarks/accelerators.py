"""What a GPU changes: many walkers side by side in one training, and many maps trained at once.

Usage: python benchmarks/accelerators.py walkers|steps|maps|in-turn|processes [--case NAME] [--number N ...] [--json]

JAX chooses the device; JAX_PLATFORMS=cpu keeps it from a GPU. Each figure is printed as soon as it is there.

walkers
    Transitions a second of trainings with that number of walkers, and a gradient step on the preset's batch for each
    step of all of them. Random numbers are drawn as in every training, test walks are left out.
steps
    The same walkers in the environment alone: they take random exits.
maps
    That number of paper maps trained to the end by the preset ``default`` in one program, ``jax.vmap`` of a training.
in-turn
    The same maps one after the other, as ``sidestep train`` does it.
processes
    The same maps on as many processes as there are processors, of one thread each, as ``sidestep sweep`` does it.
"""

import argparse
import json
import math
import os
import statistics
from functools import partial
from time import perf_counter

CASES = {"position": ("paper-congested", "position"), "map": ("rush-16", "map")}
"""Scenario and level of trainings with many walkers, by the preset ``default``."""
TRANSITIONS = 2_000_000
"""Most in one timed turn; turns have up to 100 iterations, as a round of the preset at level ``map``."""
TURNS = 3


def walkers(case, number):
    """Train with a number of walkers."""
    import jax

    from sidestep.agent.presets import preset
    from sidestep.agent.train import _between_moves, prepare, uniform_draws
    from sidestep.programs import program
    from sidestep.scenarios.builtin import scenario
    from sidestep.scenarios.maps import draw_map

    name, level = CASES[case]
    problem = scenario(name)
    iterations = max(10, min(100, TRANSITIONS // number))
    config = preset("default", level, nodes=problem.place.nodes)
    capacity = number * math.ceil(config.capacity / number)
    config = config.changed(walkers=number, round_steps=number * iterations, capacity=capacity)
    began = perf_counter()
    where, _, state = prepare(config, problem, draw_map(problem, 0), uniform_draws(config, [0], 0, start=True))

    @program(donate=("state",))
    def run(where, state, draws):
        spans = draws.reshape(-1, config.span, draws.shape[1])
        return jax.lax.scan(partial(_between_moves, config, where), state, spans)

    state, _ = jax.block_until_ready(run(where, state, uniform_draws(config, [0], 0)))
    first, drawing, took = perf_counter() - began, [], []
    for turn in range(1, TURNS + 1):
        began = perf_counter()
        draws = uniform_draws(config, [0], turn)
        drawing.append(perf_counter() - began)
        state, reports = jax.block_until_ready(run(where, state, draws))
        took.append(perf_counter() - began)
        assert math.isfinite(float(reports.loss[-1, -1])), "the loss is not finite"
    seconds = statistics.median(took)
    yield {
        "number": number,
        "transitions_per_s": config.round_steps / seconds,
        "us_an_iteration": 1e6 * seconds / iterations,
        "drawing_share": statistics.median(drawing) / seconds,
        "batch": config.batch,
        "first_s": first,
    }


def environment(case, number):
    """Step a number of walkers."""
    from dataclasses import replace

    import jax
    import steps

    name, level = CASES[case]
    steps.STEPS = max(10, min(200, TRANSITIONS // number))
    params, walks = steps.environment(name, number)
    run, walking, _ = steps.stepping(replace(params, level=level), walks, number)
    took = []
    for turn in range(TURNS + 1):
        key = jax.block_until_ready(jax.random.key(turn))
        began = perf_counter()
        walking, _ = jax.block_until_ready(run(walking, key))
        took.append(perf_counter() - began)
    yield {"number": number, "steps_per_s": number * steps.STEPS / statistics.median(took[1:])}


def _paper(number):
    """The scenario, how it is learned, and so many of its maps."""
    from sidestep.agent.presets import preset
    from sidestep.scenarios.builtin import scenario
    from sidestep.scenarios.maps import draw_map

    problem = scenario("paper-congested")
    return problem, preset("default"), [draw_map(problem, 0, index) for index in range(number)]


def _of_maps(config, seconds, minutes):
    number = len(minutes)
    return {
        "number": number,
        "seconds": seconds,
        "maps_per_s": number / seconds,
        "transitions_per_s": number * config.rounds * config.round_steps / seconds,
        "minutes": [round(each, 4) for each in minutes],  # of the last test walks, one mean for each map
    }


def maps(_case, number):
    """Train a number of maps at once: twice, of which the first compiles."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    from sidestep.agent.problem import Problem
    from sidestep.agent.train import prepare, train_round, uniform_draws
    from sidestep.scenarios.maps import PURPOSES

    problem, config, drawn = _paper(number)
    randomness = [[*np.asarray(jax.random.key_data(each.key)).tolist(), PURPOSES.index("explore")] for each in drawn]
    several = jax.tree.map(lambda *leaves: jnp.stack(leaves), *drawn)
    begin = jax.jit(jax.vmap(partial(prepare, config, problem)))
    one_round = jax.jit(jax.vmap(partial(train_round, config)), donate_argnums=1)

    def draws(done, *, start=False):
        return np.stack([uniform_draws(config, each, done, start=start) for each in randomness])

    def trained():
        where, from_anywhere, state = begin(several, draws(0, start=True))
        for done in range(config.rounds):
            sampler = from_anywhere if done < config.random_origins * config.rounds else where.sampler
            state, report = one_round(Problem(where.params, sampler, where.tests), state, draws(done))
        return jax.block_until_ready(report.test_minutes)

    took = []
    for _ in range(2):
        began = perf_counter()
        minutes = np.asarray(trained()).mean(axis=1)
        took.append(perf_counter() - began)
    yield {"compile_s": took[0] - took[1], **_of_maps(config, took[1], minutes.tolist())}


def _trained(problem, config, drawn):
    """Train one map, and give the mean of its last test walks."""
    from sidestep.agent.train import training_rounds

    *_, (_, report) = training_rounds(config, problem, drawn)
    return float(report.test_minutes.mean())


def in_turn(_case, number):
    """Train a number of maps one after the other."""
    problem, config, drawn = _paper(number)
    _trained(problem, config, drawn[0])  # compiles
    began = perf_counter()
    minutes = [_trained(problem, config, each) for each in drawn]
    yield _of_maps(config, perf_counter() - began, minutes)


def _worker(numbers, ready, channel):
    """Train the maps of these numbers in a process of its own, once all are ready."""
    from sidestep.experiments.pool import start_worker

    start_worker()
    problem, config, drawn = _paper(max(numbers) + 1)
    _trained(problem, config, drawn[0])
    ready.wait()
    channel.send([_trained(problem, config, drawn[each]) for each in numbers])


def processes(_case, number):
    """Train a number of maps on processes that have compiled before."""
    import multiprocessing

    context = multiprocessing.get_context("spawn")
    share = [list(range(number))[first :: os.cpu_count()] for first in range(min(os.cpu_count(), number))]
    ready = context.Barrier(len(share) + 1)
    channels, others = zip(*(context.Pipe(duplex=False) for _ in share), strict=True)
    running = [
        context.Process(target=_worker, args=(mine, ready, other), daemon=True)
        for mine, other in zip(share, others, strict=True)
    ]
    for each in running:
        each.start()
    ready.wait()
    began = perf_counter()
    minutes = dict(
        pair for mine, channel in zip(share, channels, strict=True) for pair in zip(mine, channel.recv(), strict=True)
    )
    seconds = perf_counter() - began
    _, config, _ = _paper(0)
    yield {"processes": len(share), **_of_maps(config, seconds, [minutes[each] for each in range(number)])}


PARTS = {"walkers": walkers, "steps": environment, "maps": maps, "in-turn": in_turn, "processes": processes}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--case", choices=CASES, action="append", help="of walkers and steps; by default both")
    parser.add_argument("--number", type=int, action="append", help="of walkers (100 to 100,000) or maps (100)")
    parser.add_argument("--json", action="store_true", help="a line of JSON for each figure")
    options = parser.parse_args()
    many = options.part in ("walkers", "steps")
    for case in (options.case or CASES) if many else ["position"]:
        for number in options.number or ([100, 1_000, 10_000, 100_000] if many else [100]):
            for row in PARTS[options.part](case, number):
                report(options, {"part": options.part, "case": case, **row})


def report(options, row):
    import jax

    if options.json:
        device = {"device": jax.devices()[0].device_kind, "cores": os.cpu_count(), "threads": os.getenv("PJRT_NPROC")}
        print(json.dumps({**device, "jax": jax.__version__, **row}), flush=True)
        return
    figures = ", ".join(f"{name} {value:,.6g}" for name, value in row.items() if isinstance(value, int | float))
    print(f"{jax.devices()[0].device_kind}: {row['part']}, {row['case']}: {figures}", flush=True)


if __name__ == "__main__":
    main()
