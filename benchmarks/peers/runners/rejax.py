"""DQN, IQN and PQN of rejax, whole trainings in JAX, on an environment in the shape of gymnax 0.0.9."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import optax
import rejax
from flax import struct
from gymnax.environments import spaces
from gymnax.environments.environment import Environment
from problem import Problem
from protocol import OnCheck
from rejax.algos.dqn import EpsilonGreedyPolicy
from rejax.networks import DiscreteQNetwork

PACKAGES = ("rejax", "gymnax", "jax", "jaxlib", "flax", "numpy")


@struct.dataclass
class Params:
    """The problem's arrays: parameters and no constants, so that all maps share one compiled program."""

    features: jax.Array
    exit_node: jax.Array
    exit_segment: jax.Array
    """Both [node, exit], with the exit that is taken instead where there is none."""
    length: jax.Array
    speed: jax.Array
    covered: jax.Array
    potential: jax.Array
    max_steps_in_episode: int = 10_000


@struct.dataclass
class State:
    """One walker."""

    node: jax.Array
    clock: jax.Array
    iteration: jax.Array
    """Steps of this walker in all its episodes."""


class Streets(Environment):
    """The walk of one walker."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    @partial(jax.jit, static_argnums=0)
    def step(self, key: jax.Array, state: State, action: jax.Array, params: Params | None = None) -> Any:
        """Step, and begin another episode where this one is over."""
        seen, after, reward, done, info = self.step_env(key, state, action, params)
        seen_again, again = self.begin(key, params, after.iteration)
        state = jax.tree.map(partial(jnp.where, done), again, after)
        return jnp.where(done, seen_again, seen), state, reward, done, info

    def step_env(self, _key: jax.Array, state: State, action: jax.Array, params: Params) -> Any:
        """Walk to the next crossing."""
        problem, slot_seconds = self.problem, self.problem.slot_seconds
        node, segment = params.exit_node[state.node, action], params.exit_segment[state.node, action]
        covered, speed = params.covered[segment], params.speed[segment]
        now = jnp.clip((state.clock // slot_seconds).astype(int), 0, len(speed) - 1)
        end = covered[now] + speed[now] * (state.clock - now * slot_seconds) + params.length[segment]
        then = jnp.clip(jnp.sum(covered <= end) - 1, now, len(speed) - 1)
        clock = then * slot_seconds + (end - covered[then]) / speed[then]
        reward = params.potential[node] - params.potential[state.node]
        reward = (reward - (clock - state.clock) / problem.unit_seconds) / problem.task.unit
        done = (node == problem.destination) | (clock >= problem.horizon)
        return params.features[node], State(node, clock, state.iteration + 1), reward, done, {}

    def reset_env(self, key: jax.Array, params: Params) -> tuple[jax.Array, State]:
        """Put the walker at its first origin."""
        return self.begin(key, params, jnp.int32(0))

    def begin(self, key: jax.Array, params: Params, iteration: jax.Array) -> tuple[jax.Array, State]:
        """Put the walker at an origin."""
        problem, task = self.problem, self.problem.task
        anywhere = jnp.asarray(problem.elsewhere)[jax.random.randint(key, (), 0, len(problem.elsewhere))]
        node = jnp.where(iteration < task.random_origins * task.iterations, anywhere, problem.origin)
        return params.features[node], State(node, jnp.float32(0), iteration)

    @property
    def num_actions(self) -> int:
        """Exits of a crossing."""
        return self.problem.exits

    def action_space(self, _params: Params) -> spaces.Discrete:
        """Exits of a crossing."""
        return spaces.Discrete(self.problem.exits)

    def observation_space(self, _params: Params) -> spaces.Box:
        """What the network is told."""
        features = self.problem.features
        return spaces.Box(float(features.min()), float(features.max()), features.shape[1:], jnp.float32)


def arrays(problem: Problem) -> Params:
    """The problem's arrays for JAX."""
    nodes = jnp.arange(problem.nodes)[:, None]
    return Params(
        features=jnp.asarray(problem.features),
        exit_node=jnp.asarray(problem.exit_node)[nodes, problem.taken],
        exit_segment=jnp.asarray(problem.exit_segment)[nodes, problem.taken],
        length=jnp.asarray(problem.length, jnp.float32),
        speed=jnp.asarray(problem.speed),
        covered=jnp.asarray(problem.covered, jnp.float32),
        potential=jnp.asarray(problem.potential, jnp.float32),
    )


