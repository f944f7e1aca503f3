"""How long potentials, decisions and training take at each level of knowledge.

Usage: python benchmarks/levels.py [--rounds N] [--json]
"""

import argparse
import json
import statistics
from dataclasses import replace
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np

from sidestep.agent.config import preset
from sidestep.agent.train import fresh_network, greedy, train
from sidestep.environment.dynamics import reset
from sidestep.environment.potentials import field_to_go
from sidestep.environment.types import LEVELS
from sidestep.scenarios.catalogue import scenario
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.worlds import instances, make_environment

WALKERS = 1_000
TURNS = 25


def milliseconds(run, *arguments):
    """Median time of a call, compiled before."""
    jax.block_until_ready(run(*arguments))
    times = []
    for _ in range(TURNS):
        began = perf_counter()
        jax.block_until_ready(run(*arguments))
        times.append(1e3 * (perf_counter() - began))
    return statistics.median(times)


def potentials():
    """All origins and departures to one destination: 1,024 nodes, 24 slots."""
    problem = scenario("rush-32", horizon=24 * 300.0)
    params = make_environment(problem, draw_map(problem, 0), "test", 1)
    goal = jnp.zeros(params.network.nodes, bool).at[-1].set(True)
    return milliseconds(jax.jit(field_to_go), params.network, params.expected, goal)


def decisions(level):
    """A batch of walkers, each at its crossing: observations in, exits out."""
    problem = scenario("rush-16", horizon=3600.0)
    place = draw_map(problem, 0)
    params = make_environment(problem, place, "test", 20, level=level)
    todo = instances(problem, place, params, WALKERS)
    _, seen = jax.vmap(lambda one: reset(params, one))(todo)
    network = fresh_network(preset("default", level), problem, place.network, place.key)
    decide = jax.jit(lambda network, seen: jax.vmap(lambda one: greedy(network)(one, place.key))(seen))
    return milliseconds(decide, network, seen)


def training(level, rounds):
    """Transitions and gradient steps a second, the first round left out since it compiles."""
    config = replace(preset("default", level), rounds=rounds)
    problem = scenario("paper-congested" if level == "position" else "rush-16")
    ended = []
    for _, report in train(config, problem, draw_map(problem, 0)):
        jax.block_until_ready(report)
        ended.append(perf_counter())
    each = float(np.median(np.diff(ended)))
    return config.round_steps / each, config.iterations / each


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = {"potentials_ms": potentials()}
    for level in LEVELS:
        transitions, updates = training(level, options.rounds)
        found[level] = {
            "decision_ms": decisions(level),
            "transitions_per_second": transitions,
            "updates_per_second": updates,
        }
    if options.json:
        print(json.dumps(found, indent=2))
        return
    print(f"potentials, 1,024 nodes x 24 slots: {found.pop('potentials_ms'):.1f} ms")
    print(f"level     {WALKERS:,} decisions, ms   transitions/s   updates/s")
    for level, row in found.items():
        print(
            f"{level:9} {row['decision_ms']:19.2f} {row['transitions_per_second']:15,.0f} "
            f"{row['updates_per_second']:11,.0f}"
        )


if __name__ == "__main__":
    main()
