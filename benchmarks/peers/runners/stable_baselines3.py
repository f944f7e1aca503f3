"""Stable-Baselines3's DQN, and QR-DQN and MaskablePPO of sb3-contrib, in PyTorch."""

from typing import Any

import torch
from problem import Problem, Task
from protocol import OnCheck

from runners.sb3_walkers import Checks, VecWalkers

PACKAGES = ("stable-baselines3", "sb3-contrib", "torch", "gymnasium", "numpy")


def learn(algorithm: str, problem: Problem, seed: int, on_check: OnCheck) -> None:
    """Learn with ``DQN``, ``QRDQN`` or ``MaskablePPO``."""
    torch.set_num_threads(1)  # serves networks this small best
    task, walkers = problem.task, VecWalkers(problem, seed)
    features = torch.as_tensor(problem.features)
    settings: dict[str, Any] = {"gamma": task.gamma, "seed": seed, "device": "cpu"}
    if algorithm == "MaskablePPO":
        model = masked_ppo(walkers, settings | ppo(task))
    else:
        model = off_policy(algorithm, walkers, settings | (paper(task) if task.walkers == 1 else fast(task)))

    def check(model: Any) -> None:
        with torch.no_grad():
            if algorithm == "DQN":
                values = model.q_net(features)
            elif algorithm == "QRDQN":
                values = model.quantile_net(features).mean(dim=1)
            else:
                values = model.policy.get_distribution(features).distribution.logits
        on_check(model.num_timesteps, model._n_updates, problem.greedy(values.numpy()))  # noqa: SLF001 - told nowhere else

    model.learn(task.transitions, callback=Checks(task.check_every, check))


def off_policy(algorithm: str, walkers: VecWalkers, settings: dict[str, Any]) -> Any:
    """Make a learner with a replay."""
    if algorithm == "DQN":
        from stable_baselines3 import DQN

        return DQN("MlpPolicy", walkers, **settings)
    from sb3_contrib import QRDQN

    settings["policy_kwargs"] |= {"n_quantiles": 25}
    return QRDQN("MlpPolicy", walkers, **settings)


def masked_ppo(walkers: VecWalkers, settings: dict[str, Any]) -> Any:
    """Make a learner that knows which exits there are."""
    from sb3_contrib import MaskablePPO

    return MaskablePPO("MlpPolicy", walkers, **settings)


def fast(task: Task) -> dict[str, Any]:
    """Settings of off-policy learners, tuned to get to the optimum early."""
    return {
        "learning_rate": lambda left: 3e-3 * left,
        "buffer_size": task.replay,
        "learning_starts": task.batch,
        "batch_size": task.batch,
        "train_freq": 1,
        "gradient_steps": 2,
        "tau": 0.05,
        "target_update_interval": task.walkers,
        "exploration_fraction": 0.3,
        "exploration_final_eps": 0.2,
        "policy_kwargs": {"net_arch": list(task.hidden)},
    }


def paper(task: Task) -> dict[str, Any]:
    """Settings of the paper."""
    return {
        "learning_rate": 1e-4,
        "buffer_size": task.replay,
        "learning_starts": task.batch,
        "batch_size": task.batch,
        "train_freq": 1,
        "gradient_steps": 1,
        "target_update_interval": 200,
        "exploration_initial_eps": 0.1,
        "exploration_final_eps": 0.1,
        "policy_kwargs": {
            "net_arch": list(task.hidden),
            "optimizer_class": torch.optim.RMSprop,
            "optimizer_kwargs": {"alpha": 0.9, "eps": 1e-10},
        },
    }


def ppo(task: Task) -> dict[str, Any]:
    """Settings of MaskablePPO."""
    return {
        "learning_rate": lambda left: 3e-3 * left,
        "n_steps": 32,
        "batch_size": task.batch,
        "n_epochs": 8,
        "gae_lambda": 0.95,
        "ent_coef": 0.02,
        "policy_kwargs": {"net_arch": list(task.hidden)},
    }
