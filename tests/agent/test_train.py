"""Training: its optimiser by hand, and one small run looked at iteration by iteration."""

import dataclasses
from collections.abc import Iterator
from itertools import islice, pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from sidestep.agent import train as training
from sidestep.agent.checkpoint import TrainingRun
from sidestep.agent.config import TrainConfig
from sidestep.agent.presets import PRESETS, preset
from sidestep.agent.q_networks import DuelingQNetwork, Linear
from sidestep.agent.td import mask
from sidestep.agent.train import RoundReport, TrainState, Transition, _td_error, optimiser, train
from sidestep.environment.types import EnvParams, Observation, RewardWeights
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.futures import replace_futures, sample_futures
from sidestep.scenarios.maps import ScenarioMap, draw_map, draw_training_map
from sidestep.scenarios.model import Scenario

# --- The optimiser --------------------------------------------------------------------------------------------------


def rule(**changes: Any) -> optax.GradientTransformation:
    """A preset's optimiser with other numbers; two rounds of one iteration."""
    config = dataclasses.replace(PRESETS["paper"], rounds=2, round_steps=4, walkers=4, **changes)
    return optimiser(config)


def follow(rule: optax.GradientTransformation, *gradients: list[float]) -> list[np.ndarray]:
    """What is added to the parameters at each step."""
    state = rule.init(jnp.zeros(len(gradients[0])))
    changes = []
    for gradient in gradients:
        change, state = rule.update(jnp.array(gradient), state)
        changes.append(np.asarray(change))
    return changes


def test_rmsprop() -> None:
    changes = follow(rule(learning_rate=0.1, learning_rate_end=0.1, decay=0.75, damping=0.5), [4.0, -8.0], [2.0, 0.0])
    # g = .25 * 4² = 4: -.1 * 4 / (√4 + .5) = -.16.   g = .25 * 8² = 16: .1 * 8 / (√16 + .5) = .177778
    np.testing.assert_allclose(changes[0], [-0.16, 0.1777778], rtol=1e-5)
    # g = .75 * 4 + .25 * 2² = 4: -.1 * 2 / (√4 + .5) = -.08.   A gradient of 0 changes nothing.
    np.testing.assert_allclose(changes[1], [-0.08, 0.0], rtol=1e-5)


def test_the_learning_rate_falls_linearly() -> None:
    changes = follow(rule(learning_rate=0.1, learning_rate_end=0.02, decay=0.75, damping=0.5), [4.0], [2.0], [2.0])
    # Two iterations from .1 to .02: .1, then .06, and .02 at the end. As above: 4 / 2.5 = 1.6 and 2 / 2.5 = .8;
    # then g = .75 * 4 + .25 * 4 = 4 again.
    np.testing.assert_allclose(np.concatenate(changes), [-0.16, -0.048, -0.016], rtol=1e-5)


def test_adam_is_there_too() -> None:
    # Adam's first step is the learning rate in the direction of the gradient, whatever its size.
    (change,) = follow(rule(optimiser="adam", learning_rate=0.01, learning_rate_end=0.01), [300.0, -0.02])
    np.testing.assert_allclose(change, [-0.01, 0.01], rtol=1e-4)


# --- The error of one transition ------------------------------------------------------------------------------------


def constant(*q: float) -> DuelingQNetwork:
    """A network with these Q-values everywhere where all exits exist."""
    value = jnp.array(q).mean()
    return DuelingQNetwork(
        offset=jnp.zeros(2),
        scale=jnp.ones(2),
        hidden=(),
        value=Linear(jnp.zeros((1, 2)), value[None]),
        advantage=Linear(jnp.zeros((3, 2)), jnp.array(q) - value),
        crossings=0,
        unit=1.0,
    )


@pytest.mark.parametrize(("double", "by_hand"), [(False, 10.0), (True, 5.5)])
def test_td_error(double: bool, by_hand: float) -> None:
    seen = Observation(jnp.int32(0), jnp.zeros(2), jnp.ones(3, bool), jnp.int32(0))
    item = Transition(seen, jnp.int32(1), jnp.float32(2), jnp.float32(0.5), seen)
    # The network says 1, 3, 8; the target 22, 9, 13. The error of exit 1 is 2 + .5 max(22, 9, 13) - 3 = 10; with
    # double Q 2 + .5 * 13 - 3 = 5.5, because the network prefers exit 2.
    config = dataclasses.replace(PRESETS["paper"], double=double)
    found = _td_error(config, constant(1, 3, 8), constant(22, 9, 13), item)
    np.testing.assert_allclose(found, by_hand, rtol=1e-6)


