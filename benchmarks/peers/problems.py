"""Problems of built-in scenarios for all peers, and Sidestep's functional core as the judge of what they learn."""

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from problem import Problem, Task, Walkers

from sidestep.environment.dynamics import reset, step
from sidestep.environment.rollout import walk
from sidestep.environment.types import EnvParams, Instance
from sidestep.evaluation.compare import compare
from sidestep.planners.registry import find_planner
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import Scenario

SCENARIO = scenario("paper-congested", flows="forecast")
BEST = "clairvoyant"
LONGEST = 200
"""Steps of two environments that are compared."""


def on_map(task: Task, seed: int, index: int, given: Scenario = SCENARIO) -> tuple[Problem, "Judge"]:
    """The problem on a map, and its judge.

    Raises
    ------
    AssertionError
        NumPy's walkers do not walk as the functional core does: then nothing would be compared.
    """
    here = draw_map(given, seed, index)
    params = make_environment(given, here, "test", 1)
    best = compare(given, {BEST: lambda *_: find_planner(BEST)}, maps=[index], walks=1, seed=seed).records[BEST]
    walks = instances(given, here, params, 1)
    network, speeds, weights = params.network, params.futures.speeds, params.reward
    problem = Problem(
        task=task,
        scenario=given.model_dump_json(),
        seed=seed,
        index=index,
        exit_node=np.asarray(network.exit_node),
        exit_segment=np.asarray(network.exit_segment),
        length=np.asarray(network.length, np.float64),
        speed=np.asarray(speeds.speed[0], np.float32),
        position=np.asarray(network.position, np.float64),
        slot_seconds=float(speeds.slot_seconds),
        origin=int(walks.origin[0]),
        destination=int(walks.destination[0]),
        horizon=given.horizon,
        unit_seconds=weights.unit_seconds,
        progress=weights.progress,
        bonus=weights.bonus,
        optimum=float(best.minutes.mean()),
    )
    judge = Judge(params, jax.tree.map(lambda leaf: leaf[0], walks))
    judge.check_same(problem)
    return problem, judge


class Judge:
    """Walks as learned, in Sidestep's functional core."""

    def __init__(self, params: EnvParams, instance: Instance) -> None:
        self.params, self.instance = params, instance

    def minutes(self, policies: Sequence[Sequence[int]]) -> list[float]:
        """Minutes of the held-out walk by each policy (an exit for each crossing); the horizon if it never ends."""
        return [float(_minutes(self.params, self.instance, jnp.asarray(policy, jnp.int32))) for policy in policies]

    def check_same(self, problem: Problem) -> None:
        """Walk both environments at random."""
        walkers = Walkers(problem, 0)
        node = int(walkers.reset()[0])
        state, _ = reset(self.params, replace(self.instance, origin=jnp.int32(node)))
        for action in np.random.default_rng(0).integers(problem.exits, size=LONGEST):
            state, outcome = _step(self.params, state, jnp.int32(action))
            there, reward, terminated, truncated, _ = walkers.step(np.full(walkers.count, action))
            assert there[0] == int(state.node)
            assert abs(reward[0] * problem.task.unit - float(outcome.reward)) < 0.01
            assert (terminated[0], truncated[0]) == (bool(outcome.terminated), bool(outcome.truncated))
            if terminated[0] or truncated[0]:
                return
            assert abs(walkers.clock[0] - float(state.clock)) < 1e-4 * walkers.clock[0] + 0.1


_step = jax.jit(step)


@jax.jit
def _minutes(params: EnvParams, instance: Instance, exits: jax.Array) -> jax.Array:
    walked = walk(params, lambda seen, _: exits[seen.node], instance, jax.random.key(0))
    return walked.seconds / 60
