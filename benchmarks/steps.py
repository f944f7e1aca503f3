"""Environment steps a second at each level of knowledge: walkers side by side take random exits; there is no agent.

Usage: python benchmarks/steps.py [--scenario NAME] [--walkers N] [--cores N] [--turns N] [--json]
"""

import argparse
import json
import os
import statistics
from dataclasses import replace
from functools import partial
from time import perf_counter, process_time

LEVELS = {
    "paper-congested": ("position", "local", "map", "live"),
    "rush-16": ("position", "local", "map", "live"),
    "helsinki": ("local", "map"),
}
"""Scenarios, and what walkers observe there."""
FUTURES = 64
WALKS = 4_096
"""Drawn beforehand, one for each walker at least; walkers begin one after the other."""
STEPS = 200
"""Of each walker in a turn."""


def on_cores(number):
    """Keep this process on some cores, and compiled programs to as many threads; before JAX is imported."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:number])
    if number == 1:
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen=false"


def environment(name, walkers):
    """A scenario's environment at the highest of its levels, and walks from anywhere to its own destination."""
    import jax

    from sidestep.scenarios.builtin import scenario
    from sidestep.scenarios.episodes import DRAWS, sampler
    from sidestep.scenarios.futures import make_environment
    from sidestep.scenarios.maps import draw_map

    problem = scenario(name)
    scenario_map = draw_map(problem, 0)
    params = make_environment(problem, scenario_map, "learn", FUTURES, level=LEVELS[name][-1])
    walks = sampler(problem, scenario_map, params, FUTURES, anywhere=True)
    return params, jax.vmap(walks.sample)(jax.random.uniform(jax.random.key(0), (max(WALKS, walkers), DRAWS)))


def stepping(params, walks, walkers):
    """Compile ``STEPS`` steps of every walker.

    Who has arrived, or is out of time, begins the next walk in the same step. All of an observation is kept until the
    next step, as for a policy; the policy here takes any exit that exists.
    """
    import jax
    import jax.numpy as jnp

    from sidestep.environment.dynamics import random_exit, reset, step
    from sidestep.environment.observation import observe

    def one(params, state, seen, walk, draw):
        after, outcome = step(params, state, random_exit(seen.valid, draw))
        over = outcome.terminated | outcome.truncated
        state = jax.tree.map(partial(jnp.where, over), reset(params, walk)[0], after)
        return state, observe(params, state), outcome.reward, over

    def run(params, walks, walking, key):
        def all_step(carry, number):
            *walking, rewards, ends = carry
            draws = jax.random.uniform(jax.random.fold_in(key, number), (walkers,))
            following = jax.tree.map(lambda leaf: leaf[(number + jnp.arange(walkers)) % len(leaf)], walks)
            *walking, reward, over = jax.vmap(partial(one, params))(*walking, following, draws)
            return (*walking, rewards + reward, ends + over), None

        nothing = jnp.zeros(walkers)
        (state, seen, *sums), _ = jax.lax.scan(all_step, (*walking, nothing, nothing), jnp.arange(STEPS))
        return (state, seen), sums

    begin = jax.jit(lambda params, walks: jax.vmap(partial(reset, params))(walks))
    walking = begin(params, jax.tree.map(lambda leaf: leaf[:walkers], walks))
    began = process_time()
    compiled = jax.jit(run).lower(params, walks, walking, jax.random.key(0)).compile()
    return partial(compiled, params, walks), walking, process_time() - began


def measured(names, walkers, turns):
    """All scenarios and levels in turns: seconds of wall and processor time for each, the first turn left out."""
    import jax

    programs, found = {}, {}
    for name in names:
        params, walks = environment(name, walkers)
        for level in LEVELS[name]:
            *programs[name, level], compiling = stepping(replace(params, level=level), walks, walkers)
            found[name, level] = {"compile_s": compiling, "wall_s": [], "cpu_s": []}
    for turn in range(turns + 1):
        key = jax.block_until_ready(jax.random.key(turn))
        for which, (run, walking) in programs.items():
            began, cpu = perf_counter(), process_time()
            after, (_, ends) = jax.block_until_ready(run(walking, key))
            took = {"wall_s": perf_counter() - began, "cpu_s": process_time() - cpu}
            assert float(ends.sum()) > 0, "nobody arrives"
            programs[which] = run, after
            if turn:
                for clock, seconds in took.items():
                    found[which][clock].append(seconds)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", choices=LEVELS, action="append", help="by default all")
    parser.add_argument("--walkers", type=int, default=1_000)
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--turns", type=int, default=25)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    on_cores(options.cores)
    rows = []
    for (name, level), took in measured(options.scenario or list(LEVELS), options.walkers, options.turns).items():
        steps = options.walkers * STEPS
        rates = {f"per_{clock}": steps / statistics.median(took[clock]) for clock in ("wall_s", "cpu_s")}
        rows.append({"scenario": name, "level": level, **rates, "compile_s": took["compile_s"]})
    if options.json:
        print(json.dumps({"walkers": options.walkers, "cores": options.cores, "steps": rows}, indent=2))
        return
    print(f"{options.walkers:,} walkers, {options.cores} core(s): millions of steps a second, medians of turns")
    print("scenario          level      wall time  processor time  compiling, s")
    for row in rows:
        wall, cpu = (row[clock] / 1e6 for clock in ("per_wall_s", "per_cpu_s"))
        print(f"{row['scenario']:17} {row['level']:9} {wall:10.2f} {cpu:15.2f} {row['compile_s']:13.1f}")


if __name__ == "__main__":
    main()
