"""Probe environments whose Q-values are known exactly: which part of the learner is broken, if one is.

Streets take whole minutes at constant speed. Nodes stand 500 m apart along x, so that a step towards the destination
is worth w_r * 500 = 0.5, and arriving 1. Walkers step at random, so that every exit of every node is learned.
"""

from functools import partial
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent.config import TrainConfig
from sidestep.agent.presets import PRESETS
from sidestep.agent.problem import Problem
from sidestep.agent.train import RoundReport, start, train_round
from sidestep.crowds.arima import ArimaFlow, load_fitted
from sidestep.environment.types import EnvParams, Instance, Observation, futures_in_turn
from sidestep.network.graph import road_network
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import InstanceSampler
from sidestep.scenarios.maps import ScenarioMap
from sidestep.walking.speed_field import speed_field

METRES = 60.0  # of every street
Minutes = tuple[float, ...]  # in each future
Streets = dict[tuple[int, int], Minutes]  # (from, to)

# The default, but small, for ever exploring, and discounting.
DEFAULT = PRESETS["default"].changed(
    rounds=10, round_steps=4_800, walkers=16, batch=64, capacity=16_384, hidden=(16, 16), gamma=0.8,
    epsilon_end=1.0,
)  # fmt: skip
# The paper's learner: one network selects and values, and is copied; coordinates alone; RMSProp, in larger steps.
PAPER = PRESETS["paper"].changed(
    rounds=4, round_steps=16_000, walkers=16, hidden=(16, 16), gamma=0.8,
    epsilon=1.0, epsilon_end=1.0, learning_rate=3e-3, learning_rate_end=0.0, target_period=50,
)  # fmt: skip


NODES, FUTURES = 6, 4  # of all probes, so that they share compiled programs


def probe(x: list[int], streets: Streets, horizon: float = 1e6) -> EnvParams:
    """An environment of streets with constant speeds; exits are numbered as they are listed.

    Small ones get more nodes, with streets to each other, and repeat their futures.
    """
    spare = both_ways(dict.fromkeys(combinations(range(len(x), NODES), 2), (1.0,)))
    every = {pair: np.resize(minutes, FUTURES) for pair, minutes in (streets | spare).items()}
    tail, head = zip(*every, strict=True)
    position = 500.0 * np.stack([np.resize(x, NODES), np.zeros(NODES)], axis=1)
    network = road_network(position, tail, head, [METRES] * len(tail))
    minutes = np.array(list(every.values())).T[..., None]  # [future, segment, slot]
    speed = jnp.asarray(METRES / (60 * minutes), jnp.float32)
    futures = futures_in_turn(speed_field(speed, 300.0), jnp.zeros(1))
    return EnvParams(network, futures, speed_field(speed[:1], 300.0), jnp.float32(horizon))


def learn(config: TrainConfig, params: EnvParams, destination: int, nodes: int) -> tuple[np.ndarray, RoundReport]:
    """Q-values [node, exit] after training from all nodes, NaN where there is no exit, and the last greedy walks."""
    origins = np.resize([node for node in range(nodes) if node != destination], NODES - 1)
    anywhere = InstanceSampler(
        origins=jnp.asarray(origins)[None],
        destinations=jnp.full((1, NODES - 1), destination),
        departures=jnp.zeros(2),
        futures=jnp.arange(FUTURES)[None],
        counts=jnp.array([FUTURES]),
    )
    walks = [jnp.full(2, number) for number in (0, destination)]
    tests = Instance(*walks, jnp.zeros(2), jnp.array([0, FUTURES - 1]))
    # Training takes from a map only its random stream: what it meets is in the environment.
    flow = ArimaFlow(jnp.zeros(params.network.segments), load_fitted())
    scenario_map = ScenarioMap(params.network, flow, flow, jax.random.key(0), (NODES,))
    problem = Problem(params, anywhere, tests)
    begin = jax.jit(partial(start, config, scenario("paper-unblocked")))  # one array for each number, to be used up
    state = begin(problem, scenario_map)
    for _ in range(config.rounds):
        state, report = train_round(config, problem, state)
    seen = jax.vmap(Observation)(
        jnp.arange(NODES), params.network.position, params.network.valid, jnp.zeros(NODES, int)
    )
    q = jax.jit(jax.vmap(state.learner.q_network))(seen)
    return np.where(seen.valid, q, np.nan)[:nodes], report


def both_ways(streets: Streets) -> Streets:
    """The streets and their way back, which takes as long."""
    return streets | {(head, tail): minutes for (tail, head), minutes in streets.items()}


@pytest.mark.parametrize("config", [DEFAULT, PAPER], ids=["default", "paper"])
class TestLine:
    """0 -- 4 min -- 1 -- 9 min -- 2: exits of node 1 are 0 to node 2 and 1 back to node 0."""

    streets = both_ways({(0, 1): (4,), (1, 2): (9,)})

    def test_one_step_to_the_destination(self, config: TrainConfig) -> None:
        q, report = learn(config, probe([0, 1, 2], self.streets), destination=1, nodes=3)
        # -c + w_r * 500 + 1: from node 0 -4 + .5 + 1, from node 2 -9 + .5 + 1.
        np.testing.assert_allclose(q[[0, 2], 0], [-2.5, -7.5], rtol=0.01)
        np.testing.assert_allclose(report.test_minutes, 4, rtol=1e-4)
        assert report.test_arrived.all()

    def test_two_steps_are_discounted(self, config: TrainConfig) -> None:
        q, report = learn(config, probe([0, 1, 2], self.streets), destination=2, nodes=3)
        # From node 1: -9 + .5 + 1 = -7.5. From node 0: -4 + .5 + .8 * -7.5 = -9.5.
        # Back from 1 to 0: -4 - .5 + .8 * -9.5 = -12.1.
        np.testing.assert_allclose([q[1, 0], q[0, 0], q[1, 1]], [-7.5, -9.5, -12.1], rtol=0.02)
        np.testing.assert_allclose(report.test_minutes, 13, rtol=1e-4)


