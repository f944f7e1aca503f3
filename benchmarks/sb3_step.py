"""Measure one environment step with its gradient step: Sidestep's ``paper`` preset beside Stable-Baselines3's DQN.

Both learn the same map with the same sizes: two inputs, two hidden layers of 50, batches of 32 from the latest 10,000
steps, one gradient step after every step, the same reward and the same ends of episodes. Each runs once to warm up (and
compile); then they take turns, and the medians are compared. See README.md for how to install and run this.

The differences favour Stable-Baselines3: its replay is uniform, while the paper's preset keeps priorities and draws by
them; its network has no dueling heads; and Sidestep's time includes the ten greedy test walks after every round. The
environment of Stable-Baselines3 is plain Python, as its users write them.
"""

import argparse
import json
import platform
import statistics
from collections.abc import Callable
from time import perf_counter

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import stable_baselines3
import torch
from stable_baselines3 import DQN

from sidestep.agent.config import TrainConfig
from sidestep.agent.presets import PRESETS
from sidestep.agent.train import training_rounds
from sidestep.environment.dynamics import reset, step
from sidestep.environment.types import EnvParams
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import ScenarioMap, draw_map
from sidestep.scenarios.model import Scenario


class Grid(gymnasium.Env):
    """The environment of a scenario on one map, in plain Python."""

    def __init__(self, problem: Scenario, params: EnvParams) -> None:
        network = params.network
        self.exit_node, self.exit_segment = network.exit_node.tolist(), network.exit_segment.tolist()
        self.length = network.length.tolist()
        self.metres = np.asarray(network.position, np.float64)
        blocks = self.metres / np.diff(np.unique(self.metres[:, 0]))[0]
        self.observed = blocks.astype(np.float32)
        self.speed = np.asarray(params.futures.speeds.speed, np.float64).tolist()  # [future][segment][slot]
        self.slot_seconds = params.futures.speeds.slot_seconds
        self.origin, self.destination, self.horizon = 0, network.nodes - 1, problem.horizon
        self.reward = problem.reward
        self.far = np.linalg.norm(self.metres - self.metres[self.destination], axis=1).tolist()
        self.observation_space = gymnasium.spaces.Box(0, problem.place.side - 1, (2,), np.float32)
        self.action_space = gymnasium.spaces.Discrete(4)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Begin at the origin, in ``options["future"]`` or any."""
        super().reset(seed=seed)
        self.future = options["future"] if options else self.np_random.integers(len(self.speed))
        self.node, self.clock = self.origin, 0.0
        return self.observed[self.node], {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Walk to the next crossing; an exit that does not exist is replaced by the next one round."""
        before, taken = self.node, int(action)
        while self.exit_node[before][taken] < 0:
            taken = (taken + 1) % 4
        segment = self.exit_segment[before][taken]
        seconds = self.crossing_seconds(self.speed[self.future][segment], self.length[segment])
        self.clock += seconds
        self.node = self.exit_node[before][taken]
        arrived = self.node == self.destination
        progress = self.far[before] - self.far[self.node]
        reward = -seconds / self.reward.unit_seconds + self.reward.progress * progress + self.reward.bonus * arrived
        return self.observed[self.node], reward, arrived, not arrived and self.clock >= self.horizon, {}

    def crossing_seconds(self, speed: list[float], metres: float) -> float:
        """Walk through the slots that the crossing spans, at each slot's speed."""
        clock, slot = self.clock, min(int(self.clock // self.slot_seconds), len(speed) - 1)
        while slot < len(speed) - 1:
            until = (slot + 1) * self.slot_seconds
            if metres < speed[slot] * (until - clock):
                break
            metres -= speed[slot] * (until - clock)
            clock, slot = until, slot + 1
        return clock + metres / speed[slot] - self.clock


def check_same(grid: Grid, problem: Scenario, scenario_map: ScenarioMap, params: EnvParams, steps: int = 300) -> None:
    """Walk both environments at random: they must agree, or the comparison compares nothing."""
    one_step = jax.jit(step)
    state, _ = reset(params, jax.tree.map(lambda leaf: leaf[0], instances(problem, scenario_map, params, 1)))
    grid.reset(options={"future": 0})
    for action in np.random.default_rng(0).integers(4, size=steps):
        state, outcome = one_step(params, state, jnp.asarray(action))
        _, reward, terminated, truncated, _ = grid.step(action)
        assert grid.node == int(state.node)
        assert abs(grid.clock - float(state.clock)) < 1e-4 * grid.clock + 0.1
        assert abs(reward - float(outcome.reward)) < 0.01
        assert (terminated, truncated) == (bool(outcome.terminated), bool(outcome.truncated))
        if terminated or truncated:
            break


def sidestep_run(config: TrainConfig, problem: Scenario, scenario_map: ScenarioMap) -> Callable[[], float]:
    """A function that trains one round more and returns the microseconds of a step."""
    rounds = training_rounds(config, problem, scenario_map)

    def run() -> float:
        began = perf_counter()
        jax.block_until_ready(next(rounds)[0])
        return 1e6 * (perf_counter() - began) / config.round_steps

    return run


def sb3_run(config: TrainConfig, grid: Grid, steps: int) -> Callable[[], float]:
    """The same for Stable-Baselines3."""
    model = DQN(
        "MlpPolicy",
        grid,
        learning_rate=config.learning_rate,
        buffer_size=config.capacity,
        learning_starts=config.batch,
        batch_size=config.batch,
        gamma=config.gamma,
        train_freq=1,
        gradient_steps=1,
        target_update_interval=config.target_period,
        exploration_initial_eps=config.epsilon,
        exploration_final_eps=config.epsilon_end,
        policy_kwargs={
            "net_arch": list(config.hidden),
            "optimizer_class": torch.optim.RMSprop,
            "optimizer_kwargs": {"alpha": config.decay, "eps": config.damping},
        },
        device="cpu",
        seed=0,
    )

    def run() -> float:
        before = model._n_updates  # noqa: SLF001 - SB3 tells nowhere else how often it learned
        began = perf_counter()
        model.learn(steps, reset_num_timesteps=False)
        took = perf_counter() - began
        assert model._n_updates - before >= steps - config.batch - 1  # noqa: SLF001
        return 1e6 * took / steps

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5, help="timed turns of each")
    parser.add_argument("--steps", type=int, default=2_000, help="steps in a turn of Stable-Baselines3")
    parser.add_argument("--rounds", type=int, default=10, help="rounds' worth of steps in a turn of Sidestep")
    parser.add_argument("--torch-threads", type=int, default=1, help="1 serves networks this small best")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    options = parser.parse_args()
    torch.set_num_threads(options.torch_threads)

    problem = scenario("paper-congested")
    scenario_map = draw_map(problem, seed=0)
    params = make_environment(problem, scenario_map, "learn", 8)
    config = PRESETS["paper"]
    config = config.changed(rounds=options.repeats + 1, round_steps=options.rounds * config.round_steps)
    grid = Grid(problem, params)
    check_same(grid, problem, scenario_map, params)

    runs = {
        "sidestep": sidestep_run(config, problem, scenario_map),
        "stable-baselines3": sb3_run(config, grid, options.steps),
    }
    for run in runs.values():
        run()
    microseconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(options.repeats):
        for name, run in runs.items():
            microseconds[name].append(run())
    median = {name: statistics.median(times) for name, times in microseconds.items()}
    ratios = [
        theirs / ours for ours, theirs in zip(microseconds["sidestep"], microseconds["stable-baselines3"], strict=True)
    ]
    found = {
        "unit": "microseconds per environment step with its gradient step",
        "microseconds": microseconds,
        "median": median,
        "ratio": statistics.median(ratios),
        "ratios": ratios,
        "versions": {
            "python": platform.python_version(),
            "jax": jax.__version__,
            "torch": torch.__version__,
            "stable-baselines3": stable_baselines3.__version__,
        },
        "device": jax.devices()[0].platform,
        "torch_threads": options.torch_threads,
    }
    if options.json:
        print(json.dumps(found, indent=1))
        return
    for name, times in microseconds.items():
        print(f"{name:18} {median[name]:8.1f} us a step   ({', '.join(f'{time:.0f}' for time in times)})")
    print(f"{'ratio':18} {found['ratio']:8.1f}             ({', '.join(f'{ratio:.1f}' for ratio in ratios)})")


if __name__ == "__main__":
    main()
