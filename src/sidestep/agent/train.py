"""Training: walk, remember, learn; one jitted scan per round (the paper's algorithm 1)."""

import itertools
import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.agent import replay as memory
from sidestep.agent.config import TrainConfig
from sidestep.agent.q_networks import DuelingQNetwork, QTable, dueling_network
from sidestep.agent.replay import Replay
from sidestep.agent.segment_network import SegmentQNetwork, segment_network
from sidestep.agent.td import double_q_learning, mask, q_learning
from sidestep.environment.dynamics import random_exit, reset, step
from sidestep.environment.observation import observe
from sidestep.environment.rollout import Decide, walk
from sidestep.environment.types import EnvParams, EnvState, Instance, Observation
from sidestep.files import cached_by_files
from sidestep.network.graph import RoadNetwork
from sidestep.scenarios.episodes import (
    DRAWS,
    InstanceSampler,
    check_paths,
    destinations_of,
    instances,
    sampler,
)
from sidestep.scenarios.futures import make_environment, replace_futures, sample_futures
from sidestep.scenarios.maps import ScenarioMap, draw_training_map, purpose_key
from sidestep.scenarios.model import Scenario

QNetwork = DuelingQNetwork | QTable | SegmentQNetwork
WORTH_SECONDS, WORTH_SECONDS_LIVE = 3.0, 30.0  # the latter against forecasts from counts, which are nearly exact
BIN_SECONDS = 900.0  # of what is learned of places


class Transition(eqx.Module):
    """One step of one walker, as the replay keeps it."""

    observation_tm1: Observation
    a_tm1: Int[Array, "*n"]
    r_t: Float[Array, "*n"]
    discount_t: Float[Array, "*n"]
    observation_t: Observation


class Walkers(eqx.Module):
    """Walkers on their way, and those of their latest steps whose returns are not complete yet."""

    state: EnvState
    observation: Observation
    pending: Transition  # each leaf [n_step - 1, walker, ...], the oldest first
    open: Bool[Array, "pending walker"]  # whether the walk that the step belongs to still goes on


class TrainState(eqx.Module):
    """Everything that training carries from round to round: saved, it can be resumed to the bit."""

    network: QNetwork
    target: QNetwork
    optimiser: optax.OptState
    replay: Replay[Transition]
    walkers: Walkers
    iteration: Int[Array, ""]
    key: Key[Array, ""]
    best: QNetwork
    best_minutes: Float[Array, ""]


class RoundReport(eqx.Module):
    """What a round looked like."""

    test_minutes: Float[Array, " test"]  # travel time, or cost, of the greedy test walks; the horizon if not arrived
    test_arrived: Bool[Array, " test"]
    loss: Float[Array, ""]  # mean over the round, reward²


def optimiser(config: TrainConfig) -> optax.GradientTransformation:
    """The paper's RMSProp (eqs. 22 and 23, with √g + σ), Adam, or plain gradient descent."""
    steps = config.rounds * config.iterations
    rate = optax.linear_schedule(config.learning_rate, config.learning_rate_end, steps)
    if config.optimiser == "rmsprop":
        rule = optax.rmsprop(rate, decay=config.decay, eps=config.damping, eps_in_sqrt=False)
    elif config.optimiser == "sgd":
        rule = optax.sgd(rate)
    else:
        rule = optax.adam(rate)
    return optax.flatten(rule)  # one vector instead of a dozen arrays: a third less to compile