# --- One small run --------------------------------------------------------------------------------------------------

# A round is one iteration, so that nothing is hidden inside one: 64 walkers, a ring of 4 iterations. The horizon of
# an hour cuts many walks off, and the learning rate is so high that the greedy walk keeps changing.
SMALL = TrainConfig(
    rounds=20, round_steps=64, walkers=64, batch=32, capacity=256, alpha=0.6, beta=0.4, priority_floor=0.01,
    gamma=0.9, double=True, hidden=(8,), one_hot=True, unit=5.0, target_period=5, target_rate=1.0,
    optimiser="rmsprop", learning_rate=0.3, learning_rate_end=0.0, decay=0.9, damping=1e-10,
    epsilon=1.0, epsilon_end=0.0, epsilon_share=0.5, random_origins=0.5, keep="best",
)  # fmt: skip
RING = SMALL.capacity // SMALL.walkers


@pytest.fixture(scope="module")
def problem() -> Scenario:
    return scenario("paper-congested", side=3, crowded_nodes=1, horizon=3600.0)


@pytest.fixture(scope="module")
def scenario_map(problem: Scenario) -> ScenarioMap:
    return draw_map(problem, seed=6)


def on_host(tree: TrainState) -> TrainState:
    """A copy in host memory, where random keys are plain numbers."""
    plain = eqx.tree_at(lambda s: s.key, tree, jax.random.key_data(tree.key))
    return jax.tree.map(np.asarray, plain)


def on_device(tree: TrainState) -> TrainState:
    """The way back."""
    arrays = jax.tree.map(jnp.asarray, tree)
    return eqx.tree_at(lambda s: s.key, arrays, jax.random.wrap_key_data(arrays.key))


def follow_training(run: Iterator[tuple[TrainState, RoundReport]]) -> list[tuple[TrainState, RoundReport]]:
    """Host copies of what training yields, each taken before the next round uses it up."""
    return [(on_host(state), jax.tree.map(np.asarray, report)) for state, report in run]


@pytest.fixture(scope="module")
def history(problem: Scenario, scenario_map: ScenarioMap) -> list[tuple[TrainState, RoundReport]]:
    """State and report after every iteration."""
    return follow_training(train(SMALL, problem, scenario_map))


@pytest.fixture(scope="module")
def states(history: list[tuple[TrainState, RoundReport]]) -> list[TrainState]:
    return [state for state, _ in history]


def latest(state: TrainState) -> Any:
    """The transitions of the last iteration, from its place in the ring."""
    first = (int(state.iteration) - 1) % RING * SMALL.walkers
    return jax.tree.map(lambda leaf: leaf[first : first + SMALL.walkers], state.replay.items)


def truncated(state: TrainState, problem: Scenario) -> np.ndarray:
    """Which walkers were cut off in the last iteration: they begin again without having arrived."""
    begun = state.walkers.state.clock == state.walkers.state.instance.departure
    return begun & (latest(state).observation_t.node != problem.destination)


def test_counts_rounds_and_iterations(history: list[tuple[TrainState, RoundReport]]) -> None:
    assert [int(state.iteration) for state, _ in history] == list(range(1, 21))
    assert [int(state.replay.added) for state, _ in history] == list(range(64, 21 * 64, 64))
    assert all(report.test_minutes.shape == (10,) for _, report in history)
    assert all(np.isfinite(report.loss) and report.loss > 0 for _, report in history)


def test_every_round_draws_its_own_numbers(states: list[TrainState]) -> None:
    assert len({state.key.tobytes() for state in states}) == 20


def test_the_target_is_copied_every_k_iterations(states: list[TrainState]) -> None:
    for before, after in pairwise(states):
        assert not eqx.tree_equal(after.network, before.network)
        copied = int(after.iteration) % 5 == 0
        assert eqx.tree_equal(after.target, after.network if copied else before.target)


