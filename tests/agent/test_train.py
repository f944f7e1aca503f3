"""Training: one small run looked at iteration by iteration, and several maps at once."""

from collections.abc import Iterator
from itertools import islice, pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent.acting import ACTING_DRAWS
from sidestep.agent.checkpoint import Checkpoint, Metadata
from sidestep.agent.config import TrainConfig
from sidestep.agent.presets import preset
from sidestep.agent.q_networks import DuelingQNetwork
from sidestep.agent.td import mask
from sidestep.agent.train import RoundReport, TrainState, training_rounds, uniform_draws
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import destinations_of
from sidestep.scenarios.maps import ScenarioMap, draw_map, draw_training_map
from sidestep.scenarios.model import Scenario

# --- One small run --------------------------------------------------------------------------------------------------

# A round is one iteration, so that nothing is hidden inside one: 64 walkers, a ring of 4 iterations. The horizon of
# an hour cuts many walks off, and the learning rate is so high that the greedy walk keeps changing.
SMALL = TrainConfig(
    rounds=20, round_steps=64, walkers=64, batch=32, capacity=256, alpha=0.6, beta=0.4, priority_floor=0.01,
    gamma=0.9, double=True, hidden=(8,), one_hot=True, unit=5.0, target_period=5, target_rate=1.0,
    optimiser="rmsprop", learning_rate=0.3, learning_rate_end=0.0, decay=0.9, damping=1e-10,
    epsilon=1.0, epsilon_end=0.0, epsilon_share=0.5, random_origins=0.5, keep="best",
)  # fmt: skip
ORIGIN, DESTINATION = 0, 8  # corners of three by three nodes
RING = SMALL.capacity // SMALL.walkers


@pytest.fixture(scope="module")
def problem() -> Scenario:
    return scenario("paper-congested", side=3, crowded_nodes=1, horizon=3600.0)


@pytest.fixture(scope="module")
def scenario_map(problem: Scenario) -> ScenarioMap:
    return draw_map(problem, seed=6)


def on_host(tree: TrainState) -> TrainState:
    """A copy in host memory."""
    return jax.tree.map(np.asarray, tree)


def on_device(tree: TrainState) -> TrainState:
    """The way back."""
    return jax.tree.map(jnp.asarray, tree)


def follow_training(run: Iterator[tuple[TrainState, RoundReport]]) -> list[tuple[TrainState, RoundReport]]:
    """Host copies of what training yields, each taken before the next round uses it up."""
    return [(on_host(state), jax.tree.map(np.asarray, report)) for state, report in run]


@pytest.fixture(scope="module")
def history(problem: Scenario, scenario_map: ScenarioMap) -> list[tuple[TrainState, RoundReport]]:
    """State and report after every iteration."""
    return follow_training(training_rounds(SMALL, problem, scenario_map))


@pytest.fixture(scope="module")
def states(history: list[tuple[TrainState, RoundReport]]) -> list[TrainState]:
    return [state for state, _ in history]


def latest(state: TrainState) -> Any:
    """The transitions of the last iteration, from its place in the ring."""
    first = (int(state.iteration) - 1) % RING * SMALL.walkers
    rows = jnp.asarray(state.replay.rows[first : first + SMALL.walkers])
    return jax.tree.map(np.asarray, state.replay.layout.unpack(rows))


def truncated(state: TrainState) -> np.ndarray:
    """Which walkers were cut off in the last iteration: they begin again without having arrived."""
    begun = state.walkers.state.clock == state.walkers.state.instance.departure
    return begun & (latest(state).observation_t.node != DESTINATION)


def test_counts_rounds_and_iterations(history: list[tuple[TrainState, RoundReport]]) -> None:
    assert [int(state.iteration) for state, _ in history] == list(range(1, 21))
    assert [int(state.replay.added) for state, _ in history] == list(range(64, 21 * 64, 64))
    assert all(report.test_minutes.shape == (10,) for _, report in history)
    assert all(np.isfinite(report.learned.loss) and report.learned.loss > 0 for _, report in history)


def test_every_round_draws_its_own_numbers() -> None:
    draws = [uniform_draws(SMALL, [1, 2], number) for number in range(20)]
    draws += [uniform_draws(SMALL, [1, 3], 0), uniform_draws(SMALL, [1, 2], 0, start=True)]
    assert len({each[:, 0].tobytes() for each in draws}) == 22
    assert draws[0].shape == (SMALL.iterations, SMALL.walkers * ACTING_DRAWS + SMALL.batch)
    np.testing.assert_array_equal(draws[3], uniform_draws(SMALL, [1, 2], 3))