def train(
    config: TrainConfig, scenario: Scenario, scenario_map: ScenarioMap, state: TrainState | None = None
) -> Iterator[tuple[TrainState, RoundReport]]:
    """Train on one map and yield after every round; give a ``state`` to go on from there.

    The state that was yielded is used up by the next round: copy what is to be kept.
    """
    destinations, scenario_map = (
        destinations_of(scenario_map, config.destinations),
        learned_place(config, scenario, scenario_map),
    )
    with ThreadPoolExecutor(1) as pool:
        # The round takes seconds to compile the first time; crowds are drawn meanwhile.
        compiling = pool.submit(_compiled_round, config, scenario)
        problem, fresh = prepare(config, scenario, scenario_map)
        one_round = compiling.result()
        state = fresh if state is None else state
        anywhere = sampler(
            scenario, scenario_map, problem.params, config.futures, destinations=destinations, anywhere=True
        )
        before = int(state.iteration) // config.iterations
        worlds = _worlds(config, scenario, scenario_map, problem.params, before, pool)
        for done, params in zip(range(before, config.rounds), worlds, strict=False):
            everywhere = config.destinations > 1 or done < config.random_origins * config.rounds
            from_where = anywhere if everywhere else problem.sampler
            state, report = one_round(params, from_where, problem.tests, state)
            yield state, report


def _worlds(
    config: TrainConfig,
    scenario: Scenario,
    scenario_map: ScenarioMap,
    params: EnvParams,
    before: int,
    pool: ThreadPoolExecutor,
) -> Iterator[EnvParams]:
    """The environment of every round after those ``before``; fresh crowds are drawn beside the round before them.

    Walkers that are on their way when their crowd is replaced go on in the new one.
    """
    if not config.fresh_futures:
        yield from itertools.repeat(params)
    draw = partial(sample_futures, scenario, scenario_map, params, futures=config.fresh_futures, among=config.futures)
    renewals = iter(range(1, config.rounds))

    def first(number: int) -> Int[Array, ""]:
        return jnp.int32(number * config.fresh_futures % config.futures)

    for number in itertools.islice(renewals, before):
        if number > before - math.ceil(config.futures / config.fresh_futures):  # or it has been replaced again
            params = replace_futures(params, draw(number), first(number), config.futures)
    for number in renewals:
        upcoming = pool.submit(draw, number)
        yield params
        params = replace_futures(params, upcoming.result(), first(number), config.futures)
    yield params


class Problem(eqx.Module):
    """What an agent is trained on."""

    params: EnvParams
    sampler: InstanceSampler
    tests: Instance


def learned_place(_config: TrainConfig, _scenario: Scenario, scenario_map: ScenarioMap) -> ScenarioMap:
    """A map that can be learned."""
    check_paths(scenario_map)
    return scenario_map


def prepare(config: TrainConfig, scenario: Scenario, scenario_map: ScenarioMap) -> tuple[Problem, TrainState]:
    """Crowds, walks and an untrained state for one map; ``jax.eval_shape`` gives their shapes without the work."""
    destinations = destinations_of(scenario_map, config.destinations)
    params = make_environment(
        scenario,
        scenario_map,
        "learn",
        config.futures + config.test_walks,
        level=config.level,
        destinations=destinations,
    )
    here = sampler(scenario, scenario_map, params, config.futures, destinations=destinations)
    several = destinations if config.destinations > 1 else None
    tests = instances(scenario, scenario_map, params, config.test_walks, first=config.futures, destinations=several)
    return Problem(params, here, tests), start(config, scenario, params, here, scenario_map)


@cached_by_files(lambda _, scenario: scenario.place.files, most=16)
def _compiled_round(config: TrainConfig, scenario: Scenario) -> Callable[..., tuple[TrainState, RoundReport]]:
    """:func:`train_round` for all maps of a scenario, which have the same shapes."""
    scenario_map = learned_place(config, scenario, draw_training_map(scenario, seed=0))
    problem, state = jax.eval_shape(partial(prepare, config, scenario), scenario_map)
    return train_round.lower(config, problem.params, problem.sampler, problem.tests, state).compile()


