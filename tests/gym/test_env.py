"""The single environment, step by step beside the functional core, and Gymnasium's own checks."""

import copy
import pickle
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import gymnasium
import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import sidestep
from sidestep import SidestepError, plotting
from sidestep.environment.dynamics import reset, step
from sidestep.environment.types import Instance
from sidestep.gym import EnvError, Task, WalkEnv
from sidestep.gym.choices import Chosen, Walks
from sidestep.network.graph import road_network
from sidestep.scenarios.model import Scenario


def test_steps_are_those_of_the_functional_core(env: WalkEnv, task: Task) -> None:
    observation, info = env.reset(seed=3, options={"future": 1})
    state, seen = reset(task.params, Instance(jnp.int32(0), jnp.int32(8), jnp.float32(0), jnp.int32(1)))
    rng = np.random.default_rng(0)
    terminated = truncated = False
    while not (terminated or truncated):
        np.testing.assert_array_equal(observation, task.encode(seen))
        assert info["action_mask"].dtype == np.int8
        np.testing.assert_array_equal(info["action_mask"], seen.valid)
        np.testing.assert_array_equal(env.action_masks(), seen.valid)
        action = rng.integers(4)  # also exits that may not be taken
        state, outcome = step(task.params, state, jnp.asarray(action))
        seen = outcome.observation
        observation, reward, terminated, truncated, info = env.step(action)
        assert reward == pytest.approx(float(outcome.reward), rel=1e-6)
        assert (terminated, truncated) == (bool(outcome.terminated), bool(outcome.truncated))
        assert info["node"] == state.node
        assert info["cost"] == pytest.approx(float(outcome.crossed.cost), rel=1e-6)
        assert info["seconds"] == pytest.approx(float(state.clock), rel=1e-6)
    assert terminated
    assert info["node"] == 8


@pytest.mark.parametrize("changes", [{}, {"departures": (0.0, 3600.0)}, {"flows": "forecast"}])
def test_tests_walk_the_walks_of_comparisons(changes: dict) -> None:
    # Two ways round: the clairvoyant takes the better one.
    square = sidestep.scenario("paper-unblocked", side=2, **changes)
    chosen = sidestep.choose_planners(square, ["expected"])
    found = sidestep.compare(square, chosen.factories, maps=[1], walks=6, seed=4).records
    env = WalkEnv(square, map_seed=4, map_index=1, purpose="test", futures=6)
    for walk in range(6):
        ways = []
        for actions in ((2, 0), (0, 2)):
            env.reset(options={"walk": walk})
            ways.append([env.step(action) for action in actions][-1][4]["seconds"] / 60)
        assert min(ways) == pytest.approx(found["clairvoyant"].minutes[0, walk], rel=1e-5)
        assert min(ways) < max(ways)
    with pytest.raises(EnvError) as error:
        env.reset(options={"walk": 6})
    assert error.value.field == "walk"


@pytest.mark.parametrize("destinations", [None, 2])
def test_in_towns_as_well(quarter: Scenario, destinations: int | None) -> None:
    chosen = sidestep.choose_planners(quarter, ["shortest-path"])
    walked = sidestep.compare(quarter, chosen.factories, maps=[0], walks=5, destinations=destinations).records
    env = WalkEnv(quarter, level="local", purpose="test", futures=5, destinations=destinations)
    params, planner = env.task.params, sidestep.find_planner("shortest-path")
    exits = np.asarray(params.network.exit_node)
    routes = sidestep.routes(planner, params, env.task.tests, jax.random.key(0), trace=100)
    for walk, route in enumerate(routes):
        _, info = env.reset(options={"walk": walk})
        assert (info["node"], info["destination"]) == (route.nodes[0], route.nodes[-1])
        for node, after in pairwise(route.nodes):
            *_, info = env.step(exits[node].tolist().index(after))
        assert info["seconds"] / 60 == pytest.approx(walked["shortest-path"].minutes[0, walk], rel=1e-5)
    for level, purpose, futures in (("local", "test", 16), ("local", "learn", 5), ("position", "test", 5)):
        env = WalkEnv(quarter, level=level, purpose=purpose, futures=futures)
        with pytest.raises(EnvError) as error:
            env.reset(options={"walk": 0})
        assert error.value.field == "walk"