def test_the_target_moves_part_of_the_way(problem: Scenario, scenario_map: ScenarioMap) -> None:
    config = dataclasses.replace(SMALL, target_period=2, target_rate=0.25)
    run = [state for state, _ in follow_training(islice(train(config, problem, scenario_map), 5))]
    for before, after in pairwise(run):
        if int(after.iteration) % 2:
            assert eqx.tree_equal(after.target, before.target)
        else:
            moved = jax.tree.map(lambda new, old: 0.25 * new + 0.75 * old, after.network, before.target)
            assert eqx.tree_equal(after.target, moved, rtol=1e-5, atol=1e-6)
            assert not eqx.tree_equal(after.target, before.target, rtol=1e-4, atol=1e-4)


def test_what_the_replay_holds_happened(states: list[TrainState], problem: Scenario, scenario_map: ScenarioMap) -> None:
    for before, after in pairwise(states):
        seen = latest(after)
        assert eqx.tree_equal(seen.observation_tm1, before.walkers.observation)
        np.testing.assert_array_equal(
            np.asarray(scenario_map.network.exit_node)[seen.observation_tm1.node, seen.a_tm1], seen.observation_t.node
        )
        # Who is still on the way stands where the transition ended; the others have begun anew.
        over = (seen.observation_t.node == problem.destination) | truncated(after, problem)
        np.testing.assert_array_equal(after.walkers.observation.node[~over], seen.observation_t.node[~over])
        assert (after.walkers.state.clock[~over] > before.walkers.state.clock[~over]).all()
        assert (after.walkers.state.clock[over] == 0).all()


def test_arriving_ends_the_future_and_the_horizon_does_not(states: list[TrainState], problem: Scenario) -> None:
    arrived = cut = 0
    for state in states:
        seen, cut_off = latest(state), truncated(state, problem)
        at_destination = seen.observation_t.node == problem.destination
        np.testing.assert_allclose(seen.discount_t, np.where(at_destination, 0, 0.9), rtol=1e-6)
        arrived, cut = arrived + at_destination.sum(), cut + cut_off.sum()
    assert arrived > 0
    assert cut > 0  # walks were cut off, and the line above found the 0.9 beside them


def test_reward_is_minutes_and_progress(states: list[TrainState], problem: Scenario, scenario_map: ScenarioMap) -> None:
    position = np.asarray(scenario_map.network.position)
    far = np.linalg.norm(position - position[problem.destination], axis=1)
    for before, after in pairwise(states):
        seen = latest(after)
        arrived = seen.observation_t.node == problem.destination
        going = ~arrived & ~truncated(after, problem)
        minutes = (after.walkers.state.clock - before.walkers.state.clock)[going] / 60
        progress = (far[seen.observation_tm1.node] - far[seen.observation_t.node])[going]
        np.testing.assert_allclose(seen.r_t[going], 1e-3 * progress - minutes, rtol=1e-3, atol=1e-3)


def test_epsilon_falls_as_configured(states: list[TrainState]) -> None:
    @jax.jit
    def greedy(network: DuelingQNetwork, seen: Any) -> jax.Array:
        return jax.vmap(lambda one: jnp.argmax(mask(network(one), one.valid)))(seen)

    others, chances = [], []  # of any exit but the best
    lasts, last_chances = [], []  # of the last exit where that is not the best
    for before, after in pairwise(states):
        seen = latest(after)
        valid = seen.observation_tm1.valid
        best = np.asarray(greedy(before.network, seen.observation_tm1))
        last = 3 - valid[:, ::-1].argmax(axis=1)
        # From 1 to 0 in the first 10 of 20 iterations; a random exit is any one in as many cases as there are exits.
        epsilon = max(0.0, 1 - int(before.iteration) / 10)
        each = epsilon / valid.sum(axis=1)
        others.append(seen.a_tm1 != best)
        chances.append(epsilon - each)
        lasts.append((seen.a_tm1 == last) & (last != best))
        last_chances.append(each * (last != best))
    assert np.sum(chances) > 100
    assert not np.any(others[9:])  # from iteration 10 on
    for happened, chance in (
        (others, np.array(chances)),
        (lasts, np.array(last_chances)),
        (lasts[4:], np.array(last_chances[4:])),  # which exit has nothing to do with whether ε is small
    ):
        assert abs(np.sum(happened) - chance.sum()) < 4 * np.sqrt((chance * (1 - chance)).sum())


