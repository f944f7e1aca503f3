"""Expected times are means over futures that serve no other purpose."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.scenarios import expectation
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.expectation import Crowds, Expectation, expected_pace
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import PURPOSES, draw_map, purpose_key
from sidestep.scenarios.places import RushHours
from sidestep.walking.crossing_time import CrossingRule, crossing_time
from sidestep.walking.expected_times import ExpectedTimes
from sidestep.walking.speed_field import SpeedField, walking_speeds

PROBLEM = scenario("paper-congested", side=3, crowded_nodes=2, horizon=3600.0)
HERE = draw_map(PROBLEM, 0)
ANY_HOUR = jnp.zeros(1)
SLOTS, SEGMENTS = 12, 24


def expected(samples: int | None) -> ExpectedTimes | SpeedField:
    crowds, key = Crowds.of(PROBLEM, HERE.flow), purpose_key(HERE, "expect")
    return Expectation(crowds, HERE.network, key, ANY_HOUR, PROBLEM.rule, samples, densities=False).speeds()


@pytest.mark.parametrize("at_once", [5, 2])
def test_times_are_means_over_the_futures(monkeypatch: pytest.MonkeyPatch, at_once: int) -> None:
    monkeypatch.setattr(expectation, "AT_ONCE", at_once * SLOTS * SEGMENTS)
    found = expected(5)
    keys = jax.random.split(purpose_key(HERE, "expect"), 1 if at_once == 5 else 3)
    enter = jax.vmap(jax.vmap(lambda one, *rest: crossing_time(one.row(), *rest), (0, 0, None)), (0, None, None))
    every = []
    for key in keys:
        drawn = HERE.flow.draw(key, jnp.zeros(at_once), SLOTS)
        speeds = walking_speeds(HERE.network, drawn, PROBLEM.speed_law)
        every += [enter(speeds, HERE.network.length, jnp.float32(slot * 300)) for slot in range(SLOTS)]
    by_hand = np.reshape(every, (len(keys), SLOTS, at_once, SEGMENTS)).mean(axis=(0, 2))
    np.testing.assert_allclose(found.seconds[0], by_hand.T, rtol=1e-4)


def test_without_samples_times_are_those_in_the_mean_crowd() -> None:
    mean = walking_speeds(HERE.network, HERE.flow.expected(ANY_HOUR, SLOTS), PROBLEM.speed_law)
    for found in (expected(0), make_environment(PROBLEM, HERE, "test", 2, samples=0).expected):
        assert isinstance(found, SpeedField)
        np.testing.assert_allclose(found.speed, mean.speed, rtol=1e-5)


def test_where_crowds_come_as_forecast_nothing_is_drawn() -> None:
    forecast = PROBLEM.changed(flows="forecast")
    assert isinstance(make_environment(forecast, draw_map(forecast, 0), "test", 1).expected, SpeedField)


def test_these_futures_serve_no_other_purpose() -> None:
    streams = {tuple(np.asarray(jax.random.key_data(purpose_key(HERE, purpose)))) for purpose in PURPOSES}
    assert len(streams) == len(PURPOSES)


def test_where_crowds_have_no_noise_they_are_walked_as_they_come() -> None:
    still = scenario("rush-16", side=3, crowded_nodes=2, rush=RushHours(sigma=0.0))
    params = make_environment(still, draw_map(still, 0), "test", 1)
    assert isinstance(params.expected, SpeedField)
    np.testing.assert_allclose(params.expected.speed, params.futures.speeds.speed, rtol=1e-6)


def test_paces_that_are_known_are_not_worked_out_again() -> None:
    pace = expected_pace(PROBLEM, HERE, 0.0)
    found = make_environment(PROBLEM, HERE, "test", 2, pace=pace).expected
    np.testing.assert_allclose(found.seconds, make_environment(PROBLEM, HERE, "test", 2).expected.seconds, rtol=1e-5)
    twice = make_environment(PROBLEM, HERE, "test", 2, pace=2 * pace).expected
    np.testing.assert_allclose(twice.seconds, 2 * found.seconds, rtol=1e-5)
    forecast = PROBLEM.changed(flows="forecast")
    assert expected_pace(forecast, draw_map(forecast, 0), 0.0) is None


DAY = PROBLEM.changed(horizon=24 * 3600.0)
DAY_SLOTS, FIRST = 288, 37


@pytest.fixture(scope="module", params=["integrated", "entry"])
def paces(request: pytest.FixtureRequest):
    """The rule, and paces where everybody begins with so many people: drawn for all slots, or for the first ones."""
    rule: CrossingRule = request.param

    def paces_of(people: jax.Array, key: jax.Array, first: int | None) -> jax.Array:
        crowds = Crowds.of(DAY, eqx.tree_at(lambda flow: flow.initial, HERE.flow, people))
        return Expectation(crowds, HERE.network, key, ANY_HOUR, rule, 70, densities=False).pace(ANY_HOUR, first=first)[
            0
        ]

    return rule, jax.jit(paces_of, static_argnums=2)


@settings(max_examples=20)
@given(level=st.floats(1, 5_000), seed=st.integers(0, 2**31))
def test_the_first_slots_alone_give_the_same_paces_to_the_bit(paces, level: float, seed: int) -> None:
    rule, paces_of = paces
    people = level * jax.random.uniform(jax.random.key(seed), SEGMENTS)
    every, few = (np.asarray(paces_of(people, jax.random.key(seed + 1), first)) for first in (None, FIRST))
    if rule == "entry":  # of which all are drawn
        np.testing.assert_array_equal(few, every)
        return
    known = ~np.isnan(few)
    np.testing.assert_array_equal(few[known], every[known])
    assert few.shape == every.shape == (SEGMENTS, DAY_SLOTS)
    assert not known[:, FIRST:].any()
    # Who is out of the street before the last of these slots is not touched by what comes after it.
    leaves = np.arange(DAY_SLOTS) * 300 + every * np.asarray(HERE.network.length)[:, None]
    assert (~known | (leaves < (FIRST - 1) * 300)).all()


def test_where_few_people_are_most_of_the_first_slots_are_known(paces) -> None:
    _, paces_of = paces
    assert not np.isnan(paces_of(jnp.full(SEGMENTS, 1.0), jax.random.key(0), FIRST)[:, : FIRST - 5]).any()
