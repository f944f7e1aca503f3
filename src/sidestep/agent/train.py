"""Training rounds: act, remember, learn, test; one compiled program per round (the paper's algorithm 1)."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sidestep.agent.acting import ACTING_DRAWS, Transition, Walkers, act, epsilon, place_walkers
from sidestep.agent.config import TrainConfig
from sidestep.agent.learning import BatchReport, Learner, learn, move_target, start_learner
from sidestep.agent.policy import Policy, deployed
from sidestep.agent.problem import Problem, pose, renewed
from sidestep.agent.q_networks import QNetwork, untrained
from sidestep.agent.replay import Replay, add, empty_replay
from sidestep.environment.rollout import walk
from sidestep.environment.types import EnvParams, Instance
from sidestep.programs import on_every_device, over_devices, program
from sidestep.scenarios.episodes import DRAWS, InstanceSampler
from sidestep.scenarios.maps import PURPOSES, ScenarioMap, purpose_key
from sidestep.scenarios.model import Scenario


class TrainState(eqx.Module):
    """Everything that training carries from round to round: saved, it can be resumed to the bit."""

    learner: Learner
    replay: Replay[Transition]
    walkers: Walkers
    iteration: Int[Array, ""]
    """Iterations done: gradient steps, and steps of each walker."""
    kept: QNetwork
    """The network of the best test walks so far or, where the mean is kept, the mean."""
    best_minutes: Float[Array, ""]
    """Mean of the best test walks so far, min."""


class RoundReport(eqx.Module):
    """How a round went."""

    test_minutes: Float[Array, " test"]
    """Travel time or cost of each greedy test walk, min; the horizon if it did not arrive."""
    test_arrived: Bool[Array, " test"]
    learned: BatchReport
    """Means over the round's gradient steps."""
    epsilon: Float[Array, ""]
    """Share of random steps as the round ended."""


def training_rounds(
    config: TrainConfig,
    scenario: Scenario,
    scenario_map: ScenarioMap,
    state: TrainState | None = None,
    on_tests: Callable[[EnvParams, Instance], None] = lambda _params, _tests: None,
) -> Iterator[tuple[TrainState, RoundReport]]:
    """Train on one map, round by round.

    Parameters
    ----------
    config
        How to learn.
    scenario, scenario_map
        What is learned, and where.
    state
        The state to go on from; by default an untrained one.
    on_tests
        Called before the first round, while that is compiled, with the environment and the greedy test walks.

    Yields
    ------
    state
        It is used up by the next round: copy what is to be kept.
    report
        How the round went.
    """
    with ThreadPoolExecutor(1) as executor:
        # A round takes seconds to compile the first time; futures are drawn meanwhile.
        randomness = [*np.asarray(jax.random.key_data(scenario_map.key)).tolist(), PURPOSES.index("explore")]
        draws = partial(uniform_draws, config, randomness)
        first = scenario_map, draws(0, start=True)
        shape_of_problem, _, shape_of_state = prepare.shapes(config, scenario, *first)
        round_of_shapes = config, shape_of_problem, shape_of_state, draws(0)
        train_round.lower(*round_of_shapes)
        compiling = executor.submit(train_round.prepare, *round_of_shapes)
        problem, from_anywhere, fresh = prepare(config, scenario, *first)
        on_tests(problem.params, problem.tests)
        compiling.result()
        state = fresh if state is None else state
        before = int(state.iteration) // config.iterations
        environments = renewed(config, scenario, scenario_map, problem.params, before, executor)
        for done, params in zip(range(before, config.rounds), environments, strict=False):
            everywhere = config.destinations > 1 or done < config.random_origins * config.rounds
            sampler = from_anywhere if everywhere else problem.sampler
            state, report = train_round(config, Problem(params, sampler, problem.tests), state, draws(done))
            yield state, report


def _brief(config: TrainConfig, **_: object) -> bool:
    """Whether a training takes less time than its compilation."""
    # One walker a step, as the paper has it, would take twice as long.
    return config.level == "position" and config.walkers > 1


@program("config", "scenario", quick=_brief, files=lambda scenario, **_: scenario.place.files, spread=True)
def prepare(
    config: TrainConfig, scenario: Scenario, scenario_map: ScenarioMap, draws: Float[Array | np.ndarray, "walker draw"]
) -> tuple[Problem, InstanceSampler, TrainState]:
    """Pose the problem of one map, with walks from anywhere and an untrained state."""
    problem, from_anywhere = pose(config, scenario, scenario_map)
    return problem, from_anywhere, start(config, scenario, problem, scenario_map, draws)