def test_walks_begin_anywhere_for_the_configured_share(states: list[TrainState], problem: Scenario) -> None:
    def origins(some: list[TrainState]) -> set[int]:
        begun = [state.walkers.state.clock == 0 for state in some]
        return set(
            np.concatenate(
                [state.walkers.state.instance.origin[new] for state, new in zip(some, begun, strict=True)]
            ).tolist()
        )

    assert origins(states[:10]) == set(range(9)) - {problem.destination}
    assert origins(states[10:]) == {problem.origin}


def test_the_best_network_is_that_of_the_shortest_tests(history: list[tuple[TrainState, RoundReport]]) -> None:
    minutes = [report.test_minutes.mean() for _, report in history]
    for number, (state, _) in enumerate(history, start=1):
        shortest = min(minutes[:number])
        # The later of equals has learned more.
        latest_best = max(i for i in range(number) if minutes[i] == shortest)
        assert eqx.tree_equal(state.best, history[latest_best][0].network)
        assert state.best_minutes == shortest


@pytest.mark.parametrize(("best_so_far", "replaced"), [(1.0, False), (1000.0, True)])
def test_the_best_network_stays_until_a_better_one_comes(
    states: list[TrainState], problem: Scenario, scenario_map: ScenarioMap, best_so_far: float, replaced: bool
) -> None:
    other = jax.tree.map(lambda leaf: leaf + 1, states[0].network)
    before = eqx.tree_at(lambda s: (s.best, s.best_minutes), states[8], (other, np.float32(best_so_far)))
    after, report = follow_training(islice(train(SMALL, problem, scenario_map, on_device(before)), 1))[0]
    assert 1 < report.test_minutes.mean() < 1000
    assert eqx.tree_equal(after.best, after.network if replaced else other)
    assert after.best_minutes == (report.test_minutes.mean() if replaced else best_so_far)


def test_keep_chooses_between_best_and_last(states: list[TrainState], problem: Scenario) -> None:
    state = eqx.tree_at(lambda s: s.best, states[3], jax.tree.map(lambda leaf: leaf + 1, states[3].network))
    for keep, kept in (("best", state.best), ("last", state.network)):
        config = dataclasses.replace(SMALL, keep=keep)
        assert TrainingRun(problem, 6, 0, config, (), "", state).network is kept


def test_the_same_seed_gives_the_same_run_to_the_bit(
    history: list[tuple[TrainState, RoundReport]], problem: Scenario, scenario_map: ScenarioMap
) -> None:
    again = follow_training(train(SMALL, problem, draw_map(problem, seed=6)))
    assert len(again) == len(history)
    for one, other in zip(again, history, strict=True):
        assert eqx.tree_equal(one, other)
    # Another stream on the same map, crowds included, gives another run.
    elsewhere = eqx.tree_at(lambda p: p.key, scenario_map, draw_map(problem, seed=7).key)
    other = follow_training(islice(train(SMALL, problem, elsewhere), 3))[-1][0]
    assert not np.allclose(other.network.value.weight, history[2][0].network.value.weight, atol=1e-3)
    assert not np.array_equal(other.replay.items.a_tm1, history[2][0].replay.items.a_tm1)


@pytest.mark.parametrize("rounds", [1, 7, 19])
def test_resumed_training_is_the_same_to_the_bit(
    history: list[tuple[TrainState, RoundReport]], problem: Scenario, scenario_map: ScenarioMap, rounds: int
) -> None:
    stored = jax.tree.map(np.copy, history[rounds - 1][0])
    resumed = follow_training(train(SMALL, problem, scenario_map, on_device(stored)))
    assert len(resumed) == 20 - rounds
    for one, other in zip(resumed, history[rounds:], strict=True):
        assert eqx.tree_equal(one, other)


