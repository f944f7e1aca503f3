"""How long costs to go, decisions and training take at each level of knowledge.

Usage: python benchmarks/levels.py [--rounds N] [--json]
"""

import argparse
import json
import statistics
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np

from sidestep.agent.policy import Policy
from sidestep.agent.presets import preset
from sidestep.agent.q_networks import untrained
from sidestep.agent.train import training_rounds
from sidestep.environment.cost_to_go import at_clock, field_cost_to_go
from sidestep.environment.dynamics import reset
from sidestep.environment.types import LEVELS
from sidestep.planners.time_dependent import earliest_arrivals, leaving
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map

WALKERS = 1_000
SEARCHES = 300


def milliseconds(run, *arguments, turns=25):
    """Median time of a call, compiled before."""
    jax.block_until_ready(run(*arguments))
    times = []
    for _ in range(turns):
        began = perf_counter()
        jax.block_until_ready(run(*arguments))
        times.append(1e3 * (perf_counter() - began))
    return statistics.median(times)


def costs_to_go():
    """All origins and departures to one destination: 1,024 nodes, 24 slots."""
    problem = scenario("rush-32", horizon=24 * 300.0, departures=(0.0, 0.0))
    params = make_environment(problem, draw_map(problem, 0), "test", 1)
    goal = jnp.zeros(params.network.nodes, bool).at[-1].set(True)

    @jax.jit
    def expected(params, goal):
        first = jnp.int32(0)
        return field_cost_to_go(params, params.expected.of(first), params.wait_in(first), goal)

    return milliseconds(expected, params, goal)


def accuracy():
    """Mean and largest error of costs to go against exact search, per cent: random origins, departures and futures."""
    problem = scenario("rush-16")
    params = make_environment(problem, draw_map(problem, 0), "test", SEARCHES)
    network, last = params.network, params.network.nodes - 1
    goal = jnp.zeros(network.nodes, bool).at[last].set(True)
    rng = np.random.default_rng(0)
    origins = jnp.asarray(rng.integers(last, size=SEARCHES))
    departures = jnp.asarray(rng.uniform(0, 3600, SEARCHES), jnp.float32)

    @jax.jit
    def both(number, origin, departure):
        field, wait = params.futures.speeds.of(number), params.wait_in(number)
        leave = leaving(network, params.futures.speeds, number, params.rule, wait)
        exact = earliest_arrivals(network, leave, origin, departure)[0][last] - departure
        table = field_cost_to_go(params, field, wait, goal)
        return exact, at_clock(table, field.slot_seconds, departure[None], origin[None])[0]

    found = np.array([both(*one) for one in zip(jnp.arange(SEARCHES), origins, departures, strict=True)])
    error = 100 * (found[:, 1] / found[:, 0] - 1)
    return float(np.abs(error).mean()), float(np.abs(error).max())


def live_feed(name):
    """Snapshot and forecast from all counts of one slot."""
    problem = scenario(name)
    scenario_map = draw_map(problem, 0)
    return (
        milliseconds(lambda: make_environment(problem, scenario_map, "test", 1, level="live"), turns=3)
        - milliseconds(lambda: make_environment(problem, scenario_map, "test", 1, level="map"), turns=3)
    ) / problem.slots


def decisions(level):
    """A batch of walkers, each at its crossing: observations in, exits out."""
    problem = scenario("rush-16", horizon=3600.0)
    scenario_map = draw_map(problem, 0)
    params = make_environment(problem, scenario_map, "test", 20, level=level)
    todo = instances(problem, scenario_map, params, WALKERS)
    _, seen = jax.vmap(lambda one: reset(params, one))(todo)
    policy = Policy(untrained(preset("default", level), problem, scenario_map.network, scenario_map.key))
    return milliseconds(jax.jit(lambda policy, seen: jax.vmap(policy)(seen)), policy, seen)


def training(level, rounds):
    """Transitions and gradient steps a second, the first round left out since it compiles."""
    config = preset("default", level).changed(rounds=rounds)
    problem = scenario("paper-congested" if level == "position" else "rush-16")
    ended = []
    for _, report in training_rounds(config, problem, draw_map(problem, 0)):
        jax.block_until_ready(report)
        ended.append(perf_counter())
    each = float(np.median(np.diff(ended)))
    return config.round_steps / each, config.iterations / each


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    mean, largest = accuracy()
    found = {
        "costs_to_go_ms": costs_to_go(),
        "costs_to_go_error_percent": {"mean": mean, "largest": largest},
        "live_feed_ms_per_slot": {name: live_feed(name) for name in ("rush-16", "rush-32")},
    }
    levels = {}
    for level in LEVELS:
        transitions, updates = training(level, options.rounds)
        levels[level] = {
            "decision_ms": decisions(level),
            "transitions_per_second": transitions,
            "updates_per_second": updates,
        }
    if options.json:
        print(json.dumps({**found, "levels": levels}, indent=2))
        return
    print(f"costs to go, 1,024 nodes x 24 slots: {found['costs_to_go_ms']:.1f} ms")
    print(f"against exact search, 256 nodes: off by {mean:.2f} % in the mean, {largest:.2f} % at most")
    for name, each in found["live_feed_ms_per_slot"].items():
        print(f"live feed, {name}: {each:.1f} ms a slot")
    print(f"level     {WALKERS:,} decisions, ms   transitions/s   updates/s")
    for level, row in levels.items():
        print(
            f"{level:9} {row['decision_ms']:19.2f} {row['transitions_per_second']:15,.0f} "
            f"{row['updates_per_second']:11,.0f}"
        )


if __name__ == "__main__":
    main()