CONSTANTS = ("nodes", "exits", "slot_seconds", "origin", "destination", "horizon", "unit_seconds")
"""What programs know of a problem, beside its arrays: maps of one scenario share them."""
_programs: dict[tuple[Any, ...], tuple[Any, Any, Any]] = {}


def learn(algorithm: str, problem: Problem, seed: int, on_check: OnCheck) -> None:
    """Learn with ``DQN``, ``IQN`` or ``PQN``, a compiled piece between two looks at what is learned."""
    task, params = problem.task, arrays(problem)
    same = (algorithm, task, *(getattr(problem, name) for name in CONSTANTS))
    if same not in _programs:
        _programs[same] = programs(algorithm, problem, params)
    learner, begin, go_on = _programs[same]
    state = begin(params, jax.random.key(seed))
    for done in range(task.check_every, task.transitions + 1, task.check_every):
        state, found = go_on(params, state)
        on_check(done, updates(learner, algorithm, done), problem.greedy(jax.device_get(found[0])))


def programs(algorithm: str, problem: Problem, params: Params) -> tuple[Any, Any, Any]:
    """The learner, and what begins a training and goes on with it."""
    task = problem.task
    learner = getattr(rejax, algorithm).create(
        env=Streets(problem),
        env_params=params,
        gamma=task.gamma,
        num_envs=task.walkers,
        total_timesteps=task.check_every,
        eval_freq=task.check_every,
        skip_initial_evaluation=True,
        **settings(algorithm, problem),
    )
    if algorithm != "IQN":  # which alone takes the sizes of its layers
        policy = EpsilonGreedyPolicy(DiscreteQNetwork)
        learner = learner.replace(agent=policy(task.hidden, learner.agent.activation, problem.exits))

    def values(learner: Any, state: Any, key: jax.Array) -> jax.Array:
        seen = learner.env_params.features
        if algorithm == "IQN":
            return learner.agent.apply(state.q_ts.params, seen, key, method="q")
        return learner.agent.apply(state.q_ts.params, seen)

    learner = learner.replace(eval_callback=values)
    begin = jax.jit(lambda params, key: learner.replace(env_params=params).init_state(key))
    go_on = jax.jit(lambda params, state: learner.replace(env_params=params).train(train_state=state), donate_argnums=1)
    return learner, begin, go_on


def settings(algorithm: str, problem: Problem) -> dict[str, Any]:
    """Settings, tuned to get to the optimum early, or the paper's."""
    task = problem.task
    fall = task.transitions / task.check_every  # rejax counts from the beginning of a piece to its end
    activation = {"agent_kwargs": {"activation": "relu"}}
    if algorithm == "PQN":
        rate = optax.linear_schedule(2e-3, 0.0, task.iterations)
        steps = {"num_steps": 16, "num_minibatches": 4, "num_epochs": 4}
        return steps | {"learning_rate": rate, "td_lambda": 0.65, "eps_end": 0.2, "exploration_fraction": 0.3 * fall}
    if algorithm == "IQN":
        activation["agent_kwargs"]["hidden_layer_sizes"] = task.hidden
        activation |= {"num_tau_samples": 8, "num_tau_prime_samples": 8}
    common = activation | {"fill_buffer": task.batch, "batch_size": task.batch}
    if task.walkers == 1:
        learning = {"learning_rate": 1e-4, "target_update_freq": 200, "polyak": 0.0, "buffer_size": task.replay}
        return common | learning | {"eps_start": 0.1, "eps_end": 0.1, "exploration_fraction": fall}
    rate = optax.linear_schedule(1e-3 if algorithm == "IQN" else 3e-3, 0.0, task.iterations)
    learning = {"learning_rate": rate, "target_update_freq": 1, "polyak": 0.95, "exploration_fraction": 0.3 * fall}
    # Its draws without replacement take longer than the gradient step from a larger ring.
    return common | learning | {"buffer_size": task.replay // 5, "eps_end": 0.2 if algorithm == "IQN" else 0.05}


def updates(learner: Any, algorithm: str, transitions: int) -> int:
    """Gradient steps after so many transitions."""
    if algorithm == "PQN":
        steps = learner.num_envs * learner.num_steps
        return transitions // steps * learner.num_minibatches * learner.num_epochs
    return max(transitions - learner.fill_buffer, 0) // learner.num_envs * learner.num_epochs