def test_a_finished_run_does_not_go_on(states: list[TrainState], problem: Scenario, scenario_map: ScenarioMap) -> None:
    assert list(train(SMALL, problem, scenario_map, on_device(states[-1]))) == []


# --- Returns of several steps ---------------------------------------------------------------------------------------

# Everybody steps at random, so that a run does the same whatever it learns; the replay is large enough for all of it.
STROLL = dataclasses.replace(
    SMALL, rounds=3, round_steps=640, walkers=64, capacity=64 * 30, epsilon_end=1.0, random_origins=0.0
)
STEPS = 30


@pytest.fixture(scope="module")
def strolls() -> dict[int, Transition]:
    """What the replay holds, [iteration, walker], after the same walks with returns of one and of three steps."""
    # A reward is minus the minutes that a step takes, and nothing else.
    minutes = scenario(
        "paper-congested", side=3, crowded_nodes=1, horizon=3600.0, reward=RewardWeights(progress=0.0, bonus=0.0)
    )
    held = {}
    for n_step in (1, 3):
        config = dataclasses.replace(STROLL, n_step=n_step)
        *_, (state, _) = follow_training(train(config, minutes, draw_map(minutes, seed=6)))
        held[n_step] = jax.tree.map(lambda leaf: leaf.reshape(STEPS, 64, *leaf.shape[1:]), state.replay.items)
    return held


def walks_that_end(one: Transition) -> tuple[np.ndarray, np.ndarray]:
    """Which steps arrived, and which were cut off: by then the walk's steps took an hour."""
    arrived = one.discount_t == 0
    cut = np.zeros_like(arrived)
    minutes = np.zeros(64)
    for t in range(STEPS):
        minutes -= one.r_t[t]
        cut[t] = ~arrived[t] & (minutes >= 60)
        minutes[arrived[t] | cut[t]] = 0
    return arrived, cut


def test_a_return_of_three_steps_is_the_sum_of_three_rewards(strolls: dict[int, Transition]) -> None:
    one, three = strolls[1], strolls[3]
    arrived, cut = walks_that_end(one)
    lengths = np.zeros((STEPS, 64), int)
    # What iteration t hands on began two iterations before.
    for t in range(2, STEPS):
        for walker in range(64):
            total, discount = 0.0, 1.0
            for at in (t - 2, t - 1, t):
                total += discount * float(one.r_t[at, walker])
                discount *= 0.9
                lengths[t, walker] += 1
                if arrived[at, walker] or cut[at, walker]:
                    break
            # After an arrival nothing comes, after a walk that is cut off as much as after any other step.
            discount *= not arrived[at, walker]
            assert three.r_t[t, walker] == pytest.approx(total, rel=1e-5)
            assert three.discount_t[t, walker] == pytest.approx(discount, rel=1e-5)
            assert three.a_tm1[t, walker] == one.a_tm1[t - 2, walker]
            assert three.observation_tm1.node[t, walker] == one.observation_tm1.node[t - 2, walker]
            assert three.observation_t.node[t, walker] == one.observation_t.node[at, walker]
            assert (three.observation_t.position[t, walker] == one.observation_t.position[at, walker]).all()
    # Walks arrived and were cut off within the three steps, and at the last of them.
    for ends in (arrived, cut):
        assert set(lengths[2:][ends[:-2]]) == {1}
        assert {2, 3} & set(lengths[2:][ends[1:-1]])
        assert 3 in lengths[2:][ends[2:]]
    assert set(lengths[2:].ravel()) == {1, 2, 3}


def test_discounts_by_hand(strolls: dict[int, Transition]) -> None:
    # .9 after one step of a walk that is cut off, .81 after two, .729 after three; 0 after an arrival.
    found = np.unique(strolls[3].discount_t[2:].round(6))
    np.testing.assert_allclose(found, [0, 0.729, 0.81, 0.9], rtol=1e-5)
    np.testing.assert_allclose(np.unique(strolls[1].discount_t.round(6)), [0, 0.9], rtol=1e-5)


def test_until_three_steps_are_made_single_ones_are_handed_on(strolls: dict[int, Transition]) -> None:
    for one, three in zip(*(jax.tree.leaves(strolls[n]) for n in (1, 3)), strict=True):
        np.testing.assert_array_equal(one[:2], three[:2])


