"""Training: walk, remember, learn; one jitted scan per round (the paper's algorithm 1)."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.agent import replay as memory
from sidestep.agent.config import TrainConfig
from sidestep.agent.qnetwork import DuelingQNetwork, dueling_network
from sidestep.agent.replay import Replay
from sidestep.agent.td import double_q_learning, mask, q_learning
from sidestep.environment.dynamics import observe, random_exit, reset, step
from sidestep.environment.instances import DRAWS, InstanceSampler
from sidestep.environment.types import EnvParams, EnvState, Instance, Observation
from sidestep.environment.walk import Decide, walk
from sidestep.scenarios import CrowdedMap, Scenario, draw_map, instances, make_environment, purpose_key, sampler


class Transition(eqx.Module):
    """One step of one walker, as the replay keeps it."""

    observation_tm1: Observation
    a_tm1: Int[Array, "*n"]
    r_t: Float[Array, "*n"]
    discount_t: Float[Array, "*n"]
    observation_t: Observation


class Walkers(eqx.Module):
    """Walkers on their way."""

    state: EnvState
    observation: Observation


class TrainState(eqx.Module):
    """Everything that training carries from round to round: saved, it can be resumed to the bit."""

    network: DuelingQNetwork
    target: DuelingQNetwork
    optimiser: optax.OptState
    replay: Replay[Transition]
    walkers: Walkers
    iteration: Int[Array, ""]
    key: Key[Array, ""]
    best: DuelingQNetwork
    best_minutes: Float[Array, ""]


class RoundReport(eqx.Module):
    """What a round looked like."""

    test_minutes: Float[Array, " test"]  # travel time of the greedy test walks; the horizon if they do not arrive
    test_arrived: Bool[Array, " test"]
    loss: Float[Array, ""]  # mean over the round, reward²


def optimiser(config: TrainConfig) -> optax.GradientTransformation:
    """The paper's RMSProp (eqs. 22 and 23, with √g + σ), or Adam."""
    steps = config.rounds * config.iterations
    rate = optax.linear_schedule(config.learning_rate, config.learning_rate_end, steps)
    if config.optimiser == "rmsprop":
        rule = optax.rmsprop(rate, decay=config.decay, eps=config.damping, eps_in_sqrt=False)
    else:
        rule = optax.adam(rate)
    return optax.flatten(rule)  # one vector instead of a dozen arrays: a third less to compile


TRAINING_CROWDS = 64  # futures that training walks meet; the test walks have their own
TEST_WALKS = 10  # greedy walks after every round, as in the paper


def train(
    config: TrainConfig, scenario: Scenario, place: CrowdedMap, state: TrainState | None = None
) -> Iterator[tuple[TrainState, RoundReport]]:
    """Train on one map and yield after every round; give a ``state`` to go on from there.

    The state that was yielded is used up by the next round: copy what is to be kept.
    """
    # The round takes seconds to compile the first time; crowds are drawn meanwhile.
    with ThreadPoolExecutor(1) as pool:
        compiling = pool.submit(_compiled_round, config, scenario)
        problem, fresh = prepare(config, scenario, place)
        one_round = compiling.result()
    state = fresh if state is None else state
    total = config.rounds * config.iterations
    anywhere = sampler(scenario, problem.params, TRAINING_CROWDS, anywhere=True)
    while (done := int(state.iteration) / total) < 1:
        from_where = anywhere if done < config.random_origins else problem.sampler
        state, report = one_round(problem.params, from_where, problem.tests, state)
        yield state, report


class Problem(eqx.Module):
    """What an agent is trained on."""

    params: EnvParams
    sampler: InstanceSampler
    tests: Instance


def prepare(config: TrainConfig, scenario: Scenario, place: CrowdedMap) -> tuple[Problem, TrainState]:
    """Crowds, walks and an untrained state for one map; ``jax.eval_shape`` gives their shapes without the work."""
    params = make_environment(scenario, place, "learn", TRAINING_CROWDS + TEST_WALKS)
    here = sampler(scenario, params, TRAINING_CROWDS)
    tests = instances(scenario, params, TEST_WALKS, first=TRAINING_CROWDS)
    return Problem(params, here, tests), start(config, params, here, place)


@lru_cache(maxsize=16)
def _compiled_round(config: TrainConfig, scenario: Scenario) -> Callable[..., tuple[TrainState, RoundReport]]:
    """:func:`train_round` for all maps of a scenario, which have the same shapes."""
    problem, state = jax.eval_shape(partial(prepare, config, scenario), draw_map(scenario, seed=0))
    return train_round.lower(config, problem.params, problem.sampler, problem.tests, state).compile()


@partial(jax.jit, static_argnames="config")
def start(config: TrainConfig, params: EnvParams, sampler: InstanceSampler, place: CrowdedMap) -> TrainState:
    """Untrained network, empty replay, walkers at their origins."""
    key, network_key, walker_key = jax.random.split(purpose_key(place, "explore"), 3)
    network = dueling_network(
        params.network, network_key, hidden=config.hidden, one_hot=config.one_hot, unit=config.unit
    )
    draws = jax.random.uniform(walker_key, (config.walkers, DRAWS))
    state, observation = jax.vmap(lambda draw: reset(params, sampler.sample(draw)))(draws)
    nothing = jnp.float32(0)
    one = jax.tree.map(lambda leaf: leaf[0], observation)
    item = Transition(one, jnp.int32(0), nothing, nothing, one)
    return TrainState(
        network=network,
        target=network,
        optimiser=optimiser(config).init(eqx.filter(network, eqx.is_array)),
        replay=memory.empty_replay(item, config.capacity),
        walkers=Walkers(state, observation),
        iteration=jnp.int32(0),
        key=key,
        best=network,
        best_minutes=jnp.float32(jnp.inf),
    )


