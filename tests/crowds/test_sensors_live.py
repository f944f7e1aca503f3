"""Crowds of sensors that go on from the latest counts."""

import math
from dataclasses import replace
from datetime import datetime
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.counts import CountTable, LatestCounts, latest_counts
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.crowds.sensor_model import SensorModel
from sidestep.crowds.sensors import CurrentCounts, SensorFlow

LEVEL = 3.0  # of log(1 + count), in every hour
PHI = np.array([0.5, 0.8])
SIGMA = np.array([0.4, 0.2])
HOUR = 12  # slots of 5 min
SLOTS, CROWDS = 4 * HOUR, 2000
# Slots of an hour from 12:00 on have the middles of hours as theirs, the first that of the counted one.
HOURLY = {"since": -0.5, "slot_seconds": 3600.0}
HARDLY = np.full(2, 1e-4)  # a standard deviation; at zero nothing but the expected count is possible


def flow(residual, since: float, sigma=SIGMA, weekly=(0.0, 0.0), slot_seconds: float = 300.0) -> SensorFlow:
    """Counts are of the hour from 12:00, ``since`` hours after its middle; ``sigma`` is of all hours or of each one."""
    floats = jnp.float32
    model = SensorModel(
        jnp.full((168, 2), LEVEL),
        jnp.asarray(weekly, floats),
        jnp.broadcast_to(jnp.asarray(sigma, floats), (24, 2)),
        jnp.asarray(PHI, floats),
        jnp.eye(2),
    )
    weights = InterpolationWeights(jnp.array([[0], [1]]), jnp.ones((2, 1)))
    current = CurrentCounts(
        jnp.full(2, jnp.nan) if residual is None else jnp.asarray(residual, floats), jnp.asarray(since, floats)
    )
    return SensorFlow(model, weights, jnp.ones(2), slot_seconds, current=current)


def hour(futures: SensorFlow):
    """The hour of the week at which people set out."""
    return 12.5 + futures.current.since


@partial(jax.jit, static_argnames="slots")
def forecast(futures: SensorFlow, slots: int = SLOTS):
    return futures.expected(hour(futures)[None], slots).counted[0]


@partial(jax.jit, static_argnames="slots")
def draw(futures: SensorFlow, seed: int = 0, slots: int = SLOTS):
    return futures.draw(jax.random.key(seed), jnp.full(CROWDS, hour(futures)), slots).counted


@partial(jax.jit, static_argnames="slots")
def ahead(futures: SensorFlow, now, slots: int):
    return futures.ahead(now, hour(futures), jnp.int32(0), slots)


def expected(residual, hours) -> np.ndarray:
    """By hand: the mean of exp of a normal number, less one; the residual fades straight from hour to hour.

    Before the middle of the counted hour, futures are as counted; ``hours`` is 0 and nothing varies.
    """
    whole = int(hours)
    part = hours - whole
    fading = (1 - part) * PHI**whole + part * PHI ** (whole + 1)
    bridged = 1 - 2 * part * (1 - part) * (1 - PHI)
    mean = LEVEL + fading * residual + (bridged - fading**2) * SIGMA**2 / 2
    return np.expm1(mean)


@pytest.mark.parametrize("since", [-0.5, 0.0, 0.25, 1.0])
def test_the_forecast_fades_to_the_expected(since: float) -> None:
    residual = np.array([1.0, -0.5])
    found = np.asarray(forecast(flow(residual, since)))
    for slot in (0, 5, 11, 30, 47):
        hours = max(since + (slot + 0.5) / HOUR, 0.0)
        assert found[slot] == pytest.approx(expected(residual, hours), rel=1e-4)


def test_sensors_without_a_count_are_as_expected() -> None:
    found = np.asarray(forecast(flow([np.nan, 0.7], 0.0)))
    without = np.asarray(forecast(flow(None, 0.0)))
    assert found[:, 0] == pytest.approx(without[:, 0])
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
    drawn = draw(flow([1.0, -0.5], since, sigma=HARDLY))
    knots = np.log1p(np.asarray(drawn)) - LEVEL  # [crowd, slot, sensor]
    assert knots.std(axis=0) == pytest.approx(0, abs=2e-4)
    for hour, after in enumerate(hours[:-1]):
        low, high = PHI**after * [1.0, -0.5], PHI ** (after + 1) * [1.0, -0.5]
        for slot in range(HOUR):
            part = (slot + 0.5) / HOUR
            assert knots[0, hour * HOUR + slot] == pytest.approx((1 - part) * low + part * high, abs=6e-4)


