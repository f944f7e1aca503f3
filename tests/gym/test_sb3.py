"""The VecEnv of Stable-Baselines3, where that is installed."""

import numpy as np
import pytest

from sidestep.gym import EnvError, WalkEnv
from sidestep.scenarios.model import Scenario

vec_env = pytest.importorskip("stable_baselines3.common.vec_env", exc_type=ImportError)

WALKERS = 4


def test_walkers_walk_as_in_a_dummy_vec_env(small: Scenario) -> None:
    from sidestep.gym.sb3 import SB3VecEnv

    options = {"futures": 3, "walks": "anywhere", "mask": "dict"}
    ours = SB3VecEnv(small, WALKERS, **options)
    theirs = vec_env.DummyVecEnv([lambda: WalkEnv(small, **options) for _ in range(WALKERS)])
    for env in (ours, theirs):
        env.seed(3)
    ended, rng = 0, np.random.default_rng(0)
    shown = [env.reset() for env in (ours, theirs)]
    for _ in range(60):
        np.testing.assert_equal(*shown)
        np.testing.assert_array_equal(*(np.stack(env.env_method("action_masks")) for env in (ours, theirs)))
        actions = rng.integers(4, size=WALKERS)
        (one, *told, infos), (other, *expected, their_infos) = (env.step(actions) for env in (ours, theirs))
        shown = [one, other]
        for mine, theirs_ in zip(told, expected, strict=True):
            np.testing.assert_array_equal(mine, theirs_)
        for over, info, their_info in zip(told[1], infos, their_infos, strict=True):
            assert info == {"TimeLimit.truncated": False} or over
            if over:
                np.testing.assert_equal(info, their_info)
        ended += told[1].sum()
        np.testing.assert_equal(ours.reset_infos, theirs.reset_infos)
    assert ended > WALKERS


def test_what_walkers_do_not_have_is_named(small: Scenario) -> None:
    from sidestep.gym.sb3 import SB3VecEnv

    env = SB3VecEnv(small, 2, futures=3)
    assert env.has_attr("action_masks")
    assert not env.has_attr("no_such_thing")
    assert env.get_attr("render_mode", [0]) == [None]
    assert env.env_is_wrapped(object) == [False, False]
    for wrong in (lambda: env.env_method("fly"), lambda: env.set_attr("render_mode", "human")):
        with pytest.raises(AttributeError):
            wrong()
    env.set_options({"future": 2})
    env.reset()
    assert [info["future"] for info in env.reset_infos] == [2, 2]
    with pytest.raises(EnvError) as error:
        SB3VecEnv(small, autoreset_mode="NextStep")
    assert error.value.field == "autoreset_mode"