def test_walks_that_begin_anywhere_have_no_others(quarter: Scenario) -> None:
    with pytest.raises(EnvError) as error:
        WalkEnv(quarter, futures=2, walks="scenario")
    assert error.value.field == "walks"


def test_what_is_told_may_be_written_to(env: WalkEnv) -> None:
    _, info = env.reset()
    info["action_mask"][:] = 1
    assert env.action_masks().tolist() == [True, False, True, False]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])  # noqa: S301
def test_copies_are_environments_of_the_same_options(env: WalkEnv, copied: Callable[[WalkEnv], WalkEnv]) -> None:
    env.reset(seed=5)
    again = copied(env)
    with pytest.raises(gymnasium.error.ResetNeeded):
        again.step(0)
    assert again.options == env.options
    for made in (env, again):
        made.reset(seed=7)
    first, second = (made.step(2) for made in (env, again))
    np.testing.assert_array_equal(first[0], second[0])
    assert first[4]["seconds"] == second[4]["seconds"] > 0


@pytest.mark.parametrize(("option", "wrong"), [("mask", "none"), ("render_mode", "ansi"), ("render_fps", 0)])
def test_options_of_environments_alone_are_named_as_well(small: Scenario, option: str, wrong: object) -> None:
    with pytest.raises(EnvError) as error:
        WalkEnv(small, futures=3, **{option: wrong})
    assert error.value.field == option


def test_gymnasium_has_nothing_to_say_against_it(small: Scenario) -> None:
    for options in ({}, {"observation": "node", "mask": "dict"}, {"observation": "one-hot", "mask": "tianshou"}):
        made = gymnasium.make("sidestep/PaperGrid-v0", scenario=small, futures=3, **options)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mpl.use("agg")  # for the window that the check opens
            check_env(made.unwrapped, skip_render_check=bool(options))
            made.reset(seed=0)
            for _ in range(30):
                if any(made.step(made.action_space.sample())[2:4]):
                    made.reset()


def test_a_seed_decides_all_walks_until_the_next_one(small: Scenario) -> None:
    def walks(env: WalkEnv, seed: int | None) -> list[tuple[int, ...]]:
        infos = [env.reset(seed=seed)[1], *(env.reset()[1] for _ in range(5))]
        return [(info["node"], info["future"]) for info in infos]

    one, other = (WalkEnv(small, futures=50, walks="anywhere") for _ in range(2))
    assert walks(one, 5) == walks(other, 5) == walks(one, 5)
    assert walks(one, 5) != walks(one, None) != walks(one, 6)
    assert walks(WalkEnv(small, futures=50, walks="anywhere"), None) != walks(other, None)


def test_resets_take_wishes(small: Scenario) -> None:
    env = WalkEnv(small, futures=6, destinations=2, level="local", walks="anywhere")
    first, second = (env.reset(options={"future": future})[1]["destination"] for future in (0, 1))
    assert first != second
    for _ in range(20):
        info = env.reset(options={"destination": second})[1]
        assert (info["destination"], info["future"] % 2) == (second, 1)
        assert info["node"] != second
        info = env.reset(options={"destination": first, "origin": second})[1]
        assert (info["node"], info["destination"], info["future"] % 2) == (second, first, 0)
        assert env.reset(options={"origin": second})[1]["destination"] == first
        assert env.reset(options={"origin": 0})[1]["node"] == 0


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"future": 3}, "future"), ({"future": -1}, "future"), ({"future": 0.5}, "future"),
        ({"future": True}, "future"),
        ({"origin": 9}, "origin"), ({"origin": 8}, "origin"), ({"origin": "0"}, "origin"), ({"origin": [1]}, "origin"),
        ({"walk": 0}, "walk"), ({"walk": 0, "future": 0}, "walk"),
        ({"destination": 7}, "destination"), ({"departure": 1}, "departure"), ({"departure": "0"}, "departure"),
        ({"departure": float("nan")}, "departure"), ({"futur": 1}, "futur"), ({1: 1}, "1"), ([], "options"),
    ],
)  # fmt: skip
def test_wishes_that_cannot_be_met_are_named(env: WalkEnv, options: dict, field: str) -> None:
    with pytest.raises(EnvError) as error:
        env.reset(options=options)
    assert error.value.field == field


