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


def known(phi: float = 0.5, sigma: float = 0.2, step: float = 3600.0) -> HourOfWeekProfile:
    """The expected count of hour h of the week is h persons."""
    residual = Arima(ar=jnp.array([phi]), ma=jnp.zeros(0), mean=jnp.array(0.0), sigma=jnp.array(sigma), d=0, step=step)
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


def test_forecast_by_hand() -> None:
    # an ordinary Sunday evening rolls over into Monday
    np.testing.assert_allclose(profile.forecast(known(), 166, jnp.array(0.0), 3), [166, 167, 0], rtol=1e-5, atol=1e-5)
    # residual log 4 in the hour before: log 2 in hour 9, log 2 / 2 in hour 10
    busy = profile.forecast(known(), 9, jnp.log(jnp.array(4.0)), 2)
    np.testing.assert_allclose(busy, [10 * 2 - 1, 11 * 2**0.5 - 1], rtol=1e-5)


def test_innovations_are_scaled_by_sigma() -> None:
    volumes = profile.simulate(known(sigma=0.2), 99, jnp.array(0.0), jnp.array([5.0, 0.0]))
    np.testing.assert_allclose(volumes, [100 * np.e - 1, 101 * np.e**0.5 - 1], rtol=1e-5)


def test_a_batch_of_crowds() -> None:
    volumes = profile.simulate(known(), 3, jnp.zeros((4, 2)), jnp.zeros((5, 4, 2)))
    assert volumes.shape == (5, 4, 2)
    np.testing.assert_allclose(volumes[:, 3, 1], [3, 4, 5, 6, 7], rtol=1e-5)


def test_short_slots_take_the_hour_they_begin_in() -> None:
    fine = profile.change_step(known(phi=0.81), 1200.0)
    assert float(fine.residual.ar[0]) == pytest.approx(0.81 ** (1 / 3))
    volumes = jax.jit(profile.forecast, static_argnums=3)(fine, 167, jnp.array(0.0), 3 * 168 * 3)
    np.testing.assert_allclose(volumes[:5], [167, 167, 167, 0, 0], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(
        volumes[:-3], np.roll(np.repeat(np.tile(np.arange(168.0), 3), 3), 3)[:-3], rtol=1e-5, atol=1e-4
    )


def test_one_step_by_hand() -> None:
    hours, series = jnp.array([9, 10, 11, 12]), jnp.array([39.0, 10, jnp.nan, 12])
    # residuals log 4, 0, missing, 0: the next are expected at log 2, 0, 0
    np.testing.assert_allclose(profile.residuals(known(), hours, series)[:2], [np.log(4), 0], atol=1e-6)
    np.testing.assert_allclose(profile.one_step(known(), hours, series), [np.nan, 11 * 2 - 1, 11, 12], rtol=1e-5)


def test_fit_finds_the_model_a_series_was_made_from() -> None:
    times = np.datetime64("2024-01-03T05", "h") + np.arange(120 * 168) * np.timedelta64(1, "h")
    start = int(profile.hour_of_week(times)[0])
    truth = known(phi=0.6, sigma=0.1)
    made = profile.simulate(truth, start, jnp.array(0.0), jax.random.normal(jax.random.key(3), (len(times),)))
    series = np.array(made, dtype=np.float64)
    series[500:700] = np.nan
    fitted = profile.fit_profile(times, series)
    # in hour 0 nobody is expected, and half of its residuals are cut off at zero
    np.testing.assert_allclose(fitted.expected[1:], truth.expected[1:], atol=0.06)
    assert float(fitted.residual.ar[0]) == pytest.approx(0.6, abs=0.03)
    assert float(fitted.residual.sigma) == pytest.approx(0.1, rel=0.05)


def test_fit_needs_every_hour_of_the_week() -> None:
    times = np.datetime64("2024-01-01T00", "h") + np.arange(100) * np.timedelta64(1, "h")
    with pytest.raises(SeriesError, match="68 hours of the week have no count, the first is Friday 04:00"):
        profile.fit_profile(times, np.ones(100))
    with pytest.raises(SeriesError, match="without gaps"):
        profile.fit_profile(times[::2], np.ones(50))


SIMULATE = jax.jit(profile.simulate)


@settings(deadline=None)
@given(
    st.floats(0, 500),
    st.floats(-0.99, 0.99),
    st.floats(0, 2),
    st.floats(-5, 5),
    hnp.arrays(np.float32, 6, elements=st.floats(-8, 8, width=32)),
)
def test_never_negative_never_nan(start: float, phi: float, sigma: float, before: float, z: np.ndarray) -> None:
    volumes = np.asarray(SIMULATE(known(phi, sigma), start, jnp.array(before), jnp.asarray(z)))
    assert np.isfinite(volumes).all()
    assert (volumes >= 0).all()
