"""Sidestep's own agent: its presets, by its public functions.

It draws its map and its crowds itself, and ends every round with greedy test walks of its own; peers get arrays from a
file, and are judged elsewhere. Both differences are to the peers' advantage.
"""

from problem import Problem
from protocol import OnCheck

from sidestep import Scenario, train
from sidestep.agent.config import TrainConfig
from sidestep.agent.presets import preset_for
from sidestep.agent.runs import TrainingRun

PACKAGES = ("sidestep", "jax", "jaxlib", "equinox", "optax", "numpy")


def learn(_algorithm: str, problem: Problem, _seed: int, on_check: OnCheck) -> None:
    """Train on the problem's map, whose seed is also that of the training."""
    scenario = Scenario.model_validate_json(problem.scenario)
    config = settings(problem, scenario)

    def on_round(run: TrainingRun) -> None:
        rounds = len(run.metadata.curve)
        on_check(rounds * config.round_steps, rounds * config.iterations, minutes=float(run.test_minutes.mean()))

    train(scenario, config, seed=problem.seed, index=problem.index, on_round=on_round)


def settings(problem: Problem, scenario: Scenario) -> TrainConfig:
    """The preset that ``sidestep train`` takes, for as many transitions as the task has."""
    task = problem.task
    rounds = {"round_steps": task.check_every, "rounds": task.transitions // task.check_every}
    if task.walkers > 1:
        return preset_for(scenario, "default").changed(**rounds)
    return preset_for(scenario, "paper").changed(test_walks=1, **rounds)  # all would be alike
