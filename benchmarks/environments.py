"""Measure the vector environments beside the functional core that moves their walkers.

Both take single steps, in turns: the core alone in one compiled call, without telling anybody about it, and the vector
environment with all that Gymnasium wants to know, walks begun anew, and copies in NumPy's arrays. CPU times are
compared, so that other work on the machine does not matter much. See README.md for how to run this.
"""

import argparse
import json
import statistics
from collections.abc import Callable
from time import process_time

import gymnasium
import jax
import numpy as np
from gymnasium.utils.performance import benchmark_vector_step

from sidestep.gym import IDS, WalkVectorEnv


def core_step(env: WalkVectorEnv) -> Callable[[], object]:
    """A function that takes one step with all walkers of an environment, by the functional core."""
    task, actions = env.task, np.zeros(env.num_envs, np.int32)
    leaves, structure = jax.tree.flatten(task)

    @jax.jit
    def step(leaves: list, state: object) -> tuple:
        walks = jax.tree.unflatten(structure, leaves)

        def one(walker, action):
            after, outcome = walks.step(walker, action)
            return after, outcome.reward, outcome.terminated, outcome.truncated, walks.encode(outcome.observation)

        return jax.vmap(one)(state, actions)

    state = jax.vmap(task.start)(jax.random.split(jax.random.key(0), env.num_envs))
    return lambda: jax.block_until_ready(step(leaves, state))


def seconds(function: Callable[[], object], calls: int) -> float:
    began = process_time()
    for _ in range(calls):
        function()
    return (process_time() - began) / calls


def measured(name: str, walkers: int, turns: int, calls: int) -> dict[str, float]:
    """CPU microseconds of a step of all walkers, and steps a second by Gymnasium's own benchmark."""
    env = gymnasium.make_vec(name, num_envs=walkers)
    env.reset(seed=0)
    actions, core = np.zeros(walkers, int), core_step(env)
    pairs = lambda: env.step(actions), core
    for function in pairs:
        function()
    took = [[seconds(function, calls) for function in pairs] for _ in range(turns)]
    return {
        "environment_us": 1e6 * min(ours for ours, _ in took),
        "core_us": 1e6 * min(alone for _, alone in took),
        "ratio": statistics.median(ours / alone for ours, alone in took),
        "steps_a_second": benchmark_vector_step(env, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--walkers", type=int, default=1_000)
    parser.add_argument("--turns", type=int, default=15)
    parser.add_argument("--calls", type=int, default=100)
    asked = parser.parse_args()
    for name in IDS:
        print(json.dumps({"id": name, **measured(name, asked.walkers, asked.turns, asked.calls)}))


if __name__ == "__main__":
    main()