def test_test_walks_are_those_of_comparisons(small: Scenario) -> None:
    here = sidestep.draw_map(small, seed=0)
    params = sidestep.make_environment(small, here, "test", futures=3)
    todo, planner = sidestep.instances(small, here, params, walks=3), sidestep.find_planner("shortest-path")
    env, exits = WalkEnv(small, futures=3, purpose="test"), np.asarray(here.network.exit_node)
    for future, route in enumerate(sidestep.routes(planner, params, todo, jax.random.key(0), trace=10)):
        env.reset(options={"future": future})
        for node, after in pairwise(route.nodes):
            *_, info = env.step(exits[node].tolist().index(after))
        assert info["seconds"] == pytest.approx(route.seconds, rel=1e-6)


def test_nobody_begins_where_no_path_leads_on(task: Task) -> None:
    network = task.params.network
    on = np.asarray(network.tail) != 4
    streets = (np.asarray(each)[on] for each in (network.tail, network.head, network.length))
    sink = replace(task.params, network=road_network(network.position, *streets))
    walks = Walks(replace(task, params=sink), latest=0.0)
    with pytest.raises(EnvError) as error:
        walks.chosen(Chosen(0, 8, 0.0, 0), {"origin": 4})
    assert error.value.field == "origin"


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_gymnasium_hands_on_what_is_wrong_with_arguments(make: Callable[..., object]) -> None:
    for options in ({"speed": 1}, {"scenario": 5}, {"futures": "8"}, {"purpose": None}):
        with pytest.raises(EnvError) as error:
            make("sidestep/PaperGrid-v0", **options)
        assert error.value.field in options


def test_actions_and_ends_out_of_place_are_refused(env: WalkEnv) -> None:
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)
    env.reset(seed=0)
    for action in (4, -1, 0.0, "0", None, [0], True, np.array([0, 1]), [[0], [0, 1]]):
        with pytest.raises(gymnasium.error.InvalidAction):
            env.step(action)
    for action in (2, np.int64(2), np.array(0, np.uint8)):
        env.step(action)
    assert env.step(jax.numpy.int32(0))[2]
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)


def test_walks_are_drawn(small: Scenario) -> None:
    made = gymnasium.make("sidestep/PaperGrid-v0", scenario=small, futures=3, render_mode="rgb_array", render_fps=2.0)
    assert made.metadata["render_fps"] == 2
    with pytest.raises(gymnasium.error.ResetNeeded):
        made.unwrapped.render()
    made.reset(seed=0, options={"future": 0})
    before = made.render()
    assert before.dtype == np.uint8
    assert before.shape == (720, 720, 3)
    made.step(2)
    assert (made.render() != before).any()
    made.close()
    with pytest.warns(UserWarning, match="render_mode"):
        assert WalkEnv(small, futures=3).render() is None


def test_a_window_is_drawn_after_every_step(small: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    mpl.use("agg")  # a choice: nobody sees it
    made = WalkEnv(small, futures=3, render_mode="human")
    drawn: list[str] = []
    monkeypatch.setattr(plotting.WalkPicture, "update", lambda _, title, *__: drawn.append(title))
    made.reset(seed=0, options={"future": 0})
    made.step(2)
    assert made.render() is None
    assert len(drawn) == 2
    made.close()
    monkeypatch.setattr(plotting, "get_backend", lambda *, auto_select=True: "agg" if auto_select else None)
    with pytest.raises(SidestepError) as error:
        WalkEnv(small, render_mode="human")
    assert error.value.field == "render_mode"
