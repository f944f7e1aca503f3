"""Sidestep's own agent: its presets, by its public functions.

It draws its map and its crowds itself, and ends every round with greedy test walks of its own; peers get arrays from a
file, and are judged elsewhere. Both differences are to the peers' advantage.
"""

from problem import Problem
from protocol import OnCheck

from sidestep import Scenario, preset, train
from sidestep.agent.runs import TrainingRun

PACKAGES = ("sidestep", "jax", "jaxlib", "equinox", "optax", "numpy")


def learn(_algorithm: str, problem: Problem, _seed: int, on_check: OnCheck) -> None:
    """Train on the problem's map, whose seed is also that of the training."""
    task = problem.task
    config = preset("default" if task.walkers > 1 else "paper")
    # Crowds come as forecast: all test walks are alike.
    config = config.changed(round_steps=task.check_every, rounds=task.transitions // task.check_every, test_walks=1)

    def on_round(run: TrainingRun) -> None:
        rounds = len(run.metadata.curve)
        on_check(rounds * config.round_steps, rounds * config.iterations, minutes=float(run.test_minutes.mean()))

    train(
        Scenario.model_validate_json(problem.scenario),
        config,
        seed=problem.seed,
        index=problem.index,
        on_round=on_round,
    )