@partial(jax.jit, static_argnames=("config", "scenario"))
def start(
    config: TrainConfig, scenario: Scenario, params: EnvParams, sampler: InstanceSampler, scenario_map: ScenarioMap
) -> TrainState:
    """Untrained network, empty replay, walkers at their origins."""
    key, network_key, walker_key = jax.random.split(purpose_key(scenario_map, "explore"), 3)
    network = fresh_network(config, scenario, params.network, network_key)
    draws = jax.random.uniform(walker_key, (config.walkers, DRAWS))
    state, observation = jax.vmap(lambda draw: reset(params, sampler.sample(draw)))(draws)
    nothing = jnp.float32(0)
    one = jax.tree.map(lambda leaf: leaf[0], observation)
    item = Transition(one, jnp.int32(0), nothing, nothing, one)
    waiting = (config.n_step - 1, config.walkers)
    pending = jax.tree.map(lambda leaf: jnp.zeros((*waiting, *leaf.shape), leaf.dtype), item)
    return TrainState(
        network=network,
        target=network,
        optimiser=optimiser(config).init(eqx.filter(network, eqx.is_array)),
        replay=memory.empty_replay(item, config.capacity),
        walkers=Walkers(state, observation, pending, jnp.zeros(waiting, bool)),
        iteration=jnp.int32(0),
        key=key,
        best=network,
        best_minutes=jnp.float32(jnp.inf),
    )