# --- Fresh crowds, and the level local ------------------------------------------------------------------------------

LOCAL = dataclasses.replace(
    preset("default", "local"), rounds=6, round_steps=64, walkers=16, batch=16, capacity=64, hidden=(8,), places=2,
    n_step=3, futures=4, fresh_futures=2, test_walks=2,
)  # fmt: skip


@pytest.fixture(scope="module")
def refreshed(problem: Scenario, scenario_map: ScenarioMap) -> list[tuple[TrainState, RoundReport]]:
    return follow_training(train(LOCAL, problem, scenario_map))


@pytest.mark.parametrize(
    ("rounds", "renewals"),
    [
        # Two of the four crowds after every round, in turn: number 1 replaces crowds 2 and 3, number 2 0 and 1, …
        (0, [(1, 2), (2, 0), (3, 2), (4, 0), (5, 2)]),
        (1, [(1, 2), (2, 0), (3, 2), (4, 0), (5, 2)]),
        (2, [(1, 2), (2, 0), (3, 2), (4, 0), (5, 2)]),
        # Number 3 has replaced what number 1 brought.
        (4, [(3, 2), (4, 0), (5, 2)]),
        (5, [(4, 0), (5, 2)]),
    ],
)
def test_with_fresh_crowds_and_returns_of_several_steps_training_resumes_to_the_bit(
    refreshed: list[tuple[TrainState, RoundReport]],
    problem: Scenario,
    scenario_map: ScenarioMap,
    monkeypatch: pytest.MonkeyPatch,
    rounds: int,
    renewals: list[tuple[int, int]],
) -> None:
    drawn, put = [], []

    def draw(*args: Any, futures: int) -> Any:
        assert futures == 2
        drawn.append(args[3])
        return sample_futures(*args, futures=futures)

    def replace(params: EnvParams, futures: Any, first: jax.Array) -> EnvParams:
        put.append(int(first))
        return replace_futures(params, futures, first)

    monkeypatch.setattr(training, "new_crowds", draw)
    monkeypatch.setattr(training, "put_crowds", replace)
    state = on_device(refreshed[rounds - 1][0]) if rounds else None
    resumed = follow_training(train(LOCAL, problem, scenario_map, state))
    assert list(zip(drawn, put, strict=False)) == renewals
    assert len(resumed) == 6 - rounds
    for one, other in zip(resumed, refreshed[rounds:], strict=True):
        assert eqx.tree_equal(one, other)


def test_fresh_crowds_are_met(
    refreshed: list[tuple[TrainState, RoundReport]],
    problem: Scenario,
    scenario_map: ScenarioMap,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(training, "put_crowds", lambda params, _futures, _first: params)
    stale = follow_training(islice(train(LOCAL, problem, scenario_map), 2))
    assert eqx.tree_equal(refreshed[0], stale[0])
    # From the second round on walkers meet others.
    assert not eqx.tree_equal(refreshed[1][0].replay.items.r_t, stale[1][0].replay.items.r_t)


def test_several_maps_and_destinations_are_learned_together() -> None:
    several = scenario("unseen-maps", side=3, larger=(), training_maps=2, crowded_nodes=1, horizon=3600.0)
    config = dataclasses.replace(
        preset("default", "live", several_maps=True), rounds=2, round_steps=256, walkers=64, batch=32, capacity=256,
        hidden=(8,), n_step=2, destinations=2, futures=4, fresh_futures=2, test_walks=4,
    )  # fmt: skip
    scenario_map = draw_training_map(several, seed=3)
    assert scenario_map.parts == (9, 9)
    destinations = standard_destinations(scenario_map.parts, 2)
    states = [state for state, _ in follow_training(train(config, several, scenario_map))]
    assert len(states) == 2
    walks = states[-1].walkers.state.instance
    # Every walk stays on its own map, and heads for one of the goals there.
    part, heads_for = walks.origin // 9, walks.destination
    np.testing.assert_array_equal(part, heads_for // 9)
    assert set(heads_for.tolist()) == set(destinations.ravel().tolist())
    np.testing.assert_array_equal(heads_for, destinations[walks.future % 2, part])