def test_the_target_is_copied_every_k_iterations(states: list[TrainState]) -> None:
    for before, after in pairwise(states):
        assert not eqx.tree_equal(after.learner.q_network, before.learner.q_network)
        copied = int(after.iteration) % 5 == 0
        assert eqx.tree_equal(after.learner.target, after.learner.q_network if copied else before.learner.target)


def test_what_the_replay_holds_happened(states: list[TrainState], scenario_map: ScenarioMap) -> None:
    for before, after in pairwise(states):
        seen = latest(after)
        assert eqx.tree_equal(seen.observation_tm1, before.walkers.observation)
        np.testing.assert_array_equal(
            np.asarray(scenario_map.network.exit_node)[seen.observation_tm1.node, seen.a_tm1], seen.observation_t.node
        )
        # Who is still on the way stands where the transition ended; the others have begun anew.
        over = (seen.observation_t.node == DESTINATION) | truncated(after)
        np.testing.assert_array_equal(after.walkers.observation.node[~over], seen.observation_t.node[~over])
        assert (after.walkers.state.clock[~over] > before.walkers.state.clock[~over]).all()
        assert (after.walkers.state.clock[over] == 0).all()


def test_arriving_ends_the_future_and_the_horizon_does_not(states: list[TrainState]) -> None:
    arrived = cut = 0
    for state in states:
        seen, cut_off = latest(state), truncated(state)
        at_destination = seen.observation_t.node == DESTINATION
        np.testing.assert_allclose(seen.discount_t, np.where(at_destination, 0, 0.9), rtol=1e-6)
        arrived, cut = arrived + at_destination.sum(), cut + cut_off.sum()
    assert arrived > 0
    assert cut > 0  # walks were cut off, and the line above found the 0.9 beside them


def test_reward_is_minutes_and_progress(states: list[TrainState], scenario_map: ScenarioMap) -> None:
    position = np.asarray(scenario_map.network.position)
    far = np.linalg.norm(position - position[DESTINATION], axis=1)
    for before, after in pairwise(states):
        seen = latest(after)
        arrived = seen.observation_t.node == DESTINATION
        going = ~arrived & ~truncated(after)
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
        best = np.asarray(greedy(before.learner.q_network, seen.observation_tm1))
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


def test_walks_begin_anywhere_for_the_configured_share(states: list[TrainState]) -> None:
    def origins(some: list[TrainState]) -> set[int]:
        begun = [state.walkers.state.clock == 0 for state in some]
        return set(
            np.concatenate(
                [state.walkers.state.instance.origin[new] for state, new in zip(some, begun, strict=True)]
            ).tolist()
        )

    assert origins(states[:10]) == set(range(9)) - {DESTINATION}
    assert origins(states[10:]) == {ORIGIN}


def test_the_best_network_is_that_of_the_shortest_tests(history: list[tuple[TrainState, RoundReport]]) -> None:
    minutes = [report.test_minutes.mean() for _, report in history]
    for number, (state, _) in enumerate(history, start=1):
        shortest = min(minutes[:number])
        # The later of equals has learned more.
        latest_best = max(i for i in range(number) if minutes[i] == shortest)
        assert eqx.tree_equal(state.kept, history[latest_best][0].learner.q_network)
        assert state.best_minutes == pytest.approx(shortest)  # means may differ in the last digit


@pytest.mark.parametrize(("best_so_far", "replaced"), [(1.0, False), (1000.0, True)])
def test_the_best_network_stays_until_a_better_one_comes(
    states: list[TrainState], problem: Scenario, scenario_map: ScenarioMap, best_so_far: float, replaced: bool
) -> None:
    other = jax.tree.map(lambda leaf: leaf + 1, states[0].learner.q_network)
    before = eqx.tree_at(lambda s: (s.kept, s.best_minutes), states[8], (other, np.float32(best_so_far)))
    after, report = follow_training(islice(training_rounds(SMALL, problem, scenario_map, on_device(before)), 1))[0]
    assert 1 < report.test_minutes.mean() < 1000
    assert eqx.tree_equal(after.kept, after.learner.q_network if replaced else other)
    assert after.best_minutes == (report.test_minutes.mean() if replaced else best_so_far)


