"""Crowds that go on from current counts."""

from dataclasses import replace

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


def flow(residual, since: float, deviation=DEVIATION) -> SensorFlow:
    """From 12:30, when the middle of the hour from 12:00 is ``since`` = 0 h ago."""
    floats = jnp.float32
    model = SensorModel(
        jnp.full((168, 2), USUAL), jnp.asarray(MEMORY, floats), jnp.asarray(deviation, floats), jnp.eye(2)
    )
    spread = Spread(jnp.array([[0], [1]]), jnp.ones((2, 1)))
    known = None if residual is None else Known(jnp.asarray(residual, floats), jnp.asarray(since, floats))
    return SensorFlow(model, spread, jnp.ones(2), jnp.array([12.5]), 300.0, known=known)


def expected(residual, hours) -> np.ndarray:
    """By hand: the mean of exp of a normal number, less one."""
    fading = MEMORY**hours
    mean = USUAL + fading * residual + (1 - fading**2) * DEVIATION**2 / 2
    return np.expm1(mean)


@pytest.mark.parametrize("since", [-0.5, 0.0, 0.25, 1.0])
def test_the_forecast_fades_to_the_usual(since: float) -> None:
    residual = np.array([1.0, -0.5])
    found = np.asarray(flow(residual, since).expected(10 * HOUR).sensed)[0]
    for slot in (0, 5, 11, 60, 119):
        hours = max(since + (slot + 0.5) / HOUR, 0.0)
        assert found[slot] == pytest.approx(expected(residual, hours), rel=1e-4)


def test_what_is_not_known_is_as_usual() -> None:
    found = np.asarray(flow([np.nan, 0.7], 0.0).expected(HOUR).sensed)[0]
    usual = np.asarray(flow(None, 0.0).expected(HOUR).sensed)[0]
    assert found[:, 0] == pytest.approx(usual[:, 0])
    assert found[:, 1] == pytest.approx([expected(0.7, (slot + 0.5) / HOUR)[1] for slot in range(HOUR)], rel=1e-4)


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
    drawn = flow([1.0, -0.5], since, deviation=np.zeros(2)).draw(jax.random.key(0), 3, 3 * HOUR).sensed
    knots = np.log1p(np.asarray(drawn)) - USUAL  # [crowd, slot, sensor]
    assert knots.std(axis=0) == pytest.approx(0, abs=1e-5)
    for hour, after in enumerate(hours[:-1]):
        low, high = MEMORY**after * [1.0, -0.5], MEMORY ** (after + 1) * [1.0, -0.5]
        for slot in range(HOUR):
            part = (slot + 0.5) / HOUR
            assert knots[0, hour * HOUR + slot] == pytest.approx((1 - part) * low + part * high, abs=1e-4)


def test_before_the_middle_of_the_counted_hour_crowds_are_as_counted() -> None:
    # At 12:00 of the hour from 12:00: its middle is half an hour ahead.
    early = replace(flow([1.0, -0.5], -0.5, deviation=np.zeros(2)), start=jnp.array([12.0]))
    knots = np.log1p(np.asarray(early.draw(jax.random.key(0), 1, HOUR).sensed))[0] - USUAL
    assert knots[: HOUR // 2] == pytest.approx(np.tile([1.0, -0.5], (HOUR // 2, 1)), abs=1e-4)
    assert abs(knots[-1, 0]) < 1.0


def test_futures_are_drawn_around_the_forecast() -> None:
    crowds = flow([1.2, np.nan], 0.0)
    drawn = np.asarray(crowds.draw(jax.random.key(1), 4000, 4 * HOUR).sensed)
    # at middles of hours, between which logarithms are straight lines and vary less
    at = [HOUR - 1, 2 * HOUR - 1, 3 * HOUR - 1]
    assert drawn[:, at].mean(axis=0) == pytest.approx(np.asarray(crowds.expected(4 * HOUR).sensed)[0, at], rel=0.03)
    # just after the counts, what is known hardly varies, and what is not varies as ever
    logs = np.log1p(drawn[:, 0])
    assert logs[:, 0].std() < 0.05
    assert logs[:, 1].std() == pytest.approx(DEVIATION[1], rel=0.1)


def test_live_walkers_forecast_from_the_same_counts() -> None:
    crowds = flow([1.0, -0.5], 0.0)
    first = np.asarray(crowds.expected(HOUR).sensed)[0]
    ahead = np.asarray(crowds.ahead(jnp.asarray(first[0]), jnp.int32(0), HOUR))
    assert ahead == pytest.approx(first, rel=0.02)


def test_without_counts_nothing_changes() -> None:
    crowds = flow(None, 0.0)
    drawn = np.asarray(crowds.draw(jax.random.key(2), 4, HOUR).sensed)
    unknown = np.asarray(flow([np.nan, np.nan], 0.0).draw(jax.random.key(2), 4, HOUR).sensed)
    assert drawn.shape == unknown.shape == (4, HOUR, 2)
    assert flow([np.nan, np.nan], 0.0).expected(HOUR).sensed == pytest.approx(np.asarray(crowds.expected(HOUR).sensed))
