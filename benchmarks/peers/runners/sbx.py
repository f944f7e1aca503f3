"""DQN of sbx: Stable-Baselines3 with its gradient steps in JAX."""

import jax
import optax
from problem import Problem
from protocol import OnCheck
from sbx import DQN

from runners.sb3_walkers import Checks, VecWalkers

PACKAGES = ("sbx-rl", "stable-baselines3", "jax", "jaxlib", "flax", "gymnasium", "numpy")


def learn(_algorithm: str, problem: Problem, seed: int, on_check: OnCheck) -> None:
    """Learn with DQN."""
    task, walkers = problem.task, VecWalkers(problem, seed)
    common = {
        "gamma": task.gamma,
        "buffer_size": task.replay,
        "learning_starts": task.batch,
        "batch_size": task.batch,
        "train_freq": 1,
        "gradient_steps": 1,
        "seed": seed,
    }
    if task.walkers == 1:
        rmsprop = {"optimizer_class": optax.rmsprop, "optimizer_kwargs": {"decay": 0.9, "eps": 1e-10}}
        common |= {"learning_rate": 1e-4, "target_update_interval": 200, "policy_kwargs": rmsprop}
        common |= {"exploration_initial_eps": 0.1, "exploration_final_eps": 0.1}
    else:  # its own learning rate cannot fall
        rate = optax.linear_schedule(3e-3, 0.0, 2 * task.iterations)
        falling = {"optimizer_class": lambda learning_rate: optax.adam(rate)}  # noqa: ARG005
        common |= {"gradient_steps": 2, "tau": 0.05, "target_update_interval": task.walkers, "policy_kwargs": falling}
        common |= {"exploration_fraction": 0.3, "exploration_final_eps": 0.2}
    common["policy_kwargs"]["net_arch"] = list(task.hidden)
    model = DQN("MlpPolicy", walkers, **common)

    def check(model: DQN) -> None:
        values = model.qf.apply(model.policy.qf_state.params, problem.features)
        on_check(model.num_timesteps, model._n_updates, problem.greedy(jax.device_get(values)))  # noqa: SLF001

    model.learn(task.transitions, callback=Checks(task.check_every, check))