@partial(jax.jit, static_argnames="config", donate_argnames="state")
def train_round(
    config: TrainConfig,
    params: EnvParams,
    sampler: InstanceSampler,
    tests: Instance,
    state: TrainState,
) -> tuple[TrainState, RoundReport]:
    """One round: ``round_steps`` steps with one gradient step for each ``walkers`` of them, then the test walks."""
    key, now = jax.random.split(state.key)
    width = config.walkers * (2 + DRAWS) + config.batch
    draws = jax.random.uniform(now, (config.iterations, width))
    state = eqx.tree_at(lambda s: s.key, state, key)
    state, losses = jax.lax.scan(partial(_iterate, config, params, sampler), state, draws)
    tested = jax.vmap(lambda test: walk(params, greedy(state.network), test, key))(tests)
    minutes = tested.seconds / 60
    better = jnp.mean(minutes) <= state.best_minutes
    best = jax.tree.map(partial(jnp.where, better), state.network, state.best)
    state = eqx.tree_at(
        lambda s: (s.best, s.best_minutes), state, (best, jnp.where(better, jnp.mean(minutes), state.best_minutes))
    )
    return state, RoundReport(minutes, tested.arrived, jnp.mean(losses))


def shown(config: TrainConfig, state: TrainState) -> DuelingQNetwork:
    """The network that a run has to show: the best in test walks or the last, as configured."""
    return state.best if config.keep == "best" else state.network


def greedy(network: DuelingQNetwork) -> Decide:
    """The decision rule of a trained network: the valid exit of the highest value."""
    return lambda observation, _key: jnp.argmax(mask(network(observation), observation.valid))


def _iterate(
    config: TrainConfig,
    params: EnvParams,
    sampler: InstanceSampler,
    state: TrainState,
    draws: Float[Array, " draw"],
) -> tuple[TrainState, Float[Array, ""]]:
    """One step of every walker and one gradient step."""
    progress = state.iteration / (config.rounds * config.iterations)
    for_walkers, for_batch = draws[: -config.batch], draws[-config.batch :]
    walkers, transitions = _walk_on(
        config, params, sampler, state.network, state.walkers, progress, for_walkers.reshape(config.walkers, -1)
    )
    replay = memory.add(state.replay, transitions, config.walkers)
    place, batch, weight = memory.sample(replay, for_batch, config.beta)

    def loss(network: DuelingQNetwork) -> tuple[Float[Array, ""], Float[Array, " batch"]]:
        td_error = jax.vmap(partial(_td_error, config, network, state.target))(batch)
        return jnp.mean(weight * td_error**2), td_error

    (mean_loss, td_error), gradient = jax.value_and_grad(loss, has_aux=True)(state.network)
    replay = memory.reprioritise(replay, place, td_error, config.alpha, config.priority_floor)
    change, optimiser_state = optimiser(config).update(gradient, state.optimiser)
    network = optax.apply_updates(state.network, change)
    iteration = state.iteration + 1
    rate = jnp.where(iteration % config.target_period == 0, config.target_rate, 0.0)
    target = optax.incremental_update(network, state.target, rate)
    return (
        TrainState(
            network, target, optimiser_state, replay, walkers, iteration, state.key, state.best, state.best_minutes
        ),
        mean_loss,
    )


def _walk_on(
    config: TrainConfig,
    params: EnvParams,
    sampler: InstanceSampler,
    network: DuelingQNetwork,
    walkers: Walkers,
    progress: Float[Array, ""],
    draws: Float[Array, "walker draw"],
) -> tuple[Walkers, Transition]:
    """Each walker takes an ε-greedy step; those whose episode is over begin another."""
    fallen = jnp.minimum(progress / config.epsilon_share, 1.0)
    epsilon = config.epsilon + fallen * (config.epsilon_end - config.epsilon)

    def one(state: EnvState, seen: Observation, draw: Float[Array, " draw"]) -> tuple[Walkers, Transition]:
        best = jnp.argmax(mask(network(seen), seen.valid))
        action = jnp.where(draw[0] < epsilon, random_exit(seen.valid, draw[1]), best)
        after, outcome = step(params, state, action)
        over = outcome.terminated | outcome.truncated
        fresh, _ = reset(params, sampler.sample(draw[2:]))
        state = jax.tree.map(partial(jnp.where, over), fresh, after)
        discount = config.gamma * (1.0 - outcome.terminated)
        return Walkers(state, observe(params, state)), Transition(
            seen, action, outcome.reward, discount, outcome.observation
        )

    return jax.vmap(one)(walkers.state, walkers.observation, draws)


def _td_error(
    config: TrainConfig, network: DuelingQNetwork, target: DuelingQNetwork, item: Transition
) -> Float[Array, ""]:
    q_tm1 = network(item.observation_tm1)
    q_t = target(item.observation_t)
    valid_t = item.observation_t.valid
    if config.double:
        selector_t = jax.lax.stop_gradient(network(item.observation_t))
        return double_q_learning(q_tm1, item.a_tm1, item.r_t, item.discount_t, q_t, selector_t, valid_t)
    return q_learning(q_tm1, item.a_tm1, item.r_t, item.discount_t, q_t, valid_t)
