"""The hour-of-week profile by hand, fitted to a series made from one, and in its limits."""

from datetime import datetime

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sidestep.crowds import profile
from sidestep.crowds.arima import Arima, SeriesError
from sidestep.crowds.profile import HourOfWeekProfile


def known(phi: float = 0.5, sigma: float = 0.2) -> HourOfWeekProfile:
    """The expected count of hour h of the week is h persons."""
    residual = Arima(ar=jnp.array([phi]), ma=jnp.zeros(0), mean=jnp.array(0.0), sigma=jnp.array(sigma))
    return HourOfWeekProfile(expected=jnp.log1p(jnp.arange(168.0)), residual=residual)


def test_hours_of_the_week() -> None:
    times = np.array(["2024-01-01T00", "2024-01-02T05", "2024-01-07T23", "2024-01-08T00"], dtype="datetime64[h]")
    assert profile.hour_of_week(times).tolist() == [0, 29, 167, 0]  # 1 January 2024 is a Monday


def test_times_of_the_week() -> None:
    assert profile.time_of_week(datetime.fromisoformat("2025-05-24T12:30")) == 132.5
    assert profile.time_of_week(datetime.fromisoformat("2025-05-26T00:00:36")) == 0.01
    assert [profile.day_and_time(hour) for hour in (132.5, 0.01, 167.999)] == [
        "Saturday 12:30",
        "Monday 00:01",
        "Monday 00:00",
    ]


def test_one_step_by_hand() -> None:
    hours, series = jnp.array([9, 10, 11, 12]), jnp.array([39.0, 10, jnp.nan, 12])
    # residuals log 4, 0, missing, 0: the next are expected at log 2, 0, 0
    np.testing.assert_allclose(profile.one_step(known(), hours, series), [np.nan, 11 * 2 - 1, 11, 12], rtol=1e-5)


def test_fit_finds_the_model_a_series_was_made_from() -> None:
    times = np.datetime64("2024-01-03T05", "h") + np.arange(120 * 168) * np.timedelta64(1, "h")
    hours = profile.hour_of_week(times)
    residual = 0.1 * np.random.default_rng(3).normal(size=len(times))
    for hour in range(1, len(times)):
        residual[hour] += 0.6 * residual[hour - 1]
    series = np.maximum(np.expm1(np.log1p(hours) + residual), 0)
    series[500:700] = np.nan
    fitted = profile.fit_profile(times, series)
    # in hour 0 nobody is expected, and half of its residuals are cut off at zero
    np.testing.assert_allclose(fitted.expected[1:], np.log1p(np.arange(1, 168)), atol=0.06)
    assert float(fitted.residual.ar[0]) == pytest.approx(0.6, abs=0.03)
    assert float(fitted.residual.sigma) == pytest.approx(0.1, rel=0.05)


def test_fit_needs_every_hour_of_the_week() -> None:
    times = np.datetime64("2024-01-01T00", "h") + np.arange(100) * np.timedelta64(1, "h")
    with pytest.raises(SeriesError, match="68 hours of the week have no count, the first is Friday 04:00"):
        profile.fit_profile(times, np.ones(100))
    with pytest.raises(SeriesError, match="without gaps"):
        profile.fit_profile(times[::2], np.ones(50))


ONE_STEP = jax.jit(profile.one_step)


@settings(deadline=None)
@given(
    st.integers(0, 100),
    st.floats(-0.99, 0.99),
    hnp.arrays(np.float32, 6, elements=st.floats(0, 8000, width=32) | st.just(np.nan)),
)
def test_never_negative_and_never_nan_after_a_count(start: int, phi: float, series: np.ndarray) -> None:
    found = np.asarray(ONE_STEP(known(phi), start + jnp.arange(6), jnp.asarray(series)))
    seen = np.cumsum(~np.isnan(series[:-1])) > 0
    assert np.isnan(found[1:]).tolist() == (~seen).tolist()
    assert not (found < 0).any()


def test_weeks_that_are_all_alike_have_no_innovations() -> None:
    times = np.datetime64("2024-01-01T00", "h") + np.arange(3 * profile.HOURS_OF_WEEK)
    square = np.where(np.arange(len(times)) % 24 < 12, 0.0, 100.0)
    model = profile.fit_profile(times, square)
    assert (model.residual.ar.tolist(), float(model.residual.sigma)) == ([0.0], 0.0)
    np.testing.assert_allclose(np.expm1(model.expected), square[: profile.HOURS_OF_WEEK], rtol=1e-5)
    predicted = np.asarray(profile.one_step(model, jnp.asarray(profile.hour_of_week(times)), jnp.asarray(square)))
    np.testing.assert_allclose(predicted[1:], square[1:], rtol=1e-5)


def test_one_week_tells_nothing_about_others() -> None:
    times = np.datetime64("2024-01-01T00", "h") + np.arange(profile.HOURS_OF_WEEK)
    with pytest.raises(SeriesError, match="once"):
        profile.fit_profile(times, np.arange(float(profile.HOURS_OF_WEEK)))
