"""Crowds that go on from current counts."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.flow.sensors import Known, SensorFlow, SensorModel
from sidestep.network.spread import Spread

USUAL = 3.0  # of log(1 + count), in every hour
MEMORY = np.array([0.5, 0.8])
DEVIATION = np.array([0.4, 0.2])
HOUR = 12  # slots of 5 min
SLOTS, CROWDS = 4 * HOUR, 2000


def flow(residual, since: float, deviation=DEVIATION) -> SensorFlow:
    """From 12:30, when the middle of the hour from 12:00 is ``since`` = 0 h ago."""
    floats = jnp.float32
    model = SensorModel(
        jnp.full((168, 2), USUAL), jnp.asarray(MEMORY, floats), jnp.asarray(deviation, floats), jnp.eye(2)
    )
    spread = Spread(jnp.array([[0], [1]]), jnp.ones((2, 1)))
    known = None if residual is None else Known(jnp.asarray(residual, floats), jnp.asarray(since, floats))
    return SensorFlow(model, spread, jnp.ones(2), jnp.array([12.5]), 300.0, known=known)


@partial(jax.jit, static_argnames="slots")
def forecast(crowds: SensorFlow, slots: int = SLOTS):
    return crowds.expected(slots).sensed[0]


@jax.jit
def draw(crowds: SensorFlow, seed: int = 0):
    return crowds.draw(jax.random.key(seed), CROWDS, SLOTS).sensed


def expected(residual, hours) -> np.ndarray:
    """By hand: the mean of exp of a normal number, less one; the residual fades straight from hour to hour."""
    whole = int(hours)
    fading = (1 - (hours - whole)) * MEMORY**whole + (hours - whole) * MEMORY ** (whole + 1)
    mean = USUAL + fading * residual + (1 - fading**2) * DEVIATION**2 / 2
    return np.expm1(mean)


@pytest.mark.parametrize("since", [-0.5, 0.0, 0.25, 1.0])
def test_the_forecast_fades_to_the_usual(since: float) -> None:
    residual = np.array([1.0, -0.5])
    found = np.asarray(forecast(flow(residual, since)))
    for slot in (0, 5, 11, 30, 47):
        hours = max(since + (slot + 0.5) / HOUR, 0.0)
        assert found[slot] == pytest.approx(expected(residual, hours), rel=1e-4)


def test_what_is_not_known_is_as_usual() -> None:
    found = np.asarray(forecast(flow([np.nan, 0.7], 0.0)))
    usual = np.asarray(forecast(flow(None, 0.0)))
    assert found[:, 0] == pytest.approx(usual[:, 0])
    assert found[:, 1] == pytest.approx([expected(0.7, (slot + 0.5) / HOUR)[1] for slot in range(SLOTS)], rel=1e-4)


@pytest.mark.parametrize(
    ("since", "hours"),
    [
        # counted in the hour of the departure: from its middle on, straight lines from one middle to the next
        (0.0, [0, 1, 2]),
        # the hour before
        (1.0, [1, 2, 3]),
    ],
)
def test_futures_without_noise_start_from_the_counts(since: float, hours: list[int]) -> None:
    drawn = draw(flow([1.0, -0.5], since, deviation=np.zeros(2)))
    knots = np.log1p(np.asarray(drawn)) - USUAL  # [crowd, slot, sensor]
    assert knots.std(axis=0) == pytest.approx(0, abs=1e-4)
    for hour, after in enumerate(hours[:-1]):
        low, high = MEMORY**after * [1.0, -0.5], MEMORY ** (after + 1) * [1.0, -0.5]
        for slot in range(HOUR):
            part = (slot + 0.5) / HOUR
            assert knots[0, hour * HOUR + slot] == pytest.approx((1 - part) * low + part * high, abs=1e-4)


def test_before_the_middle_of_the_counted_hour_crowds_are_as_counted() -> None:
    # At 12:00 of the hour from 12:00: its middle is half an hour ahead.
    early = replace(flow([1.0, -0.5], -0.5, deviation=np.zeros(2)), start=jnp.array([12.0]))
    knots = np.log1p(np.asarray(draw(early)))[0] - USUAL
    assert knots[: HOUR // 2] == pytest.approx(np.tile([1.0, -0.5], (HOUR // 2, 1)), abs=1e-4)
    assert abs(knots[HOUR, 0]) < 1.0


def test_futures_are_drawn_around_the_forecast() -> None:
    crowds = flow([1.2, np.nan], 0.0)
    drawn = np.asarray(draw(crowds, 1))
    # at middles of hours, between which logarithms are straight lines and vary less
    at = [HOUR - 1, 2 * HOUR - 1, 3 * HOUR - 1]
    assert drawn[:, at].mean(axis=0) == pytest.approx(np.asarray(forecast(crowds))[at], rel=0.03)
    # just after the counts, what is known hardly varies, and what is not varies as ever
    logs = np.log1p(drawn[:, 0])
    assert logs[:, 0].std() < 0.05
    assert logs[:, 1].std() == pytest.approx(DEVIATION[1], rel=0.1)


def test_live_walkers_forecast_from_the_same_counts() -> None:
    crowds = flow([1.0, -0.5], 0.0)
    first = np.asarray(forecast(crowds))[:HOUR]
    ahead = np.asarray(crowds.ahead(jnp.asarray(first[0]), jnp.int32(0), HOUR))
    assert ahead == pytest.approx(first, rel=0.04)


def test_without_counts_nothing_changes() -> None:
    nothing, unknown = flow(None, 0.0), flow([np.nan, np.nan], 0.0)
    assert forecast(unknown) == pytest.approx(np.asarray(forecast(nothing)))
    logs = [np.log1p(np.asarray(draw(crowds, 2))) for crowds in (nothing, unknown)]
    assert logs[0].mean(axis=0) == pytest.approx(logs[1].mean(axis=0), abs=0.04)
    assert logs[0].std(axis=0) == pytest.approx(logs[1].std(axis=0), abs=0.03)
