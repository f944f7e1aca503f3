"""The functional core: walks, features and random streams."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sidestep
from sidestep import SidestepError
from sidestep.environment.types import LEVELS, EnvState
from sidestep.gym import EnvError, Task, make_task
from sidestep.gym.features import feature_table
from sidestep.gym.walkers import streams, uniform
from sidestep.scenarios.model import Scenario


@pytest.fixture(scope="module")
def rush() -> Scenario:
    return sidestep.scenario("rush-16", side=3, crowded_nodes=1, horizon=3600.0)


@pytest.mark.parametrize("level", LEVELS)
def test_features_keep_to_their_table(rush: Scenario, level: str) -> None:
    task = make_task(rush, level=level, futures=2, walks="anywhere")
    table = feature_table(level, 4, interpolated=False)

    @jax.jit
    def walked(task: Task) -> jax.Array:
        def on(state: EnvState, action: jax.Array) -> tuple[EnvState, jax.Array]:
            shown = jax.vmap(lambda walker: task.encode(task.observe(walker)))(state)
            return jax.vmap(task.step, (0, None))(state, action)[0], shown

        begun = jax.vmap(task.start)(jax.random.split(jax.random.key(0), 30))
        return jax.lax.scan(on, begun, jnp.array([0, 1, 2, 3, 2]))[1]

    shown = walked(task)
    assert shown.shape == (5, 30, len(table))
    assert (shown >= jnp.array([each.low for each in table])).all()
    assert (shown <= jnp.array([each.high for each in table])).all()


def test_features_mean_what_the_table_says(rush: Scenario) -> None:
    task = make_task(rush, level="local", futures=2)
    state = task.start(jax.random.key(0))
    names = [each.name for each in feature_table("local", 4, interpolated=False)]
    seen, after = task.observe(state), task.step(state, jnp.int32(2))[0]
    now, then = (dict(zip(names, task.encode(task.observe(each)).tolist(), strict=True)) for each in (state, after))
    assert (now["x"], now["y"], then["x"], then["y"]) == (-1, -1, 0, -1)
    assert now["clock"] == pytest.approx(float(state.clock) / 4 / 3600)
    assert now["distance"] == pytest.approx(2 * 550 * 2**0.5 / float(task.encoder.metres) / 10)
    assert (now["ahead_x"], now["exits"]) == (pytest.approx(0.5**0.5), 0.5)
    assert [now[f"exit_{each}_valid"] for each in range(4)] == [1, 0, 1, 0]
    assert now["exit_1_cost"] == 0
    assert now["exit_2_cost"] == pytest.approx(np.log(seen.local.cost[2] / task.encoder.seconds), rel=1e-5)
    assert [then[f"exit_{each}_back"] for each in range(4)] == [0, 0, 0, 1]
    assert min(now["exit_0_estimate"], now["exit_2_estimate"]) == 0


def test_walkers_from_maps_side_by_side_stay_on_theirs() -> None:
    several = sidestep.scenario("unseen-maps", side=3, crowded_nodes=1, training_maps=2, larger=())
    learn = make_task(several, level="local", futures=2, destinations=2, walks="anywhere")
    assert learn.parts == (9, 9)
    walks = jax.jit(lambda task, keys: jax.vmap(task.start)(keys))(
        learn, jax.random.split(jax.random.key(1), 50)
    ).instance
    assert (walks.origin // 9 == walks.destination // 9).all()
    assert make_task(several, level="local", futures=2, purpose="test").parts == (9,)


def test_learners_and_judges_meet_different_futures(task: Task, small: Scenario) -> None:
    test = make_task(small, futures=3, purpose="test")
    first, other = (each.params.futures.speeds.speed[:, 0] for each in (task, test))
    assert (first[:, None] != other[None]).any(axis=-1).all()
    np.testing.assert_array_equal(task.params.network.length, test.params.network.length)


def test_draws_are_uniform_and_independent() -> None:
    rows = jnp.asarray(streams(range(100)))
    draws = np.asarray(jax.vmap(lambda row: jax.vmap(lambda walk: uniform(row, walk))(jnp.arange(100)))(rows))
    flat = draws.reshape(-1, 4)
    assert ((flat >= 0) & (flat < 1)).all()
    assert len(np.unique(flat)) > 39_900
    counts = np.stack([np.histogram(column, 20, (0, 1))[0] for column in flat.T])
    assert ((counts - 500) ** 2 / 500).sum(axis=1).max() < 43.8  # of 19 degrees of freedom: once in a thousand
    assert np.abs(np.corrcoef(flat.T) - np.eye(4)).max() < 0.04
    assert abs(np.corrcoef(draws[:, :-1].ravel(), draws[:, 1:].ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(draws[:-1].ravel(), draws[1:].ravel())[0, 1]) < 0.02


@pytest.mark.parametrize(
    ("scenario", "options", "field"),
    [
        ("paper", {}, "scenario"), (None, {}, "scenario"), ("no-such.toml", {}, None),
        ("paper-congested", {"level": "hindsight"}, "level"), ("paper-congested", {"futures": 0}, "futures"),
        ("paper-congested", {"purpose": "play"}, "purpose"), ("paper-congested", {"mask": "none"}, "mask"),
        ("paper-congested", {"mask": "dict"}, "mask"),  # which is for environments
        ("paper-congested", {"render_mode": "human"}, "render_mode"),
        ("paper-congested", {"map_seed": -1}, "map_seed"), ("paper-congested", {"seed": 1}, "seed"),
        ("paper-congested", {"destinations": 2}, "destinations"), ("paper-congested", {"walks": "here"}, "walks"),
        ("paper-congested", {"level": "local", "destinations": 40}, "destinations"),
        ("paper-congested", {"level": "local", "destinations": 5, "futures": 4}, "destinations"),
    ],
)  # fmt: skip
def test_options_that_are_wrong_are_named(scenario: object, options: dict, field: str | None) -> None:
    with pytest.raises(SidestepError) as error:
        make_task(scenario, **options)
    assert error.value.field == field


def test_options_are_refused_as_the_environments_own_error(small: Scenario) -> None:
    with pytest.raises(EnvError):
        make_task(small, levels="map")
