"""ARIMA by hand, beside statsmodels, and in its statistics; the exact change of step; the shipped model."""

import importlib.util
import json
from functools import partial
from pathlib import Path
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from statsmodels.tsa.arima.model import ARIMA  # type: ignore[import-untyped]

from sidestep.crowds import arima
from sidestep.crowds.arima import Arima, ArimaFlow, SeriesError

ROOT = Path(__file__).parents[2]


def model(
    ar: list[float] | None = None,
    ma: list[float] | None = None,
    mean: float = 0.0,
    sigma: float = 1.0,
    d: int = 0,
    step: float = 3600.0,
) -> Arima:
    return Arima(
        ar=jnp.array(ar or [], dtype=float),
        ma=jnp.array(ma or [], dtype=float),
        mean=jnp.array(mean, dtype=float),
        sigma=jnp.array(sigma, dtype=float),
        d=d,
        step=step,
    )


def follow(m: Arima, history: list[float], innovations: list[float]) -> list[float]:
    return arima.simulate(m, jnp.array(history, dtype=float), jnp.array(innovations, dtype=float)).tolist()


# --- By hand --------------------------------------------------------------------------------------------------------


def test_ar1() -> None:
    # 100 + .5 (200 - 100) + 10 = 160;  100 + .5 * 60 - 20 = 110;  100 + .5 * 10 = 105
    assert follow(model([0.5], mean=100, sigma=10), [200], [1, -2, 0]) == [160, 110, 105]


def test_ar2_takes_the_oldest_value_first() -> None:
    # .5 * 4 + .25 * 8 = 4;  .5 * 4 + .25 * 4 = 3
    assert follow(model([0.5, 0.25]), [8, 4], [0, 0]) == [4, 3]


def test_one_difference() -> None:
    # grows by 4, then by 2, 1, 1/2
    assert follow(model([0.5], d=1), [10, 14], [0, 0, 0]) == [16, 17, 17.5]


def test_two_differences() -> None:
    # no AR: the slope 3 stays;  AR .5: growth 3, second difference 2 -> 1 -> .5, so growth 4, 4.5
    assert follow(model(d=2), [1, 4], [0, 0]) == [7, 10]
    assert follow(model([0.5], d=2), [1, 2, 5], [0, 0]) == [9, 13.5]


def test_moving_average_has_the_papers_sign() -> None:
    # mu(B) = 1 - .4 B: an innovation of 10 is followed by -4
    m = model(ma=[0.4], mean=50, sigma=10)
    assert follow(m, [50], [1, 0, 0]) == [60, 46, 50]
    assert follow(m, [50, 60], [0, 0]) == [46, 50]  # the innovation is recovered from the history


def test_a_short_history_is_padded_with_its_oldest_value() -> None:
    assert follow(model([0.5], d=1), [10], [0, 0]) == [10, 10]
    assert follow(model([0.5, 0.25]), [8], [0]) == [6]


def test_missing_history_is_taken_to_be_as_expected() -> None:
    m = model([0.5], mean=100)
    assert follow(m, [200, float("nan")], [0]) == [125]
    assert follow(m, [float("nan"), 200], [0]) == [150]
    assert follow(m, [float("nan")], [0]) == [100]


def test_only_what_is_reported_is_cut_at_zero() -> None:
    m = model([0.5])
    assert arima.latent(m, jnp.array([0.0]), jnp.array([-4.0, 0, 4])).tolist() == [-4, -2, 3]
    assert follow(m, [0], [-4, 0, 4]) == [0, 0, 3]


def test_forecast_is_simulation_without_noise() -> None:
    m = model([0.5], mean=100, sigma=10)
    history = jnp.array([[200.0, 0.0]])
    np.testing.assert_allclose(arima.forecast(m, history, 2), [[150, 50], [125, 75]])


def test_one_step_is_a_forecast_from_each_prefix() -> None:
    m = model([0.6], [0.3], d=1)
    series = jnp.array([10.0, 14, jnp.nan, 12, 20, 3])
    predicted = arima.one_step(m, series)
    assert np.isnan(predicted[0])
    for t in range(1, len(series)):
        np.testing.assert_allclose(predicted[t], arima.forecast(m, series[:t], 1)[0], rtol=1e-5)
    late = arima.one_step(m, jnp.array([jnp.nan, jnp.nan, 7.0, 8.0]))
    assert np.isnan(late).tolist() == [True, True, True, False]


