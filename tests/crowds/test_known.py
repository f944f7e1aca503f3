"""Crowds that go on from current counts."""

import math
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.crowds.sensors import Known, SensorFlow, SensorModel

USUAL = 3.0  # of log(1 + count), in every hour
MEMORY = np.array([0.5, 0.8])
DEVIATION = np.array([0.4, 0.2])
HOUR = 12  # slots of 5 min
SLOTS, CROWDS = 4 * HOUR, 2000
# Slots of an hour from 12:00 on have the middles of hours as theirs, the first that of the counted one.
HOURLY = {"since": -0.5, "slot_seconds": 3600.0}
HARDLY = np.full(2, 1e-4)  # a deviation without which nothing could have been counted but the usual


def flow(residual, since: float, deviation=DEVIATION, weekly=(0.0, 0.0), slot_seconds: float = 300.0) -> SensorFlow:
    """What is known is of the hour from 12:00, ``since`` its middle; deviations are of all hours or of each one."""
    floats = jnp.float32
    model = SensorModel(
        jnp.full((168, 2), USUAL),
        jnp.asarray(weekly, floats),
        jnp.broadcast_to(jnp.asarray(deviation, floats), (24, 2)),
        jnp.asarray(MEMORY, floats),
        jnp.eye(2),
    )
    spread = InterpolationWeights(jnp.array([[0], [1]]), jnp.ones((2, 1)))
    known = None if residual is None else Known(jnp.asarray(residual, floats), jnp.asarray(since, floats))
    return SensorFlow(model, spread, jnp.ones(2), jnp.array([12.5 + since]), slot_seconds, known=known)


@partial(jax.jit, static_argnames="slots")
def forecast(futures: SensorFlow, slots: int = SLOTS):
    return futures.expected(slots).sensed[0]


@partial(jax.jit, static_argnames="slots")
def draw(futures: SensorFlow, seed: int = 0, slots: int = SLOTS):
    return futures.draw(jax.random.key(seed), CROWDS, slots).sensed


@partial(jax.jit, static_argnames="slots")
def ahead(futures: SensorFlow, now, slots: int):
    return futures.ahead(now, jnp.int32(0), slots)


def expected(residual, hours) -> np.ndarray:
    """By hand: the mean of exp of a normal number, less one; the residual fades straight from hour to hour.

    Before the middle of the counted hour, futures are as counted; ``hours`` is 0 and nothing varies.
    """
    whole = int(hours)
    part = hours - whole
    fading = (1 - part) * MEMORY**whole + part * MEMORY ** (whole + 1)
    bridged = 1 - 2 * part * (1 - part) * (1 - MEMORY)
    mean = USUAL + fading * residual + (bridged - fading**2) * DEVIATION**2 / 2
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
    drawn = draw(flow([1.0, -0.5], since, deviation=HARDLY))
    knots = np.log1p(np.asarray(drawn)) - USUAL  # [crowd, slot, sensor]
    assert knots.std(axis=0) == pytest.approx(0, abs=2e-4)
    for hour, after in enumerate(hours[:-1]):
        low, high = MEMORY**after * [1.0, -0.5], MEMORY ** (after + 1) * [1.0, -0.5]
        for slot in range(HOUR):
            part = (slot + 0.5) / HOUR
            assert knots[0, hour * HOUR + slot] == pytest.approx((1 - part) * low + part * high, abs=6e-4)


