"""The shape of gymnax's environments, in both of its versions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.gym import EnvError
from sidestep.gym.gymnax import Box, Dict, Discrete, GymnaxEnv, GymnaxParams
from sidestep.scenarios.model import Scenario


@pytest.mark.parametrize("api", ["0.0.9", "1.0"])
def test_walks_begin_anew_inside_a_step(small: Scenario, api: str) -> None:
    env = GymnaxEnv(small, api=api, futures=3, walks="anywhere")
    params, core = env.default_params, jax.jit(lambda task, *walk: task.step(*walk))

    @jax.jit
    def step(params: GymnaxParams, *walk: object) -> tuple:
        return env.step(*walk, params)

    observation, state = env.reset(jax.random.PRNGKey(0), params)
    ended, actions = 0, np.random.default_rng(0).integers(4, size=60)
    for number in range(60):
        key, action = jax.random.PRNGKey(number), jnp.int32(actions[number])
        after, outcome = core(params.task, state, action)
        observation, state, reward, *ends, info = step(params, key, state, action)
        assert reward == outcome.reward
        assert [bool(end) for end in ends] == [bool(outcome.terminated), False][: len(ends)]
        np.testing.assert_array_equal(info["final_observation"], params.task.encode(outcome.observation))
        expected = params.task.start(key) if ends[0] else after
        assert int(state.node) == int(expected.node)
        np.testing.assert_array_equal(observation, env.get_obs(state, params))
        np.testing.assert_array_equal(info["action_mask"], env.action_mask(state, params))
        assert info["discount"] == 1 - outcome.terminated
        ended += bool(ends[0])
    assert ended > 2


def test_walks_are_cut_off_at_the_most_steps(small: Scenario) -> None:
    for api in ("0.0.9", "1.0"):
        env = GymnaxEnv(small, api=api, futures=3)
        params = env.default_params.replace(max_steps_in_episode=2)
        _, state = env.reset(jax.random.key(0), params)
        for action in (2, 3):
            _, after, _, *ends, info = env.step(jax.random.key(1), state, action, params)
            _, unreset, _, over, _ = env.step_env(jax.random.key(1), state, action, params)
            assert bool(over) == (api == "0.0.9" and action == 3) == bool(env.is_terminal(unreset, params))
            assert bool(env.is_truncated(unreset, params)) == (action == 3)
            state = after
        assert bool(ends[-1])
        assert bool(info["truncated"])
        assert state.steps == 0


def test_spaces_hold_what_is_shown(small: Scenario) -> None:
    env = GymnaxEnv(small, level="local", futures=3, mask="dict")
    observation, _ = env.reset(jax.random.key(0))
    space, actions = env.observation_space(env.default_params), env.action_space()
    assert isinstance(space, Dict)
    assert isinstance(space.spaces["observation"], Box)
    assert isinstance(actions, Discrete)
    assert (actions.n, env.num_actions, env.name) == (4, 4, "paper-congested")
    assert space.contains(observation)
    drawn = space.sample(jax.random.key(0))
    assert {name: one.shape for name, one in drawn.items()} == {"observation": (44,), "action_mask": (4,)}
    assert actions.contains(actions.sample(jax.random.key(0)))
    assert GymnaxEnv(small, futures=3, observation="node").observation_space().n == 9
    assert GymnaxEnv(small, futures=3, observation="one-hot").observation_space().shape == (9,)


def test_another_version_is_refused(small: Scenario) -> None:
    with pytest.raises(EnvError) as error:
        GymnaxEnv(small, api="2.0")
    assert error.value.field == "api"