def test_crowds_are_independent_and_models_can_be_mapped() -> None:
    z = jax.random.normal(jax.random.key(0), (5, 3, 2))
    start = jnp.full((1, 3, 2), 50.0)
    together = jax.jit(arima.simulate)(model([0.9], mean=50, sigma=5), start, z)
    alone = arima.simulate(model([0.9], mean=50, sigma=5), start[:, 1, 0], z[:, 1, 0])
    np.testing.assert_allclose(together[:, 1, 0], alone, rtol=1e-6)
    models = jax.tree.map(lambda *leaves: jnp.stack(leaves), model([0.9], mean=50), model([0.1], mean=9))
    both = jax.vmap(arima.forecast, in_axes=(0, None, None))(models, jnp.array([10.0]), 1)
    np.testing.assert_allclose(both[:, 0], [14, 9.1], rtol=1e-6)


# --- Beside statsmodels, and in the long run ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def noise() -> np.ndarray:
    return np.random.default_rng(3).normal(size=2000)


@pytest.mark.parametrize("order", [(2, 0, 1), (1, 1, 1)])
def test_fit_and_forecast_agree_with_statsmodels(noise: np.ndarray, order: tuple[int, int, int]) -> None:
    p, d, q = order
    truth = model([0.6, 0.2][:p], [0.4], mean=0 if d else 500, sigma=20, d=d)
    series = np.asarray(arima.latent(truth, jnp.array([500.0]), jnp.asarray(noise)), dtype=np.float64)
    fitted = arima.fit_arima(series, p=p, d=d, q=q)
    np.testing.assert_allclose(fitted.ar, truth.ar, atol=0.15)
    np.testing.assert_allclose(fitted.ma, truth.ma, atol=0.15)
    assert float(fitted.sigma) == pytest.approx(20, rel=0.05)
    ours = arima.latent(fitted, jnp.asarray(series), jnp.zeros(8))
    constant = [] if d else [float(fitted.mean)]
    numbers = [*constant, *fitted.ar.tolist(), *(-fitted.ma).tolist(), float(fitted.sigma) ** 2]
    theirs = ARIMA(series, order=order, trend="n" if d else "c").smooth(numbers).forecast(8)
    np.testing.assert_allclose(ours, theirs, rtol=1e-3)


def test_fit_copes_with_gaps_and_zeros(noise: np.ndarray) -> None:
    series = np.array(arima.simulate(model([0.8], mean=100, sigma=30), jnp.array([100.0]), jnp.asarray(noise)))
    series = series.astype(np.float64)
    series[np.random.default_rng(1).random(len(series)) < 0.2] = np.nan
    fitted = arima.fit_arima(series)
    assert float(fitted.ar[0]) == pytest.approx(0.8, abs=0.05)
    assert float(fitted.mean) == pytest.approx(100, abs=15)
    assert (fitted.d, fitted.step) == (0, 3600)


def test_the_data_choose_d(noise: np.ndarray) -> None:
    assert arima.choose_d(noise) == 0
    assert arima.choose_d(np.cumsum(noise)) == 1
    assert arima.choose_d(np.cumsum(np.cumsum(noise))) == 2
    assert arima.choose_d(np.arange(50.0)) == 1  # a straight line; nothing is left after one difference
    gaps = np.cumsum(noise)
    gaps[100:300] = np.nan
    assert arima.choose_d(gaps) == 1
    assert arima.fit_arima(np.cumsum(noise)).d == 1


@pytest.mark.parametrize(
    ("series", "says"),
    [
        (np.arange(10.0), "10 values"),
        (np.full(100, np.nan), "0 values"),
        (np.full(100, 5.0), "0 times"),
        (np.arange(100.0), "1 times"),
        (np.array([np.inf] * 100), "infinite"),
    ],
)
def test_hopeless_series(series: np.ndarray, says: str) -> None:
    with pytest.raises(SeriesError, match=says):
        arima.fit_arima(series)