# The baselines, likewise small, exploring and discounting.
TABLE = PRESETS["tabular-q"].changed(
    rounds=4, round_steps=38_400, gamma=0.8, epsilon_end=1.0,
)  # fmt: skip
DQN = DEFAULT.changed(dueling=False, double=False, alpha=0.0)


@pytest.mark.parametrize(("config", "rtol"), [(TABLE, 1e-4), (DQN, 0.02)], ids=["tabular-q", "dqn"])
def test_baselines_on_the_line(config: TrainConfig, rtol: float) -> None:
    q, report = learn(config, probe([0, 1, 2], TestLine.streets), destination=2, nodes=3)
    # As above; what is beyond the destination is never learned, and means nothing.
    np.testing.assert_allclose(q[:2], [[-9.5, np.nan], [-7.5, -12.1]], rtol=rtol)
    np.testing.assert_allclose(report.test_minutes, 13, rtol=1e-4)
    assert report.test_arrived.all()


def test_the_baselines_are_the_presets() -> None:
    for name, config in (("tabular-q", TABLE), ("dqn", DQN)):
        has = PRESETS[name]
        for setting in ("table", "dueling", "double", "alpha", "unit", "target_rate", "target_period", "optimiser"):
            assert getattr(config, setting) == getattr(has, setting), setting
    table = PRESETS["tabular-q"]
    assert TABLE.learning_rate / TABLE.batch == table.learning_rate / table.batch


class TestDiamond:
    """Two ways from node 0 to node 3: by node 1 (exit 0) and by node 2 (exit 1). Four futures, met equally often."""

    @staticmethod
    def learn(by_1: tuple[Minutes, Minutes], by_2: tuple[Minutes, Minutes]) -> tuple[np.ndarray, RoundReport]:
        streets = both_ways({(0, 1): by_1[0], (0, 2): by_2[0], (1, 3): by_1[1], (2, 3): by_2[1]})
        return learn(DEFAULT, probe([0, 1, 1, 2], streets), destination=3, nodes=4)

    def test_takes_the_fast_way(self) -> None:
        # By node 1 it is crowded: 6 + 10 minutes. By node 2: 7 + 3, though its first street takes longer.
        q, report = self.learn(by_1=((6,) * 4, (10,) * 4), by_2=((7,) * 4, (3,) * 4))
        # The last steps: -10 + 1.5 = -8.5 and -3 + 1.5 = -1.5. Node 0: -6 + .5 + .8 * -8.5 = -12.3 and
        # -7 + .5 + .8 * -1.5 = -7.7. Back from 1 to 0: -6 - .5 + .8 * -7.7 = -12.66, from 2: -7 - .5 - 6.16 = -13.66.
        np.testing.assert_allclose(q[:3], [[-12.3, -7.7], [-8.5, -12.66], [-1.5, -13.66]], rtol=0.02)
        np.testing.assert_allclose(report.test_minutes, 10, rtol=1e-4)

    def test_learns_the_mean_over_futures(self) -> None:
        # By node 1 it is 2 + 3 minutes in three futures and 10 + 11 in the fourth: 4 + 5 in the mean. By node 2 always
        # 5 + 5. The rare future is a surprise and replayed more often than met: without importance weights node 1 would
        # seem to take 4.7 minutes and 5.7 from there (where 3 δ^1.6 of the one balances δ^1.6 of the other).
        q, report = self.learn(by_1=((2, 2, 2, 10), (3, 3, 3, 11)), by_2=((5,) * 4, (5,) * 4))
        # The last steps: -5 + 1.5 = -3.5. Node 0: -4 + .5 + .8 * -3.5 = -6.3 and -5 + .5 - 2.8 = -7.3.
        # Back to node 0: -4 - .5 + .8 * -6.3 = -9.54 and -5 - .5 - 5.04 = -10.54.
        np.testing.assert_allclose(q[:3], [[-6.3, -7.3], [-3.5, -9.54], [-3.5, -10.54]], rtol=0.1)
        np.testing.assert_allclose(report.test_minutes, [5, 21], rtol=1e-4)


def test_the_horizon_does_not_end_the_future() -> None:
    # A corridor 0 -- 1 -- … -- 5 of 3 minutes a street and a horizon of one minute: every walk is cut off after a step.
    corridor = both_ways({(node, node + 1): (3,) for node in range(5)})
    q, report = learn(DEFAULT, probe([0, 1, 2, 3, 4, 5], corridor, horizon=60.0), destination=5, nodes=6)
    # Every step onward is -3 + .5, and arriving 1 more: from node 4 -1.5, from node 3 -2.5 + .8 * -1.5 = -3.7, from
    # node 2 -2.5 + .8 * -3.7 = -5.46, and so on. Counted as ends, the steps short of node 5 would be worth -2.5 each.
    onward = q[np.arange(5), 0]
    np.testing.assert_allclose(onward, [-7.9944, -6.868, -5.46, -3.7, -1.5], rtol=0.02)
    # A step back from node k to k - 1 costs 3 + .5 and .8 of what the way from there is worth.
    np.testing.assert_allclose(q[1:5, 1], -3.5 + 0.8 * onward[:4], rtol=0.02)
    assert not report.test_arrived.any()  # the test walks from node 0 are cut off too