def fresh_network(config: TrainConfig, scenario: Scenario, network: RoadNetwork, key: Key[Array, ""]) -> QNetwork:
    """The untrained network of a configuration for one map."""
    if config.table:
        return QTable(jnp.zeros((network.nodes, network.exits)))
    if config.level == "position":
        return dueling_network(
            network, key, hidden=config.hidden, one_hot=config.one_hot, unit=config.unit, dueling=config.dueling
        )
    return segment_network(
        network,
        key,
        level=config.level,
        sensed=scenario.place.interpolated,
        hidden=config.hidden,
        places=config.places,
        bins=1 + math.ceil(scenario.slots * scenario.slot_seconds / BIN_SECONDS),
        bin_seconds=BIN_SECONDS,
        dueling=config.dueling,
        potential=config.potential,
        reward_seconds=scenario.reward.unit_seconds,
        unit=config.unit,
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
    minutes = tested.cost / 60
    better = jnp.mean(minutes) <= state.best_minutes
    best = jax.tree.map(partial(jnp.where, better), state.network, state.best)
    state = eqx.tree_at(
        lambda s: (s.best, s.best_minutes), state, (best, jnp.where(better, jnp.mean(minutes), state.best_minutes))
    )
    return state, RoundReport(minutes, tested.arrived, jnp.mean(losses))


def selected_params(config: TrainConfig, state: TrainState) -> QNetwork:
    """The network that a run has to show: the best in test walks or the last, as configured."""
    return state.best if config.keep == "best" else state.network


def greedy(network: QNetwork) -> Decide:
    """The decision rule of a trained network: the valid exit of the highest value.

    Where crowds spread from sensors, streets are short and alike, and corrections that are learned are small against
    the walk: a street that is reckoned to save less than ``WORTH_SECONDS`` against the one that the level's estimate
    prefers is not taken. And they may lead in circles, as estimates never do: whoever comes back to a crossing follows
    the estimate there.
    """

    def decide(observation: Observation, _key: Key[Array, ""]) -> Int[Array, ""]:
        value = network(observation)
        local, expected, estimate = observation.local, observation.expected, observation.estimate
        sensed = expected is not None and expected.log_density_ratio is not None
        if sensed and isinstance(network, SegmentQNetwork) and local is not None and estimate is not None:
            preferred = jnp.argmax(mask(-estimate, observation.valid))
            worth = WORTH_SECONDS if observation.live is None else WORTH_SECONDS_LIVE
            value = value.at[preferred].add(worth / network.reward_seconds)
            value = jnp.where(local.revisiting, -estimate, value)
        return jnp.argmax(mask(value, observation.valid))

    return decide


def _iterate(
    config: TrainConfig,
    params: EnvParams,
    sampler: InstanceSampler,
    state: TrainState,
    draws: Float[Array, " draw"],
) -> tuple[TrainState, Float[Array, ""]]:
    """One step of every walker and one gradient step."""
    for_walkers, for_batch = draws[: -config.batch], draws[-config.batch :]
    walkers, transitions = _walk_on(
        config, params, sampler, state.network, state.walkers, state.iteration, for_walkers.reshape(config.walkers, -1)
    )
    replay = memory.add(state.replay, transitions, config.walkers)
    index, batch, weight = memory.sample(replay, for_batch, config.beta)

    def loss(network: QNetwork) -> tuple[Float[Array, ""], Float[Array, " batch"]]:
        td_error = jax.vmap(partial(_td_error, config, network, state.target))(batch)
        # Twice the Huber loss is the square, as far as it goes.
        losses = 2 * optax.huber_loss(td_error, delta=config.huber) if config.huber else td_error**2
        return jnp.mean(weight * losses), td_error

    (mean_loss, td_error), gradient = jax.value_and_grad(loss, has_aux=True)(state.network)
    replay = memory.reprioritise(replay, index, td_error, config.alpha, config.priority_floor)
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
    network: QNetwork,
    walkers: Walkers,
    iteration: Int[Array, ""],
    draws: Float[Array, "walker draw"],
) -> tuple[Walkers, Transition]:
    """Each walker takes an ε-greedy step; those whose episode is over begin another."""
    progress = iteration / (config.rounds * config.iterations)
    fallen = jnp.minimum(progress / config.epsilon_share, 1.0)
    epsilon = config.epsilon + fallen * (config.epsilon_end - config.epsilon)

    def one(
        state: EnvState, seen: Observation, draw: Float[Array, " draw"]
    ) -> tuple[EnvState, Observation, Transition, Bool[Array, ""]]:
        best = jnp.argmax(mask(network(seen), seen.valid))
        action = jnp.where(draw[0] < epsilon, random_exit(seen.valid, draw[1]), best)
        after, outcome = step(params, state, action)
        over = outcome.terminated | outcome.truncated
        fresh, _ = reset(params, sampler.sample(draw[2:]))
        state = jax.tree.map(partial(jnp.where, over), fresh, after)
        discount = config.gamma * (1.0 - outcome.terminated)
        latest = Transition(seen, action, outcome.reward, discount, outcome.observation)
        return state, observe(params, state), latest, over

    state, observation, latest, over = jax.vmap(one)(walkers.state, walkers.observation, draws)
    if config.n_step == 1:
        return Walkers(state, observation, walkers.pending, walkers.open), latest
    going = walkers.open
    grown = jax.tree.map(
        partial(_where, going), jax.vmap(lambda old: _lengthened(old, latest))(walkers.pending), walkers.pending
    )
    # Until the oldest place has been filled, steps are handed on as they come.
    filled = iteration >= config.n_step - 1
    complete = jax.tree.map(lambda old, new: jnp.where(filled, old[0], new), grown, latest)
    pending = jax.tree.map(lambda old, new: jnp.concatenate([old[1:], new[None]]), grown, latest)
    still = jnp.concatenate([(going & ~over)[1:], ~over[None]])
    return Walkers(state, observation, pending, still), complete


def _lengthened(old: Transition, new: Transition) -> Transition:
    """A transition with the step that followed on it."""
    reward = old.r_t + old.discount_t * new.r_t
    return Transition(old.observation_tm1, old.a_tm1, reward, old.discount_t * new.discount_t, new.observation_t)


def _where(condition: Bool[Array, "pending walker"], one: Array, other: Array) -> Array:
    return jnp.where(condition.reshape(condition.shape + (1,) * (one.ndim - condition.ndim)), one, other)


def _td_error(config: TrainConfig, network: QNetwork, target: QNetwork, item: Transition) -> Float[Array, ""]:
    q_tm1 = network(item.observation_tm1)
    q_t = target(item.observation_t)
    valid_t = item.observation_t.valid
    if config.double:
        selector_t = jax.lax.stop_gradient(network(item.observation_t))
        return double_q_learning(q_tm1, item.a_tm1, item.r_t, item.discount_t, q_t, selector_t, valid_t)
    return q_learning(q_tm1, item.a_tm1, item.r_t, item.discount_t, q_t, valid_t)