def start(
    config: TrainConfig,
    scenario: Scenario,
    problem: Problem,
    scenario_map: ScenarioMap,
    draws: Float[Array | np.ndarray, "walker draw"],
) -> TrainState:
    """Untrained network, empty replay, walkers at origins that are drawn by uniform numbers."""
    q_network = untrained(config, scenario, problem.params.network, purpose_key(scenario_map, "explore"))
    walkers, transition = place_walkers(config, problem, draws)
    learner, replay = start_learner(config, q_network), empty_replay(transition, config.capacity)
    return TrainState(learner, replay, walkers, jnp.int32(0), kept=q_network, best_minutes=jnp.float32(jnp.inf))


def uniform_draws(
    config: TrainConfig, randomness: list[int], number: int, *, start: bool = False
) -> Float[np.ndarray, "row draw"]:
    """Draw all random numbers of a round: on a CPU NumPy takes a fraction of JAX's time, and nothing is compiled.

    Parameters
    ----------
    config
        How many.
    randomness, number
        Of the training, and of the round.
    start
        Those that the training begins with instead: a row for each walker.

    Returns
    -------
    Float[np.ndarray, "row draw"]
        In [0, 1); a row for each iteration.
    """
    rng = np.random.default_rng([*randomness, number, start])
    shape = (config.walkers, DRAWS) if start else (config.iterations, config.walkers * ACTING_DRAWS + config.batch)
    return rng.random(shape, np.float32)


@program("config", donate=("state",), quick=_brief, spread=True)
def train_round(
    config: TrainConfig, problem: Problem, state: TrainState, draws: Float[Array | np.ndarray, "iteration draw"]
) -> tuple[TrainState, RoundReport]:
    """Train for one round: ``round_steps`` steps, a gradient step for each ``walkers`` of them, then the test walks.

    Parameters
    ----------
    config
        How to learn.
    problem
        What walkers learn from and are tested on in this round.
    state
        Used up.
    draws
        The round's :func:`uniform_draws`.

    Returns
    -------
    state
        After the round.
    report
        How it went.

    References
    ----------
    Algorithm 1 of the paper, with its branches in order: terminal transitions do not bootstrap.
    """
    spans = draws.reshape(-1, config.span, draws.shape[1])
    state, steps = jax.lax.scan(partial(_between_moves, config, problem), state, spans)
    q_network = _mean(config, state) if config.keep == "mean" else state.learner.q_network
    policy = deployed(config, problem.evaluated(config, q_network), problem.params.reward.unit_seconds)
    unused = jax.random.key(0)  # nothing is random in what has been learned
    by_node = config.level == "position"  # where nothing else is seen
    tests = jax.vmap(lambda test: walk(problem.params, policy, test, unused, by_node=by_node))
    tested = on_every_device(over_devices(tests, config.test_walks, in_axes=(0,))(problem.tests))
    minutes = tested.cost / 60
    mean = jnp.mean(minutes)
    best_minutes = jnp.minimum(mean, state.best_minutes)
    better = partial(jnp.where, mean <= state.best_minutes)
    kept = q_network if config.keep == "mean" else jax.tree.map(better, q_network, state.kept)
    report = RoundReport(minutes, tested.arrived, jax.tree.map(jnp.mean, steps), epsilon(config, state.iteration))
    return replace(state, kept=kept, best_minutes=best_minutes), report


def _mean(config: TrainConfig, state: TrainState) -> QNetwork:
    """Mean of the networks after each of the last quarter of rounds; before that quarter, the latest network."""
    number = jnp.maximum(state.iteration // config.iterations - config.rounds_before_mean, 1)
    share = 1 / number
    return jax.tree.map(lambda new, mean: share * new + (1 - share) * mean, state.learner.q_network, state.kept)


def _between_moves(
    config: TrainConfig, problem: Problem, state: TrainState, draws: Float[Array, "iteration draw"]
) -> tuple[TrainState, BatchReport]:
    """A span of iterations, for all of which the target network is evaluated once, and then its move."""
    target = problem.evaluated(config, state.learner.target)
    state, steps = jax.lax.scan(partial(_iterate, config, problem, target), state, draws)
    return replace(state, learner=move_target(config, state.learner, state.iteration)), steps


def _iterate(
    config: TrainConfig, problem: Problem, target: QNetwork, state: TrainState, draws: Float[Array, " draw"]
) -> tuple[TrainState, BatchReport]:
    """One step of every walker and one gradient step."""
    # All devices learn the same from the whole batch: were it divided, gradients would add up in another order.
    for_walkers = draws[: -config.batch].reshape(config.walkers, -1)
    for_batch = on_every_device(draws[-config.batch :])
    evaluated = partial(problem.evaluated, config)
    policy = Policy(evaluated(state.learner.q_network))
    walkers, transitions = act(config, problem, policy, state.walkers, state.iteration, for_walkers)
    replay = add(state.replay, on_every_device(transitions), config.walkers)
    learner, replay, report = learn(config, state.learner, target, replay, for_batch, evaluated)
    return TrainState(learner, replay, walkers, state.iteration + 1, state.kept, state.best_minutes), report