@pytest.mark.parametrize("order", [(-1, 0, 0), (0, 0, -1), (1, 3, 0), (1, -1, 0)])
def test_impossible_orders(order: tuple[int, int, int]) -> None:
    with pytest.raises(SeriesError) as caught:
        arima.fit_arima(np.random.default_rng(0).normal(size=100), *order)
    assert caught.value.field == "order"


def test_statistics_of_a_simulated_series() -> None:
    # standard deviation 30 / sqrt(1 - .8^2) = 50
    z = jax.random.normal(jax.random.key(1), (2100, 100))
    path = np.asarray(arima.simulate(model([0.8], mean=500, sigma=30), jnp.full((1, 100), 500.0), z))[100:]
    assert path.mean() == pytest.approx(500, abs=2)
    assert path.std() == pytest.approx(50, rel=0.02)
    assert np.corrcoef(path[1:].ravel(), path[:-1].ravel())[0, 1] == pytest.approx(0.8, abs=0.01)


VOLUMES = st.one_of(st.floats(0, 1e4, width=32), st.just(float("nan")))
SIMULATE = jax.jit(arima.simulate)


@settings(deadline=None)
@given(
    st.integers(0, 2),
    st.floats(-0.99, 0.99),
    st.floats(-0.99, 0.99),
    st.floats(0, 5000),
    st.floats(0, 2000),
    hnp.arrays(np.float32, (3, 2), elements=VOLUMES),
    hnp.arrays(np.float32, (6, 2), elements=st.floats(-8, 8, width=32)),
)
def test_volumes_are_never_negative_and_never_nan(
    d: int, ar: float, ma: float, mean: float, sigma: float, history: np.ndarray, innovations: np.ndarray
) -> None:
    m = model([ar], [ma], mean=0 if d else mean, sigma=sigma, d=d)
    volumes = np.asarray(SIMULATE(m, jnp.asarray(history), jnp.asarray(innovations)))
    assert np.isfinite(volumes).all()
    assert (volumes >= 0).all()


# --- Change of step -------------------------------------------------------------------------------------------------


def test_half_the_step_by_hand() -> None:
    # phi = sqrt(.81) = .9;  100 (1 - .81) / (1 - .81^2) = 100 * .19 / .3439 = 55.249, sigma = 7.433
    half = arima.change_step(model([0.81], mean=70, sigma=10), 1800.0)
    np.testing.assert_allclose([half.ar[0], half.sigma, half.mean], [0.9, 7.43297, 70], rtol=1e-5)
    assert half.step == 1800