def test_before_the_middle_of_the_counted_hour_crowds_are_as_counted() -> None:
    # At 12:00 of the hour from 12:00: its middle is half an hour ahead.
    early = flow([1.0, -0.5], -0.5)
    assert early.start.tolist() == [12.0]
    knots = np.log1p(np.asarray(draw(early)))[0] - USUAL
    assert knots[: HOUR // 2] == pytest.approx(np.tile([1.0, -0.5], (HOUR // 2, 1)), abs=1e-4)
    assert (abs(knots[HOUR] - [1.0, -0.5]) > 0.01).all()
    # So they are forecast, with nothing for what varies.
    assert np.asarray(forecast(early))[: HOUR // 2] == pytest.approx(
        np.tile(np.expm1([4.0, 2.5]), (HOUR // 2, 1)), rel=1e-4
    )


def test_futures_are_drawn_around_the_forecast() -> None:
    futures = flow([1.2, np.nan], 0.0)
    drawn = np.asarray(draw(futures, 1))
    # at middles of hours, between which logarithms are straight lines and vary less
    at = [HOUR - 1, 2 * HOUR - 1, 3 * HOUR - 1]
    assert drawn[:, at].mean(axis=0) == pytest.approx(np.asarray(forecast(futures))[at], rel=0.03)
    # just after the counts, what is known hardly varies, and what is not varies as ever
    logs = np.log1p(drawn[:, 0])
    assert logs[:, 0].std() < 0.05
    assert logs[:, 1].std() == pytest.approx(DEVIATION[1], rel=0.1)


def test_live_walkers_forecast_from_the_same_counts() -> None:
    # The middle of the first slot is that of the counted hour; later ones are between the hours.
    for slot_seconds in (3600.0, 300.0):
        since = -slot_seconds / 2 / 3600
        futures = flow([1.0, -0.5], since, weekly=(0.3, 0.1), slot_seconds=slot_seconds)
        first = np.asarray(forecast(futures))
        assert np.asarray(ahead(futures, first[0], SLOTS)) == pytest.approx(first, rel=1e-4)


def test_without_counts_nothing_changes() -> None:
    nothing, unknown = flow(None, 0.0), flow([np.nan, np.nan], 0.0)
    assert forecast(unknown) == pytest.approx(np.asarray(forecast(nothing)))
    logs = [np.log1p(np.asarray(draw(futures, 2))) for futures in (nothing, unknown)]
    assert logs[0].mean(axis=0) == pytest.approx(logs[1].mean(axis=0), abs=0.04)
    assert logs[0].std(axis=0) == pytest.approx(logs[1].std(axis=0), abs=0.03)


# --- What lasts -----------------------------------------------------------------------------------------------------

# Weeks deviate by .3 and residuals by .4 of the first sensor. Variance then and later: .09 + .16 = .25. Covariance
# with later hours .09 + .16 / 2^hours: .25, .17, .13, .11; its squares by .25: .25, .1156, .0676, .0484.
SHARE = np.array([1, 0.68, 0.52, 0.44])
LEFT = np.array([0, 0.1344, 0.1824, 0.2016])
FIRST = 0  # sensor, with a memory of 1/2


def hourly(futures: SensorFlow, seed: int = 3) -> np.ndarray:
    """How the logarithms of the first sensor's counts in four hours differ from the usual ones."""
    return np.log1p(np.asarray(draw(futures, seed, slots=4), np.float64))[..., FIRST] - USUAL


def distributed(logs: np.ndarray, mean: np.ndarray, variance: np.ndarray) -> None:
    """Within five standard errors; float32 tells logarithms of counts to some 1e-6."""
    futures = len(logs)
    assert (abs(logs.mean(axis=0) - mean) <= 5 * np.sqrt(variance / futures) + 1e-5).all()
    assert (abs(logs.var(axis=0) - variance) <= 5 * variance * math.sqrt(2 / futures) + 1e-9).all()


def test_a_part_of_what_was_counted_lasts() -> None:
    futures = flow([1.0, np.nan], weekly=(0.3, 0.0), **HOURLY)
    found = np.asarray(forecast(futures, slots=4))[:, FIRST]
    assert found == pytest.approx(np.expm1(USUAL + SHARE + LEFT / 2), rel=1e-4)
    logs = hourly(futures)
    distributed(logs, SHARE, LEFT)
    # Of the hours after and two hours after, given the first: .17 - .17 * .13 / .25
    covariance = 0.0816
    error = math.sqrt((LEFT[1] * LEFT[2] + covariance**2) / CROWDS)
    assert abs(np.cov(logs[:, 1], logs[:, 2])[0, 1] - covariance) < 5 * error


def test_what_differs_from_place_to_place_is_known_by_its_counts() -> None:
    # By .4 as well: variance .25 + .16 = .41, covariances .41, .33, .29, .27. The middle of a lognormal factor of mean
    # 1 is .08 lower, of logarithms, so that what was counted is by 1.08 more.
    futures = replace(flow([1.0, np.nan], weekly=(0.3, 0.0), **HOURLY), uneven=0.4)
    covariance = np.array([0.41, 0.33, 0.29, 0.27])
    mean, left = covariance / 0.41 * 1.08 - 0.08, 0.41 - covariance**2 / 0.41
    assert mean[0] == pytest.approx(1)
    found = np.asarray(forecast(futures, slots=4))
    assert found[:, FIRST] == pytest.approx(np.expm1(USUAL + mean + left / 2), rel=1e-4)
    distributed(hourly(futures), mean, left)
    # A sensor that is not known has the usual mean: that of its residuals, .2^2 / 2.
    assert found[:, 1] == pytest.approx(np.full(4, np.expm1(USUAL + 0.02)), rel=1e-4)


def test_counts_tell_as_much_as_their_hour_varies() -> None:
    # Residuals deviate by .4 from 12:00 to 13:00, as counted, and by .2 in all other hours. Covariances
    # .09 + .4 * .2 / 2^hours: .13, .11, .10, and variances of .13.
    deviation = np.full((24, 2), 0.2)
    deviation[12] = 0.4
    futures = flow([1.0, np.nan], weekly=(0.3, 0.0), deviation=deviation, **HOURLY)
    share = np.array([1, 0.52, 0.44, 0.4])
    left = np.array([0, 0.13 - 0.0676, 0.13 - 0.0484, 0.13 - 0.04])
    found = np.asarray(forecast(futures, slots=4))[:, FIRST]
    assert found == pytest.approx(np.expm1(USUAL + share + left / 2), rel=1e-4)
    distributed(hourly(futures), share, left)


def test_what_is_not_known_may_last_too() -> None:
    futures = flow([np.nan, 1.0], weekly=(0.3, 0.0), **HOURLY)
    found = np.asarray(forecast(futures, slots=4))[:, FIRST]
    assert found == pytest.approx(np.full(4, np.expm1(USUAL + 0.125)), rel=1e-4)
    distributed(hourly(futures), np.zeros(4), np.full(4, 0.25))
