"""The vector environment: the same as single environments side by side, in one call."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from sidestep.gym import EnvError, WalkEnv, WalkVectorEnv
from sidestep.scenarios.model import Scenario

WALKERS = 5


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("mask", ["info", "dict"])
def test_walkers_walk_as_single_environments_do(small: Scenario, mode: AutoresetMode, mask: str) -> None:
    options = {"scenario": small, "futures": 3, "walks": "anywhere", "mask": mask}
    ours = gymnasium.make_vec("sidestep/PaperGrid-v0", WALKERS, autoreset_mode=mode, **options)
    assert isinstance(ours, WalkVectorEnv)
    assert ours.metadata["autoreset_mode"] is mode
    theirs = SyncVectorEnv([lambda: WalkEnv(**options) for _ in range(WALKERS)], autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    ours.action_space.seed(0)
    assert data_equivalence(ours.reset(seed=7), theirs.reset(seed=7))
    ended = 0
    for _ in range(60):
        actions = ours.action_space.sample()
        told, expected = ours.step(actions), theirs.step(actions)
        for one, other in zip(told, expected, strict=True):
            assert data_equivalence(one, other), (one, other)
        ended += told[2].sum()
    assert ended > WALKERS
    assert data_equivalence(ours.reset(), theirs.reset())


def test_pickles_are_environments_of_the_same_options(small: Scenario) -> None:
    envs = WalkVectorEnv(small, 2, futures=3, autoreset_mode="SameStep")
    again = pickle.loads(pickle.dumps(envs))  # noqa: S301
    assert again.options == envs.options
    assert data_equivalence(again.reset(seed=3), envs.reset(seed=3))


def test_walks_that_are_over_wait_for_a_reset(small: Scenario) -> None:
    envs = WalkVectorEnv(small, 2, futures=3, autoreset_mode="Disabled")
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step([0, 0])
    envs.reset(seed=0)
    for actions in ([2, 2], [2, 3], [0, 2], [0, 2]):
        _, _, terminated, _, _ = envs.step(np.array(actions))
    assert terminated.tolist() == [True, False]
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros(2, int))
    _, infos = envs.reset(options={"reset_mask": np.array([True, False]), "future": [2, 1]})
    assert infos["node"].tolist() == [0, 2]
    assert infos["future"][0] == 2
    assert infos["_node"].tolist() == [True, False]
    envs.step(np.zeros(2, int))


def test_seeds_may_be_one_for_each_walker_and_for_some_of_them(small: Scenario) -> None:
    envs = WalkVectorEnv(small, 3, futures=50, walks="anywhere")

    def walks(options: dict | None = None, **seed: object) -> list[list[tuple[int, int]]]:
        infos = [envs.reset(options=options, **seed)[1], envs.reset()[1]]
        return [[(info["node"][walker], info["future"][walker]) for info in infos] for walker in range(3)]

    envs.reset(options={"reset_mask": np.array([False, True, False])})  # the first time all begin
    first, second, third = walks(seed=[4, 2**70, 4])
    assert first == third != second
    assert walks(seed=4)[0] == first
    again = walks({"reset_mask": np.array([False, True, False])}, seed=[0, 4, 0])
    assert again[1] == first
    assert again[0] != first
    for seed in ([1, 2], [1, 2, -1], [1, 2, 0.5], "123", 0.5, [1, 2, None]):
        with pytest.raises(EnvError) as error:
            envs.reset(seed=seed)
        assert error.value.field == "seed"
    with pytest.raises(gymnasium.error.Error):
        envs.reset(seed=-1)
    with pytest.raises(EnvError):
        envs.reset(seed=1, options={"future": 50})
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step([0, 0, 0])


def test_walks_are_cut_off(small: Scenario) -> None:
    envs = WalkVectorEnv(small, 1, futures=3, max_episode_steps=3)
    envs.reset(seed=0)
    ends = [bool(envs.step([action])[3][0]) for action in (2, 3, 2, 0, 2, 3, 2)]
    assert ends == [False, False, True, False, False, False, True]


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"num_envs": 0}, "num_envs"), ({"autoreset_mode": "never"}, "autoreset_mode"), ({"levels": 1}, "levels"),
        ({"max_episode_steps": 0}, "max_episode_steps"), ({"observation": "node", "level": "map"}, "observation"),
        ({"destinations": 2}, "destinations"), ({"futures": 1.5}, "futures"), ({"render_mode": "ansi"}, "render_mode"),
    ],
)  # fmt: skip
def test_options_that_are_wrong_are_named(small: Scenario, options: dict, field: str) -> None:
    with pytest.raises(EnvError) as error:
        WalkVectorEnv(small, **options)
    assert error.value.field == field


def test_actions_of_another_shape_are_refused(small: Scenario) -> None:
    envs = WalkVectorEnv(small, 2, futures=3)
    envs.reset(seed=0)
    for actions in (0, [0], [0, 4], [0, -1], [0.0, 1.0], [[0, 0]], None, "00"):
        with pytest.raises(gymnasium.error.InvalidAction):
            envs.step(actions)
    for options in ({"reset_mask": [True, False]}, {"reset_mask": np.zeros(2, bool)}, {"future": [0, 1, 2]}):
        with pytest.raises(EnvError) as error:
            envs.reset(options=options)
        assert error.value.field in options
