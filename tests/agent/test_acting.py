"""Acting: ε falls as configured, and returns of several steps are sums of rewards."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent.acting import ACTING_DRAWS, Transition, act, by_value, epsilon, place_walkers
from sidestep.agent.policy import Policy
from sidestep.agent.presets import PRESETS
from sidestep.agent.problem import Problem
from sidestep.agent.q_networks import QTable
from sidestep.environment.types import Observation
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances, sampler
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import RewardSpec


@pytest.mark.parametrize(
    ("share", "iteration", "chance"),
    [(1.0, 0, 0.9), (1.0, 10, 0.5), (1.0, 20, 0.1), (0.5, 5, 0.5), (0.5, 10, 0.1), (0.5, 17, 0.1)],
)
def test_epsilon_falls_linearly_over_its_share(share: float, iteration: int, chance: float) -> None:
    # Twenty iterations in all.
    config = PRESETS["paper"].changed(rounds=2, round_steps=10, epsilon=0.9, epsilon_end=0.1, epsilon_share=share)
    assert float(epsilon(config, jnp.int32(iteration))) == pytest.approx(chance)


UNIFORM = (jnp.arange(600) + 0.5) / 600


@pytest.mark.parametrize(
    ("temperature", "shares"),
    # Q of 0, ln 2, ln 3 and an exit that does not exist: in proportion 1 : 2 : 3, at half the temperature 1 : 4 : 9.
    [(1.0, [100, 200, 300, 0]), (0.5, [43, 171, 386, 0]), (0.0, [0, 0, 600, 0]), (1e-3, [0, 0, 600, 0])],
)
def test_exits_are_taken_in_proportion_to_their_values(temperature: float, shares: list[int]) -> None:
    policy = Policy(QTable(jnp.log(jnp.array([[1.0, 2.0, 3.0, 100.0]]))))
    position, node, valid = jnp.zeros(2), jnp.int32(0), jnp.array([True, True, True, False])
    seen = Observation(position=position, node=node, valid=valid, steps=jnp.int32(0))
    taken = jax.vmap(lambda uniform: by_value(policy, temperature, seen, uniform))(UNIFORM)
    np.testing.assert_array_equal(np.bincount(taken, minlength=4), shares)


@pytest.mark.parametrize("uniform", [0.0, 1 - 2.0**-24])
def test_no_uniform_number_leads_to_an_exit_that_does_not_exist(uniform: float) -> None:
    policy = Policy(QTable(jnp.array([[0.0, 1.7, -0.3, 0.0]])))
    valid = jnp.array([False, True, True, False])
    seen = Observation(position=jnp.zeros(2), node=jnp.int32(0), valid=valid, steps=jnp.int32(0))
    assert valid[by_value(policy, 0.7, seen, jnp.float32(uniform))]


# --- Returns of several steps ---------------------------------------------------------------------------------------

# Every step is a random one, so that walkers do the same whatever their policy.
STROLL = PRESETS["default"].changed(rounds=3, round_steps=640, walkers=64, gamma=0.9, epsilon=1.0, epsilon_end=1.0)
STEPS = 30


@pytest.fixture(scope="module")
def strolls() -> dict[int, Transition]:
    """Transitions, [iteration, walker], of the same walks with returns of one and of three steps."""
    # A reward is minus the minutes that a step takes, and nothing else.
    minutes = scenario(
        "paper-congested", side=3, crowded_nodes=1, horizon=3600.0, reward=RewardSpec(progress=0.0, bonus=0.0)
    )
    scenario_map = draw_map(minutes, seed=6)
    params = make_environment(minutes, scenario_map, "learn", 8)
    problem = Problem(params, sampler(minutes, scenario_map, params, 8), instances(minutes, scenario_map, params, 1))
    policy = Policy(QTable(jnp.zeros((params.network.nodes, params.network.exits))))
    begin, draws = (
        jax.random.uniform(jax.random.key(number), shape)
        for number, shape in enumerate([(64, 4), (STEPS, 64, ACTING_DRAWS)])
    )
    held = {}
    for n_step in (1, 3):
        config = STROLL.changed(n_step=n_step)
        one = partial(act, config, problem, policy)
        walkers, _ = place_walkers(config, problem, begin)
        stroll = jax.jit(
            lambda walkers, one=one: jax.lax.scan(lambda w, x: one(w, *x), walkers, (jnp.arange(STEPS), draws))
        )
        held[n_step] = jax.tree.map(np.asarray, stroll(walkers)[1])
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