@settings(deadline=None)
@given(st.floats(0.05, 0.99), st.floats(1, 500), st.floats(60, 20_000), st.floats(60, 20_000))
def test_changing_twice_is_changing_once(phi: float, sigma: float, first: float, second: float) -> None:
    m = model([phi], mean=300, sigma=sigma)
    middle = arima.change_step(m, first)
    if not 0.001 < float(middle.ar[0]) < 0.9999:  # single precision would lose it
        return
    twice, once = arima.change_step(middle, second), arima.change_step(m, second)
    assert twice.step == once.step == second
    np.testing.assert_allclose(twice.ar, once.ar, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(twice.sigma, once.sigma, rtol=2e-3)


@settings(deadline=None)
@given(st.floats(0.05, 0.99), st.floats(1, 500))
def test_twelve_steps_of_five_minutes_make_the_hour(phi: float, sigma: float) -> None:
    fine = arima.change_step(model([phi], sigma=sigma), 300.0)
    small = float(fine.ar[0])
    assert small**12 == pytest.approx(phi, rel=1e-5)
    variance = float(fine.sigma) ** 2 * sum(small ** (2 * k) for k in range(12))
    assert variance == pytest.approx(sigma**2, rel=1e-3)


@pytest.mark.parametrize(
    ("other", "step", "field"),
    [
        (model([0.5, 0.1]), 300.0, "order"),
        (model([0.5], [0.1]), 300.0, "order"),
        (model([0.5], d=1), 300.0, "order"),
        (model([-0.5]), 300.0, "ar"),
        (model([1.0]), 300.0, "ar"),
        (model([0.5]), 0.0, "step"),
        (model([0.5]), float("nan"), "step"),
    ],
)
def test_no_other_step(other: Arima, step: float, field: str) -> None:
    with pytest.raises(SeriesError) as caught:
        arima.change_step(other, step)
    assert caught.value.field == field


# --- Crowds on a network --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flow() -> ArimaFlow:
    return ArimaFlow(jnp.array([200.0, 900]), model([0.8], mean=300, sigma=50, step=300.0))


@partial(jax.jit, static_argnames="slots")
def ahead(flow: ArimaFlow, now: jax.Array, slots: int = 4) -> jax.Array:
    return flow.ahead(now, jnp.float32(0), jnp.int32(9), slots)


@partial(jax.jit, static_argnames="slots")
def expected(flow: ArimaFlow, slots: int = 4) -> jax.Array:
    return flow.expected(jnp.zeros(3), slots).counted


def test_ahead_is_the_forecast(flow: ArimaFlow) -> None:
    now = jnp.array([100.0, 800])
    found = ahead(flow, now)
    # 300 - 200 * .8^k and 300 + 500 * .8^k
    np.testing.assert_allclose(found, [[100, 800], [140, 700], [172, 620], [197.6, 556]], rtol=1e-6)
    np.testing.assert_allclose(found[1:], arima.forecast(flow.model, now[None], 3), rtol=1e-6)
    # from the counts at clock 0 it is what was expected then
    np.testing.assert_allclose(ahead(flow, flow.initial), expected(flow)[0], rtol=1e-6)


def test_crowds_start_at_their_volumes_and_never_leave_a_segment_empty(flow: ArimaFlow) -> None:
    field = flow.draw(jax.random.key(0), jnp.zeros(5), 3)
    assert (field.counted.shape, field.slot_seconds) == ((5, 3, 2), 300)
    assert field.counted[:, 0].tolist() == [[200, 900]] * 5
    assert len(set(field.counted[:, 1, 0].tolist())) == 5
    assert expected(ArimaFlow(jnp.zeros(2), flow.model))[0, 0].tolist() == [1, 1]


def test_crowds_know_no_hours_and_have_one_expected_field(flow: ArimaFlow) -> None:
    assert expected(flow).shape == (1, 4, 2)
    assert not flow.timed
    assert flow.covers(100.0)


def test_stationary_paths_by_hand() -> None:
    # .6 and sqrt(1 - .6^2) = .8; phi of each series: .6 * 1 + .8 * 2 = 2.2, .8 * 1 + .6 * 2 = 2
    path = arima.stationary_ar1(jnp.array([0.6, 0.8]), jnp.ones((1, 2)), jnp.full((1, 1, 2), 2.0))
    np.testing.assert_allclose(path, [[[1, 1], [2.2, 2]]], rtol=1e-6)


# --- The shipped model ----------------------------------------------------------------------------------------------


def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fit_auckland", ROOT / "scripts/fit_auckland.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_shipped_numbers_are_those_of_a_refit() -> None:
    fit_auckland = script()
    shipped = json.loads(fit_auckland.TARGET.read_text())
    fitted = fit_auckland.fitted()
    numbers = ("ar", "ma", "mean", "sigma")
    for name in numbers:  # another optimiser, CPU or BLAS may end at a slightly different maximum
        np.testing.assert_allclose(np.array(shipped[name]), np.array(fitted[name]), rtol=1e-3)
    assert {k: v for k, v in shipped.items() if k not in numbers} == {
        k: v for k, v in fitted.items() if k not in numbers
    }


def test_the_shipped_model() -> None:
    m = arima.load_fitted()
    assert float(m.ar[0]) == pytest.approx(0.87, abs=0.01)
    assert float(m.sigma) == pytest.approx(224, abs=1)
    assert (m.ma.shape, m.d, m.step) == ((0,), 0, 3600)
    with pytest.raises(SeriesError, match="auckland") as caught:
        arima.load_fitted("shanghai")
    assert caught.value.field == "name"
