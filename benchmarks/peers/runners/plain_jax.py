"""The single file of JAX beside this folder, with uniform or prioritised replay; it walks its greedy walks itself."""

from dataclasses import replace

import plain_jax
from problem import Problem
from protocol import OnCheck

PACKAGES = ("jax", "jaxlib", "numpy")


def learn(algorithm: str, problem: Problem, seed: int, on_check: OnCheck) -> None:
    """Learn with ``uniform`` or ``prioritised`` replay, as the file's own settings say."""
    task = problem.task
    settings = replace(plain_jax.LEARN, epsilon=(1.0, 0.2)) if task.walkers > 1 else plain_jax.PAPER
    settings = replace(settings, updates=task.iterations, prioritised=algorithm == "prioritised")
    tables, _ = plain_jax.read(problem.path)
    for updates, minutes in plain_jax.rounds(settings, tables, seed, task.check_every // task.walkers):
        if updates:
            on_check(updates * task.walkers, updates, minutes=minutes)
        if updates >= settings.updates:
            return