def test_the_mean_is_of_the_networks_of_the_last_quarter_of_rounds(
    states: list[TrainState], problem: Scenario, scenario_map: ScenarioMap
) -> None:
    means = [
        state.kept for state, _ in follow_training(training_rounds(SMALL.changed(keep="mean"), problem, scenario_map))
    ]
    # What is kept changes nothing that is learned, but for last digits: the two are compiled apart.
    networks = [state.learner.q_network for state in states]
    for mean, network in zip(means[:16], networks[:16], strict=True):
        assert eqx.tree_equal(mean, network, rtol=1e-5, atol=1e-6)
    for rounds in (17, 18, 20):
        expected = jax.tree.map(lambda *leaves: np.mean(leaves, axis=0), *networks[15:rounds])
        assert eqx.tree_equal(means[rounds - 1], expected, rtol=1e-4, atol=1e-5)
    assert not eqx.tree_equal(means[-1], networks[-1], rtol=1e-2)


def test_keep_chooses_between_best_and_last(states: list[TrainState], problem: Scenario) -> None:
    state = eqx.tree_at(lambda s: s.kept, states[3], jax.tree.map(lambda leaf: leaf + 1, states[3].learner.q_network))
    for keep, kept in (("best", state.kept), ("last", state.learner.q_network)):
        metadata = Metadata(scenario=problem, seed=6, map=0, config=SMALL.changed(keep=keep), fingerprint="")
        assert Checkpoint(metadata, state).model.q_network is kept


def test_the_same_seed_gives_the_same_run_to_the_bit(
    history: list[tuple[TrainState, RoundReport]], problem: Scenario, scenario_map: ScenarioMap
) -> None:
    again = follow_training(training_rounds(SMALL, problem, draw_map(problem, seed=6)))
    assert len(again) == len(history)
    for one, other in zip(again, history, strict=True):
        assert eqx.tree_equal(one, other)
    # Another stream on the same map, crowds included, gives another run.
    elsewhere = eqx.tree_at(lambda p: p.key, scenario_map, draw_map(problem, seed=7).key)
    other = follow_training(islice(training_rounds(SMALL, problem, elsewhere), 3))[-1][0]
    assert not np.allclose(
        other.learner.q_network.value.weight, history[2][0].learner.q_network.value.weight, atol=1e-3
    )
    assert not np.array_equal(latest(other).a_tm1, latest(history[2][0]).a_tm1)


@pytest.mark.parametrize("rounds", [1, 7, 19])
def test_resumed_training_is_the_same_to_the_bit(
    history: list[tuple[TrainState, RoundReport]], problem: Scenario, scenario_map: ScenarioMap, rounds: int
) -> None:
    stored = jax.tree.map(np.copy, history[rounds - 1][0])
    resumed = follow_training(training_rounds(SMALL, problem, scenario_map, on_device(stored)))
    assert len(resumed) == 20 - rounds
    for one, other in zip(resumed, history[rounds:], strict=True):
        assert eqx.tree_equal(one, other)


def test_a_finished_run_does_not_go_on(states: list[TrainState], problem: Scenario, scenario_map: ScenarioMap) -> None:
    assert list(training_rounds(SMALL, problem, scenario_map, on_device(states[-1]))) == []


# --- Several maps ---------------------------------------------------------------------------------------------------


def test_several_maps_and_destinations_are_learned_together() -> None:
    several = scenario("unseen-maps", side=3, larger=(), training_maps=2, crowded_nodes=1, horizon=3600.0)
    config = preset("default", "live", several_maps=True).changed(
        rounds=2, round_steps=256, walkers=64, batch=32, capacity=256,
        hidden=(8,), n_step=2, destinations=2, futures=4, fresh_futures=2, test_walks=4,
    )  # fmt: skip
    scenario_map = draw_training_map(several, seed=3)
    assert scenario_map.parts == (9, 9)
    destinations = destinations_of(scenario_map, 2)
    states = [state for state, _ in follow_training(training_rounds(config, several, scenario_map))]
    assert len(states) == 2
    walks = states[-1].walkers.state.instance
    # Every walk stays on its own map, and heads for one of the destinations there.
    part, heads_for = walks.origin // 9, walks.destination
    np.testing.assert_array_equal(part, heads_for // 9)
    assert set(heads_for.tolist()) == set(destinations.ravel().tolist())
    np.testing.assert_array_equal(heads_for, destinations[walks.future % 2, part])