def test_before_the_middle_of_the_counted_hour_crowds_are_as_counted() -> None:
    # At 12:00 of the hour from 12:00: its middle is half an hour ahead.
    early = flow([1.0, -0.5], -0.5)
    assert float(hour(early)) == 12
    knots = np.log1p(np.asarray(draw(early)))[0] - LEVEL
    assert knots[: HOUR // 2] == pytest.approx(np.tile([1.0, -0.5], (HOUR // 2, 1)), abs=1e-4)
    assert (abs(knots[HOUR] - [1.0, -0.5]) > 0.01).all()
    # The forecast is the same, with nothing for what varies.
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
    assert logs[:, 1].std() == pytest.approx(SIGMA[1], rel=0.1)


def test_live_walkers_forecast_from_the_same_counts() -> None:
    # The middle of the first slot is that of the counted hour; later ones are between the hours.
    for slot_seconds in (3600.0, 300.0):
        since = -slot_seconds / 2 / 3600
        futures = flow([1.0, -0.5], since, weekly=(0.3, 0.1), slot_seconds=slot_seconds)
        first = np.asarray(forecast(futures))
        assert np.asarray(ahead(futures, first[0], SLOTS)) == pytest.approx(first, rel=1e-4)


def test_without_any_count_nothing_changes() -> None:
    unknown = flow(None, 0.0)

    @jax.jit
    def without(futures: SensorFlow):
        plain, hours = replace(futures, current=None), jnp.full(CROWDS, hour(futures))
        return plain.expected(hours[:1], SLOTS).counted[0], plain.draw(jax.random.key(2), hours, SLOTS).counted

    mean, drawn = without(unknown)
    assert forecast(unknown) == pytest.approx(np.asarray(mean))
    logs = [np.log1p(np.asarray(futures)) for futures in (drawn, draw(unknown, 2))]
    assert logs[0].mean(axis=0) == pytest.approx(logs[1].mean(axis=0), abs=0.04)
    assert logs[0].std(axis=0) == pytest.approx(logs[1].std(axis=0), abs=0.03)


# --- What lasts -----------------------------------------------------------------------------------------------------

# Weeks deviate by .3 and residuals by .4 of the first sensor. Variance then and later: .09 + .16 = .25. Covariance
# with later hours .09 + .16 / 2^hours: .25, .17, .13, .11; its squares by .25: .25, .1156, .0676, .0484.
SHARE = np.array([1, 0.68, 0.52, 0.44])
LEFT = np.array([0, 0.1344, 0.1824, 0.2016])
FIRST = 0  # sensor, whose residuals halve in an hour


def hourly(futures: SensorFlow, seed: int = 3) -> np.ndarray:
    """How the logarithms of the first sensor's counts in four hours differ from the expected ones."""
    return np.log1p(np.asarray(draw(futures, seed, slots=4), np.float64))[..., FIRST] - LEVEL


def distributed(logs: np.ndarray, mean: np.ndarray, variance: np.ndarray) -> None:
    """Within five standard errors; float32 tells logarithms of counts to some 1e-6."""
    futures = len(logs)
    assert (abs(logs.mean(axis=0) - mean) <= 5 * np.sqrt(variance / futures) + 1e-5).all()
    assert (abs(logs.var(axis=0) - variance) <= 5 * variance * math.sqrt(2 / futures) + 1e-9).all()


def test_a_part_of_what_was_counted_lasts() -> None:
    futures = flow([1.0, np.nan], weekly=(0.3, 0.0), **HOURLY)
    found = np.asarray(forecast(futures, slots=4))[:, FIRST]
    assert found == pytest.approx(np.expm1(LEVEL + SHARE + LEFT / 2), rel=1e-4)
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
    assert found[:, FIRST] == pytest.approx(np.expm1(LEVEL + mean + left / 2), rel=1e-4)
    distributed(hourly(futures), mean, left)
    # A sensor without a count has the expected mean: that of its residuals, .2^2 / 2.
    assert found[:, 1] == pytest.approx(np.full(4, np.expm1(LEVEL + 0.02)), rel=1e-4)


def test_counts_tell_as_much_as_their_hour_varies() -> None:
    # Residuals deviate by .4 from 12:00 to 13:00, as counted, and by .2 in all other hours. Covariances
    # .09 + .4 * .2 / 2^hours: .13, .11, .10, and variances of .13.
    sigma = np.full((24, 2), 0.2)
    sigma[12] = 0.4
    futures = flow([1.0, np.nan], weekly=(0.3, 0.0), sigma=sigma, **HOURLY)
    share = np.array([1, 0.52, 0.44, 0.4])
    left = np.array([0, 0.13 - 0.0676, 0.13 - 0.0484, 0.13 - 0.04])
    found = np.asarray(forecast(futures, slots=4))[:, FIRST]
    assert found == pytest.approx(np.expm1(LEVEL + share + left / 2), rel=1e-4)
    distributed(hourly(futures), share, left)


def test_what_was_not_counted_may_last_too() -> None:
    futures = flow([np.nan, 1.0], weekly=(0.3, 0.0), **HOURLY)
    found = np.asarray(forecast(futures, slots=4))[:, FIRST]
    assert found == pytest.approx(np.full(4, np.expm1(LEVEL + 0.125)), rel=1e-4)
    distributed(hourly(futures), np.zeros(4), np.full(4, 0.25))


def test_crowds_of_sensors_go_on_from_the_latest_counts() -> None:
    last = np.array(["2025-05-24T12"], "datetime64[h]")  # a Saturday
    table = CountTable(last, ("quay",), np.array([[7.0]]), None, (), "live.csv")
    latest = latest_counts(table, ("bridge", "quay"), datetime.fromisoformat("2025-05-24T12:45"))
    before = replace(flow(None, 0.0), record=jnp.zeros((2, 168, 2)))
    after = before.going_on_from(latest)
    assert after.record is None
    assert after.current.residual.tolist() == [pytest.approx(np.nan, nan_ok=True), pytest.approx(math.log(8) - LEVEL)]
    assert float(after.current.since) == 0.25


# --- Hours that are not those of clocks -----------------------------------------------------------------------------


def off_hour(residual, since, offset, start: float, sigma=SIGMA) -> SensorFlow:
    """Counted in the hour from 12:00 and ``offset`` hours on, which ``since`` may be of each sensor."""
    futures = flow(residual, 0.0, sigma=sigma)
    assert start == pytest.approx(np.asarray(12.5 + np.asarray(offset) + since))
    floats = (jnp.asarray(each, jnp.float32) for each in (since, offset))
    return replace(futures, current=CurrentCounts(futures.current.residual, *floats))


@pytest.mark.parametrize(
    ("since", "offset", "start"),
    [
        (0.5, 0.25, 13.25),
        (1.0, 1 / 3, 12.5 + 1 / 3 + 1),  # float32 has no third, and the hour must not slip
        (1.9, 0.0, 14.4),
        (np.array([0.5, 1.25]), np.array([0.75, 0.0]), 13.75),
    ],
)
def test_what_was_counted_fades_from_the_middle_of_its_hour_on(since, offset, start: float) -> None:
    residual = np.array([1.0, -0.5])
    futures, quiet = (off_hour(residual, since, offset, start, sigma) for sigma in (SIGMA, HARDLY))

    @jax.jit
    def both(futures: SensorFlow, quiet: SensorFlow):
        hours = jnp.full(CROWDS, start, jnp.float32)
        drawn = [each.draw(jax.random.key(4), hours, SLOTS).counted for each in (futures, quiet)]
        return futures.expected(hours[:1], SLOTS).counted[0], *drawn

    mean, drawn, still = (np.asarray(each, np.float64) for each in both(futures, quiet))
    begun = np.broadcast_to(since, 2)
    for slot in (0, 5, 11, 30, 47):
        for sensor, hours in enumerate(begun + (slot + 0.5) / HOUR):
            assert mean[slot, sensor] == pytest.approx(expected(residual, hours)[sensor], rel=1e-4)
            whole, part = divmod(hours, 1)
            knots = PHI[sensor] ** whole * residual[sensor] * np.array([1, PHI[sensor]])
            straight = (1 - part) * knots[0] + part * knots[1]
            assert np.log1p(still[:, slot, sensor]).mean() - LEVEL == pytest.approx(straight, abs=1e-3)
    logs = np.log1p(drawn)
    for sensor, hours in enumerate(begun):  # at the next middle but one there is one normal number, as by hand
        slot = int((math.ceil(hours) + 1 - hours) * HOUR)
        after = hours + (slot + 0.5) / HOUR
        part, fading = after % 1, PHI[sensor] ** int(after)
        bridged = 1 - 2 * part * (1 - part) * (1 - PHI[sensor])
        left = (bridged - (fading * (1 - part + part * PHI[sensor])) ** 2) * SIGMA[sensor] ** 2
        assert logs[:, slot, sensor].var() == pytest.approx(left, rel=0.16)  # five standard errors


def test_counts_are_held_against_the_expected_level_of_their_middle() -> None:
    rising = replace(flow(None, 0.0).model, expected=jnp.arange(168.0)[:, None] * jnp.array([0.01, 0.02]))
    before = replace(flow(None, 0.0), model=rising, current=None)
    # Saturday 12:15 to 13:15 is a quarter of the way from hour 132 to 133; Sunday 23:45 on from 167 to 0.
    one = before.going_on_from(LatestCounts(np.array([7.0, 7.0]), np.datetime64("2025-05-24T12:15"), 0.5))
    assert one.current.residual == pytest.approx(math.log(8) - np.array([1.3225, 2.645]), rel=1e-5)
    hour = np.array(["2025-05-24T12:15", "2025-05-25T23:45"], "datetime64[s]")
    each = before.going_on_from(LatestCounts(np.array([7.0, np.nan]), hour, np.array([0.5, 0.25])))
    assert each.current.residual[0] == one.current.residual[0]
    assert each.current.offset.tolist() == [0.25, 0.75]
    last = before.going_on_from(LatestCounts(np.array([7.0, 7.0]), hour, np.array([0.5, 0.25])))
    assert float(last.current.residual[1]) == pytest.approx(math.log(8) - 0.25 * 3.34, rel=1e-5)


def test_counts_tell_as_much_as_the_two_hours_of_theirs_vary() -> None:
    # From 12:30 on, half of it in the hour that deviates by .4, half in one by .2: .3 by then.
    sigma = np.full((24, 2), 0.2)
    sigma[12] = 0.4
    futures = off_hour([1.0, np.nan], -0.5, 0.5, 12.5, sigma)
    futures = replace(futures, model=replace(futures.model, weekly=jnp.array([0.3, 0.0])), slot_seconds=3600.0)
    found = np.asarray(futures.expected(jnp.full(1, 12.5), 1).counted)[0, 0, FIRST]
    assert found == pytest.approx(np.expm1(LEVEL + 1), rel=1e-4)
    ratio, then = futures._counted(futures.current, jnp.float32(12.5))
    assert (ratio.tolist(), then.tolist()) == ([1, 0], pytest.approx([0.3, 0.3]))


def test_counts_of_some_sensors() -> None:
    hours = np.array(["2025-05-24T12:15", "2025-05-24T12:30"], "datetime64[s]")
    own = LatestCounts(np.array([7.0, np.nan]), hours, np.array([0.5, 0.25])).of([1, 0, 0])
    np.testing.assert_array_equal(own.counts, [np.nan, 7, 7])
    assert (own.known, own.hour.tolist(), own.since.tolist()) == (2, hours[[1, 0, 0]].tolist(), [0.25, 0.5, 0.5])
    same = LatestCounts(np.array([7.0, 8.0]), np.datetime64("2025-05-24T12"), 0.25).of([1])
    assert (same.counts.tolist(), same.hour, same.since) == ([8], np.datetime64("2025-05-24T12"), 0.25)
