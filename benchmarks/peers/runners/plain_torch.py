"""The single file of PyTorch beside this folder."""

import plain_torch
from problem import Problem
from protocol import OnCheck

PACKAGES = ("torch", "numpy")


def learn(_algorithm: str, problem: Problem, seed: int, on_check: OnCheck) -> None:
    """Learn with DQN."""
    plain_torch.learn(problem, seed, on_check)
